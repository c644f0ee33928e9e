//! Lean of the attitude source with a time constant: a finding.
//!
//! A filter that trusts its accelerometers loses bank in long turns, because gravity and centripetal acceleration give
//! none: the missing bank approaches a share of the bank (M. Euston et al., "A Complementary Filter for Attitude
//! Estimation of a Fixed-Wing UAV", IROS 2008, section IV). In the steady turn it acts like soft iron; the first
//! seconds of each turn show it. The share is the unknown of a [score test](super::score_test).
//!
//! A lean of 12 % with 10 s has 4 to 8 sigmas in simulated calibrations, 60 flights without one have at most 3; time
//! constants of 5 and 20 s are found with the same model.

use super::attitude_error::{AttitudeError, AttitudeErrorFinding, AttitudeErrorTest};
use crate::time::WrappingMillis;
use crate::trig::sqrt;

/// Lagging lean in the table of attitude errors.
pub(super) const LAGGING_LEAN: AttitudeError =
    AttitudeError { effect: |state| [state.lagged_roll_rad, 0.0], assumed_sigma: |_| 0.0, test: Some(find_error) };

/// Time constant of filters aided by accelerometers, seconds.
const TIME_CONSTANT_S: f32 = 10.0;

/// Minimum significance for which the expected error allows, sigmas.
const MIN_SIGMAS: f32 = 2.5;

/// Minimum significance of a reported error, sigmas.
pub(in crate::calibration) const MIN_REPORTED_SIGMAS: f32 = 3.0;

/// Share of the bank that the source loses in a long turn, if significant.
fn find_error(test: &AttitudeErrorTest<'_>) -> Option<AttitudeErrorFinding> {
    let score = test.sums.eliminate(test.system, &test.system.step_to_maximum()?)?;
    let estimate = score.gradient.x / score.information.x;
    let sigma = sqrt(test.residuals.autocorrelation_inflation() / score.information.x);
    (estimate.abs() > MIN_SIGMAS * sigma).then_some(AttitudeErrorFinding {
        estimate,
        significance_sigmas: estimate.abs() / sigma,
        excess_square: estimate * estimate,
    })
}

/// Reported roll through a low pass with the time constant of the lean.
#[derive(Clone, Copy, Debug, Default)]
pub(in crate::calibration) struct LaggedRoll {
    lagged_rad: f32,
    last: Option<(WrappingMillis, f32)>,
}

impl LaggedRoll {
    /// Lagged roll at the next sample in order of time, radians; zero at the first.
    pub fn update(&mut self, time: WrappingMillis, roll_rad: f32) -> f32 {
        if let Some((before, before_rad)) = self.last.replace((time, roll_rad)) {
            let step_s = time.ms_since(before) as f32 / 1000.0;
            let mean_rad = 0.5 * (roll_rad + before_rad);
            self.lagged_rad += (mean_rad - self.lagged_rad) * step_s / (TIME_CONSTANT_S + step_s);
        }
        self.lagged_rad
    }
}
