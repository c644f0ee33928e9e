//! Calibration from samples without a known turn side (free flight).

use core::f32::consts::TAU;

use nalgebra::{Matrix3, Vector3};

use super::synthetic::{
    Airframe, Flight, Random, exact_circle, free_samples, max_abs, measured_sample, multirotor_samples, quantile,
    turn_samples,
};
use crate::calibration::closed_form::starting_point::vertical_component_start;
use crate::calibration::tests::{NO_PRIOR, harsh_airframe};
use crate::calibration::{AngleRates, CollectionPart, Method, Sample, Samples, Solution, SolveError, solve_samples};
use crate::frames::{Field, RollPitch, wrap_pi};
use crate::time::WrappingMillis;

fn solve(samples: Samples<'_>) -> Result<Solution, SolveError> {
    solve_samples(Method::MaximumLikelihood, samples, &NO_PRIOR)
}

fn solve_free_flight(samples: &[Sample]) -> Result<Solution, SolveError> {
    solve(free_samples(samples))
}

/// Cramér-Rao bound: 0.3 to 0.6 deg at 15 deg of tilt and 0.6 deg of attitude noise; for the noise of 0.3 deg here 0.1
/// to 0.2 deg, away from the magnetic poles.
#[test]
fn a_multirotor_tilted_to_all_sides_is_calibrated() {
    let mut errors = Vec::new();
    for seed in 0..40 {
        let mut random = Random(8000 + seed);
        let airframe = harsh_airframe(&mut random);
        let solution = solve_free_flight(&multirotor_samples(&airframe, 0.3, &mut random))
            .unwrap_or_else(|error| panic!("seed {seed}: {error:?} {airframe:?}"));
        airframe.assert_expected_error_is_honest(&solution, seed);
        errors.push(airframe.rms_error_deg(&solution.calibration));
    }
    assert!(quantile(&errors, 0.5) <= 0.35 && quantile(&errors, 0.9) <= 0.8, "{errors:?}");
}

#[test]
fn turns_without_a_side_give_the_same_solution() {
    for seed in 0..10 {
        let mut random = Random(8100 + seed);
        let airframe = harsh_airframe(&mut random);
        let turns = Flight { attitude_bias_deg: 0.0, bank_scale: 0.0, ..Flight::TYPICAL }.fly(&airframe, &mut random);
        let from_turns = solve(turns.turns()).unwrap();
        let from_free = solve_free_flight(&[turns.left, turns.right].concat()).unwrap();
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
            solve_free_flight(&samples).unwrap().advice.unwrap()
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
        let start = vertical_component_start(free_samples(&samples), &Matrix3::identity()).unwrap();
        assert!((start.inclination_rad - airframe.inclination_rad).abs() < 0.01, "seed {seed}: {start:?} {airframe:?}");
        assert!((start.w.determinant() - 1.0).abs() < 1e-3);
        for (heading_rad, roll_deg) in [(0.3, 0.0), (2.0, 10.0), (4.0, -10.0)] {
            let attitude = RollPitch::from_deg(roll_deg, 5.0);
            let found = start.w * (airframe.field(attitude, heading_rad).ut / start.field_unit_ut - start.hard_iron);
            let heading = attitude.to_level_frame(Field::new(found)).heading_rad();
            let error_deg = wrap_pi(heading - heading_rad).to_degrees().abs();
            assert!(error_deg < 1.0 && (found.norm() - 1.0).abs() < 0.02, "seed {seed}: {error_deg} {found}");
        }
    }
}

#[test]
fn coplanar_or_broken_samples_give_no_non_finite_start() {
    let airframe = Airframe::random(&mut Random(1), 0.2, 1.0, 5.0, [60.0, 60.1]);
    let level = exact_circle(&airframe, 0.0, 40);
    let broken = [Sample { field: Field::new(Vector3::repeat(f32::NAN)), ..level[0] }; 20];
    for samples in [&level[..], &level[..3], &broken, &[]] {
        let start = vertical_component_start(free_samples(samples), &Matrix3::identity());
        assert!(start.is_none_or(|start| start.w.iter().all(|w| w.is_finite())), "{} samples", samples.len());
    }
}

/// An inverted roll or pitch mirrors the geometry. With body rates it appears as reversed turns, without them as a
/// wrong mounting.
#[test]
fn a_mirrored_attitude_is_detected() {
    for seed in 0..10 {
        let (mut random, airframe) = Airframe::seeded(8300 + seed, 0.2, 1.5, 10.0, [40.0, 70.0]);
        let samples = multirotor_samples(&airframe, 0.3, &mut random);
        for (roll, pitch) in [(-1.0, 1.0), (1.0, -1.0)] {
            let mirror = |sample: &Sample| {
                let RollPitch { roll_rad, pitch_rad } = sample.attitude;
                Sample { attitude: RollPitch { roll_rad: roll * roll_rad, pitch_rad: pitch * pitch_rad }, ..*sample }
            };
            let mut mirrored: Vec<Sample> = samples.iter().map(mirror).collect();
            let refused = solve_free_flight(&mirrored).map(|_| ());
            assert_eq!(refused, Err(SolveError::TurnsReversed), "seed {seed}: {roll} {pitch}");
            for sample in &mut mirrored {
                sample.rates = AngleRates::UNKNOWN;
            }
            let refused = solve_free_flight(&mirrored).map(|_| ());
            assert!(matches!(refused, Err(SolveError::MountContradicted { .. })), "seed {seed}: {refused:?}");
        }
    }
}

/// A multirotor may bank out of a turn.
#[test]
fn banking_out_of_a_turn_is_accepted_with_body_rates() {
    let (mut random, airframe) = Airframe::seeded(8400, 0.2, 1.0, 5.0, [55.0, 65.0]);
    let turn = |bank_deg: f32, rate_rad_s: f32, known: bool, from_ms: u32, random: &mut Random| -> Vec<Sample> {
        (0..120_u16)
            .map(|i| {
                let t_s = f32::from(i) * 0.4;
                let wobble = RollPitch::from_deg(bank_deg + 2.0 * t_s.sin(), 2.0 * (0.7 * t_s).cos());
                let rates = if known { AngleRates::from_rad_s([0.0, 0.0, rate_rad_s]) } else { AngleRates::UNKNOWN };
                let time = WrappingMillis::new(from_ms + u32::from(i) * 400);
                Sample { rates, time, ..measured_sample(&airframe, wobble, rate_rad_s * t_s, 0.1, random) }
            })
            .collect()
    };
    for (known, expected) in [(true, Ok(())), (false, Err(SolveError::TurnsReversed))] {
        let (left, right) = (turn(-20.0, 0.2, known, 0, &mut random), turn(20.0, -0.2, known, 60_000, &mut random));
        assert_eq!(solve(turn_samples(&left, &right)).map(|_| ()), expected, "rates {known}");
    }
}

/// Wrong minima, of another mount or near a magnetic pole, fit samples of straight flight through gusts.
#[test]
fn straight_flight_determines_no_calibration() {
    for seed in 0..40 {
        let (mut random, airframe) = Airframe::seeded(8300 + seed, 0.2, 0.5, 3.0, [40.0, 72.0]);
        let ahead_rad = random.uniform(0.0, TAU);
        let [roll_deg, pitch_deg, heading_deg] = [4.0, 1.5, 6.0].map(|maximum| random.uniform(0.5 * maximum, maximum));
        let samples: Vec<Sample> = (0..448_u16)
            .map(|i| {
                let t = f32::from(i);
                let true_attitude = RollPitch::from_deg(roll_deg * (t / 1.7).sin(), 2.0 + pitch_deg * (t / 2.3).cos());
                let heading_rad = ahead_rad + (heading_deg * (t / 13.0).sin()).to_radians();
                let measured = measured_sample(&airframe, true_attitude, heading_rad, 0.2, &mut random);
                let [roll_rad, pitch_rad] = [true_attitude.roll_rad, true_attitude.pitch_rad]
                    .map(|angle| angle + (random.normal() * 0.2).to_radians());
                let attitude = RollPitch { roll_rad, pitch_rad };
                Sample { attitude, time: WrappingMillis::new(u32::from(i) * 1000), ..measured }
            })
            .collect();
        let undetermined = Err(SolveError::NotDetermined(CollectionPart::FREE));
        assert_eq!(solve_free_flight(&samples).map(|_| ()), undetermined, "seed {seed}");
    }
}
