//! Attitude latency: estimation, use, and effect on the expected error.

use core::f32::consts::TAU;

use nalgebra::{Matrix3, SVector};

use super::synthetic::{Airframe, Flight, Random, RecordedTurns, mean, rms};
use crate::calibration::fit::linearised_problem::LinearisedProblem;
use crate::calibration::hypotheses::attitude_error::AttitudeState;
use crate::calibration::hypotheses::attitude_error_table::{ATTITUDE_ERRORS, LATENCY_INDEX};
use crate::calibration::model::{Likelihood, ModelConfig, ModelParameters, NoiseModel, for_each_prior};
use crate::calibration::tests::{NO_PRIOR, solve_turns};
use crate::calibration::uncertainty::information::Information;
use crate::calibration::verification;
use crate::calibration::{AttitudeLatency, Calibration, LeastSquares, Rates, Sample};
use crate::frames::{Attitude, wrap_pi};

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
                Attitude { roll_rad: roll_rad + bank_deg.to_radians(), pitch_rad: pitch_rad + 2_f32.to_radians() };
            (attitude, Rates::from_rad_s([roll_rad_s, pitch_rad_s, 0.0]))
        };
        let mut noise = [0.0_f32; 2];
        for (i, sample) in side.iter_mut().enumerate() {
            let t_s = i as f32 * 0.4;
            let heading_rad = wrap_pi(bank_deg.signum() * 13_f32.to_radians() * t_s);
            noise = noise.map(|n| 0.45 * n + 0.893 * 0.3_f32.to_radians() * random.normal());
            let (reported, rates) = attitude(t_s - late_s);
            let measured = crate::calibration::tests::synthetic::measured_sample(
                airframe,
                attitude(t_s).0,
                heading_rad,
                0.12,
                random,
            );
            *sample = Sample {
                attitude: Attitude { roll_rad: reported.roll_rad + noise[0], pitch_rad: reported.pitch_rad + noise[1] },
                rates,
                ..Sample { time: sample.time, ..measured }
            };
        }
    }
    recorded
}

struct FlightResults {
    found_ms: Vec<f32>,
    sigma_ms: Vec<f32>,
    normalised_errors: Vec<f32>,
    applied_flight_count: usize,
    error_ratios: Vec<f32>,
}

fn latency_results(wander_deg: f32, late_s: f32) -> FlightResults {
    let mut shown = FlightResults {
        found_ms: Vec::new(),
        sigma_ms: Vec::new(),
        normalised_errors: Vec::new(),
        applied_flight_count: 0,
        error_ratios: Vec::new(),
    };
    for seed in 0..60 {
        let mut random = Random(9000 + seed);
        let airframe = Airframe::random(&mut random, 0.1, 1.0, 5.0, [-65.0, 65.0]);
        let solution = solve_turns(&fly_with_latency(&airframe, wander_deg, late_s, &mut random)).unwrap();
        let AttitudeLatency { estimate_s: found_s, sigma_s } = solution.quality.latency.unwrap();
        shown.found_ms.push(found_s * 1e3);
        shown.sigma_ms.push(sigma_s * 1e3);
        shown.normalised_errors.push((found_s - late_s) / sigma_s);
        shown.applied_flight_count += usize::from(solution.calibration.uses_latency());
        shown.error_ratios.push(rms(&airframe.errors_deg(&solution.calibration)) / solution.quality.expected_rms_deg);
    }
    shown
}

/// Latencies of 0, 20 and 100 ms are estimated as 1, 20 and 99 ms with sigma 10 ms, in spite of correlated attitude
/// errors. Sixty flights scatter the mean by 0.13 sigma and the RMS by 10 %. Only significant estimates are used.
#[test]
fn latency_is_estimated_with_an_honest_sigma() {
    for (late_s, applied_count) in [(0.0, 0..=1), (0.02, 0..=20), (0.1, 60..=60)] {
        let shown = latency_results(3.0, late_s);
        let found_ms = mean(&shown.found_ms);
        assert!((found_ms - late_s * 1e3).abs() < 5.0, "{late_s}: {found_ms}");
        assert!((8.0..12.0).contains(&mean(&shown.sigma_ms)), "{late_s}: {:?}", shown.sigma_ms);
        assert!((0.75..1.25).contains(&rms(&shown.normalised_errors)), "{late_s}: {}", rms(&shown.normalised_errors));
        assert!(applied_count.contains(&shown.applied_flight_count), "{late_s}: {}", shown.applied_flight_count);
        assert!((0.4..1.1).contains(&rms(&shown.error_ratios)), "{late_s}: {}", rms(&shown.error_ratios));
    }
}

#[test]
fn an_uncertain_latency_is_not_used() {
    let shown = latency_results(1.0, 0.1);
    assert_eq!(shown.applied_flight_count, 0);
    assert!((20.0..40.0).contains(&mean(&shown.sigma_ms)), "{:?}", shown.sigma_ms);
    assert!((0.75..1.25).contains(&rms(&shown.normalised_errors)), "{}", rms(&shown.normalised_errors));
}

fn flight_with_latency(seed: u64, late_s: f32) -> (Airframe, RecordedTurns) {
    let mut random = Random(seed);
    let airframe = Airframe::random(&mut random, 0.1, 1.0, 5.0, [50.0, 60.0]);
    let recorded = fly_with_latency(&airframe, 3.0, late_s, &mut random);
    (airframe, recorded)
}

fn without_rates(recorded: &RecordedTurns) -> RecordedTurns {
    let strip = |samples: &[Sample]| samples.iter().map(|s| Sample { rates: Rates::UNKNOWN, ..*s }).collect();
    RecordedTurns { left: strip(&recorded.left), right: strip(&recorded.right) }
}

/// Without body rates the latency is unobservable. With them, inclination residuals decrease by a fifth at 100 ms and 3
/// deg/s.
#[test]
fn without_rates_there_is_no_estimate() {
    let (_, recorded) = flight_with_latency(1, 0.1);
    let (with, without) = (solve_turns(&recorded).unwrap(), solve_turns(&without_rates(&recorded)).unwrap());
    assert_eq!((without.quality.latency, without.calibration.latency_s), (None, 0.0));
    assert!(
        with.quality.inclination_residual_deg < 0.85 * without.quality.inclination_residual_deg,
        "{with:?} {without:?}"
    );
}

#[test]
fn verification_applies_each_calibration_s_latency() {
    let (_, recorded) = flight_with_latency(2, -0.1);
    let calibration = solve_turns(&recorded).unwrap().calibration;
    assert!((calibration.latency_s + 0.1).abs() < 0.03, "{}", calibration.latency_s);
    let without_latency = Calibration { latency_s: 0.0, ..calibration };
    let scores = verification::score_held_back(recorded.turns(), true, &calibration, &without_latency);
    assert!(scores.candidate_score < 0.9 * scores.active_score, "{scores:?}");
    let scores = verification::score_held_back(recorded.turns(), true, &without_latency, &calibration);
    assert!(scores.active_score < 0.9 * scores.candidate_score, "{scores:?}");
}

#[test]
fn elimination_equals_a_joint_solution_of_fourteen_unknowns() {
    let (airframe, recorded) = flight_with_latency(3, 0.03);
    let samples = recorded.turns();
    let mut likelihood = Likelihood::new(&NO_PRIOR, ModelConfig::DEFAULT, samples, airframe.total_ut);
    likelihood.noise = NoiseModel::new(0.003, 0.006, Matrix3::identity());
    (likelihood.sample_stride, likelihood.uses_normal_equations) = (1, false);
    for used_s in [0.0, 0.02] {
        likelihood.latency_s = used_s;
        let start = airframe.exact_start();
        let unknowns = likelihood.unknowns_from_start(&start).unwrap();
        let parameters = ModelParameters::from_unknowns(&unknowns);
        let mut joint = LeastSquares::<14, 1>::new();
        for_each_prior(&likelihood, &parameters, &mut |prior| {
            joint.add_weighted_row(&prior.jacobian_row.push(0.0), [-prior.residual], 1.0 / (prior.sigma * prior.sigma));
        });
        joint.add_weighted_row(&SVector::<f32, 14>::ith(13, 1.0), [-used_s], 100.0);
        for sample in samples.iter() {
            let equations = likelihood.sample_equations(sample, None, &parameters);
            let norm = &equations.norm_equation;
            joint.add_weighted_row(&norm.jacobian_row.as_vector().push(0.0), [-norm.residual], norm.weight);
            let attitude = sample.latency_compensated_attitude(used_s);
            let by_latency = ATTITUDE_ERRORS[LATENCY_INDEX]
                .inclination_derivative(&equations, &AttitudeState::steady_turn(attitude, sample.rates));
            let inclination_equation = equations.inclination_equation.unwrap();
            joint.add_weighted_row(
                &inclination_equation.jacobian_row.as_vector().push(by_latency),
                [-inclination_equation.residual],
                inclination_equation.weight,
            );
        }
        let expected = joint.solve().unwrap();
        let mut information = Information::new(&LinearisedProblem::linearise(&likelihood, samples, &unknowns));
        information.accumulate_samples(&likelihood, samples, &unknowns, None);
        let (latency, follows) = information.estimate_latency(used_s).unwrap();
        let step_s = latency.estimate_s - used_s;
        assert!((step_s - expected[13]).abs() < 2e-4, "{step_s} {}", expected[13]);
        let change = information.linear_system.step_to_maximum().unwrap() + follows * step_s;
        let others = expected.fixed_rows::<13>(0).into_owned();
        assert!((change - others).norm() < 0.01 * others.norm(), "{change} {others}");
    }
}
