//! Table of the constant errors of the attitude source. Each is a consider state; some are tested by their score.
//!
//! A new hypothesis is a file with its [`AttitudeError`] and, if tested, its significance test, and a row at the end
//! of the table.

use core::array;

use nalgebra::Vector1;

use super::attitude_error::{AttitudeError, AttitudeState};
use super::score_test::ScoreTest;
use super::{attitude_drift, attitude_latency, bank_scale, lagging_bank_scale, pitch_sign};
use crate::calibration::model::SampleEquations;
use crate::calibration::types::consider_states::ConsiderSigmas;
use crate::calibration::types::quality::AttitudeLatency;

/// Constant errors of the attitude source, in the order in which they are tested.
pub(in crate::calibration) const ATTITUDE_ERRORS: &[AttitudeError] = &[
    AttitudeError {
        attitude_derivative: |_| [1.0, 0.0],
        assumed_sigma: |consider_sigmas| consider_sigmas.bias_rad,
        significance_test: None,
    },
    AttitudeError {
        attitude_derivative: |_| [0.0, 1.0],
        assumed_sigma: |consider_sigmas| consider_sigmas.bias_rad,
        significance_test: None,
    },
    bank_scale::BANK_SCALE_ERROR,
    attitude_latency::LATENCY_ERROR,
    lagging_bank_scale::LAGGING_BANK_SCALE_ERROR,
    attitude_drift::ROLL_DRIFT,
    attitude_drift::PITCH_DRIFT,
    pitch_sign::PITCH_SIGN_ERROR,
];

/// Number of attitude errors.
pub(in crate::calibration) const ATTITUDE_ERROR_COUNT: usize = ATTITUDE_ERRORS.len();
/// Index of the roll bias.
pub(in crate::calibration) const ROLL_BIAS_INDEX: usize = 0;
/// Index of the bank-angle scale error.
pub(in crate::calibration) const BANK_SCALE_INDEX: usize = 2;
/// Index of the attitude latency, whose sigma is estimated.
pub(in crate::calibration) const LATENCY_INDEX: usize = 3;
/// Index of the lagging bank-angle scale error.
pub(in crate::calibration) const LAGGING_BANK_SCALE_INDEX: usize = 4;

/// Standard deviations of all attitude errors.
pub(in crate::calibration) type AttitudeErrorSigmas = [f32; ATTITUDE_ERROR_COUNT];

/// Standard deviations of all errors before they are tested: the assumed ones, and for the latency that of its
/// estimate.
pub(in crate::calibration) fn assumed_sigmas(
    consider_sigmas: ConsiderSigmas,
    latency: Option<AttitudeLatency>,
) -> AttitudeErrorSigmas {
    let mut sigmas = array::from_fn(|index| (ATTITUDE_ERRORS[index].assumed_sigma)(consider_sigmas));
    sigmas[LATENCY_INDEX] = latency.map_or(0.0, |latency| latency.sigma_s);
    sigmas
}

/// Score-test sums of all errors, over inclination residuals.
pub(in crate::calibration) type AttitudeErrorSums = [ScoreTest<1>; ATTITUDE_ERROR_COUNT];

/// Adds the inclination residual of a sample to the sums.
pub(in crate::calibration) fn add_inclination_residual(
    sums: &mut AttitudeErrorSums,
    equations: &SampleEquations,
    state: &AttitudeState,
) {
    let Some(inclination) = &equations.inclination_equation else { return };
    for (sums, error) in sums.iter_mut().zip(ATTITUDE_ERRORS) {
        sums.add_weighted_equation(inclination, &Vector1::new(error.inclination_derivative(equations, state)), 1.0);
    }
}
