//! What is known of an airframe before any sample of it.
//!
//! Weak priors that let thin data shrink towards no correction. Each is an equation like those of the samples, with the
//! standard deviations of [`Config`](super::Config). Liu 2007 has no priors; these are chosen for the airframes of
//! UAVs.

use super::unknowns::{INCLINATION, Row, Vector13, d, w};
use super::{Likelihood, Parameters};
use crate::calibration::inverse;

/// What is known beforehand, as an equation: `row . change` is `-residual`, give or take `sigma`.
#[derive(Clone, Debug)]
pub(in crate::calibration) struct PriorEquation {
    /// Derivative of the residual by the unknowns.
    pub row: Vector13,
    /// How far the unknowns are from what is expected.
    pub residual: f32,
    /// Standard deviation of the residual.
    pub sigma: f32,
    /// What it is about.
    pub of: Quantity,
}

/// What a prior is about, in the axes of the mount.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::calibration) enum Quantity {
    /// The symmetric part of `W`, less its scale.
    SoftIron,
    /// The skew part of `W`.
    Mounting,
    /// `b`.
    HardIron,
    /// `I`.
    Inclination,
}

impl Quantity {
    /// How many there are.
    pub const COUNT: usize = 4;
}

/// Wider than all inclinations there are, radians: keeps the system regular where nothing is known of it.
const ANY_INCLINATION_RAD: f32 = 10.0;

/// The priors, one after the other, at a set of parameters.
pub(in crate::calibration) fn for_each_prior(
    likelihood: &Likelihood,
    parameters: &Parameters,
    each: &mut dyn FnMut(&PriorEquation),
) {
    iron_and_mounting(likelihood, parameters, each);
    hard_iron(likelihood, parameters, each);
    inclination(likelihood, parameters, each);
}

/// On the parts of `W` that are not its scale, which is left free:
///
/// | residual | derivative by `W` |
/// |---|---|
/// | soft iron, `(W_ij + W_ji) / 2` | 1/2 by `W_ij` and `W_ji` |
/// | mounting, `(W_ij - W_ji) / 2`: to first order the angle about the third axis | 1/2 by `W_ij`, -1/2 by `W_ji` |
/// | soft iron, `W_ii - trace(W) / 3` | 1 by `W_ii`, -1/3 by each of the diagonal |
fn iron_and_mounting(likelihood: &Likelihood, parameters: &Parameters, each: &mut dyn FnMut(&PriorEquation)) {
    let config = &likelihood.config;
    for (i, j) in [(0, 1), (0, 2), (1, 2)] {
        let (ij, ji) = (parameters.w[(i, j)], parameters.w[(j, i)]);
        let (by_ij, by_ji) = (unit(w(i, j), 0.5), unit(w(j, i), 0.5));
        let (residual, sigma) = (ij.midpoint(ji), config.soft_iron_sigma);
        each(&PriorEquation { row: by_ij + by_ji, residual, sigma, of: Quantity::SoftIron });
        let (residual, sigma) = ((ij - ji) / 2.0, config.mounting_sigma);
        each(&PriorEquation { row: by_ij - by_ji, residual, sigma, of: Quantity::Mounting });
    }
    let third_of_trace = (0..3).map(|i| unit(w(i, i), 1.0 / 3.0)).sum::<Vector13>();
    for i in 0..3 {
        let row = unit(w(i, i), 1.0) - third_of_trace;
        let residual = parameters.w[(i, i)] - parameters.w.trace() / 3.0;
        each(&PriorEquation { row, residual, sigma: config.soft_iron_sigma, of: Quantity::SoftIron });
    }
}

/// On each component of the hard iron, `b = mean - W^-1 d`. A change of it is `W^-1 dW W^-1 d - W^-1 dd`: with `k` for
/// a row of `W^-1`, `k (W^-1 d)^T` by `W`, `-k` by `d`. Without an inverse there is no `b`, and nothing to be known of
/// it.
fn hard_iron(likelihood: &Likelihood, parameters: &Parameters, each: &mut dyn FnMut(&PriorEquation)) {
    let Some(field_from_body) = inverse(&parameters.w) else { return };
    let from_b = field_from_body * parameters.d;
    let sigma = likelihood.config.hard_iron_sigma_ut / likelihood.unit_ut;
    for i in 0..3 {
        let k = field_from_body.row(i).transpose();
        let mut row = Row { by_field: k, x: from_b, by_inclination: 0.0 }.dense();
        for axis in 0..3 {
            row[d(axis)] = -k[axis];
        }
        let residual = likelihood.mean[i] - from_b[i];
        each(&PriorEquation { row, residual, sigma, of: Quantity::HardIron });
    }
}

/// On the inclination, `I` less the known one, where it is known: 1 by `I`.
fn inclination(likelihood: &Likelihood, parameters: &Parameters, each: &mut dyn FnMut(&PriorEquation)) {
    let known = likelihood.known_inclination_rad.map(|known| (known, likelihood.config.known_inclination_sigma_rad));
    let (value_rad, sigma) = known.unwrap_or((0.0, ANY_INCLINATION_RAD));
    let residual = parameters.inclination_rad - value_rad;
    each(&PriorEquation { row: unit(INCLINATION, 1.0), residual, sigma, of: Quantity::Inclination });
}

/// All unknowns zero but one.
pub(super) fn unit(index: usize, value: f32) -> Vector13 {
    let mut vector = Vector13::zeros();
    vector[index] = value;
    vector
}
