//! Which line's attitude is taken, where it comes on several.
//!
//! The same autopilot may tell it on two lines, by MAVLink with body rates and by MSP without, or two may tell different
//! ones. Mixed they would be an attitude that jumps. So one line is taken while it talks, and one that has rates takes the
//! place of one that has none.

use crate::time::Timestamp;

/// A line that says nothing for so long leaves its place to another, microseconds: several reports of the slowest source.
const SILENCE_US: u64 = 1_000_000;

/// The line that is taken now.
#[derive(Clone, Copy, Debug)]
struct Taken {
    line: u8,
    has_rates: bool,
    at: Timestamp,
}

/// The lines on which attitude comes.
#[derive(Clone, Copy, Debug, Default)]
pub struct Lines(Option<Taken>);

impl Lines {
    /// Nothing has come yet.
    #[must_use]
    pub const fn new() -> Self {
        Self(None)
    }

    /// Whether a report that came at `now` on a line is taken; whether its protocol has body rates.
    pub fn takes(&mut self, now: Timestamp, line: u8, has_rates: bool) -> bool {
        let takes = self.0.is_none_or(|taken| {
            taken.line == line || (has_rates && !taken.has_rates) || now.us_since(taken.at) > SILENCE_US
        });
        if takes {
            self.0 = Some(Taken { line, has_rates, at: now });
        }
        takes
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const fn at(ms: u64) -> Timestamp {
        Timestamp::from_us(ms * 1000)
    }

    #[test]
    fn one_line_is_taken_while_it_talks() {
        let mut lines = Lines::new();
        assert!(lines.takes(at(0), 1, true));
        for ms in (10..5_000).step_by(10) {
            assert!(!lines.takes(at(ms), 0, true), "{ms}");
            assert!(!lines.takes(at(ms), 0, false), "{ms}");
            assert!(lines.takes(at(ms), 1, true), "{ms}");
        }
    }

    #[test]
    fn rates_take_the_place_of_none_and_keep_it() {
        let mut lines = Lines::new();
        assert!(lines.takes(at(0), 0, false));
        assert!(!lines.takes(at(1), 1, false));
        assert!(lines.takes(at(2), 1, true));
        assert!(!lines.takes(at(3), 0, false));
    }

    /// From both sides; a line that was refused meanwhile has not kept itself in the place.
    #[test]
    fn a_silent_line_leaves_its_place() {
        let mut lines = Lines::new();
        assert!(lines.takes(at(0), 1, true));
        assert!(!lines.takes(at(1_000), 0, false));
        assert!(lines.takes(Timestamp::from_us(1_000_001), 0, false));
        assert!(lines.takes(at(1_002), 1, true), "with rates it is back at once");
    }
}
