//! A log that was read, and its judgement.

use std::io::Read;

use log_analysis::log::csv::FieldUnit;
use log_analysis::log::{self, LogError, LogFormat, LoggedFlight};
use log_analysis::replay::evaluation::EvaluationOptions;
use log_analysis::replay::judgement_request::{JudgementError, evaluate_as_requested, settings_table};
use log_analysis::replay::parameter_export::{CorrectedTerms, ParameterFormat};
use log_analysis::replay::verdict::Verdict;
use log_analysis::replay::{ReferenceKind, RowSelection};
use log_analysis::report::{self, ReportOrigin};
use serde::{Deserialize, Serialize};

/// Request to read a log.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LogRequest {
    /// Names of the chosen files; only one is read.
    pub names: Vec<String>,
    /// Name of the log within a file that holds several.
    #[serde(default)]
    pub log: Option<String>,
    /// Unit of the field, if the log is a table.
    pub unit: FieldUnit,
}

/// Choices on the page, as the options of `host-sim replay`.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PageChoices {
    /// Samples of a module that is compared.
    pub module: Option<RowSelection>,
    /// Number of the only compass to evaluate.
    pub compass: Option<u8>,
    /// First time of the log that is used, seconds.
    pub from_s: Option<f64>,
    /// Last time of the log that is used, seconds.
    pub to_s: Option<f64>,
    /// Heading that errors are measured against; the best in the log if absent.
    pub reference: Option<ReferenceKind>,
    /// Terms that the parameter files correct.
    #[serde(default)]
    pub correct: CorrectedTerms,
    /// Inclination of the Earth field, degrees; needed by a table without place and heading.
    pub inclination_deg: Option<f64>,
}

/// Contents of a log that the page offers choices of.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct LogSummary {
    /// Numbers of the compasses.
    pub compasses: Vec<u8>,
    /// Times of the first and the last row, seconds.
    pub range_s: [f64; 2],
    /// Whether the log is a table, whose unit is not recorded.
    pub is_table: bool,
}

/// Judgement of a log.
#[derive(Clone, Debug, Serialize)]
pub struct JudgedLog {
    /// The report page.
    pub page: String,
    /// The verdict as `host-sim replay --json` prints it.
    pub json: String,
}

/// Reason why a request failed.
#[derive(Clone, Debug, Serialize)]
pub struct RequestFailure {
    /// The reason in words.
    pub error: String,
    /// Names of the logs of which one is to be chosen.
    pub logs: Vec<String>,
}

impl From<String> for RequestFailure {
    fn from(error: String) -> Self {
        Self { error, logs: Vec::new() }
    }
}

/// A log that was read.
#[derive(Debug)]
pub struct LoadedLog {
    name: String,
    flight: LoggedFlight,
}

impl LoadedLog {
    /// Reads a log.
    ///
    /// # Errors
    ///
    /// The source cannot be read, or holds no usable flight, or several of which none is chosen.
    pub fn read_log(source: &mut dyn Read, request: LogRequest) -> Result<Self, RequestFailure> {
        let LogRequest { names, log: chosen, unit } = request;
        let name = names.iter().chain(&chosen).map(String::as_str).collect::<Vec<_>>();
        let name = name.join(if chosen.is_some() { "/" } else { ", " });
        let is_chosen = |log_name: &str| chosen.as_ref().is_none_or(|chosen| log_name == chosen);
        let flight = match names.len() {
            1 => log::only_flight(&mut |visit| {
                log::visit_flights(source, unit, None, &mut |log_name, flight| {
                    if is_chosen(log_name) {
                        visit(log_name, flight);
                    }
                })
            }),
            _ => Err(LogError::SeveralLogs(names)),
        };
        let flight = flight.map_err(|error| {
            let logs = if let LogError::SeveralLogs(logs) = &error { logs.clone() } else { Vec::new() };
            RequestFailure { error: JudgementError::Log(error).text_for_log(&name), logs }
        })?;
        Ok(Self { name, flight })
    }

    /// Contents of the log.
    #[must_use]
    pub fn log_summary(&self) -> LogSummary {
        LogSummary {
            compasses: self.flight.compasses.iter().map(|compass| compass.compass_number).collect(),
            range_s: self.flight.time_range_s(),
            is_table: self.flight.log_format == LogFormat::Csv,
        }
    }

    /// Judges the log.
    ///
    /// # Errors
    ///
    /// The log does not have the compass, the reference or the part.
    pub fn judge_log(&self, choices: &PageChoices) -> Result<JudgedLog, String> {
        let Self { name, flight } = self;
        let options = choices.evaluation_options();
        let evaluation = evaluate_as_requested(flight, &options).map_err(|error| error.text_for_log(name))?;
        let verdict = Verdict::new(flight, &evaluation, ParameterFormat::for_autopilot(flight.autopilot));
        let origin = ReportOrigin { settings: settings_table(&options), ..ReportOrigin::default() };
        Ok(JudgedLog {
            page: report::render_page(&report::report_replay(&verdict, name, &origin)),
            json: verdict.json().to_string(),
        })
    }
}

impl PageChoices {
    fn evaluation_options(&self) -> EvaluationOptions {
        EvaluationOptions {
            compared_module: self.module,
            compass_number: self.compass,
            time_window_s: [self.from_s.unwrap_or(f64::NEG_INFINITY), self.to_s.unwrap_or(f64::INFINITY)],
            reference_kind: self.reference,
            inclination_deg: self.inclination_deg,
            corrected_terms: self.correct,
            ..EvaluationOptions::DEFAULT
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const CHOICES: &str = r#"{ "module": "all", "compass": 1, "from_s": 30, "to_s": null, "reference": "column" }"#;

    fn loaded_example_log() -> LoadedLog {
        let request = serde_json::from_str(r#"{ "names": ["flight.csv"], "unit": "mg" }"#).unwrap();
        LoadedLog::read_log(&mut include_bytes!("../../data/flight.csv").as_slice(), request).unwrap()
    }

    #[test]
    fn choices_of_the_page_are_used_and_stated_in_the_report() {
        let log = loaded_example_log();
        let LogSummary { compasses, range_s: [from_s, to_s], is_table } = log.log_summary();
        assert!(compasses == [1] && from_s < 30.0 && to_s > 199.0 && is_table, "{from_s} to {to_s} s");
        let judged_whole = PageChoices {
            module: Some(RowSelection::Flight),
            compass: None,
            from_s: None,
            to_s: None,
            reference: None,
            correct: CorrectedTerms::All,
            inclination_deg: None,
        };
        let [judged_whole, chosen] =
            [judged_whole, serde_json::from_str(CHOICES).unwrap()].map(|choices| log.judge_log(&choices).unwrap());
        let used_samples = |judged: &JudgedLog| {
            let json: serde_json::Value = serde_json::from_str(&judged.json).unwrap();
            [&json["compasses"][0]["rows"]["used"], &json["compasses"][0]["module"]["samples"]]
                .map(|count| count.as_u64().unwrap())
        };
        let [[rows, kept], [later_rows, later_kept]] = [used_samples(&judged_whole), used_samples(&chosen)];
        assert!(later_rows < rows && later_kept != kept, "{rows} rows, {kept} kept; {later_rows}, {later_kept}");
        for setting in ["<dt>module</dt><dd>all</dd>", "<dt>compass</dt><dd>1</dd>", "<dt>from</dt><dd>30 s</dd>"] {
            assert!(chosen.page.contains(setting), "{setting}");
        }
        assert!(!chosen.page.contains("<dt>to</dt>") && !chosen.page.contains("<dt>command</dt>"));
    }

    /// The sentences of the command line: tests/promises/commands.rs.
    #[test]
    fn a_log_that_cannot_be_judged_is_an_error_in_words() {
        let read = |names: &str, bytes: &[u8]| {
            let request = serde_json::from_str(&format!(r#"{{ "names": {names}, "unit": "ut" }}"#)).unwrap();
            LoadedLog::read_log(&mut &*bytes, request).unwrap_err().error
        };
        assert_eq!(read(r#"["a.bin"]"#, b""), "empty-file: a.bin: the file is empty");
        assert!(read(r#"["letter"]"#, b"Dear reader").starts_with("unknown-format: letter: not a known log"));
        let several = read(r#"["a.bin", "b.bin"]"#, b"");
        assert!(several.starts_with("several-logs: a.bin, b.bin: these are several logs"), "{several}");
        let log = loaded_example_log();
        let choices = |change: fn(&mut PageChoices)| {
            let mut choices = serde_json::from_str(CHOICES).unwrap();
            change(&mut choices);
            log.judge_log(&choices).unwrap_err()
        };
        for (error, code) in [
            (choices(|choices| choices.reference = Some(ReferenceKind::GpsYaw)), "no-such-reference"),
            (choices(|choices| choices.compass = Some(8)), "no-such-compass"),
            (choices(|choices| (choices.from_s, choices.to_s) = (Some(500.0), Some(200.0))), "reversed-time-range"),
            (choices(|choices| choices.from_s = Some(5000.0)), "time-range-outside-log"),
            (choices(|choices| (choices.from_s, choices.to_s) = (Some(60.0), Some(61.0))), "few-rows-in-time-range"),
        ] {
            assert!(error.starts_with(&format!("{code}: flight.csv: ")), "{error}");
        }
    }
}
