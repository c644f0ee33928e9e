//! A solution in the form an autopilot can express.

use nalgebra::Vector3;

use super::orientation::ExportedOrientation;
use super::parameter_format::ParameterFormat;
use crate::log::{FieldCorrection, LoggedFlight};
use crate::numbers::{UT_PER_MILLIGAUSS, format_number};

/// Heading error of parameters on held-back rows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HeldBackScore {
    /// Heading error with the parameters, degrees RMS less mean.
    pub rms_deg: f64,
    /// Heading error as logged, on the same rows, degrees RMS less mean.
    pub as_logged_rms_deg: f64,
    /// Whether both heading errors are estimated from strength and inclination of the corrected field, because the log
    /// has no reference heading.
    pub is_estimate: bool,
    /// Heading error that corresponds to the scatter of the corrected strength, degrees RMS. Errors of the attitude do
    /// not contribute: a large value is a disturbed field.
    pub field_scatter_deg: f64,
}

/// A solution in the form an autopilot can express.
#[derive(Clone, Debug, PartialEq)]
pub struct ExportedCorrection {
    /// Number of the compass, from 1.
    pub compass_number: u8,
    /// Correction of the field in the axes of `orientation`.
    pub correction: FieldCorrection,
    /// Orientation of the sensor.
    pub orientation: ExportedOrientation,
    /// Heading difference to the full solution, degrees: RMS less mean, and mean.
    pub heading_loss_deg: [f64; 2],
    /// First and last row fitted, seconds.
    pub fitted_range_s: Option<[f64; 2]>,
    /// Heading error on held-back rows.
    pub held_back_score: Option<HeldBackScore>,
    /// Heading errors on held-back rows with all terms, and with offsets alone, which one scale of all axes does not change,
    /// degrees RMS less mean.
    pub rms_by_terms_deg: Option<[f64; 2]>,
    /// Warnings: interference that parameters cannot express, and values that the autopilot would reject.
    pub warnings: Vec<String>,
}

/// ArduPilot's default of `COMPASS_OFFS_MAX`, milligauss.
const DEFAULT_MAX_OFFSET_MG: f64 = 1800.0;

impl ExportedCorrection {
    /// Whether the parameters compensate motor current.
    pub(super) fn has_motor_compensation(&self) -> bool {
        self.correction.motor_ut_per_a != Vector3::zeros()
    }

    /// Heading difference to the full solution, degrees RMS with its mean.
    pub(in crate::replay) fn total_loss_deg(&self) -> f64 {
        libm::hypot(self.heading_loss_deg[0], self.heading_loss_deg[1])
    }

    /// The heading errors by the terms that a file has, a clause.
    #[must_use]
    pub fn rms_by_terms_text(&self) -> Option<String> {
        let [all, offsets] = self.rms_by_terms_deg?.map(|rms_deg| format_number(rms_deg, 1));
        Some(format!("{all} deg RMS with all terms, {offsets} with offsets alone or offsets and scale"))
    }

    /// Largest offset component of the exported correction, milligauss.
    pub(in crate::replay) fn largest_offset_mg(&self) -> f64 {
        self.correction.hard_iron_ut.amax() / UT_PER_MILLIGAUSS
    }

    /// Limit of the offsets that the autopilot rejects, milligauss, if exceeded.
    pub(in crate::replay) fn offset_limit_mg_if_exceeded(
        &self,
        flight: &LoggedFlight,
        format: ParameterFormat,
    ) -> Option<f64> {
        let limit_mg = flight.parameters.last_value("COMPASS_OFFS_MAX").unwrap_or(DEFAULT_MAX_OFFSET_MG);
        (format == ParameterFormat::ArduPilot && self.largest_offset_mg() > limit_mg).then_some(limit_mg)
    }
}
