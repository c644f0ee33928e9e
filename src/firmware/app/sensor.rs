//! Task of the magnetometer: initialises it and reads every measurement.

use embassy_time::{Duration, Instant, Timer, with_timeout};

use super::task_links::{SensorDetection, increment_counter, stamped_now};
use crate::app::task_links::TaskLinks;
use crate::chip::ChipError;
use crate::log::{info, warning};
use crate::magnetometer::Magnetometer;

/// Delay before a failed sensor is initialised again.
const RETRY_DELAY: Duration = Duration::from_millis(200);

/// Timeout of a driver call: a longer one means that the bus hangs.
const DRIVER_TIMEOUT: Duration = Duration::from_millis(400);

/// Interval of configuration checks: a flipped bit costs at most a second of headings.
const VERIFICATION_INTERVAL: Duration = Duration::from_secs(1);

/// Longest time between heartbeats of this task, milliseconds.
pub(super) const MAX_HEARTBEAT_INTERVAL_MS: u64 = RETRY_DELAY.as_millis() + DRIVER_TIMEOUT.as_millis();

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum StopReason {
    /// The sensor does not answer, or answers wrongly.
    NoAnswer,
    /// The sensor's configuration has changed.
    ConfigurationLost,
}

/// Initialises the magnetometer and reads every measurement; starts again after any error.
pub async fn run_sensor(links: &TaskLinks, mut magnetometer: impl Magnetometer) -> ! {
    loop {
        match with_timeout(DRIVER_TIMEOUT, magnetometer.init()).await {
            Ok(Ok(identity)) => {
                info!("magnetometer {=str}", identity.model.model_name());
                let (period_us, equal_readings_until_stuck) =
                    (magnetometer.period_us(), magnetometer.equal_readings_until_stuck());
                links.sensor.sender().send(SensorDetection { identity, period_us, equal_readings_until_stuck });
                if read_until_error(links, &mut magnetometer).await == StopReason::ConfigurationLost {
                    // The sensor answers, so that it is initialised again without a delay.
                    increment_counter(&links.event_counters.sensor_register_upsets);
                    continue;
                }
            }
            Ok(Err(_)) | Err(_) => warning!("magnetometer does not answer, or failed its self-test"),
        }
        increment_counter(&links.event_counters.sensor_errors);
        increment_counter(&links.heartbeats.sensor);
        Timer::after(RETRY_DELAY).await;
    }
}

async fn read_until_error(links: &TaskLinks, magnetometer: &mut impl Magnetometer) -> StopReason {
    let mut verify_at = Instant::now() + VERIFICATION_INTERVAL;
    while let Ok(Ok(reading)) = with_timeout(DRIVER_TIMEOUT, magnetometer.read_measurement()).await {
        let reading = stamped_now(reading);
        increment_counter(&links.event_counters.readings);
        increment_counter(&links.heartbeats.sensor);
        if reading.value.was_overwritten {
            increment_counter(&links.event_counters.overruns);
        }
        links.queue_or_count(&links.readings, reading);
        // The configuration is verified just after a measurement, when the next one is furthest away.
        if Instant::now() >= verify_at {
            verify_at += VERIFICATION_INTERVAL;
            match with_timeout(DRIVER_TIMEOUT, magnetometer.verify_configuration()).await {
                Ok(Ok(())) => {}
                Ok(Err(ChipError::Configuration { .. })) => {
                    warning!("magnetometer upset");
                    return StopReason::ConfigurationLost;
                }
                Ok(Err(_)) | Err(_) => break,
            }
        }
    }
    warning!("magnetometer lost");
    StopReason::NoAnswer
}
