//! Why the module did not do what was asked or tried: stable codes, and words that say what to do.

use core::fmt;

use crate::acceptance::Rejection;
use crate::calibration::ladder::Procedure;
use crate::calibration::{Part, SolveError};
use crate::collection::Lack;
use crate::settings::OutOfRange;
use crate::store::StoreError;
use crate::wire::decimal::{AsTyped, Decimal};

/// Why the module did not do what was asked or tried.
#[derive(Clone, Debug, PartialEq)]
pub enum Refusal {
    /// The autopilot is armed, and this is for the ground.
    Armed,
    /// A solve or save is running.
    Busy,
    /// `cal start` in a collection that a person began.
    Collecting {
        /// How it is collected.
        by: Procedure,
        /// How it was to be.
        wanted: Procedure,
    },
    /// `cal stop` without a collection.
    NotCollecting,
    /// `cal mark` outside a swing.
    NotSwinging,
    /// The vehicle moves, or no samples come.
    NotSteady,
    /// There is no room for another mark.
    TooManyMarks,
    /// `cal advise` before anything was solved.
    NotSolved,
    /// `set align` without a calibration.
    NoCalibration,
    /// `cal solve` without samples.
    NoSamples,
    /// There are no samples, or they are too few, or they show too little, for a reason that is known.
    Lacking {
        /// The code of the refusal without that reason.
        code: &'static str,
        /// The expected heading error, degrees RMS, if it came to that.
        expected_rms_deg: Option<f32>,
        /// The reason.
        lack: Lack,
    },
    /// So large an alignment has to be asked for with `yes`.
    LargeAlignment {
        /// The heading that was given, degrees.
        heading_deg: f32,
        /// What would be added to every heading, degrees.
        align_deg: f32,
    },
    /// The magnetometer has not answered yet, so a calibration could not be tied to it.
    NoSensor,
    /// `cal undo` without a calibration before.
    NothingToUndo,
    /// A value outside its range; what it must be.
    OutOfRange(OutOfRange),
    /// The samples gave no calibration.
    Solve(SolveError),
    /// Solved, but not accepted.
    Rejected(Rejection),
    /// A collection was under way when the power went, or the memory that it was in.
    CollectionLost,
    /// Writing failed; the calibration in use is the old one.
    Store(StoreError),
}

impl Refusal {
    /// The same with what was wrong with the flight, if that is known and may be the reason.
    #[must_use]
    pub fn because(self, lack: Option<Lack>) -> Self {
        let Some(lack) = lack.filter(|lack| self.is_for_want_of_samples() || self.is_of_an_arc(*lack)) else {
            return self;
        };
        let expected_rms_deg = match self {
            Self::Rejected(Rejection::NotAccurate { expected_rms_deg }) => Some(expected_rms_deg),
            _ => None,
        };
        Self::Lacking { code: self.code(), expected_rms_deg, lack }
    }

    /// Whether it is what an arc makes of the coefficients that it leaves open, and nothing to rely on.
    const fn is_of_an_arc(&self, lack: Lack) -> bool {
        use SolveError::{MountContradicted, NotConverged, TurnsReversed};
        matches!(lack, Lack::Arc { .. })
            && matches!(self, Self::Solve(NotConverged | TurnsReversed | MountContradicted { .. }))
    }

    /// Whether other samples, or more of them, might mend it.
    #[must_use]
    pub const fn is_for_want_of_samples(&self) -> bool {
        match self {
            Self::NoSamples | Self::Lacking { .. } => true,
            Self::Solve(error) => matches!(
                error,
                SolveError::TooFewSamples { part: Part::Turns(_) | Part::All, .. }
                    | SolveError::NotAnEllipse(_)
                    | SolveError::NotDetermined(_)
                    | SolveError::SamePlane
            ),
            Self::Rejected(rejection) => {
                matches!(rejection, Rejection::TooFewHeldBack { .. } | Rejection::NotAccurate { .. })
            }
            _ => false,
        }
    }

    /// Stable code, kebab-case.
    #[must_use]
    pub fn code(&self) -> &'static str {
        match self {
            Self::Armed => "armed",
            Self::Busy => "busy",
            Self::Collecting { .. } => "collecting",
            Self::NotCollecting => "not-collecting",
            Self::NotSwinging => "not-swinging",
            Self::NotSteady => "not-steady",
            Self::TooManyMarks => "too-many-marks",
            Self::NotSolved => "not-solved",
            Self::NoCalibration => "no-calibration",
            Self::NoSamples => "no-samples",
            Self::Lacking { code, .. } => code,
            Self::LargeAlignment { .. } => "needs-word",
            Self::NoSensor => "no-sensor",
            Self::NothingToUndo => "nothing-to-undo",
            Self::OutOfRange(_) => "out-of-range",
            Self::Solve(error) => error.code(),
            Self::Rejected(rejection) => rejection.code(),
            Self::CollectionLost => "collection-lost",
            Self::Store(error) => error.code(),
        }
    }
}

/// What to do about it, in words.
impl fmt::Display for Refusal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Armed => f.write_str("the autopilot is armed, and this is for the ground; land and disarm it first"),
            Self::Busy => f.write_str("a solve is running; wait for it, or cal abort"),
            Self::Collecting { by, wanted } => {
                write!(f, "{} is being collected; to forget that: cal start {} again", by.name(), wanted.name())
            }
            Self::NotCollecting => f.write_str("nothing is being collected; cal start begins"),
            Self::NotSwinging => f.write_str("no compass swing is under way; cal start swing begins one"),
            Self::NotSteady => f.write_str("the vehicle must stand still for a second, with attitude coming in"),
            Self::TooManyMarks => f.write_str("there is no room for another mark; cal solve"),
            Self::NotSolved => f.write_str("nothing was solved since the start; cal solve first"),
            Self::NoCalibration => f.write_str("there is no calibration in use; calibrate first"),
            Self::NoSamples => {
                f.write_str("there are no samples; cal start, then fly, turning and tilting to all sides")
            }
            Self::Lacking { expected_rms_deg, lack, .. } => {
                if let Some(expected_rms_deg) = *expected_rms_deg {
                    write!(f, "expected error {} deg; ", Decimal::<1>(expected_rms_deg))?;
                }
                lack.fmt(f)
            }
            Self::LargeAlignment { heading_deg, align_deg } => {
                write!(f, "every heading would be turned by {} deg, ", Decimal::<1>(*align_deg))?;
                write!(
                    f,
                    "which is more than a mounting is off; if it is right: set align {} yes",
                    AsTyped(*heading_deg, 0)
                )
            }
            Self::NoSensor => f.write_str("the magnetometer has not answered; check its wiring, see status"),
            Self::NothingToUndo => f.write_str("there is no calibration before this one"),
            Self::OutOfRange(OutOfRange(range)) => f.write_str(range),
            Self::Solve(error) => error.fmt(f),
            Self::Rejected(rejection) => rejection.fmt(f),
            Self::CollectionLost => f.write_str("what was collected went with the power; collect again"),
            Self::Store(error) => error.fmt(f),
        }
    }
}
