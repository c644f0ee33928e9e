//! Likelihood model: sampling, noise estimation, parametrisation, damping.

use nalgebra::{Matrix3, Vector3};

use super::synthetic::{Airframe, Flight, Parts, max_abs, turn_samples};
use crate::calibration::fit::linearised_problem::LinearisedProblem;
use crate::calibration::model::{Likelihood, ModelConfig, ModelParameters, NoiseModel, Vector13};
use crate::calibration::tests::NO_PRIOR;
use crate::calibration::{HeadingMark, Orientation, Prior, Sample, Samples, SolveError};
use crate::frames::{Field, RollPitch};

fn sample_of_field(ut: [f32; 3]) -> Sample {
    Sample::new(Field::new(ut.into()), RollPitch::default())
}

fn identity_unknowns() -> Vector13 {
    ModelParameters { w: Matrix3::identity(), corrected_mean_field: Vector3::zeros(), inclination_rad: 0.0 }
        .unknowns()
        .unwrap()
}

/// Noise estimate after samples with these mean squares of clipped residuals, relative to sigmas of 1 % and 0.02 rad.
fn noise_after_reweighting(samples: u16, mean_squares: [f32; 2]) -> NoiseModel {
    let mut likelihood = Likelihood::new(&NO_PRIOR, ModelConfig::DEFAULT, Samples::default(), 50.0);
    likelihood.noise = NoiseModel::new(0.01, 0.02, Matrix3::identity());
    let clipped_squares = mean_squares.map(|square| square * f32::from(samples));
    likelihood.estimate_noise(clipped_squares, samples, &identity_unknowns());
    likelihood.noise
}

/// A clipped normal variable has a mean square of 0.9205. Thirteen unknowns fit a part of the noise of few samples: 24
/// samples have 17.5 degrees of freedom for each kind of residual. The prior of a typical sensor counts as four samples:
/// 10 %.
#[test]
fn noise_is_estimated_from_the_residuals() {
    for (samples, norm_factor, tolerance) in [(1000, 1.0, 0.02), (1000, 4.0, 0.02), (24, 1.0, 0.1), (24, 4.0, 0.12)] {
        let fitted = if samples == 24 { 17.5 / 24.0 } else { 1.0 };
        let mean_square = |factor: f32| 0.9205 * factor * factor * fitted;
        let noise = noise_after_reweighting(samples, [mean_square(norm_factor), mean_square(1.0)]);
        for (found, expected) in [(noise.norm_sigma, 0.01 * norm_factor), (noise.inclination_sigma_rad, 0.02)] {
            assert!((found / expected - 1.0).abs() < tolerance, "{samples}: {found} {expected}");
        }
    }
}

/// A fit without residuals is chance: noise below a tenth of a typical sensor's (0.4 %, 0.34 deg) does not exist,
/// and a dozen samples do not show noise below half of it.
#[test]
fn noise_estimates_have_a_floor() {
    for (samples, least) in [(1000, 0.1), (12, 0.5), (7, 0.5), (2, 0.5)] {
        let noise = noise_after_reweighting(samples, [0.0; 2]);
        let shares = [noise.norm_sigma / 0.004, noise.inclination_sigma_rad / 0.006];
        assert!(shares.iter().all(|share| (least..1.0).contains(share)), "{samples}: {noise:?}");
    }
}

/// A norm residual of 5 % is ten times that of a poor sensor; an inclination residual of 5 deg is no attitude.
#[test]
fn a_fit_with_large_residuals_is_not_acceptable() {
    let mut likelihood = Likelihood::new(&NO_PRIOR, ModelConfig::DEFAULT, Samples::default(), 50.0);
    for (norm, inclination_deg, is_acceptable) in [(0.04, 4.0_f32, true), (0.06, 1.0, false), (0.01, 6.0, false)] {
        likelihood.noise = NoiseModel::new(norm, inclination_deg.to_radians(), Matrix3::identity());
        assert_eq!(likelihood.is_acceptable_fit(), is_acceptable, "{norm} {inclination_deg} deg");
    }
}

/// A quarter, then half of many samples save time; marks are always used, and all samples in the end.
#[test]
fn early_iterations_use_a_subset_of_many_samples() {
    let turn: Vec<Sample> = (0..512_u16).map(|i| sample_of_field([f32::from(i % 40), 20.0, 30.0])).collect();
    let mark = HeadingMark { sample: turn[0], heading_rad: 0.0 };
    for (samples, expected) in [(512, [128, 256, 512]), (256, [128, 256, 256]), (12, [12, 12, 12])] {
        let part = Parts { left: &turn[..samples], marks: &[mark], ..Parts::default() }.samples();
        // The stride is chosen without the mark, which would make 513 of 512.
        let mut likelihood =
            Likelihood::new(&NO_PRIOR, ModelConfig::DEFAULT, turn_samples(&turn[..samples], &[]), 50.0);
        for expected in expected {
            let system = LinearisedProblem::linearise(&likelihood, part, &identity_unknowns());
            assert_eq!(usize::from(system.sample_count), expected + 1, "{samples}");
            likelihood.estimate_noise(system.clipped_squares, system.sample_count, &identity_unknowns());
        }
    }
}

/// Subtracting the mean keeps the precision at hard iron of sixty times the field. Two of f32's seven digits are lost:
/// 0.1 deg at worst.
#[test]
fn huge_hard_iron_costs_no_precision() {
    for seed in 0..20 {
        let (mut random, airframe) = Airframe::seeded(6000 + seed, 0.2, 0.0, 5.0, [-60.0, 60.0]);
        let airframe = Airframe { b_ut: Vector3::new(2000.0, -2000.0, 1000.0), ..airframe };
        let recorded = Flight { wander_deg: 2.0, ..Flight::NOISE_FREE }.fly(&airframe, &mut random);
        let mut likelihood = Likelihood::new(&NO_PRIOR, ModelConfig::DEFAULT, recorded.turns(), airframe.total_ut);
        likelihood.config.hard_iron_sigma_ut = 1e5;
        let start = airframe.exact_start();
        let unknowns = likelihood.unknowns_from_start(&start).unwrap();
        let mut worst = 0.0_f32;
        let parameters = ModelParameters::from_unknowns(&unknowns);
        likelihood.for_each_sample_equations(recorded.turns(), &parameters, &mut |equations| {
            worst = equations.iter().map(|equation| equation.residual.abs()).fold(worst, f32::max);
        });
        assert!(worst < 1e-4, "seed {seed}: {worst}");
        let calibration = likelihood.calibration(&unknowns).unwrap();
        let error = max_abs(&airframe.errors_deg(&calibration));
        assert!(error < 0.1, "seed {seed}: {error}");
    }
}

#[test]
fn a_calibration_is_equivalent_to_its_unknowns() {
    let mount = Orientation::from_name("roll90-yaw90").unwrap();
    let field = sample_of_field([12.0, -31.0, 28.0]);
    let samples = [field, sample_of_field([5.0, 3.0, -20.0]), sample_of_field([-30.0, 9.0, 2.0])];
    let samples = turn_samples(&samples, &[]);
    let likelihood = Likelihood::new(&Prior { mount, ..NO_PRIOR }, ModelConfig::DEFAULT, samples, 40.0);
    let parameters = ModelParameters {
        w: Matrix3::new(1.2, 0.1, -0.2, 0.3, 0.9, 0.1, -0.1, 0.2, 1.1),
        corrected_mean_field: Vector3::new(0.2, -0.4, 0.6),
        inclination_rad: 0.7,
    };
    let calibration = likelihood.calibration(&parameters.unknowns().unwrap()).unwrap();
    assert!((calibration.w_matrix().determinant() - 1.0).abs() < 1e-5);
    assert!((calibration.inclination_rad - 0.7).abs() < 1e-6);
    let x = mount.body_from_sensor() * field.field.ut / 40.0 - likelihood.mean_field;
    let expected = parameters.w * x + parameters.corrected_mean_field;
    let found = calibration.calibrated_field(field.field).ut / calibration.total_ut;
    assert!((found - expected).norm() < 1e-5, "{found} {expected}");
    let nothing = calibration.calibrated_field(Field::new(calibration.b_vector_ut())).ut;
    let x = mount.body_from_sensor() * calibration.b_vector_ut() / 40.0 - likelihood.mean_field;
    assert!(nothing.norm() < 1e-4 && (parameters.w * x + parameters.corrected_mean_field).norm() < 1e-5);
}

#[test]
fn mirrored_or_singular_matrices_are_rejected() {
    let likelihood = Likelihood::new(&NO_PRIOR, ModelConfig::DEFAULT, Samples::default(), 40.0);
    for diagonal in [[1.0, 1.0, -1.0], [1.0, 1.0, 0.0], [1.0, f32::NAN, 1.0]] {
        let mut unknowns = identity_unknowns();
        for (i, value) in diagonal.into_iter().enumerate() {
            unknowns[crate::calibration::model::w_index(i, i)] = value;
        }
        assert_eq!(likelihood.calibration(&unknowns), Err(SolveError::NotConverged));
    }
}

/// Inclination two sigma off its prior costs 2; damping shortens the step to 1/2, 1/4.
#[test]
fn damping_shortens_a_step() {
    let samples = [sample_of_field([50.0, 0.0, 0.0])];
    let samples = turn_samples(&samples, &[]);
    let prior = Prior { inclination_rad: Some(0.3), ..NO_PRIOR };
    let likelihood = Likelihood::new(&prior, ModelConfig::WITHOUT_ATTITUDE, samples, 50.0);
    let parameters =
        ModelParameters { w: Matrix3::identity(), corrected_mean_field: Vector3::x(), inclination_rad: 0.3 + 0.035 };
    let system = LinearisedProblem::linearise(&likelihood, samples, &parameters.unknowns().unwrap());
    assert!((system.cost - 2.0).abs() < 1e-3, "{}", system.cost);
    for (damping, share) in [(0.0, 1.0), (1.0, 0.5), (3.0, 0.25)] {
        let (change, predicted_decrease) = system.damped_step(damping).unwrap();
        let inclination_rad = change[crate::calibration::model::INCLINATION_INDEX];
        assert!((inclination_rad / (-0.035 * share) - 1.0).abs() < 1e-3, "{damping}: {inclination_rad}");
        // Predicted decrease: half of step times gradient.
        assert!((predicted_decrease / (2.0 * share) - 1.0).abs() < 1e-3, "{damping}: {predicted_decrease}");
    }
    assert!((system.step_to_maximum().unwrap() - system.damped_step(0.0).unwrap().0).norm() < 1e-6);
}
