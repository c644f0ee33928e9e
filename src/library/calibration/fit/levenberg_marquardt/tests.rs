//! Unit tests of `levenberg_marquardt`.

use crate::calibration::tests::synthetic::Parts;
use nalgebra::{Matrix3, Vector3};

use super::*;
use crate::calibration::closed_form::starting_point;
use crate::calibration::model::{INCLINATION_INDEX, ModelConfig, ModelParameters};
use crate::calibration::tests::synthetic::{Airframe, Flight, Random, RecordedTurns};
use crate::calibration::{Prior, Sample};
use crate::frames::{Attitude, Field};

fn is_close(found: f32, expected: f32) -> bool {
    (found - expected).abs() <= 1e-4 * expected.abs()
}

#[test]
fn damping_follows_the_achieved_gain() {
    let damping = Damping { value: 0.5, growth: 32.0 };
    for (share, factor) in [
        (1.0, 0.1),
        (0.99, 0.1),
        (0.9, 1.0 - 0.512),
        (0.75, 0.875),
        (0.5, 1.0),
        (0.25, 1.125),
        (0.0, 2.0),
        (7.0, 0.1),
        (-7.0, 2.0),
    ] {
        let after = damping.after_success(share);
        assert!(is_close(after.value, 0.5 * factor), "{share}: {after:?}");
        assert!(is_close(after.growth, 4.0));
    }
    assert!(is_close(Damping { value: 5e-9, growth: 4.0 }.after_success(1.0).value, 1e-9), "not below f32's digits");
}

#[test]
fn damping_growth_doubles_with_each_failure() {
    let mut damping = Damping { value: 1.0, growth: 4.0 };
    for value in [4.0, 32.0, 512.0] {
        damping = damping.after_failure();
        assert!(is_close(damping.value, value), "{damping:?}");
    }
}

/// One sample without attitude at the maximum likelihood, except for an inclination that is off by `sigmas`: the
/// cost is half the square, and a step promises all of it.
fn refinement_off_by(sigmas: f32) -> Refinement {
    let sample = Sample::new(Field::from_ut(50.0, 0.0, 0.0), Attitude::default());
    let samples = Parts { left: &[sample], ..Parts::default() }.samples();
    let prior = Prior { inclination_rad: Some(0.0), ..Prior::default() };
    let likelihood = Likelihood::new(&prior, ModelConfig::WITHOUT_ATTITUDE, samples, 50.0);
    let inclination_rad = sigmas * likelihood.config.known_inclination_sigma_rad;
    let parameters =
        ModelParameters { w: Matrix3::identity(), corrected_mean_field: Vector3::new(1.0, 0.0, 0.0), inclination_rad };
    Refinement::new(likelihood, samples, parameters.unknowns().unwrap(), true)
}

fn step_after_cost_increase(refinement: &mut Refinement, cost_increase: f32) -> RefinementProgress {
    let sample = Sample::new(Field::from_ut(50.0, 0.0, 0.0), Attitude::default());
    refinement.linear_system.cost += cost_increase;
    refinement.levenberg_marquardt_step(Parts { left: &[sample], ..Parts::default() }.samples())
}

/// Convergence thresholds: a tenth of a sigma at the end, one sigma before. The last step is applied.
#[test]
fn a_refinement_converges_when_the_predicted_gain_is_small() {
    for (rounds, sigmas, progress) in [
        (MAX_NOISE_ESTIMATES, 0.098, RefinementProgress::Converged),
        (MAX_NOISE_ESTIMATES, -0.102, RefinementProgress::Continue),
        (MAX_NOISE_ESTIMATES - 1, -0.98, RefinementProgress::Converged),
        (0, 0.98, RefinementProgress::Converged),
        (0, 1.02, RefinementProgress::Continue),
    ] {
        let mut refinement = refinement_off_by(sigmas);
        refinement.noise_estimate_count = rounds;
        assert_eq!(step_after_cost_increase(&mut refinement, 0.0), progress, "{rounds} {sigmas}");
        assert!(refinement.unknowns[INCLINATION_INDEX].abs() < 2e-5, "{}", refinement.unknowns[INCLINATION_INDEX]);
        let left = refinement.linear_system.step_to_maximum().unwrap();
        assert!(left.amax() < 2e-5, "{left}");
    }
}

#[test]
fn a_refinement_ends_after_forty_steps() {
    for (before, progress) in [(38, RefinementProgress::Continue), (39, RefinementProgress::Converged)] {
        let mut refinement = refinement_off_by(3.0);
        refinement.steps_since_noise_estimate = before;
        assert_eq!(step_after_cost_increase(&mut refinement, 0.0), progress, "after {before}");
    }
}

#[test]
fn a_refinement_ends_when_no_step_reduces_the_cost() {
    for (value, progress) in [(2.4e5, RefinementProgress::Continue), (2.6e5, RefinementProgress::Converged)] {
        let mut refinement = refinement_off_by(3000.0);
        refinement.damping.value = value;
        assert_eq!(step_after_cost_increase(&mut refinement, -1e9), progress, "{value}");
        assert!(is_close(refinement.damping.value, 4.0 * value), "a failed step");
    }
}

#[test]
fn steps_that_raise_the_cost_are_rejected() {
    for (refined, worse, taken) in
        [(false, -0.01, true), (false, 0.01, false), (true, 0.0, true), (true, 0.99, true), (true, 1.01, false)]
    {
        let mut refinement = refinement_off_by(3.0);
        refinement.likelihood.has_noise_estimate = refined;
        let before = refinement.unknowns;
        step_after_cost_increase(&mut refinement, -4.5 - worse);
        assert_eq!(refinement.unknowns != before, taken, "refined {refined}, worse by {worse}");
        let growth = if taken { 2.0 } else { 4.0 };
        let found = refinement.damping.value / Damping::START_DAMPING.value;
        assert!((found / growth - 1.0).abs() < 0.01, "{found} {growth}");
    }
}

#[test]
fn damping_ignores_gains_within_the_tolerance() {
    for (lost, factor) in [(0.0, 0.1), (2.25, 1.0), (3.75, 1.0 + (2.0_f32 / 3.0).powi(3))] {
        let mut refinement = refinement_off_by(3.0);
        step_after_cost_increase(&mut refinement, -lost);
        let found = refinement.damping.value / Damping::START_DAMPING.value;
        // Tolerance: damping shortens a step by a thousandth, its gain by a millionth.
        assert!((found / factor - 1.0).abs() < 0.01, "{lost}: {found} {factor}");
    }
    // Both steps are accepted, with no gain. A predicted gain of 0.98 is within the tolerance of 1: damping falls as
    // after a good step. One of 1.28 is beyond it: damping rises.
    for (sigmas, factor) in [(1.4, 0.1), (1.6, 2.0)] {
        let mut refinement = refinement_off_by(sigmas);
        refinement.likelihood.has_noise_estimate = true;
        step_after_cost_increase(&mut refinement, -0.5 * sigmas * sigmas);
        let found = refinement.damping.value / Damping::START_DAMPING.value;
        assert!((found / factor - 1.0).abs() < 0.01, "{sigmas}: {found} {factor}");
    }
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
    let mut random = Random(seed);
    let airframe = Airframe::random(&mut random, 0.2, 1.5, 10.0, [-65.0, 65.0]);
    (airframe, Flight::TYPICAL.fly(&airframe, &mut random))
}

fn refinement(recorded: &RecordedTurns, refines_unknowns: bool) -> Refinement {
    let start = starting_point::sphere_start(recorded.turns(), &Matrix3::identity()).unwrap();
    let likelihood = Likelihood::new(&Prior::default(), ModelConfig::DEFAULT, recorded.turns(), start.field_unit_ut);
    let unknowns = likelihood.unknowns_from_start(&start).unwrap();
    Refinement::new(likelihood, recorded.turns(), unknowns, refines_unknowns)
}

#[test]
fn the_noise_is_estimated_three_times() {
    let (_, recorded) = flight(1);
    let mut refinement = refinement(&recorded, true);
    assert_eq!(refinement.damping, Damping { value: 1e-3, growth: 4.0 });
    let mut estimates = Vec::new();
    loop {
        let rounds = refinement.noise_estimate_count;
        match refinement.refine_step(recorded.turns()) {
            RefinementProgress::Continue if refinement.noise_estimate_count > rounds => {
                assert!(is_close(refinement.damping.value, 1e-6) && refinement.steps_since_noise_estimate == 0);
                estimates.push(refinement.likelihood.noise.inclination_sigma_rad);
            }
            RefinementProgress::Continue => assert!(refinement.steps_since_noise_estimate > 0),
            end => break assert_eq!(end, RefinementProgress::Converged),
        }
    }
    assert_eq!((estimates.len(), refinement.noise_estimate_count), (3, 3));
    assert!((estimates[2] / estimates[1] - 1.0).abs() < 0.01, "{estimates:?}");
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
    assert!(
        (restarted.likelihood.noise.inclination_sigma_rad / converged.likelihood.noise.inclination_sigma_rad - 1.0)
            .abs()
            < 0.01
    );
    let mut late = settled();
    late.restart_with_latency(recorded.turns(), 0.05, &Vector13::repeat(1e-4));
    assert_eq!(late.likelihood.latency_s.to_bits(), 0.05_f32.to_bits());
    assert!((late.unknowns - converged.unknowns - Vector13::repeat(1e-4)).norm() < 1e-6);
    assert_eq!((late.noise_estimate_count, late.steps_since_noise_estimate), (MAX_NOISE_ESTIMATES - 1, 0));
    // The noise estimate contained the interference, so one more is needed.
    let mut with_current = settled();
    with_current.restart_with_interference(recorded.turns(), &Vector3::new(0.0, 1e-3, 0.0), &Vector13::repeat(1e-4));
    assert!((with_current.likelihood.interference_per_ampere() - Vector3::new(0.0, 1e-3, 0.0)).norm() < 1e-6);
    assert!((with_current.unknowns - converged.unknowns - Vector13::repeat(1e-4)).norm() < 1e-6);
    assert_eq!(
        (with_current.noise_estimate_count, with_current.steps_since_noise_estimate),
        (MAX_NOISE_ESTIMATES - 2, 0)
    );
}

#[test]
fn fixed_unknowns_stay() {
    let (_, recorded) = flight(2);
    let mut refinement = refinement(&recorded, false);
    let before = refinement.unknowns;
    let steps =
        (0..10).take_while(|_| refinement.refine_step(recorded.turns()) == RefinementProgress::Continue).count();
    assert_eq!((steps, refinement.unknowns), (3, before));
    // Initial noise: 5 % of the norm, 0.1 rad of inclination. The sphere fit reduces the norm's, not to a sensor's.
    let NoiseModel { norm_sigma: norm, inclination_sigma_rad, .. } = refinement.likelihood.noise;
    assert!(
        (0.01..0.049).contains(&norm) && (0.01..0.3).contains(&inclination_sigma_rad),
        "{norm} {inclination_sigma_rad}"
    );
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

#[test]
fn only_the_last_pass_rotates_equations() {
    let (_, recorded) = flight(1);
    let mut refinement = refinement(&recorded, true);
    while refinement.refine_step(recorded.turns()) == RefinementProgress::Continue {
        assert_eq!(refinement.likelihood.uses_normal_equations, refinement.noise_estimate_count < MAX_NOISE_ESTIMATES);
    }
    assert!(!refinement.likelihood.uses_normal_equations);
    for (samples, sums_up) in [(128, false), (129, true)] {
        let likelihood = Likelihood::new(
            &Prior::default(),
            ModelConfig::DEFAULT,
            Parts { left: &recorded.left[..64], right: &recorded.right[..samples - 64], ..Parts::default() }.samples(),
            50.0,
        );
        assert_eq!(likelihood.uses_normal_equations, sums_up, "{samples}");
    }
}

#[test]
fn normal_equations_agree_with_rotations() {
    let (_, recorded) = flight(3);
    let Refinement { mut likelihood, unknowns, .. } = refinement(&recorded, true);
    likelihood.sample_stride = 1;
    let [summed, exact] = [true, false].map(|sums_up| {
        likelihood.uses_normal_equations = sums_up;
        LinearisedProblem::linearise(&likelihood, recorded.turns(), &unknowns)
    });
    assert!(is_close(summed.cost, exact.cost) && summed.sample_count == exact.sample_count);
    let (found, expected) = (summed.step_to_maximum().unwrap(), exact.step_to_maximum().unwrap());
    assert!((found - expected).norm() < 1e-3 * expected.norm(), "{found} {expected}");
}
