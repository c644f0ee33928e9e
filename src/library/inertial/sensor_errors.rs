//! Errors of an inertial sensor that the attitude filter expects.

use super::sample::GRAVITY_M_S2;
use crate::trig::DEG;

/// Errors of gyro and accelerometer before any estimate, 1 sigma of each axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct InertialSensorErrors {
    /// Offset of the gyro, rad/s.
    pub gyro_offset_rad_s: f32,
    /// Scale error of the gyro, relative.
    pub gyro_scale: f32,
    /// Cross-axis sensitivity of the gyro, relative.
    pub gyro_cross_axis: f32,
    /// Offset of the accelerometer, m/s^2.
    pub accelerometer_offset_m_s2: f32,
}

impl InertialSensorErrors {
    /// A calibrated sensor: offsets of 1 deg/s and 3 mg, scale to 1 %, axes to 0.2 %.
    pub const CALIBRATED: Self =
        Self { gyro_offset_rad_s: DEG, gyro_scale: 0.01, gyro_cross_axis: 0.002, accelerometer_offset_m_s2: 0.03 };

    /// The same sensor whose offsets were estimated earlier: 30 K change those of the gyro by 0.5 deg/s (table 3 of the
    /// LSM6DSL's data sheet), and those of the accelerometer by 3 mg; soldering and age by more, 10 mg.
    pub(super) const fn with_known_offsets(self) -> Self {
        Self { gyro_offset_rad_s: 0.5 * DEG, accelerometer_offset_m_s2: 0.01 * GRAVITY_M_S2, ..self }
    }
}

/// Estimated offsets of an inertial sensor, in its axes turned to the body's by its mounting.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SensorOffsets {
    /// Offset of the gyro, rad/s.
    pub gyro_rad_s: [f32; 3],
    /// Offset of the accelerometer, m/s^2.
    pub accelerometer_m_s2: [f32; 3],
}

impl SensorOffsets {
    /// No estimate.
    pub const UNKNOWN: Self = Self { gyro_rad_s: [0.0; 3], accelerometer_m_s2: [0.0; 3] };

    /// Whether all offsets are finite.
    #[must_use]
    pub fn is_finite(&self) -> bool {
        self.gyro_rad_s.iter().chain(&self.accelerometer_m_s2).all(|offset| offset.is_finite())
    }
}
