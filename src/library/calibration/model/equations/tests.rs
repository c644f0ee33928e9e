//! Unit tests of `equations`.

use core::f32::consts::TAU;

use nalgebra::Matrix3;

use super::*;
use crate::calibration::model::unknowns::Vector13;
use crate::calibration::tests::{ZERO_ROW, is_close};
use crate::frames::RollPitch;

/// Huber's loss: linear beyond two sigmas of 0.1.
#[test]
fn an_outlier_counts_linearly_and_is_clipped() {
    for (sigmas, weight, loss, clipped) in [
        (0.5, 100.0, 0.125, 0.5),
        (2.0, 100.0, 2.0, 2.0),
        (8.0, 25.0, 2.0 + 2.0 * 6.0, 2.0),
        (-8.0, 25.0, 2.0 + 2.0 * 6.0, -2.0),
    ] {
        let equation = ResidualEquation::new(ZERO_ROW, sigmas * 0.1, 0.01, 2.0);
        assert!(is_close(equation.weight, weight) && is_close(equation.loss, loss), "{sigmas}: {equation:?}");
        assert!(is_close(equation.clipped_residual(), clipped), "{sigmas}: {equation:?}");
        assert!(is_close(equation.clipped_square, clipped * clipped), "{sigmas}: {equation:?}");
    }
}

#[test]
fn clipped_mean_square_of_normal_noise() {
    let density = |z: f64| (-0.5 * z * z).exp() / core::f64::consts::TAU.sqrt();
    let clip = f64::from(CLIP_SIGMAS).powi(2);
    let mean: f64 =
        (-10_000..10_000).map(|i| (f64::from(i) + 0.5) * 1e-3).map(|z| density(z) * (z * z).min(clip) * 1e-3).sum();
    assert!((f64::from(CLIPPED_MEAN_SQUARE) / mean - 1.0).abs() < 1e-3, "{mean}");
}

#[test]
fn without_attitude_there_is_no_inclination_equation() {
    let parameters =
        ModelParameters { w: Matrix3::identity(), corrected_mean_field: Vector3::zeros(), inclination_rad: 1.0 };
    let tilt = RollPitch::from_deg(20.0, 0.0).tilt_rotation();
    let measured =
        MeasuredSample { centred_field: Vector3::new(0.6, 0.0, 0.8), tilt_rotation: tilt, heading_rad: None };
    let equations = |config| SampleEquations::new(&parameters, &measured, &NoiseModel::INITIAL, &config, true);
    assert!(
        equations(ModelConfig::DEFAULT).inclination_equation.is_some()
            && equations(ModelConfig::WITH_FIXED_MOUNTING).inclination_equation.is_some()
    );
    assert!(equations(ModelConfig::WITHOUT_ATTITUDE).inclination_equation.is_none());
    assert!(equations(ModelConfig::DEFAULT).heading_equation.is_none());
}

/// Expected gradient at the truth over all headings at 15 deg of bank each way and 70 deg of inclination, in
/// standard deviations. Noise of 1 % as six sigma points with its mean and covariance.
fn expected_gradient(is_refined: bool) -> f32 {
    let parameters = ModelParameters {
        w: Matrix3::new(1.1, 0.1, -0.05, 0.0, 0.9, 0.1, 0.05, -0.1, 1.05),
        corrected_mean_field: Vector3::new(0.1, -0.2, 0.6),
        inclination_rad: 70_f32.to_radians(),
    };
    let sigma = 0.01;
    let noise = NoiseModel::new(sigma, 0.011, parameters.w);
    let mut gradient = Vector13::zeros();
    let mut information = Vector13::zeros();
    for (bank_deg, step) in [-15.0, 15.0].into_iter().flat_map(|bank_deg| (0..128_u8).map(move |step| (bank_deg, step)))
    {
        let attitude = RollPitch::from_deg(bank_deg, 0.0);
        let tilt = attitude.tilt_rotation();
        let exact = parameters.expected_field(&tilt, f32::from(step) / 128.0 * TAU).unwrap();
        for (axis, sign) in [(0, 1.0), (1, 1.0), (2, 1.0), (0, -1.0), (1, -1.0), (2, -1.0)] {
            let x = exact + Vector3::ith(axis, sign * sigma * 3_f32.sqrt());
            let measured = MeasuredSample { centred_field: x, tilt_rotation: tilt, heading_rad: None };
            let equations = SampleEquations::new(&parameters, &measured, &noise, &ModelConfig::DEFAULT, is_refined);
            for equation in
                [Some(&equations.norm_equation), equations.inclination_equation.as_ref()].into_iter().flatten()
            {
                let row = equation.jacobian_row.as_vector();
                gradient += row * (equation.weight * equation.residual / 6.0);
                information += row.component_mul(&row) * (equation.weight / 6.0);
            }
        }
    }
    gradient.component_div(&information.map(f32::sqrt)).amax()
}

/// Without correction the bias is half a sigma of a flight of 2 x 128 samples; the first-order correction reduces
/// it to a third.
#[test]
fn corrected_measurements_remove_the_noise_bias() {
    let (corrected, not) = (expected_gradient(true), expected_gradient(false));
    assert!(corrected < 0.5 * not && not > 0.4, "{corrected} {not}");
}

/// Expected error given both residuals, `S J^T (J S J^T + R)^-1 e`, with `S` the sensor covariance, `J` the
/// derivatives of norm and inclination by the measurement, and `R` the attitude's share. Outliers are limited to
/// two sigmas.
#[test]
fn the_measurement_is_corrected_by_its_expected_sensor_error() {
    let noise_w = Matrix3::new(1.2, 0.1, -0.2, 0.3, 0.9, 0.1, -0.1, 0.2, 1.1);
    let noise = NoiseModel::new(0.01, 0.015, noise_w);
    let tilt = RollPitch::from_deg(25.0, 5.0).tilt_rotation();
    let mut parameters =
        ModelParameters { w: noise_w, corrected_mean_field: Vector3::new(0.1, 0.0, 0.2), inclination_rad: 1.0 };
    let measured = MeasuredSample {
        centred_field: parameters.expected_field(&tilt, 0.7).unwrap() + Vector3::new(0.004, -0.006, 0.005),
        tilt_rotation: tilt,
        heading_rad: None,
    };
    let moved_by = |parameters: &ModelParameters| {
        let prediction = parameters.predict_field(measured.centred_field, &tilt);
        let by_attitude = prediction.inclination_derivatives_by_attitude(&tilt);
        let covariance =
            noise.covariance(&prediction.field_direction, &prediction.inclination_derivative_by_field, by_attitude);
        let residuals = Residuals::new(parameters, &prediction);
        let config = &ModelConfig::DEFAULT;
        let (corrected_sample, _) =
            linearise_at_corrected_field(parameters, &measured, &noise, &covariance, &prediction, &residuals, config);
        (measured.centred_field - corrected_sample.centred_field, prediction, residuals)
    };
    let (found, prediction, residuals) = moved_by(&parameters);
    let by_x =
        [noise_w.tr_mul(&prediction.field_direction), noise_w.tr_mul(&prediction.inclination_derivative_by_field)];
    let [roll, pitch] = prediction.inclination_derivatives_by_attitude(&tilt);
    let attitude = (0.015_f32.powi(2) - 1e-4) * (roll * roll + pitch * pitch);
    let element = |i: usize, j: usize| by_x[i].dot(&by_x[j]) * 1e-4 + if (i, j) == (1, 1) { attitude } else { 0.0 };
    let inverse =
        nalgebra::Matrix2::new(element(0, 0), element(0, 1), element(1, 0), element(1, 1)).try_inverse().unwrap();
    let [norm, inclination] = (inverse * nalgebra::Vector2::new(residuals.norm, residuals.inclination_rad)).into();
    let expected = (by_x[0] * norm + by_x[1] * inclination) * 1e-4;
    assert!((found - expected).norm() < 1e-3 * expected.norm(), "{found} {expected}");

    parameters.inclination_rad -= 1.0;
    let (found, _, residuals) = moved_by(&parameters);
    let slope = element(0, 1) / element(0, 0);
    let left = element(1, 1) - slope * element(0, 1);
    let inclination_multiplier = 2.0 / left.sqrt();
    let expected = (by_x[0] * (residuals.norm / element(0, 0) - slope * inclination_multiplier)
        + by_x[1] * inclination_multiplier)
        * 1e-4;
    assert!((found - expected).norm() < 1e-3 * expected.norm(), "{found} {expected}");
}

#[test]
fn heading_variance_is_the_sum_of_reference_and_sensor_variance() {
    let parameters =
        ModelParameters { w: Matrix3::identity(), corrected_mean_field: Vector3::zeros(), inclination_rad: 0.9 };
    let tilt = RollPitch::from_deg(10.0, 0.0).tilt_rotation();
    let x = parameters.expected_field(&tilt, 0.7).unwrap();
    let measured = MeasuredSample { centred_field: x, tilt_rotation: tilt, heading_rad: Some(0.69) };
    for noise in [NoiseModel::new(1e-6, 1e-6, Matrix3::identity()), NoiseModel::new(0.01, 0.02, Matrix3::identity())] {
        let prediction = parameters.predict_field(x, &tilt);
        let measured_variance = noise.heading_variance(&prediction.heading_derivative_by_field(&tilt), &prediction);
        let equation = SampleEquations::new(&parameters, &measured, &noise, &ModelConfig::DEFAULT, false)
            .heading_equation
            .unwrap();
        assert!((equation.residual - 0.01).abs() < 1e-5);
        assert!(
            is_close(1.0 / equation.weight, 0.0175 * 0.0175 + measured_variance),
            "{} {measured_variance}",
            1.0 / equation.weight
        );
    }
}
