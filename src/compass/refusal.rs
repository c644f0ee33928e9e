//! Why the module did not do what was asked or tried: stable codes, and words that say what to do.

use core::fmt;

use crate::calibration::SolveError;
use crate::store::StoreError;
use crate::wire::decimal::Decimal;

/// Why the module did not do what was asked or tried.
#[derive(Clone, Debug, PartialEq)]
pub enum Refusal {
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
    OutOfRange(&'static str),
    /// The samples gave no calibration.
    Solve(SolveError),
    /// Too few samples were held back on a side to verify with.
    TooFewHeldBack {
        /// How many there are.
        have: u16,
        /// How many it takes.
        need: u16,
    },
    /// Solved, but not accurate enough to be of use.
    NotAccurate {
        /// Expected heading error, degrees RMS.
        expected_rms_deg: f32,
    },
    /// On held-back samples it is no better than the one in use.
    NotBetter {
        /// Score of the new one, smaller is better.
        candidate: f32,
        /// Score of the one in use.
        incumbent: f32,
    },
    /// The samples determine less than those of the calibration in use did, and do not contradict it.
    Thinner {
        /// Expected heading error, degrees RMS.
        expected_rms_deg: f32,
        /// That of the calibration in use.
        incumbent_rms_deg: f32,
    },
    /// Writing failed; the calibration in use is the old one.
    Store(StoreError),
}

impl Refusal {
    /// Stable code, kebab-case.
    #[must_use]
    pub fn code(&self) -> &'static str {
        match self {
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
            Self::TooFewHeldBack { .. } => "too-few-held-back",
            Self::NotAccurate { .. } => "not-accurate",
            Self::NotBetter { .. } => "not-better",
            Self::Thinner { .. } => "thinner",
            Self::Store(error) => error.code(),
        }
    }
}

/// What to do about it, in words.
impl fmt::Display for Refusal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
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
            Self::OutOfRange(what) => f.write_str(what),
            Self::Solve(error) => error.fmt(f),
            Self::TooFewHeldBack { have, need } => {
                write!(f, "{have} of {need} samples to verify with on the thinner side; fly longer turns each way")
            }
            Self::NotAccurate { expected_rms_deg } => {
                let expected = Decimal::<1>(*expected_rms_deg);
                write!(f, "expected error {expected} deg; fly full circles both ways with steadier bank")
            }
            Self::NotBetter { candidate, incumbent } => {
                let (candidate, incumbent) = (Decimal::<2>(*candidate), Decimal::<2>(*incumbent));
                write!(f, "score {candidate} against {incumbent} of the one in use, which stays")
            }
            Self::Thinner { expected_rms_deg, incumbent_rms_deg } => {
                let (new, old) = (Decimal::<1>(*expected_rms_deg), Decimal::<1>(*incumbent_rms_deg));
                write!(f, "expected error {new} deg, {old} deg of the one in use, which stays; see cal advise")
            }
            Self::Store(error) => error.fmt(f),
        }
    }
}
