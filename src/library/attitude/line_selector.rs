//! Selection of one input line for attitude.
//!
//! One autopilot may send attitude on two lines (MAVLink with body rates, MSP without), or two autopilots on one each;
//! a mixture would jump. The first line is used until it is silent; a line with a gyro's rates replaces one without.

use crate::time::Timestamp;

/// Silence after which another line may be selected, microseconds: several reports of the slowest source.
const LINE_EXPIRY_US: u64 = 1_000_000;

/// Line selected for attitude.
#[derive(Clone, Copy, Debug)]
struct SelectedLine {
    line: u8,
    has_gyro: bool,
    last_report_at: Timestamp,
}

/// Selects the input line for attitude.
#[derive(Clone, Copy, Debug, Default)]
pub struct LineSelector(Option<SelectedLine>);

impl LineSelector {
    /// Selector without a selected line.
    #[must_use]
    pub const fn new() -> Self {
        Self(None)
    }

    /// Returns whether a report received at `now` on `line` is accepted; `has_gyro`: with the rates of a gyro.
    pub fn accept_line_report(&mut self, now: Timestamp, line: u8, has_gyro: bool) -> bool {
        let is_accepted = self.0.is_none_or(|selected| {
            selected.line == line
                || (has_gyro && !selected.has_gyro)
                || now.us_since(selected.last_report_at) > LINE_EXPIRY_US
        });
        if is_accepted {
            self.0 = Some(SelectedLine { line, has_gyro, last_report_at: now });
        }
        is_accepted
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const fn timestamp_ms(ms: u64) -> Timestamp {
        Timestamp::from_us(ms * 1000)
    }

    /// A rejected report of another line does not prolong the selection of the silent one.
    #[test]
    fn a_silent_line_is_released() {
        let mut lines = LineSelector::new();
        assert!(lines.accept_line_report(timestamp_ms(0), 1, true));
        assert!(!lines.accept_line_report(timestamp_ms(1_000), 0, false));
        assert!(lines.accept_line_report(Timestamp::from_us(1_000_001), 0, false));
        assert!(lines.accept_line_report(timestamp_ms(1_002), 1, true), "with rates it is back at once");
    }
}
