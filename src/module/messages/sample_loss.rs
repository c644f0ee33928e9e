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
}

impl fmt::Display for SampleLoss {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Saturated(percent) => write!(f, "{percent} % of the readings were saturated"),
            Self::ImpossibleAttitude => f.write_str("the attitude reports had impossible values"),
            Self::NoAttitude(percent) => write!(f, "{percent} % of the readings had no attitude"),
        }
    }
}
