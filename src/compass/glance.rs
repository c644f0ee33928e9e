//! The state machine at a glance: what a lamp can tell of it.

use super::{Compass, Prospect, Refusal, State};
use crate::calibration::ladder::Procedure;

/// The state at a glance.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Glance {
    /// Uncalibrated, and nothing is collected.
    Waiting,
    /// A collection is under way, and so much of it is done, 0..=100 percent.
    Collecting(u8),
    /// A calibration is in use.
    Calibrated,
    /// Uncalibrated, and the last solve was refused.
    Refused,
}

impl Compass<'_> {
    /// The state at a glance.
    #[must_use]
    pub fn glance(&self) -> Glance {
        match self.state() {
            State::Uncalibrated => match self.last {
                // The next flight mends it.
                None | Some(Ok(_) | Err(Refusal::CollectionLost)) => Glance::Waiting,
                Some(Err(_)) => Glance::Refused,
            },
            State::Collecting if self.awaits_arming() => Glance::Waiting,
            State::Collecting => Glance::Collecting(self.done_percent()),
            State::Solving | State::Verifying => Glance::Collecting(100),
            State::Calibrated => Glance::Calibrated,
        }
    }

    /// How much of the collection is done. Of a flight, how near the expected error is to the wanted one; of what a person
    /// ends, nothing is known.
    fn done_percent(&self) -> u8 {
        let progress = self.collector.progress();
        match progress.procedure {
            Procedure::Turns => progress.left.percent.midpoint(progress.right.percent),
            Procedure::Level => progress.level.percent,
            Procedure::Flight => {
                let expected_deg = self.trials.prospect.as_ref().and_then(|prospect: &Prospect| prospect.expected_deg);
                // The cast saturates, and takes what is no number to nothing.
                expected_deg.map_or(0, |deg| (100.0 * self.settings.accuracy_deg / deg).min(100.0) as u8)
            }
            Procedure::Swing | Procedure::Tumble => 0,
        }
    }
}
