//! Source of the attitude, as the user chooses it.

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
