//! Keeps the magnetometer measuring.

use embassy_time::{Duration, Timer, with_timeout};

use super::Links;
use super::links::{FoundSensor, count, stamped};
use crate::log::{info, warning};
use crate::magnetometer::Magnetometer;

/// A sensor that does not answer is tried again so often.
const RETRY: Duration = Duration::from_millis(200);

/// No driver call takes longer, or its bus hangs.
const PATIENCE: Duration = Duration::from_millis(400);

/// The longest time without a sign of life from this task, milliseconds.
pub(super) const LONGEST_SILENCE_MS: u64 = RETRY.as_millis() + PATIENCE.as_millis();

/// Initialises the magnetometer, reads every measurement, and begins again after any error.
pub async fn run(links: &Links, mut magnetometer: impl Magnetometer) -> ! {
    loop {
        match with_timeout(PATIENCE, magnetometer.init()).await {
            Ok(Ok(identity)) => {
                info!("magnetometer {=str}", identity.model.name());
                links.sensor.sender().send(FoundSensor { identity, period_us: magnetometer.period_us() });
                read_until_error(links, &mut magnetometer).await;
            }
            Ok(Err(_)) | Err(_) => warning!("magnetometer does not answer"),
        }
        count(&links.counters.sensor_errors);
        count(&links.heartbeats.sensor);
        Timer::after(RETRY).await;
    }
}

async fn read_until_error(links: &Links, magnetometer: &mut impl Magnetometer) {
    while let Ok(Ok(reading)) = with_timeout(PATIENCE, magnetometer.read()).await {
        let reading = stamped(reading);
        count(&links.counters.readings);
        count(&links.heartbeats.sensor);
        if reading.value.overrun {
            count(&links.counters.overruns);
        }
        if reading.value.saturated {
            count(&links.counters.saturated);
        }
        links.offer(&links.readings, reading);
    }
    warning!("magnetometer lost");
}
