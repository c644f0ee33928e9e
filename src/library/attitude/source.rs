//! Source of the attitude, as the user chooses it.

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
    /// The autopilot's attitude with own body rates, or the own attitude where no autopilot has reported one.
    Automatic,
}

impl AttitudeSource {
    /// Names with their sources, in the order of their numbers.
    pub const NAMED_SOURCES: [(&str, Self); 3] =
        [("autopilot", Self::Autopilot), ("own", Self::Own), ("auto", Self::Automatic)];
}
