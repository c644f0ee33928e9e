//! ArduPilot's offsets of the module's compass: after its own calibration they correct a field that the module has
//! corrected already.

use crate::port::autopilot::is_device_of_module;
use autoswing::trig::sqrt;
use autoswing_module::messages::{AutopilotReport, ParameterName};

/// Device ids by slot.
const ID_NAMES: [&str; 3] = ["COMPASS_DEV_ID", "COMPASS_DEV_ID2", "COMPASS_DEV_ID3"];

/// Offsets by slot and axis, milligauss.
const OFFSET_NAMES: [[&str; 3]; 3] = [
    ["COMPASS_OFS_X", "COMPASS_OFS_Y", "COMPASS_OFS_Z"],
    ["COMPASS_OFS2_X", "COMPASS_OFS2_Y", "COMPASS_OFS2_Z"],
    ["COMPASS_OFS3_X", "COMPASS_OFS3_Y", "COMPASS_OFS3_Z"],
];

/// Largest offset that is not reported, milligauss: about 1 deg of heading. The offset that marks a compass as
/// calibrated is 1 mG.
const MAX_OFFSET_MG: f32 = 5.0;

/// Reader of the offsets.
#[derive(Debug, Default)]
pub(super) struct CompassOffsets {
    /// Number of parameters that were read.
    read_count: u8,
    module_slot: Option<u8>,
    squared_offset_mg2: f32,
    /// Whether the present offsets were reported.
    is_reported: bool,
    report: Option<AutopilotReport>,
}

impl CompassOffsets {
    /// Name of the parameter to read next; none after all.
    pub fn next_name(&self) -> Option<ParameterName> {
        let index = usize::from(self.read_count);
        let offset_name = || OFFSET_NAMES.get(usize::from(self.module_slot?))?.get(index - ID_NAMES.len());
        ID_NAMES.get(index).or_else(offset_name).map(|name| ParameterName::new(name))
    }

    /// Ends the read of [`next_name`](Self::next_name), with its number unless the autopilot lacks it.
    pub fn complete_reading(&mut self, number: Option<f32>, can_node: Option<u8>) {
        let (slot, number) = (self.read_count, number.unwrap_or(0.0));
        self.read_count += 1;
        if usize::from(slot) < ID_NAMES.len() {
            if is_device_of_module(number as u32, can_node) {
                self.module_slot = Some(slot);
            }
            return;
        }
        self.squared_offset_mg2 += number * number;
        if let (None, Some(slot)) = (self.next_name(), self.module_slot) {
            let offset_mg = sqrt(self.squared_offset_mg2);
            let is_large = offset_mg > MAX_OFFSET_MG;
            self.report = (is_large && !self.is_reported)
                .then_some(AutopilotReport::CorrectedTwice { slot: slot + 1, offset_mg });
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
