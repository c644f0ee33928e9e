//! Fraction of the raw heading's noise that smoothing does not remove.

use crate::trig::square;

/// Estimator of the noise variance that remains after smoothing, which the filter cannot distinguish from the heading.
/// After a 5 s mean, noise of 0.5 s correlation time has an eleventh of its variance; noise as slow as a turn has most
/// of it.
#[derive(Clone, Debug)]
pub(super) struct ResidualNoise {
    mean_innovation_rad: f32,
    remaining_fraction: f32,
    /// Effective averaging time so far, seconds.
    averaging_s: f32,
}

impl ResidualNoise {
    /// Time constant of the mean, seconds.
    const MEAN_TIME_CONSTANT_S: f32 = 5.0;

    /// Longest averaging time of the fraction, and the weight of its initial value, seconds.
    const MAX_AVERAGING_S: f32 = 120.0;
    const INITIAL_AVERAGING_S: f32 = 10.0;

    /// Factor on the fraction, found by simulation: the filter follows a third of the slow noise, so that the
    /// innovation contains only two thirds.
    const TRACKING_CORRECTION: f32 = 1.5;

    pub const INITIAL: Self =
        Self { mean_innovation_rad: 0.0, remaining_fraction: 0.15, averaging_s: Self::INITIAL_AVERAGING_S };

    pub fn remaining_fraction(&self) -> f32 {
        (Self::TRACKING_CORRECTION * self.remaining_fraction).min(1.0)
    }

    pub fn restart_mean(&mut self) {
        self.mean_innovation_rad = 0.0;
    }

    pub fn update_noise(&mut self, innovation_rad: f32, variance: f32, step_s: f32) {
        self.mean_innovation_rad +=
            (innovation_rad - self.mean_innovation_rad) * step_s / (Self::MEAN_TIME_CONSTANT_S + step_s);
        self.averaging_s = (self.averaging_s + step_s).min(Self::MAX_AVERAGING_S);
        let mean_fraction = (square(self.mean_innovation_rad) / variance).min(1.0);
        self.remaining_fraction += (mean_fraction - self.remaining_fraction) * step_s / (self.averaging_s + step_s);
    }
}
