//! A request to judge a log, checked against the log: the command line and the page answer with the same errors.

use std::fmt;

use super::evaluation::{EvaluationOptions, FlightEvaluation, evaluate_flight};
use super::parameter_export::CorrectedTerms;
use super::reference::{ReferenceHeading, ReferenceKind};
use crate::log::{LogError, LoggedFlight};
use crate::numbers::json_name;

/// Fewest usable rows of a chosen part of a log: 2 s at 10 Hz.
const MIN_ROWS_OF_PART: usize = 20;

/// Reason why a log is not judged as requested.
#[derive(Debug)]
pub enum JudgementError {
    /// The log cannot be read.
    Log(LogError),
    /// The orientation of a compass is that of the autopilot's board, or unknown; its number.
    FixedOrientation(u8),
    /// The part of the log ends before it begins; its first and last time, seconds.
    ReversedTimeRange([f64; 2]),
    /// The part is outside the log; times of the log, seconds.
    TimeRangeOutsideLog([f64; 2]),
    /// The part has too few usable rows; their number.
    FewRowsInTimeRange(usize),
    /// The log does not have the compass; numbers of those it has.
    NoSuchCompass(Vec<u8>),
    /// The log does not have the reference heading; those it has.
    NoSuchReference(Vec<ReferenceKind>),
}

impl JudgementError {
    /// Stable code of the reason, for programs.
    #[must_use]
    pub const fn stable_code(&self) -> &'static str {
        match self {
            Self::Log(error) => error.stable_code(),
            Self::FixedOrientation(_) => "fixed-orientation",
            Self::ReversedTimeRange(_) => "reversed-time-range",
            Self::TimeRangeOutsideLog(_) => "time-range-outside-log",
            Self::FewRowsInTimeRange(_) => "few-rows-in-time-range",
            Self::NoSuchCompass(_) => "no-such-compass",
            Self::NoSuchReference(_) => "no-such-reference",
        }
    }

    /// The error of a log as the command line and the page show it: code, name of the log, sentence.
    #[must_use]
    pub fn text_for_log(&self, log_name: &str) -> String {
        format!("{}: {log_name}: {self}", self.stable_code())
    }
}

impl From<LogError> for JudgementError {
    fn from(error: LogError) -> Self {
        Self::Log(error)
    }
}

impl std::error::Error for JudgementError {}

impl fmt::Display for JudgementError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let list = |names: Vec<String>| if names.is_empty() { "none".to_owned() } else { names.join(", ") };
        match self {
            Self::Log(error) => error.fmt(f),
            Self::FixedOrientation(number) => write!(
                f,
                "the orientation of compass {number} is that of the autopilot's board, or unknown; choose another compass"
            ),
            Self::ReversedTimeRange([from_s, to_s]) => {
                write!(f, "the part from {from_s} to {to_s} s ends before it begins")
            }
            Self::TimeRangeOutsideLog([first_s, last_s]) => {
                write!(f, "the log has no rows in this part; it has {first_s:.0} to {last_s:.0} s")
            }
            Self::FewRowsInTimeRange(count) => {
                write!(f, "this part has {count} usable rows; choose a longer part, in flight")
            }
            Self::NoSuchCompass(numbers) => write!(
                f,
                "the log has no compass of this number; it has {}",
                list(numbers.iter().map(u8::to_string).collect())
            ),
            Self::NoSuchReference(kinds) => write!(
                f,
                "the log has no such reference heading; it has {}",
                list(kinds.iter().map(json_name).collect())
            ),
        }
    }
}

/// Evaluates a log after checking that the options fit it.
///
/// # Errors
///
/// The log lacks the compass, the reference or the part.
pub fn evaluate_as_requested(
    flight: &LoggedFlight,
    options: &EvaluationOptions,
) -> Result<FlightEvaluation, JudgementError> {
    let [from_s, to_s] = options.time_window_s;
    let [first_s, last_s] = flight.time_range_s();
    if from_s >= to_s {
        return Err(JudgementError::ReversedTimeRange([from_s, to_s]));
    }
    if from_s > last_s || to_s < first_s {
        return Err(JudgementError::TimeRangeOutsideLog([first_s, last_s]));
    }
    let numbers: Vec<u8> = flight.compasses.iter().map(|compass| compass.compass_number).collect();
    if options.compass_number.is_some_and(|number| !numbers.contains(&number)) {
        return Err(JudgementError::NoSuchCompass(numbers));
    }
    let has_reference = |kind: &ReferenceKind| ReferenceHeading::of_kind(flight, *kind).is_some();
    if options.reference_kind.is_some_and(|kind| !has_reference(&kind)) {
        let available = ReferenceKind::ALL_KINDS.into_iter().filter(has_reference).collect();
        return Err(JudgementError::NoSuchReference(available));
    }
    let evaluation = evaluate_flight(flight, options);
    let is_part = from_s > first_s || to_s < last_s;
    let used_rows = evaluation.compasses.iter().map(|compass| compass.row_counts.used).max().unwrap_or(0);
    if is_part && used_rows < MIN_ROWS_OF_PART {
        return Err(JudgementError::FewRowsInTimeRange(used_rows));
    }
    Ok(evaluation)
}

/// Options that were given, name and value, for the report.
pub fn settings_table(options: &EvaluationOptions) -> Vec<[String; 2]> {
    let [from_s, to_s] = options.time_window_s;
    let seconds = |time_s: f64| time_s.is_finite().then(|| format!("{time_s} s"));
    let settings = [
        ("module", options.compared_module.map(json_name)),
        ("age of the field", options.field_latency_s.map(|age_s| format!("{} ms", age_s * 1e3))),
        ("inclination", options.inclination_deg.map(|inclination_deg| format!("{inclination_deg} deg"))),
        ("from", seconds(from_s)),
        ("to", seconds(to_s)),
        ("reference", options.reference_kind.map(json_name)),
        (
            "parameters correct",
            (options.corrected_terms != CorrectedTerms::All).then(|| json_name(options.corrected_terms)),
        ),
        ("compass", options.compass_number.map(|number| number.to_string())),
    ];
    settings.into_iter().filter_map(|(name, value)| Some([name.to_owned(), value?])).collect()
}
