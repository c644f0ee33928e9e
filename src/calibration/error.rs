//! Why samples gave no calibration.

use core::fmt;

use super::{Axis, IronChange, Orientation, Part};

/// Why samples gave no calibration.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum SolveError {
    /// A part has too few samples for any solution.
    TooFewSamples {
        /// The part.
        part: Part,
        /// Samples it has.
        have: u16,
        /// Samples it takes.
        need: u16,
    },
    /// A sample is not a finite number.
    NotFinite,
    /// Level samples are at too few headings.
    TooFewHeadings {
        /// Headings there are, of twelve.
        have: u8,
        /// Headings it takes.
        need: u8,
    },
    /// An axis of the sensor keeps to one end of its range.
    AxisStuck {
        /// The axis, as the chip names it.
        axis: Axis,
    },
    /// The samples of a part do not lie on an ellipse round a centre: too short an arc, or not a turn.
    NotAnEllipse(Part),
    /// The samples leave the coefficients of the method open.
    NotDetermined(Part),
    /// Both sides have about the same bank, so that the two planes do not intersect.
    SamePlane,
    /// The iron changed by so much that nothing explains the samples, or what does cannot be right.
    IronChanged(IronChange),
    /// No start led to a fit that explains the samples.
    NotConverged,
    /// The headings run against the turns: the roll of the attitude source has the wrong sign.
    TurnsReversed,
    /// The inclination that was told is not that of the samples.
    InclinationContradicted {
        /// What the samples show, degrees, positive down.
        found_deg: i8,
    },
    /// The samples say that the sensor is mounted otherwise than configured.
    MountContradicted {
        /// The right-angle mounting nearest to what the samples say.
        found: Orientation,
    },
}

impl SolveError {
    /// That a part has too few samples. Numbers beyond 65,535 are shown as that.
    pub(super) fn too_few(part: Part, have: usize, need: usize) -> Self {
        let [have, need] = [have, need].map(|number| u16::try_from(number).unwrap_or(u16::MAX));
        Self::TooFewSamples { part, have, need }
    }

    /// Asks for so many samples of a part.
    ///
    /// # Errors
    ///
    /// [`SolveError::TooFewSamples`] when there are fewer.
    pub(super) fn require(part: Part, have: usize, need: usize) -> Result<(), Self> {
        if have < need { Err(Self::too_few(part, have, need)) } else { Ok(()) }
    }

    /// Stable code, kebab-case.
    #[must_use]
    pub const fn code(&self) -> &'static str {
        match self {
            Self::TooFewSamples { .. } => "too-few-samples",
            Self::NotFinite => "not-finite",
            Self::TooFewHeadings { .. } => "too-few-headings",
            Self::AxisStuck { .. } => "axis-stuck",
            Self::NotAnEllipse(_) => "not-an-ellipse",
            Self::NotDetermined(_) => "not-determined",
            Self::SamePlane => "same-plane",
            Self::IronChanged(_) => "iron-changed",
            Self::NotConverged => "not-converged",
            Self::TurnsReversed => "turns-reversed",
            Self::InclinationContradicted { .. } => "inclination-contradicted",
            Self::MountContradicted { .. } => "mount-contradicted",
        }
    }
}

/// What to do about it, in words.
impl fmt::Display for SolveError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::TooFewSamples { part, have, need } => {
                write!(f, "{have} of {need} samples of {0}; {1} more {0}", part.name(), part.verb())
            }
            Self::TooFewHeadings { have, need } => {
                write!(f, "{have} of {need} headings, 30 deg apart; turn through all of them")
            }
            Self::NotFinite => {
                f.write_str("a sample is not a number; this is a fault of the firmware, please report it")
            }
            Self::AxisStuck { axis } => {
                write!(
                    f,
                    "the sensor's {} axis is saturated or stuck; move it away from magnets, or replace it",
                    axis.name()
                )
            }
            Self::NotAnEllipse(part) => write!(f, "the {} are no full circle; go round", part.name()),
            Self::NotDetermined(part) => {
                write!(f, "the samples of {} leave the coefficients open; turn all round", part.name())
            }
            Self::SamePlane => f.write_str("left and right bank differ too little; bank 15 deg or more each way"),
            Self::IronChanged(change) => change.fmt(f),
            Self::NotConverged => {
                f.write_str("no coefficients explain the samples; fly again away from iron and wires")
            }
            Self::TurnsReversed => f.write_str("headings run against the turns; check the sign of the source's roll"),
            Self::InclinationContradicted { found_deg } => {
                write!(f, "the samples show an inclination of {found_deg} deg")?;
                write!(f, "; set inclination {found_deg} or none, then cal solve")
            }
            Self::MountContradicted { found } => {
                write!(f, "the sensor seems mounted {0}; set mount {0}, then cal solve", found.name())
            }
        }
    }
}

impl core::error::Error for SolveError {}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::calibration::{Course, Side};

    /// Codes are read by programs and the words by a person in the field: both are promises.
    #[test]
    fn every_error_has_its_code_and_says_what_to_do() {
        let found = Orientation::from_name("yaw90").unwrap();
        for (error, code, words) in [
            (
                SolveError::TooFewSamples { part: Part::Turns(Side::Left), have: 8, need: 12 },
                "too-few-samples",
                "8 of 12 samples of left turns; fly more left turns",
            ),
            (
                SolveError::TooFewSamples { part: Part::Marks, have: 3, need: 4 },
                "too-few-samples",
                "3 of 4 samples of marks; take more marks",
            ),
            (
                SolveError::NotFinite,
                "not-finite",
                "a sample is not a number; this is a fault of the firmware, please report it",
            ),
            (
                SolveError::TooFewHeadings { have: 4, need: 5 },
                "too-few-headings",
                "4 of 5 headings, 30 deg apart; turn through all of them",
            ),
            (
                SolveError::AxisStuck { axis: Axis::Y },
                "axis-stuck",
                "the sensor's y axis is saturated or stuck; move it away from magnets, or replace it",
            ),
            (
                SolveError::NotAnEllipse(Part::Turns(Side::Right)),
                "not-an-ellipse",
                "the right turns are no full circle; go round",
            ),
            (
                SolveError::NotDetermined(Part::Marks),
                "not-determined",
                "the samples of marks leave the coefficients open; turn all round",
            ),
            (
                SolveError::SamePlane,
                "same-plane",
                "left and right bank differ too little; bank 15 deg or more each way",
            ),
            (
                SolveError::IronChanged(IronChange { ut: 14.26, course: Course::Step { after_s: 31 }, of_s: 230 }),
                "iron-changed",
                "iron changed by 14.3 uT after 31 of 230 s; fix what moved and fly again",
            ),
            (
                SolveError::IronChanged(IronChange { ut: 6.04, course: Course::Drift, of_s: 230 }),
                "iron-changed",
                "iron drifted by 6.0 uT in 230 s; wait until temperatures settle and fly again",
            ),
            (
                SolveError::InclinationContradicted { found_deg: -62 },
                "inclination-contradicted",
                "the samples show an inclination of -62 deg; set inclination -62 or none, then cal solve",
            ),
            (
                SolveError::NotConverged,
                "not-converged",
                "no coefficients explain the samples; fly again away from iron and wires",
            ),
            (
                SolveError::TurnsReversed,
                "turns-reversed",
                "headings run against the turns; check the sign of the source's roll",
            ),
            (
                SolveError::MountContradicted { found },
                "mount-contradicted",
                "the sensor seems mounted yaw90; set mount yaw90, then cal solve",
            ),
        ] {
            assert_eq!((error.code(), error.to_string().as_str()), (code, words));
        }
    }

    #[test]
    fn one_sample_too_few_is_too_few() {
        assert_eq!(SolveError::require(Part::Level, 8, 8), Ok(()));
        let missing = SolveError::TooFewSamples { part: Part::Level, have: 7, need: 8 };
        assert_eq!(SolveError::require(Part::Level, 7, 8), Err(missing));
        let many = SolveError::TooFewSamples { part: Part::All, have: u16::MAX, need: u16::MAX };
        assert_eq!(SolveError::too_few(Part::All, 65_536, 70_000), many);
    }
}
