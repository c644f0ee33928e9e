//! Instructions from the sensor's registers to the last byte of each sample.

use super::emulated_machine::{INSTRUCTION_NS, TICK_NS, TICKS_PER_US};

/// Update period of the field, microseconds; both accesses of one measurement read the same field.
pub const FIELD_UPDATE_PERIOD_US: u64 = 2_000;

/// Path of each sample through the module, from the first sensor access to the last written byte.
#[derive(Default)]
pub struct SamplePath {
    /// Start of the present sample's sensor access, machine ticks.
    access_start_ticks: Option<u64>,
    /// Whether the firmware has written to the instrument port since the sensor access; its last write ends the path.
    has_written: bool,
    durations_ticks: Vec<u64>,
}

impl SamplePath {
    /// Takes the instructions of the samples since the last call.
    pub fn take_instruction_counts(&mut self) -> Vec<u64> {
        let instructions = |ticks: u64| ticks * TICK_NS / INSTRUCTION_NS;
        std::mem::take(&mut self.durations_ticks).into_iter().map(instructions).collect()
    }

    /// The machine restarted: the present sample ends.
    pub fn end_sample(&mut self) {
        self.access_start_ticks = None;
    }

    pub fn on_sensor_access(&mut self, ticks: u64) {
        let is_same_measurement = self
            .access_start_ticks
            .is_some_and(|start_ticks| ticks - start_ticks < FIELD_UPDATE_PERIOD_US * TICKS_PER_US);
        if self.has_written || !is_same_measurement {
            self.access_start_ticks = Some(ticks);
            self.has_written = false;
        }
    }

    pub fn on_output(&mut self, ticks: u64) {
        let Some(start_ticks) = self.access_start_ticks else { return };
        if self.has_written {
            self.durations_ticks.pop();
        }
        self.durations_ticks.push(ticks - start_ticks);
        self.has_written = true;
    }
}
