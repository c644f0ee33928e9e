//! Adaptive noise of the assumption that the velocity is the reference.

use nalgebra::Vector3;

use crate::trig::{sqrt, square};

/// Time scales of the velocity's deviations, seconds: a hand's movements and a boat's in waves; a turn of an aeroplane whose speed is not
/// known. With the first alone 93 % of the headings of aeroplanes and VTOLs without an autopilot were within two sigmas, with both 99 %.
const TIME_SCALES_S: [f32; 2] = [0.5, 2.5];

/// Deviation on the short scale that is expected at a start in motion, m/s. With 0.5 m/s the acceleration of a VTOL of some seconds tilted
/// the attitude by 15 deg, at a sigma of 1 deg; with 3 m/s a hand's heading is less accurate.
const START_DEVIATION_M_S: f32 = 1.5;

/// Largest deviation on the long scale that is expected at a start, m/s: that of a fast aeroplane.
const MAX_MOVEMENT_M_S: f32 = 30.0;

/// Time constant with which the mean square decreases, relative to the time scale: longer than a vehicle's drive between two turns. It
/// increases at once.
const MEMORY_SCALES: f32 = 40.0;

/// Least variance of a component, (m/s)^2: 2 cm/s, of which accelerometer noise alone leaves a tenth.
const MIN_VARIANCE: f32 = 0.02 * 0.02;

/// Variance of the measurement relative to the mean square of an axis. The smoothing halves the variance of white noise.
const VARIANCE_PER_MEAN_SQUARE: f32 = 2.0;

/// Smoothed deviation of the velocity from its reference, and its mean square.
#[derive(Clone, Debug)]
struct SmoothedDeviation {
    smoothed_m_s: Vector3<f32>,
    mean_square: f32,
}

impl SmoothedDeviation {
    fn new(mean_square: f32) -> Self {
        Self { smoothed_m_s: Vector3::zeros(), mean_square }
    }
}

/// Deviations on each time scale. The noise has the density of the scale on which it is largest: deviations that keep their sign for
/// long tilt the attitude further.
#[derive(Clone, Debug)]
pub(super) struct VelocityNoise {
    deviations: [SmoothedDeviation; TIME_SCALES_S.len()],
    /// Largest mean square on the long scale.
    largest_mean_square: f32,
}

impl VelocityNoise {
    /// Deviations at a start. The vehicle's largest deviation on the long scale has been `movement_m_s`.
    pub fn new(movement_m_s: f32) -> Self {
        let largest_mean_square = square(movement_m_s.min(MAX_MOVEMENT_M_S));
        let deviations = [square(START_DEVIATION_M_S), largest_mean_square].map(SmoothedDeviation::new);
        Self { deviations, largest_mean_square }
    }

    /// Largest deviation on the long scale, m/s.
    pub fn movement_m_s(&self) -> f32 {
        sqrt(self.largest_mean_square)
    }

    /// Takes the present deviations as movements; no wrong vertical may cause them.
    pub fn record_movement(&mut self) {
        let mean_square = self.deviations[1].mean_square.min(square(MAX_MOVEMENT_M_S));
        self.largest_mean_square = self.largest_mean_square.max(mean_square);
    }

    /// Processes the deviation of a step, of which other errors explain a part of this variance; returns the variance of a
    /// measurement of each axis, (m/s)^2. A step is shorter than the time scales, and its measurement so much less
    /// accurate. Rest ends earlier movements.
    pub fn measurement_variance(
        &mut self,
        deviation_m_s: &Vector3<f32>,
        explained_variance: f32,
        is_at_rest: bool,
        is_speed_known: bool,
        step_s: f32,
    ) -> f32 {
        let mut density = MIN_VARIANCE * TIME_SCALES_S[0];
        let used_scales = if is_speed_known { &TIME_SCALES_S[..1] } else { &TIME_SCALES_S };
        for (SmoothedDeviation { smoothed_m_s, mean_square }, &scale_s) in self.deviations.iter_mut().zip(used_scales) {
            *smoothed_m_s += (deviation_m_s - *smoothed_m_s) * (step_s / scale_s).min(1.0);
            let unexplained = (smoothed_m_s.norm_squared() / 3.0 - explained_variance).max(0.0);
            let is_replaced = is_at_rest || unexplained > *mean_square;
            let weight = if is_replaced { 1.0 } else { (step_s / (MEMORY_SCALES * scale_s)).min(1.0) };
            *mean_square += (unexplained - *mean_square) * weight;
            density = density.max(VARIANCE_PER_MEAN_SQUARE * *mean_square * scale_s);
        }
        density * (2.0 / step_s)
    }
}
