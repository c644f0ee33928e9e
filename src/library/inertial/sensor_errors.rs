//! Errors of an inertial sensor that the attitude filter expects.

use super::sample::GRAVITY_M_S2;
use crate::trig::{DEG, hypot, square};

/// Cross-axis sensitivity of a chip's gyro, 1 sigma: 2 % at most in the MPU-6000 (PS-MPU-6000A rev. 3.4). Waves and the hand
/// tilt faster than the accelerometer corrects, so a calibration takes the gyro's axes for those of the board.
pub const GYRO_CROSS_AXIS: f32 = 0.01;

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
}

/// Change of a gyro's offset with temperature, rad/s/K (table 3 of the LSM6DSL's data sheet).
const GYRO_OFFSET_PER_K: f32 = 0.015 * DEG;

/// Error of an accelerometer's offset that was estimated earlier, m/s^2: 10 mg by soldering and age; 30 K change it by 3 mg.
const KNOWN_ACCELEROMETER_OFFSET_M_S2: f32 = 0.01 * GRAVITY_M_S2;

/// Estimated offsets of an inertial sensor, in its axes turned to the body's by its mounting, and how it is moved.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SensorOffsets {
    /// Offset of the gyro, rad/s.
    pub gyro_rad_s: [f32; 3],
    /// Standard deviations of the gyro's offset, rad/s.
    pub gyro_sigma_rad_s: [f32; 3],
    /// Offset of the accelerometer, m/s^2.
    pub accelerometer_m_s2: [f32; 3],
    /// Temperature of the estimate, degrees Celsius.
    pub temperature_c: f32,
    /// Largest deviation of the velocity from its reference that lasted for seconds, m/s. In a turn the specific force of an aeroplane is
    /// that of level flight: the larger the deviations to be expected, the less it shows at a start.
    pub movement_m_s: f32,
}

impl SensorOffsets {
    /// No estimate.
    pub const UNKNOWN: Self = Self {
        gyro_rad_s: [0.0; 3],
        gyro_sigma_rad_s: [1.0; 3],
        accelerometer_m_s2: [0.0; 3],
        temperature_c: 0.0,
        movement_m_s: 0.0,
    };

    /// Whether all numbers are finite.
    #[must_use]
    pub fn is_finite(&self) -> bool {
        let vectors = [self.gyro_rad_s, self.gyro_sigma_rad_s, self.accelerometer_m_s2];
        vectors.as_flattened().iter().chain([&self.temperature_c, &self.movement_m_s]).all(|number| number.is_finite())
    }

    /// The offsets of an earlier estimate at this temperature.
    #[must_use]
    pub fn at_temperature(self, temperature_c: f32) -> Self {
        let change_rad_s = GYRO_OFFSET_PER_K * (temperature_c - self.temperature_c);
        Self { gyro_sigma_rad_s: self.gyro_sigma_rad_s.map(|sigma_rad_s| hypot(sigma_rad_s, change_rad_s)), ..self }
    }

    /// Variances of the gyro's offset, (rad/s)^2, and of the accelerometer's, (m/s^2)^2, before a new estimate.
    pub(super) fn variances(&self, errors: &InertialSensorErrors) -> ([f32; 3], f32) {
        // Another temperature makes the sigmas of no estimate still larger.
        let is_known = self.gyro_sigma_rad_s[0] < Self::UNKNOWN.gyro_sigma_rad_s[0];
        let accelerometer_m_s2 = errors.accelerometer_offset_m_s2;
        (
            self.gyro_sigma_rad_s.map(|sigma_rad_s| square(sigma_rad_s.min(errors.gyro_offset_rad_s))),
            square(if is_known { accelerometer_m_s2.min(KNOWN_ACCELEROMETER_OFFSET_M_S2) } else { accelerometer_m_s2 }),
        )
    }
}
