//! Ports: serial lines to an autopilot or an instrument, and their protocols.
//!
//! A [`Protocol`] performs no I/O. The task of a port (`app::port`) gives it received bytes and a snapshot of the
//! module's state, distributes the decoded messages, and writes its output.

mod detection;
mod mavlink;
mod msp;
mod nmea;
mod schedule;

pub use detection::Port;
pub use mavlink::Mavlink;
pub use msp::Msp;
pub use nmea::Nmea;
pub use schedule::MessageSchedule;

use crate::attitude::AttitudeReport;
use crate::calibration::{Calibration, HeadingUncertainty};
use crate::compass::{Command, IndicatorState};
use crate::earth::{Date, Position};
use crate::heading::{Heading, NoHeading};
use crate::instrument::Estimate;
use crate::settings::{HeadingKind, Settings};
use crate::time::Timestamp;

/// Message received on a port, independent of the protocol.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ReceivedMessage {
    /// Roll and pitch of the selected sender, with body rates if the protocol has them.
    Attitude(AttitudeReport),
    /// Attitude of another sender, which is only counted.
    RejectedAttitude,
    /// Position of the aircraft.
    Position(Position),
    /// Date.
    Date(Date),
    /// Motor current, amperes.
    Current(f32),
    /// Command for the state machine, whose result is awaited.
    Command(Command),
    /// Any other message of the protocol, which shows that the protocol is in use.
    Other,
}

/// Snapshot of the module's state, from which messages are made.
#[derive(Clone, Copy, Debug)]
pub struct Snapshot<'a> {
    /// Current time, not before the estimate's.
    pub now: Timestamp,
    /// Latest estimate.
    pub estimate: &'a Estimate,
    /// Effective settings; a declination that was not entered is the field model's, if known.
    pub settings: &'a Settings,
    /// State of the state machine.
    pub indicator: IndicatorState,
    /// Active calibration with its heading uncertainty; may be none if it was already reported.
    pub calibration: Option<&'a (Calibration, HeadingUncertainty)>,
}

impl Snapshot<'_> {
    /// Heading to send, and its kind: the smoothed heading if it is selected and available, otherwise the raw one.
    #[must_use]
    pub fn selected_heading(&self) -> (Result<Heading, NoHeading>, HeadingKind) {
        match (self.settings.stream_heading, self.estimate.smoothed_heading) {
            (HeadingKind::Smooth, Some(smooth)) => (Ok(smooth), HeadingKind::Smooth),
            _ => (self.estimate.heading, HeadingKind::Raw),
        }
    }
}

/// Bytes to write. A message that does not fit is dropped whole.
#[derive(Debug)]
pub struct TransmitBuffer {
    bytes: [u8; OUTPUT],
    begin: usize,
    end: usize,
    /// Number of messages since the start; wraps, as the other counters do.
    pub messages: u32,
    /// Number of messages without a heading.
    pub empty: u32,
    /// Number of dropped or lost messages.
    pub lost: u32,
}

/// Capacity, bytes, for the longest simultaneous messages: a STATUSTEXT, a VISION_POSITION_ESTIMATE and some smaller
/// ones; or twice three NMEA sentences.
const OUTPUT: usize = 384;

impl Default for TransmitBuffer {
    fn default() -> Self {
        Self::new()
    }
}

impl TransmitBuffer {
    /// Creates an empty buffer.
    #[must_use]
    pub const fn new() -> Self {
        Self { bytes: [0; OUTPUT], begin: 0, end: 0, messages: 0, empty: 0, lost: 0 }
    }

    /// Appends a message given in parts; returns whether there was room.
    pub fn append(&mut self, parts: &[&[u8]]) -> bool {
        self.messages = self.messages.wrapping_add(1);
        let length: usize = parts.iter().map(|part| part.len()).sum();
        if self.end + length > OUTPUT {
            self.bytes.copy_within(self.begin..self.end, 0);
            (self.begin, self.end) = (0, self.end - self.begin);
        }
        if self.end + length > OUTPUT {
            self.lost = self.lost.wrapping_add(1);
            return false;
        }
        for part in parts {
            let end = self.end + part.len();
            if let Some(target) = self.bytes.get_mut(self.end..end) {
                target.copy_from_slice(part);
                self.end = end;
            }
        }
        true
    }

    /// Bytes to write.
    #[must_use]
    pub fn pending(&self) -> &[u8] {
        self.bytes.get(self.begin..self.end).unwrap_or_default()
    }

    /// Removes bytes that were written.
    pub fn consume(&mut self, number: usize) {
        self.begin += number.min(self.end - self.begin);
        if self.begin == self.end {
            self.clear();
        }
    }

    fn clear(&mut self) {
        (self.begin, self.end) = (0, 0);
    }

    /// Drops the pending bytes after a line error.
    pub fn fail(&mut self) {
        self.clear();
        self.lost = self.lost.wrapping_add(1);
    }
}

/// Protocol of a port.
pub trait Protocol {
    /// Processes a received byte; returns the message that it completes.
    fn process_byte(&mut self, at: Timestamp, byte: u8) -> Option<ReceivedMessage>;

    /// Whether the autopilot is armed, if it has reported that recently.
    fn is_armed(&self, now: Timestamp) -> Option<bool>;

    /// Number of broken or impossible frames since the start; wraps.
    fn rejected_frames(&self) -> u32;

    /// Appends due messages. Called for every estimate, at least ten times a second.
    fn poll(&mut self, facts: &Snapshot<'_>, out: &mut TransmitBuffer);
}

#[cfg(test)]
mod tests {
    use super::*;

    pub(super) fn facts<'a>(estimate: &'a Estimate, settings: &'a Settings) -> Snapshot<'a> {
        Snapshot { now: estimate.at, estimate, settings, indicator: IndicatorState::Calibrated, calibration: None }
    }

    #[test]
    fn a_message_is_written_whole_or_not_at_all() {
        let mut out = TransmitBuffer::new();
        assert!(out.append(&[&[1; OUTPUT - 2], &[1]]));
        assert!(!out.append(&[&[2], &[2]]));
        assert_eq!(out.pending(), [1; OUTPUT - 1]);
        assert!(out.append(&[&[3]]));
        assert_eq!((out.messages, out.lost), (3, 1));
        out.consume(OUTPUT - 2);
        assert_eq!(out.pending(), [1, 3]);
        out.fail();
        assert!(out.pending().is_empty());
        assert_eq!(out.lost, 2);
        assert!(out.append(&[&[4; OUTPUT]]));
        out.consume(usize::MAX);
        assert!(out.pending().is_empty());
    }

    /// Written bytes free their room also while others are pending.
    #[test]
    fn room_of_sent_bytes_is_reused() {
        let mut out = TransmitBuffer::new();
        assert!(out.append(&[&[1; OUTPUT]]));
        out.consume(100);
        assert_eq!(out.pending(), [1; OUTPUT - 100]);
        assert!(!out.append(&[&[2; 101]]));
        assert_eq!(out.pending(), [1; OUTPUT - 100]);
        assert!(out.append(&[&[2; 60], &[3; 40]]));
        assert_eq!(out.pending(), [vec![1; OUTPUT - 100], vec![2; 60], vec![3; 40]].concat());
    }
}
