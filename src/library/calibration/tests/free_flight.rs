//! Calibration from samples without a known turn side (free flight).

use crate::calibration::tests::synthetic::Parts;
use core::f32::consts::TAU;

use super::synthetic::{Airframe, Flight, Random, max_abs, measured_sample, multirotor_samples, quantile, rms};
use crate::calibration::closed_form::starting_point::vertical_component_start;
use crate::calibration::tests::{NO_PRIOR, harsh_airframe};
use crate::calibration::{Method, Orientation, Prior, Rates, Sample, SamplePart, Samples, SolveError, solve_samples};
use crate::frames::{Attitude, Field};
use crate::time::WrappingMillis;
use nalgebra::{Matrix3, Vector3};

fn solve_free_flight(
    samples: &[Sample],
    prior: &Prior,
) -> Result<crate::calibration::assessment::Solution, SolveError> {
    solve_samples(Method::MaximumLikelihood, Samples::new(samples), prior)
}

/// Cramér-Rao bound: 0.3 to 0.6 deg at 15 deg of tilt and 0.6 deg of attitude noise; for the noise of 0.3 deg here 0.1
/// to 0.2 deg, away from the magnetic poles.
#[test]
fn a_multirotor_tilted_to_all_sides_is_calibrated() {
    let mut errors = Vec::new();
    for seed in 0..40 {
        let mut random = Random(8000 + seed);
        let airframe = harsh_airframe(&mut random);
        let solution = solve_free_flight(&multirotor_samples(&airframe, 0.3, &mut random), &NO_PRIOR)
            .unwrap_or_else(|error| panic!("seed {seed}: {error:?} {airframe:?}"));
        let error_deg = rms(&airframe.errors_deg(&solution.calibration));
        assert!(error_deg <= 3.0 * solution.quality.expected_rms_deg, "seed {seed}: {error_deg} {solution:?}");
        errors.push(error_deg);
    }
    assert!(quantile(&errors, 0.5) <= 0.35 && quantile(&errors, 0.9) <= 0.8, "{errors:?}");
}

#[test]
fn turns_without_a_side_give_the_same_solution() {
    for seed in 0..10 {
        let mut random = Random(8100 + seed);
        let airframe = harsh_airframe(&mut random);
        let turns = Flight { attitude_bias_deg: 0.0, bank_scale: 0.0, ..Flight::TYPICAL }.fly(&airframe, &mut random);
        let from_turns = solve_samples(Method::MaximumLikelihood, turns.turns(), &NO_PRIOR).unwrap();
        let free = Parts { free: &[&turns.left[..], &turns.right].concat(), ..Parts::default() }.samples();
        let from_free = solve_samples(Method::MaximumLikelihood, free, &NO_PRIOR).unwrap();
        let apart: Vec<f32> = airframe
            .errors_deg(&from_turns.calibration)
            .iter()
            .zip(airframe.errors_deg(&from_free.calibration))
            .map(|(turns, free)| turns - free)
            .collect();
        assert!(max_abs(&apart) < 0.1 * from_turns.quality.expected_rms_deg.max(0.2), "seed {seed}: {apart:?}");
    }
}

/// Twelve times the samples reduce the variance above the floor to a twelfth.
#[test]
fn the_error_floor_remains_with_more_samples() {
    for seed in 0..5 {
        let mut random = Random(8150 + seed);
        let airframe = harsh_airframe(&mut random);
        let mut expected_error_of_samples = |times: usize| {
            let mut samples: Vec<Sample> =
                (0..times).flat_map(|_| multirotor_samples(&airframe, 0.6, &mut random)).collect();
            samples.iter_mut().zip(0..).for_each(|(sample, i)| sample.time = WrappingMillis::new(250 * i));
            solve_free_flight(&samples, &NO_PRIOR).unwrap().advice.unwrap()
        };
        let (once, often) = (expected_error_of_samples(1), expected_error_of_samples(12));
        let square = |deg: f32| deg * deg;
        let floor_squared = square(once.error_floor_deg);
        let predicted_deg = (floor_squared + (square(once.expected_deg) - floor_squared) / 12.0).sqrt();
        assert!(once.expected_deg > 1.3 * once.error_floor_deg, "seed {seed}: {once:?}");
        assert!((often.expected_deg / predicted_deg - 1.0).abs() < 0.2, "seed {seed}: {predicted_deg} {often:?}");
    }
}

#[test]
fn the_vertical_component_gives_a_start() {
    for seed in 0..40 {
        let mut random = Random(8200 + seed);
        let airframe =
            Airframe::random(&mut random, 0.3, 3.0, 20.0, if seed % 2 == 0 { [20.0, 75.0] } else { [-75.0, -20.0] });
        let samples = multirotor_samples(&airframe, 0.0, &mut random);
        let free = Parts { free: &samples, ..Parts::default() }.samples();
        let start = vertical_component_start(free, &Matrix3::identity()).unwrap();
        assert!((start.inclination_rad - airframe.inclination_rad).abs() < 0.01, "seed {seed}: {start:?} {airframe:?}");
        assert!((start.w.determinant() - 1.0).abs() < 1e-3);
        for (heading_rad, roll_deg) in [(0.3, 0.0), (2.0, 10.0), (4.0, -10.0)] {
            let attitude = Attitude::from_deg(roll_deg, 5.0);
            let found = start.w * (airframe.field(attitude, heading_rad).ut / start.field_unit_ut - start.hard_iron);
            let heading = attitude.to_level_frame(Field::new(found)).heading_rad();
            let error_deg = crate::frames::wrap_pi(heading - heading_rad).to_degrees().abs();
            assert!(error_deg < 1.0 && (found.norm() - 1.0).abs() < 0.02, "seed {seed}: {error_deg} {found}");
        }
    }
}

#[test]
fn coplanar_or_broken_samples_give_no_non_finite_start() {
    let airframe = Airframe::random(&mut Random(1), 0.2, 1.0, 5.0, [60.0, 60.1]);
    let level: Vec<Sample> = (0..40_u8)
        .map(|i| measured_sample(&airframe, Attitude::default(), f32::from(i) / 40.0 * TAU, 0.0, &mut Random(2)))
        .collect();
    let broken = [Sample { field: Field::new(Vector3::repeat(f32::NAN)), ..level[0] }; 20];
    for samples in [&level[..], &level[..3], &broken, &[]] {
        let free = Parts { free: samples, ..Parts::default() }.samples();
        let start = vertical_component_start(free, &Matrix3::identity());
        assert!(start.is_none_or(|start| start.w.iter().all(|w| w.is_finite())), "{} samples", samples.len());
    }
}

/// An inverted roll or pitch mirrors the geometry. With body rates it appears as reversed turns, without them as a
/// wrong mounting.
#[test]
fn a_mirrored_attitude_is_detected() {
    for seed in 0..10 {
        let mut random = Random(8300 + seed);
        let airframe = Airframe::random(&mut random, 0.2, 1.5, 10.0, [40.0, 70.0]);
        let samples = multirotor_samples(&airframe, 0.3, &mut random);
        assert!(solve_free_flight(&samples, &NO_PRIOR).is_ok());
        for (roll, pitch) in [(-1.0, 1.0), (1.0, -1.0)] {
            let mirror = |sample: &Sample| {
                let Attitude { roll_rad, pitch_rad } = sample.attitude;
                Sample { attitude: Attitude { roll_rad: roll * roll_rad, pitch_rad: pitch * pitch_rad }, ..*sample }
            };
            let mirrored: Vec<Sample> = samples.iter().map(mirror).collect();
            let refused = solve_free_flight(&mirrored, &NO_PRIOR).map(|_| ());
            assert_eq!(refused, Err(SolveError::TurnsReversed), "seed {seed}: {roll} {pitch}");
            let silent: Vec<Sample> =
                mirrored.iter().map(|sample| Sample { rates: Rates::UNKNOWN, ..*sample }).collect();
            let refused = solve_free_flight(&silent, &NO_PRIOR).map(|_| ());
            assert!(matches!(refused, Err(SolveError::MountContradicted { .. })), "seed {seed}: {refused:?}");
        }
    }
}

/// A multirotor may bank out of a turn.
#[test]
fn banking_out_of_a_turn_is_accepted_with_body_rates() {
    let mut random = Random(8400);
    let airframe = Airframe::random(&mut random, 0.2, 1.0, 5.0, [55.0, 65.0]);
    let turn = |bank_deg: f32, rate_rad_s: f32, known: bool, from_ms: u32, random: &mut Random| -> Vec<Sample> {
        (0..120_u16)
            .map(|i| {
                let t_s = f32::from(i) * 0.4;
                let wobble = Attitude::from_deg(bank_deg + 2.0 * t_s.sin(), 2.0 * (0.7 * t_s).cos());
                let rates = if known { Rates::from_rad_s([0.0, 0.0, rate_rad_s]) } else { Rates::UNKNOWN };
                let time = WrappingMillis::new(from_ms + u32::from(i) * 400);
                Sample { rates, time, ..measured_sample(&airframe, wobble, rate_rad_s * t_s, 0.1, random) }
            })
            .collect()
    };
    for (known, expected) in [(true, Ok(())), (false, Err(SolveError::TurnsReversed))] {
        let (left, right) = (turn(-20.0, 0.2, known, 0, &mut random), turn(20.0, -0.2, known, 60_000, &mut random));
        let turns = Parts { left: &left, right: &right, ..Parts::default() }.samples();
        assert_eq!(solve_samples(Method::MaximumLikelihood, turns, &NO_PRIOR).map(|_| ()), expected, "rates {known}");
    }
}

#[test]
fn another_mounting_is_reported() {
    let mut random = Random(8500);
    let airframe = Airframe::random(&mut random, 0.15, 1.0, 5.0, [50.0, 65.0]);
    let samples = multirotor_samples(&airframe, 0.3, &mut random);
    for found in Orientation::all_orientations() {
        let sensor_from_body = found.body_from_sensor().transpose();
        let turned: Vec<Sample> = samples
            .iter()
            .map(|sample| Sample { field: Field::new(sensor_from_body * sample.field.ut), ..*sample })
            .collect();
        let refused = solve_free_flight(&turned, &NO_PRIOR).map(|_| ());
        let expected =
            if found == Orientation::IDENTITY_ROTATION { Ok(()) } else { Err(SolveError::MountContradicted { found }) };
        assert_eq!(refused, expected, "{}", found.orientation_name());
        assert!(
            solve_free_flight(&turned, &Prior { mount: found, ..NO_PRIOR }).is_ok(),
            "{}",
            found.orientation_name()
        );
    }
}

/// A wrong minimum near a magnetic pole fits samples of straight flight through gusts.
#[test]
fn straight_flight_has_an_honest_expected_error() {
    let mut not_determined = 0;
    for seed in 0..40 {
        let mut random = Random(8300 + seed);
        let airframe = Airframe::random(&mut random, 0.2, 0.5, 3.0, [40.0, 72.0]);
        let ahead_rad = random.uniform(0.0, TAU);
        let [roll_deg, pitch_deg, heading_deg] = [4.0, 1.5, 6.0].map(|maximum| random.uniform(0.5 * maximum, maximum));
        let samples: Vec<Sample> = (0..448_u16)
            .map(|i| {
                let t = f32::from(i);
                let true_attitude = Attitude::from_deg(roll_deg * (t / 1.7).sin(), 2.0 + pitch_deg * (t / 2.3).cos());
                let heading_rad = ahead_rad + (heading_deg * (t / 13.0).sin()).to_radians();
                let measured = measured_sample(&airframe, true_attitude, heading_rad, 0.2, &mut random);
                let mut attitude_error_rad = || (random.normal() * 0.2).to_radians();
                let [roll_off, pitch_off] = core::array::from_fn(|_| attitude_error_rad());
                let attitude = Attitude {
                    roll_rad: true_attitude.roll_rad + roll_off,
                    pitch_rad: true_attitude.pitch_rad + pitch_off,
                };
                Sample { attitude, time: WrappingMillis::new(u32::from(i) * 1000), ..measured }
            })
            .collect();
        match solve_free_flight(&samples, &NO_PRIOR) {
            Ok(solution) => {
                let error_deg = rms(&airframe.errors_deg(&solution.calibration));
                let expected_deg = solution.quality.expected_rms_deg;
                assert!(error_deg <= 3.0 * expected_deg, "seed {seed}: {error_deg} {expected_deg}");
            }
            Err(error) => not_determined += usize::from(error == SolveError::NotDetermined(SamplePart::All)),
        }
    }
    // 25 of 40 flights are undetermined; the sphere start solves 14 that ended at the pole, to 37 deg or worse.
    assert!((20..=30).contains(&not_determined), "{not_determined}");
}
