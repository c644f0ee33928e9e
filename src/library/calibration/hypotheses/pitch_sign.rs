//! Pitch of the wrong sign.
//!
//! The unknown of a [score test](super::score_test) is the true over the reported pitch, less one: -2. Noise of the
//! reports raises it, or lowers that of the right sign, which is -0.15 to 0 in 300 simulated flights. Of planes and VTOLs
//! with the wrong sign it is -1.84 or less, with 3.5 sigmas or more.

use super::attitude_error::{AttitudeError, find_significant_error};

/// Pitch of the wrong sign in the table of attitude errors.
pub(super) const PITCH_SIGN_ERROR: AttitudeError = AttitudeError {
    attitude_derivative: |state| [0.0, state.attitude.pitch_rad],
    assumed_sigma: |_| 0.0,
    significance_test: Some(|test| {
        find_significant_error(test, MIN_SIGNIFICANCE_SIGMAS).filter(|finding| finding.estimate < MAX_ESTIMATE)
    }),
};

/// Minimum significance, sigmas.
const MIN_SIGNIFICANCE_SIGMAS: f32 = 3.0;

/// Largest estimate of a wrong sign: half way between it and reports that are noise alone, -1.
const MAX_ESTIMATE: f32 = -1.5;
