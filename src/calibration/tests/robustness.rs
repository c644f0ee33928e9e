//! Faults in the samples: the right answer, or a refusal with a reason. Never a wrong answer that looks right.

use super::solved;
use super::synthetic::{Airframe, Flight, Random, Recorded, rms, vector};
use crate::calibration::Sample;

/// What came of a fault over many airframes.
#[derive(Debug, Default)]
struct Tally {
    right: u32,
    refused: u32,
    reasons: Vec<&'static str>,
}

/// Expected errors beyond this are refused by the module, degrees.
const ACCEPTED_DEG: f32 = 3.0;

/// Flies 60 airframes with a fault; asserts that what would be accepted is right, within three of its own sigmas.
fn suffer(fault: impl Fn(&mut Recorded, &mut Random)) -> Tally {
    let mut tally = Tally::default();
    for seed in 0..60 {
        let mut random = Random(4000 + seed);
        let airframe = Airframe::random(&mut random, 0.2, 1.5, 10.0, [-70.0, 70.0]);
        let mut recorded = Flight::REAL.fly(&airframe, &mut random);
        fault(&mut recorded, &mut random);
        match solved(&recorded) {
            Ok(solution) if solution.quality.expected_rms_deg <= ACCEPTED_DEG => {
                let error = rms(&airframe.errors_deg(&solution.calibration));
                let expected = solution.quality.expected_rms_deg;
                assert!(error <= 3.0 * expected, "seed {seed}: {error} deg, expected {expected}");
                tally.right += 1;
            }
            Ok(_) => tally.refused += 1,
            Err(error) => {
                tally.refused += 1;
                tally.reasons.push(error.code());
            }
        }
    }
    tally
}

fn each(recorded: &mut Recorded, change: impl FnMut(&mut Sample)) {
    recorded.left.iter_mut().chain(&mut recorded.right).for_each(change);
}

/// Gusts throw the attitude source off by ten degrees for three seconds, four times on each side.
#[test]
fn gusts() {
    let tally = suffer(|recorded, random| {
        for side in [&mut recorded.left, &mut recorded.right] {
            for gust in 0..4 {
                let [roll_rad, pitch_rad] = [0; 2].map(|_| (random.normal() * 10.0).to_radians());
                for sample in side.iter_mut().skip(gust * 37).take(6) {
                    sample.attitude.roll_rad += roll_rad;
                    sample.attitude.pitch_rad += pitch_rad;
                }
            }
        }
    });
    assert!(tally.right >= 55, "{tally:?}");
}

/// A power line below: up to 15 uT for five seconds, once on each side.
#[test]
fn a_power_line() {
    let tally = suffer(|recorded, random| {
        for side in [&mut recorded.left, &mut recorded.right] {
            let disturbance = vector(random, 1.0).normalize() * 15.0;
            for (i, sample) in side.iter_mut().skip(60).take(10).enumerate() {
                sample.field.ut += disturbance * (core::f32::consts::PI * i as f32 / 10.0).sin();
            }
        }
    });
    assert!(tally.right >= 55, "{tally:?}");
}

/// The motor's current steps from one thrust to another now and then: 0.5 uT to and fro.
#[test]
fn motor_current_steps() {
    let tally = suffer(|recorded, random| {
        let step = vector(random, 1.0).normalize() * 0.5;
        let mut seconds = 0.0;
        each(recorded, |sample| {
            seconds += 0.5;
            if (seconds / 20.0) as u32 % 2 == 1 {
                sample.field.ut += step;
            }
        });
    });
    assert!(tally.right >= 50, "{tally:?}");
}

/// An axis ends at three quarters of what it should reach, and nothing flags it.
#[test]
fn a_saturated_axis() {
    let tally = suffer(|recorded, _| {
        let all = recorded.left.iter().chain(&recorded.right);
        let top = all.map(|s| s.field.ut.x).fold(f32::MIN, f32::max);
        let bottom = recorded.left.iter().chain(&recorded.right).map(|s| s.field.ut.x).fold(f32::MAX, f32::min);
        let limit = bottom + 0.75 * (top - bottom);
        each(recorded, |sample| sample.field.ut.x = sample.field.ut.x.min(limit));
    });
    assert_eq!(tally.refused, 60, "{tally:?}");
    assert!(tally.reasons.contains(&"axis-stuck"), "{tally:?}");
}

/// An axis always says the same.
#[test]
fn a_frozen_axis_is_refused() {
    for axis in 0..3 {
        let tally = suffer(|recorded, _| {
            let stuck = recorded.left[0].field.ut[axis];
            each(recorded, |sample| sample.field.ut[axis] = stuck);
        });
        assert_eq!(tally.refused, 60, "axis {axis}: {tally:?}");
    }
}

/// What is called left is right: somebody's sign of roll.
#[test]
fn swapped_turns_are_refused() {
    let tally = suffer(|recorded, _| {
        core::mem::swap(&mut recorded.left, &mut recorded.right);
        each(recorded, |sample| sample.attitude.roll_rad = -sample.attitude.roll_rad);
    });
    assert_eq!(tally.refused, 60, "{tally:?}");
}

/// Standing still, leaning to one side and then to the other.
#[test]
fn standing_still_is_refused() {
    let tally = suffer(|recorded, random| {
        for side in [&mut recorded.left, &mut recorded.right] {
            let first = side[0];
            for sample in side.iter_mut() {
                let noise = vector(random, 0.2);
                *sample = Sample { time: sample.time, ..first };
                sample.field.ut += noise;
            }
        }
    });
    assert_eq!(tally.refused, 60, "{tally:?}");
}
