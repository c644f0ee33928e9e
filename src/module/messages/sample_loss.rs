//! Why readings did not become samples.

use core::fmt;

/// Main reason for readings that did not become samples.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SampleLoss {
    /// Percentage of readings at the range limit.
    Saturated(u32),
    /// Attitude reports out of range, such as degrees instead of radians.
    ImpossibleAttitude,
    /// Percentage of readings without attitude.
    NoAttitude(u32),
    /// Percentage of readings without an accurate attitude of the module's own sensors, and no other.
    InaccurateOwnAttitude(u32),
}

impl SampleLoss {
    /// What to do.
    #[must_use]
    pub const fn advice(&self) -> &'static str {
        match self {
            Self::Saturated(_) => "move the sensor away from magnets and wires",
            Self::ImpossibleAttitude => "check their unit: MAVLink's is radians, not degrees",
            Self::NoAttitude(_) => "send ATTITUDE ten times a second or more",
            Self::InaccurateOwnAttitude(_) => "rest for some seconds, then turn and tilt for longer",
        }
    }
}

impl fmt::Display for SampleLoss {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Saturated(percent) => write!(f, "{percent} % of the readings were saturated"),
            Self::ImpossibleAttitude => f.write_str("the attitude reports had impossible values"),
            Self::NoAttitude(percent) => write!(f, "{percent} % of the readings had no attitude"),
            Self::InaccurateOwnAttitude(percent) => {
                write!(f, "for {percent} % of the readings the own attitude was not accurate")
            }
        }
    }
}
