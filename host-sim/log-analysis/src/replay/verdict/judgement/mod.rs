//! Judgement of a compass as the aircraft flies it now, and what to do with it.

use std::fmt;

use serde::Serialize;

use crate::replay::evaluation::{CompassEvaluation, FlightEvaluation, heading_deg};
use crate::replay::hard_iron_changes::temporary_change_start_s;
use crate::replay::log_warning::LogWarning;
use crate::replay::parameter_choice::{
    BAD_COMPASS_RMS_DEG, GOOD_COMPASS_RMS_DEG, NoParameters, is_mostly_inexpressible,
};
use crate::replay::parameter_export::orientation::FixedOrientation;
use crate::replay::parameter_export::{ExportedCorrection, HeldBackScore};
use crate::replay::reading_checks::{CheckedMeaning, ReadingCheck};
use crate::replay::reference::ReferenceHeading;
use crate::replay::row::ReplayRow;
use crate::replay::row_headings::{covers_headings, score_rows};

/// State of a compass with the parameters in use.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum CompassState {
    /// The compass is good: at most 2 deg RMS as logged, and no change of hard iron.
    Good,
    /// The compass is neither good nor bad, or it cannot be judged: no reference of 2 deg or better, or too few
    /// headings.
    Doubtful,
    /// Over 5 deg RMS, a change of hard iron with an effect of over 5 deg, or a failed sensor.
    Bad,
}

/// What the pilot is advised to do about a compass.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum CompassAction {
    /// Load the exported parameters.
    #[serde(rename = "load")]
    LoadParameters,
    /// Leave compass and parameters unchanged.
    #[serde(rename = "leave")]
    LeaveUnchanged,
    /// Fly again, since this flight does not determine parameters.
    FlyAgain,
    /// Replace or move the compass.
    Replace,
    /// Correct how the log is read, or the setting that it shows to be wrong; until then nothing is known.
    CorrectReading,
}

/// Reason of a judgement; displayed as a clause.
#[derive(Clone, Debug, PartialEq)]
pub enum JudgementReason {
    /// The sensor failed; contains the warning about its failure.
    SensorFailed(LogWarning),
    /// Hard iron changed in flight.
    HardIronChanged {
        /// Start of a temporary change, seconds; none if the last change does not cancel the one before.
        temporary_from_s: Option<f64>,
        /// Time of the last change, seconds of the log.
        at_s: f64,
        /// Size of the change, microtesla.
        size_ut: f64,
        /// Largest effect on a level heading, degrees.
        heading_effect_deg: f64,
    },
    /// Heading error as logged, degrees RMS less mean.
    ErrorAsLogged(f64),
    /// The log has no reference of 2 deg or better.
    NoReference,
    /// The log has too few headings with a reference.
    FewHeadings,
    /// The report contains parameters; their heading error on held-back rows.
    Parameters(HeldBackScore),
    /// The report contains no parameters; the reason.
    NoParameters(NoParameters),
}

impl JudgementReason {
    /// Stable code of the reason, for programs.
    #[must_use]
    pub const fn stable_code(&self) -> &'static str {
        match self {
            Self::SensorFailed(_) => "sensor-failed",
            Self::HardIronChanged { .. } => "iron-changed",
            Self::ErrorAsLogged(rms_deg) if *rms_deg <= GOOD_COMPASS_RMS_DEG => "good-as-logged",
            Self::ErrorAsLogged(_) => "error-as-logged",
            Self::NoReference => "no-reference",
            Self::FewHeadings => "few-headings",
            Self::Parameters(_) => "parameters-gain",
            Self::NoParameters(no_parameters) => no_parameters.stable_code(),
        }
    }
}

/// Judgement of a compass.
#[derive(Clone, Debug, PartialEq)]
pub struct CompassJudgement {
    /// State of the compass.
    pub compass_state: CompassState,
    /// Action that the pilot is advised to take.
    pub recommended_action: CompassAction,
    /// Reasons of the judgement.
    pub reasons: Vec<JudgementReason>,
    /// Heading error as logged since the last change of hard iron, degrees RMS less mean; none without a reference of 2
    /// deg or better.
    pub as_logged_rms_deg: Option<f64>,
}

impl CompassJudgement {
    /// Judges a compass by its evaluation and the parameters found for it.
    #[must_use]
    pub fn new(
        evaluation: &FlightEvaluation,
        compass: &CompassEvaluation,
        failure: Option<LogWarning>,
        parameters: &Result<ExportedCorrection, NoParameters>,
    ) -> Self {
        let as_logged_rms_deg = as_logged_rms_deg(evaluation, compass);
        let change = compass.hard_iron_changes.last();
        let largest_effect_deg =
            compass.hard_iron_changes.iter().map(|change| change.heading_effect_deg).fold(0.0, f64::max);
        let is_contradicted =
            matches!(parameters, Err(NoParameters::UnprovenReading(check)) if check.outcome.is_failed());
        let compass_state = match as_logged_rms_deg {
            _ if failure.is_some() || largest_effect_deg > BAD_COMPASS_RMS_DEG => CompassState::Bad,
            Some(rms_deg) if rms_deg > BAD_COMPASS_RMS_DEG => CompassState::Bad,
            Some(rms_deg) if rms_deg <= GOOD_COMPASS_RMS_DEG && change.is_none() && !is_contradicted => {
                CompassState::Good
            }
            _ => CompassState::Doubtful,
        };
        let recommended_action = if failure.is_some() {
            CompassAction::Replace
        } else {
            let covers_headings = as_logged_rms_deg.is_some() || accurate_reference(evaluation).is_none();
            parameters.as_ref().map_or_else(
                |rejection| action_without_parameters(compass_state, rejection, covers_headings),
                |_| CompassAction::LoadParameters,
            )
        };
        let changed = change.map(|change| JudgementReason::HardIronChanged {
            temporary_from_s: temporary_change_start_s(&compass.hard_iron_changes),
            at_s: change.hard_iron_step.time_s,
            size_ut: change.hard_iron_step.size_ut(),
            heading_effect_deg: change.heading_effect_deg,
        });
        let unknown = if accurate_reference(evaluation).is_some() {
            JudgementReason::FewHeadings
        } else {
            JudgementReason::NoReference
        };
        // A failed sensor needs no remark that its error is unknown.
        let accuracy =
            as_logged_rms_deg.map(JudgementReason::ErrorAsLogged).or_else(|| failure.is_none().then_some(unknown));
        let parameter_reason = match parameters {
            _ if failure.is_some() => None,
            Ok(export) => export.held_back_score.map(JudgementReason::Parameters),
            Err(rejection) => Some(JudgementReason::NoParameters(rejection.clone())),
        };
        let reasons = failure
            .map(JudgementReason::SensorFailed)
            .into_iter()
            .chain(changed)
            .chain(accuracy)
            .chain(parameter_reason)
            .collect();
        Self { compass_state, recommended_action, reasons, as_logged_rms_deg }
    }

    /// Codes of the reasons.
    #[must_use]
    pub fn reason_codes(&self) -> Vec<&'static str> {
        self.reasons.iter().map(JudgementReason::stable_code).collect()
    }
}

/// Action without parameters; `covers_headings` is false if the flight has too few headings for a judgement.
fn action_without_parameters(
    compass_state: CompassState,
    rejection: &NoParameters,
    covers_headings: bool,
) -> CompassAction {
    match rejection {
        NoParameters::UnprovenReading(ReadingCheck { meaning: CheckedMeaning::Constancy, .. }) => {
            CompassAction::Replace
        }
        NoParameters::UnprovenReading(check) if check.outcome.is_failed() => CompassAction::CorrectReading,
        NoParameters::OffsetsTooLarge { .. } => CompassAction::Replace,
        NoParameters::Turned(turned) => match turned.reason {
            FixedOrientation::UnconfirmedAngle | FixedOrientation::UnconfirmedSense => CompassAction::FlyAgain,
            FixedOrientation::Internal => CompassAction::Replace,
            _ => CompassAction::CorrectReading,
        },
        // On few headings neither the compass nor a fit is judged.
        _ if !covers_headings => CompassAction::FlyAgain,
        // Another flight does not reduce the loss by the symmetric matrix.
        NoParameters::Inaccurate { held_back, inexpressible_error_deg }
            if is_mostly_inexpressible(held_back.rms_deg, *inexpressible_error_deg) =>
        {
            CompassAction::Replace
        }
        NoParameters::NoGain(held_back) | NoParameters::Inaccurate { held_back, .. }
            if !held_back.is_estimate && held_back.rms_deg.min(held_back.field_scatter_deg) > BAD_COMPASS_RMS_DEG =>
        {
            CompassAction::Replace
        }
        _ if compass_state == CompassState::Good => CompassAction::LeaveUnchanged,
        NoParameters::NoGain(_) if compass_state == CompassState::Doubtful => CompassAction::LeaveUnchanged,
        _ => CompassAction::FlyAgain,
    }
}

fn accurate_reference(evaluation: &FlightEvaluation) -> Option<&ReferenceHeading> {
    evaluation.reference.as_ref().filter(|reference| reference.sigma_if_accurate_deg().is_some())
}

/// Heading error as logged since the last change of hard iron, degrees RMS less mean; none on too few headings.
fn as_logged_rms_deg(evaluation: &FlightEvaluation, compass: &CompassEvaluation) -> Option<f64> {
    accurate_reference(evaluation)?;
    let rows: Vec<ReplayRow> = compass.parameter_fit.fitted_rows(&compass.rows).copied().collect();
    if !covers_headings(&rows) {
        return None;
    }
    let logged = score_rows(&rows, |row| Some((heading_deg(row, row.logged_field.ut.map(f64::from)), f64::NAN)));
    logged.map(|score| score.rms_deg)
}

impl fmt::Display for CompassState {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Good => "good",
            Self::Doubtful => "doubtful",
            Self::Bad => "bad",
        })
    }
}

impl fmt::Display for CompassJudgement {
    /// The judgement as a predicate: "is off by 7.3 deg RMS; with these parameters 0.6: load them".
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut separator = "";
        for reason in &self.reasons {
            let text = match reason {
                JudgementReason::SensorFailed(warning) => {
                    let warning = warning.to_string();
                    format!("failed: {}", warning.split_once(": ").map_or(warning.as_str(), |(_, rest)| rest))
                }
                JudgementReason::HardIronChanged {
                    temporary_from_s: Some(from_s),
                    at_s,
                    size_ut,
                    heading_effect_deg,
                } => format!(
                    "had other iron around it from {from_s:.0} to {at_s:.0} s, by {size_ut:.1} uT, which bent headings \
                     by up to {heading_effect_deg:.0} deg"
                ),
                JudgementReason::HardIronChanged { at_s, size_ut, heading_effect_deg, .. } => format!(
                    "has other iron around it since {at_s:.0} s, by {size_ut:.1} uT, which bends headings by up to \
                     {heading_effect_deg:.0} deg"
                ),
                JudgementReason::ErrorAsLogged(rms_deg) if self.compass_state == CompassState::Good => {
                    format!("is good already ({rms_deg:.2} deg RMS)")
                }
                JudgementReason::ErrorAsLogged(rms_deg) => format!("is off by {rms_deg:.1} deg RMS"),
                JudgementReason::FewHeadings => "was flown on too few headings to be judged".to_owned(),
                JudgementReason::NoReference => {
                    "cannot be compared with a heading of 2 deg or better in this log".to_owned()
                }
                JudgementReason::Parameters(HeldBackScore {
                    rms_deg, as_logged_rms_deg, is_estimate: true, ..
                }) => format!(
                    "with these parameters its field is consistent to {rms_deg:.1} deg, as logged to \
                     {as_logged_rms_deg:.1}"
                ),
                JudgementReason::Parameters(HeldBackScore { rms_deg, .. }) if *rms_deg > GOOD_COMPASS_RMS_DEG => {
                    format!(
                        "with these parameters {rms_deg:.1}, part of it what the autopilot's parameters cannot express"
                    )
                }
                JudgementReason::Parameters(HeldBackScore { rms_deg, .. }) => {
                    format!("with these parameters {rms_deg:.1}")
                }
                JudgementReason::NoParameters(_) if self.compass_state == CompassState::Good => continue,
                JudgementReason::NoParameters(no_parameters) => no_parameters.to_string(),
            };
            write!(f, "{separator}{text}")?;
            separator = "; ";
        }
        f.write_str(match self.recommended_action {
            CompassAction::LoadParameters => ": load them",
            CompassAction::LeaveUnchanged => ": leave it as it is",
            CompassAction::FlyAgain => ": fly again",
            CompassAction::Replace => ": replace or move it",
            CompassAction::CorrectReading => ": correct that first",
        })
    }
}

#[cfg(test)]
mod tests;
