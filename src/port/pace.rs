//! When the next message is due.

use crate::time::Timestamp;

/// Keeps messages on an even grid, which readings that come a little early or late do not shift.
#[derive(Debug, Default)]
pub struct Pace {
    due: Timestamp,
}

impl Pace {
    /// The first message is due at once.
    #[must_use]
    pub const fn new() -> Self {
        Self { due: Timestamp::START }
    }

    /// Whether a message is due at a rate; if so, the next one is later.
    pub fn is_due(&mut self, now: Timestamp, rate_hz: u8) -> bool {
        if now < self.due {
            return false;
        }
        let period_us = 1_000_000 / u64::from(rate_hz.max(1));
        // On the grid of the last due time, unless that is long past.
        let next = self.due.plus_us(period_us);
        self.due = if next > now { next } else { now.plus_us(period_us) };
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// How many messages are due in a second of readings with this period.
    fn in_a_second(period_us: u64, rate_hz: u8) -> usize {
        let mut pace = Pace::new();
        (0..1_000_000 / period_us).filter(|i| pace.is_due(Timestamp::from_us(1 + i * period_us), rate_hz)).count()
    }

    /// Readings of 80, 155 and 200 Hz need not divide the rate, and still carry it on the average.
    #[test]
    fn the_rate_is_kept_on_any_grid_of_readings() {
        for period_us in [12_500, 6_450, 5_000] {
            for rate_hz in [1, 5, 10, 33, 50] {
                let count = in_a_second(period_us, rate_hz);
                assert!(count.abs_diff(rate_hz.into()) <= 1, "{rate_hz} Hz of readings every {period_us} us: {count}");
            }
        }
        assert_eq!(in_a_second(12_500, 80), 80);
        // A rate above the readings' is that of the readings.
        assert_eq!(in_a_second(100_000, 80), 10);
    }

    /// After a pause of seconds there is one message, not all that were missed.
    #[test]
    fn a_pause_is_not_made_up_for() {
        let mut pace = Pace::new();
        assert!(pace.is_due(Timestamp::from_us(1_000_000), 10));
        assert!(pace.is_due(Timestamp::from_us(5_000_000), 10));
        assert!(!pace.is_due(Timestamp::from_us(5_099_999), 10));
        assert!(pace.is_due(Timestamp::from_us(5_100_000), 10));
        // This one was late by 40 ms, the next is due on the old grid.
        assert!(pace.is_due(Timestamp::from_us(5_240_000), 10));
        assert!(!pace.is_due(Timestamp::from_us(5_299_999), 10));
        assert!(pace.is_due(Timestamp::from_us(5_300_000), 10));
    }

    /// A setting of zero is refused elsewhere; here it is one a second.
    #[test]
    fn no_rate_divides_by_zero() {
        assert_eq!(in_a_second(12_500, 0), 1);
    }
}
