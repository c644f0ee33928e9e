//! Format of a parameter file.

use crate::log::AutopilotKind;

/// Format of a parameter file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ParameterFormat {
    /// ArduPilot `COMPASS_*`, name and value a line.
    ArduPilot,
    /// PX4 `CAL_MAGn_*`, as QGroundControl loads them.
    Px4,
    /// INAV command lines.
    Inav,
}

impl ParameterFormat {
    /// The format of the autopilot that wrote the log.
    #[must_use]
    pub const fn for_autopilot(autopilot: AutopilotKind) -> Self {
        match autopilot {
            AutopilotKind::Px4 => Self::Px4,
            AutopilotKind::Inav => Self::Inav,
            AutopilotKind::ArduPilot | AutopilotKind::Unknown => Self::ArduPilot,
        }
    }

    /// Name of the parameter file.
    #[must_use]
    pub const fn file_name(self) -> &'static str {
        match self {
            Self::ArduPilot => "compass.param",
            // The extension of QGroundControl's files.
            Self::Px4 => "compass.params",
            Self::Inav => "compass.txt",
        }
    }
}
