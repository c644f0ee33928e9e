//! ArduPilot's offsets of the module's compass: after its own calibration they correct a field that the module has
//! corrected already.

use crate::port::autopilot::{COMPASS_COUNT, DEVICE_ID_PATTERN, OFFSET_PATTERNS, is_device_of_module};
use autoswing::trig::sqrt;
use autoswing_module::messages::{AutopilotReport, ParameterName};

/// Largest offset that is not reported, milligauss: about 1 deg of heading. The offset that marks a compass as
/// calibrated is 1 mG.
const MAX_OFFSET_MG: f32 = 5.0;

/// Reader of the offsets.
#[derive(Debug, Default)]
pub(super) struct CompassOffsets {
    /// Number of parameters that were read.
    read_count: u8,
    /// Slot of the module's compass, counted from 1.
    module_slot: Option<u8>,
    squared_offset_mg2: f32,
    /// Whether the present offsets were reported.
    is_reported: bool,
    report: Option<AutopilotReport>,
}

impl CompassOffsets {
    /// Name of the parameter to read next; none after all.
    pub fn next_name(&self) -> Option<ParameterName> {
        let (pattern, slot) = match self.read_count.checked_sub(COMPASS_COUNT) {
            None => (DEVICE_ID_PATTERN, self.read_count + 1),
            Some(axis) => (*OFFSET_PATTERNS.get(usize::from(axis))?, self.module_slot?),
        };
        Some(ParameterName::from_pattern(pattern, slot, 0))
    }

    /// Ends the read of [`next_name`](Self::next_name), with its number unless the autopilot lacks it.
    pub fn complete_reading(&mut self, number: Option<f32>, can_node: Option<u8>) {
        let number = number.unwrap_or(0.0);
        self.read_count += 1;
        if self.read_count <= COMPASS_COUNT {
            if is_device_of_module(number as u32, can_node) {
                self.module_slot = Some(self.read_count);
            }
            return;
        }
        self.squared_offset_mg2 += number * number;
        if let (None, Some(slot)) = (self.next_name(), self.module_slot) {
            let offset_mg = sqrt(self.squared_offset_mg2);
            let is_large = offset_mg > MAX_OFFSET_MG;
            self.report =
                (is_large && !self.is_reported).then_some(AutopilotReport::CorrectedTwice { slot, offset_mg });
            self.is_reported = is_large;
        }
    }

    /// Reads all parameters again.
    pub fn restart_reading(&mut self) {
        *self = Self { is_reported: self.is_reported, ..Self::default() };
    }

    /// Takes the report of new offsets.
    pub const fn take_report(&mut self) -> Option<AutopilotReport> {
        self.report.take()
    }
}
