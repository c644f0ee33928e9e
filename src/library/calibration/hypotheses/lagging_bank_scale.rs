//! Bank-angle scale error of the attitude source with a time constant: a finding.
//!
//! A filter that trusts its accelerometers loses bank in long turns, because gravity and centripetal acceleration give
//! none: the missing bank approaches a share of the bank (M. Euston et al., "A Complementary Filter for Attitude
//! Estimation of a Fixed-Wing UAV", IROS 2008, section IV). In the steady turn it acts like soft iron; the first
//! seconds of each turn show it. The share is the unknown of a [score test](super::score_test).
//!
//! An error of 12 % with 10 s has 4 to 8 sigmas in simulated calibrations, 60 flights without an error have at most 3;
//! time constants of 5 and 20 s are found with the same model.

use super::attitude_error::{AttitudeError, find_significant_error};
use crate::time::WrappingMillis;

/// Lagging bank-angle scale error in the table of attitude errors.
pub(super) const LAGGING_BANK_SCALE_ERROR: AttitudeError = AttitudeError {
    attitude_derivative: |state| [state.lagged_roll_rad, 0.0],
    assumed_sigma: |_| 0.0,
    significance_test: Some(|test| find_significant_error(test, MIN_SIGNIFICANCE_SIGMAS)),
};

/// Time constant of filters aided by accelerometers, seconds.
const TIME_CONSTANT_S: f32 = 10.0;

/// Minimum significance for which the expected error allows, sigmas.
const MIN_SIGNIFICANCE_SIGMAS: f32 = 2.5;

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
            self.lagged_rad += (mean_rad - self.lagged_rad) * step_s / (TIME_CONSTANT_S + step_s);
        }
        self.lagged_rad
    }
}

#[cfg(test)]
mod tests {
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
