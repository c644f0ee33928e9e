//! Observability: whether the samples determine the inclination, and which quantities rest on priors alone.

use super::information::Information;
use crate::calibration::fit::linearised_problem::LinearisedProblem;
use crate::calibration::hypotheses::attitude_error_table::AttitudeErrorSigmas;
use crate::calibration::model::{
    INCLINATION_INDEX, Likelihood, ModelParameters, PriorQuantity, Vector13, for_each_prior,
};
use crate::calibration::types::quality::UnobservableQuantities;

/// Minimum share of the inclination's information from the samples; below it, their separate estimate has no valid
/// `f32` digits.
const MIN_SAMPLE_INFORMATION_SHARE: f32 = 0.05;

/// Inclination from the samples alone, radians, with its variance: a configured inclination is removed from the
/// estimate. `None` if undetermined.
pub(in crate::calibration) fn inclination_from_samples(
    information: &Information,
    likelihood: &Likelihood,
    unknowns: &Vector13,
    sigmas: &AttitudeErrorSigmas,
) -> Option<[f32; 2]> {
    let column = information.linear_system.covariance_times(&Vector13::ith(INCLINATION_INDEX, 1.0))?;
    let total_variance = column[INCLINATION_INDEX];
    let estimate_rad = unknowns[INCLINATION_INDEX];
    let (sample_share, sample_estimate_rad) = match likelihood.known_inclination_rad {
        None => (1.0, estimate_rad),
        Some(known_rad) => {
            let given_variance =
                likelihood.config.known_inclination_sigma_rad * likelihood.config.known_inclination_sigma_rad;
            // Informations add: `1 / total_variance = 1 / given_variance + 1 / sample_variance`.
            let sample_share = 1.0 - total_variance / given_variance;
            if sample_share < MIN_SAMPLE_INFORMATION_SHARE {
                return None;
            }
            (sample_share, known_rad + (estimate_rad - known_rad) / sample_share)
        }
    };
    let shifts = information
        .attitude_error_sums
        .iter()
        .zip(sigmas)
        .map(|(error, sigma)| column.dot(&error.cross_information[0]) * sigma);
    let shifted = shifts.map(|shift| shift * shift).sum::<f32>() / (sample_share * sample_share);
    let variance = total_variance / sample_share * information.residuals.autocorrelation_inflation() + shifted;
    (sample_estimate_rad + variance).is_finite().then_some([sample_estimate_rad, variance])
}

/// Unobservable quantities: more than half of the prior sigma remains in some direction. Without the inclination, which
/// no manoeuvre improves. `None` if the information is singular.
pub(in crate::calibration) fn unobservable_quantities(
    system: &LinearisedProblem,
    likelihood: &Likelihood,
    unknowns: &Vector13,
) -> Option<UnobservableQuantities> {
    let mut unobservable = UnobservableQuantities::default();
    let mut is_regular = true;
    for_each_prior(likelihood, &ModelParameters::from_unknowns(unknowns), &mut |prior| {
        let Some(column) = system.covariance_times(&prior.jacobian_row) else {
            is_regular = false;
            return;
        };
        let is_unobservable = prior.jacobian_row.dot(&column) > 0.25 * prior.sigma * prior.sigma;
        match prior.prior_quantity {
            PriorQuantity::SoftIron => unobservable.soft_iron |= is_unobservable,
            PriorQuantity::Mounting => unobservable.mounting |= is_unobservable,
            PriorQuantity::HardIron => unobservable.hard_iron |= is_unobservable,
            PriorQuantity::Inclination => {}
        }
    });
    is_regular.then_some(unobservable)
}
