//! Unit tests of `levenberg_marquardt`.

use nalgebra::{Matrix3, Vector3};

use super::*;
use crate::calibration::closed_form::starting_point;
use crate::calibration::model::{ModelConfig, ModelParameters};
use crate::calibration::tests::synthetic::{Airframe, Flight, Random, RecordedTurns, random_vector, turn_samples};
use crate::calibration::{Prior, Sample};
use crate::frames::{Field, RollPitch};

/// One sample without attitude at the maximum likelihood, except for an inclination that is off by three sigmas: the
/// cost is 4.5, and a step promises all of it.
fn sample_and_refinement() -> (Samples<'static>, Refinement) {
    let samples = turn_samples(&[Sample::new(Field::from_ut(50.0, 0.0, 0.0), RollPitch::default())], &[]);
    let prior = Prior { inclination_rad: Some(0.0), ..Prior::default() };
    let likelihood = Likelihood::new(&prior, ModelConfig::WITHOUT_ATTITUDE, samples, 50.0);
    let inclination_rad = 3.0 * likelihood.config.known_inclination_sigma_rad;
    let parameters =
        ModelParameters { w: Matrix3::identity(), corrected_mean_field: Vector3::new(1.0, 0.0, 0.0), inclination_rad };
    (samples, Refinement::new(likelihood, samples, parameters.unknowns().unwrap(), true))
}

/// Damping increases with each rejected step, faster than the last time, and decreases after a step that gains what it
/// promised. With an estimated noise, corrected measurements make the cost inexact by half a squared sigma.
#[test]
fn only_steps_that_lower_the_cost_are_accepted() {
    for (has_noise_estimate, gain, is_accepted) in [
        (false, 4.5, true),
        (false, 0.1, true),
        (false, -0.1, false),
        (true, 4.5, true),
        (true, -0.5, true),
        (true, -1.5, false),
    ] {
        let (samples, mut refinement) = sample_and_refinement();
        refinement.likelihood.has_noise_estimate = has_noise_estimate;
        refinement.linear_system.cost += gain - 4.5;
        let (before, Damping { value, growth }) = (refinement.unknowns, refinement.damping);
        assert_eq!(refinement.levenberg_marquardt_step(samples), RefinementProgress::Continue);
        assert_eq!(refinement.unknowns != before, is_accepted, "{has_noise_estimate} {gain}");
        assert_eq!(refinement.damping.growth > growth, !is_accepted, "{has_noise_estimate} {gain}");
        assert_eq!(refinement.damping.value < value, gain > 4.0, "{has_noise_estimate} {gain}");
    }
}

/// A field that no calibration explains. The bound is what the device's time for a solve is derived from.
#[test]
fn a_refinement_ends_whatever_the_samples_are() {
    for seed in 0..20 {
        let (_, mut recorded) = flight(seed);
        let mut random = Random(seed);
        recorded.samples_mut().for_each(|sample| sample.field = Field::new(random_vector(&mut random, 60.0)));
        let mut refinement = refinement(&recorded, true);
        let steps = (0..=MAX_REFINEMENT_STEPS)
            .take_while(|_| refinement.refine_step(recorded.turns()) == RefinementProgress::Continue)
            .count();
        assert!(steps <= MAX_REFINEMENT_STEPS as usize, "seed {seed}");
    }
    // A cost that no step reduces.
    let (samples, mut refinement) = sample_and_refinement();
    let mut steps = 0;
    loop {
        refinement.linear_system.cost = -1e9;
        steps += 1;
        if refinement.levenberg_marquardt_step(samples) != RefinementProgress::Continue {
            break;
        }
    }
    assert!(steps < 10, "{steps}");
}

#[test]
fn a_singular_problem_fails() {
    let likelihood = Likelihood::new(&Prior::default(), ModelConfig::DEFAULT, Samples::default(), 50.0);
    let flat = ModelParameters { w: Matrix3::zeros(), corrected_mean_field: Vector3::zeros(), inclination_rad: 0.0 }
        .unknowns()
        .unwrap();
    let mut refinement = Refinement::new(likelihood, Samples::default(), flat, true);
    assert_eq!(refinement.refine_step(Samples::default()), RefinementProgress::Failed);
}

fn flight(seed: u64) -> (Airframe, RecordedTurns) {
    let (mut random, airframe) = Airframe::seeded(seed, 0.2, 1.5, 10.0, [-65.0, 65.0]);
    (airframe, Flight::TYPICAL.fly(&airframe, &mut random))
}

fn refinement(recorded: &RecordedTurns, refines_unknowns: bool) -> Refinement {
    let start = starting_point::sphere_start(recorded.turns(), &Matrix3::identity()).unwrap();
    let likelihood = Likelihood::new(&Prior::default(), ModelConfig::DEFAULT, recorded.turns(), start.field_unit_ut);
    let unknowns = likelihood.unknowns_from_start(&start).unwrap();
    Refinement::new(likelihood, recorded.turns(), unknowns, refines_unknowns)
}

#[test]
fn a_restart_converges_in_one_round() {
    let (_, recorded) = flight(4);
    let settled = || {
        let mut refinement = refinement(&recorded, true);
        while refinement.refine_step(recorded.turns()) == RefinementProgress::Continue {}
        refinement
    };
    let (converged, mut restarted) = (settled(), refinement(&recorded, true));
    restarted.unknowns = converged.unknowns;
    restarted.restart_with_noise(recorded.turns(), converged.likelihood.noise.clone());
    assert_eq!(
        (restarted.refine_step(recorded.turns()), restarted.refine_step(recorded.turns())),
        (RefinementProgress::Continue, RefinementProgress::Converged)
    );
    let change = (restarted.unknowns - converged.unknowns).norm();
    assert!(change < 1e-3 * converged.unknowns.norm(), "{change}");
    let [found, expected] =
        [&restarted, &converged].map(|refinement| refinement.likelihood.noise.inclination_sigma_rad);
    assert!((found / expected - 1.0).abs() < 0.01, "{found} {expected}");
    // A correction moves the unknowns, and needs one more noise estimate; interference two, because it was noise.
    let step = Vector13::repeat(1e-4);
    let mut late = settled();
    late.restart_with_latency(recorded.turns(), 0.05, &step);
    assert_eq!(late.likelihood.latency_s.to_bits(), 0.05_f32.to_bits());
    let mut with_current = settled();
    let change = Vector3::new(0.0, 1e-3, 0.0);
    with_current.restart_with_interference(recorded.turns(), &change, &step);
    assert!((with_current.likelihood.interference_per_ampere() - change).norm() < 1e-6);
    for (restarted, noise_estimates) in [(late, 1), (with_current, 2)] {
        assert!((restarted.unknowns - converged.unknowns - step).norm() < 1e-6);
        assert_eq!(MAX_NOISE_ESTIMATES - restarted.noise_estimate_count, noise_estimates);
    }
}

#[test]
fn fixed_unknowns_stay() {
    let (_, recorded) = flight(2);
    let mut refinement = refinement(&recorded, false);
    let before = refinement.unknowns;
    let steps =
        (0..10).take_while(|_| refinement.refine_step(recorded.turns()) == RefinementProgress::Continue).count();
    assert_eq!((steps, refinement.unknowns), (3, before));
}

/// Number of passes for twenty flights from the sphere fit, the worst starting point: 7.0 on average.
#[test]
fn a_solve_takes_seven_passes() {
    let mut passes = 0;
    for seed in 0..20 {
        let (_, recorded) = flight(seed);
        let mut refinement = refinement(&recorded, true);
        passes += 1;
        while refinement.refine_step(recorded.turns()) == RefinementProgress::Continue {
            passes += 1;
        }
    }
    assert!((130..=145).contains(&passes), "{passes}");
}

/// Sums of thin data lose digits, which the last pass and the covariance need.
#[test]
fn the_last_pass_and_few_samples_rotate_equations() {
    let (_, recorded) = flight(1);
    let mut refinement = refinement(&recorded, true);
    while refinement.refine_step(recorded.turns()) == RefinementProgress::Continue {}
    assert!(!refinement.likelihood.uses_normal_equations);
    let few_samples = turn_samples(&recorded.left[..30], &recorded.right[..30]);
    let likelihood = Likelihood::new(&Prior::default(), ModelConfig::DEFAULT, few_samples, 50.0);
    assert!(!likelihood.uses_normal_equations);
}
