//! Errors of an inertial sensor that the attitude filter expects.

use crate::trig::DEG;

/// Errors of gyro and accelerometer before any estimate, 1 sigma of each axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct InertialSensorErrors {
    /// Offset of the gyro, rad/s.
    pub gyro_offset_rad_s: f32,
    /// Scale error of the gyro, relative.
    pub gyro_scale: f32,
    /// Offset of the accelerometer, m/s^2.
    pub accelerometer_offset_m_s2: f32,
}

impl InertialSensorErrors {
    /// A calibrated sensor: offsets of 1 deg/s and 3 mg, scale to 1 %.
    pub const CALIBRATED: Self = Self { gyro_offset_rad_s: DEG, gyro_scale: 0.01, accelerometer_offset_m_s2: 0.03 };
}
