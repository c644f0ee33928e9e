//! Iron that goes with the current: what motors and their wires add to the field.
//!
//! A current `I` adds `k I` to the field at the sensor, so `k` is three more unknowns where samples know their current. They
//! are sought as a [latency](super::latency) is: not carried through the search, but eliminated from what it ended with. A
//! `k` is a change of the hard iron of which each sample has the share `I - mean I`, so its sums, what is left of them when
//! the other unknowns follow, and the step are those of a [change](super::constancy): `k + S^-1 U`. That is the step that
//! sixteen unknowns would take. From there all is sought again with `k` taken out of the field, until it stays.
//!
//! `k` is used where it is known and matters: its sigma, with the likeness of neighbouring residuals in it, makes no more
//! than half a microtesla at the current's spread, and it is more than chance. Used or not, what is left unknown of it is in
//! the covariance of the coefficients, at the mean current and at its spread about that, and what was found and is not used,
//! too, if it is more than chance. What is known before any sample is that it is some tenths of a microtesla per ampere.

use nalgebra::{Matrix3, Vector3};
use serde::{Deserialize, Serialize};

use super::{Calibration, Sample, Samples};
use crate::frames::{Body, Field, Sensor};
use crate::trig;

/// Whether it is looked for: a firmware without the feature `current` has none of this in it. On a host it always is.
pub(crate) const IS_LOOKED_FOR: bool = cfg!(any(feature = "current", not(target_os = "none")));

/// What is known beforehand of an axis of `k`, microtesla per ampere, 1 sigma: a motor battery's wires at a hand's breadth.
const PRIOR_SIGMA_UT_PER_A: f32 = 0.3;

/// `k` is used where its sigma at the current's spread is no larger, microtesla.
const MAX_SIGMA_UT: f32 = 0.5;

/// Nor is one of less significance: chi-squared with three degrees of freedom exceeds it in one of a thousand.
const MIN_SIGNIFICANCE: f32 = 16.3;

/// As long as it is not taken out of the field, it is itself what is alike in neighbours and scatters: what is as
/// significant by residuals taken as independent is tried.
const WORTH_A_TRY: f32 = 30.0;

/// What is in use is sought again if it was off by more than this part of its sigma.
const SETTLED_SIGMAS: f32 = 0.3;

/// So many are tried: the first leaves a tenth of itself, for what scattered by it was taken for noise.
const MAX_TRIED: u8 = 4;

/// A current is not known unless so many of all samples know it: one of so many may not.
const UNKNOWN_OF: usize = 4;

/// Iron that goes with the current, and the currents that it was found with.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct CurrentIron {
    /// `k`, microtesla per ampere, chip axes: what each ampere adds to the field as the sensor measures it. Nothing where
    /// it is not used.
    pub ut_per_a: [f32; 3],
    /// Its standard deviation on an axis, microtesla per ampere; nothing where samples knew no current.
    pub sigma_ut_per_a: f32,
    /// Mean of the samples' current, amperes.
    pub mean_a: f32,
    /// Its standard deviation, amperes; nothing where samples knew no current.
    pub spread_a: f32,
}

impl CurrentIron {
    /// None, and nothing known of it.
    pub const NONE: Self = Self { ut_per_a: [0.0; 3], sigma_ut_per_a: 0.0, mean_a: 0.0, spread_a: 0.0 };

    /// None yet, of samples with their currents.
    pub(super) fn of(samples: Samples<'_>) -> Self {
        if !IS_LOOKED_FOR {
            return Self::NONE;
        }
        let currents = || samples.all().filter_map(|sample| sample.rates.current_a());
        let known = currents().count();
        if known * UNKNOWN_OF < samples.all().count() * (UNKNOWN_OF - 1) || known == 0 {
            return Self::NONE;
        }
        let mean_a = currents().sum::<f32>() / known as f32;
        let variance = currents().map(|amperes| (amperes - mean_a) * (amperes - mean_a)).sum::<f32>() / known as f32;
        Self { mean_a, spread_a: libm::sqrtf(variance), ..Self::NONE }
    }

    /// Whether any is in use.
    #[must_use]
    pub fn is_used(&self) -> bool {
        self.ut_per_a.iter().any(|axis| *axis != 0.0)
    }

    /// What a current adds to the field, microtesla, chip axes; of one that is not known, what the mean adds.
    #[must_use]
    pub fn ut(&self, current_a: Option<f32>) -> Vector3<f32> {
        if !IS_LOOKED_FOR {
            return Vector3::zeros();
        }
        Vector3::from(self.ut_per_a) * current_a.unwrap_or(self.mean_a)
    }

    /// Current less the mean, amperes; nothing where it is not known.
    pub(super) fn share_a(&self, sample: &Sample) -> f32 {
        sample.rates.current_a().filter(|_| IS_LOOKED_FOR).map_or(0.0, |amperes| amperes - self.mean_a)
    }

    /// Variance of the field on an axis, square microtesla, beyond what the uncertainty of the coefficients allows for: at a
    /// current further from the mean than those of the samples were, and where the current is not known.
    fn variance_ut2(&self, current_a: Option<f32>) -> f32 {
        let spread2 = self.spread_a * self.spread_a;
        match current_a {
            Some(amperes) => {
                let off_a = amperes - self.mean_a;
                self.sigma_ut_per_a * self.sigma_ut_per_a * (off_a * off_a - spread2).max(0.0)
            }
            None => Vector3::from(self.ut_per_a).norm_squared() * spread2,
        }
    }

    /// Whether all are numbers.
    pub(super) fn is_finite(&self) -> bool {
        self.ut_per_a.iter().chain(&[self.sigma_ut_per_a, self.mean_a, self.spread_a]).all(|number| number.is_finite())
    }
}

/// What samples show of `k`.
#[derive(Clone, Debug)]
pub(super) struct Found {
    /// Mount axes, units of field per ampere.
    pub k: Vector3<f32>,
    /// The covariance of that.
    pub covariance: Matrix3<f32>,
    /// How much more it is than nothing, by residuals taken as independent, and by how alike they are.
    pub significance: [f32; 2],
}

impl Found {
    /// The precision of what is known beforehand, with this unit of field, microtesla.
    pub fn prior(unit_ut: f32) -> f32 {
        let sigma = PRIOR_SIGMA_UT_PER_A / unit_ut;
        1.0 / (sigma * sigma)
    }

    /// Its sigma on the axis that is known least.
    pub fn sigma(&self) -> f32 {
        libm::sqrtf(self.covariance.diagonal().max())
    }

    /// What samples are to be looked at with next, after so many others and now `used`; none: all is well. `spread` is that
    /// of the current, amperes, times the unit of field, microtesla.
    pub fn next(&self, used: &Vector3<f32>, tried: u8, spread: f32) -> Option<Vector3<f32>> {
        let [alone, alike] = self.significance;
        let is_used = *used != Vector3::zeros();
        if !is_used {
            return (tried == 0 && alone > WORTH_A_TRY).then_some(self.k);
        }
        let is_of_use = self.sigma() * spread <= MAX_SIGMA_UT && alike > MIN_SIGNIFICANCE;
        if !is_of_use {
            // One step alone may leave so much of it that the rest hides it.
            return Some(if tried > 1 { Vector3::zeros() } else { self.k });
        }
        let is_off = (self.k - used).amax() > SETTLED_SIGMAS * self.sigma();
        (is_off && tried < MAX_TRIED).then_some(self.k)
    }

    /// Vectors whose squares are the covariance, and what was found and is not used, if it is more than chance.
    pub fn roots(&self, used: &Vector3<f32>) -> [Vector3<f32>; 4] {
        let mut left = self.covariance;
        let mut root = |axis: usize| {
            let variance = left[(axis, axis)];
            let root = if variance > 0.0 { left.column(axis) / libm::sqrtf(variance) } else { Vector3::zeros() };
            left -= root * root.transpose();
            root
        };
        let unused = if self.significance[1] > MIN_SIGNIFICANCE { self.k - used } else { Vector3::zeros() };
        [root(0), root(1), root(2), unused]
    }
}

impl Calibration {
    /// The field of a sensor without what a current adds to it, chip axes.
    #[must_use]
    pub fn without_current(&self, field: Field<Sensor>, current_a: Option<f32>) -> Field<Sensor> {
        if !IS_LOOKED_FOR {
            return field;
        }
        Field::new(field.ut - self.current.ut(current_a))
    }

    /// Variance of a heading, square radians, by what is not known of the current or of what it adds, beyond what the
    /// uncertainty of the coefficients allows for: on an axis of the horizontal field that this was found in.
    #[must_use]
    pub fn current_variance_rad2(&self, current_a: Option<f32>) -> f32 {
        if !IS_LOOKED_FOR {
            return 0.0;
        }
        let horizontal_ut = self.total_ut * trig::sin_cos(self.inclination_rad).1;
        let variance_ut2 = self.current.variance_ut2(current_a);
        if variance_ut2 > 0.0 { variance_ut2 / (horizontal_ut * horizontal_ut) } else { 0.0 }
    }

    /// The corrected field of a sample in the body frame, microtesla, without what its current added.
    #[must_use]
    pub fn body(&self, sample: &Sample) -> Field<Body> {
        self.apply(self.without_current(sample.field, sample.rates.current_a()))
    }
}
