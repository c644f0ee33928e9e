//! Why the module did not do what was asked or tried: stable codes, and words that say what to do.

use core::fmt;

use crate::acceptance::Rejection;
use crate::calibration::SolveError;
use crate::settings::OutOfRange;
use crate::store::StoreError;

/// Why the module did not do what was asked or tried.
#[derive(Clone, Debug, PartialEq)]
pub enum Refusal {
    /// The autopilot is armed, and this is for the ground.
    Armed,
    /// A solve or save is running.
    Busy,
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
    /// Writing failed; the calibration in use is the old one.
    Store(StoreError),
}

impl Refusal {
    /// Stable code, kebab-case.
    #[must_use]
    pub fn code(&self) -> &'static str {
        match self {
            Self::Armed => "armed",
            Self::Busy => "busy",
            Self::NotCollecting => "not-collecting",
            Self::NotSwinging => "not-swinging",
            Self::NotSteady => "not-steady",
            Self::TooManyMarks => "too-many-marks",
            Self::NotSolved => "not-solved",
            Self::NoCalibration => "no-calibration",
            Self::NoSamples => "no-samples",
            Self::NoSensor => "no-sensor",
            Self::NothingToUndo => "nothing-to-undo",
            Self::OutOfRange(_) => "out-of-range",
            Self::Solve(error) => error.code(),
            Self::Rejected(rejection) => rejection.code(),
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
            Self::NotCollecting => f.write_str("nothing is being collected; cal start begins"),
            Self::NotSwinging => f.write_str("no compass swing is under way; cal start swing begins one"),
            Self::NotSteady => f.write_str("the vehicle must stand still for a second, with attitude coming in"),
            Self::TooManyMarks => f.write_str("there is no room for another mark; cal solve"),
            Self::NotSolved => f.write_str("nothing was solved since the start; cal solve first"),
            Self::NoCalibration => f.write_str("there is no calibration in use; calibrate first"),
            Self::NoSamples => f.write_str("there are no samples; cal start, then fly left and right turns"),
            Self::NoSensor => f.write_str("the magnetometer has not answered; check its wiring, see status"),
            Self::NothingToUndo => f.write_str("there is no calibration before this one"),
            Self::OutOfRange(OutOfRange(range)) => f.write_str(range),
            Self::Solve(error) => error.fmt(f),
            Self::Rejected(rejection) => rejection.fmt(f),
            Self::Store(error) => error.fmt(f),
        }
    }
}
