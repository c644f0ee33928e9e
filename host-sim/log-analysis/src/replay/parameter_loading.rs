//! Parameter files as ground stations load them, with the values that they replace.

use std::fmt::Write as _;

use super::parameter_export::{ParameterFormat, file_values, format_parameter_file};
use super::verdict::Verdict;
use crate::log::LoggedFlight;

/// A parameter file.
#[derive(Clone, Debug, PartialEq)]
pub struct ParameterFile {
    /// Name of the file.
    pub file_name: &'static str,
    /// Text of the file.
    pub text: String,
}

/// Old and new value of a parameter.
#[derive(Clone, Debug, PartialEq)]
pub struct ParameterChange {
    /// Name of the parameter.
    pub name: String,
    /// Last value in the log, if it has one.
    pub logged_value: Option<f64>,
    /// Value to load, with the digits of the file.
    pub new_value: String,
}

impl Verdict<'_> {
    /// The files with the parameters to load, that of the usual ground station first; none without parameters.
    #[must_use]
    pub fn parameter_files(&self) -> Vec<ParameterFile> {
        let Some(text) = self.parameter_text() else { return Vec::new() };
        let Self { flight, parameter_format: format, .. } = *self;
        let main =
            ParameterFile { file_name: format.file_name(), text: text.clone() + &self.logged_values_comment(&text) };
        let for_qgc = (format == ParameterFormat::ArduPilot).then(|| ParameterFile {
            file_name: ParameterFormat::Px4.file_name(),
            text: in_qgc_columns(&main.text, flight),
        });
        std::iter::once(main).chain(for_qgc).collect()
    }

    /// Old and new values of the parameters to load.
    pub fn parameter_changes(&self) -> Vec<ParameterChange> {
        self.parameter_text().map_or_else(Vec::new, |text| parameter_changes(&text, self.flight))
    }

    fn parameter_text(&self) -> Option<String> {
        let exports = self.exported_corrections();
        (!exports.is_empty()).then(|| format_parameter_file(self.flight, &exports, self.parameter_format))
    }

    fn logged_values_comment(&self, text: &str) -> String {
        let mut comment = String::new();
        for ParameterChange { name, logged_value, .. } in parameter_changes(text, self.flight) {
            if let Some(value) = logged_value {
                // Writing to a string cannot fail.
                let _ = writeln!(comment, "# {name} {value}");
            }
        }
        if comment.is_empty() { comment } else { format!("# the values in the log, which these replace:\n{comment}") }
    }
}

fn parameter_changes(text: &str, flight: &LoggedFlight) -> Vec<ParameterChange> {
    let change = |(name, new_value): (&str, &str)| ParameterChange {
        name: name.to_owned(),
        logged_value: flight.parameters.last_value(name),
        new_value: new_value.to_owned(),
    };
    file_values(text).map(change).collect()
}

/// ArduPilot's parameters in five columns separated by tabs: system, component, name, value, MAVLink type. QGroundControl
/// refuses a file of another system, and a parameter of another type (`ParameterManager::readParametersFromStream`).
fn in_qgc_columns(text: &str, flight: &LoggedFlight) -> String {
    // `MAV_PARAM_TYPE_INT8`, `MAV_PARAM_TYPE_REAL32`.
    const INT8: u8 = 2;
    const REAL32: u8 = 9;
    let system = flight.autopilot_system_ids.first().copied().unwrap_or(1);
    let line = |line: &str| match line.split_once(',').filter(|_| !line.starts_with('#')) {
        Some((name, value)) => {
            let is_integer = ["ORIENT", "MOTCT", "ENABLE"].iter().any(|part| name.contains(part));
            format!("{system}\t1\t{name}\t{value}\t{}\n", if is_integer { INT8 } else { REAL32 })
        }
        None => format!("{line}\n"),
    };
    text.lines().map(line).collect()
}
