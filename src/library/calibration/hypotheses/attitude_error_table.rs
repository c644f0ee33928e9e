//! Table of the constant errors of the attitude source. Each is a consider state; some are tested by their score.
//!
//! A new hypothesis is an [`AttitudeError`] with, if tested, its significance test, and a row at the end of the table.

use core::array;

use nalgebra::Vector1;

use super::attitude_error::{AttitudeError, AttitudeState, find_significant_error};
use super::score_test::ScoreTest;
use super::{attitude_latency, bank_scale};
use crate::calibration::model::SampleEquations;
use crate::calibration::types::quality::{AttitudeLatency, ConsiderSigmas};
use crate::time::WrappingMillis;

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
    LAGGING_BANK_SCALE_ERROR,
    ROLL_DRIFT,
    PITCH_DRIFT,
    PITCH_SIGN_ERROR,
    AttitudeError {
        attitude_derivative: |state| [state.attitude.pitch_rad, 0.0],
        assumed_sigma: |consider_sigmas| consider_sigmas.cross_axis,
        significance_test: None,
    },
    AttitudeError {
        attitude_derivative: |state| [0.0, state.attitude.roll_rad],
        assumed_sigma: |consider_sigmas| consider_sigmas.cross_axis,
        significance_test: None,
    },
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

/// Bank-angle scale error of the attitude source with a time constant: a finding.
///
/// A filter that trusts its accelerometers loses bank in long turns, because gravity and centripetal acceleration give
/// none: the missing bank approaches a share of the bank (M. Euston et al., "A Complementary Filter for Attitude
/// Estimation of a Fixed-Wing UAV", IROS 2008, section IV). In the steady turn it acts like soft iron; the first
/// seconds of each turn show it. The share is the unknown of a [score test](super::score_test).
///
/// An error of 12 % with 10 s has 4 to 8 sigmas in simulated calibrations, 60 flights without an error have at most 3;
/// time constants of 5 and 20 s are found with the same model.
pub(super) const LAGGING_BANK_SCALE_ERROR: AttitudeError = AttitudeError {
    attitude_derivative: |state| [state.lagged_roll_rad, 0.0],
    assumed_sigma: |_| 0.0,
    significance_test: Some(|test| find_significant_error(test, LAGGING_MIN_SIGMAS)),
};

/// Time constant of filters aided by accelerometers, seconds.
const LAG_TIME_CONSTANT_S: f32 = 10.0;

/// Minimum significance for which the expected error allows, sigmas.
const LAGGING_MIN_SIGMAS: f32 = 2.5;

/// Minimum significance of a reported error, sigmas.
pub(in crate::calibration) const MIN_REPORTED_SIGMAS: f32 = 3.0;

/// Reported roll after a low-pass filter with the time constant of the error.
#[derive(Clone, Copy, Debug, Default)]
pub(in crate::calibration) struct LaggedRoll {
    lagged_rad: f32,
    last_sample: Option<(WrappingMillis, f32)>,
}

impl LaggedRoll {
    /// Lagged roll at the next sample in order of time, radians; zero at the first.
    pub fn filter_roll(&mut self, time: WrappingMillis, roll_rad: f32) -> f32 {
        if let Some((last_time, last_roll_rad)) = self.last_sample.replace((time, roll_rad)) {
            let step_s = time.ms_since(last_time) as f32 / 1000.0;
            let mean_rad = 0.5 * (roll_rad + last_roll_rad);
            self.lagged_rad += (mean_rad - self.lagged_rad) * step_s / (LAG_TIME_CONSTANT_S + step_s);
        }
        self.lagged_rad
    }
}

/// Minimum significance, sigmas.
const DRIFT_MIN_SIGMAS: f32 = 3.5;

/// Drift of the roll.
pub(super) const ROLL_DRIFT: AttitudeError = attitude_drift(|state| [state.centred_flight_fraction, 0.0]);
/// Drift of the pitch.
pub(super) const PITCH_DRIFT: AttitudeError = attitude_drift(|state| [0.0, state.centred_flight_fraction]);

/// Drift of roll and pitch during the flight, as of a source whose accelerometers warm.
///
/// A constant error of the attitude cancels in use, a part of it shows in no samples. A drift gives turns of one side
/// another error than those of the other, which acts as soft iron; within a side it shows. The unknown of a
/// [score test](super::score_test) is the change from the first to the last sample. In 300 simulated flights without a
/// drift one in a hundred has 3 sigmas, of those with 3 deg half have 4 and more in one axis.
const fn attitude_drift(attitude_derivative: fn(&AttitudeState) -> [f32; 2]) -> AttitudeError {
    AttitudeError {
        attitude_derivative,
        assumed_sigma: |_| 0.0,
        significance_test: Some(|test| find_significant_error(test, DRIFT_MIN_SIGMAS)),
    }
}

/// Pitch of the wrong sign.
///
/// The unknown of a [score test](super::score_test) is the true over the reported pitch, less one: -2. Noise of the
/// reports raises it, or lowers that of the right sign, which is -0.15 to 0 in 300 simulated flights. Of planes and VTOLs
/// with the wrong sign it is -1.84 or less, with 3.5 sigmas or more.
pub(super) const PITCH_SIGN_ERROR: AttitudeError = AttitudeError {
    attitude_derivative: |state| [0.0, state.attitude.pitch_rad],
    assumed_sigma: |_| 0.0,
    significance_test: Some(|test| {
        find_significant_error(test, PITCH_SIGN_MIN_SIGMAS).filter(|finding| finding.estimate < MAX_PITCH_SIGN_ESTIMATE)
    }),
};

/// Minimum significance, sigmas.
const PITCH_SIGN_MIN_SIGMAS: f32 = 3.0;

/// Largest estimate of a wrong sign: half way between it and reports that are noise alone, -1.
const MAX_PITCH_SIGN_ESTIMATE: f32 = -1.5;

#[cfg(test)]
mod lagging_bank_scale_tests {
    use super::*;

    /// `1 - 1/e` of a constant bank after 10 s, on either side; to 3 % at samples 0.5 s apart.
    #[test]
    fn roll_lags_by_ten_seconds() {
        for bank_rad in [0.5_f32, -0.5] {
            let mut lagged = LaggedRoll::default();
            assert_eq!(lagged.filter_roll(WrappingMillis::new(0), bank_rad).to_bits(), 0);
            let after_ten_s =
                (1..=20).map(|step| lagged.filter_roll(WrappingMillis::new(step * 500), bank_rad)).last().unwrap();
            assert!((after_ten_s / bank_rad - 0.632).abs() < 0.02);
        }
    }
}
