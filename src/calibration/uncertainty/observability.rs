//! Observability: whether the samples determine the inclination, and which quantities rest on priors alone.

use super::information::Information;
use crate::calibration::fit::linearised_problem::LinearisedProblem;
use crate::calibration::hypotheses::attitude_error_table::AttitudeErrorSigmas;
use crate::calibration::model::{
    INCLINATION_INDEX, Likelihood, ModelParameters, PriorQuantity, Vector13, for_each_prior,
};

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
    let of_all = column[INCLINATION_INDEX];
    let found_rad = unknowns[INCLINATION_INDEX];
    let (share, own_rad) = match likelihood.known_inclination_rad {
        None => (1.0, found_rad),
        Some(known_rad) => {
            let known = likelihood.config.known_inclination_sigma_rad * likelihood.config.known_inclination_sigma_rad;
            // Information adds: `1 / of_all = 1 / known + 1 / own`.
            let share = 1.0 - of_all / known;
            if share < MIN_SAMPLE_INFORMATION_SHARE {
                return None;
            }
            (share, known_rad + (found_rad - known_rad) / share)
        }
    };
    let shifts = information
        .attitude_errors
        .iter()
        .zip(sigmas)
        .map(|(error, sigma)| column.dot(&error.cross_information[0]) * sigma);
    let shifted = shifts.map(|shift| shift * shift).sum::<f32>() / (share * share);
    let variance = of_all / share * information.residuals.autocorrelation_inflation() + shifted;
    (own_rad + variance).is_finite().then_some([own_rad, variance])
}

/// Unobservable quantities: more than half of the prior sigma remains in some direction. `None` if the information
/// is singular.
pub(in crate::calibration) fn unobservable_quantities(
    system: &LinearisedProblem,
    likelihood: &Likelihood,
    unknowns: &Vector13,
) -> Option<impl Iterator<Item = PriorQuantity>> {
    let mut left = [None; PriorQuantity::PRIOR_COUNT];
    let mut determined = true;
    for_each_prior(likelihood, &ModelParameters::new(unknowns), &mut |prior| {
        let Some(column) = system.covariance_times(&prior.jacobian_row) else {
            determined = false;
            return;
        };
        if prior.jacobian_row.dot(&column) > 0.25 * prior.sigma * prior.sigma
            && let Some(slot) = left.get_mut(prior.prior_quantity as usize)
        {
            *slot = Some(prior.prior_quantity);
        }
    });
    if !determined {
        return None;
    }
    Some(left.into_iter().flatten())
}
