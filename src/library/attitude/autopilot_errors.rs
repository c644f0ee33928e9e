//! Errors of an autopilot's attitude and body rates, as the module's own gyro and accelerometer show them.

use nalgebra::Vector3;

/// Time for which the verticals keep their errors, seconds: a turn. With 30 s, aeroplanes beside which iron of 50 uT passes within 30 s
/// have a heading error of 4.3 deg RMS, with 10 s 1.9, without a measured error of the tilt 3.9.
pub(crate) const TILT_ERROR_TIME_S: f32 = 10.0;

/// Errors of an autopilot; `None` where own sensors do not show them.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct AutopilotErrors {
    /// Error of its roll and pitch.
    pub tilt: Option<TiltError>,
    /// Offset of the gyro whose rates are in use, its or the own one.
    pub gyro_offset: Option<GyroOffset>,
    /// Angle by which the module turns in its mount now beyond what errors of the gyros explain, radians, not negative.
    pub unexplained_turn_rad: f32,
}

/// Error of roll and pitch by the own vertical.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TiltError {
    /// Mean error of roll over a second, rad.
    pub roll_rad: f32,
    /// Mean error of pitch over a second, rad.
    pub pitch_rad: f32,
    /// Variance of each mean, rad^2.
    pub variance_rad2: f32,
    /// Variance of roll and pitch at present, rad^2, by errors that do not last.
    pub noise_variance_rad2: f32,
}

/// Offset of a gyro by the own one, whose offset is known from its last rest.
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
