//! Activities of the state machine: a collection, a solve with the save of its calibration.

use crate::store::CalibrationRecord;
use autoswing::calibration::{Solution, Solver};
use autoswing::reading::Identity;

/// Who started a collection.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum CollectionStarter {
    User,
    /// The module started the collection, which pauses while the vehicle is disarmed.
    Module,
}

#[expect(clippy::large_enum_variant, reason = "there is one of it, and no heap to put it on")]
#[derive(Debug)]
pub(super) enum Activity {
    Idle,
    Collecting(CollectionStarter),
    Solving(Solve),
}

/// A solve, up to the save of its calibration.
#[derive(Debug)]
pub(super) struct Solve {
    pub stage: SolveStage,
    pub purpose: SolvePurpose,
    /// Sensor at the start of the solve; the calibration is valid for it alone.
    pub sensor: DetectedSensor,
}

#[expect(clippy::large_enum_variant, reason = "there is one of it, and no heap to put it on")]
#[derive(Debug)]
pub(super) enum SolveStage {
    Fitting(Solver),
    Verifying(Solution),
    /// Save of the accepted calibration.
    Saving(CalibrationRecord),
}

#[derive(Clone, Copy, Debug)]
pub(super) enum SolvePurpose {
    /// Trial solve: the collection continues, unless the result ends it.
    Trial(CollectionStarter),
    /// Calibration from the samples of a collection, if one is in progress; a failure ends it unless it is automatic.
    Calibration(Option<CollectionStarter>),
}

impl Activity {
    /// Who started the collection in progress.
    pub const fn starter(&self) -> Option<CollectionStarter> {
        match self {
            Self::Idle => None,
            Self::Collecting(starter) => Some(*starter),
            Self::Solving(solve) => match solve.purpose {
                SolvePurpose::Trial(starter) => Some(starter),
                SolvePurpose::Calibration(starter) => starter,
            },
        }
    }

    pub fn is_automatic(&self) -> bool {
        self.starter() == Some(CollectionStarter::Module)
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct DetectedSensor {
    pub identity: Identity,
    pub readings_per_sample: u16,
}
