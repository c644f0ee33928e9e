//! Unsolicited messages.

use crate::messages::accuracy::ExpectedAccuracy;
use crate::messages::autopilot_report::{AutopilotReport, ParameterState};
use crate::messages::refusal::{Refusal, RefusalCause};
use crate::store::StoreError;
use autoswing::instrument::InstallationChange;

/// Unsolicited report to the user.
#[derive(Clone, Debug, PartialEq)]
pub enum Message {
    /// End of a solve.
    Solved(SolveOutcome),
    /// A command from a port was rejected. The console replies to its own commands.
    CommandRejected(Refusal),
    /// The flash failed without a command: at the start it is unreadable, which leaves default settings and no
    /// calibration; later it does not complete a save.
    StoreFailed(StoreError),
    /// A collection was running when the power failed; the samples are lost.
    CollectionLost,
    /// Progress of a collection, percent. MAVLink only.
    Collecting(u8),
    /// End of a collection, before its solve. MAVLink only.
    CollectionEnded,
    /// Hard iron changed, or the module turned in its mount, since the calibration.
    InstallationChanged(InstallationChange),
    /// The installation is as calibrated again.
    InstallationRestored,
    /// The headings have become uncertain in straight flight.
    TurnRequested {
        /// Standard deviation of the heading, radians.
        sigma_rad: f32,
    },
    /// The pitch that a quadplane subtracts from its attitude depends on its mode, which the module does not know.
    TrimsAmbiguous,
    /// Another module is the same MAVLink component of the autopilot's system.
    ComponentTaken {
        /// The component.
        taken: u8,
        /// Component of this module from now on.
        component: u8,
    },
    /// Another node on the CAN bus has the number of this one.
    NodeNumberConflict {
        /// The number.
        number: u8,
        /// Whether this node takes another number. Otherwise it sends no field.
        is_given_up: bool,
    },
    /// Result of a check or a setup of the autopilot.
    Autopilot(AutopilotReport),
    /// The module is in safe mode after repeated panics.
    SafeMode,
}

/// Result of a solve: expected accuracy of the new active calibration, or the reason for its absence.
pub type SolveOutcome = Result<ExpectedAccuracy, Refusal>;

/// Severity of a message.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Severity {
    /// No action required.
    Info,
    /// User action required.
    Warning,
}

impl Message {
    /// Severity of the message.
    #[must_use]
    pub const fn severity(&self) -> Severity {
        match self {
            Self::Solved(Ok(_))
            | Self::Collecting(_)
            | Self::CollectionEnded
            | Self::InstallationRestored
            | Self::ComponentTaken { .. } => Severity::Info,
            Self::Autopilot(report) => report.severity(),
            Self::Solved(Err(_))
            | Self::CommandRejected(_)
            | Self::StoreFailed(_)
            | Self::CollectionLost
            | Self::InstallationChanged(_)
            | Self::TurnRequested { .. }
            | Self::TrimsAmbiguous
            | Self::NodeNumberConflict { .. }
            | Self::SafeMode => Severity::Warning,
        }
    }

    /// Adds a known, applicable cause to a refused solve.
    #[must_use]
    pub fn with_cause(self, cause: Option<impl Into<RefusalCause>>) -> Self {
        match self {
            Self::Solved(Err(refusal)) => Self::Solved(Err(refusal.with_cause(cause))),
            other => other,
        }
    }

    pub(super) const fn is_refusal(&self) -> bool {
        matches!(self, Self::Solved(Err(_)) | Self::CommandRejected(_) | Self::StoreFailed(_))
    }
}

impl AutopilotReport {
    const fn severity(&self) -> Severity {
        match self {
            Self::Compass(_) | Self::Trims(_) | Self::Heading(_) | Self::Summary(_) => Severity::Info,
            Self::Parameter(report) => match report.state {
                ParameterState::Changed => Severity::Info,
                ParameterState::Wrong | ParameterState::NotChanged | ParameterState::Missing => Severity::Warning,
            },
            Self::NoAutopilot
            | Self::NoReply
            | Self::Armed
            | Self::NotKept
            | Self::NothingReplaced
            | Self::OtherAutopilot
            | Self::CorrectedTwice { .. }
            | Self::NoCompass => Severity::Warning,
        }
    }
}
