//! Faulty samples: a correct solution or a rejection, never a wrong solution with a small expected error.

use super::synthetic::{Airframe, Flight, Random, RecordedTurns, random_vector};
use crate::calibration::Sample;
use crate::calibration::tests::solve_turns;

/// Limit of the expected error, degrees.
const MAX_EXPECTED_RMS_DEG: f32 = 3.0;

/// Flies 60 airframes with a fault; asserts that accepted solutions are within three times the expected error. Returns
/// the number of accepted ones.
fn accepted_with_fault(fault: impl Fn(&mut RecordedTurns, &mut Random)) -> u32 {
    let mut accepted = 0;
    for seed in 0..60 {
        let (mut random, airframe) = Airframe::seeded(4000 + seed, 0.2, 1.5, 10.0, [-70.0, 70.0]);
        let mut recorded = Flight::TYPICAL.fly(&airframe, &mut random);
        fault(&mut recorded, &mut random);
        if let Ok(solution) = solve_turns(&recorded)
            && solution.quality.expected_rms_deg <= MAX_EXPECTED_RMS_DEG
        {
            airframe.assert_expected_error_is_honest(&solution, seed);
            accepted += 1;
        }
    }
    accepted
}

/// Attitude errors of 10 deg for 3 s, four times per side.
#[test]
fn gusts_cause_no_wrong_calibration() {
    let accepted = accepted_with_fault(|recorded, random| {
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
    assert!(accepted >= 55, "{accepted}");
}

/// Power lines add up to 15 uT for 5 s, once per side.
#[test]
fn a_power_line_causes_no_wrong_calibration() {
    let accepted = accepted_with_fault(|recorded, random| {
        for side in [&mut recorded.left, &mut recorded.right] {
            let disturbance = random_vector(random, 1.0).normalize() * 15.0;
            for (i, sample) in side.iter_mut().skip(60).take(10).enumerate() {
                sample.field.ut += disturbance * (core::f32::consts::PI * i as f32 / 10.0).sin();
            }
        }
    });
    assert!(accepted >= 55, "{accepted}");
}

/// The motor current adds steps of 0.5 uT every 20 s.
#[test]
fn motor_current_steps_cause_no_wrong_calibration() {
    let accepted = accepted_with_fault(|recorded, random| {
        let step = random_vector(random, 1.0).normalize() * 0.5;
        for (i, sample) in recorded.samples_mut().enumerate() {
            if (i + 1) / 40 % 2 == 1 {
                sample.field.ut += step;
            }
        }
    });
    assert!(accepted >= 50, "{accepted}");
}

#[test]
fn standing_still_is_rejected() {
    let accepted = accepted_with_fault(|recorded, random| {
        for side in [&mut recorded.left, &mut recorded.right] {
            let first = side[0];
            for sample in side.iter_mut() {
                let noise = random_vector(random, 0.2);
                *sample = Sample { time: sample.time, ..first };
                sample.field.ut += noise;
            }
        }
    });
    assert_eq!(accepted, 0);
}
