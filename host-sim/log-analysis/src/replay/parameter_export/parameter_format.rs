//! Format of a parameter file.

use serde::{Deserialize, Serialize};

use crate::log::AutopilotKind;

/// Format of a parameter file.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
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

/// Terms of the correction that a file has.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum CorrectedTerms {
    /// Offsets alone.
    Offsets,
    /// Offsets, and one scale of all axes, which bends no heading.
    Scale,
    /// Offsets, matrix, motor current and orientation.
    #[default]
    All,
}

impl CorrectedTerms {
    /// Number of offsets, then diagonal, then further elements of the matrix that are fitted in a format.
    pub(super) const fn unknown_count(self, format: ParameterFormat) -> usize {
        match (self, format) {
            (Self::Offsets | Self::Scale, _) => 3,
            (Self::All, ParameterFormat::Inav) => 6,
            (Self::All, _) => 9,
        }
    }
}
