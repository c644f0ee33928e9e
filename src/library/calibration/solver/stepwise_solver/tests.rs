//! Unit tests of `solver`.

use nalgebra::Matrix3;

use super::*;
use crate::calibration::tests::synthetic::{Airframe, Flight, RecordedTurns};
use crate::calibration::{DetectedHardIronChange, HardIronTimeCourse};

fn solution_with_error(expected_rms_deg: f32, b_ut: f32) -> Solution {
    let (_, recorded) = typical_flight();
    let mut solution = solve_samples(Method::MaximumLikelihood, recorded.turns(), &Prior::default()).unwrap();
    solution.quality.expected_rms_deg = expected_rms_deg;
    solution.calibration.b_ut = [0.0, b_ut, 0.0];
    solution
}

fn typical_flight() -> (Airframe, RecordedTurns) {
    let (mut random, airframe) = Airframe::seeded(31, 0.1, 1.0, 5.0, [55.0, 55.0]);
    let recorded = Flight::TYPICAL.fly(&airframe, &mut random);
    (airframe, recorded)
}

/// Another start is tried for an expected error above 3 deg, and for hard iron of six times the Earth's field.
#[test]
fn a_poor_result_is_one_that_another_start_may_improve() {
    let change = DetectedHardIronChange { size_ut: 9.0, time_course: HardIronTimeCourse::Drift, duration_ms: 200_000 };
    for (name, result, expected) in [
        ("good", Ok(solution_with_error(2.0, 200.0)), false),
        ("large expected error", Ok(solution_with_error(4.0, 0.0)), true),
        ("large hard iron", Ok(solution_with_error(0.5, -400.0)), true),
        ("not a number", Ok(solution_with_error(f32::NAN, 0.0)), true),
        ("not converged", Err(SolveError::NotConverged), true),
        ("hard-iron change", Err(SolveError::HardIronChanged(change)), true),
        ("reversed turns", Err(SolveError::TurnsReversed), false),
    ] {
        assert_eq!(is_poor(&result), expected, "{name}");
    }
}

fn run_to_end(mut solver: Solver, samples: Samples<'_>) -> (Result<Solution, SolveError>, usize) {
    let mut began = 1;
    for _ in 0..MAX_SOLVE_STEPS {
        let before = solver.attempt;
        match solver.solve_step(samples) {
            SolveProgress::Continue => {}
            SolveProgress::Finished(end) => return (end, began),
        }
        began += usize::from(before != solver.attempt);
    }
    panic!("no end within {MAX_SOLVE_STEPS} steps")
}

#[test]
fn the_better_of_two_results_is_returned() {
    let (airframe, recorded) = typical_flight();
    let samples = recorded.turns();
    let new = || Solver::new(Method::MaximumLikelihood, samples, &Prior::default()).unwrap();
    let (plain, began) = run_to_end(new(), samples);
    let plain = plain.unwrap();
    assert_eq!(began, 1);
    let error = |solution: &Solution| airframe.rms_error_deg(&solution.calibration);
    // Simulates a poor first result with this misfit.
    for (misfit, is_found_again) in [(f32::INFINITY, false), (0.0, true)] {
        let mut solver = new();
        while !matches!(solver.refinement.refine_step(samples), Refining::Converged) {}
        let RetainedResult { starting_point: start, noise, .. } = solver.retain_result(&plain).unwrap();
        let sphere = starting_point::sphere_start(samples, &Matrix3::identity()).unwrap();
        assert!(solver.restart_refinement(samples, &sphere, SampleCorrections::NO_CORRECTIONS));
        solver.attempt.start = AttemptStart::Sphere;
        let corrections = SampleCorrections::NO_CORRECTIONS;
        solver.first_result = Some(RetainedResult { starting_point: start, misfit, corrections, noise });
        let (again, began) = run_to_end(solver, samples);
        assert_eq!(began, if is_found_again { 2 } else { 1 });
        let again = again.unwrap();
        assert!((error(&again) - error(&plain)).abs() < 0.05 && again.hard_iron_change.is_none());
    }
}

#[test]
fn the_misfit_scales_with_the_total_field() {
    let (_, recorded) = typical_flight();
    let solver = Solver::new(Method::MaximumLikelihood, recorded.turns(), &Prior::default()).unwrap();
    let mut solution = solution_with_error(0.5, 0.0);
    let misfit = solver.misfit(&solution.calibration);
    let NoiseModel { norm_sigma, inclination_sigma_rad, .. } = solver.refinement.likelihood.noise;
    let expected = norm_sigma * inclination_sigma_rad * solution.calibration.total_ut;
    assert!((misfit / expected - 1.0).abs() < 1e-5);
    solution.calibration.total_ut *= 2.0;
    assert!((solver.misfit(&solution.calibration) / misfit - 2.0).abs() < 1e-5);
}

#[test]
fn a_retained_result_is_restored_with_its_corrections() {
    let (_, recorded) = typical_flight();
    let mut solver = Solver::new(Method::MaximumLikelihood, recorded.turns(), &Prior::default()).unwrap();
    solver.refinement.likelihood.latency_s = 0.04;
    solver.refinement.likelihood.motor_current.ut_per_a = [0.3, -0.2, 0.1];
    let Refinement { likelihood, unknowns, .. } = &solver.refinement;
    let retained = solver.retain_result(&solution_with_error(0.5, 0.0)).unwrap();
    let again = likelihood.unknowns_from_start(&retained.starting_point).unwrap();
    assert!((again - unknowns).norm() < 1e-5 * unknowns.norm(), "{again} {unknowns}");
    assert!(solver.restart_refinement(recorded.turns(), &retained.starting_point, retained.corrections));
    let Likelihood { latency_s, motor_current: current, .. } = &solver.refinement.likelihood;
    assert_eq!((*latency_s, current.ut_per_a), (0.04, [0.3, -0.2, 0.1]));
    assert_eq!((solver.latency_update_count, solver.interference_update_count), (1, 1), "each was tried once at least");
}

#[test]
fn a_poor_result_is_retried_without_the_inclination() {
    let (_, recorded) = typical_flight();
    let samples = recorded.turns();
    let prior_with_inclination = Prior { inclination_rad: Some(0.9), ..Prior::default() };
    for (prior, end, is_left_out) in [
        (prior_with_inclination, Ok(solution_with_error(2.0, 0.0)), false),
        (prior_with_inclination, Ok(solution_with_error(4.0, 0.0)), true),
        (prior_with_inclination, Err(SolveError::TurnsReversed), true),
        (Prior::default(), Err(SolveError::TurnsReversed), false),
    ] {
        let mut solver = Solver::new(Method::MaximumLikelihood, samples, &prior).unwrap();
        assert_eq!(solver.start_without_inclination(&end, samples), is_left_out);
        assert_eq!(matches!(solver.given_inclination, GivenInclination::Dropped { .. }), is_left_out);
        assert_eq!(solver.prior.inclination_rad.is_some(), prior.inclination_rad.is_some() && !is_left_out);
        assert!(!is_left_out || !solver.start_without_inclination(&end, samples));
    }
}
