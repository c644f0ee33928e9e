//! The sender's clock against the module's.

use super::Config;
use crate::time::{Timestamp, WrappingMillis};

/// Follows the sender's clock: the smallest delay seen is the one without queueing, so that reports are stamped by the
/// sender's even spacing and not by the line's jitter.
#[derive(Debug)]
pub(super) struct SenderClock {
    /// The last report: the sender's clock, and when it was sent on the module's clock.
    last: Option<(WrappingMillis, Timestamp)>,
}

impl SenderClock {
    /// Before the first report.
    pub const fn new() -> Self {
        Self { last: None }
    }

    /// When a report was sent, on the module's clock.
    pub fn sent_at(&mut self, arrival: Timestamp, sender: WrappingMillis, config: &Config) -> Timestamp {
        let sent = self
            .last
            .and_then(|(last_sender, last_sent)| follow(arrival, sender.difference(last_sender), last_sent, config))
            .unwrap_or(arrival);
        self.last = Some((sender, sent));
        sent
    }
}

/// As long after the last report as the sender says, but not after the arrival. `None` for a rebooted sender and for
/// one without a clock: the arrival is all there is.
fn follow(arrival: Timestamp, passed_ms: i32, last_sent: Timestamp, config: &Config) -> Option<Timestamp> {
    let passed_ms = u64::try_from(passed_ms).ok().filter(|&ms| ms > 0)?;
    let expected = last_sent.plus_us(passed_ms * 1000);
    let error_us = arrival.us_since(expected).max(expected.us_since(arrival));
    (error_us <= u64::from(config.max_clock_error_us))
        .then(|| arrival.min(expected.plus_us(u64::from(config.clock_leak_us))))
}
