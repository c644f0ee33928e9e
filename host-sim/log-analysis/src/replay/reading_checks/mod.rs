//! Checks by the data that a log means what the reader took it for: signs, axes, unit, and the direction of north.
//!
//! A failed check forbids the parameter file of a compass; a file also requires that every check of
//! [`CheckedMeaning::is_required`] passes. The table of checks is in docs/how-replay-works.md.

mod check;
mod north;
mod sense;

pub use check::{CheckOutcome, CheckedMeaning, ReadingCheck};
pub use sense::misalignment_about_z_deg;

use super::evaluation::{CompassEvaluation, FlightEvaluation};
use super::flown_headings::yaw_sectors;
use super::row::ReplayRow;
use super::row_solve::is_determined;
use crate::log::{AttitudeView, CorrectionResidual, FieldCorrection, LogFormat, LoggedFlight};
use crate::numbers::median;

/// Weakest and strongest Earth field, microtesla.
const EARTH_FIELD_RANGE_UT: [f64; 2] = [22.0, 67.0];

/// The check that forbids parameters: the first failed one, else the first required one without a pass.
pub fn forbidding_check(checks: &[ReadingCheck]) -> Option<&ReadingCheck> {
    let failed = checks.iter().find(|check| check.outcome.is_failed());
    failed.or_else(|| checks.iter().find(|check| check.meaning.is_required() && check.outcome != CheckOutcome::Passed))
}

/// Checks the reading of a compass's log by its rows and the fit to them.
pub fn check_reading(
    flight: &LoggedFlight,
    evaluation: &FlightEvaluation,
    compass: &CompassEvaluation,
) -> Vec<ReadingCheck> {
    let rows: Vec<ReplayRow> = compass.parameter_fit.fitted_rows(&compass.rows).copied().collect();
    let correction = compass.parameter_fit.correction();
    let determined = correction.filter(|_| compass.parameter_fit.solution().is_some_and(is_determined));
    let north = north::check_north(flight, evaluation, &rows, determined.as_ref());
    let is_north_known = !matches!(north, CheckOutcome::Unchecked(_));
    let inclination = check_inclination(evaluation, &rows, determined.as_ref(), is_north_known);
    // The mirror image of a field, or of roll with repaired rates, fits as a turned sensor: the field as read names the axis.
    let is_turned = compass.parameter_fit.fit.as_ref().is_some_and(|fit| fit.mount.number() != 0);
    let is_repaired = flight.logged_rate_signs.iter().any(|sign| *sign < 0.0);
    let sensed = correction.as_ref().filter(|_| !(inclination.is_failed() || is_turned && is_repaired));
    let check = |meaning, outcome| ReadingCheck { meaning, outcome };
    vec![
        check(CheckedMeaning::Slot, check_slot(flight, compass)),
        check(CheckedMeaning::Correction, check_correction(flight, compass)),
        check(CheckedMeaning::Constancy, check_constancy(compass)),
        check(CheckedMeaning::Attitude, check_attitude(flight)),
        check(CheckedMeaning::Sense, sense::check_sense(flight, evaluation, &rows, sensed)),
        check(CheckedMeaning::Unit, check_unit(flight, evaluation, compass)),
        check(CheckedMeaning::Inclination, inclination),
        check(CheckedMeaning::Reference, sense::check_reference(evaluation, &rows, correction.as_ref())),
        check(CheckedMeaning::North, north),
    ]
}

/// Slot by device ids and priorities, and by the offsets in use where rows have them.
fn check_slot(flight: &LoggedFlight, compass: &CompassEvaluation) -> CheckOutcome {
    match flight.slot(compass.compass_number) {
        Ok(_) => CheckOutcome::Passed,
        Err(reason) => {
            let finding = format!("its parameters in the autopilot are unknown, because {reason}");
            if reason.is_contradictory() { CheckOutcome::Failed(finding) } else { CheckOutcome::Unchecked(finding) }
        }
    }
}

/// The corrected field against the raw field with the autopilot's correction. ArduPilot logs the corrected field alone; its
/// offsets in use prove the slot.
fn check_correction(flight: &LoggedFlight, compass: &CompassEvaluation) -> CheckOutcome {
    /// Difference that no interval between the readings of both fields makes, microtesla.
    const MAX_DIFFERENCE_UT: f64 = 2.0;
    const MIN_ROW_COUNT: usize = 20;
    let logged = flight.compass(compass.compass_number);
    let residual = logged.and_then(|logged| logged.correction_residual);
    let Some(residual) = residual.filter(|residual| residual.row_count >= MIN_ROW_COUNT) else {
        return CheckOutcome::unchecked("the log has not both the raw and the corrected field");
    };
    let CorrectionResidual { constant_ut, scatter_ut, .. } = residual;
    let constant_ut = constant_ut.norm();
    if scatter_ut > MAX_DIFFERENCE_UT {
        CheckOutcome::Failed(format!(
            "the corrected field differs from the raw one with the log's parameters by {:.1} uT: orientation, scales or \
             offsets in use are others than those of the log",
            libm::hypot(scatter_ut, constant_ut)
        ))
    } else if constant_ut > MAX_DIFFERENCE_UT && residual.is_of_offsets() {
        CheckOutcome::Failed(format!(
            "the corrected field differs from the raw one with the log's parameters by {constant_ut:.1} uT, as if the \
             offsets were not those in use"
        ))
    } else if constant_ut > MAX_DIFFERENCE_UT {
        CheckOutcome::Unchecked(format!(
            "the corrected field differs from the raw one with the log's parameters by {constant_ut:.1} uT throughout, as \
             by a bias that PX4's filter learnt"
        ))
    } else {
        CheckOutcome::Passed
    }
}

/// Changes proportional to the field are the sensor's: iron is additive.
fn check_constancy(compass: &CompassEvaluation) -> CheckOutcome {
    compass.causes.sensor_change.map_or(CheckOutcome::Passed, |change| CheckOutcome::Failed(change.to_string()))
}

/// Axes of the attitude, by the messages that are logged.
fn check_attitude(flight: &LoggedFlight) -> CheckOutcome {
    match flight.attitude_view {
        AttitudeView::Vtol(view) => {
            CheckOutcome::Unchecked(format!("{view}; XKF1 or XKQ is not logged, nor do the modes of the log show when"))
        }
        AttitudeView::Body | AttitudeView::BodyForVtol(_) | AttitudeView::BodyByModes => CheckOutcome::Passed,
    }
}

/// Strength of the field by the fit to the rows, or as logged where the flight determines no fit, against the model or the
/// Earth's range. A poor gain is no other unit.
fn check_unit(flight: &LoggedFlight, evaluation: &FlightEvaluation, compass: &CompassEvaluation) -> CheckOutcome {
    /// Ratio that is nearer to ten than to one: the root of ten.
    const MAX_RATIO: f64 = 3.16;
    /// Units that one was read as: factor of the strength, and names.
    const UNITS: [(f64, &str); 6] = [
        (10.0, "milligauss read as microtesla"),
        (0.1, "microtesla read as milligauss"),
        (100.0, "nanotesla read as milligauss"),
        (1000.0, "nanotesla read as microtesla"),
        (0.01, "gauss read as microtesla"),
        (0.001, "gauss read as milligauss"),
    ];
    let Some(found_ut) = compass.parameter_fit.strength_ut().or_else(|| logged_strength_ut(flight, compass)) else {
        return CheckOutcome::unchecked("the field did not turn");
    };
    let [least_ut, most_ut] = evaluation.earth_total_ut().map_or(EARTH_FIELD_RANGE_UT, |ut| [ut; 2]);
    let is_in = |strength_ut: f64| (least_ut / MAX_RATIO..=most_ut * MAX_RATIO).contains(&strength_ut);
    if is_in(found_ut) {
        return CheckOutcome::Passed;
    }
    let unit = UNITS.into_iter().find(|(factor, _)| is_in(found_ut / factor)).map_or("another unit", |(_, unit)| unit);
    let remedy = match flight.log_format {
        LogFormat::Csv => format!("{unit}? Give its unit by --unit"),
        _ => "the sensor or its driver has a wrong scale".to_owned(),
    };
    let decimals = if found_ut < 1.0 { 4 } else { 0 };
    CheckOutcome::Failed(format!(
        "the field is {found_ut:.decimals$} uT strong, the Earth's {least_ut:.0} to {most_ut:.0}: {remedy}"
    ))
}

/// Median strength as logged, microtesla, on enough headings that iron does not decide it.
fn logged_strength_ut(flight: &LoggedFlight, compass: &CompassEvaluation) -> Option<f64> {
    let usable = compass.rows.iter().filter(|row| row.is_usable);
    yaw_sectors(flight, &compass.rows).suffice().then(|| median(usable.map(|row| row.logged_ut().norm())))
}

/// Inclination of the corrected field, against the model or the one given. A negated field turns like a right one: without
/// these and without north its sign must be confirmed.
fn check_inclination(
    evaluation: &FlightEvaluation,
    rows: &[ReplayRow],
    correction: Option<&FieldCorrection>,
    is_north_known: bool,
) -> CheckOutcome {
    /// Larger than the error of a fit of full circles and of the model.
    const MAX_DIFFERENCE_DEG: f64 = 20.0;
    let Some(correction) = correction else { return CheckOutcome::unchecked("the flight determines no fit") };
    let [down, total] = rows.iter().fold([0.0; 2], |[down, total], row| {
        let field = row.corrected_field(correction);
        [down + row.down_in_body().dot(&field), total + field.norm()]
    });
    let found_deg = libm::asin((down / total).clamp(-1.0, 1.0)).to_degrees();
    let Some(model_deg) = evaluation.given_inclination_deg.or(evaluation.earth_inclination_deg()) else {
        if is_north_known {
            return CheckOutcome::unchecked("the log has no place");
        }
        let [points, half] = if found_deg < 0.0 { ["up", "southern"] } else { ["down", "northern"] };
        return CheckOutcome::Failed(format!(
            "without place and heading nothing confirms that the field points {points}, as on the {half} half of the Earth: if \
             it was flown there, give --inclination {found_deg:.0}"
        ));
    };
    let source = if evaluation.given_inclination_deg.is_some() { "as given" } else { "by the field model" };
    if (found_deg - model_deg).abs() <= MAX_DIFFERENCE_DEG {
        let is_level = (found_deg + model_deg).abs() <= MAX_DIFFERENCE_DEG;
        if is_level && !is_north_known {
            return CheckOutcome::Failed(
                "the field is too level to show its sign by the inclination, and the log has no heading".to_owned(),
            );
        }
        CheckOutcome::Passed
    } else if (found_deg + model_deg).abs() <= MAX_DIFFERENCE_DEG {
        CheckOutcome::Failed(format!(
            "the inclination is {found_deg:.0} deg, {model_deg:.0} {source}: an axis is mirrored, or the whole field negated"
        ))
    } else {
        CheckOutcome::Failed(format!(
            "the inclination is {found_deg:.0} deg, {model_deg:.0} {source}: the fit is not that of the Earth's field"
        ))
    }
}
