//! Unit tests of information, covariance and observability.

use nalgebra::{Matrix3, SMatrix, SVector, Vector1, Vector3};

use super::coefficient_covariance::{CoefficientConversion, CoefficientCovariance};
use super::heading_uncertainty::heading_uncertainty;
use super::information::Information;
use super::observability::{inclination_from_samples, unobservable_quantities};
use super::sandwich_covariance::{CovarianceContent, sandwich_covariance};
use crate::calibration::fit::linearised_problem::LinearisedProblem;
use crate::calibration::hypotheses::attitude_error_table::{
    ATTITUDE_ERROR_COUNT, AttitudeErrorSigmas, BANK_SCALE_INDEX, LATENCY_INDEX, assumed_sigmas,
};
use crate::calibration::hypotheses::hard_iron_change::{HardIronChangeEffect, derivative_by_hard_iron};
use crate::calibration::hypotheses::motor_current::InterferenceEstimate;
use crate::calibration::model::{
    COEFFICIENT_COUNT, INCLINATION_INDEX, JacobianRow, Likelihood, Matrix13, ModelConfig, ModelParameters, NoiseModel,
    PriorQuantity, ResidualEquation, UNKNOWN_COUNT, Vector12, Vector13, beta_index, for_each_prior,
};
use crate::calibration::tests::derivatives::assert_derivative;
use crate::calibration::{
    AttitudeLatency, Calibration, ConsiderSigmas, LeastSquares, Orientation, Prior, Samples, UnobservableQuantities,
};

type Matrix12 = SMatrix<f32, 12, 12>;

const TRUE_W: Matrix3<f32> = Matrix3::new(1.2, 0.1, -0.2, 0.3, 0.9, 0.1, -0.1, 0.2, 1.1);

fn parameters() -> ModelParameters {
    ModelParameters { w: TRUE_W, corrected_mean_field: Vector3::new(0.2, -0.4, 0.6), inclination_rad: 0.7 }
}

fn likelihood(prior: &Prior, config: ModelConfig) -> Likelihood {
    let mut likelihood = Likelihood::new(prior, config, Samples::default(), 40.0);
    likelihood.mean_field = Vector3::new(0.3, -0.8, 0.5);
    likelihood
}

fn prior_information(likelihood: &Likelihood, unknowns: &Vector13) -> Information {
    Information::new(&LinearisedProblem::from_priors(likelihood, unknowns))
}

/// Numerical derivatives in units of the total field before the step: `W F / F'` and `beta = W (b' - b) / F`.
#[test]
fn jacobian_rows_equal_numerical_derivatives() {
    for mount in ["none", "yaw90", "roll90-pitch180-yaw90"] {
        let prior = Prior { mount: Orientation::from_name(mount).unwrap(), ..Prior::default() };
        let likelihood = likelihood(&prior, ModelConfig::DEFAULT);
        let at = parameters().unknowns().unwrap();
        let units = CoefficientConversion::new(&likelihood, &at).unwrap();
        let before = likelihood.calibration(&at).unwrap();
        let coefficient = |calibration: &Calibration, i: usize| match (i / 3, i % 3) {
            (row @ 0..3, column) => calibration.w[row][column] * before.total_ut / calibration.total_ut,
            (_, axis) => {
                let moved = (calibration.b_vector_ut() - before.b_vector_ut()) / before.total_ut;
                (before.w_matrix() * moved)[axis]
            }
        };
        for i in 0..COEFFICIENT_COUNT {
            let row = units.jacobian_row(i);
            for j in 0..UNKNOWN_COUNT {
                let moved = |step: f32| {
                    let mut unknowns = at;
                    unknowns[j] += step;
                    coefficient(&likelihood.calibration(&unknowns).unwrap(), i)
                };
                assert_derivative(row[j], moved, &format!("coefficient {i} by unknown {j}, {mount}"));
            }
        }
    }
}

/// Norm residuals with a lag-1 autocorrelation of 1/2, which triples their variance.
const CORRELATED_RESIDUALS: [f32; 3] = [1.0, 1.0, 0.0];

fn uniform_information(likelihood: &Likelihood, unknowns: &Vector13, weight: f32) -> Information {
    let mut information = prior_information(likelihood, unknowns);
    for i in 0..UNKNOWN_COUNT {
        information.linear_system.add_row(&Vector13::ith(i, 1.0), 0.0, weight);
    }
    information
}

/// Full covariance matrix from `cov(a, b) = (var(a + b) - var(a) - var(b)) / 2`.
fn full_covariance(
    information: &Information,
    likelihood: &Likelihood,
    at: &Vector13,
    sigmas: &AttitudeErrorSigmas,
) -> Matrix12 {
    let mut covariance = CoefficientCovariance::ZERO;
    sandwich_covariance(information, likelihood, at, (CovarianceContent::All, sigmas), &mut covariance).unwrap();
    let unit_vector = |i: usize| Vector12::ith(i, 1.0);
    let variance_of = |row: Vector12| covariance.variance(&row);
    Matrix12::from_fn(|i, j| {
        (variance_of(unit_vector(i) + unit_vector(j)) - variance_of(unit_vector(i)) - variance_of(unit_vector(j))) / 2.0
    })
}

#[test]
fn covariance_is_the_sum_of_its_terms() {
    let mut likelihood = likelihood(&Prior::default(), ModelConfig::DEFAULT);
    likelihood.motor_current.current_sigma_a = 10.0;
    let at = parameters().unknowns().unwrap();
    let mut information = uniform_information(&likelihood, &at, 1e4);
    let row = Vector13::from_fn(|i, _| (i as f32 * 0.7).sin());
    information.linear_system.add_row(&row, 0.05, 1e4);
    // Inflation `2 rho / (1 - rho)` of the information: 2 of the inclination residual (rho = 1/2), 1 of the norm
    // residuals (rho = 1/3).
    let inclination = JacobianRow {
        derivative_by_field: Vector3::new(1.0, -0.7, 0.5),
        centred_field: Vector3::new(0.6, 0.9, -1.1),
        derivative_by_inclination: -1.0,
    };
    let inclination_row = inclination.as_vector();
    information.linear_system.add_row(&inclination_row, 0.0, 3e3);
    information.residuals.inclination_information.add_row(&inclination, 3e3);
    for residuals in [[1.0, 1.0], [1.0, 1.0], [0.0, 0.0], [0.0, 0.0], [1.0, 1.0], [0.0, 1.0]] {
        information.residuals.autocorrelation.add_residuals(0, residuals);
    }
    information.hard_iron_change = HardIronChangeEffect {
        gradient: Vector13::from_fn(|i, _| 150.0 * (i as f32 * 0.3).cos()),
        added_in_turns: Vector3::new(0.02, -0.01, 0.015),
    };
    let derivatives: [f32; 3] = [0.2, 1.1, 2.3];
    information.motor_current_sums.cross_information =
        derivatives.map(|phase| Vector13::from_fn(|i, _| 1e5 * (i as f32 * 0.9 + phase).sin()));
    information.interference_error_factors = [[1.0, 0.4, -0.3], [0.0, 0.8, 0.5], [0.0, 0.0, 0.6], [-0.7, 0.2, 0.9]]
        .map(|error: [f32; 3]| Vector3::from(error) * 1e-3);
    for (error, phase) in information.attitude_error_sums.iter_mut().zip([0.4, 1.9, 2.8, 3.7]) {
        error.cross_information = [Vector13::from_fn(|i, _| 1e4 * (i as f32 + phase).sin())];
    }
    let units = CoefficientConversion::new(&likelihood, &at).unwrap();
    let j = SMatrix::<f32, 12, 13>::from_fn(|i, k| units.jacobian_row(i)[k]);
    let mut inverse = Matrix13::zeros();
    for k in 0..UNKNOWN_COUNT {
        inverse.set_column(k, &information.linear_system.covariance_times(&Vector13::ith(k, 1.0)).unwrap());
    }
    let g = j * inverse;
    let change = j * information.linear_system.step_to_maximum().unwrap();
    let latency = AttitudeLatency { estimate_s: 0.0, sigma_s: 0.01 };
    let consider = assumed_sigmas(ConsiderSigmas { bias_rad: 0.003, bank_scale: 0.02, cross_axis: 0.0 }, Some(latency));
    let norm = (Matrix13::identity() + row * row.transpose()) * 1e4;
    let doubted = norm + inclination_row * inclination_row.transpose() * (3e3 * 2.0);
    let mut expected = g * j.transpose() + g * doubted * g.transpose();
    let level = g * information.hard_iron_change.gradient;
    let mut in_turns = level;
    for axis in 0..3 {
        in_turns[beta_index(axis)] -= information.hard_iron_change.added_in_turns[axis];
    }
    let iron_change = (level * level.transpose() + in_turns * in_turns.transpose() * 2.0) / 3.0;
    expected += iron_change;
    expected += change * change.transpose();
    for (error, sigma) in information.attitude_error_sums.iter().zip([0.003, 0.003, 0.02, 0.01]) {
        let shift = g * error.cross_information[0] * sigma;
        expected += shift * shift.transpose();
    }
    let mut followed = Matrix12::zeros();
    let mut interference_term = Matrix12::zeros();
    for error in information.interference_error_factors {
        let [x, y, z] = information.motor_current_sums.cross_information;
        let shift = g * (x * error.x + y * error.y + z * error.z);
        followed += shift * shift.transpose();
        let mut spread = Vector12::zeros();
        for axis in 0..3 {
            spread[beta_index(axis)] = (parameters().w * error)[axis] * 10.0;
        }
        interference_term += spread * spread.transpose();
    }
    expected += followed + interference_term;
    let found = full_covariance(&information, &likelihood, &at, &consider);
    let scale = expected.diagonal().amax();
    for (f, e) in found.iter().zip(&expected) {
        assert!((f - e).abs() < 1e-4 * scale, "{found} {expected}");
    }
    let without_attitude_errors = assumed_sigmas(ConsiderSigmas::ZERO, Some(latency));
    let smaller = full_covariance(&information, &likelihood, &at, &without_attitude_errors);
    assert!(smaller.diagonal().amax() < 0.97 * scale);
    for part in [change * change.transpose(), iron_change, g * norm * g.transpose(), followed, interference_term] {
        let size = part.diagonal().amax() / scale;
        assert!(size > 0.01, "{size}");
    }
}

/// Reference: least squares of all sixteen unknowns, with the prior as three more rows, which autocorrelation does
/// not inflate. The other unknowns follow the interference.
#[test]
fn motor_current_estimate_equals_joint_least_squares() {
    let mut likelihood = likelihood(&Prior::default(), ModelConfig::DEFAULT);
    likelihood.motor_current.current_sigma_a = 10.0;
    likelihood.motor_current.ut_per_a = [0.3, -0.2, 0.25];
    let at = parameters().unknowns().unwrap();
    let mut information = uniform_information(&likelihood, &at, 1e4);
    let mut joint = LeastSquares::<16, 1>::new();
    let rows = |row: &Vector13, current_derivative: Vector3<f32>| {
        row.push(current_derivative.x).push(current_derivative.y).push(current_derivative.z)
    };
    for_each_prior(&likelihood, &parameters(), &mut |prior| {
        let row = rows(&prior.jacobian_row, Vector3::zeros());
        joint.add_weighted_row(&row, [-prior.residual], 1.0 / (prior.sigma * prior.sigma));
    });
    for i in 0..UNKNOWN_COUNT {
        joint.add_weighted_row(&SVector::ith(i, 1.0), [0.0], 1e4);
    }
    let prior = InterferenceEstimate::prior_precision(likelihood.field_unit_ut);
    for axis in 0..3 {
        let applied = likelihood.interference_per_ampere()[axis];
        joint.add_weighted_row(&SVector::ith(UNKNOWN_COUNT + axis, 1.0), [-applied], prior);
    }
    for (i, residual) in [(0, 0.02), (1, -0.01), (2, 0.015), (3, 0.005)] {
        let by_field = Vector3::from_fn(|axis, _| f32::sin(i as f32 * 2.1 + axis as f32 * 1.3));
        let row = JacobianRow {
            derivative_by_field: by_field,
            centred_field: Vector3::new(0.6, 0.9, -1.1),
            derivative_by_inclination: 0.3,
        };
        let equation = ResidualEquation::new(row, residual, 1.0 / 1e4, 1e6);
        let (current_derivative, share_a) = (derivative_by_hard_iron(&parameters().w, &equation), 1.0 + i as f32 / 2.0);
        information.motor_current_sums.add_weighted_equation(&equation, &current_derivative, share_a);
        information.linear_system.add_row(&equation.jacobian_row.as_vector(), residual, 1e4);
        let row = rows(&equation.jacobian_row.as_vector(), current_derivative * share_a);
        joint.add_weighted_row(&row, [-residual], 1e4);
    }
    for residual in CORRELATED_RESIDUALS {
        information.residuals.autocorrelation.add_residuals(0, [residual, 0.0]);
    }
    let found = information.estimate_interference(&likelihood).unwrap();
    let expected = joint.solve().unwrap();
    let (others, step) = (expected.fixed_rows::<UNKNOWN_COUNT>(0), expected.fixed_rows::<3>(UNKNOWN_COUNT));
    let found_step = found.interference_per_ampere - likelihood.interference_per_ampere();
    assert!((found_step - step).norm() < 1e-3 * step.norm(), "{found:?} {step}");
    let follow = information.step_for_interference_change(&found_step).unwrap();
    let found_others = information.linear_system.step_to_maximum().unwrap() + follow;
    assert!((found_others - others).norm() < 0.01 * others.norm(), "{found_others} {others}");
    let independent = Matrix3::from_fn(|i, j| {
        joint.covariance_times(&SVector::ith(UNKNOWN_COUNT + i, 1.0)).unwrap()[UNKNOWN_COUNT + j]
    });
    // `P (3 (P^-1 - prior) + prior) P`: rho = 1/2 triples all information but the prior's.
    let expected = independent * 3.0 - independent * independent * (2.0 * prior);
    assert!((found.covariance - expected).norm() < 2e-3 * expected.norm(), "{} {expected}", found.covariance);
    assert!((independent * 3.0 - expected).norm() > 0.1 * expected.norm());
    assert!((expected - independent).norm() > 0.1 * expected.norm());
    let [independent_significance, autocorrelated] = found.significance;
    let by_all =
        found.interference_per_ampere.dot(&(independent.try_inverse().unwrap() * found.interference_per_ampere));
    assert!((independent_significance / by_all - 1.0).abs() < 1e-2, "{found:?} {by_all}");
    assert!((independent_significance / autocorrelated - 3.0).abs() < 1e-3, "{found:?}");
    let sum: Matrix3<f32> =
        information.interference_error_factors.iter().take(3).map(|error| error * error.transpose()).sum();
    assert!((sum - found.covariance).norm() < 1e-3 * expected.norm(), "{sum}");
}

#[test]
fn latency_sigma_becomes_a_consider_state() {
    let likelihood = likelihood(&Prior::default(), ModelConfig::DEFAULT);
    let mut information = uniform_information(&likelihood, &parameters().unknowns().unwrap(), 1e4);
    assert!(information.estimate_latency(0.0).is_none());
    let row =
        JacobianRow { derivative_by_field: Vector3::x(), centred_field: Vector3::y(), derivative_by_inclination: -1.0 };
    let latency = &mut information.attitude_error_sums[LATENCY_INDEX];
    latency.add_weighted_equation(&ResidualEquation::new(row, 0.01, 1e-4, 1e6), &Vector1::new(0.5), 1.0);
    latency.cross_information = [Vector13::ith(2, 40.0)];
    let (latency, follows) = information.estimate_latency(0.0).unwrap();
    // Information: 0.25 of 1e4, less 40^2 / 1e4 explained by unknown 2, plus the prior's 100.
    assert!((latency.sigma_s * f32::sqrt(2500.0 - 0.16 + 100.0) - 1.0).abs() < 1e-4, "{latency:?}");
    assert!((follows[2] + 40.0 / 1e4).abs() < 1e-5, "{follows}");
    let sigmas = assumed_sigmas(ConsiderSigmas::DEFAULT, Some(latency));
    assert_eq!(sigmas[..=LATENCY_INDEX], [0.0035, 0.0035, 0.01, latency.sigma_s]);
    assert_eq!(assumed_sigmas(ConsiderSigmas::ZERO, None).map(f32::to_bits), [0; ATTITUDE_ERROR_COUNT]);
}

/// Samples that halve the variance of the prior alone leave it unobservable; with a tenth of it they determine it. The
/// inclination does not count.
#[test]
fn what_depends_on_the_prior_is_unobservable() {
    let likelihood = likelihood(&Prior::default(), ModelConfig::DEFAULT);
    let at = parameters().unknowns().unwrap();
    let nothing = UnobservableQuantities::default();
    for (quantity, flagged) in [
        (PriorQuantity::SoftIron, UnobservableQuantities { soft_iron: true, ..nothing }),
        (PriorQuantity::Mounting, UnobservableQuantities { mounting: true, ..nothing }),
        (PriorQuantity::HardIron, UnobservableQuantities { hard_iron: true, ..nothing }),
        (PriorQuantity::Inclination, nothing),
    ] {
        for (information_of_prior, expected) in [(1.0, flagged), (9.0, nothing)] {
            let mut information = prior_information(&likelihood, &at);
            information.linear_system.add_row(&at, 0.0, 1e6);
            for_each_prior(&likelihood, &parameters(), &mut |prior| {
                let samples_per_prior = if prior.prior_quantity == quantity { information_of_prior } else { 1e3 };
                let weight = samples_per_prior / (prior.sigma * prior.sigma);
                information.linear_system.add_row(&prior.jacobian_row, 0.0, weight);
            });
            let found = unobservable_quantities(&information.linear_system, &likelihood, &at);
            assert_eq!(found, Some(expected), "{quantity:?} {information_of_prior}");
        }
    }
}

#[test]
fn the_sensor_s_noise_is_that_of_a_single_reading() {
    let at = parameters().unknowns().unwrap();
    let per_unit = TRUE_W.determinant().cbrt();
    for (readings_per_sample, white, factor) in
        [(1, 1.0, 1.0), (8, 1.0, 8_f32.sqrt()), (0, 1.0, 1.0), (8, 0.25, 2_f32.sqrt()), (1, 0.0, 0.0)]
    {
        let mut likelihood = likelihood(&Prior { readings_per_sample, ..Prior::default() }, ModelConfig::DEFAULT);
        likelihood.noise = NoiseModel::new(0.003, 0.005, TRUE_W);
        let found = heading_uncertainty(&likelihood, &at, &CoefficientCovariance::ZERO, white).unwrap();
        let expected = 0.003 * factor * per_unit;
        let sigma = found.relative_sensor_sigma;
        assert!((sigma - expected).abs() < 1e-5 * 0.003, "{readings_per_sample}: {sigma}");
        let attitude_sigma_rad = f32::sqrt(0.005 * 0.005 - white * 0.003 * 0.003);
        assert!((found.attitude_sigma_rad - attitude_sigma_rad).abs() < 1e-6);
    }
}

#[test]
fn singular_information_has_no_covariance() {
    let likelihood = likelihood(&Prior::default(), ModelConfig::DEFAULT);
    let at = parameters().unknowns().unwrap();
    let flat = ModelParameters { w: Matrix3::zeros(), ..parameters() }.unknowns().unwrap();
    let open = prior_information(&likelihood, &flat);
    let mut covariance = CoefficientCovariance::ZERO;
    for unknowns in [&at, &flat] {
        let content = (CovarianceContent::All, &[0.0; ATTITUDE_ERROR_COUNT]);
        assert!(sandwich_covariance(&open, &likelihood, unknowns, content, &mut covariance).is_none());
    }
    assert!(unobservable_quantities(&open.linear_system, &likelihood, &at).is_none());
    assert!(heading_uncertainty(&likelihood, &flat, &CoefficientCovariance::ZERO, 1.0).is_none());
}

#[test]
fn autocorrelation_does_not_inflate_priors() {
    let likelihood = likelihood(&Prior::default(), ModelConfig::DEFAULT);
    let at = parameters().unknowns().unwrap();
    let mut information = prior_information(&likelihood, &at);
    // Direction of the overall scale of `W`, which no prior constrains.
    let scale = Vector13::from_fn(|i, _| if [0, 4, 8].contains(&i) { 1.0 } else { 0.0 });
    information.linear_system.add_row(&scale, 0.0, 1e4);
    let covariance_of =
        |information: &Information| full_covariance(information, &likelihood, &at, &[0.0; ATTITUDE_ERROR_COUNT]);
    let before = covariance_of(&information);
    for residual in CORRELATED_RESIDUALS {
        information.residuals.autocorrelation.add_residuals(0, [residual, 0.0]);
    }
    let after = covariance_of(&information);
    assert!((information.residuals.autocorrelation_inflation() - 3.0).abs() < 1e-3);
    for i in 0..COEFFICIENT_COUNT {
        assert!((after[(i, i)] / before[(i, i)] - 1.0).abs() < 0.05, "{i}: {} {}", after[(i, i)], before[(i, i)]);
    }
}

#[test]
fn configured_inclination_is_removed_from_the_estimate() {
    let known_sigma = ModelConfig::DEFAULT.known_inclination_sigma_rad;
    for (own_rad, sigma, is_shown) in [(0.75, 0.004, true), (0.6, 0.03, true), (0.9, 0.2, false)] {
        for is_configured in [true, false] {
            let prior = Prior { inclination_rad: is_configured.then_some(0.7), ..Prior::default() };
            let likelihood = likelihood(&prior, ModelConfig::DEFAULT);
            let weights = if is_configured { [known_sigma.powi(-2), f32::powi(sigma, -2)] } else { [0.0, 1.0] };
            let inclination_rad = (weights[0] * 0.7 + weights[1] * own_rad) / (weights[0] + weights[1]);
            let at = ModelParameters { inclination_rad, ..parameters() }.unknowns().unwrap();
            let mut information = prior_information(&likelihood, &at);
            for i in 0..INCLINATION_INDEX {
                information.linear_system.add_row(&Vector13::ith(i, 1.0), 0.0, 1e6);
            }
            information.linear_system.add_row(&Vector13::ith(INCLINATION_INDEX, 1.0), 0.0, 1.0 / (sigma * sigma));
            // rho = 1/2, and a gradient of 2e3 per unit of bank-angle scale error.
            for residual in CORRELATED_RESIDUALS {
                let residuals = if is_configured { [0.0, residual] } else { [residual, 0.0] };
                information.residuals.autocorrelation.add_residuals(0, residuals);
            }
            information.attitude_error_sums[BANK_SCALE_INDEX].cross_information =
                [Vector13::ith(INCLINATION_INDEX, 2e3)];
            let mut sigmas = [0.0; ATTITUDE_ERROR_COUNT];
            sigmas[BANK_SCALE_INDEX] = 0.01;
            let Some([found_rad, variance]) = inclination_from_samples(&information, &likelihood, &at, &sigmas) else {
                assert!(is_configured && !is_shown, "{own_rad} {sigma}");
                continue;
            };
            assert!(!is_configured || is_shown, "{own_rad} {sigma}");
            assert!((found_rad - own_rad).abs() < 1e-3, "{found_rad} {own_rad}");
            let shift = 2e3 * 0.01 * sigma * sigma;
            let expected = sigma * sigma * 3.0 + shift * shift;
            assert!((variance / expected - 1.0).abs() < 0.02, "{variance} {expected} {is_configured}");
        }
    }
}
