//! Detection of rest: gyro and accelerometer stay near their slow means.

use nalgebra::Vector3;

use super::sample::InertialSample;
use crate::trig::{DEG, VectorLength as _};

/// Largest deviation of the rates from their mean at rest, rad/s: ten times the noise of a MEMS gyro in 100 Hz.
const MAX_RATE_DEVIATION_RAD_S: f32 = DEG;

/// Largest deviation of the specific force from its mean at rest, m/s^2: ten times the noise of a MEMS accelerometer.
const MAX_FORCE_DEVIATION_M_S2: f32 = 0.3;

/// Duration of small deviations that is rest, seconds. A slow sway changes its rate within that time.
const HOLD_S: f32 = 1.0;

/// Highest speed at rest, m/s: noise of a satellite receiver.
const MAX_SPEED_M_S: f32 = 0.5;

/// Time constant of the means, seconds.
const MEAN_TIME_S: f32 = 0.5;

/// Slow means of the sample, and the time since a large deviation from them.
#[derive(Clone, Debug)]
pub(super) struct RestDetector {
    mean: Option<InertialSample>,
    quiet_s: f32,
}

impl RestDetector {
    pub const INITIAL: Self = Self { mean: None, quiet_s: 0.0 };

    /// A vehicle with a known speed is not at rest: it may turn steadily.
    pub fn update(&mut self, sample: &InertialSample, speed_m_s: Option<f32>, step_s: f32) {
        let mean = self.mean.get_or_insert(*sample);
        let weight = (step_s / MEAN_TIME_S).min(1.0);
        let rate_deviation = sample.rates_rad_s - mean.rates_rad_s;
        let force_deviation = sample.specific_force_m_s2 - mean.specific_force_m_s2;
        mean.rates_rad_s += rate_deviation * weight;
        mean.specific_force_m_s2 += force_deviation * weight;
        let is_quiet = speed_m_s.unwrap_or_default() < MAX_SPEED_M_S
            && rate_deviation.vector_length() < MAX_RATE_DEVIATION_RAD_S
            && force_deviation.vector_length() < MAX_FORCE_DEVIATION_M_S2;
        self.quiet_s = if is_quiet { self.quiet_s + step_s } else { 0.0 };
    }

    /// Mean rates at rest, rad/s; `None` in motion.
    pub fn rates_at_rest(&self) -> Option<Vector3<f32>> {
        self.mean.filter(|_| self.quiet_s >= HOLD_S).map(|mean| mean.rates_rad_s)
    }
}
