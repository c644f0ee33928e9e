//! Maximum likelihood relative to the Cramér-Rao bound, and coverage of its sigmas; a small `lab bench accuracy`.

use std::sync::OnceLock;

use laboratory::studies::accuracy::flight::{FlightPattern, StudyFlight};
use laboratory::studies::accuracy::flight_study::run_flight_study;
use laboratory::studies::accuracy::{AccuracyPlan, AccuracyResult, MethodResult, SigmaCoverage, run_accuracy_study};
use simulator::world::aircraft::VehicleKind;

use crate::fixtures::share_of_flights;

fn plan(airframes: u64, noise_draws: u64) -> AccuracyPlan {
    AccuracyPlan { airframe_count: airframes, noise_draws, seed: 1000 }
}

/// 40 airframes with 20 flights each: the ratio of one airframe has a standard error of 0.3 / sqrt(20) = 7 %, which
/// raises the 90th percentile by 1.28 times 7 %.
fn study_result() -> &'static AccuracyResult {
    static STUDY_RESULT: OnceLock<AccuracyResult> = OnceLock::new();
    STUDY_RESULT.get_or_init(|| run_accuracy_study(plan(40, 20), &|| {}))
}

fn maximum_likelihood_result() -> MethodResult {
    study_result().methods[0]
}

#[test]
fn maximum_likelihood_reaches_the_cramer_rao_bound() {
    let result = maximum_likelihood_result();
    assert_eq!(result.method, "maximum-likelihood");
    assert!(result.ratio_median <= 1.05, "{result:?}");
    assert!(result.ratio_worst_decile <= 1.15 + 0.09, "{result:?}");
}

#[test]
fn every_solve_converges_and_none_is_accepted_wrongly() {
    let result = maximum_likelihood_result();
    assert!((result.solves.converged_percent, result.solves.wrong_calibrations) == (100.0, 0), "{result:?}");
    // All flights provide enough information.
    assert!(result.solves.accepted_percent >= 99.0, "{result:?}");
}

/// Tolerance of three percentage points, including a standard error of one point with 2,560 headings.
#[test]
fn errors_are_within_sigma_as_often_as_predicted() {
    for SigmaCoverage { one_sigma_percent, two_sigma_percent, headings } in
        [study_result().coverage, study_result().coverage_with_faults]
    {
        assert_eq!(headings, 40 * 4 * 16);
        assert!((one_sigma_percent - 68.3).abs() <= 3.0, "{one_sigma_percent}");
        assert!((two_sigma_percent - 95.4).abs() <= 3.0, "{two_sigma_percent}");
    }
}

/// Closed-form methods assume constant attitude in the turns; their order follows from their assumptions.
#[test]
fn closed_forms_are_less_accurate_than_maximum_likelihood() {
    let [ml, two_plane, four_ellipse] = [0, 1, 2].map(|i| study_result().methods[i].solves.rms_median_deg);
    assert!(ml < two_plane && two_plane < four_ellipse, "{ml} {two_plane} {four_ellipse}");
}

/// Results do not depend on the number of threads and their order.
#[test]
fn a_run_is_a_function_of_its_seed() {
    let routine = copter_flight(FlightPattern::Routine);
    assert_eq!(run_flight_study(routine, plan(2, 1), &|| {}), run_flight_study(routine, plan(2, 1), &|| {}));
}

fn copter_flight(flight_pattern: FlightPattern) -> StudyFlight {
    StudyFlight { kind: VehicleKind::Copter, flight_pattern, duration_minutes: 3.0 }
}

#[test]
fn a_copter_is_calibrated_by_its_routine_either_way_round() {
    for pattern in [FlightPattern::Routine, FlightPattern::Mirrored] {
        let plan = plan(share_of_flights(20), 5);
        let row = run_flight_study(copter_flight(pattern), plan, &|| {});
        assert!(
            row.solves.converged_percent >= 100.0
                && row.solves.accepted_percent >= 95.0
                && row.solves.wrong_calibrations == 0,
            "{row:?}"
        );
        assert!(row.solves.rms_median_deg <= 0.8 && row.rms_worst_decile_deg <= 1.6, "{row:?}");
        // RMS error over the bound: the solver weights attitudes equally, although accelerations degrade some.
        assert!((0.9..=1.25).contains(&row.solver_loss_median), "{row:?}");
        // RMS error over the bound of the optimal selection of equal size.
        assert!((0.85..=1.15).contains(&row.error_to_best_bound_median), "{row:?}");
        assert_eq!(row.coverage.headings, plan.airframe_count as usize * 16);
    }
}

/// The deterministic selection costs 5 % for a copter and 6 % for an aeroplane, because one of four samples is held
/// back. The solver's contribution has a standard error of 4 %.
#[test]
fn a_wandering_flight_reaches_nearly_the_best_possible_accuracy() {
    for (kind, max_choice_ratio) in [(VehicleKind::Copter, 1.08), (VehicleKind::Plane, 1.09)] {
        let flight = StudyFlight { kind, ..copter_flight(FlightPattern::Wandering) };
        let row = run_flight_study(flight, plan(share_of_flights(20), 5), &|| {});
        assert!(row.solves.accepted_percent >= 95.0, "{row:?}");
        assert!(row.selection_loss_median <= max_choice_ratio, "{row:?}");
        assert!(row.error_to_best_bound_median <= 1.1 + 0.08, "{row:?}");
    }
}
