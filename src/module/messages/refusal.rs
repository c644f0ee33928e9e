//! Reasons for rejected commands and failed solves.

use super::sample_loss::SampleLoss;
use crate::settings::OutOfRange;
use crate::store::StoreError;
use autoswing::acceptance::Rejection;
use autoswing::calibration::method_selection::Procedure;
use autoswing::calibration::{CollectionPart, SolveError};
use autoswing::collection::CollectionProblem;

/// Reason for a rejected command or a failed solve. Codes and texts are in `message_list.rs`.
#[derive(Clone, Debug, PartialEq)]
pub enum Refusal {
    /// The command is not allowed while armed.
    Armed,
    /// A solve or save is running.
    Busy,
    /// `cal start` during a collection that the user started.
    Collecting {
        /// Procedure of the running collection.
        present_procedure: Procedure,
        /// Procedure of the command.
        requested_procedure: Procedure,
    },
    /// `cal stop` without a collection.
    NotCollecting,
    /// `cal mark` outside a compass swing.
    NotSwinging,
    /// The vehicle moves, or samples are missing.
    NotStationary,
    /// The buffer of marks is full.
    TooManyMarks,
    /// `cal advise` before the first solve.
    NotSolved,
    /// `set align` without a calibration.
    NoCalibration,
    /// `cal show` without a stored calibration.
    NoStoredCalibration,
    /// `cal solve` without samples.
    NoSamples,
    /// Samples are missing or not informative, for a known cause.
    InsufficientSamples {
        /// Code of the refusal that this one replaces.
        code: &'static str,
        /// Expected heading error, degrees RMS, if a solve estimated one.
        expected_rms_deg: Option<f32>,
        /// Cause of the refusal.
        cause: RefusalCause,
    },
    /// Large alignments require the word `yes`.
    LargeAlignment {
        /// Heading of the command, degrees.
        heading_deg: f32,
        /// Resulting heading offset, degrees.
        align_deg: f32,
    },
    /// The magnetometer is not identified yet; a calibration is valid for one sensor only.
    NoSensor,
    /// `set attitude` needs a gyro and an accelerometer, and none answers.
    NoInertialSensor,
    /// `cal undo` without a previous calibration.
    NoPreviousCalibration,
    /// A value is outside its range.
    OutOfRange(OutOfRange),
    /// No calibration fits the samples.
    Solve(SolveError),
    /// The candidate calibration was rejected.
    Rejected(Rejection),
    /// The save failed; the active calibration is unchanged.
    Store(StoreError),
    /// The command is not available in safe mode.
    SafeMode,
}

/// Cause of missing or uninformative samples.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum RefusalCause {
    /// Problem of the samples collected, caused by the manoeuvres flown.
    CollectionProblem(CollectionProblem),
    /// Loss of readings rejected before averaging.
    SampleLoss(SampleLoss),
}

impl From<CollectionProblem> for RefusalCause {
    fn from(problem: CollectionProblem) -> Self {
        Self::CollectionProblem(problem)
    }
}

impl From<SampleLoss> for RefusalCause {
    fn from(loss: SampleLoss) -> Self {
        Self::SampleLoss(loss)
    }
}

impl Refusal {
    /// Adds or replaces the cause, if it is known and applies to this refusal.
    #[must_use]
    pub fn with_cause(self, cause: Option<impl Into<RefusalCause>>) -> Self {
        let is_possible_cause = |cause: &RefusalCause| self.is_curable_by_samples() || self.is_caused_by_arc(*cause);
        let Some(cause) = cause.map(Into::into).filter(is_possible_cause) else { return self };
        let expected_rms_deg = match (cause, &self) {
            (RefusalCause::CollectionProblem(_), Self::Rejected(Rejection::NotAccurate { expected_rms_deg })) => {
                Some(*expected_rms_deg)
            }
            _ => None,
        };
        Self::InsufficientSamples { code: self.stable_code(), expected_rms_deg, cause }
    }

    /// Whether an arc instead of a circle explains the failure: an arc leaves the coefficients undetermined.
    const fn is_caused_by_arc(&self, cause: RefusalCause) -> bool {
        use SolveError::{MountContradicted, NotConverged, TurnsReversed};
        matches!(cause, RefusalCause::CollectionProblem(CollectionProblem::ArcOnly { .. }))
            && matches!(self, Self::Solve(NotConverged | TurnsReversed | MountContradicted { .. }))
    }

    /// Whether more or other samples could give a calibration.
    #[must_use]
    pub const fn is_curable_by_samples(&self) -> bool {
        match self {
            Self::NoSamples | Self::InsufficientSamples { .. } => true,
            Self::Solve(error) => matches!(
                error,
                SolveError::TooFewSamples {
                    part: CollectionPart::LEFT | CollectionPart::RIGHT | CollectionPart::FREE,
                    ..
                } | SolveError::NotAnEllipse(_)
                    | SolveError::NotDetermined(_)
                    | SolveError::SamePlane
            ),
            Self::Rejected(rejection) => {
                matches!(
                    rejection,
                    Rejection::TooFewHeldBack { .. } | Rejection::NotAccurate { .. } | Rejection::Unobservable
                )
            }
            _ => false,
        }
    }
}
