//! Whether a flight proves that a compass is turned against its orientation.

use crate::log::{CustomRotation, FieldCorrection, LoggedFlight};
use crate::replay::evaluation::{CompassEvaluation, FlightEvaluation, score_correction};
use crate::replay::parameter_export::ParameterFormat;
use crate::replay::parameter_export::orientation::{FixedOrientation, OrientationParameters};
use crate::replay::reading_checks::{CheckOutcome, CheckedMeaning, ReadingCheck, misalignment_about_z_deg};
use crate::replay::row::ReplayRow;
use crate::replay::row_solve::solved_correction;
use crate::score::wrap_180;

/// Largest angle between the corrected field and the axes of the body rates, and largest mean heading error, with which a
/// rotation is confirmed, degrees: that of a poorly mounted autopilot.
const MAX_MISALIGNMENT_DEG: f64 = 10.0;

/// Orientation parameters of a compass that the flight proves. Level turns alone do not distinguish a rotation about z
/// from another north: body rates of rolls and pitches do, or a reference heading.
pub fn provable_orientation(
    flight: &LoggedFlight,
    evaluation: &FlightEvaluation,
    compass: &CompassEvaluation,
    format: ParameterFormat,
    reading_checks: &[ReadingCheck],
    used: &[CustomRotation],
) -> Result<OrientationParameters, FixedOrientation> {
    let parameters = OrientationParameters::from_log(flight, compass.compass_number, format, used)?;
    let Some(fit) = &compass.parameter_fit.fit else { return Ok(parameters) };
    let correction = solved_correction(&fit.solution);
    let rows: Vec<ReplayRow> = compass.parameter_fit.fitted_rows(&compass.rows).copied().collect();
    let by_rates_deg = if flight.has_measured_rates { misalignment_about_z_deg(&rows, &correction) } else { None };
    let by_reference_deg = mean_error_deg(evaluation, &rows, &correction);
    let is_small = |deg: Option<f64>| deg.is_some_and(|deg| deg.abs() <= MAX_MISALIGNMENT_DEG);
    if !fit.solution.quality.determines_all_coefficients() || !(is_small(by_rates_deg) || is_small(by_reference_deg)) {
        return Err(FixedOrientation::UnconfirmedAngle);
    }
    if fit.mount.number() != 0 && !is_sense_certain(evaluation, reading_checks, by_reference_deg) {
        return Err(FixedOrientation::UnconfirmedSense);
    }
    Ok(parameters)
}

/// Mean heading error of a correction against a reference of true north with a known declination, degrees.
fn mean_error_deg(evaluation: &FlightEvaluation, rows: &[ReplayRow], correction: &FieldCorrection) -> Option<f64> {
    let reference = evaluation.reference.as_ref()?;
    reference.sigma_if_accurate_deg().filter(|_| reference.counts_from_true_north())?;
    Some(wrap_180(score_correction(rows, correction)?.mean_deg + evaluation.declination_deg()?))
}

/// Whether a rotation by 45 deg and more is distinguished from a mirror image, which fits with the opposite inclination and heading.
fn is_sense_certain(evaluation: &FlightEvaluation, checks: &[ReadingCheck], by_reference_deg: Option<f64>) -> bool {
    /// Inclination whose sign the check shows, degrees: the bound of the check.
    const MIN_INCLINATION_DEG: f64 = 20.0;
    let is_steep = evaluation.earth_inclination_deg().is_some_and(|deg| deg.abs() > MIN_INCLINATION_DEG);
    let has_inclination = checks
        .iter()
        .any(|check| check.meaning == CheckedMeaning::Inclination && check.outcome == CheckOutcome::Passed);
    is_steep && has_inclination || by_reference_deg.is_some_and(|deg| deg.abs() <= MAX_MISALIGNMENT_DEG)
}
