//! How old the attitude is: found, used where that is worth it, and what it means for everything else.

use core::f32::consts::TAU;

use nalgebra::{Matrix3, SVector};

use super::synthetic::{Airframe, Flight, Random, Recorded, mean, rms};
use super::{NO_PRIOR, solved};
use crate::calibration::information::Information;
use crate::calibration::likelihood::{Config, Likelihood, Noise, Parameters, for_each_prior};
use crate::calibration::{Calibration, Latency, LeastSquares, Rates, Sample, verification};
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
            (attitude, Rates::from_rad_s([roll_rad_s, pitch_rad_s, 0.0]))
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

/// What sixty flights show of a source that is late by so much.
struct Shown {
    found_ms: Vec<f32>,
    sigma_ms: Vec<f32>,
    /// Errors over their sigma.
    errors: Vec<f32>,
    used: usize,
    /// RMS heading error over the expected one.
    ratios: Vec<f32>,
}

fn flown(wander_deg: f32, late_s: f32) -> Shown {
    let mut shown =
        Shown { found_ms: Vec::new(), sigma_ms: Vec::new(), errors: Vec::new(), used: 0, ratios: Vec::new() };
    for seed in 0..60 {
        let mut random = Random(9000 + seed);
        let airframe = Airframe::random(&mut random, 0.1, 1.0, 5.0, [-65.0, 65.0]);
        let solution = solved(&fly(&airframe, wander_deg, late_s, &mut random)).unwrap();
        let Latency { found_s, sigma_s } = solution.quality.latency.unwrap();
        shown.found_ms.push(found_s * 1e3);
        shown.sigma_ms.push(sigma_s * 1e3);
        shown.errors.push((found_s - late_s) / sigma_s);
        shown.used += usize::from(solution.calibration.uses_latency());
        shown.ratios.push(rms(&airframe.errors_deg(&solution.calibration)) / solution.quality.expected_rms_deg);
    }
    shown
}

/// 0, 20 and 100 ms are found as 1, 20 and 99 with a sigma of 10, which is true although attitude errors last for half a
/// second: of sixty, the mean scatters by 0.13 sigma and the RMS by a tenth. What is not certain is not used, what is
/// certain always, and the expected heading error holds either way.
#[test]
fn a_latency_is_found_with_its_sigma() {
    for (late_s, used) in [(0.0, 0..=1), (0.02, 0..=20), (0.1, 60..=60)] {
        let shown = flown(3.0, late_s);
        let found_ms = mean(&shown.found_ms);
        assert!((found_ms - late_s * 1e3).abs() < 5.0, "{late_s}: {found_ms}");
        assert!((8.0..12.0).contains(&mean(&shown.sigma_ms)), "{late_s}: {:?}", shown.sigma_ms);
        assert!((0.75..1.25).contains(&rms(&shown.errors)), "{late_s}: {}", rms(&shown.errors));
        assert!(used.contains(&shown.used), "{late_s}: {}", shown.used);
        assert!((0.4..1.1).contains(&rms(&shown.ratios)), "{late_s}: {}", rms(&shown.ratios));
    }
}

/// Bank that hardly wanders shows a latency to 30 ms: known, and not used, however large.
#[test]
fn a_latency_that_hardly_shows_is_not_used() {
    let shown = flown(1.0, 0.1);
    assert_eq!(shown.used, 0);
    assert!((20.0..40.0).contains(&mean(&shown.sigma_ms)), "{:?}", shown.sigma_ms);
    assert!((0.75..1.25).contains(&rms(&shown.errors)), "{}", rms(&shown.errors));
}

fn late(seed: u64, late_s: f32) -> (Airframe, Recorded) {
    let mut random = Random(seed);
    let airframe = Airframe::random(&mut random, 0.1, 1.0, 5.0, [50.0, 60.0]);
    let recorded = fly(&airframe, 3.0, late_s, &mut random);
    (airframe, recorded)
}

fn without_rates(recorded: &Recorded) -> Recorded {
    let strip = |samples: &[Sample]| samples.iter().map(|s| Sample { rates: Rates::NONE, ..*s }).collect();
    Recorded { left: strip(&recorded.left), right: strip(&recorded.right) }
}

/// Where the source gives no rates, all is as it was without: nothing is known of a latency. With them the dips scatter
/// less by what was late, 100 ms of bank that moves by 3 deg/s: a fifth of it.
#[test]
fn without_rates_nothing_is_known_of_it() {
    let (_, recorded) = late(1, 0.1);
    let (with, without) = (solved(&recorded).unwrap(), solved(&without_rates(&recorded)).unwrap());
    assert_eq!((without.quality.latency, without.calibration.latency_s), (None, 0.0));
    assert!(with.quality.dip_residual_deg < 0.85 * without.quality.dip_residual_deg, "{with:?} {without:?}");
}

/// Who verifies looks at samples as the calibration does: with its latency they agree better than without.
#[test]
fn held_back_samples_are_seen_with_each_calibration_s_latency() {
    let (_, recorded) = late(2, -0.1);
    let calibration = solved(&recorded).unwrap().calibration;
    assert!((calibration.latency_s + 0.1).abs() < 0.03, "{}", calibration.latency_s);
    let unused = Calibration { latency_s: 0.0, ..calibration };
    let scores = verification::verify(recorded.turns(), true, &calibration, &unused);
    assert!(scores.candidate < 0.9 * scores.incumbent, "{scores:?}");
    let scores = verification::verify(recorded.turns(), true, &unused, &calibration);
    assert!(scores.incumbent < 0.9 * scores.candidate, "{scores:?}");
}

/// Eliminated, it is what least squares of all fourteen unknowns at once make of it, prior included; and the others
/// follow as they do there.
#[test]
fn it_is_what_fourteen_unknowns_would_make_of_it() {
    let (airframe, recorded) = late(3, 0.03);
    let samples = recorded.turns();
    let mut likelihood = Likelihood::new(&NO_PRIOR, Config::DEFAULT, samples, airframe.total_ut);
    likelihood.noise = Noise::new(0.003, 0.006, Matrix3::identity());
    (likelihood.stride, likelihood.sums_up) = (1, false);
    for used_s in [0.0, 0.02] {
        likelihood.latency_s = used_s;
        let start = airframe.exact_start();
        let unknowns = likelihood.unknowns(&start).unwrap();
        let parameters = Parameters::new(&unknowns);
        let mut joint = LeastSquares::<14, 1>::new();
        for_each_prior(&likelihood, &parameters, &mut |prior| {
            joint.add(&prior.row.push(0.0), [-prior.residual], 1.0 / (prior.sigma * prior.sigma));
        });
        joint.add(&SVector::<f32, 14>::ith(13, 1.0), [-used_s], 100.0);
        for sample in samples.iter() {
            let equations = likelihood.equations(sample, None, &parameters);
            let norm = &equations.norm;
            joint.add(&norm.row.dense().push(0.0), [-norm.residual], norm.weight);
            let dip = equations.dip.unwrap();
            joint.add(&dip.row.dense().push(equations.attitude_effects[3]), [-dip.residual], dip.weight);
        }
        let expected = joint.solve().unwrap();
        let mut information = Information::new(&likelihood.linearise(samples, &unknowns));
        information.look(&likelihood, samples, &unknowns, None);
        let (latency, follows) = information.latency(used_s).unwrap();
        let step_s = latency.found_s - used_s;
        assert!((step_s - expected[13]).abs() < 2e-4, "{step_s} {}", expected[13]);
        let change = information.system.change().unwrap() + follows * step_s;
        let others = expected.fixed_rows::<13>(0).into_owned();
        assert!((change - others).norm() < 0.01 * others.norm(), "{change} {others}");
    }
}
