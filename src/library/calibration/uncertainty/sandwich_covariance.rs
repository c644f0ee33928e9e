//! Sandwich covariance of the coefficients, from the Fisher information.

use super::coefficient_covariance::{CoefficientConversion, CoefficientCovariance};
use super::information::Information;
use crate::calibration::hypotheses::attitude_error_table::AttitudeErrorSigmas;
use crate::calibration::model::{
    COEFFICIENT_COUNT, Likelihood, ModelParameters, Vector12, Vector13, beta_index, for_each_prior,
};

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::calibration) enum CovarianceContent {
    All,
    /// Errors that remain with unlimited samples of the same kind: unobservable directions, which rest on the priors,
    /// and constant errors of the attitude source.
    WithoutNoise,
}

/// Weight of turns in the mean square of an error that differs between turns and level flight: that of the banked
/// envelope, two banks of three.
const SHARE_OF_TURNS: f32 = 2.0 / 3.0;

/// Writes the covariance of the coefficients, in the units of a [`Calibration`](crate::calibration::Calibration).
/// `None` when the information is singular.
///
/// Sandwich covariance: with `H` the information, rho the lag-1 autocorrelation of each kind of residual, and
/// `x = 2 rho / (1 - rho)`, `H^-1 (H + x_incl H_incl + x_norm H_norm) H^-1`, where
/// `H_norm = H - H_incl - H_priors`. `1 + x_incl` is also multiplied by the heteroscedasticity ratio. Added are the
/// model discrepancy, as an error of the hard iron on each axis, the consider states, a detected hard-iron change, the
/// error of the motor-current interference, and the square of the remaining step to the maximum likelihood (zero after a
/// refinement; the error of a closed form).
///
/// An output parameter, because a returned value would exist several times on the stack.
#[inline(never)]
pub(in crate::calibration) fn sandwich_covariance(
    information: &Information,
    likelihood: &Likelihood,
    unknowns: &Vector13,
    (errors, sigmas): (CovarianceContent, &AttitudeErrorSigmas),
    covariance: &mut CoefficientCovariance,
) -> Option<()> {
    let units = CoefficientConversion::new(likelihood, unknowns)?;
    // `H^-1` times the Jacobian row of each coefficient: 12 of 13 columns instead of a 13x13 inverse.
    let mut columns = [Vector13::zeros(); COEFFICIENT_COUNT];
    for (i, column) in columns.iter_mut().enumerate() {
        *column = information.linear_system.covariance_times(&units.jacobian_row(i))?;
    }
    let [mut norm_excess, inclination_excess] = information.residuals.autocorrelation.excess_variance_inflation();
    let inclination_excess =
        (1.0 + inclination_excess) * information.residuals.heteroscedasticity.variance_ratio() - 1.0;
    let mut inflated = Vector13::zeros();
    covariance.set_lower_triangle(|i, j| {
        if errors == CovarianceContent::WithoutNoise {
            return 0.0;
        }
        if j == 0 {
            // `set_lower_triangle` visits the lower triangle row by row, so each row starts with column 0.
            inflated = units.jacobian_row(i) * (1.0 + norm_excess)
                + information.residuals.inclination_information.multiply_vector(&columns[i])
                    * (inclination_excess - norm_excess);
        }
        inflated.dot(&columns[j])
    });
    if errors == CovarianceContent::WithoutNoise {
        // With -1, the noise term is zero, and the loop over the priors adds the prior term `H^-1 H_priors H^-1`.
        norm_excess = -1.0;
    }
    let to_coefficients = |vector: &Vector13| Vector12::from_fn(|i, _| columns[i].dot(vector));
    for_each_prior(likelihood, &ModelParameters::from_unknowns(unknowns), &mut |prior| {
        covariance.add_outer_product(&to_coefficients(&prior.jacobian_row), -norm_excess / (prior.sigma * prior.sigma));
    });
    let field_variance = information.residuals.discrepancy.field_variance(&likelihood.noise);
    for axis in 0..3 {
        covariance.add_outer_product(&Vector12::ith(beta_index(axis), 1.0), field_variance);
    }
    for (error, sigma) in information.attitude_error_sums.iter().zip(sigmas) {
        covariance.add_outer_product(&to_coefficients(&error.cross_information[0]), sigma * sigma);
    }
    let error_in_level_flight = to_coefficients(&information.hard_iron_change.gradient);
    let mut error_in_turns = error_in_level_flight;
    for axis in 0..3 {
        error_in_turns[beta_index(axis)] -= information.hard_iron_change.added_in_turns[axis];
    }
    covariance.add_outer_product(&error_in_level_flight, 1.0 - SHARE_OF_TURNS);
    covariance.add_outer_product(&error_in_turns, SHARE_OF_TURNS);
    let per_ampere = ModelParameters::from_unknowns(unknowns).w;
    for error in &information.interference_error_factors {
        covariance.add_outer_product(&to_coefficients(&information.motor_current_sums.gradient_effect(error)), 1.0);
        // The unknowns follow an interference error at the mean current. One standard deviation from the mean, it
        // adds a hard-iron error.
        let excess_error = per_ampere * error * likelihood.motor_current.current_sigma_a;
        let mut coefficients = Vector12::zeros();
        for axis in 0..3 {
            coefficients[beta_index(axis)] = excess_error[axis];
        }
        covariance.add_outer_product(&coefficients, 1.0);
    }
    let change = information.linear_system.step_to_maximum()?;
    covariance.add_outer_product(&Vector12::from_fn(|i, _| units.jacobian_row(i).dot(&change)), 1.0);
    covariance.is_finite().then_some(())
}
