//! Motor-current interference: the field of motors and their wires, proportional to the current.

use nalgebra::Vector3;

use super::samples::{Sample, Samples};
use crate::trig::sqrt;

/// Largest plausible current, relative to the highest of the calibration: a copter's full throttle is five times hover.
const MAX_CURRENT_RATIO: f32 = 5.0;

/// At most one of this many samples may lack a current.
const MIN_SAMPLES_PER_MISSING_CURRENT: usize = 4;

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
    pub const NO_INTERFERENCE: Self =
        Self { ut_per_a: [0.0; 3], sigma_ut_per_a: 0.0, mean_current_a: 0.0, current_sigma_a: 0.0 };

    pub(in crate::calibration) fn from_samples(samples: Samples<'_>) -> Self {
        let currents = || samples.all_samples().filter_map(|sample| sample.current.amperes());
        let known_count = currents().count();
        if known_count * MIN_SAMPLES_PER_MISSING_CURRENT
            < samples.all_samples().count() * (MIN_SAMPLES_PER_MISSING_CURRENT - 1)
            || known_count == 0
        {
            return Self::NO_INTERFERENCE;
        }
        let mean_a = currents().sum::<f32>() / known_count as f32;
        let variance =
            currents().map(|amperes| (amperes - mean_a) * (amperes - mean_a)).sum::<f32>() / known_count as f32;
        Self { mean_current_a: mean_a, current_sigma_a: sqrt(variance), ..Self::NO_INTERFERENCE }
    }

    /// Whether an interference is applied.
    #[must_use]
    pub fn is_applied(&self) -> bool {
        self.ut_per_a.iter().any(|axis| *axis != 0.0)
    }

    /// Whether the aircraft of the samples can draw this current; a larger one is an error of the report.
    #[must_use]
    pub fn is_plausible_current(&self, current_a: f32) -> bool {
        let highest_a = self.mean_current_a.abs() + 2.0 * self.current_sigma_a;
        self.sigma_ut_per_a == 0.0 || current_a.abs() <= MAX_CURRENT_RATIO * highest_a
    }

    /// Interference of a current, microtesla, chip axes; of the mean current if unknown.
    #[must_use]
    pub fn interference_ut(&self, current_a: Option<f32>) -> Vector3<f32> {
        Vector3::from(self.ut_per_a) * current_a.unwrap_or(self.mean_current_a)
    }

    /// Current minus the mean, amperes; 0 if unknown.
    pub(in crate::calibration) fn current_deviation_a(&self, sample: &Sample) -> f32 {
        sample.current.amperes().map_or(0.0, |amperes| amperes - self.mean_current_a)
    }

    /// Field variance on an axis, square microtesla, not covered by the covariance of the coefficients: at currents
    /// beyond the samples' spread, and at unknown current.
    pub(super) fn variance_beyond_covariance_ut2(&self, current_a: Option<f32>) -> f32 {
        let current_variance_a2 = self.current_sigma_a * self.current_sigma_a;
        match current_a {
            Some(amperes) => {
                let deviation_a = amperes - self.mean_current_a;
                self.sigma_ut_per_a * self.sigma_ut_per_a * (deviation_a * deviation_a - current_variance_a2).max(0.0)
            }
            None => Vector3::from(self.ut_per_a).norm_squared() * current_variance_a2,
        }
    }

    pub(in crate::calibration) fn is_finite(&self) -> bool {
        self.ut_per_a
            .iter()
            .chain(&[self.sigma_ut_per_a, self.mean_current_a, self.current_sigma_a])
            .all(|number| number.is_finite())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Full throttle of a copter is five times hover; ten times is an error of the report.
    #[test]
    fn a_current_far_beyond_those_of_the_calibration_is_implausible() {
        for mean_current_a in [10.0, -10.0] {
            let known = MotorCurrentInterference {
                sigma_ut_per_a: 0.1,
                mean_current_a,
                current_sigma_a: 2.0,
                ..MotorCurrentInterference::NO_INTERFERENCE
            };
            for sign in [1.0, -1.0] {
                assert!(known.is_plausible_current(sign * 50.0) && !known.is_plausible_current(sign * 100.0));
            }
        }
        let without_currents = MotorCurrentInterference::NO_INTERFERENCE;
        assert!(without_currents.is_plausible_current(500.0), "there are no currents to compare with");
    }
}
