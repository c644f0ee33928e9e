//! Adaptive noise of the assumption that the velocity is the reference.

use nalgebra::Vector3;

/// Correlation time of the velocity's deviations, seconds: that of a hand's movements and of a boat's in waves.
const CORRELATION_S: f32 = 0.5;

/// Time constant with which the mean square decreases, seconds: longer than a vehicle's drive between two turns. It
/// increases at once.
const MEAN_SQUARE_TIME_S: f32 = 20.0;

/// Least variance of a component, (m/s)^2: 2 cm/s, of which accelerometer noise alone leaves a tenth.
const MIN_VARIANCE: f32 = 0.02 * 0.02;

/// Variance of the measurement relative to the mean square of an axis. The smoothing halves the variance of white noise.
const VARIANCE_PER_MEAN_SQUARE: f32 = 2.0;

/// Smoothed deviation of the velocity from its reference, and its mean square.
#[derive(Clone, Debug)]
pub(super) struct VelocityNoise {
    smoothed_m_s: Vector3<f32>,
    mean_square: f32,
}

impl VelocityNoise {
    pub fn new(mean_square: f32) -> Self {
        Self { smoothed_m_s: Vector3::zeros(), mean_square }
    }

    /// Processes the deviation of a step, of which other errors explain a part of this variance; returns the variance of a
    /// measurement of each axis, (m/s)^2. A step is shorter than the correlation time, and its measurement so much less
    /// accurate. Rest ends earlier movements.
    pub fn measurement_variance(
        &mut self,
        deviation_m_s: &Vector3<f32>,
        explained_variance: f32,
        is_at_rest: bool,
        step_s: f32,
    ) -> f32 {
        self.smoothed_m_s += (deviation_m_s - self.smoothed_m_s) * (step_s / CORRELATION_S).min(1.0);
        let square = (self.smoothed_m_s.norm_squared() / 3.0 - explained_variance).max(0.0);
        let weight = if is_at_rest || square > self.mean_square { 1.0 } else { (step_s / MEAN_SQUARE_TIME_S).min(1.0) };
        self.mean_square += (square - self.mean_square) * weight;
        let variance = (VARIANCE_PER_MEAN_SQUARE * self.mean_square).max(MIN_VARIANCE);
        variance * (2.0 * CORRELATION_S / step_s)
    }
}
