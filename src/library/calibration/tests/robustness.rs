//! Faulty samples: a correct solution or a rejection, never a wrong solution with a small expected error.

use super::synthetic::{Airframe, Flight, Random, RecordedTurns, random_vector, rms};
use crate::calibration::tests::solve_turns;
use crate::calibration::{Sample, SolveError};

#[derive(Debug, Default)]
struct FaultOutcomes {
    accepted: u32,
    rejected: u32,
    reasons: Vec<SolveError>,
}

/// Limit of the expected error, degrees.
const MAX_EXPECTED_RMS_DEG: f32 = 3.0;

/// Flies 60 airframes with a fault; asserts that accepted solutions are within three times the expected error.
fn fly_with_fault(fault: impl Fn(&mut RecordedTurns, &mut Random)) -> FaultOutcomes {
    let mut tally = FaultOutcomes::default();
    for seed in 0..60 {
        let mut random = Random(4000 + seed);
        let airframe = Airframe::random(&mut random, 0.2, 1.5, 10.0, [-70.0, 70.0]);
        let mut recorded = Flight::TYPICAL.fly(&airframe, &mut random);
        fault(&mut recorded, &mut random);
        match solve_turns(&recorded) {
            Ok(solution) if solution.quality.expected_rms_deg <= MAX_EXPECTED_RMS_DEG => {
                let error = rms(&airframe.errors_deg(&solution.calibration));
                let expected = solution.quality.expected_rms_deg;
                assert!(error <= 3.0 * expected, "seed {seed}: {error} deg, expected {expected}");
                tally.accepted += 1;
            }
            Ok(_) => tally.rejected += 1,
            Err(error) => {
                tally.rejected += 1;
                tally.reasons.push(error);
            }
        }
    }
    tally
}

fn for_each_sample(recorded: &mut RecordedTurns, change: impl FnMut(&mut Sample)) {
    recorded.left.iter_mut().chain(&mut recorded.right).for_each(change);
}

/// Attitude errors of 10 deg for 3 s, four times per side.
#[test]
fn gusts_cause_no_wrong_calibration() {
    let tally = fly_with_fault(|recorded, random| {
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
    assert!(tally.accepted >= 55, "{tally:?}");
}

/// Power lines add up to 15 uT for 5 s, once per side.
#[test]
fn a_power_line_causes_no_wrong_calibration() {
    let tally = fly_with_fault(|recorded, random| {
        for side in [&mut recorded.left, &mut recorded.right] {
            let disturbance = random_vector(random, 1.0).normalize() * 15.0;
            for (i, sample) in side.iter_mut().skip(60).take(10).enumerate() {
                sample.field.ut += disturbance * (core::f32::consts::PI * i as f32 / 10.0).sin();
            }
        }
    });
    assert!(tally.accepted >= 55, "{tally:?}");
}

/// The motor current adds steps of 0.5 uT every 20 s.
#[test]
fn motor_current_steps_cause_no_wrong_calibration() {
    let tally = fly_with_fault(|recorded, random| {
        let step = random_vector(random, 1.0).normalize() * 0.5;
        let mut seconds = 0.0;
        for_each_sample(recorded, |sample| {
            seconds += 0.5;
            if (seconds / 20.0) as u32 % 2 == 1 {
                sample.field.ut += step;
            }
        });
    });
    assert!(tally.accepted >= 50, "{tally:?}");
}

/// An axis clipped at 75 % of its range.
#[test]
fn a_saturated_axis_is_rejected() {
    let tally = fly_with_fault(|recorded, _| {
        let all = recorded.left.iter().chain(&recorded.right);
        let top = all.map(|s| s.field.ut.x).fold(f32::MIN, f32::max);
        let bottom = recorded.left.iter().chain(&recorded.right).map(|s| s.field.ut.x).fold(f32::MAX, f32::min);
        let limit = bottom + 0.75 * (top - bottom);
        for_each_sample(recorded, |sample| sample.field.ut.x = sample.field.ut.x.min(limit));
    });
    assert_eq!(tally.rejected, 60, "{tally:?}");
    assert!(tally.reasons.iter().any(|error| matches!(error, SolveError::AxisStuck { .. })), "{tally:?}");
}

#[test]
fn a_frozen_axis_is_rejected() {
    for axis in 0..3 {
        let tally = fly_with_fault(|recorded, _| {
            let stuck = recorded.left[0].field.ut[axis];
            for_each_sample(recorded, |sample| sample.field.ut[axis] = stuck);
        });
        assert_eq!(tally.rejected, 60, "axis {axis}: {tally:?}");
    }
}

#[test]
fn swapped_turns_are_rejected() {
    let tally = fly_with_fault(|recorded, _| {
        core::mem::swap(&mut recorded.left, &mut recorded.right);
        for_each_sample(recorded, |sample| sample.attitude.roll_rad = -sample.attitude.roll_rad);
    });
    assert_eq!(tally.rejected, 60, "{tally:?}");
}

#[test]
fn standing_still_is_rejected() {
    let tally = fly_with_fault(|recorded, random| {
        for side in [&mut recorded.left, &mut recorded.right] {
            let first = side[0];
            for sample in side.iter_mut() {
                let noise = random_vector(random, 0.2);
                *sample = Sample { time: sample.time, ..first };
                sample.field.ut += noise;
            }
        }
    });
    assert_eq!(tally.rejected, 60, "{tally:?}");
}
