//! Each rejection reason, and the second start that avoids one.

use core::f32::consts::TAU;

use super::synthetic::{
    Airframe, Flight, Parts, Random, RecordedTurns, exact_circle, exact_turn, free_samples, level_circle,
    level_samples, marked_samples, multirotor_samples, random_vector, samples_in_mount, turn_samples,
};
use super::{NO_PRIOR, harsh_airframe, solve_turns};
use crate::calibration::{
    Axis, CollectionPart, HeadingMark, Method, Orientation, Prior, Sample, Samples, Solution, SolveError, solve_samples,
};
use crate::frames::Field;

fn ordinary_flight(flight: Flight) -> (Airframe, RecordedTurns) {
    let (mut random, airframe) = Airframe::seeded(41, 0.1, 1.0, 5.0, [55.0, 55.0]);
    (airframe, flight.fly(&airframe, &mut random))
}

fn solve_error(method: Method, samples: Samples<'_>) -> Option<SolveError> {
    solve_samples(method, samples, &NO_PRIOR).err()
}

#[test]
fn too_few_samples_reports_the_part() {
    let (airframe, RecordedTurns { left, right }) = ordinary_flight(Flight::TYPICAL);
    let level = level_circle(&airframe, 11, &mut Random(1));
    let marks = [HeadingMark { sample: left[0], heading_rad: 1.0 }; 3];
    let (few_left, few_right) = (turn_samples(&left[..11], &right), turn_samples(&left, &right[..11]));
    for (method, samples, part, have, need) in [
        (Method::TwoPlane, few_left, CollectionPart::LEFT, 11, 12),
        (Method::TwoPlane, few_right, CollectionPart::RIGHT, 11, 12),
        (Method::FourEllipse, few_left, CollectionPart::LEFT, 11, 12),
        (Method::FourEllipse, few_right, CollectionPart::RIGHT, 11, 12),
        (Method::MaximumLikelihood, turn_samples(&left[..5], &right[..6]), CollectionPart::FREE, 11, 12),
        (Method::Level, level_samples(&level), CollectionPart::LEVEL, 11, 12),
        (Method::CompassSwing, marked_samples(&marks), CollectionPart::MARKS, 3, 4),
        (Method::CompassSwing, Samples::default(), CollectionPart::FREE, 0, 12),
    ] {
        let expected = SolveError::TooFewSamples { part, have, need };
        assert_eq!(solve_error(method, samples), Some(expected), "{}", method.method_name());
    }
}

#[test]
fn nonfinite_and_absurd_samples_are_rejected_in_every_part_and_by_every_method() {
    type SampleChange = fn(&mut Sample);
    let (_, RecordedTurns { left: good, .. }) = ordinary_flight(Flight::TYPICAL);
    let changes: [SampleChange; 7] = [
        |s| s.field.ut.x = 2e6,
        |s| s.field.ut.y = -2e6,
        |s| s.field.ut.z = f32::INFINITY,
        |s| s.field.ut.z = f32::NAN,
        |s| s.attitude.roll_rad = f32::NAN,
        |s| s.attitude.pitch_rad = f32::INFINITY,
        |s| s.attitude.pitch_rad = f32::NAN,
    ];
    for (change, method) in changes.into_iter().zip(Method::ALL_METHODS.into_iter().cycle()) {
        let mut bad = good.clone();
        change(&mut bad[7]);
        let mark = HeadingMark { sample: bad[7], heading_rad: 0.0 };
        for samples in
            [turn_samples(&bad, &good), turn_samples(&good, &bad), level_samples(&bad), marked_samples(&[mark; 4])]
        {
            assert_eq!(solve_error(method, samples), Some(SolveError::NotFinite), "{} {mark:?}", method.method_name());
        }
    }
    let nowhere = marked_samples(&[HeadingMark { sample: good[0], heading_rad: f32::NAN }; 4]);
    assert_eq!(solve_error(Method::CompassSwing, nowhere), Some(SolveError::NotFinite));
}

/// A frozen axis, and one whose readings end at 60 % of its range.
#[test]
fn a_stuck_axis_is_reported() {
    for (index, axis) in [Axis::X, Axis::Y, Axis::Z].into_iter().enumerate() {
        let (_, recorded) = ordinary_flight(Flight::TYPICAL);
        let values = || recorded.turns().iter().map(|sample| sample.field.ut[index]);
        let (low, high) = (values().fold(f32::MAX, f32::min), values().fold(f32::MIN, f32::max));
        for (from, to) in [(7.0, 7.0), (low, low + 0.6 * (high - low)), (high - 0.6 * (high - low), high)] {
            let mut stuck = recorded.clone();
            stuck.samples_mut().for_each(|sample| sample.field.ut[index] = sample.field.ut[index].clamp(from, to));
            let refused = solve_error(Method::MaximumLikelihood, stuck.turns());
            assert_eq!(refused, Some(SolveError::AxisStuck { axis }), "{from} to {to} uT");
        }
    }
}

/// Level flight on one heading moves no axis, nor does a module held still where an axis reads most.
#[test]
fn only_turns_show_that_an_axis_is_stuck() {
    let (_, RecordedTurns { left, mut right }) = ordinary_flight(Flight::TYPICAL);
    let level = [left[0]; 200];
    let samples = Parts { left: &left, right: &right, level: &level, ..Parts::default() }.samples();
    assert_eq!(solve_error(Method::TwoPlane, samples), None);
    let most = right.iter().enumerate().max_by(|(_, a), (_, b)| a.field.ut.y.total_cmp(&b.field.ut.y)).unwrap().0;
    right.splice(most..most, [right[most]; 150]);
    let samples = Parts { left: &left, right: &right, ..Parts::default() }.samples();
    assert_eq!(solve_error(Method::MaximumLikelihood, samples), None);
}

#[test]
fn a_turn_that_is_no_ellipse_is_reported() {
    for side in [CollectionPart::LEFT, CollectionPart::RIGHT] {
        let (_, mut recorded) = ordinary_flight(Flight::TYPICAL);
        let turn = if side == CollectionPart::LEFT { &mut recorded.left } else { &mut recorded.right };
        // A hyperbola, as from a short arc with gusts.
        for (i, s) in turn.iter_mut().enumerate() {
            let along = i as f32 / 75.0 - 1.0;
            s.field = Field::from_ut(20.0 * along.cosh(), 30.0 * along.sinh(), 10.0 * along);
        }
        for method in [Method::TwoPlane, Method::FourEllipse] {
            let refused = solve_error(method, recorded.turns());
            assert_eq!(refused, Some(SolveError::NotAnEllipse(side)), "{}", method.method_name());
        }
    }
}

/// The planes of the turns must differ by 10 deg.
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

/// The first error is reported, not that of the retry without the inclination.
#[test]
fn a_random_field_does_not_converge() {
    let (_, mut recorded) = ordinary_flight(Flight::TYPICAL);
    let mut random = Random(3);
    recorded.samples_mut().for_each(|sample| sample.field = Field::new(random_vector(&mut random, 60.0)));
    for inclination_rad in [None, Some(0.96)] {
        let refused =
            solve_samples(Method::MaximumLikelihood, recorded.turns(), &Prior { inclination_rad, ..NO_PRIOR });
        assert_eq!(refused.map(|_| ()), Err(SolveError::NotConverged), "{inclination_rad:?}");
    }
}

#[test]
fn headings_against_the_bank_are_reversed_turns() {
    let airframe = Airframe::with_hard_iron([9.0, -4.0, 15.0]);
    let level = exact_circle(&airframe, 0.0, 36);
    for (step_rad, expected) in [(TAU / 36.0, None), (-TAU / 36.0, Some(SolveError::TurnsReversed))] {
        let (left, right) = (exact_turn(&airframe, -25.0, -step_rad, 72), exact_turn(&airframe, 25.0, step_rad, 72));
        let with_level = |left, right| {
            let samples = Parts { left, right, level: &level, ..Parts::default() }.samples();
            solve_error(Method::MaximumLikelihood, samples)
        };
        assert_eq!(with_level(&left, &[]), expected, "left {step_rad}");
        assert_eq!(with_level(&[], &right), expected, "right {step_rad}");
        let both = turn_samples(&left, &right);
        assert_eq!(solve_error(Method::FourEllipse, both), expected, "both {step_rad}");
        // In the fit of both sides, a sensor mounted upside down explains reversed turns.
        let found = Orientation::from_name("roll180").unwrap();
        let contradicted = expected.map(|_| SolveError::MountContradicted { found });
        assert_eq!(solve_error(Method::MaximumLikelihood, both), contradicted);
    }
}

/// Of turns and of flight to all sides, with and without a configured inclination.
#[test]
fn another_mounting_is_reported() {
    let (airframe, recorded) = ordinary_flight(Flight::TYPICAL);
    let free = free_samples(&multirotor_samples(&airframe, 0.3, &mut Random(8500)));
    for (samples, inclination_rad) in [(recorded.turns(), None), (recorded.turns(), Some(0.96)), (free, None)] {
        for found in Orientation::all_orientations() {
            let turned = samples_in_mount(samples, found);
            let solve = |mount| {
                let prior = Prior { mount, inclination_rad, ..NO_PRIOR };
                solve_samples(Method::MaximumLikelihood, turned, &prior).map(|_| ())
            };
            let is_correct = found == Orientation::IDENTITY_ROTATION;
            let expected = if is_correct { Ok(()) } else { Err(SolveError::MountContradicted { found }) };
            assert_eq!(solve(Orientation::IDENTITY_ROTATION), expected, "{}", found.orientation_name());
            assert_eq!(solve(found), Ok(()), "{}", found.orientation_name());
        }
    }
}

/// Bank and pitch wander by half of the bank, which misleads the two-plane start; the sphere start converges.
#[test]
fn a_second_start_solves_a_misled_first() {
    for seed in [26, 86, 109, 124, 184, 202, 254, 279, 288] {
        let mut random = Random(seed);
        let airframe = harsh_airframe(&mut random);
        let rough =
            Flight { samples_per_side: 60, wander_deg: 8.0, bank_deg: 15.0, sensor_noise_ut: 0.12, ..Flight::TYPICAL };
        let solution = solve_turns(&rough.fly(&airframe, &mut random)).unwrap_or_else(|e| panic!("seed {seed}: {e:?}"));
        airframe.assert_expected_error_is_honest(&solution, seed);
        let error_deg = airframe.rms_error_deg(&solution.calibration);
        assert!(error_deg < 1.0, "seed {seed}: {error_deg} deg");
    }
}

#[test]
fn a_solution_reports_its_quality() {
    let (airframe, recorded) = ordinary_flight(Flight { attitude_bias_deg: 0.0, bank_scale: 0.0, ..Flight::TYPICAL });
    let Solution { calibration, quality, advice, .. } = solve_turns(&recorded).unwrap();
    assert_eq!((quality.method, quality.samples), (Method::MaximumLikelihood, 300));
    // Expected: sensor noise of 0.12 uT, and 0.3 deg of attitude plus the sensor's share; 20 % are five sigma.
    let noise = 0.12 / airframe.total_ut;
    assert!((0.8 * noise..1.3 * noise).contains(&quality.norm_residual), "{}", quality.norm_residual);
    assert!((0.2..0.45).contains(&quality.inclination_residual_deg), "{}", quality.inclination_residual_deg);
    assert!((calibration.inclination_rad - airframe.inclination_rad).abs() < 0.01);
    assert!((calibration.w_matrix().determinant() - 1.0).abs() < 1e-4);
    assert!(quality.expected_worst_deg > quality.expected_rms_deg && advice.is_some());
}
