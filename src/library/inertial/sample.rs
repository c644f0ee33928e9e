//! Sample of gyro and accelerometer.

use nalgebra::{Matrix3, Vector3};

/// Standard gravity, m/s^2 (CGPM 1901).
pub const GRAVITY_M_S2: f32 = 9.806_65;

/// Simultaneous sample of gyro and accelerometer, body axes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct InertialSample {
    /// Body rates p, q, r, rad/s.
    pub rates_rad_s: Vector3<f32>,
    /// Specific force, m/s^2: (0, 0, -9.8) level at rest.
    pub specific_force_m_s2: Vector3<f32>,
}

impl InertialSample {
    /// The sample in other axes.
    #[must_use]
    pub fn rotated(&self, rotation: &Matrix3<f32>) -> Self {
        Self { rates_rad_s: rotation * self.rates_rad_s, specific_force_m_s2: rotation * self.specific_force_m_s2 }
    }

    pub(super) fn is_finite(&self) -> bool {
        self.rates_rad_s.iter().chain(&self.specific_force_m_s2).all(|component| component.is_finite())
    }
}
