//! Source of the attitude, as the user chooses it.

/// Source of the attitude.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum AttitudeSource {
    /// Attitude and body rates of the autopilot.
    Autopilot,
    /// Attitude and body rates of the module's own gyro and accelerometer.
    Own,
    /// The autopilot's attitude with own body rates, or the own attitude where no autopilot has reported one.
    #[default]
    Automatic,
}

impl AttitudeSource {
    /// All sources with their names, in the order of their numbers.
    pub const ALL_SOURCES: [(Self, &str); 3] =
        [(Self::Autopilot, "autopilot"), (Self::Own, "own"), (Self::Automatic, "auto")];
}
