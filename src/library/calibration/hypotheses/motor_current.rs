//! Motor-current interference: the field of motors and their wires, proportional to the current.
//!
//! A current `I` adds `k I` to the field at the sensor: three more unknowns for samples with a current.
//! `interference_per_ampere` is eliminated from the result of the search as a hard-iron change of which each sample has
//! the fraction `I - mean I`, with the step `k + S^-1 U` of the [score test](super::score_test). The search then
//! continues with `k I` removed, until `interference_per_ampere` converges.
//!
//! `interference_per_ampere` is applied only if significant and certain to 0.5 uT at the current's spread. Its
//! uncertainty, and a significant estimate that is not applied, are added to the covariance of the coefficients.

use nalgebra::{Matrix3, Vector3};

use super::score_test::EfficientScore;
use crate::calibration::linear_algebra::inverse;
use crate::calibration::model::Likelihood;
use crate::trig::sqrt;

/// Prior sigma of each axis of `interference_per_ampere`, uT/A: wires of a motor battery at 10 cm.
const PRIOR_SIGMA_UT_PER_A: f32 = 0.3;

/// Maximum sigma at the current's spread for `interference_per_ampere` to be applied, microtesla.
const MAX_SIGMA_UT: f32 = 0.5;

/// Minimum significance of an applied `interference_per_ampere`: 99.9 % quantile of chi-squared with three degrees of
/// freedom.
const MIN_SIGNIFICANCE: f32 = 16.3;

/// Significance, for independent residuals, above which `interference_per_ampere` is tried: before its removal, the
/// interference inflates autocorrelation and noise.
const TRIAL_SIGNIFICANCE: f32 = 30.0;

/// Deviation from the estimate above which `interference_per_ampere` is updated, sigmas.
const CONVERGED_SIGMAS: f32 = 0.3;

/// Maximum number of updates. The first leaves a tenth, because the noise estimate contained the interference.
pub(in crate::calibration) const MAX_UPDATES: u8 = 4;

#[derive(Clone, Debug)]
pub(in crate::calibration) struct InterferenceEstimate {
    /// Mount axes, units of field per ampere.
    pub interference_per_ampere: Vector3<f32>,
    pub covariance: Matrix3<f32>,
    /// Significance (chi-squared) for independent residuals, and with autocorrelation.
    pub significance: [f32; 2],
}

impl InterferenceEstimate {
    /// The estimate. `inflation`: variance inflation by autocorrelation. `None` if not finite.
    #[inline(never)]
    pub fn new(score: &EfficientScore<3>, likelihood: &Likelihood, inflation: f32) -> Option<Self> {
        let (applied, prior) = (likelihood.interference_per_ampere(), Self::prior_precision(likelihood.field_unit_ut));
        let sample_information = score.information;
        let total_information = sample_information + Matrix3::from_diagonal_element(prior);
        let inverse_information = inverse(&total_information)?;
        let k = applied + inverse_information * (score.gradient - applied * prior);
        let significance = k.dot(&(total_information * k));
        let covariance = inverse_information * sample_information * inverse_information * inflation
            + inverse_information * inverse_information * prior;
        let estimate =
            Self { interference_per_ampere: k, covariance, significance: [significance, significance / inflation] };
        (significance + estimate.largest_axis_sigma()).is_finite().then_some(estimate)
    }

    pub fn prior_precision(unit_ut: f32) -> f32 {
        let sigma = PRIOR_SIGMA_UT_PER_A / unit_ut;
        1.0 / (sigma * sigma)
    }

    pub fn largest_axis_sigma(&self) -> f32 {
        sqrt(self.covariance.diagonal().max())
    }

    /// Next interference after `update_count` updates; `None` if `applied` is final. `scaled_current_sigma_a_ut`:
    /// standard deviation of the current (A) times the unit of field (uT).
    pub fn next_interference(
        &self,
        applied: &Vector3<f32>,
        update_count: u8,
        scaled_current_sigma_a_ut: f32,
    ) -> Option<Vector3<f32>> {
        let [independent, autocorrelated] = self.significance;
        let is_applied = *applied != Vector3::zeros();
        if !is_applied {
            return (update_count == 0 && independent > TRIAL_SIGNIFICANCE).then_some(self.interference_per_ampere);
        }
        let is_applicable =
            self.largest_axis_sigma() * scaled_current_sigma_a_ut <= MAX_SIGMA_UT && autocorrelated > MIN_SIGNIFICANCE;
        if !is_applicable {
            // After one update, the remaining interference may still hide the significance.
            return Some(if update_count > 1 { Vector3::zeros() } else { self.interference_per_ampere });
        }
        let needs_update =
            (self.interference_per_ampere - applied).amax() > CONVERGED_SIGMAS * self.largest_axis_sigma();
        (needs_update && update_count < MAX_UPDATES).then_some(self.interference_per_ampere)
    }

    /// Vectors whose outer products sum to the covariance, plus a significant estimate that is not applied.
    pub fn covariance_factors(&self, applied: &Vector3<f32>) -> [Vector3<f32>; 4] {
        let mut remaining_covariance = self.covariance;
        let mut root = |axis: usize| {
            let variance = remaining_covariance[(axis, axis)];
            let root =
                if variance > 0.0 { remaining_covariance.column(axis) / sqrt(variance) } else { Vector3::zeros() };
            remaining_covariance -= root * root.transpose();
            root
        };
        let unapplied_estimate = if self.significance[1] > MIN_SIGNIFICANCE {
            self.interference_per_ampere - applied
        } else {
            Vector3::zeros()
        };
        [root(0), root(1), root(2), unapplied_estimate]
    }
}
