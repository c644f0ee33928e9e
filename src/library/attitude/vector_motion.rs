//! Recent motion of a vector that is fixed to the Earth, in body axes, beside the motion that body rates predict.

use nalgebra::Vector3;

use crate::trig::VectorLength as _;

/// Time constant with which motion is forgotten, seconds: longer than a roll into a turn. It limits the effect of a
/// gyro offset.
pub(super) const MOTION_MEMORY_S: f32 = 2.0;

/// Motion of a unit vector, with exponential forgetting, radians.
#[derive(Debug)]
pub(super) struct VectorMotion {
    last_vector: Option<Vector3<f32>>,
    pub observed: Vector3<f32>,
    /// Motion predicted from the body rates.
    pub predicted: Vector3<f32>,
}

impl VectorMotion {
    pub const fn new() -> Self {
        const ZERO_VECTOR: Vector3<f32> = Vector3::new(0.0, 0.0, 0.0);
        Self { last_vector: None, observed: ZERO_VECTOR, predicted: ZERO_VECTOR }
    }

    /// Part of earlier motion that is kept in a step of this duration, seconds.
    pub fn decay_factor(step_s: f32) -> f32 {
        1.0 - step_s / MOTION_MEMORY_S
    }

    /// Adds the step to the vector's present value, with the integrated body rates; keeps a part of earlier motion.
    /// Returns the predicted but missing motion of the step.
    pub fn accumulate_motion(&mut self, vector: Vector3<f32>, turn: Vector3<f32>, step_s: f32) -> Vector3<f32> {
        let last_vector = self.last_vector.replace(vector).unwrap_or(vector);
        let (observed, predicted) = (vector - last_vector, (last_vector + vector).cross(&turn) * 0.5);
        self.observed = self.observed * Self::decay_factor(step_s) + observed;
        self.predicted = self.predicted * Self::decay_factor(step_s) + predicted;
        predicted - observed
    }

    /// Length of the difference of observed and predicted motion, radians.
    pub fn error_rad(&self) -> f32 {
        (self.observed - self.predicted).vector_length()
    }
}
