//! Attitude latency beyond the nominal latency of the attitude source.
//!
//! Attitude that is `tau` too old has a roll of `phi - tau phi'` and a pitch of `theta - tau theta'`, which shows only
//! when they vary. So `tau` is a fourteenth unknown for samples with rates: the derivative of the inclination is
//! `cos theta (l_y / h) phi' - (l_x / h) theta'`, with `l` the level field and `h` its horizontal part. Its prior sigma
//! is 0.1 s.
//!
//! `tau` is not part of the search but estimated from its result by the [score test](super::score_test): `tau = U / S`.
//! If `tau` is significant, the attitudes are extrapolated by it and the search continues.
//!
//! Residuals and rates of neighbouring samples are correlated, so the variance of `U` is inflated by
//! `(1 + rho) / (1 - rho)`, with `rho` the lag-1 autocorrelation of the contributions to `U`.

use super::attitude_error::AttitudeError;
use super::score_test::{EfficientScore, ScoreTest};
use crate::calibration::statistics::residuals::Autocorrelation;
use crate::calibration::types::quality::AttitudeLatency;
use crate::trig::sqrt;

/// Attitude latency in the table of attitude errors. The sigma is estimated, and the latency corrected rather than
/// allowed for.
pub(super) const LATENCY_ERROR: AttitudeError = AttitudeError {
    attitude_derivative: |state| [state.rates.roll_rad_s(), state.rates.pitch_rad_s()],
    assumed_sigma: |_| 0.0,
    significance_test: None,
};

/// Prior sigma of the latency, seconds.
const PRIOR_SIGMA_S: f32 = 0.1;

/// Maximum sigma for a latency to be applied, seconds.
const MAX_SIGMA_S: f32 = 0.015;

/// Minimum significance for a latency to be applied, sigmas.
const MIN_SIGNIFICANCE_SIGMAS: f32 = 3.0;

/// Maximum sigma for a first try, seconds. An uncorrected latency increases the residuals and so its own sigma.
const MAX_TRIAL_SIGMA_S: f32 = 2.0 * MAX_SIGMA_S;

/// Deviation from the estimate above which the applied latency is updated, sigmas.
const CONVERGED_SIGMAS: f32 = 0.5;

/// Maximum number of updates; the first leaves a few per cent, by nonlinearity.
pub(in crate::calibration) const MAX_UPDATES: u8 = 2;

impl AttitudeLatency {
    /// Maximum-likelihood latency and its sigma, with `applied_s` applied. `contributions`: of the samples to `U`. `None`
    /// without rates or if not finite.
    pub(in crate::calibration) fn estimate_latency(
        sums: &ScoreTest<1>,
        score: &EfficientScore<1>,
        contributions: &Autocorrelation,
        applied_s: f32,
    ) -> Option<Self> {
        let prior = 1.0 / (PRIOR_SIGMA_S * PRIOR_SIGMA_S);
        let sample_information = score.information.x.max(0.0);
        let total_information = sample_information + prior;
        let [excess_variance_inflation, _] = contributions.excess_variance_inflation();
        let found_s = applied_s + (score.gradient.x - prior * applied_s) / total_information;
        let sigma_s = sqrt(sample_information * (1.0 + excess_variance_inflation) + prior) / total_information;
        (sums.information.x > 0.0 && (found_s + sigma_s).is_finite()).then_some(Self { estimate_s: found_s, sigma_s })
    }

    const fn is_applicable(self) -> bool {
        self.sigma_s < MAX_SIGMA_S && self.is_significant()
    }

    const fn is_significant(self) -> bool {
        self.estimate_s.abs() > MIN_SIGNIFICANCE_SIGMAS * self.sigma_s
    }

    /// Next latency after `update_count` updates, seconds; `None` if `applied_s` is final. A latency that turns out
    /// useless is reset to 0.
    pub(in crate::calibration) fn next_latency_s(self, applied_s: f32, update_count: u8) -> Option<f32> {
        if update_count == 0 {
            return (self.sigma_s < MAX_TRIAL_SIGMA_S && self.is_significant()).then_some(self.estimate_s);
        }
        if applied_s == 0.0 {
            return None;
        }
        if !self.is_applicable() {
            return Some(0.0);
        }
        let needs_update = (self.estimate_s - applied_s).abs() > CONVERGED_SIGMAS * self.sigma_s;
        (needs_update && update_count < MAX_UPDATES).then_some(self.estimate_s)
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector1;

    use super::*;
    use crate::calibration::model::Vector13;

    /// The prior is of the whole latency, whatever part of it is applied.
    #[test]
    fn the_prior_pulls_an_applied_latency_towards_zero() {
        let (information, gradient) = (Vector1::new(300.0), Vector1::new(10.0));
        let sums = ScoreTest { information, gradient, ..ScoreTest::zero() };
        let score = EfficientScore { nuisance_columns: [Vector13::zeros()], information, gradient };
        for (applied_s, expected_s) in [(0.0, 0.025), (0.05, 0.0625)] {
            let found = AttitudeLatency::estimate_latency(&sums, &score, &Autocorrelation::default(), applied_s);
            let estimate_s = found.unwrap().estimate_s;
            assert!((estimate_s - expected_s).abs() < 1e-6, "{applied_s}: {estimate_s}");
        }
    }

    /// Certain to 15 ms, of three sigma; tried up to twice that sigma, because a latency increases its own sigma.
    #[test]
    fn only_certain_and_significant_latencies_are_applied() {
        for (name, found_s, sigma_s, at_first, later) in [
            ("certain", 0.1, 0.005, true, true),
            ("certain enough to try", 0.1, 0.025, true, false),
            ("uncertain", 0.2, 0.05, false, false),
            ("insignificant", 0.02, 0.01, false, false),
            ("not a number", f32::NAN, 0.01, false, false),
        ] {
            for found_s in [found_s, -found_s] {
                let latency = AttitudeLatency { estimate_s: found_s, sigma_s };
                assert_eq!(latency.next_latency_s(0.0, 0), at_first.then_some(found_s), "{name}");
                assert_eq!(latency.next_latency_s(found_s, 1), (!later).then_some(0.0), "{name}");
                assert_eq!((latency.next_latency_s(0.0, 1), latency.next_latency_s(0.0, 2)), (None, None), "{name}");
            }
        }
    }

    #[test]
    fn an_inaccurate_latency_is_updated_once() {
        let latency = AttitudeLatency { estimate_s: -0.04, sigma_s: 0.01 };
        for (used_s, is_off) in [(-0.02, true), (-0.039, false), (-0.041, false), (-0.06, true)] {
            assert_eq!(latency.next_latency_s(used_s, 1), is_off.then_some(-0.04), "{used_s}");
            assert_eq!(latency.next_latency_s(used_s, MAX_UPDATES), None);
        }
    }
}
