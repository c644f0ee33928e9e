//! Conversion of sender time stamps to the module's clock.

use crate::attitude::config::AttitudeConfig;
use crate::time::{Timestamp, WrappingMillis};

/// Step back of a sender's time stamp that is a restart, milliseconds; a smaller one is a report out of order.
const MIN_RESTART_STEP_MS: i32 = 1_000;

/// Clock-offset estimator. The smallest delay observed is the one without queueing, so reports are stamped by the
/// sender's regular interval without the line's jitter.
#[derive(Debug)]
pub(super) struct SenderClock {
    /// Sender's clock and module's clock at the last report.
    last_report: Option<(WrappingMillis, Timestamp)>,
}

impl SenderClock {
    pub const fn new() -> Self {
        Self { last_report: None }
    }

    /// Whether the sender has restarted since the last report: its clock has stepped back, or it has none and was silent.
    pub fn has_restarted(
        &self,
        arrival: Timestamp,
        sender_clock_at_sending: WrappingMillis,
        config: &AttitudeConfig,
    ) -> bool {
        self.last_report.is_some_and(|(last_sender, last_sent)| {
            match sender_clock_at_sending.signed_ms_since(last_sender) {
                0 => arrival.us_since(last_sent) > u64::from(config.restart_silence_us),
                step_ms => step_ms <= -MIN_RESTART_STEP_MS,
            }
        })
    }

    pub fn sending_time(
        &mut self,
        arrival: Timestamp,
        sender_clock_at_sending: WrappingMillis,
        config: &AttitudeConfig,
    ) -> Timestamp {
        let sent_at = self
            .last_report
            .and_then(|(last_sender, last_sent)| {
                predicted_sending_time(arrival, sender_clock_at_sending.signed_ms_since(last_sender), last_sent, config)
            })
            .unwrap_or(arrival);
        self.last_report = Some((sender_clock_at_sending, sent_at));
        sent_at
    }
}

/// Time of sending from the sender's interval, at most the arrival. `None` after a reboot of the sender or without a
/// sender clock; the arrival is used then.
fn predicted_sending_time(
    arrival: Timestamp,
    passed_ms: i32,
    last_sent: Timestamp,
    config: &AttitudeConfig,
) -> Option<Timestamp> {
    let passed_ms = u64::try_from(passed_ms).ok().filter(|&ms| ms > 0)?;
    let expected = last_sent.plus_us(passed_ms * 1000);
    let error_us = arrival.us_since(expected).max(expected.us_since(arrival));
    (error_us <= u64::from(config.max_clock_deviation_us))
        .then(|| arrival.min(expected.plus_us(u64::from(config.clock_offset_growth_us_per_report))))
}
