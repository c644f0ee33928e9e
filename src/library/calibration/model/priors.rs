//! Weak priors on the unknowns, which keep thin data close to no correction: linearised residuals with standard
//! deviations for the airframes of UAVs. Liu 2007 has no priors.

use super::likelihood::Likelihood;
use super::prediction::ModelParameters;
use super::unknowns::{INCLINATION_INDEX, JacobianRow, Vector13, corrected_mean_index, w_index};
use crate::calibration::linear_algebra::inverse;

/// Linearised prior: `row . change = -residual`, with standard deviation `sigma`.
#[derive(Clone, Debug)]
pub(in crate::calibration) struct PriorEquation {
    pub jacobian_row: Vector13,
    pub residual: f32,
    pub sigma: f32,
    pub prior_quantity: PriorQuantity,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::calibration) enum PriorQuantity {
    /// Symmetric part of `W`, without its scale.
    SoftIron,
    /// Skew part of `W`.
    Mounting,
    /// Hard iron `b`.
    HardIron,
    /// Inclination `I`.
    Inclination,
}

/// Sigma of an unknown inclination, radians: wide, keeps the information regular.
const UNKNOWN_INCLINATION_SIGMA_RAD: f32 = 10.0;

/// Calls `visit` with every prior, linearised at the parameters.
pub(in crate::calibration) fn for_each_prior(
    likelihood: &Likelihood,
    parameters: &ModelParameters,
    visit: &mut dyn FnMut(&PriorEquation),
) {
    soft_iron_and_mounting_priors(likelihood, parameters, visit);
    hard_iron_priors(likelihood, parameters, visit);
    inclination_prior(likelihood, parameters, visit);
}

/// Priors on `W` except its scale:
///
/// | residual | derivative by `W` |
/// |---|---|
/// | soft iron, `(W_ij + W_ji) / 2` | 1/2 by `W_ij` and `W_ji` |
/// | mounting, `(W_ij - W_ji) / 2`: to first order the angle about the third axis | 1/2 by `W_ij`, -1/2 by `W_ji` |
/// | soft iron, `W_ii - trace(W) / 3` | 1 by `W_ii`, -1/3 by each of the diagonal |
fn soft_iron_and_mounting_priors(
    likelihood: &Likelihood,
    parameters: &ModelParameters,
    visit: &mut dyn FnMut(&PriorEquation),
) {
    let config = &likelihood.config;
    for (i, j) in [(0, 1), (0, 2), (1, 2)] {
        let (ij, ji) = (parameters.w[(i, j)], parameters.w[(j, i)]);
        let (by_ij, by_ji) = (scaled_unit_vector(w_index(i, j), 0.5), scaled_unit_vector(w_index(j, i), 0.5));
        let (residual, sigma) = (ij.midpoint(ji), config.soft_iron_sigma);
        visit(&PriorEquation { jacobian_row: by_ij + by_ji, residual, sigma, prior_quantity: PriorQuantity::SoftIron });
        let (residual, sigma) = ((ij - ji) / 2.0, config.mounting_sigma_rad);
        visit(&PriorEquation { jacobian_row: by_ij - by_ji, residual, sigma, prior_quantity: PriorQuantity::Mounting });
    }
    let third_of_trace = (0..3).map(|i| scaled_unit_vector(w_index(i, i), 1.0 / 3.0)).sum::<Vector13>();
    for i in 0..3 {
        let row = scaled_unit_vector(w_index(i, i), 1.0) - third_of_trace;
        let residual = parameters.w[(i, i)] - parameters.w.trace() / 3.0;
        visit(&PriorEquation {
            jacobian_row: row,
            residual,
            sigma: config.soft_iron_sigma,
            prior_quantity: PriorQuantity::SoftIron,
        });
    }
}

/// Priors on the hard iron `b = mean - W^-1 d`. Its change is `W^-1 dW W^-1 d - W^-1 dd`: with `k` a row of `W^-1`,
/// `k (W^-1 d)^T` by `W` and `-k` by `d`. None if `W` is singular.
fn hard_iron_priors(likelihood: &Likelihood, parameters: &ModelParameters, visit: &mut dyn FnMut(&PriorEquation)) {
    let Some(field_from_body) = inverse(&parameters.w) else { return };
    let from_b = field_from_body * parameters.corrected_mean_field;
    let sigma = likelihood.config.hard_iron_sigma_ut / likelihood.field_unit_ut;
    for i in 0..3 {
        let k = field_from_body.row(i).transpose();
        let mut row =
            JacobianRow { derivative_by_field: k, centred_field: from_b, derivative_by_inclination: 0.0 }.as_vector();
        for axis in 0..3 {
            row[corrected_mean_index(axis)] = -k[axis];
        }
        let residual = likelihood.mean_field[i] - from_b[i];
        visit(&PriorEquation { jacobian_row: row, residual, sigma, prior_quantity: PriorQuantity::HardIron });
    }
}

fn inclination_prior(likelihood: &Likelihood, parameters: &ModelParameters, visit: &mut dyn FnMut(&PriorEquation)) {
    let given = likelihood.known_inclination_rad.map(|given| (given, likelihood.config.known_inclination_sigma_rad));
    let (value_rad, sigma) = given.unwrap_or((0.0, UNKNOWN_INCLINATION_SIGMA_RAD));
    let residual = parameters.inclination_rad - value_rad;
    visit(&PriorEquation {
        jacobian_row: scaled_unit_vector(INCLINATION_INDEX, 1.0),
        residual,
        sigma,
        prior_quantity: PriorQuantity::Inclination,
    });
}

pub(in crate::calibration) fn scaled_unit_vector(index: usize, value: f32) -> Vector13 {
    let mut vector = Vector13::zeros();
    vector[index] = value;
    vector
}
