//! Errors of a solve.

use core::fmt;

use super::hard_iron_change::DetectedHardIronChange;
use super::orientation::Orientation;
use super::samples::CollectionPart;

/// An axis of the chip.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Axis {
    /// x axis of the chip.
    X,
    /// y axis of the chip.
    Y,
    /// z axis of the chip.
    Z,
}

impl Axis {
    /// Lower-case letter of the axis.
    #[must_use]
    pub const fn axis_name(self) -> &'static str {
        match self {
            Self::X => "x",
            Self::Y => "y",
            Self::Z => "z",
        }
    }
}

/// Reason for a failed solve.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum SolveError {
    /// A part has fewer samples than any solution needs.
    TooFewSamples {
        /// Part of the collection that lacks samples, such as its left turns.
        part: CollectionPart,
        /// Number of samples in the part.
        have: u16,
        /// Required number of samples.
        need: u16,
    },
    /// A sample has a non-finite value.
    NotFinite,
    /// Level samples cover too few headings.
    TooFewHeadings {
        /// Number of headings covered, of twelve.
        have: u8,
        /// Required number of headings.
        need: u8,
    },
    /// An axis of the sensor stays at one end of its range.
    AxisStuck {
        /// Chip axis.
        axis: Axis,
    },
    /// The samples of a part are not on an ellipse: too short an arc, or not a turn.
    NotAnEllipse(CollectionPart),
    /// The samples do not determine the coefficients.
    NotDetermined(CollectionPart),
    /// Both sides have nearly the same bank, so their planes do not intersect.
    SamePlane,
    /// The hard iron changed so much that no plausible fit exists.
    HardIronChanged(DetectedHardIronChange),
    /// No starting point led to an acceptable fit.
    NotConverged,
    /// Headings run against the turns: the attitude source's roll has the wrong sign.
    TurnsReversed,
    /// The configured inclination contradicts the samples.
    InclinationContradicted {
        /// Inclination of the samples, degrees, positive down.
        found_deg: i8,
    },
    /// The configured mounting contradicts the samples.
    MountContradicted {
        /// Right-angle mounting nearest to the fit.
        found: Orientation,
    },
}

impl SolveError {
    /// Error of a part with too few samples; numbers saturate at 65,535.
    pub(in crate::calibration) fn too_few(part: CollectionPart, have: usize, need: usize) -> Self {
        let [have, need] = [have, need].map(|number| u16::try_from(number).unwrap_or(u16::MAX));
        Self::TooFewSamples { part, have, need }
    }

    ///
    /// # Errors
    ///
    /// [`SolveError::TooFewSamples`] when `have < need`.
    pub(in crate::calibration) fn require_samples(part: CollectionPart, have: usize, need: usize) -> Result<(), Self> {
        if have < need { Err(Self::too_few(part, have, need)) } else { Ok(()) }
    }
}

impl fmt::Display for SolveError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::TooFewSamples { part, have, need } => write!(f, "{have} of {need} samples of {}", part.part_name()),
            Self::NotFinite => f.write_str("a sample is not a finite number"),
            Self::TooFewHeadings { have, need } => write!(f, "{have} of {need} headings, 30 deg apart"),
            Self::AxisStuck { axis } => write!(f, "the sensor's {} axis is saturated or stuck", axis.axis_name()),
            Self::NotAnEllipse(part) => write!(f, "the {} are no full circle", part.part_name()),
            Self::NotDetermined(part) => {
                write!(f, "the samples of {} do not determine the coefficients", part.part_name())
            }
            Self::SamePlane => f.write_str("left and right bank differ too little"),
            Self::HardIronChanged(change) => change.fmt(f),
            Self::NotConverged => f.write_str("no coefficients explain the samples"),
            Self::TurnsReversed => f.write_str("the headings run against the turns"),
            Self::InclinationContradicted { found_deg } => {
                write!(f, "the samples show an inclination of {found_deg} deg")
            }
            Self::MountContradicted { found } => {
                write!(f, "the sensor seems to be mounted {}", found.orientation_name())
            }
        }
    }
}

impl core::error::Error for SolveError {}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_part_one_sample_short_is_rejected() {
        assert_eq!(SolveError::require_samples(CollectionPart::LEVEL, 8, 8), Ok(()));
        let missing = SolveError::TooFewSamples { part: CollectionPart::LEVEL, have: 7, need: 8 };
        assert_eq!(SolveError::require_samples(CollectionPart::LEVEL, 7, 8), Err(missing));
        let saturated = SolveError::TooFewSamples { part: CollectionPart::FREE, have: u16::MAX, need: u16::MAX };
        assert_eq!(SolveError::too_few(CollectionPart::FREE, 65_536, 70_000), saturated);
    }
}
