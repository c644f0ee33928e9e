//! State of the vehicle from other nodes.

use crate::wire::dronecan::NodeId;
use autoswing::time::Timestamp;

/// Age at which an armed state or a battery of another node expires, microseconds.
const REPORT_EXPIRY_US: u64 = 10_000_000;

/// Reports of other nodes. Of several armed states, `armed` counts until the same node reports otherwise; of several
/// batteries, the first one.
#[derive(Debug, Default)]
pub(super) struct VehicleReports {
    arming_report: Option<(Timestamp, NodeId, bool)>,
    battery_report: Option<(Timestamp, NodeId, u8)>,
}

impl VehicleReports {
    /// Processes an armed state.
    pub fn update_armed(&mut self, at: Timestamp, source: NodeId, is_armed: bool) {
        let is_held = |(last, node, was_armed): (Timestamp, NodeId, bool)| {
            was_armed && !is_armed && node != source && at.us_since(last) <= REPORT_EXPIRY_US
        };
        if !self.arming_report.is_some_and(is_held) {
            self.arming_report = Some((at, source, is_armed));
        }
    }

    /// Whether the vehicle is armed, if that was reported recently.
    pub fn is_armed(&self, now: Timestamp) -> Option<bool> {
        self.arming_report.filter(|(at, ..)| now.us_since(*at) <= REPORT_EXPIRY_US).map(|(.., is_armed)| is_armed)
    }

    /// Whether the current of this battery is used.
    pub fn accept_battery(&mut self, at: Timestamp, source: NodeId, battery_number: u8) -> bool {
        let is_other = |(last, node, battery)| {
            (node, battery) != (source, battery_number) && at.us_since(last) <= REPORT_EXPIRY_US
        };
        let accepts = !self.battery_report.is_some_and(is_other);
        if accepts {
            self.battery_report = Some((at, source, battery_number));
        }
        accepts
    }

    /// Whether a battery reports its current.
    pub fn has_battery(&self, now: Timestamp) -> bool {
        self.battery_report.is_some_and(|(at, ..)| now.us_since(at) <= REPORT_EXPIRY_US)
    }
}
