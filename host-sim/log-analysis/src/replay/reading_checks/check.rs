//! A check of a meaning, and its outcome.

use std::fmt;

use serde::Serialize;

use crate::numbers::json_name;

/// Meaning of a log that a check confirms.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum CheckedMeaning {
    /// The slot of the compass in the names of the autopilot's parameters.
    Slot,
    /// The autopilot's correction of the field, by the parameters of the log.
    Correction,
    /// The axes of the attitude: those of the body.
    Attitude,
    /// The field turns against the body rates, and follows the attitude: signs of field, attitude and rates agree.
    Sense,
    /// The sensor: its gain, signs and registers are the same throughout the flight.
    #[serde(rename = "sensor-constancy")]
    Constancy,
    /// The unit of the field: its strength is that of the Earth's field.
    Unit,
    /// The inclination of the corrected field, its sign first.
    Inclination,
    /// The mean of the heading errors, against true north.
    North,
    /// The sense in which the reference heading counts.
    Reference,
}

/// Outcome of a check, with the finding.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum CheckOutcome {
    /// The data confirm the reading.
    Passed,
    /// The data confirm the reading, and show something else that matters.
    PassedWith(String),
    /// The data contradict the reading.
    Failed(String),
    /// The log has too little for the check.
    Unchecked(String),
}

/// Check of one meaning of a compass's log.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ReadingCheck {
    /// Checked meaning.
    pub meaning: CheckedMeaning,
    /// Outcome of the check.
    pub outcome: CheckOutcome,
}

impl CheckedMeaning {
    /// Whether parameters are given only if the check passes. The others may lack a place, or a reference.
    pub const fn is_required(self) -> bool {
        matches!(self, Self::Slot | Self::Attitude | Self::Sense | Self::Unit)
    }
}

impl CheckOutcome {
    pub(super) fn unchecked(missing: &str) -> Self {
        Self::Unchecked(missing.to_owned())
    }

    /// Stable name of the outcome, for programs.
    pub const fn stable_code(&self) -> &'static str {
        match self {
            Self::Passed | Self::PassedWith(_) => "passed",
            Self::Failed(_) => "failed",
            Self::Unchecked(_) => "unchecked",
        }
    }

    /// Whether the data contradict the reading.
    pub const fn is_failed(&self) -> bool {
        matches!(self, Self::Failed(_))
    }

    /// The finding; none if the check passed without one.
    pub fn finding(&self) -> Option<&str> {
        match self {
            Self::Passed => None,
            Self::PassedWith(finding) | Self::Failed(finding) | Self::Unchecked(finding) => Some(finding),
        }
    }
}

impl fmt::Display for ReadingCheck {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} {}", json_name(self.meaning), self.outcome.stable_code())?;
        self.outcome.finding().map_or(Ok(()), |finding| write!(f, ": {finding}"))
    }
}
