//! Likelihood model: sampling, noise estimation, parametrisation, damping.

use crate::calibration::tests::synthetic::Parts;
use nalgebra::{Matrix3, Vector3};

use super::synthetic::{Airframe, Flight, Random};
use crate::calibration::closed_form::starting_point::StartingPoint;
use crate::calibration::fit::linearised_problem::LinearisedProblem;
use crate::calibration::model::{Likelihood, ModelConfig, ModelParameters, NoiseModel, Vector13};
use crate::calibration::tests::NO_PRIOR;
use crate::calibration::{HeadingMark, Orientation, Prior, Sample, Samples, SolveError};
use crate::frames::{Attitude, Field};

fn sample_of_field(ut: [f32; 3]) -> Sample {
    Sample::new(Field::new(ut.into()), Attitude::default())
}

fn identity_unknowns() -> Vector13 {
    ModelParameters { w: Matrix3::identity(), corrected_mean_field: Vector3::zeros(), inclination_rad: 0.0 }
        .unknowns()
        .unwrap()
}

/// Noise estimate after samples with these normalised mean squares, from sigmas of 1 % and 0.02 rad.
fn noise_after_reweighting(samples: u16, mean_squares: [f32; 2]) -> NoiseModel {
    let mut likelihood = Likelihood::new(&NO_PRIOR, ModelConfig::DEFAULT, Samples::default(), 50.0);
    likelihood.noise = NoiseModel::new(0.01, 0.02, Matrix3::identity());
    let mut system = LinearisedProblem::from_priors(&likelihood, &identity_unknowns());
    system.sample_count = samples;
    system.clipped_squares = mean_squares.map(|square| square * f32::from(samples));
    likelihood.estimate_noise(system.clipped_squares, system.sample_count, &identity_unknowns());
    likelihood.noise
}

/// Degrees of freedom: samples minus 6.5 for each residual type (13 unknowns). The prior counts as four samples of a
/// typical sensor (0.4 %) and attitude source (0.34 deg). A clipped normal variable has a mean square of 0.9205.
#[test]
fn noise_is_estimated_from_the_residuals() {
    for (samples, freedom) in [(256, 249.5), (100, 93.5), (12, 5.5), (8, 1.5), (7, 1.0), (2, 1.0)] {
        let noise = noise_after_reweighting(samples, [0.9205, 0.9205 * 4.0]);
        let number = f32::from(samples);
        let norm = ((number * 0.01_f32.powi(2) + 4.0 * 0.004_f32.powi(2)) / (freedom + 4.0)).sqrt();
        let inclination_sigma_rad = ((number * 0.04_f32.powi(2) + 4.0 * 0.006_f32.powi(2)) / (freedom + 4.0)).sqrt();
        assert!((noise.norm_sigma / norm - 1.0).abs() < 1e-3, "{samples}: {} {norm}", noise.norm_sigma);
        assert!(
            (noise.inclination_sigma_rad / inclination_sigma_rad - 1.0).abs() < 1e-3,
            "{samples}: {} {inclination_sigma_rad}",
            noise.inclination_sigma_rad
        );
    }
}

#[test]
fn noise_estimates_have_a_floor() {
    let noise_of_few_samples = noise_after_reweighting(12, [0.0; 2]);
    assert!(
        (noise_of_few_samples.norm_sigma - (4.0 * 0.004_f32.powi(2) / 9.5).sqrt()).abs() < 1e-6,
        "{}",
        noise_of_few_samples.norm_sigma
    );
    assert!(
        (noise_of_few_samples.inclination_sigma_rad - (4.0 * 0.006_f32.powi(2) / 9.5).sqrt()).abs() < 1e-6,
        "{}",
        noise_of_few_samples.inclination_sigma_rad
    );
    let noise_of_many_samples = noise_after_reweighting(1000, [0.0; 2]);
    assert!(
        (noise_of_many_samples.norm_sigma - 0.0005).abs() < 1e-9
            && (noise_of_many_samples.inclination_sigma_rad - 0.0009).abs() < 1e-9,
        "{noise_of_many_samples:?}"
    );
}

#[test]
fn a_fit_with_large_residuals_is_not_acceptable() {
    let mut likelihood = Likelihood::new(&NO_PRIOR, ModelConfig::DEFAULT, Samples::default(), 50.0);
    for (norm, inclination_sigma_rad, explains) in [(0.049, 0.086, true), (0.051, 0.01, false), (0.01, 0.088, false)] {
        likelihood.noise = NoiseModel::new(norm, inclination_sigma_rad, Matrix3::identity());
        assert_eq!(likelihood.is_acceptable_fit(), explains, "{norm} {inclination_sigma_rad}");
    }
}

/// First iterations use a subset of many samples (about 128, then half of 512); marks are always used.
#[test]
fn early_iterations_use_a_subset_of_many_samples() {
    let turn: Vec<Sample> = (0..512_u16).map(|i| sample_of_field([f32::from(i % 40), 20.0, 30.0])).collect();
    let mark = HeadingMark { sample: turn[0], heading_rad: 0.0 };
    for (samples, at_first) in [(512, 128), (384, 128), (383, 192), (256, 128), (255, 255), (12, 12)] {
        for marks in [&[][..], &[mark]] {
            let part = Parts { left: &turn[..samples], marks, ..Parts::default() }.samples();
            let mut likelihood = Likelihood::new(&NO_PRIOR, ModelConfig::DEFAULT, part, 50.0);
            let at_first = if samples + marks.len() == 384 { 128 } else { at_first };
            let system = LinearisedProblem::linearise(&likelihood, part, &identity_unknowns());
            if (samples + marks.len()) % 128 != 0 || marks.is_empty() {
                assert_eq!(usize::from(system.sample_count), at_first + marks.len(), "{samples}");
            }
            assert!(!likelihood.has_noise_estimate);
            likelihood.estimate_noise(system.clipped_squares, system.sample_count, &identity_unknowns());
            assert!(likelihood.has_noise_estimate);
            let next_count = if samples == 512 { 256 } else { samples };
            let system = LinearisedProblem::linearise(&likelihood, part, &identity_unknowns());
            assert_eq!(usize::from(system.sample_count), next_count + marks.len(), "{samples}");
            likelihood.estimate_noise(system.clipped_squares, system.sample_count, &identity_unknowns());
            assert_eq!(
                usize::from(LinearisedProblem::linearise(&likelihood, part, &identity_unknowns()).sample_count),
                samples + marks.len()
            );
        }
    }
}

/// Mean of all samples and marks in mounting axes, relative to the unit. Residuals are of `W (m - mean) + d`.
#[test]
fn the_sample_mean_is_subtracted() {
    let mount = Orientation::from_name("yaw90").unwrap();
    let (left, right) = ([sample_of_field([10.0, 0.0, 5.0])], [sample_of_field([30.0, -8.0, 5.0])]);
    let marks = [HeadingMark { sample: sample_of_field([20.0, 20.0, 35.0]), heading_rad: 0.0 }];
    let samples = Parts { left: &left, right: &right, marks: &marks, ..Parts::default() }.samples();
    let prior = Prior { mount, ..NO_PRIOR };
    let likelihood = Likelihood::new(&prior, ModelConfig::DEFAULT, samples, 10.0);
    // Yaw by 90 deg: sensor x is body y, sensor y is body -x.
    let mean = Vector3::new(-0.4, 2.0, 1.5);
    assert!((likelihood.mean_field - mean).norm() < 1e-6, "{}", likelihood.mean_field);
    let mut norms = Vec::new();
    let parameters = ModelParameters {
        w: Matrix3::identity(),
        corrected_mean_field: Vector3::new(0.0, 0.0, 2.0),
        inclination_rad: 0.0,
    };
    likelihood
        .for_each_sample_equations(samples, &parameters, &mut |equations| norms.push(equations.norm_equation.residual));
    for (norm, field) in norms.iter().zip([[0.0, 1.0, 0.5], [0.8, 3.0, 0.5], [-2.0, 2.0, 3.5]]) {
        let expected = (Vector3::from(field) - mean + parameters.corrected_mean_field).norm() - 1.0;
        assert!((norm - expected).abs() < 1e-5, "{norm} {expected}");
    }
    assert_eq!(norms.len(), 3);
    assert_eq!(Likelihood::new(&prior, ModelConfig::DEFAULT, Samples::default(), 10.0).mean_field, Vector3::zeros());
}

/// Subtracting the mean keeps the precision at hard iron of sixty times the field. Two of f32's seven digits are lost:
/// 0.1 deg at worst.
#[test]
fn huge_hard_iron_costs_no_precision() {
    for seed in 0..20 {
        let mut random = Random(6000 + seed);
        let airframe = Airframe::random(&mut random, 0.2, 0.0, 5.0, [-60.0, 60.0]);
        let airframe = Airframe { b_ut: Vector3::new(2000.0, -2000.0, 1000.0), ..airframe };
        let recorded = Flight { wander_deg: 2.0, ..Flight::NOISE_FREE }.fly(&airframe, &mut random);
        let mut likelihood = Likelihood::new(&NO_PRIOR, ModelConfig::DEFAULT, recorded.turns(), airframe.total_ut);
        likelihood.config.hard_iron_sigma_ut = 1e5;
        let start = airframe.exact_start();
        let unknowns = likelihood.unknowns_from_start(&start).unwrap();
        let mut worst = 0.0_f32;
        likelihood.for_each_sample_equations(
            recorded.turns(),
            &ModelParameters::from_unknowns(&unknowns),
            &mut |equations| {
                worst = worst
                    .max(equations.norm_equation.residual.abs())
                    .max(equations.inclination_equation.as_ref().unwrap().residual.abs());
            },
        );
        assert!(worst < 1e-4, "seed {seed}: {worst}");
        let calibration = likelihood.calibration(&unknowns).unwrap();
        let error = crate::calibration::tests::max_abs(&airframe.errors_deg(&calibration));
        assert!(error < 0.1, "seed {seed}: {error}");
    }
}

#[test]
fn a_calibration_is_equivalent_to_its_unknowns() {
    let mount = Orientation::from_name("roll90-yaw90").unwrap();
    let field = sample_of_field([12.0, -31.0, 28.0]);
    let samples = [field, sample_of_field([5.0, 3.0, -20.0]), sample_of_field([-30.0, 9.0, 2.0])];
    let samples = Parts { left: &samples, ..Parts::default() }.samples();
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

#[test]
fn a_start_converts_to_unknowns() {
    let samples = [sample_of_field([12.0, -31.0, 28.0]), sample_of_field([5.0, 3.0, -20.0])];
    let samples = Parts { left: &samples, ..Parts::default() }.samples();
    let likelihood = Likelihood::new(&NO_PRIOR, ModelConfig::DEFAULT, samples, 40.0);
    let w = Matrix3::new(1.2, 0.1, -0.2, 0.3, 0.9, 0.1, -0.1, 0.2, 1.1);
    let start = StartingPoint { field_unit_ut: 40.0, w, hard_iron: Vector3::new(0.1, 0.2, -0.3), inclination_rad: 0.4 };
    let parameters = ModelParameters::from_unknowns(&likelihood.unknowns_from_start(&start).unwrap());
    assert!(
        (parameters.corrected_mean_field - w * (likelihood.mean_field - start.hard_iron)).norm() < 1e-6
            && parameters.w == w
    );
    assert!((parameters.mean_minus_hard_iron().unwrap() - (likelihood.mean_field - start.hard_iron)).norm() < 1e-5);
    assert!((parameters.inclination_rad - 0.4).abs() < 1e-6);
    assert!(
        likelihood
            .unknowns_from_start(&StartingPoint { hard_iron: Vector3::from_element(f32::NAN), ..start })
            .is_none()
    );
}

#[test]
fn the_cost_sums_all_equations_and_priors() {
    let mut random = Random(61);
    let airframe = Airframe::random(&mut random, 0.2, 1.0, 5.0, [-60.0, 60.0]);
    let recorded = Flight::TYPICAL.fly(&airframe, &mut random);
    let marks = [
        HeadingMark { sample: recorded.left[3], heading_rad: 1.0 },
        HeadingMark { sample: recorded.left[9], heading_rad: 2.0 },
    ];
    let samples = Parts { left: &recorded.left[..40], marks: &marks, ..Parts::default() }.samples();
    for config in [ModelConfig::DEFAULT, ModelConfig::WITHOUT_ATTITUDE] {
        let likelihood = Likelihood::new(&NO_PRIOR, config, samples, airframe.total_ut);
        let unknowns = ModelParameters {
            corrected_mean_field: likelihood.mean_field,
            ..ModelParameters::from_unknowns(&identity_unknowns())
        }
        .unknowns()
        .unwrap();
        let system = LinearisedProblem::linearise(&likelihood, samples, &unknowns);
        let mut cost = LinearisedProblem::from_priors(&likelihood, &unknowns).cost;
        let mut clipped = [0.0, 0.0];
        likelihood.for_each_sample_equations(samples, &ModelParameters::from_unknowns(&unknowns), &mut |equations| {
            cost += equations.norm_equation.loss;
            cost +=
                equations.inclination_equation.as_ref().map_or(0.0, |inclination_equation| inclination_equation.loss);
            cost += equations.heading_equation.as_ref().map_or(0.0, |heading| heading.loss);
            clipped[0] += equations.norm_equation.clipped_square;
            clipped[1] += equations
                .inclination_equation
                .as_ref()
                .map_or(0.0, |inclination_equation| inclination_equation.clipped_square);
        });
        assert!((system.cost / cost - 1.0).abs() < 1e-4, "{} {cost}", system.cost);
        assert!((system.clipped_squares[0] / clipped[0] - 1.0).abs() < 1e-4);
        assert!((system.clipped_squares[1] - clipped[1]).abs() <= 1e-4 * clipped[1]);
        assert_eq!(system.sample_count, 42);
    }
}

/// Inclination two sigma off its prior costs 2; damping shortens the step to 1/2, 1/4.
#[test]
fn damping_shortens_a_step() {
    let samples = [sample_of_field([50.0, 0.0, 0.0])];
    let samples = Parts { left: &samples, ..Parts::default() }.samples();
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
