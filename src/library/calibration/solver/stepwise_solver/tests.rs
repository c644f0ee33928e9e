//! Unit tests of `solver`.

use crate::calibration::tests::synthetic::Parts;
use nalgebra::Matrix3;

use super::*;
use crate::calibration::Axis;
use crate::calibration::solver::sample_checks::stuck_axis;
use crate::calibration::tests::synthetic::{Airframe, Flight, Random, RecordedTurns, rms};
use crate::calibration::{DetectedHardIronChange, HardIronTimeCourse, HeadingMark};
use crate::frames::Attitude;
use crate::frames::Field;

fn varying_samples(number: u8) -> Vec<Sample> {
    let field = |i: u8| Field::from_ut(f32::from(i), 100.0 - f32::from(i), 3.0 * f32::from(i % 10));
    let sample = |i| Sample::new(field(i), Attitude::default());
    (0..number).map(sample).collect()
}

/// `number` of sixty samples have `value_ut` on one axis, the rest 10 to 50 uT.
fn stuck_axis_of(axis: usize, number: usize, value_ut: f32) -> Option<Axis> {
    let mut samples = varying_samples(60);
    for (i, sample) in samples.iter_mut().enumerate() {
        let running_ut = 10.0 + 40.0 * (i - i.min(number)) as f32 / (59 - number) as f32;
        sample.field.ut[axis] = if i < number { value_ut } else { running_ut };
    }
    let (left, right) = samples.split_at(30);
    stuck_axis(Parts { left, right, ..Parts::default() }.samples())
}

/// A fifth of 60 is 12. Varying samples are at least 0.85 uT apart, so one is at each end of the range.
#[test]
fn an_axis_is_stuck_if_over_a_fifth_of_its_samples_are_at_one_end() {
    for (index, axis) in [Axis::X, Axis::Y, Axis::Z].into_iter().enumerate() {
        for end_ut in [50.0, 10.0] {
            assert_eq!(stuck_axis_of(index, 11, end_ut), None, "{axis:?} {end_ut}");
            assert_eq!(stuck_axis_of(index, 12, end_ut), Some(axis), "{axis:?} {end_ut}");
            assert_eq!(stuck_axis_of(index, 20, 30.0), None, "{axis:?} in the middle");
        }
        for (near_ut, far_ut) in [(49.65, 49.55), (10.35, 10.45)] {
            assert_eq!(stuck_axis_of(index, 15, near_ut), Some(axis), "{axis:?} {near_ut}");
            assert_eq!(stuck_axis_of(index, 15, far_ut), None, "{axis:?} {far_ut}");
        }
    }
}

/// Few samples are at one end by chance, and level flight on one heading moves no axis.
#[test]
fn only_turns_show_that_an_axis_is_stuck() {
    let constant_samples = vec![varying_samples(1)[0]; 40];
    assert_eq!(stuck_axis(Parts { level: &constant_samples, ..Parts::default() }.samples()), None);
    assert_eq!(stuck_axis(Parts { left: &constant_samples[..11], ..Parts::default() }.samples()), None);
    assert_eq!(
        stuck_axis(Parts { left: &constant_samples[..6], right: &constant_samples[..6], ..Parts::default() }.samples()),
        Some(Axis::X)
    );
}

#[test]
fn twelve_samples_or_one_mark_are_accepted() {
    let samples = varying_samples(12);
    let missing = |part, have, need| Err(SolveError::TooFewSamples { part, have, need });
    let level_samples = |level| Parts { level, ..Parts::default() }.samples();
    assert_eq!(check_samples(Method::MaximumLikelihood, level_samples(&samples)), Ok(()));
    assert_eq!(
        check_samples(Method::MaximumLikelihood, level_samples(&samples[..11])),
        missing(SamplePart::All, 11, 12)
    );
    assert_eq!(check_samples(Method::Level, level_samples(&samples[..11])), missing(SamplePart::Level, 11, 12));
    assert_eq!(check_samples(Method::CompassSwing, level_samples(&[])), missing(SamplePart::All, 0, 12));
    let mark = [HeadingMark { sample: samples[0], heading_rad: 1.0 }];
    assert_eq!(check_samples(Method::CompassSwing, Parts { marks: &mark, ..Parts::default() }.samples()), Ok(()));
}

#[test]
fn non_finite_samples_are_rejected() {
    type SampleChange = fn(&mut Sample);
    let refused: [SampleChange; 7] = [
        |s| s.field.ut.x = 1.1e6,
        |s| s.field.ut.y = -1.1e6,
        |s| s.field.ut.z = f32::INFINITY,
        |s| s.field.ut.z = f32::NAN,
        |s| s.attitude.roll_rad = f32::NAN,
        |s| s.attitude.pitch_rad = f32::INFINITY,
        |s| s.attitude.pitch_rad = f32::NAN,
    ];
    for change in refused {
        let good = varying_samples(20);
        let mut bad = good.clone();
        change(&mut bad[7]);
        let marks = [HeadingMark { sample: bad[7], heading_rad: 0.0 }];
        for samples in [
            Parts { left: &bad, right: &good, ..Parts::default() }.samples(),
            Parts { left: &good, right: &bad, ..Parts::default() }.samples(),
            Parts { level: &bad, ..Parts::default() }.samples(),
            Parts { marks: &marks, ..Parts::default() }.samples(),
        ] {
            assert_eq!(check_samples(Method::MaximumLikelihood, samples), Err(SolveError::NotFinite), "{:?}", bad[7]);
        }
    }
    let mut large = varying_samples(20);
    large[3].field.ut.x = -0.9e6;
    assert_eq!(check_samples(Method::Level, Parts { level: &large, ..Parts::default() }.samples()), Ok(()));
    let marks = [HeadingMark { sample: varying_samples(1)[0], heading_rad: f32::NAN }];
    let nowhere = check_samples(Method::CompassSwing, Parts { marks: &marks, ..Parts::default() }.samples());
    assert_eq!(nowhere, Err(SolveError::NotFinite));
}

fn solution_with_error(expected_rms_deg: f32, b_ut: f32) -> Solution {
    let (_, recorded) = typical_flight();
    let mut solution = solve_samples(Method::MaximumLikelihood, recorded.turns(), &Prior::default()).unwrap();
    solution.quality.expected_rms_deg = expected_rms_deg;
    solution.calibration.b_ut = [0.0, b_ut, 0.0];
    solution
}

fn typical_flight() -> (Airframe, RecordedTurns) {
    let mut random = Random(31);
    let airframe = Airframe::random(&mut random, 0.1, 1.0, 5.0, [55.0, 55.0]);
    let recorded = Flight::TYPICAL.fly(&airframe, &mut random);
    (airframe, recorded)
}

#[test]
fn limits_of_a_poor_result() {
    for (expected_rms_deg, b_ut, doubtful) in
        [(2.99, 299.0, false), (3.01, 0.0, true), (0.5, 301.0, true), (0.5, -301.0, true), (f32::NAN, 0.0, true)]
    {
        assert_eq!(is_poor(&Ok(solution_with_error(expected_rms_deg, b_ut))), doubtful, "{expected_rms_deg} {b_ut}");
    }
    let change = DetectedHardIronChange { size_ut: 9.0, time_course: HardIronTimeCourse::Drift, duration_s: 200 };
    assert!(is_poor(&Err(SolveError::NotConverged)) && is_poor(&Err(SolveError::HardIronChanged(change))));
    assert!(!is_poor(&Err(SolveError::TurnsReversed)));
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
    let error = |solution: &Solution| rms(&airframe.errors_deg(&solution.calibration));
    // Simulates a poor first result with this misfit.
    for (misfit, is_found_again) in [(f32::INFINITY, false), (0.0, true)] {
        let mut solver = new();
        while !matches!(solver.refinement.refine_step(samples), Refining::Converged) {}
        let RetainedResult { starting_point: start, noise, .. } = solver.retain_result(&plain).unwrap();
        let sphere = starting_point::sphere_start(samples, &Matrix3::identity()).unwrap();
        assert!(solver.restart_refinement(samples, &sphere, SampleCorrections::NO_CORRECTIONS));
        (solver.attempt.start, solver.first_result) = (
            AttemptStart::Sphere,
            Some(RetainedResult {
                starting_point: start,
                misfit,
                corrections: SampleCorrections::NO_CORRECTIONS,
                noise,
            }),
        );
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
    let noise = &solver.refinement.likelihood.noise;
    assert!(
        (misfit / (noise.norm_sigma * noise.inclination_sigma_rad * solution.calibration.total_ut) - 1.0).abs() < 1e-5
    );
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

/// A latency that changes with each estimate is used twice, and then not again.
#[test]
fn the_latency_is_updated_at_most_twice() {
    let (_, recorded) = typical_flight();
    let mut solver = Solver::new(Method::MaximumLikelihood, recorded.turns(), &Prior::default()).unwrap();
    let mut used_s = Vec::new();
    while used_s.len() < 5 {
        let latency = AttitudeLatency { estimate_s: 0.1 + 0.05 * used_s.len() as f32, sigma_s: 0.01 };
        if !solver.restart_with_latency(recorded.turns(), Some(&(latency, Vector13::zeros()))) {
            break;
        }
        used_s.push(solver.refinement.likelihood.latency_s);
    }
    assert!(used_s.len() == 2 && (used_s[1] - 0.15).abs() < 1e-6, "{used_s:?}");
}

#[test]
fn interference_is_dropped_above_0_5_ut_of_sigma() {
    let (_, recorded) = typical_flight();
    let samples = recorded.turns();
    for (sigma_ut, stays) in [(0.45, true), (0.55, false)] {
        let mut solver = Solver::new(Method::MaximumLikelihood, samples, &Prior::default()).unwrap();
        let likelihood = &mut solver.refinement.likelihood;
        (likelihood.motor_current.current_sigma_a, likelihood.motor_current.ut_per_a) = (10.0, [0.3, 0.0, 0.0]);
        let (k, sigma) = (likelihood.interference_per_ampere(), sigma_ut / 10.0 / likelihood.field_unit_ut);
        let covariance = Matrix3::from_diagonal_element(sigma * sigma);
        let found = InterferenceEstimate { interference_per_ampere: k, covariance, significance: [99.0; 2] };
        solver.interference_update_count = 2;
        let information = solver.information(&solver.refinement.likelihood, samples);
        assert_eq!(solver.restart_with_interference(samples, &information, &found), !stays, "{sigma_ut} uT");
        assert_eq!(solver.refinement.likelihood.motor_current.is_applied(), stays);
    }
}

#[test]
fn a_poor_result_is_retried_without_the_inclination() {
    let (_, recorded) = typical_flight();
    let samples = recorded.turns();
    let prior_with_inclination = Prior { inclination_rad: Some(0.9), ..Prior::default() };
    for (prior, end, is_left_out) in [
        (prior_with_inclination, Ok(solution_with_error(2.9, 0.0)), false),
        (prior_with_inclination, Ok(solution_with_error(3.1, 0.0)), true),
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

#[test]
fn each_attempt_has_its_successors() {
    let successors = |before: Attempt| -> Vec<usize> {
        let later = ATTEMPT_QUEUE.iter().enumerate().skip_while(move |(_, attempt)| **attempt != before).skip(1);
        later.filter(|(_, next)| next.may_follow(before)).map(|(place, _)| place).collect()
    };
    assert_eq!(ATTEMPT_QUEUE.map(successors), [vec![1, 3], vec![2, 3], vec![3], vec![4], vec![5], vec![]]);
}
