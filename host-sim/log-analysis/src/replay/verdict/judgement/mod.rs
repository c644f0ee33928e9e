//! Judgement of a compass as the aircraft flies it now, and what to do with it.

use std::fmt;

use serde::Serialize;

use crate::replay::bending_load::BendingLoad;
use crate::replay::evaluation::CompassEvaluation;
use crate::replay::field_change::{HardIronChange, temporary_change_start_s};
use crate::replay::logged_accuracy::{LoggedAccuracy, UnknownError};
use crate::replay::parameter_choice::{NoParameters, is_mostly_inexpressible};
use crate::replay::parameter_export::orientation::FixedOrientation;
use crate::replay::parameter_export::{ExportedCorrection, HeldBackScore};
use crate::replay::reading_checks::{CheckedMeaning, ReadingCheck};
use crate::replay::sensor_failure::SensorFailure;
use crate::score::{BAD_COMPASS_RMS_DEG, GOOD_COMPASS_RMS_DEG};

/// State of a compass with the parameters in use, on the headings flown.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum CompassState {
    /// At most 2 deg RMS as logged, and no change of hard iron.
    Good,
    /// At most 5 deg RMS as logged, and no change of hard iron with a larger effect.
    Fair,
    /// Over 5 deg RMS, a change of hard iron with an effect of over 5 deg, or a failed sensor.
    Bad,
    /// The log does not show how good the compass is.
    Unjudged,
}

/// Effect of a load that is a reason of a judgement, degrees: half of it, as in cruise, makes a bad compass.
const MIN_BENDING_DEG: f64 = 2.0 * BAD_COMPASS_RMS_DEG;

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
    /// The sensor failed.
    SensorFailed(SensorFailure),
    /// Hard iron changed in flight.
    HardIronChanged {
        /// Start of a temporary change, seconds; none if the last change does not cancel the one before.
        temporary_from_s: Option<f64>,
        /// The last change.
        change: HardIronChange,
    },
    /// A load, such as the motors, bends the field.
    BentBy(BendingLoad),
    /// Heading error as logged.
    AsLogged(LoggedAccuracy),
    /// The log does not show the error as logged; the reason.
    UnknownError(UnknownError),
    /// The report contains parameters; their heading error on held-back rows.
    Parameters(HeldBackScore),
    /// The report contains no parameters; the reason.
    NoParameters(NoParameters),
}

impl JudgementReason {
    /// Stable code of the reason, for programs.
    pub const fn stable_code(&self) -> &'static str {
        match self {
            Self::SensorFailed(_) => "sensor-failed",
            Self::HardIronChanged { .. } => "iron-changed",
            Self::BentBy(_) => "bent-by-load",
            Self::AsLogged(accuracy) if accuracy.rms_deg <= GOOD_COMPASS_RMS_DEG => "good-as-logged",
            Self::AsLogged(_) => "error-as-logged",
            Self::UnknownError(cause) => cause.stable_code(),
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
    /// Heading error as logged since the last change of hard iron, if the log shows it.
    pub logged_accuracy: Option<LoggedAccuracy>,
}

impl CompassJudgement {
    /// Judges a compass by its error as logged and the parameters found for it.
    pub fn new(
        compass: &CompassEvaluation,
        accuracy: Result<LoggedAccuracy, UnknownError>,
        parameters: &Result<ExportedCorrection, NoParameters>,
    ) -> Self {
        let failure = compass.sensor_failure.as_ref();
        let logged_accuracy = accuracy.as_ref().ok().copied();
        let bending_load =
            compass.causes.bending_loads.iter().max_by(|a, b| a.heading_effect_deg.total_cmp(&b.heading_effect_deg));
        let bending_load = bending_load.filter(|load| failure.is_none() && load.heading_effect_deg > MIN_BENDING_DEG);
        let is_wrong = failure.is_some()
            || matches!(parameters, Err(NoParameters::UnprovenReading(check)) if has_changed(check))
            || matches!(accuracy, Err(UnknownError::ContradictsModel { .. }))
            || accuracy.is_err() && bending_load.is_some();
        let compass_state = compass_state(compass, logged_accuracy, is_wrong, parameters);
        let bending_load = bending_load.filter(|_| compass_state != CompassState::Good);
        let recommended_action = match parameters {
            _ if failure.is_some() => CompassAction::Replace,
            Ok(_) => CompassAction::LoadParameters,
            Err(rejection) => match action_without_parameters(compass_state, rejection) {
                // Another flight has the same load.
                CompassAction::FlyAgain if bending_load.is_some() => CompassAction::Replace,
                action => action,
            },
        };
        let changed = compass.causes.hard_iron_changes.last().map(|change| JudgementReason::HardIronChanged {
            temporary_from_s: temporary_change_start_s(&compass.causes.hard_iron_changes),
            change: *change,
        });
        let is_unjudged = accuracy.is_err();
        let accuracy = match accuracy {
            // In a log that is read wrongly an error is not the compass's.
            _ if compass_state == CompassState::Unjudged && is_contradicted(parameters) => None,
            Ok(accuracy) => Some(JudgementReason::AsLogged(accuracy)),
            // A failed or bent sensor needs no remark that its error is unknown.
            Err(_) if failure.is_some() || bending_load.is_some() => None,
            Err(cause) => Some(JudgementReason::UnknownError(cause)),
        };
        let parameter_reason = match parameters {
            _ if failure.is_some() => None,
            Ok(export) => export.held_back_score.map(JudgementReason::Parameters),
            // What the log lacks for a judgement, it lacks for parameters, too.
            Err(_) if is_unjudged && !is_contradicted(parameters) => None,
            Err(rejection) => Some(JudgementReason::NoParameters(rejection.clone())),
        };
        let reasons = failure
            .cloned()
            .map(JudgementReason::SensorFailed)
            .into_iter()
            .chain(changed)
            .chain(bending_load.cloned().map(JudgementReason::BentBy))
            .chain(accuracy)
            .chain(parameter_reason)
            .collect();
        Self { compass_state, recommended_action, reasons, logged_accuracy }
    }

    /// Codes of the reasons.
    pub fn reason_codes(&self) -> Vec<&'static str> {
        self.reasons.iter().map(JudgementReason::stable_code).collect()
    }
}

/// Whether a failed check contradicts the reading of the log.
fn is_contradicted(parameters: &Result<ExportedCorrection, NoParameters>) -> bool {
    matches!(parameters, Err(NoParameters::UnprovenReading(check)) if check.outcome.is_failed())
}

/// Whether a check shows that the sensor changed in flight.
fn has_changed(check: &ReadingCheck) -> bool {
    check.meaning == CheckedMeaning::Constancy && check.outcome.is_failed()
}

fn compass_state(
    compass: &CompassEvaluation,
    accuracy: Option<LoggedAccuracy>,
    is_wrong: bool,
    parameters: &Result<ExportedCorrection, NoParameters>,
) -> CompassState {
    let effects_deg = compass.causes.hard_iron_changes.iter().map(|change| change.heading_effect_deg);
    let largest_effect_deg = effects_deg.reduce(f64::max);
    let is_over = |limit_deg: f64| {
        accuracy.is_some_and(|accuracy| accuracy.rms_deg > limit_deg)
            || largest_effect_deg.is_some_and(|effect_deg| effect_deg > limit_deg)
    };
    if is_wrong || is_over(BAD_COMPASS_RMS_DEG) {
        CompassState::Bad
    } else if accuracy.is_none() || is_contradicted(parameters) {
        CompassState::Unjudged
    } else if largest_effect_deg.is_some() || is_over(GOOD_COMPASS_RMS_DEG) {
        CompassState::Fair
    } else {
        CompassState::Good
    }
}

fn action_without_parameters(compass_state: CompassState, rejection: &NoParameters) -> CompassAction {
    match rejection {
        NoParameters::UnprovenReading(check) if has_changed(check) => CompassAction::Replace,
        NoParameters::UnprovenReading(check) if check.outcome.is_failed() => CompassAction::CorrectReading,
        _ if compass_state == CompassState::Good => CompassAction::LeaveUnchanged,
        NoParameters::OffsetsTooLarge { .. } => CompassAction::Replace,
        NoParameters::Turned(turned) => match turned.reason {
            FixedOrientation::UnconfirmedAngle | FixedOrientation::UnconfirmedSense => CompassAction::FlyAgain,
            FixedOrientation::Internal => CompassAction::Replace,
            _ => CompassAction::CorrectReading,
        },
        // What does not show how good the compass is does not show either that it is to be replaced.
        _ if compass_state == CompassState::Unjudged => CompassAction::FlyAgain,
        // Another flight in the same kind of log has no parameters either.
        NoParameters::UnprovenReading(check) if check.meaning == CheckedMeaning::Slot => CompassAction::CorrectReading,
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
        NoParameters::NoGain(_) if compass_state == CompassState::Fair => CompassAction::LeaveUnchanged,
        _ => CompassAction::FlyAgain,
    }
}

impl CompassState {
    /// The state in a word.
    #[must_use]
    pub const fn state_word(self) -> &'static str {
        match self {
            Self::Good => "good",
            Self::Fair => "fair",
            Self::Bad => "bad",
            Self::Unjudged => "unjudged",
        }
    }
}

impl fmt::Display for CompassJudgement {
    /// The judgement as a predicate: "is off by 7.3 deg RMS; with these parameters 0.6: load them".
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut separator = "";
        for reason in &self.reasons {
            let text = match reason {
                JudgementReason::SensorFailed(failure) => format!("failed: {failure}"),
                JudgementReason::HardIronChanged { temporary_from_s, change } => {
                    let HardIronChange { time_s, step_ut, heading_effect_deg, .. } = change;
                    let [had, since, bent] = match temporary_from_s {
                        Some(from_s) => ["had", &format!("from {from_s:.0} to"), "bent"],
                        None => ["has", "since", "bends"],
                    };
                    format!(
                        "{had} other iron around it {since} {:.0} s, by {:.1} uT, which {bent} headings by up to \
                         {heading_effect_deg:.0} deg",
                        time_s,
                        step_ut.norm()
                    )
                }
                JudgementReason::BentBy(load) => format!("is bent by {}", load.cause.summary()),
                JudgementReason::AsLogged(accuracy) if self.compass_state == CompassState::Good => {
                    format!("is good already ({accuracy})")
                }
                JudgementReason::AsLogged(accuracy) if accuracy.rms_deg <= GOOD_COMPASS_RMS_DEG => {
                    format!("since then it is good ({accuracy})")
                }
                JudgementReason::AsLogged(accuracy) => format!("is off by {accuracy}"),
                JudgementReason::UnknownError(cause) if self.compass_state == CompassState::Bad => {
                    format!("is wrong: {cause}")
                }
                JudgementReason::UnknownError(cause) => format!("cannot be judged: {cause}"),
                JudgementReason::Parameters(HeldBackScore {
                    rms_deg, as_logged_rms_deg, is_estimate: true, ..
                }) => format!(
                    "with these parameters its field is consistent to {rms_deg:.1} deg, as logged to \
                     {as_logged_rms_deg:.1}"
                ),
                JudgementReason::Parameters(HeldBackScore { rms_deg, .. }) if *rms_deg > GOOD_COMPASS_RMS_DEG => {
                    format!("with these parameters {rms_deg:.1}, part of it what they cannot express")
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
