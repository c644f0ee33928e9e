//! A load that bends the field of a compass.

use std::fmt;

use crate::log::LoadSource;
use crate::numbers::format_number;

/// Cause of a disturbance.
#[derive(Clone, Debug, PartialEq)]
pub enum BendingCause {
    /// Loads that are logged.
    Logged {
        /// Name of the loads.
        name: String,
        /// Sources whose sum, or mean, explains the field.
        sources: Vec<LoadSource>,
        /// Current to which the size refers, amperes; none for a command, whose size is that from 0 to 1.
        at_current_a: Option<f64>,
    },
    /// A load with a constant period, seconds, that is not logged.
    Periodic(f64),
}

/// A disturbance and its cause.
#[derive(Clone, Debug, PartialEq)]
pub struct BendingLoad {
    /// Cause of the disturbance.
    pub cause: BendingCause,
    /// Disturbance of the corrected field, body axes, microtesla: at the current, over the range of the command, or
    /// amplitude.
    pub size_ut: f64,
    /// Largest effect on a level heading, degrees.
    pub heading_effect_deg: f64,
    /// Significance in standard deviations of a normal distribution, corrected for the autocorrelation of the residuals
    /// and for the number of candidates.
    pub sigmas: f64,
}

impl BendingCause {
    /// Stable code, for programs.
    pub fn stable_code(&self) -> &'static str {
        match self {
            Self::Periodic(_) => "periodic",
            Self::Logged { sources, .. } => match sources.first() {
                Some(LoadSource::Battery(_)) => "battery-current",
                Some(LoadSource::Esc(_)) => "motor-current",
                Some(LoadSource::Motor(_)) => "motor-command",
                Some(LoadSource::Output(_)) => "output",
                Some(LoadSource::Throttle) | None => "throttle",
            },
        }
    }

    /// What bends the field, as far as it is beyond doubt: which of several motors it is, the fit may confuse.
    pub fn summary(&self) -> String {
        match self {
            Self::Periodic(period_s) => format!("a load with a period of {} s", format_number(*period_s, 1)),
            Self::Logged { name, sources, .. } if matches!(sources.first(), Some(LoadSource::Output(_))) => {
                name.clone()
            }
            Self::Logged { .. } => "its motors or their current".to_owned(),
        }
    }

    /// Period, seconds, of a load with a constant one.
    pub const fn period_s(&self) -> Option<f64> {
        if let Self::Periodic(period_s) = self { Some(*period_s) } else { None }
    }

    /// Current to which the size refers, amperes.
    pub const fn at_current_a(&self) -> Option<f64> {
        if let Self::Logged { at_current_a, .. } = self { *at_current_a } else { None }
    }

    /// Numbers of the batteries, motors or outputs, from 1.
    pub fn source_numbers(&self) -> Vec<u8> {
        match self {
            Self::Periodic(_) => Vec::new(),
            Self::Logged { sources, .. } => sources.iter().map(|source| source.number()).collect(),
        }
    }
}

impl fmt::Display for BendingLoad {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let amount = match &self.cause {
            BendingCause::Logged { name, at_current_a: Some(amperes), .. } => {
                write!(f, "{name}: ")?;
                format!(" at {} A", format_number(*amperes, 0))
            }
            BendingCause::Logged { name, .. } => {
                write!(f, "{name}: ")?;
                let is_throttle = name.contains("motor") || name.contains("throttle");
                if is_throttle { " at full throttle".to_owned() } else { " over the range of the output".to_owned() }
            }
            BendingCause::Periodic(period_s) => {
                let decimals = if *period_s < 10.0 { 2 } else { 1 };
                write!(f, "a load with a period of {} s: ", format_number(*period_s, decimals))?;
                " of amplitude".to_owned()
            }
        };
        let [ut, deg, sigmas] = [(self.size_ut, 1), (self.heading_effect_deg, 0), (self.sigmas, 0)]
            .map(|(value, n)| format_number(value, n));
        write!(f, "{ut} uT{amount}, up to {deg} deg of heading, {sigmas} sigma")
    }
}
