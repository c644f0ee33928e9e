//! A load that bends the field of a compass.

use std::fmt;

use crate::log::LoadSource;
use crate::numbers::format_number;

/// A logged load, and the disturbance by it.
#[derive(Clone, Debug, PartialEq)]
pub struct BendingLoad {
    /// Name of the load, or of several of one kind.
    pub name: String,
    /// Sources whose sum, or mean, explains the field.
    pub sources: Vec<LoadSource>,
    /// Current to which the size refers, amperes; none for a command, whose size is that from 0 to 1.
    pub at_current_a: Option<f64>,
    /// Disturbance of the corrected field, body axes, microtesla: at the current, or over the range of the command.
    pub size_ut: f64,
    /// Largest effect on a level heading, degrees.
    pub heading_effect_deg: f64,
    /// Significance in standard deviations of a normal distribution, corrected for the autocorrelation of the residuals
    /// and for the number of candidates.
    pub sigmas: f64,
}

impl BendingLoad {
    /// Stable code of the cause, for programs.
    #[must_use]
    pub fn stable_code(&self) -> &'static str {
        match self.sources.first() {
            Some(LoadSource::Battery(_)) => "battery-current",
            Some(LoadSource::Esc(_)) => "motor-current",
            Some(LoadSource::Motor(_)) => "motor-command",
            Some(LoadSource::Output(_)) => "output",
            Some(LoadSource::Throttle) | None => "throttle",
        }
    }

    /// What bends the field, as far as it is beyond doubt: commands and currents of motors go together.
    #[must_use]
    pub fn summary(&self) -> String {
        let is_output = matches!(self.sources.first(), Some(LoadSource::Output(_)));
        if is_output { self.name.clone() } else { "its motors or their current".to_owned() }
    }

    /// Numbers of the batteries, motors or outputs, from 1.
    #[must_use]
    pub fn source_numbers(&self) -> Vec<u8> {
        self.sources.iter().map(|source| source.number()).collect()
    }
}

impl fmt::Display for BendingLoad {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let is_throttle = self.name.contains("motor") || self.name.contains("throttle");
        let amount = match self.at_current_a {
            Some(amperes) => format!("at {} A", format_number(amperes, 0)),
            None if is_throttle => "at full throttle".to_owned(),
            None => "over the range of the output".to_owned(),
        };
        let [ut, deg, sigmas] = [(self.size_ut, 1), (self.heading_effect_deg, 0), (self.sigmas, 0)]
            .map(|(value, decimals)| format_number(value, decimals));
        write!(f, "{}: {ut} uT {amount}, up to {deg} deg of heading, {sigmas} sigma", self.name)
    }
}
