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
use crate::calibration::types::time_order::{PART_COUNT, TimeOrdered};
use crate::trig::sqrt;

/// Bank-angle scale error in the table of attitude errors.
pub(super) const BANK_SCALE_ERROR: AttitudeError = AttitudeError {
    attitude_derivative: |state| [state.attitude.roll_rad, 0.0],
    assumed_sigma: |consider_sigmas| consider_sigmas.bank_scale,
    significance_test: Some(find_bank_scale_error),
};

/// Maximum share of the information about `k` that roll noise may contribute.
const MAX_NOISE_SHARE: f32 = 0.5;

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
    let parameters = ModelParameters::new(test.fit.unknowns);
    let mut clusters = ClusterVariance::default();
    for (part, sample) in TimeOrdered::new(test.fit.samples) {
        let equations = test.fit.likelihood.sample_equations(sample, None, &parameters);
        let attitude = sample.latency_compensated_attitude(test.fit.likelihood.latency_s);
        let state = AttitudeState::steady_turn(attitude, sample.rates);
        let by_bank = BANK_SCALE_ERROR.inclination_derivative(&equations, &state);
        clusters.add_sample_score(part, &equations, by_bank, &score.nuisance_columns[0]);
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
        if total_information.is_nan() || roll_noise > MAX_NOISE_SHARE * total_information {
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
mod tests {
    use nalgebra::{Vector1, Vector3};

    use super::*;
    use crate::calibration::hypotheses::score_test::ScoreTest;
    use crate::calibration::model::JacobianRow;

    fn is_close(found: f32, expected: f32) -> bool {
        (found - expected).abs() <= 1e-4 * expected.abs()
    }

    const ZERO_ROW: JacobianRow = JacobianRow {
        derivative_by_field: Vector3::new(0.0, 0.0, 0.0),
        centred_field: Vector3::new(0.0, 0.0, 0.0),
        derivative_by_inclination: 0.0,
    };

    fn inclination_equation(weight: f32, residual: f32, row: JacobianRow) -> ResidualEquation {
        let equation = ResidualEquation::new(row, residual, 1.0 / weight, 1e6);
        assert!(is_close(equation.weight, weight));
        equation
    }

    /// Inclination residuals with their derivatives by roll and by the bank-angle scale error. The nuisance
    /// parameters explain a part of information and gradient, which is subtracted.
    fn estimate(
        evidence: &[(ResidualEquation, [f32; 2])],
        explained_information: f32,
        explained_gradient: f32,
        roll_sigma_rad: f32,
        inflation: f32,
    ) -> Option<BankScaleEstimate> {
        let [mut roll, mut bank] = [(); 2].map(|()| ScoreTest::zero());
        for (equation, [by_roll, by_bank]) in evidence {
            roll.add_weighted_equation(equation, &Vector1::new(*by_roll), 1.0);
            bank.add_weighted_equation(equation, &Vector1::new(*by_bank), 1.0);
        }
        let score = EfficientScore {
            nuisance_columns: [Vector13::zeros()],
            information: bank.information.add_scalar(-explained_information),
            gradient: bank.gradient.add_scalar(-explained_gradient),
        };
        BankScaleEstimate::new(&score, roll.information.x * roll_sigma_rad * roll_sigma_rad, inflation)
    }

    #[test]
    fn estimate_equals_hand_calculation() {
        let evidence = [
            (inclination_equation(100.0, -0.3, ZERO_ROW), [0.5, 2.0]),
            (inclination_equation(50.0, 0.2, ZERO_ROW), [-1.0, -3.0]),
        ];
        let (information, gradient) = (100.0 * 4.0 + 50.0 * 9.0, 100.0 * 2.0 * 0.3 + 50.0 * 3.0 * 0.2);
        let noise = (100.0 * 0.25 + 50.0) * 0.04;
        let found = estimate(&evidence, 150.0, 7.0, 0.2, 1.5).unwrap();
        let bank_information = information - 150.0 - noise;
        assert!(is_close(found.missing_bank_share, (gradient - 7.0 + noise) / bank_information), "{found:?}");
        assert!(
            is_close(found.variance, (information - 150.0) * 1.5 / (bank_information * bank_information)),
            "{found:?}"
        );
        assert!(is_close(found.finding(0.0).unwrap().estimate, found.missing_bank_share));
    }

    #[test]
    fn the_estimate_adds_to_the_assumed_sigma_in_quadrature() {
        // Information 1e4: an estimate of 0.1 with variance 1e-4.
        let found = estimate(&[(inclination_equation(1e4, -0.1, ZERO_ROW), [0.0, 1.0])], 0.0, 0.0, 0.0, 1.0).unwrap();
        let allowed = found.finding(0.01).unwrap().allowed_sigma(0.01);
        assert!((allowed - (0.01_f32.powi(2) + 0.1_f32.powi(2)).sqrt()).abs() < 1e-5);
    }

    #[test]
    fn noise_dominated_estimate_is_rejected() {
        let evidence = [(inclination_equation(1e6, 0.0, ZERO_ROW), [1.0, 1.0])];
        assert!(estimate(&evidence, 0.0, 0.0, 0.49_f32.sqrt(), 1.0).is_some());
        assert!(estimate(&evidence, 0.0, 0.0, 0.51_f32.sqrt(), 1.0).is_none());
        assert!(estimate(&evidence, f32::NAN, 0.0, 0.1, 1.0).is_none());
        assert!(estimate(&evidence, 0.0, f32::NAN, 0.1, 1.0).is_none());
        assert!(estimate(&[], 0.0, 0.0, 0.1, 1.0).is_none());
    }

    fn bank_scale_estimate(missing: f32, sigma: f32) -> BankScaleEstimate {
        BankScaleEstimate { missing_bank_share: missing, variance: sigma * sigma, score_information: 1e4 }
    }

    /// Estimate and allowance together have a variance of 5e-4; the threshold is three times that.
    #[test]
    fn errors_above_the_threshold_are_allowed_for() {
        for (square, excess) in [(14.9e-4, 0.0), (15.1e-4, 0.2e-4), (20e-4, 10e-4), (29e-4, 28e-4), (31e-4, 31e-4)] {
            for missing in [f32::sqrt(square), -f32::sqrt(square)] {
                let found = bank_scale_estimate(missing, 0.02);
                assert!((found.excess_square(0.01) - excess).abs() < 1e-7, "{missing}: {}", found.excess_square(0.01));
                let error = found.finding(0.01);
                assert_eq!(error.is_some(), excess > 0.0, "{missing}");
                if let Some(AttitudeErrorFinding { estimate, significance_sigmas: sigmas, .. }) = error {
                    assert!(is_close(estimate, missing) && is_close(sigmas, (square / 5e-4).sqrt()));
                }
            }
        }
    }

    #[test]
    fn uncertain_estimate_is_rejected() {
        let is_accepted = |missing, sigma| {
            bank_scale_estimate(missing, sigma).with_cluster_variance(ClusterVariance::default()).is_some()
        };
        assert!(is_accepted(0.1, 0.049) && !is_accepted(0.1, 0.051) && !is_accepted(-0.1, 0.051));
        assert!(!is_accepted(0.34, 0.1) && is_accepted(0.36, 0.1) && is_accepted(-0.36, 0.1));
    }

    fn clusters(contributions: impl Iterator<Item = (usize, f32)>) -> ClusterVariance {
        let mut clusters = ClusterVariance::default();
        let column = Vector13::zeros();
        for (part, contribution) in contributions {
            let norm = inclination_equation(1.0, 5.0, ZERO_ROW);
            let inclination = Some(inclination_equation(1.0, contribution, ZERO_ROW));
            let equations = SampleEquations {
                norm_equation: norm,
                inclination_equation: inclination,
                heading_equation: None,
                inclination_derivatives_by_attitude: [7.0, 7.0],
            };
            clusters.add_sample_score(part, &equations, 1.0, &column);
        }
        clusters
    }

    /// The incomplete last cluster of a part counts, too.
    #[test]
    fn twelve_samples_form_a_cluster() {
        // Cluster sums of the scores: 12, -12, 12 and 12 in the first part, 6 in the second.
        let first = (0..48).map(|i| {
            (
                0,
                if i < 12 {
                    1.0
                } else if i < 24 {
                    -1.0
                } else {
                    1.0
                },
            )
        });
        let second = (0..6).map(|_| (1, 1.0));
        let interleaved = first.zip(second.map(Some).chain(core::iter::repeat(None)));
        let found = clusters(interleaved.flat_map(|(a, b)| core::iter::once(a).chain(b))).variance();
        let sums = [12.0, -12.0, 12.0, 12.0, 6.0_f32];
        let mean = sums.iter().sum::<f32>() / 5.0;
        let expected = sums.iter().map(|s| (s - mean) * (s - mean)).sum::<f32>() * 5.0 / 4.0;
        assert!(is_close(found, expected), "{found} {expected}");
        assert!(!clusters((0..5).map(|_| (0, 1.0))).variance().is_finite());
    }

    #[test]
    fn score_contributions_exclude_the_nuisance_parameters() {
        let row = JacobianRow { derivative_by_field: Vector3::x() * 3.0, centred_field: Vector3::z(), ..ZERO_ROW };
        let column = Vector13::ith(2, 0.5);
        let equations = SampleEquations {
            norm_equation: inclination_equation(10.0, 0.1, row),
            inclination_equation: Some(inclination_equation(4.0, -0.2, row)),
            heading_equation: None,
            inclination_derivatives_by_attitude: [0.0, 0.0],
        };
        let mut clusters = ClusterVariance::default();
        clusters.add_sample_score(0, &equations, 2.0, &column);
        let (sum, samples) = clusters.open_clusters[0];
        assert!(is_close(sum, 10.0 * 0.1 * -1.5 + 4.0 * -0.2 * (2.0 - 1.5)) && samples == 1, "{sum}");
        clusters.add_sample_score(PART_COUNT, &equations, 2.0, &column);
        assert_eq!(clusters.open_clusters.iter().map(|open| open.1).sum::<u8>(), 1);
    }

    #[test]
    fn the_larger_of_cluster_and_estimate_variance_is_used() {
        let scattered = clusters((0..48).map(|i| (0, if i / 12 % 2 == 0 { 1.0 } else { -1.0 })));
        let expected = scattered.variance() / 1e8;
        assert!(is_close(bank_scale_estimate(0.1, 1e-4).with_cluster_variance(scattered).unwrap().variance, expected));
        assert!(is_close(bank_scale_estimate(0.1, 0.01).with_cluster_variance(scattered).unwrap().variance, 1e-4));
    }
}
