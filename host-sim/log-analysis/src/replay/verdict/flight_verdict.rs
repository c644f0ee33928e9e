//! The verdict on a flight and its compasses.

use super::judgement::{CompassAction, CompassJudgement, CompassState};
use crate::log::LoggedFlight;
use crate::numbers::format_number;
use crate::replay::compass_agreement::{Disagreement, disagreement};
use crate::replay::evaluation::{CompassEvaluation, CorrectionSource, FlightEvaluation};
use crate::replay::log_warning::warnings_of_flight;
use crate::replay::logged_accuracy::logged_accuracy;
use crate::replay::parameter_choice::{NoParameters, choose_parameters, provable_orientation};
use crate::replay::parameter_export::{ExportedCorrection, ParameterFormat};
use crate::replay::reading_checks::{ReadingCheck, check_reading, forbidding_check};

/// Verdict on a flight.
#[derive(Clone, Debug)]
pub struct Verdict<'a> {
    /// The evaluated log.
    pub flight: &'a LoggedFlight,
    /// Evaluation of the flight.
    pub evaluation: &'a FlightEvaluation,
    /// Warnings about the log.
    pub log_warnings: Vec<String>,
    /// The compasses, by number.
    pub compasses: Vec<CompassVerdict<'a>>,
    /// Format of the parameters.
    pub parameter_format: ParameterFormat,
}

/// Verdict on a compass.
#[derive(Clone, Debug)]
pub struct CompassVerdict<'a> {
    /// Number, place, chip and bus of the sensor, as far as the log has them.
    pub compass_name: String,
    /// Evaluation of the compass.
    pub evaluation: &'a CompassEvaluation,
    /// State of the compass, and what to do with it.
    pub judgement: CompassJudgement,
    /// Parameters to load, or the reason for giving none.
    pub parameters: Result<ExportedCorrection, NoParameters>,
    /// Checks that the log means what it was read as.
    pub reading_checks: Vec<ReadingCheck>,
    /// Difference from two other compasses that agree.
    pub disagreement: Option<Disagreement>,
}

impl<'a> Verdict<'a> {
    /// Verdict on an evaluated log; `format` is that of the parameters.
    #[must_use]
    pub fn new(flight: &'a LoggedFlight, evaluation: &'a FlightEvaluation, format: ParameterFormat) -> Self {
        let mut used_rotations = Vec::new();
        let compass = |compass: &'a CompassEvaluation| {
            let reading_checks = check_reading(flight, evaluation, compass);
            let parameters = match forbidding_check(&reading_checks) {
                Some(check) if check.outcome.is_failed() => Err(NoParameters::UnprovenReading(check.clone())),
                unconfirmed => {
                    let orientation =
                        provable_orientation(flight, evaluation, compass, format, &reading_checks, &used_rotations);
                    let chosen = choose_parameters(flight, evaluation, compass, format, orientation);
                    chosen.and_then(|exported| {
                        unconfirmed.map_or(Ok(exported), |check| Err(NoParameters::UnprovenReading(check.clone())))
                    })
                }
            };
            used_rotations.extend(parameters.as_ref().ok().and_then(|exported| exported.orientation.custom_rotation()));
            CompassVerdict {
                compass_name: compass_name(flight, compass.compass_number),
                evaluation: compass,
                judgement: CompassJudgement::new(compass, logged_accuracy(flight, evaluation, compass), &parameters),
                parameters,
                reading_checks,
                disagreement: disagreement(&evaluation.compasses, compass),
            }
        };
        Self {
            flight,
            evaluation,
            log_warnings: warnings_of_flight(flight, evaluation),
            compasses: evaluation.compasses.iter().map(compass).collect(),
            parameter_format: format,
        }
    }

    /// The compasses, those in use first.
    #[must_use]
    pub fn compasses_in_use_first(&self) -> Vec<&CompassVerdict<'a>> {
        let mut compasses: Vec<&CompassVerdict<'a>> = self.compasses.iter().collect();
        // Compasses of unknown use come after used ones and before unused ones.
        compasses.sort_by_key(|compass| match compass.evaluation.is_used_for_heading {
            Some(true) => 0,
            None => 1,
            Some(false) => 2,
        });
        compasses
    }

    /// First compass that the autopilot's heading uses, or may use; none if it uses none of them.
    #[must_use]
    pub fn compass_in_use(&self) -> Option<&CompassVerdict<'a>> {
        let first = self.compasses_in_use_first().first().copied();
        first.filter(|compass| compass.state_in_use().is_some())
    }

    /// Whether the compass in use is good, or has parameters to load; so it is if none is in use.
    #[must_use]
    pub fn is_good_or_correctable(&self) -> bool {
        self.compass_in_use().is_none_or(|compass| {
            compass.judgement.compass_state == CompassState::Good
                || compass.judgement.recommended_action == CompassAction::LoadParameters
        })
    }

    /// Judgement of each compass, in sentences.
    pub fn summary_sentences(&self) -> Vec<String> {
        self.compasses_in_use_first().into_iter().map(CompassVerdict::summary_sentence).collect()
    }

    /// Parameters to load, of all compasses for which the verdict gives some.
    #[must_use]
    pub fn exported_corrections(&self) -> Vec<ExportedCorrection> {
        self.compasses.iter().filter_map(|compass| compass.parameters_to_load().cloned()).collect()
    }

    /// Name and duration of the log.
    #[must_use]
    pub fn log_description(&self, name: &str) -> String {
        let [from_s, to_s] = self.flight.time_range_s();
        let firmware = self.flight.firmware_name.as_deref().unwrap_or("firmware not named");
        let [duration_s, from_s, to_s] = [to_s - from_s, from_s, to_s].map(|time_s| format_number(time_s, 0));
        format!(
            "{name}: {}, {firmware}, {duration_s} s: {from_s} to {to_s} s of its clock",
            self.flight.log_format.format_name()
        )
    }

    /// RMS less mean against the reference by correction and compass, degrees; corrections without any are omitted.
    #[must_use]
    pub fn rms_by_correction_deg(&self) -> Vec<(&'static str, Vec<Option<f64>>)> {
        let rows = CorrectionSource::ALL_SOURCES.map(|source| {
            let rms_deg = |compass: &CompassEvaluation| Some(compass.score_by(source)?.rms_deg);
            (source.source_name(), self.evaluation.compasses.iter().map(rms_deg).collect::<Vec<_>>())
        });
        let held_back = |compass: &CompassVerdict<'_>| {
            compass.parameters_to_load()?.held_back_score.filter(|score| !score.is_estimate).map(|score| score.rms_deg)
        };
        let parameters = ("parameters to load", self.compasses.iter().map(held_back).collect());
        rows.into_iter().chain([parameters]).filter(|(_, cells)| cells.iter().any(Option::is_some)).collect()
    }
}

fn compass_name(flight: &LoggedFlight, compass_number: u8) -> String {
    match flight.sensor_description(compass_number) {
        sensor if sensor.is_empty() => format!("Compass {compass_number}"),
        sensor => format!("Compass {compass_number} ({sensor})"),
    }
}

impl CompassVerdict<'_> {
    /// Parameters of the compass, if the judgement is to load them.
    #[must_use]
    pub fn parameters_to_load(&self) -> Option<&ExportedCorrection> {
        self.parameters.as_ref().ok().filter(|_| self.judgement.recommended_action == CompassAction::LoadParameters)
    }

    /// State of a compass that the autopilot uses, or may use; none of others, which harm no flight.
    #[must_use]
    pub fn state_in_use(&self) -> Option<CompassState> {
        (self.evaluation.is_used_for_heading != Some(false)).then_some(self.judgement.compass_state)
    }

    /// The state in a word, or that the compass is unused.
    pub fn state_word(&self) -> &'static str {
        self.state_in_use().map_or("unused", CompassState::state_word)
    }

    /// Judgement of the compass, a sentence.
    #[must_use]
    pub fn summary_sentence(&self) -> String {
        let use_text = if self.evaluation.is_used_for_heading == Some(true) { ", in use," } else { "" };
        format!("{}{use_text} {}.", self.compass_name, self.judgement)
    }

    /// Percentage of usable rows for which the module, so calibrated, would have sent a heading.
    #[must_use]
    pub fn sent_percent(&self) -> Option<f64> {
        let rows = self.evaluation.rows.iter().zip(&self.evaluation.module_result.as_ref()?.headings);
        let sent_flags: Vec<bool> =
            rows.filter(|(row, _)| row.is_usable).map(|(_, heading)| heading.status.is_ok()).collect();
        let usable_count = sent_flags.iter().filter(|is_sent| **is_sent).count();
        (!sent_flags.is_empty()).then(|| 100.0 * usable_count as f64 / sent_flags.len() as f64)
    }
}
