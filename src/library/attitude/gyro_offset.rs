//! Offset of the gyro whose rates are in use, as the own gyro shows it.

use nalgebra::Vector3;

/// Offset of the gyro in use. The own one's is known from its last rest.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GyroOffset {
    /// Offset of each axis, rad/s.
    pub rad_s: Vector3<f32>,
    /// Variance of each axis, (rad/s)^2.
    pub variance: f32,
}

impl GyroOffset {
    /// That of own rates: they are without it, but for this variance.
    pub(super) fn of_own_rates(variance: f32) -> Self {
        Self { rad_s: Vector3::zeros(), variance }
    }
}
