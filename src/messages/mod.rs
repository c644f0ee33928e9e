//! Messages: everything that the module reports to people, in one list.
//!
//! | file | holds |
//! |---|---|
//! | `mod.rs` | [`Message`] and its severity |
//! | `refusal.rs` | [`Refusal`]: why a command or a solve was refused |
//! | `list.rs` | the list: stable code, what happened and what to do, an entry for each message and each refusal |
//!
//! The console writes a message after `note `, MAVLink sends it as a STATUSTEXT of its severity. The errors of the rooms
//! below have one plain clause each; advice and severity are here.

mod list;
mod refusal;
#[cfg(test)]
mod tests;

pub use refusal::{Refusal, RefusalCause};

use core::fmt::{self, Display};

use crate::calibration::{Calibration, Envelope, Quality};
use crate::decimal::Decimal;
use crate::instrument::HardIronChange;
use crate::store::StoreError;
use crate::trig;

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
    /// A collection was running when the power failed; its samples are lost.
    CollectionLost,
    /// Progress of a collection, percent. MAVLink only.
    Collecting(u8),
    /// End of a collection, before its solve. MAVLink only.
    CollectionEnded,
    /// Hard iron changed since the calibration.
    HardIronChanged(HardIronChange),
    /// Hard iron is as calibrated again.
    HardIronRestored,
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
            Self::Solved(Ok(_)) | Self::Collecting(_) | Self::CollectionEnded | Self::HardIronRestored => {
                Severity::Info
            }
            Self::Solved(Err(_))
            | Self::CommandRejected(_)
            | Self::StoreFailed(_)
            | Self::CollectionLost
            | Self::HardIronChanged(_) => Severity::Warning,
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

    const fn is_refusal(&self) -> bool {
        matches!(self, Self::Solved(Err(_)) | Self::CommandRejected(_) | Self::StoreFailed(_))
    }
}

/// Line for the user: `<code>: what happened; what to do`, with `refused ` in front of a refusal.
impl Display for Message {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let refused = if self.is_refusal() { "refused " } else { "" };
        write!(f, "{refused}{}: {}", self.code(), self.text())
    }
}

/// Expected accuracy of a calibration.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ExpectedAccuracy {
    /// Quality.
    pub quality: Quality,
    /// Heading error per degree of attitude error in level flight, at the worst heading (dimensionless). `None` if the
    /// inclination is unknown, as after tumbling.
    pub heading_deg_per_attitude_deg: Option<f32>,
}

impl ExpectedAccuracy {
    /// A tilt about magnetic north rotates the vertical field into the horizontal one: `d psi = tan(inclination) d
    /// phi`, from Liu 2007 eq. 3.
    #[inline(never)]
    pub(crate) fn new(quality: Quality, calibration: &Calibration) -> Self {
        let (sin, cos) = trig::sin_cos(calibration.inclination_rad);
        let attitude_cost = quality.knows_inclination.then_some((sin / cos).abs());
        Self { quality, heading_deg_per_attitude_deg: attitude_cost }
    }
}

impl Display for ExpectedAccuracy {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        ExpectedErrorText(&self.quality).fmt(f)?;
        match self.heading_deg_per_attitude_deg {
            Some(cost) => write!(f, "; a degree of attitude error costs {} deg", Decimal::<2>(cost)),
            None => Ok(()),
        }
    }
}

/// Expected heading error as text.
pub(crate) struct ExpectedErrorText<'a>(pub &'a Quality);

impl Display for ExpectedErrorText<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (rms, worst) = (Decimal::<2>(self.0.expected_rms_deg), Decimal::<2>(self.0.expected_worst_deg));
        let envelope = match self.0.envelope {
            Envelope::Banked => "",
            Envelope::Level => ", level only",
        };
        write!(f, "expected error {rms} deg rms, sigma {worst} deg at the worst heading{envelope}")
    }
}
