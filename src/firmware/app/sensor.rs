//! Task of the magnetometer.

use super::chip::{self, ChipEvents, ChipFailure, run_chip};
use super::task_links::{SensorDetection, Timestamped, increment_counter};
use crate::app::task_links::TaskLinks;
use crate::log::info;
use crate::magnetometer::Magnetometer;
use autoswing::reading::{Identity, Reading};
use autoswing::time::Timestamp;

/// Longest time between heartbeats of this task, milliseconds.
pub(super) const MAX_HEARTBEAT_INTERVAL_MS: u64 = chip::MAX_EVENT_INTERVAL_MS;

/// Reads every measurement of the magnetometer for ever.
pub async fn run_sensor(links: &TaskLinks, magnetometer: impl Magnetometer) -> ! {
    run_chip(magnetometer, MagnetometerEvents { links }).await
}

struct MagnetometerEvents<'a> {
    links: &'a TaskLinks,
}

impl<M: Magnetometer> ChipEvents<M> for MagnetometerEvents<'_> {
    fn on_start(&mut self, magnetometer: &M, identity: Identity) {
        info!("magnetometer {=str}", identity.model.model_name());
        let (period_us, equal_readings_until_stuck) =
            (magnetometer.period_us(), magnetometer.equal_readings_until_stuck());
        self.links.sensor.sender().send(SensorDetection { identity, period_us, equal_readings_until_stuck });
    }

    fn on_measurement(&mut self, timestamp: Timestamp, reading: Reading) {
        increment_counter(&self.links.event_counters.readings);
        increment_counter(&self.links.heartbeats.sensor);
        if reading.was_overwritten {
            increment_counter(&self.links.event_counters.overruns);
        }
        self.links.queue_or_count(&self.links.readings, Timestamped { timestamp, value: reading });
    }

    fn on_failure(&mut self, failure: ChipFailure) {
        let counters = &self.links.event_counters;
        match failure {
            ChipFailure::ConfigurationLost => increment_counter(&counters.sensor_register_upsets),
            ChipFailure::NoAnswer => {
                increment_counter(&counters.sensor_errors);
                increment_counter(&self.links.heartbeats.sensor);
            }
        }
    }
}
