//! Drift of roll and pitch during the flight, as of a source whose accelerometers warm.
//!
//! A constant error of the attitude cancels in use, a part of it shows in no samples. A drift gives turns of one side
//! another error than those of the other, which acts as soft iron; within a side it shows. The unknown of a
//! [score test](super::score_test) is the change from the first to the last sample. In 300 simulated flights without a
//! drift one in a hundred has 3 sigmas, of those with 3 deg half have 4 and more in one axis.

use super::attitude_error::{AttitudeError, AttitudeState, find_significant_error};

/// Minimum significance, sigmas.
const MIN_SIGNIFICANCE_SIGMAS: f32 = 3.5;

/// Drift of the roll.
pub(super) const ROLL_DRIFT: AttitudeError = attitude_drift(|state| [state.centred_flight_fraction, 0.0]);
/// Drift of the pitch.
pub(super) const PITCH_DRIFT: AttitudeError = attitude_drift(|state| [0.0, state.centred_flight_fraction]);

const fn attitude_drift(attitude_derivative: fn(&AttitudeState) -> [f32; 2]) -> AttitudeError {
    AttitudeError {
        attitude_derivative,
        assumed_sigma: |_| 0.0,
        significance_test: Some(|test| find_significant_error(test, MIN_SIGNIFICANCE_SIGMAS)),
    }
}
