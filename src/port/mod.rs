//! Ports: a line with an autopilot, or an instrument, at its far end, and what is said on it in which protocol.
//!
//! A [`Protocol`] is a pure value. One task for each port (`app::port`) gives it the bytes that come and what there is to
//! tell, passes on what it has [`Heard`], and writes its [`Output`].
//!
//! Which protocols there are is chosen by the Cargo features `mavlink`, `msp` and `nmea`, here and in [`wire`](crate::wire);
//! one that is left out is [`LeftOut`], and [`ProtocolKind::is_here`](crate::settings::ProtocolKind::is_here) knows of it.

mod left_out;
mod line;
#[cfg(feature = "mavlink")]
mod mavlink;
#[cfg(feature = "msp")]
mod msp;
#[cfg(feature = "nmea")]
mod nmea;
mod pace;

#[cfg(not(any(feature = "mavlink", feature = "msp", feature = "nmea")))]
compile_error!("without a protocol nobody learns the heading: choose one of the features mavlink, msp and nmea");

pub use left_out::LeftOut;
#[cfg(not(feature = "mavlink"))]
pub use left_out::LeftOut as Mavlink;
#[cfg(not(feature = "msp"))]
pub use left_out::LeftOut as Msp;
#[cfg(not(feature = "nmea"))]
pub use left_out::LeftOut as Nmea;
pub use line::Port;
#[cfg(feature = "mavlink")]
pub use mavlink::Mavlink;
#[cfg(feature = "msp")]
pub use msp::Msp;
#[cfg(feature = "nmea")]
pub use nmea::Nmea;
pub use pace::Pace;

use crate::attitude::Report;
use crate::calibration::{Calibration, Uncertainty};
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
    /// The current that the motors draw, amperes.
    Current(f32),
    /// Somebody wants something, and waits for [`Protocol::answer`].
    Asked(Order),
    /// Anything else in this protocol: somebody is there.
    Life,
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
    /// The calibration in use, and how wrong a heading by it may be; none also if it is the one that was told last
    /// ([`Port::has_not_seen`]).
    pub calibration: Option<&'a (Calibration, Uncertainty)>,
}

/// Bytes to be written. A message that does not fit is left away whole.
#[derive(Debug)]
pub struct Output {
    bytes: [u8; OUTPUT],
    /// Where those that wait begin and end.
    begin: usize,
    end: usize,
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

impl Default for Output {
    fn default() -> Self {
        Self::new()
    }
}

impl Output {
    /// Nothing to write.
    #[must_use]
    pub const fn new() -> Self {
        Self { bytes: [0; OUTPUT], begin: 0, end: 0, told: 0, empty: 0, lost: 0 }
    }

    /// Appends a message, of several parts; whether there was room for it.
    pub fn message(&mut self, parts: &[&[u8]]) -> bool {
        self.told = self.told.wrapping_add(1);
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
            if let Some(room) = self.bytes.get_mut(self.end..end) {
                room.copy_from_slice(part);
                self.end = end;
            }
        }
        true
    }

    /// What is to be written.
    #[must_use]
    pub fn pending(&self) -> &[u8] {
        self.bytes.get(self.begin..self.end).unwrap_or_default()
    }

    /// So many bytes of it have been written.
    pub fn written(&mut self, number: usize) {
        self.begin += number.min(self.end - self.begin);
        if self.begin == self.end {
            self.clear();
        }
    }

    fn clear(&mut self) {
        (self.begin, self.end) = (0, 0);
    }

    /// The line has failed: what was to be written is lost.
    pub fn fail(&mut self) {
        self.clear();
        self.lost = self.lost.wrapping_add(1);
    }
}

/// What is said on a line, and understood of it.
pub trait Protocol {
    /// Takes a byte that came at an instant: none while it completes no message that is looked for.
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
        Facts { now: estimate.at, estimate, settings, glance: Glance::Calibrated, calibration: None }
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

    /// What has been written leaves its room to what comes, also when something is left.
    #[test]
    fn room_that_was_left_is_used() {
        let mut out = Output::new();
        assert!(out.message(&[&[1; OUTPUT]]));
        out.written(100);
        assert_eq!(out.pending(), [1; OUTPUT - 100]);
        assert!(!out.message(&[&[2; 101]]));
        assert_eq!(out.pending(), [1; OUTPUT - 100]);
        assert!(out.message(&[&[2; 60], &[3; 40]]));
        assert_eq!(out.pending(), [vec![1; OUTPUT - 100], vec![2; 60], vec![3; 40]].concat());
    }
}
