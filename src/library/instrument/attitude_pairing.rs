//! Queue of readings waiting for the next attitude report, so that their attitude can be interpolated.

use super::averager::{AveragedSample, Averager, CorrectedReading};
use crate::attitude::{self, AttitudeLookup};
use crate::frames::{Field, Sensor};
use crate::time::Timestamp;

/// Longest wait of a reading, microseconds: longer than the longest interpolated interval.
const MAX_WAIT_US: u64 = 300_000;

const _: () = {
    let attitude::AttitudeConfig { latency_us, max_gap_us, .. } = attitude::AttitudeConfig::DEFAULT;
    assert!(MAX_WAIT_US > max_gap_us as u64 + latency_us.unsigned_abs() as u64);
};

/// Queue capacity: 0.3 s at 200 Hz. 1.3 KB.
const QUEUE_CAPACITY: usize = 64;

#[derive(Debug)]
pub(super) struct PairingQueue {
    waiting_readings: heapless::Deque<(Timestamp, Field<Sensor>), QUEUE_CAPACITY>,
    averager: Averager,
    /// Time of the last reading, rejected ones included.
    last_reading_at: Timestamp,
    unpaired_reading_count: u32,
}

impl PairingQueue {
    pub const fn new(readings_per_sample: u16, max_step_us: u64) -> Self {
        Self {
            waiting_readings: heapless::Deque::new(),
            averager: Averager::new(readings_per_sample, max_step_us),
            last_reading_at: Timestamp::START,
            unpaired_reading_count: 0,
        }
    }

    pub fn clear_queue(&mut self) {
        self.waiting_readings.clear();
        self.averager.reset();
    }

    pub fn set_sensor_parameters(&mut self, readings_per_sample: u16, max_step_us: u64) {
        self.waiting_readings.clear();
        self.averager = Averager::new(readings_per_sample, max_step_us);
    }

    pub fn push_field(&mut self, at: Timestamp, field: Field<Sensor>) {
        self.advance_time(at);
        if self.waiting_readings.is_full() {
            self.waiting_readings.pop_front();
            self.count_unpaired();
        }
        // Infallible: a full queue was shortened above.
        let _ = self.waiting_readings.push_back((at, field));
    }

    /// Advances time for a rejected reading.
    pub fn advance_time(&mut self, at: Timestamp) {
        self.last_reading_at = at;
    }

    /// Pairs queued readings with attitudes until a sample is complete; returns it with the time of its last reading.
    pub fn next_sample(
        &mut self,
        attitude_at: impl Fn(Timestamp) -> AttitudeLookup,
        corrected_at: impl Fn(Timestamp, Field<Sensor>) -> Option<CorrectedReading>,
    ) -> Option<(Timestamp, AveragedSample)> {
        while let Some(&(at, field)) = self.waiting_readings.front() {
            let attitude = match attitude_at(at) {
                AttitudeLookup::Interpolated(attitude) => Some(attitude),
                AttitudeLookup::Missing => None,
                // Wait: the next report may allow interpolation.
                _ if self.last_reading_at.us_since(at) < MAX_WAIT_US => return None,
                _ => None,
            };
            self.waiting_readings.pop_front();
            let Some(attitude) = attitude else {
                self.count_unpaired();
                continue;
            };
            if let Some(averaged) = self.averager.push_reading(at, field, attitude, corrected_at(at, field)) {
                return Some((at, averaged));
            }
        }
        None
    }

    pub const fn unpaired_reading_count(&self) -> u32 {
        self.unpaired_reading_count
    }

    fn count_unpaired(&mut self) {
        self.unpaired_reading_count = self.unpaired_reading_count.wrapping_add(1);
    }
}
