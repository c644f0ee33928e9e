//! Motor-current interference: the field of motors and their wires, proportional to the current.
//!
//! A current `I` adds `k I` to the field at the sensor: three more unknowns for samples with a current. `k` is
//! eliminated from the result of the search as a hard-iron change of which each sample has the fraction `I - mean I`,
//! with the sums and the step `k + S^-1 U` of the hard-iron score test. The search then continues with `k I` removed,
//! until `k` converges.
//!
//! `k` is applied only if significant and certain to 0.5 uT at the current's spread. Its uncertainty, and a significant
//! estimate that is not applied, are added to the covariance of the coefficients.

use nalgebra::{Matrix3, Vector3};

use super::{Calibration, Sample, Samples};
use crate::frames::{Body, Field, Sensor};
use crate::trig;
use crate::trig::sqrt;

/// Prior sigma of each axis of `k`, uT/A: wires of a motor battery at 10 cm.
const PRIOR_SIGMA_UT_PER_A: f32 = 0.3;

/// Maximum sigma at the current's spread for `k` to be applied, microtesla.
const MAX_SIGMA_UT: f32 = 0.5;

/// Minimum significance of an applied `k`: 99.9 % quantile of chi-squared with three degrees of freedom.
const MIN_SIGNIFICANCE: f32 = 16.3;

/// Significance, for independent residuals, above which `k` is tried: before its removal, the interference inflates
/// autocorrelation and noise.
const TRIAL_SIGNIFICANCE: f32 = 30.0;

/// Deviation from the estimate above which `k` is updated, sigmas.
const CONVERGED_SIGMAS: f32 = 0.3;

/// Maximum number of updates. The first leaves a tenth, because the noise estimate contained the interference.
const MAX_UPDATES: u8 = 4;

/// At most one of this many samples may lack a current.
const MAX_UNKNOWN_ONE_IN: usize = 4;

/// Motor-current interference, and the distribution of the currents it was estimated from.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct MotorCurrentInterference {
    /// `k`, uT/A, chip axes; zero if not applied.
    pub ut_per_a: [f32; 3],
    /// Standard deviation of an axis of `k`, uT/A; 0 without currents.
    pub sigma_ut_per_a: f32,
    /// Mean current of the samples, amperes.
    pub mean_current_a: f32,
    /// Standard deviation of the current, amperes; 0 without currents.
    pub current_sigma_a: f32,
}

impl MotorCurrentInterference {
    /// No interference.
    pub const NONE: Self = Self { ut_per_a: [0.0; 3], sigma_ut_per_a: 0.0, mean_current_a: 0.0, current_sigma_a: 0.0 };

    pub(super) fn from_samples(samples: Samples<'_>) -> Self {
        let currents = || samples.all().filter_map(|sample| sample.rates.current_a());
        let known = currents().count();
        if known * MAX_UNKNOWN_ONE_IN < samples.all().count() * (MAX_UNKNOWN_ONE_IN - 1) || known == 0 {
            return Self::NONE;
        }
        let mean_a = currents().sum::<f32>() / known as f32;
        let variance = currents().map(|amperes| (amperes - mean_a) * (amperes - mean_a)).sum::<f32>() / known as f32;
        Self { mean_current_a: mean_a, current_sigma_a: sqrt(variance), ..Self::NONE }
    }

    /// Whether an interference is applied.
    #[must_use]
    pub fn is_applied(&self) -> bool {
        self.ut_per_a.iter().any(|axis| *axis != 0.0)
    }

    /// Interference of a current, microtesla, chip axes; of the mean current if unknown.
    #[must_use]
    pub fn interference_ut(&self, current_a: Option<f32>) -> Vector3<f32> {
        Vector3::from(self.ut_per_a) * current_a.unwrap_or(self.mean_current_a)
    }

    /// Current minus the mean, amperes; 0 if unknown.
    pub(super) fn current_offset_a(&self, sample: &Sample) -> f32 {
        sample.rates.current_a().map_or(0.0, |amperes| amperes - self.mean_current_a)
    }

    /// Field variance on an axis, square microtesla, not covered by the covariance of the coefficients: at currents
    /// beyond the samples' spread, and at unknown current.
    fn excess_variance_ut2(&self, current_a: Option<f32>) -> f32 {
        let spread2 = self.current_sigma_a * self.current_sigma_a;
        match current_a {
            Some(amperes) => {
                let off_a = amperes - self.mean_current_a;
                self.sigma_ut_per_a * self.sigma_ut_per_a * (off_a * off_a - spread2).max(0.0)
            }
            None => Vector3::from(self.ut_per_a).norm_squared() * spread2,
        }
    }

    pub(super) fn is_finite(&self) -> bool {
        self.ut_per_a
            .iter()
            .chain(&[self.sigma_ut_per_a, self.mean_current_a, self.current_sigma_a])
            .all(|number| number.is_finite())
    }
}

#[derive(Clone, Debug)]
pub(super) struct InterferenceEstimate {
    pub k: Vector3<f32>,
    pub covariance: Matrix3<f32>,
    /// Significance (chi-squared) for independent residuals, and with autocorrelation.
    pub significance: [f32; 2],
}

impl InterferenceEstimate {
    pub fn prior_precision(unit_ut: f32) -> f32 {
        let sigma = PRIOR_SIGMA_UT_PER_A / unit_ut;
        1.0 / (sigma * sigma)
    }

    pub fn max_sigma(&self) -> f32 {
        sqrt(self.covariance.diagonal().max())
    }

    /// Next `k` after `tried` updates; `None` if `used` is final. `spread`: standard deviation of the current (A) times
    /// the unit of field (uT).
    pub fn next_interference(&self, used: &Vector3<f32>, tried: u8, spread: f32) -> Option<Vector3<f32>> {
        let [independent, autocorrelated] = self.significance;
        let is_used = *used != Vector3::zeros();
        if !is_used {
            return (tried == 0 && independent > TRIAL_SIGNIFICANCE).then_some(self.k);
        }
        let is_applicable = self.max_sigma() * spread <= MAX_SIGMA_UT && autocorrelated > MIN_SIGNIFICANCE;
        if !is_applicable {
            // After one update the remainder may still hide the significance.
            return Some(if tried > 1 { Vector3::zeros() } else { self.k });
        }
        let is_off = (self.k - used).amax() > CONVERGED_SIGMAS * self.max_sigma();
        (is_off && tried < MAX_UPDATES).then_some(self.k)
    }

    /// Vectors whose outer products sum to the covariance, plus a significant estimate that is not applied.
    pub fn covariance_factors(&self, used: &Vector3<f32>) -> [Vector3<f32>; 4] {
        let mut left = self.covariance;
        let mut root = |axis: usize| {
            let variance = left[(axis, axis)];
            let root = if variance > 0.0 { left.column(axis) / sqrt(variance) } else { Vector3::zeros() };
            left -= root * root.transpose();
            root
        };
        let unused = if self.significance[1] > MIN_SIGNIFICANCE { self.k - used } else { Vector3::zeros() };
        [root(0), root(1), root(2), unused]
    }
}

impl Calibration {
    /// Field without motor-current interference, chip axes.
    #[must_use]
    pub fn remove_motor_current(&self, field: Field<Sensor>, current_a: Option<f32>) -> Field<Sensor> {
        Field::new(field.ut - self.motor_current.interference_ut(current_a))
    }

    /// Heading variance, square radians, from unknown current or interference beyond the covariance of the
    /// coefficients, on one axis of the horizontal field.
    #[must_use]
    pub fn motor_current_heading_variance_rad2(&self, current_a: Option<f32>) -> f32 {
        let horizontal_ut = self.total_ut * trig::sin_cos(self.inclination_rad).1;
        let variance_ut2 = self.motor_current.excess_variance_ut2(current_a);
        if variance_ut2 > 0.0 { variance_ut2 / (horizontal_ut * horizontal_ut) } else { 0.0 }
    }

    /// Corrected field of a sample in the body frame, microtesla, without motor-current interference.
    #[must_use]
    pub fn corrected_body_field(&self, sample: &Sample) -> Field<Body> {
        self.apply(self.remove_motor_current(sample.field, sample.rates.current_a()))
    }
}
