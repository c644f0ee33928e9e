//! A log that was read, and its judgement.

use std::io::Read;

use log_analysis::log::csv::FieldUnit;
use log_analysis::log::{self, LogFormat, LoggedFlight};
use log_analysis::replay::evaluation::{EvaluationOptions, evaluate_flight};
use log_analysis::replay::parameter_export::{ParameterFormat, format_parameter_file};
use log_analysis::replay::verdict::Verdict;
use log_analysis::replay::{ReferenceKind, RowSelection};
use log_analysis::report::{self, ReportOrigin};
use serde::{Deserialize, Serialize};

/// Request to read a log.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LogRequest {
    /// Name of the file.
    pub name: String,
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
    /// Name and text of the parameter file.
    pub parameters: Option<[String; 2]>,
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
    /// The source cannot be read, or holds no usable flight.
    pub fn read_log(source: &mut dyn Read, request: LogRequest) -> Result<Self, String> {
        let flight = log::read_flight(source, request.unit).map_err(|error| error.to_string())?;
        Ok(Self { name: request.name, flight })
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
    /// The log does not have the compass.
    pub fn judge_log(&self, choices: &PageChoices) -> Result<JudgedLog, String> {
        let Self { name, flight } = self;
        let options = EvaluationOptions {
            compared_module: choices.module,
            compass_number: choices.compass,
            time_window_s: [choices.from_s.unwrap_or(f64::NEG_INFINITY), choices.to_s.unwrap_or(f64::INFINITY)],
            reference_kind: choices.reference,
            ..EvaluationOptions::DEFAULT
        };
        let evaluation = evaluate_flight(flight, &options);
        if evaluation.compasses.is_empty() {
            return Err("the log has no compass of this number".to_owned());
        }
        if choices.reference.is_some() && evaluation.reference.is_none() {
            return Err("the log has no such reference".to_owned());
        }
        let format = ParameterFormat::for_autopilot(flight.autopilot);
        let verdict = Verdict::new(flight, &evaluation, format);
        let exported = verdict.exported_corrections();
        let parameters = (!exported.is_empty())
            .then(|| [format.file_name().to_owned(), format_parameter_file(flight, &exported, format)]);
        let origin = ReportOrigin {
            settings: settings_table(choices),
            parameter_file: parameters.clone(),
            ..ReportOrigin::default()
        };
        Ok(JudgedLog {
            page: report::render_page(&report::report_replay(&verdict, name, &origin)),
            json: verdict.json().to_string(),
            parameters,
        })
    }
}

fn settings_table(choices: &PageChoices) -> Vec<[String; 2]> {
    let given_choices = [
        ("module", choices.module.map(|selection| selection.selection_name().to_owned())),
        ("compass", choices.compass.map(|compass_number| compass_number.to_string())),
        ("from", choices.from_s.map(|time_s| format!("{time_s} s"))),
        ("to", choices.to_s.map(|time_s| format!("{time_s} s"))),
        ("reference", choices.reference.map(|_| "as chosen; named in the findings".to_owned())),
    ];
    given_choices.into_iter().filter_map(|(name, value)| Some([name.to_owned(), value?])).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    const CHOICES: &str = r#"{ "module": "all", "compass": 1, "from_s": 30, "to_s": null, "reference": "column" }"#;

    fn loaded_example_log() -> LoadedLog {
        let request = serde_json::from_str(r#"{ "name": "flight.csv", "unit": "mg" }"#).unwrap();
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

    #[test]
    fn a_log_that_cannot_be_judged_is_an_error_in_words() {
        let request: LogRequest = serde_json::from_str(r#"{ "name": "letter", "unit": "ut" }"#).unwrap();
        let error = LoadedLog::read_log(&mut b"Dear reader".as_slice(), request).unwrap_err();
        assert!(error.starts_with("not a known log"), "{error}");
        let missing = PageChoices { reference: Some(ReferenceKind::GpsYaw), ..serde_json::from_str(CHOICES).unwrap() };
        assert_eq!(loaded_example_log().judge_log(&missing).unwrap_err(), "the log has no such reference");
        let missing = PageChoices { compass: Some(8), ..serde_json::from_str(CHOICES).unwrap() };
        assert_eq!(loaded_example_log().judge_log(&missing).unwrap_err(), "the log has no compass of this number");
    }
}
