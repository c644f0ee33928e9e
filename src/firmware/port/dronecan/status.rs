//! State of the node in NodeStatus.

use crate::port::snapshot::Snapshot;
use crate::wire::dronecan::outbound::{NodeHealth, NodeMode, NodeStatus};
use autoswing::heading::NoHeading;
use autoswing::time::Timestamp;
use autoswing_module::compass::IndicatorState;

/// Silence of the sensor after which the node's health is ERROR, microseconds. Besides, only safe mode has this health:
/// autopilots do not arm beside an unhealthy node, and other causes show in the withheld field.
const SENSOR_SILENCE_FAULT_US: u64 = 10_000_000;

/// Readings and silence of the sensor so far, for NodeStatus.
#[derive(Debug, Default)]
pub(super) struct StatusMonitor {
    has_reading: bool,
    /// Time at which the sensor's silence began.
    sensor_silent_since: Option<Timestamp>,
}

impl StatusMonitor {
    /// Updates the state with an estimate.
    pub fn update_sensor_silence(&mut self, snapshot: &Snapshot<'_>) {
        if snapshot.estimate.heading == Err(NoHeading::SensorSilent) {
            self.sensor_silent_since.get_or_insert(snapshot.now);
        } else {
            (self.has_reading, self.sensor_silent_since) = (true, None);
        }
    }

    /// Status to send.
    pub fn status_message(&self, snapshot: &Snapshot<'_>, is_updating: bool, has_number_conflict: bool) -> NodeStatus {
        let is_silent =
            self.sensor_silent_since.is_some_and(|since| snapshot.now.us_since(since) >= SENSOR_SILENCE_FAULT_US);
        let is_faulty = is_silent || snapshot.estimate.heading == Err(NoHeading::SafeMode);
        NodeStatus {
            uptime_s: (snapshot.now.as_us() / 1_000_000) as u32,
            health: if is_faulty { NodeHealth::Error } else { NodeHealth::Ok },
            node_mode: match (is_updating, self.has_reading || is_faulty) {
                (true, _) => NodeMode::SoftwareUpdate,
                (false, false) => NodeMode::Initialization,
                (false, true) => NodeMode::Operational,
            },
            vendor_code: vendor_status_code(snapshot, has_number_conflict),
        }
    }
}

/// State in 16 bits: bits 0 to 3 the reason for an empty heading (0: there is one), bits 4 and 5 the calibration, bit 6
/// a field that is not sent, bit 7 another node with this number, bits 8 to 14 the progress of a collection in percent.
fn vendor_status_code(snapshot: &Snapshot<'_>, has_number_conflict: bool) -> u16 {
    let reason = snapshot.estimate.heading.err().map_or(0, no_heading_number);
    let (calibration, percent) = match snapshot.indicator_state {
        IndicatorState::Idle => (0, 0),
        IndicatorState::Collecting(percent) => (1, percent.min(100)),
        IndicatorState::Calibrated => (2, 100),
        IndicatorState::Refused => (3, 0),
    };
    let is_withheld = snapshot.estimate.compass_field.is_none() || has_number_conflict;
    reason
        | calibration << 4
        | u16::from(is_withheld) << 6
        | u16::from(has_number_conflict) << 7
        | u16::from(percent) << 8
}

/// Number of the reason for no heading, listed in the documents.
const fn no_heading_number(reason: NoHeading) -> u16 {
    match reason {
        NoHeading::Uncalibrated => 1,
        NoHeading::SensorSilent => 2,
        NoHeading::SensorSaturated => 3,
        NoHeading::SensorClipped => 4,
        NoHeading::SensorStuck => 5,
        NoHeading::SensorSpike => 6,
        NoHeading::AttitudeStale => 7,
        NoHeading::AttitudeFrozen => 8,
        NoHeading::AttitudeContradicted => 9,
        NoHeading::FieldDisturbed => 10,
        NoHeading::FieldChanged => 11,
        NoHeading::SafeMode => 12,
        NoHeading::AttitudeInaccurate => 13,
    }
}
