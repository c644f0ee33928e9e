//! Task of gyro and accelerometer: its measurements become an attitude.

use super::chip::{ChipEvents, ChipFailure, run_chip};
use super::task_links::{AttitudeInput, Timestamped, increment_counter};
use crate::app::task_links::TaskLinks;
use crate::inertial_sensor::{InertialReading, InertialSensor};
use crate::log::info;
use autoswing::calibration::Orientation;
use autoswing::inertial::{AttitudeFilter, InertialSensorErrors, SensorOffsets};
use autoswing::time::Timestamp;

/// Interval of the estimates for the instrument, microseconds: the rate of an autopilot's reports, 50 Hz.
const ESTIMATE_INTERVAL_US: u64 = 19_000;

/// Time for which a speed is valid, microseconds: receivers report it once a second or oftener.
const SPEED_VALIDITY_US: u64 = 2_000_000;

/// Estimates the attitude from every measurement of the sensor for ever.
pub async fn run_inertial_sensor(links: &TaskLinks, sensor: impl InertialSensor) -> ! {
    let (sensor_errors, mount) = (sensor.sensor_errors(), Orientation::IDENTITY_ROTATION);
    run_chip(sensor, AttitudeEstimator { links, sensor_errors, filter: None, mount, estimated_at: Timestamp::START })
        .await
}

struct AttitudeEstimator<'a> {
    links: &'a TaskLinks,
    sensor_errors: InertialSensorErrors,
    filter: Option<AttitudeFilter>,
    /// Orientation of the sensor, which shares the board, and its setting, with the magnetometer.
    mount: Orientation,
    estimated_at: Timestamp,
}

impl<S: InertialSensor> ChipEvents<S> for AttitudeEstimator<'_> {
    fn on_start(&mut self, _: &S, (): ()) {
        info!("gyro and accelerometer");
    }

    /// A saturated measurement is a gap in the motion.
    fn on_measurement(&mut self, at: Timestamp, reading: InertialReading) {
        increment_counter(&self.links.event_counters.inertial_readings);
        if reading.is_saturated {
            return;
        }
        let filter = self.filter.get_or_insert_with(|| {
            // The alignment of the stored calibration belongs to the offsets that were estimated with it.
            let offsets = self.links.sensor_offsets.try_get().unwrap_or(SensorOffsets::UNKNOWN);
            AttitudeFilter::new(self.sensor_errors, offsets.at_temperature(reading.temperature_c))
        });
        let sample = reading.sample.rotated(&self.mount.body_from_sensor());
        let speed = self.links.ground_speed.try_get();
        let speed_m_s =
            speed.filter(|speed| at.us_since(speed.timestamp) <= SPEED_VALIDITY_US).map(|speed| speed.value);
        filter.update(at, &sample, speed_m_s);
        if at.us_since(self.estimated_at) >= ESTIMATE_INTERVAL_US {
            self.estimated_at = at;
            self.mount = self.links.settings.try_get().map_or(self.mount, |settings| settings.mount);
            self.links.sensor_offsets.sender().send(filter.sensor_offsets(reading.temperature_c));
            if let Some(attitude) = filter.attitude() {
                if attitude.measured_rates_rad_s.is_some() {
                    increment_counter(&self.links.event_counters.inertial_estimates_after_rest);
                }
                let value = AttitudeInput::Own(attitude);
                self.links.queue_or_count(&self.links.attitude_inputs, Timestamped { timestamp: at, value });
            }
        }
    }

    fn on_failure(&mut self, failure: ChipFailure) {
        let counters = &self.links.event_counters;
        increment_counter(match failure {
            ChipFailure::ConfigurationLost => &counters.inertial_register_upsets,
            ChipFailure::NoAnswer => &counters.inertial_errors,
        });
    }
}
