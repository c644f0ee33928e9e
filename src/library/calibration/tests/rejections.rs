//! Each rejection reason, and the second start that avoids one.

use crate::calibration::tests::synthetic::Parts;
use core::f32::consts::{PI, TAU};

use nalgebra::{Matrix3, Vector3};

use super::synthetic::{Airframe, Flight, Random, RecordedTurns, level_circle, measured_sample, random_vector, rms};
use crate::calibration::tests::NO_PRIOR;
use crate::calibration::{
    Axis, HeadingMark, Method, Orientation, Sample, SamplePart, Samples, Side, Solution, SolveError, Solver,
    solve_samples,
};
use crate::frames::{Attitude, Field};
use crate::time::WrappingMillis;

fn ordinary_flight(flight: Flight) -> (Airframe, RecordedTurns) {
    let mut random = Random(41);
    let airframe = Airframe::random(&mut random, 0.1, 1.0, 5.0, [55.0, 55.0]);
    (airframe, flight.fly(&airframe, &mut random))
}

fn solve_error(method: Method, samples: Samples<'_>) -> Option<SolveError> {
    solve_samples(method, samples, &NO_PRIOR).err()
}

#[test]
fn too_few_samples_reports_the_part() {
    let (airframe, recorded) = ordinary_flight(Flight::TYPICAL);
    let missing = |part, have, need| Some(SolveError::TooFewSamples { part, have, need });
    let RecordedTurns { left, right } = &recorded;
    for method in [Method::TwoPlane, Method::FourEllipse] {
        let error_of = |left, right| solve_error(method, Parts { left, right, ..Parts::default() }.samples());
        assert_eq!(error_of(&left[..11], right), missing(SamplePart::Turns(Side::Left), 11, 12));
        assert_eq!(error_of(left, &right[..11]), missing(SamplePart::Turns(Side::Right), 11, 12));
    }
    let few_samples = Parts { left: &left[..5], right: &right[..6], ..Parts::default() }.samples();
    assert_eq!(solve_error(Method::MaximumLikelihood, few_samples), missing(SamplePart::All, 11, 12));
    let level = level_circle(&airframe, 11, &mut Random(1));
    let level = Parts { level: &level, ..Parts::default() }.samples();
    assert_eq!(solve_error(Method::Level, level), missing(SamplePart::Level, 11, 12));
    let mark = HeadingMark { sample: left[0], heading_rad: 1.0 };
    let marks = Parts { marks: &[mark; 3], ..Parts::default() }.samples();
    assert_eq!(solve_error(Method::CompassSwing, marks), missing(SamplePart::Marks, 3, 4));
}

#[test]
fn every_method_rejects_nonfinite_samples() {
    let (_, mut recorded) = ordinary_flight(Flight::TYPICAL);
    recorded.right[17].field.ut.z = f32::NAN;
    for method in Method::ALL_METHODS {
        assert_eq!(solve_error(method, recorded.turns()), Some(SolveError::NotFinite), "{}", method.method_name());
    }
}

#[test]
fn too_few_headings_reports_their_number() {
    let (airframe, _) = ordinary_flight(Flight::TYPICAL);
    let mut random = Random(2);
    let level: Vec<Sample> = (0..40_u8)
        .map(|i| measured_sample(&airframe, Attitude::default(), f32::from(i % 4) * PI / 2.0 + 0.1, 0.05, &mut random))
        .collect();
    let level = Parts { level: &level, ..Parts::default() }.samples();
    let refused = solve_error(Method::Level, level);
    assert!(matches!(refused, Some(SolveError::TooFewHeadings { have: 3 | 4, need: 5 })), "{refused:?}");
}

#[test]
fn a_stuck_axis_is_reported() {
    for (index, axis) in [Axis::X, Axis::Y, Axis::Z].into_iter().enumerate() {
        let (_, mut recorded) = ordinary_flight(Flight::TYPICAL);
        recorded.left.iter_mut().chain(&mut recorded.right).for_each(|sample| sample.field.ut[index] = 7.0);
        let refused = solve_error(Method::MaximumLikelihood, recorded.turns());
        assert_eq!(refused, Some(SolveError::AxisStuck { axis }));
    }
}

#[test]
fn a_turn_that_is_no_ellipse_is_reported() {
    for side in [Side::Left, Side::Right] {
        let (_, mut recorded) = ordinary_flight(Flight::TYPICAL);
        let turn = if side == Side::Left { &mut recorded.left } else { &mut recorded.right };
        // A hyperbola, as from a short arc with gusts.
        for (i, s) in turn.iter_mut().enumerate() {
            let along = i as f32 / 75.0 - 1.0;
            s.field = Field::from_ut(20.0 * along.cosh(), 30.0 * along.sinh(), 10.0 * along);
        }
        for method in [Method::TwoPlane, Method::FourEllipse] {
            let refused = solve_error(method, recorded.turns());
            assert_eq!(refused, Some(SolveError::NotAnEllipse(SamplePart::Turns(side))), "{}", method.method_name());
        }
    }
}

#[test]
fn unobservable_coefficients_are_reported() {
    let (airframe, recorded) = ordinary_flight(Flight { wander_deg: 0.5, ..Flight::TYPICAL });
    assert_eq!(solve_error(Method::Ellipsoid, recorded.turns()), Some(SolveError::NotDetermined(SamplePart::All)));
    let constant_sample = measured_sample(&airframe, Attitude::default(), 1.0, 0.0, &mut Random(0));
    let marks =
        Parts { marks: &[HeadingMark { sample: constant_sample, heading_rad: 1.0 }; 6], ..Parts::default() }.samples();
    assert_eq!(solve_error(Method::CompassSwing, marks), Some(SolveError::NotDetermined(SamplePart::Marks)));
}

/// Limit: 9.8 deg between the planes of the turns. Banks of 4 deg each way give 8 deg, of 6 deg 12 deg.
#[test]
fn small_banks_give_the_same_plane() {
    for method in [Method::TwoPlane, Method::FourEllipse] {
        let solved_with = |bank_deg| {
            let (_, recorded) = ordinary_flight(Flight { bank_deg, samples_per_side: 700, ..Flight::NOISE_FREE });
            solve_error(method, recorded.turns())
        };
        assert_eq!(solved_with(4.0), Some(SolveError::SamePlane), "{}", method.method_name());
        assert_ne!(solved_with(6.0), Some(SolveError::SamePlane), "{}", method.method_name());
    }
}

#[test]
fn a_random_field_does_not_converge() {
    let (_, mut recorded) = ordinary_flight(Flight::TYPICAL);
    let mut random = Random(3);
    for s in recorded.left.iter_mut().chain(&mut recorded.right) {
        s.field = Field::new(random_vector(&mut random, 60.0));
    }
    assert_eq!(solve_error(Method::MaximumLikelihood, recorded.turns()), Some(SolveError::NotConverged));
}

/// Airframe that the closed forms recover exactly.
const ALIGNED_AIRFRAME: Airframe = Airframe {
    a: Matrix3::new(1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0),
    b_ut: Vector3::new(9.0, -4.0, 15.0),
    total_ut: 50.0,
    inclination_rad: 1.0,
};

fn aligned_sample(bank_deg: f32, heading_rad: f32, millis: u32) -> Sample {
    let measured =
        measured_sample(&ALIGNED_AIRFRAME, Attitude::from_deg(bank_deg, 0.0), heading_rad, 0.0, &mut Random(0));
    Sample { time: WrappingMillis::new(millis), ..measured }
}

fn two_circles(bank_deg: f32, heading_step_rad: f32) -> Vec<Sample> {
    (0..72_u16).map(|i| aligned_sample(bank_deg, f32::from(i) * heading_step_rad, u32::from(i) * 500)).collect()
}

#[test]
fn headings_against_the_bank_are_reversed_turns() {
    const HEADING_STEP_RAD: f32 = TAU / 36.0;
    let level = two_circles(0.0, HEADING_STEP_RAD);
    for (heading_step_rad, expected) in [(HEADING_STEP_RAD, None), (-HEADING_STEP_RAD, Some(SolveError::TurnsReversed))]
    {
        let (left, right) = (two_circles(-25.0, -heading_step_rad), two_circles(25.0, heading_step_rad));
        let error_of = |method, left, right| {
            solve_error(method, Parts { left, right, level: &level, ..Parts::default() }.samples())
        };
        assert_eq!(error_of(Method::MaximumLikelihood, &left, &[]), expected, "left {heading_step_rad}");
        assert_eq!(error_of(Method::MaximumLikelihood, &[], &right), expected, "right {heading_step_rad}");
        let both = solve_error(Method::FourEllipse, Parts { left: &left, right: &right, ..Parts::default() }.samples());
        assert_eq!(both, expected, "both {heading_step_rad}");
        // In the fit of both sides, a sensor mounted upside down explains reversed turns.
        let both =
            solve_error(Method::MaximumLikelihood, Parts { left: &left, right: &right, ..Parts::default() }.samples());
        let found = Orientation::from_name("roll180").unwrap();
        assert_eq!(both, expected.map(|_| SolveError::MountContradicted { found }));
    }
}

/// Each turn has 24 samples 5 s apart, too sparse to give a direction, and 8 s in which the heading changes by
/// `runs_rad`. The limit is 3 rad on both sides together.
#[test]
fn half_a_circle_against_the_turns_is_rejected() {
    let turn = |bank_deg: f32, runs_rad: f32| -> Vec<Sample> {
        let stragglers = (0..24_u8).map(|i| aligned_sample(bank_deg, f32::from(i) / 24.0 * TAU, u32::from(i) * 5_000));
        let seconds =
            (0..=8_u8).map(|i| aligned_sample(bank_deg, runs_rad * f32::from(i) / 8.0, 200_000 + u32::from(i) * 1_000));
        stragglers.chain(seconds).collect()
    };
    let refused = |left_rad: f32, right_rad: f32| {
        let (left, right) = (turn(-25.0, left_rad), turn(25.0, right_rad));
        solve_error(Method::FourEllipse, Parts { left: &left, right: &right, ..Parts::default() }.samples())
    };
    for (left_rad, right_rad, expected) in [
        (0.0, -2.9, None),
        (0.0, -3.1, Some(SolveError::TurnsReversed)),
        (2.9, 0.0, None),
        (3.1, 0.0, Some(SolveError::TurnsReversed)),
        (1.6, -1.6, Some(SolveError::TurnsReversed)),
        (-1.0, -3.5, None),
        (-3.5, 3.5, None),
    ] {
        assert_eq!(refused(left_rad, right_rad), expected, "{left_rad} {right_rad}");
    }
}

#[test]
fn a_wrong_mounting_is_reported() {
    let (_, recorded) = ordinary_flight(Flight::TYPICAL);
    let found = Orientation::from_name("roll180-yaw90").unwrap();
    let refused = solve_error(Method::MaximumLikelihood, recorded.in_mount(found).turns());
    assert_eq!(refused, Some(SolveError::MountContradicted { found }));
}

/// Bank and pitch wander by half of the bank, which misleads the two-plane start; the sphere start converges.
#[test]
fn a_second_start_solves_a_misled_first() {
    for seed in [26, 86, 109, 124, 184, 202, 254, 279, 288] {
        let mut random = Random(seed);
        let airframe = crate::calibration::tests::harsh_airframe(&mut random);
        let rough =
            Flight { samples_per_side: 60, wander_deg: 8.0, bank_deg: 15.0, sensor_noise_ut: 0.12, ..Flight::TYPICAL };
        let recorded = rough.fly(&airframe, &mut random);
        let solution =
            crate::calibration::tests::solve_turns(&recorded).unwrap_or_else(|e| panic!("seed {seed}: {e:?}"));
        let (error, expected) = (rms(&airframe.errors_deg(&solution.calibration)), solution.quality.expected_rms_deg);
        assert!(error < 1.0 && error < 3.0 * expected, "seed {seed}: {error} deg, expected {expected}");
    }
}

#[test]
fn a_solution_reports_its_quality() {
    let (airframe, recorded) = ordinary_flight(Flight { attitude_bias_deg: 0.0, bank_scale: 0.0, ..Flight::TYPICAL });
    let solver = Solver::new(Method::MaximumLikelihood, recorded.turns(), &NO_PRIOR).unwrap();
    let Solution { calibration, quality, advice, .. } = solver.run(recorded.turns()).unwrap();
    assert_eq!((quality.method, quality.samples), (Method::MaximumLikelihood, 300));
    // Expected: sensor noise of 0.12 uT, and 0.3 deg of attitude plus the sensor's share; 20 % are five sigma.
    let noise = 0.12 / airframe.total_ut;
    assert!((0.8 * noise..1.3 * noise).contains(&quality.norm_residual), "{}", quality.norm_residual);
    assert!((0.2..0.45).contains(&quality.inclination_residual_deg), "{}", quality.inclination_residual_deg);
    assert!((calibration.inclination_rad - airframe.inclination_rad).abs() < 0.01);
    assert!((calibration.w_matrix().determinant() - 1.0).abs() < 1e-4);
    assert!(quality.expected_worst_deg > quality.expected_rms_deg && advice.is_some());
}
