//! Continuous time from a log's clock, across restarts and invalid stamps: the clock itself until a restart.

/// Largest step back attributed to reordering, microseconds.
const MAX_REORDERING_US: u64 = 3_000_000;

/// Largest step ahead accepted without a confirming stamp, microseconds.
const MAX_UNCONFIRMED_STEP_US: u64 = 30_000_000;

/// Gap inserted at a restart, seconds, so that no interpolation crosses it.
const RESTART_GAP_S: f64 = 10.0;

/// Largest valid clock, microseconds: a hundred and thirty years. PX4's simulator counts from 1970.
const MAX_CLOCK_US: u64 = 4_000_000_000_000_000;

#[derive(Clone, Debug, Default)]
pub struct Timeline {
    newest_us: Option<u64>,
    /// An implausible stamp waiting for confirmation.
    unconfirmed_us: Option<u64>,
    /// Flight time at which the log's present clock reads zero, seconds; zero until a restart.
    offset_s: f64,
    pub restart_count: u32,
    pub rejected_stamp_count: u64,
}

impl Timeline {
    /// Time of a stamp, seconds; none if the stamp is rejected.
    pub fn flight_time_s(&mut self, clock_us: u64) -> Option<f64> {
        if clock_us > MAX_CLOCK_US {
            self.rejected_stamp_count += 1;
            return None;
        }
        let Some(newest_us) = self.newest_us else {
            self.newest_us = Some(clock_us);
            return Some(seconds_from_us(clock_us));
        };
        let is_near = |of_us: u64| {
            clock_us.saturating_add(MAX_REORDERING_US) >= of_us
                && clock_us <= of_us.saturating_add(MAX_UNCONFIRMED_STEP_US)
        };
        if is_near(newest_us) {
            self.newest_us = Some(newest_us.max(clock_us));
            self.unconfirmed_us = None;
        } else if self.unconfirmed_us.is_some_and(is_near) {
            self.unconfirmed_us = None;
            // The pending time stamp was counted as rejected, but the present one confirms it.
            self.rejected_stamp_count -= 1;
            if clock_us < newest_us {
                self.restart_count += 1;
                self.offset_s += seconds_from_us(newest_us) - seconds_from_us(clock_us) + RESTART_GAP_S;
            }
            self.newest_us = Some(clock_us);
        } else {
            self.unconfirmed_us = Some(clock_us);
            self.rejected_stamp_count += 1;
            return None;
        }
        Some(seconds_from_us(clock_us) + self.offset_s)
    }

    pub fn newest_s(&self) -> f64 {
        self.newest_us.map_or(0.0, |clock_us| seconds_from_us(clock_us) + self.offset_s)
    }

    pub const fn has_accepted_stamp(&self) -> bool {
        self.newest_us.is_some()
    }
}

fn seconds_from_us(us: u64) -> f64 {
    us as f64 / 1e6
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Stamps, times, and numbers of restarts and of rejected stamps.
    type Case = (&'static [f64], &'static [Option<f64>], (u32, u64));

    #[test]
    fn a_clock_is_continued_across_disorder_invalid_stamps_pauses_and_restarts() {
        let cases: [Case; 8] = [
            // Small disorder is kept.
            (
                &[100.0, 101.0, 100.5, 98.1, 130.0],
                &[Some(100.0), Some(101.0), Some(100.5), Some(98.1), Some(130.0)],
                (0, 0),
            ),
            // A single implausible stamp is dropped.
            (&[100.0, 101.0, 5.0, 101.2], &[Some(100.0), Some(101.0), None, Some(101.2)], (0, 1)),
            (&[100.0, 101.0, 1e6, 101.2], &[Some(100.0), Some(101.0), None, Some(101.2)], (0, 1)),
            (&[100.0, 101.0, 1.7e9, 101.2], &[Some(100.0), Some(101.0), None, Some(101.2)], (0, 1)),
            (&[100.0, 101.0, 1e12, 101.2], &[Some(100.0), Some(101.0), None, Some(101.2)], (0, 1)),
            // PX4's simulator counts from 1970.
            (&[1.71e9, 1.71e9 + 0.5], &[Some(1.71e9), Some(1.71e9 + 0.5)], (0, 0)),
            // One stamp alone is no restart.
            (&[120.0, 120.1, 5.0, 5.1, 5.2], &[Some(120.0), Some(120.1), None, Some(130.1), Some(130.2)], (1, 0)),
            // A stamp that a second one confirms is not rejected.
            (&[100.0, 500.0, 500.1, 500.2], &[Some(100.0), None, Some(500.1), Some(500.2)], (0, 0)),
        ];
        for (stamps_s, expected_s, counts) in cases {
            let mut line = Timeline::default();
            let placed_s: Vec<_> = stamps_s.iter().map(|stamp_s| line.flight_time_s((stamp_s * 1e6) as u64)).collect();
            let is_near = |(placed_s, expected_s): (&Option<f64>, &Option<f64>)| match (placed_s, expected_s) {
                (Some(placed_s), Some(expected_s)) => (placed_s - expected_s).abs() < 1e-6,
                _ => placed_s == expected_s,
            };
            assert!(placed_s.iter().zip(expected_s).all(is_near), "{stamps_s:?}: {placed_s:?}");
            assert_eq!((line.restart_count, line.rejected_stamp_count), counts, "{stamps_s:?}");
        }
    }
}
