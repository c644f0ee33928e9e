//! Whether headings count from true north; otherwise, whether the compass or the reference is turned.

use super::check::CheckOutcome;
use crate::log::{FieldCorrection, LoggedFlight};
use crate::numbers::mean_angle_deg;
use crate::replay::evaluation::{FlightEvaluation, score_correction};
use crate::replay::flown_headings::HeadingSectors;
use crate::replay::reference::{ReferenceHeading, ReferenceKind};
use crate::replay::result::HeadingScore;
use crate::replay::row::ReplayRow;
use crate::replay::row_headings::score_field;
use crate::score::wrap_180;

/// Largest mean error against true north that is not mentioned, degrees: a declination of another year, or a mounting by
/// eye.
const MAX_UNMENTIONED_ERROR_DEG: f64 = 10.0;

/// A mounting or an antenna is off by a right angle, or more; a place without model has up to 30 deg of declination.
const MAX_MEAN_ERROR_DEG: f64 = 45.0;

/// The autopilot's yaw contains the errors of its compass, and a table's column has any north; beyond this one of the two
/// is reversed.
const MAX_MEAN_ERROR_OF_OTHERS_DEG: f64 = 120.0;

/// Without a fit, the mean as logged is that of a compass which follows the reference, degrees RMS.
const MAX_RMS_AS_LOGGED_DEG: f64 = 20.0;

/// Mean heading errors as logged and with the fit, less the declination.
pub(super) fn check_north(
    flight: &LoggedFlight,
    evaluation: &FlightEvaluation,
    rows: &[ReplayRow],
    correction: Option<&FieldCorrection>,
) -> CheckOutcome {
    let Some(reference) = evaluation.reference.as_ref() else {
        return CheckOutcome::unchecked("the log has no reference heading");
    };
    let sectors: HeadingSectors = rows.iter().filter_map(|row| row.reference_deg).collect();
    if !sectors.suffice() {
        return CheckOutcome::unchecked("the flight has too few headings");
    }
    let is_true_north = reference.measures_error() && reference.counts_from_true_north();
    let max_error_deg = if is_true_north { MAX_MEAN_ERROR_DEG } else { MAX_MEAN_ERROR_OF_OTHERS_DEG };
    let declination_deg = evaluation.declination_deg();
    let mean_deg = |score: &HeadingScore| wrap_180(score.mean_deg + declination_deg.unwrap_or(0.0));
    let as_logged = score_field(rows, ReplayRow::logged_ut).filter(|score| score.rms_deg < MAX_RMS_AS_LOGGED_DEG);
    let with_fit = correction.and_then(|correction| score_correction(rows, correction));
    // A fit replaces the orientation in use.
    let scores = [(with_fit, "with the fit"), (as_logged, "as logged")];
    let mean = scores.iter().find_map(|(score, name)| score.as_ref().map(|score| (mean_deg(score), *name)));
    let Some((mean_deg, name)) = mean else {
        return CheckOutcome::unchecked("neither the field as logged nor a fit follows the reference");
    };
    let is_large = mean_deg.abs() > max_error_deg;
    let is_mentioned = is_true_north && declination_deg.is_some() && mean_deg.abs() > MAX_UNMENTIONED_ERROR_DEG;
    if !is_large && !is_mentioned {
        return CheckOutcome::Passed;
    }
    let finding = format!(
        "{name}, headings differ from {} by {mean_deg:.0} deg in the mean: {}",
        reference.reference_name(),
        cause_of_difference(flight, reference, rows, mean_deg)
    );
    if is_large { CheckOutcome::Failed(finding) } else { CheckOutcome::PassedWith(finding) }
}

/// Whether the compass or the reference is turned, by a further heading of the log; a clause.
fn cause_of_difference(
    flight: &LoggedFlight,
    reference: &ReferenceHeading,
    rows: &[ReplayRow],
    compass_error_deg: f64,
) -> String {
    let unknown = || "the orientation of the compass is wrong, or that of the reference".to_owned();
    let kinds = [ReferenceKind::GpsYaw, ReferenceKind::GpsCourse, ReferenceKind::AutopilotYaw];
    let others = kinds.into_iter().filter_map(|kind| ReferenceHeading::of_kind(flight, kind));
    let Some(other) = others.into_iter().find(|other| other.reference_name() != reference.reference_name()) else {
        return unknown();
    };
    let differences = rows.iter().filter_map(|row| Some(row.reference_deg? - other.heading_deg(flight, row.t_s)?));
    let Some(reference_error_deg) = mean_angle_deg(differences) else { return unknown() };
    let (name, other_name) = (reference.reference_name(), other.reference_name());
    if reference_error_deg.abs() <= MAX_UNMENTIONED_ERROR_DEG {
        format!(
            "{name} and {other_name} agree, so that the orientation of the compass is off by {compass_error_deg:.0} deg"
        )
    } else if wrap_180(compass_error_deg + reference_error_deg).abs() <= MAX_UNMENTIONED_ERROR_DEG {
        let turned = if *reference == ReferenceHeading::GpsYaw { "the antennas are turned" } else { "it is turned" };
        format!(
            "the compass agrees with {other_name}, so that {turned} by {reference_error_deg:.0} deg against the nose"
        )
    } else {
        unknown()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::replay::evaluation::{EvaluationOptions, evaluate_flight};
    use crate::replay::reading_checks::{CheckedMeaning, check_reading};
    use crate::replay::tests::FLOWN_TURNS;

    /// GPS yaw of antennas that are turned against the nose; the autopilot's yaw is right.
    #[test]
    fn turned_antennas_are_named_by_another_heading() {
        for (turned_deg, is_failed) in [(0.0_f32, false), (20.0, false), (90.0, true), (-90.0, true)] {
            let mut flight = FLOWN_TURNS.0.clone();
            let rows: Vec<_> = flight.attitude.rows().iter().step_by(2).copied().collect();
            for row in rows {
                let yaw_deg = (row.row_values[2].to_degrees() + turned_deg).rem_euclid(360.0);
                flight.gps.push_row(row.t_s, [48.0, 11.3, 500.0, 0.0, 0.0, yaw_deg]);
            }
            let options = EvaluationOptions {
                field_latency_s: Some(0.0),
                reference_kind: Some(ReferenceKind::GpsYaw),
                ..EvaluationOptions::DEFAULT
            };
            let evaluation = evaluate_flight(&flight, &options);
            let checks = check_reading(&flight, &evaluation, &evaluation.compasses[0]);
            let north = checks.into_iter().find(|check| check.meaning == CheckedMeaning::North).unwrap();
            assert_eq!(north.outcome.is_failed(), is_failed, "{turned_deg}: {north}");
            let finding = north.outcome.finding().unwrap_or_default();
            let expected = format!("so that the antennas are turned by {turned_deg:.0} deg against the nose");
            assert_eq!(finding.contains(&expected), turned_deg != 0.0, "{turned_deg}: {north}");
        }
    }
}
