//! Keeps the magnetometer measuring.

use embassy_time::{Duration, Instant, Timer, with_timeout};

use super::Links;
use super::links::{StampedReading, count};
use crate::log::{info, warning};
use crate::magnetometer::Magnetometer;

/// A sensor that does not answer is tried again so often.
const RETRY: Duration = Duration::from_millis(200);

/// No driver call takes longer, or its bus hangs.
const PATIENCE: Duration = Duration::from_millis(400);

/// Initialises the magnetometer, reads every measurement, and begins again after any error.
pub async fn run(links: &Links, mut magnetometer: impl Magnetometer) -> ! {
    loop {
        match with_timeout(PATIENCE, magnetometer.init()).await {
            Ok(Ok(identity)) => {
                info!("magnetometer {=str}", identity.model.name());
                links.set_identity(identity);
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
        let time_us = Instant::now().as_micros();
        count(&links.counters.readings);
        count(&links.heartbeats.sensor);
        if reading.overrun {
            count(&links.counters.overruns);
        }
        if reading.saturated {
            count(&links.counters.saturated);
        }
        if links.readings.try_send(StampedReading { time_us, reading }).is_err() {
            count(&links.counters.samples_dropped);
        }
    }
    warning!("magnetometer lost");
}
