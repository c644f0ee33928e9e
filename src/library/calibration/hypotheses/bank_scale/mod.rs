//! Bank-angle scale error of the attitude source: a finding.
//!
//! A filter aided by accelerometers may read nine tenths of the bank in a turn. In steady turns that acts like soft
//! iron; only when bank varies do the inclination residuals vary with the missing bank. The relative error `k` is the
//! unknown of a [score test](super::score_test): `k = U / S`.
//!
//! Roll noise is in the derivative and in the residual, an errors-in-variables bias towards -1. Its known contribution
//! `sigma^2 sum w (d inclination / d roll)^2` is removed from `S` and `U`.
//!
//! 330 samples of turns at 25 deg give a sigma of 2 %. Correcting for `k` makes the headings of a good source worse
//! (0.12 to 0.32 deg), so it is only a finding.

use super::attitude_error::{AttitudeError, AttitudeErrorFinding, AttitudeErrorTestInput, AttitudeState};
use super::score_test::EfficientScore;
use crate::calibration::model::{ModelParameters, ResidualEquation, SampleEquations, Vector13};
use crate::calibration::types::samples::PART_COUNT;
use crate::trig::sqrt;

/// Bank-angle scale error in the table of attitude errors.
pub(super) const BANK_SCALE_ERROR: AttitudeError = AttitudeError {
    attitude_derivative: |state| [state.attitude.roll_rad, 0.0],
    assumed_sigma: |consider_sigmas| consider_sigmas.bank_scale,
    significance_test: Some(find_bank_scale_error),
};

/// Maximum share of the information about `k` that roll noise may contribute.
const MAX_ROLL_NOISE_SHARE_OF_INFORMATION: f32 = 0.5;

/// Maximum sigma of an estimate of moderate significance, relative bank.
const MAX_SIGMA: f32 = 0.05;

/// Significance above which any sigma is accepted, sigmas.
const CERTAIN_SIGMAS: f32 = 3.5;

/// Significance threshold, squared sigmas. One clean flight in 16 exceeds it.
const MIN_SIGNIFICANCE_SQUARED: f32 = 3.0;

/// Slope of the squared error to allow for, over the squared estimate above the threshold: at twice the threshold the
/// whole estimate is allowed for.
const ALLOWANCE_SLOPE: f32 = 2.0;

#[derive(Clone, Copy, Debug, PartialEq)]
struct BankScaleEstimate {
    /// Missing bank relative to the reported bank; negative if the source reports too much.
    missing_bank_share: f32,
    variance: f32,
    score_information: f32,
}

/// Finds a significant error above the assumed one. Only then makes a second pass over the samples, for the
/// cluster-robust variance.
fn find_bank_scale_error(test: &AttitudeErrorTestInput<'_>) -> Option<AttitudeErrorFinding> {
    let score = test.score_sums.eliminate_coefficients(test.linear_system, &test.linear_system.step_to_maximum()?)?;
    let roll_sigma_rad = test.fit.likelihood.noise.attitude_sigma_rad();
    let roll_noise = test.roll_information * roll_sigma_rad * roll_sigma_rad;
    let estimate = BankScaleEstimate::new(&score, roll_noise, test.residuals.autocorrelation_inflation())?;
    estimate.finding(test.assumed_sigma)?;
    let parameters = ModelParameters::from_unknowns(test.fit.unknowns);
    let mut clusters = ClusterVariance::default();
    for sample in test.fit.samples.iter() {
        let equations = test.fit.likelihood.sample_equations(sample, None, &parameters);
        let attitude = sample.latency_compensated_attitude(test.fit.likelihood.latency_s);
        let state = AttitudeState::steady_turn(attitude, sample.rates);
        let by_bank = BANK_SCALE_ERROR.inclination_derivative(&equations, &state);
        clusters.add_sample_score(sample.part.index(), &equations, by_bank, &score.nuisance_columns[0]);
    }
    estimate.with_cluster_variance(clusters)?.finding(test.assumed_sigma)
}

/// Number of consecutive samples in a cluster: six seconds of a turn.
const CLUSTER_SAMPLES: u8 = 12;

/// Cluster-robust variance of the score (K.-Y. Liang and S. L. Zeger, Biometrika 73, 1986): a disturbance of some
/// seconds, such as a power line, counts once.
#[derive(Clone, Copy, Debug, Default)]
struct ClusterVariance {
    open_clusters: [(f32, u8); PART_COUNT],
    closed_cluster_count: f32,
    cluster_sum: f32,
    cluster_squares: f32,
}

impl ClusterVariance {
    /// Adds the score of a part's next sample; `nuisance_column`: `H^-1` times the effect of the scale error on the
    /// gradient.
    fn add_sample_score(
        &mut self,
        part: usize,
        equations: &SampleEquations,
        bank_scale_derivative: f32,
        nuisance_column: &Vector13,
    ) {
        let score_of = |equation: &ResidualEquation, by_bank: f32| {
            equation.weight * equation.residual * (by_bank - equation.jacobian_row.dot(nuisance_column))
        };
        let Some((sum, samples)) = self.open_clusters.get_mut(part) else { return };
        *sum += score_of(&equations.norm_equation, 0.0)
            + equations
                .inclination_equation
                .as_ref()
                .map_or(0.0, |inclination| score_of(inclination, bank_scale_derivative));
        *samples += 1;
        if *samples == CLUSTER_SAMPLES {
            let closed_sum = core::mem::take(sum);
            *samples = 0;
            self.close_cluster(closed_sum);
        }
    }

    fn close_cluster(&mut self, sum: f32) {
        self.closed_cluster_count += 1.0;
        self.cluster_sum += sum;
        self.cluster_squares += sum * sum;
    }

    fn variance(mut self) -> f32 {
        for (sum, samples) in self.open_clusters {
            if samples > 0 {
                self.close_cluster(sum);
            }
        }
        (self.cluster_squares - self.cluster_sum * self.cluster_sum / self.closed_cluster_count)
            * self.closed_cluster_count
            / (self.closed_cluster_count - 1.0)
    }
}

impl BankScaleEstimate {
    /// The estimate. `roll_noise`: contribution of roll noise to the sums. `inflation`: variance inflation by
    /// autocorrelation. `None` when noise dominates.
    fn new(score: &EfficientScore<1>, roll_noise: f32, inflation: f32) -> Option<Self> {
        let total_information = score.information.x;
        if total_information.is_nan() || roll_noise > MAX_ROLL_NOISE_SHARE_OF_INFORMATION * total_information {
            return None;
        }
        let bank_information = total_information - roll_noise;
        let missing_bank_share = (score.gradient.x + roll_noise) / bank_information;
        let variance = total_information * inflation / (bank_information * bank_information);
        (missing_bank_share.is_finite() && variance.is_finite()).then_some(Self {
            missing_bank_share,
            variance,
            score_information: bank_information,
        })
    }

    /// Applies the cluster-robust variance if it is larger. `None` if the estimate is then too uncertain.
    fn with_cluster_variance(self, clusters: ClusterVariance) -> Option<Self> {
        let variance = self.variance.max(clusters.variance() / (self.score_information * self.score_information));
        let is_informative = variance <= MAX_SIGMA * MAX_SIGMA
            || self.missing_bank_share * self.missing_bank_share > CERTAIN_SIGMAS * CERTAIN_SIGMAS * variance;
        is_informative.then_some(Self { variance, ..self })
    }

    /// The error, if significant and above the allowance (1 sigma of relative bank).
    fn finding(&self, allowance: f32) -> Option<AttitudeErrorFinding> {
        let excess_square = self.excess_square(allowance);
        (excess_square > 0.0).then(|| AttitudeErrorFinding {
            estimate: self.missing_bank_share,
            significance_sigmas: sqrt(
                self.missing_bank_share * self.missing_bank_share / self.null_variance(allowance),
            ),
            excess_square,
        })
    }

    /// Squared error to allow for beyond the allowance.
    fn excess_square(&self, allowance: f32) -> f32 {
        let estimate_squared = self.missing_bank_share * self.missing_bank_share;
        // Zero for NaN.
        let excess_square =
            ALLOWANCE_SLOPE * (estimate_squared - MIN_SIGNIFICANCE_SQUARED * self.null_variance(allowance));
        if excess_square > 0.0 { excess_square.min(estimate_squared) } else { 0.0 }
    }

    /// Variance of the estimate if the source's error is within the allowance: that of the noise plus the allowance's
    /// square.
    fn null_variance(&self, allowance: f32) -> f32 {
        self.variance + allowance * allowance
    }
}

#[cfg(test)]
mod tests;
