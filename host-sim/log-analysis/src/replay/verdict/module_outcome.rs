//! Whether and when the module would have calibrated itself.

use std::fmt;

use autoswing_module::messages::Refusal;

use crate::numbers::format_number;
use crate::replay::evaluation::CompassEvaluation;

/// Whether and when the module would have calibrated a compass; displayed as a phrase.
#[derive(Clone, Debug, PartialEq)]
pub enum CompassOutcome {
    /// Calibrated without a command at this time of the log, seconds.
    Automatic(f64),
    /// Calibrated only by a command at the end of the log.
    Commanded,
    /// The module would have refused the calibration.
    Refused(Refusal),
}

impl CompassOutcome {
    /// Outcome of a compass; none if no module is compared.
    #[must_use]
    pub fn new(compass: &CompassEvaluation) -> Option<Self> {
        let outcome = match (&compass.module_result.as_ref()?.acceptance, compass.calibration_time_s()) {
            (Err(refusal), _) => Self::Refused(refusal.clone()),
            (Ok(()), Some(at_s)) => Self::Automatic(at_s),
            (Ok(()), None) => Self::Commanded,
        };
        Some(outcome)
    }
}

impl fmt::Display for CompassOutcome {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Automatic(at_s) => {
                write!(f, "would have calibrated itself at {} s of the log", format_number(*at_s, 0))
            }
            Self::Commanded => f.write_str("would have calibrated by a command at the end"),
            Self::Refused(refusal) => write!(f, "would have been refused: {}: {refusal}", refusal.stable_code()),
        }
    }
}
