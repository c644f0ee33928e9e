//! Readings that wait for the attitude after them, so that it can be interpolated to their instant.

use super::averager::Averager;
use crate::attitude::{self, Lookup, Motion};
use crate::calibration::Sample;
use crate::frames::{Field, Sensor};
use crate::time::Timestamp;

/// Readings wait for their attitude no longer than this, microseconds: longer than any two reports are interpolated
/// over.
const PATIENCE_US: u64 = 300_000;

const _: () = {
    let attitude::Config { latency_us, max_gap_us, .. } = attitude::Config::DEFAULT;
    assert!(PATIENCE_US > max_gap_us as u64 + latency_us.unsigned_abs() as u64);
};

/// Readings that can wait: those of [`PATIENCE_US`] at 200 Hz. 1.3 KB.
const CAPACITY: usize = 64;

/// Readings that wait, and the averager behind them.
#[derive(Debug)]
pub(super) struct Pairing {
    waiting: heapless::Deque<(Timestamp, Field<Sensor>), CAPACITY>,
    averager: Averager,
    /// The instant of the last reading, whether or not it was good for anything.
    now: Timestamp,
    /// Readings for which no attitude came; wraps.
    unpaired: u32,
}

impl Pairing {
    /// No reading waits.
    pub const fn new(readings_per_sample: u16, max_step_us: u64) -> Self {
        Self {
            waiting: heapless::Deque::new(),
            averager: Averager::new(readings_per_sample, max_step_us),
            now: Timestamp::START,
            unpaired: 0,
        }
    }

    /// Forgets what waits and the run under way.
    pub fn reset(&mut self) {
        self.waiting.clear();
        self.averager.reset();
    }

    /// As [`reset`](Self::reset), with another sensor.
    pub fn restart(&mut self, readings_per_sample: u16, max_step_us: u64) {
        self.waiting.clear();
        self.averager = Averager::new(readings_per_sample, max_step_us);
    }

    /// Takes a reading.
    pub fn push(&mut self, at: Timestamp, field: Field<Sensor>) {
        self.pass(at);
        if self.waiting.is_full() {
            self.waiting.pop_front();
            self.count_unpaired();
        }
        // There is room: one was just taken out if there was none.
        let _ = self.waiting.push_back((at, field));
    }

    /// Time has passed, but no reading came that is good for anything.
    pub fn pass(&mut self, at: Timestamp) {
        self.now = at;
    }

    /// Pairs what has waited long enough, until there is a sample; also the instant of its last reading.
    pub fn next(
        &mut self,
        attitude_at: impl Fn(Timestamp) -> Lookup,
        motion_at: impl Fn(Timestamp) -> Motion,
    ) -> Option<(Timestamp, Sample)> {
        while let Some(&(at, field)) = self.waiting.front() {
            let attitude = match attitude_at(at) {
                Lookup::Interpolated(attitude) => Some(attitude),
                Lookup::Missing => None,
                // It may come yet.
                _ if self.now.us_since(at) < PATIENCE_US => return None,
                _ => None,
            };
            self.waiting.pop_front();
            let Some(attitude) = attitude else {
                self.count_unpaired();
                continue;
            };
            if let Some(sample) = self.averager.push(at, field, attitude, motion_at(at)) {
                return Some((at, sample));
            }
        }
        None
    }

    /// Readings so far for which no attitude came.
    pub const fn unpaired(&self) -> u32 {
        self.unpaired
    }

    fn count_unpaired(&mut self) {
        self.unpaired = self.unpaired.wrapping_add(1);
    }
}
