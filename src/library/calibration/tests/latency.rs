//! Attitude latency: estimation, use, and effect on the expected error.

use core::f32::consts::TAU;

use super::synthetic::{Airframe, Flight, Random, RecordedTurns, mean, measured_sample, rms};
use crate::calibration::tests::solve_turns;
use crate::calibration::{AngleRates, AttitudeLatency, Calibration, Sample, verification};
use crate::frames::{RollPitch, wrap_pi};

/// Bank or pitch wander in light weather: sines of 2 to 6 s, radians.
struct AttitudeWander([[f32; 3]; 4]);

impl AttitudeWander {
    fn new(random: &mut Random, amplitude_deg: f32) -> Self {
        Self([(); 4].map(|()| {
            let period_s = random.uniform(2.0, 6.0);
            [random.uniform(0.3, 1.0) * amplitude_deg.to_radians() / 2.0, TAU / period_s, random.uniform(0.0, TAU)]
        }))
    }

    fn angle_and_rate(&self, t_s: f32) -> [f32; 2] {
        self.0.iter().fold([0.0; 2], |[angle, rate], [amplitude, omega, phase]| {
            let (sin, cos) = (omega * t_s + phase).sin_cos();
            [angle + amplitude * sin, rate + amplitude * omega * cos]
        })
    }
}

fn fly_with_latency(airframe: &Airframe, wander_deg: f32, late_s: f32, random: &mut Random) -> RecordedTurns {
    let mut recorded = Flight { attitude_noise_deg: 0.3, ..Flight::TYPICAL }.fly(airframe, random);
    for (side, bank_deg) in [(&mut recorded.left, -25.0_f32), (&mut recorded.right, 25.0)] {
        let [roll, pitch] = [(); 2].map(|()| AttitudeWander::new(random, wander_deg));
        let attitude = |t_s: f32| {
            let ([roll_rad, roll_rad_s], [pitch_rad, pitch_rad_s]) =
                (roll.angle_and_rate(t_s), pitch.angle_and_rate(t_s));
            let attitude =
                RollPitch { roll_rad: roll_rad + bank_deg.to_radians(), pitch_rad: pitch_rad + 2_f32.to_radians() };
            (attitude, AngleRates::from_rad_s([roll_rad_s, pitch_rad_s, 0.0]))
        };
        let mut noise = [0.0_f32; 2];
        for (i, sample) in side.iter_mut().enumerate() {
            let t_s = i as f32 * 0.4;
            let heading_rad = wrap_pi(bank_deg.signum() * 13_f32.to_radians() * t_s);
            noise = noise.map(|n| 0.45 * n + 0.893 * 0.3_f32.to_radians() * random.normal());
            let (reported, rates) = attitude(t_s - late_s);
            let measured = measured_sample(airframe, attitude(t_s).0, heading_rad, 0.12, random);
            *sample = Sample {
                attitude: RollPitch {
                    roll_rad: reported.roll_rad + noise[0],
                    pitch_rad: reported.pitch_rad + noise[1],
                },
                rates,
                ..Sample { time: sample.time, ..measured }
            };
        }
    }
    recorded
}

/// Latencies of 0, 20 and 100 ms are estimated as 1, 20 and 99 ms with sigma 10 ms, in spite of correlated attitude
/// errors. Sixty flights scatter the mean by 0.13 sigma and the RMS by 10 %. Only significant and certain estimates are
/// used: in smooth air sigma is 30 ms.
#[test]
fn latency_is_estimated_with_an_honest_sigma() {
    for (wander_deg, late_s, sigma_ms, applied_count) in [
        (3.0, 0.0, 8.0..12.0, 0..=1),
        (3.0, 0.02, 8.0..12.0, 0..=20),
        (3.0, 0.1, 8.0..12.0, 60..=60),
        (1.0, 0.1, 20.0..40.0, 0..=0),
    ] {
        let [mut found_ms, mut sigmas_ms, mut normalised_errors, mut ratios] = [const { Vec::new() }; 4];
        let mut applied = 0;
        for seed in 0..60 {
            let (mut random, airframe) = Airframe::seeded(9000 + seed, 0.1, 1.0, 5.0, [-65.0, 65.0]);
            let solution = solve_turns(&fly_with_latency(&airframe, wander_deg, late_s, &mut random)).unwrap();
            let AttitudeLatency { estimate_s, sigma_s } = solution.quality.latency.unwrap();
            found_ms.push(estimate_s * 1e3);
            sigmas_ms.push(sigma_s * 1e3);
            normalised_errors.push((estimate_s - late_s) / sigma_s);
            applied += usize::from(solution.calibration.uses_latency());
            ratios.push(airframe.error_ratio(&solution));
        }
        let label = format!("{late_s} s, {wander_deg} deg");
        assert!(sigma_ms.contains(&mean(&sigmas_ms)), "{label}: {sigmas_ms:?}");
        assert!((0.75..1.25).contains(&rms(&normalised_errors)), "{label}: {}", rms(&normalised_errors));
        assert!(applied_count.contains(&applied), "{label}: {applied}");
        if wander_deg > 1.0 {
            assert!((mean(&found_ms) - late_s * 1e3).abs() < 5.0, "{label}: {found_ms:?}");
            assert!((0.4..1.1).contains(&rms(&ratios)), "{label}: {}", rms(&ratios));
        }
    }
}

fn flight_with_latency(seed: u64, late_s: f32) -> RecordedTurns {
    let (mut random, airframe) = Airframe::seeded(seed, 0.1, 1.0, 5.0, [50.0, 60.0]);
    fly_with_latency(&airframe, 3.0, late_s, &mut random)
}

/// Without body rates the latency is unobservable. With them, inclination residuals decrease by a fifth at 100 ms and 3
/// deg/s.
#[test]
fn without_rates_there_is_no_estimate() {
    let recorded = flight_with_latency(1, 0.1);
    let without_rates = recorded.map_samples(|sample| Sample { rates: AngleRates::UNKNOWN, ..*sample });
    let (with, without) = (solve_turns(&recorded).unwrap(), solve_turns(&without_rates).unwrap());
    assert_eq!((without.quality.latency, without.calibration.latency_s), (None, 0.0));
    assert!(
        with.quality.inclination_residual_deg < 0.85 * without.quality.inclination_residual_deg,
        "{with:?} {without:?}"
    );
}

#[test]
fn verification_applies_each_calibration_s_latency() {
    let recorded = flight_with_latency(2, -0.1);
    let calibration = solve_turns(&recorded).unwrap().calibration;
    assert!((calibration.latency_s + 0.1).abs() < 0.03, "{}", calibration.latency_s);
    let without_latency = Calibration { latency_s: 0.0, ..calibration };
    let scores = verification::score_held_back(recorded.turns(), true, &calibration, &without_latency);
    assert!(scores.candidate_score < 0.9 * scores.active_score, "{scores:?}");
}
