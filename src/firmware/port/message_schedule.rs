//! Schedule of periodic messages.

use autoswing::time::Timestamp;

/// Keeps messages on an even time grid, which jitter of the readings does not shift; the first is due at once.
#[derive(Debug, Default)]
pub struct MessageSchedule {
    due_at: Timestamp,
}

impl MessageSchedule {
    /// Whether a message is due at this rate; if so, schedules the next one.
    pub fn is_due(&mut self, now: Timestamp, rate_hz: u8) -> bool {
        if now < self.due_at {
            return false;
        }
        let period_us = 1_000_000 / u64::from(rate_hz.max(1));
        // The next message stays on the grid of due times, unless a whole period was missed.
        let next_due = self.due_at.plus_us(period_us);
        self.due_at = if next_due > now { next_due } else { now.plus_us(period_us) };
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Number of messages due in a second of readings with this period.
    fn messages_per_second(period_us: u64, rate_hz: u8) -> usize {
        let mut schedule = MessageSchedule::default();
        (0..1_000_000 / period_us).filter(|i| schedule.is_due(Timestamp::from_us(1 + i * period_us), rate_hz)).count()
    }

    /// Readings at 80, 155 and 200 Hz, which need not be multiples of the message rate.
    #[test]
    fn the_message_rate_is_kept_at_any_reading_rate() {
        for period_us in [12_500, 6_450, 5_000] {
            for rate_hz in [1, 5, 10, 33, 50] {
                let count = messages_per_second(period_us, rate_hz);
                assert!(count.abs_diff(rate_hz.into()) <= 1, "{rate_hz} Hz of readings every {period_us} us: {count}");
            }
        }
        assert_eq!(messages_per_second(12_500, 80), 80);
        assert_eq!(messages_per_second(100_000, 80), 10);
    }
}
