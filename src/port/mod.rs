//! Ports: a line with an autopilot, or an instrument, at its far end, and what is said on it in which protocol.
//!
//! A [`Protocol`] is a pure value. One task for each port (`app::port`) gives it the bytes that come and what there is to
//! tell, passes on what it has [`Heard`], and writes its [`Output`].

mod ear;
mod line;
mod msp;
mod nmea;
mod pace;

pub use ear::Mavlink;
pub use line::Port;
pub use msp::Msp;
pub use nmea::Nmea;
pub use pace::Pace;

use crate::attitude::Report;
use crate::compass::{Glance, Refusal};
use crate::earth::{Day, Place};
use crate::instrument::Estimate;
use crate::settings::Settings;
use crate::time::Timestamp;

/// What has been heard on a port, in whatever protocol.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Heard {
    /// Roll and pitch, and rates where the protocol has them, of the sender that is believed.
    Attitude(Report),
    /// The same of another sender: counted, and nothing else.
    Foreign,
    /// Where the aircraft is.
    Place(Place),
    /// Today.
    Day(Day),
    /// Somebody wants something, and waits for [`Protocol::answer`].
    Asked(Order),
}

/// What can be asked for on a port.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Order {
    /// Begin to collect: `cal start`.
    Start,
    /// Solve with what there is: `cal solve`.
    Accept,
    /// Stop and forget: `cal abort`.
    Cancel,
    /// Restart the module.
    Reboot,
}

/// What there is to tell.
#[derive(Clone, Copy, Debug)]
pub struct Facts<'a> {
    /// This instant: that of the estimate, or later.
    pub now: Timestamp,
    /// The newest estimate.
    pub estimate: &'a Estimate,
    /// Settings in force; a declination among them that was not entered is that of the field model, if it is known.
    pub settings: &'a Settings,
    /// The state machine at a glance.
    pub glance: Glance,
}

/// Bytes to be written. A message that does not fit is left away whole.
#[derive(Debug, Default)]
pub struct Output {
    bytes: heapless::Vec<u8, OUTPUT>,
    /// Messages since the start; wraps, as the others do.
    pub told: u32,
    /// Those among them that had no heading to tell.
    pub empty: u32,
    /// Those that were left away, or lost.
    pub lost: u32,
}

/// The longest there is at once: a STATUSTEXT, a VISION_POSITION_ESTIMATE and some smaller ones; or three NMEA sentences
/// after three.
const OUTPUT: usize = 384;

impl Output {
    /// Nothing to write.
    #[must_use]
    pub const fn new() -> Self {
        Self { bytes: heapless::Vec::new(), told: 0, empty: 0, lost: 0 }
    }

    /// Appends a message, of several parts; whether there was room for it.
    pub fn message(&mut self, parts: &[&[u8]]) -> bool {
        self.told = self.told.wrapping_add(1);
        let before = self.bytes.len();
        let fits = parts.iter().all(|part| self.bytes.extend_from_slice(part).is_ok());
        if !fits {
            self.bytes.truncate(before);
            self.lost = self.lost.wrapping_add(1);
        }
        fits
    }

    /// What is to be written.
    #[must_use]
    pub fn pending(&self) -> &[u8] {
        &self.bytes
    }

    /// So many bytes of it have been written.
    pub fn written(&mut self, number: usize) {
        let number = number.min(self.bytes.len());
        self.bytes.rotate_left(number);
        self.bytes.truncate(self.bytes.len() - number);
    }

    /// The line has failed: what was to be written is lost.
    pub fn fail(&mut self) {
        self.bytes.clear();
        self.lost = self.lost.wrapping_add(1);
    }
}

/// What is said on a line, and understood of it.
pub trait Protocol {
    /// Takes a byte that came at an instant.
    fn byte(&mut self, at: Timestamp, byte: u8) -> Option<Heard>;

    /// Whether the autopilot at the far end is armed, if it has said so lately.
    fn is_armed(&self, now: Timestamp) -> Option<bool>;

    /// Frames that were not taken because they were broken or impossible, since the start; wraps.
    fn rejected(&self) -> u32;

    /// Appends what is due. It is called for every estimate, so at least ten times a second.
    fn poll(&mut self, facts: &Facts<'_>, out: &mut Output);

    /// What became of the last order.
    fn answer(&mut self, _order: Order, _result: Result<(), &Refusal>) {}

    /// A line for whoever looks at a ground station, as the console shows it after `note `.
    fn note(&mut self, _text: &str) {}
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What there is to tell of an estimate.
    pub(super) fn facts<'a>(estimate: &'a Estimate, settings: &'a Settings) -> Facts<'a> {
        Facts { now: estimate.at, estimate, settings, glance: Glance::Calibrated }
    }

    #[test]
    fn a_message_is_written_whole_or_not_at_all() {
        let mut out = Output::new();
        assert!(out.message(&[&[1; OUTPUT - 2], &[1]]));
        assert!(!out.message(&[&[2], &[2]]));
        assert_eq!(out.pending(), [1; OUTPUT - 1]);
        assert!(out.message(&[&[3]]));
        assert_eq!((out.told, out.lost), (3, 1));
        out.written(OUTPUT - 2);
        assert_eq!(out.pending(), [1, 3]);
        out.fail();
        assert!(out.pending().is_empty());
        assert_eq!(out.lost, 2);
        assert!(out.message(&[&[4; OUTPUT]]));
        out.written(usize::MAX);
        assert!(out.pending().is_empty());
    }
}
