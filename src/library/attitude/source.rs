//! Source of the attitude, as the user chooses it.

use crate::inertial::GYRO_CROSS_AXIS;

/// Whether the module may have a gyro and an accelerometer: feature `own-attitude`. A board without them saves the code.
pub const HAS_OWN_ATTITUDE: bool = cfg!(feature = "own-attitude");

/// Source of the attitude.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum AttitudeSource {
    /// Attitude and body rates of the autopilot.
    #[default]
    Autopilot,
    /// Attitude and body rates of the module's own gyro and accelerometer.
    Own,
    /// The autopilot's attitude, checked by the own gyro, or the own attitude where no autopilot has reported one.
    Automatic,
}

impl AttitudeSource {
    /// Names with their sources, in the order of their numbers.
    pub const NAMED_SOURCES: [(&str, Self); 3] =
        [("autopilot", Self::Autopilot), ("own", Self::Own), ("auto", Self::Automatic)];

    /// Cross-axis sensitivity of the gyro, 1 sigma, in the expected error of a calibration. Of an autopilot none is assumed,
    /// nor of `Automatic`, whose attitude is an autopilot's where there is one.
    #[must_use]
    pub const fn gyro_cross_axis(self) -> f32 {
        match self {
            Self::Own => GYRO_CROSS_AXIS,
            Self::Autopilot | Self::Automatic => 0.0,
        }
    }
}
