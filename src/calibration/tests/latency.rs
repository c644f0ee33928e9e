//! How old the attitude is: found, used where that is worth it, and what it means for everything else.

use core::f32::consts::TAU;

use super::solved;
use super::synthetic::{Airframe, Flight, Random, Recorded, mean, rms};
use crate::calibration::{Latency, Rates, Sample};
use crate::frames::{Attitude, wrap_pi};

/// Bank and pitch as an aircraft in light weather flies them, radians, with their rates: sines of 2 to 6 s.
struct Wander([[f32; 3]; 4]);

impl Wander {
    fn new(random: &mut Random, amplitude_deg: f32) -> Self {
        Self([(); 4].map(|()| {
            let period_s = random.uniform(2.0, 6.0);
            [random.uniform(0.3, 1.0) * amplitude_deg.to_radians() / 2.0, TAU / period_s, random.uniform(0.0, TAU)]
        }))
    }

    fn at(&self, t_s: f32) -> [f32; 2] {
        self.0.iter().fold([0.0; 2], |[angle, rate], [amplitude, omega, phase]| {
            let (sin, cos) = (omega * t_s + phase).sin_cos();
            [angle + amplitude * sin, rate + amplitude * omega * cos]
        })
    }
}

/// Two turns in which the attitude source is late by so much.
fn fly(airframe: &Airframe, wander_deg: f32, late_s: f32, random: &mut Random) -> Recorded {
    let mut recorded = Flight { attitude_noise_deg: 0.3, ..Flight::REAL }.fly(airframe, random);
    for (side, bank_deg) in [(&mut recorded.left, -25.0_f32), (&mut recorded.right, 25.0)] {
        let [roll, pitch] = [(); 2].map(|()| Wander::new(random, wander_deg));
        let attitude = |t_s: f32| {
            let ([roll_rad, roll_rad_s], [pitch_rad, pitch_rad_s]) = (roll.at(t_s), pitch.at(t_s));
            let attitude =
                Attitude { roll_rad: roll_rad + bank_deg.to_radians(), pitch_rad: pitch_rad + 2_f32.to_radians() };
            (attitude, Rates::from_rad_s(roll_rad_s, pitch_rad_s))
        };
        let mut noise = [0.0_f32; 2];
        for (i, sample) in side.iter_mut().enumerate() {
            let t_s = i as f32 * 0.4;
            let heading_rad = wrap_pi(bank_deg.signum() * 13_f32.to_radians() * t_s);
            noise = noise.map(|n| 0.45 * n + 0.893 * 0.3_f32.to_radians() * random.normal());
            let (said, rates) = attitude(t_s - late_s);
            let measured = super::synthetic::sample(airframe, attitude(t_s).0, heading_rad, 0.12, random);
            *sample = Sample {
                attitude: Attitude { roll_rad: said.roll_rad + noise[0], pitch_rad: said.pitch_rad + noise[1] },
                rates,
                ..Sample { time: sample.time, ..measured }
            };
        }
    }
    recorded
}

#[test]
fn probe() {
    for wander_deg in [1.0, 3.0] {
        for late_s in [0.0, 0.02, 0.1] {
            let (mut found, mut sigmas, mut z, mut used, mut ratio) =
                (Vec::new(), Vec::new(), Vec::new(), 0, Vec::new());
            for seed in 0..60 {
                let mut random = Random(9000 + seed);
                let airframe = Airframe::random(&mut random, 0.1, 1.0, 5.0, [-65.0, 65.0]);
                let recorded = fly(&airframe, wander_deg, late_s, &mut random);
                let solution = solved(&recorded).unwrap();
                let Latency { found_s, sigma_s } = solution.quality.latency.unwrap();
                found.push(found_s * 1e3);
                sigmas.push(sigma_s * 1e3);
                z.push((found_s - late_s) / sigma_s);
                used += i32::from(solution.calibration.uses_latency());
                ratio.push(rms(&airframe.errors_deg(&solution.calibration)) / solution.quality.expected_rms_deg);
            }
            println!(
                "wander {wander_deg} late {late_s}: found {:.1} sigma {:.1} z mean {:.2} rms {:.2} used {used} ratio rms {:.2}",
                mean(&found),
                mean(&sigmas),
                mean(&z),
                rms(&z),
                rms(&ratio)
            );
        }
    }
}
