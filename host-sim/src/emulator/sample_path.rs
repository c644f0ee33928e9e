//! Instructions from the sensor's registers to the last byte of each sample.

use super::emulated_machine::{INSTRUCTION_NS, TICK_NS, TICKS_PER_US};

/// Update period of the field, microseconds; both accesses of one measurement read the same field.
pub const FIELD_UPDATE_PERIOD_US: u64 = 2_000;

/// Path of each sample through the module, from the first sensor access to the last written byte.
#[derive(Default)]
pub struct SamplePath {
    /// Start of the present sample's sensor access, machine ticks.
    began: Option<u64>,
    /// Whether the firmware has written to the instrument port since that access; the last write determines the
    /// duration.
    written: bool,
    ticks: Vec<u64>,
}

impl SamplePath {
    /// Takes the instructions of the samples since the last call.
    pub fn take_instructions(&mut self) -> Vec<u64> {
        let instructions = |ticks: u64| ticks * TICK_NS / INSTRUCTION_NS;
        std::mem::take(&mut self.ticks).into_iter().map(instructions).collect()
    }

    /// The machine restarted: the present sample ends.
    pub fn end_sample(&mut self) {
        self.began = None;
    }

    pub fn on_sensor_access(&mut self, ticks: u64) {
        let again = self.began.is_some_and(|began| ticks - began < FIELD_UPDATE_PERIOD_US * TICKS_PER_US);
        if self.written || !again {
            self.began = Some(ticks);
            self.written = false;
        }
    }

    pub fn on_output(&mut self, ticks: u64) {
        let Some(began) = self.began else { return };
        if self.written {
            self.ticks.pop();
        }
        self.ticks.push(ticks - began);
        self.written = true;
    }
}
