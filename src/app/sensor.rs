//! Keeps the magnetometer measuring.

use embassy_time::{Duration, Instant, Timer, with_timeout};

use super::Links;
use super::links::{FoundSensor, count, stamped};
use crate::log::{info, warning};
use crate::magnetometer::{Error, Magnetometer};

/// A sensor that does not answer is tried again so often.
const RETRY: Duration = Duration::from_millis(200);

/// No driver call takes longer, or its bus hangs.
const PATIENCE: Duration = Duration::from_millis(400);

/// The configuration is read back so often: a bit that flips in it costs a second of headings.
const VERIFY_EVERY: Duration = Duration::from_secs(1);

/// The longest time without a sign of life from this task, milliseconds.
pub(super) const LONGEST_SILENCE_MS: u64 = RETRY.as_millis() + PATIENCE.as_millis();

/// Why measurements have ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Ended {
    /// The sensor does not answer, or not as it should.
    Lost,
    /// Its configuration has changed.
    Upset,
}

/// Initialises the magnetometer, reads every measurement, and begins again after any error.
pub async fn run(links: &Links, mut magnetometer: impl Magnetometer) -> ! {
    loop {
        match with_timeout(PATIENCE, magnetometer.init()).await {
            Ok(Ok(identity)) => {
                info!("magnetometer {=str}", identity.model.name());
                let (period_us, stuck_after) = (magnetometer.period_us(), magnetometer.stuck_after());
                links.sensor.sender().send(FoundSensor { identity, period_us, stuck_after });
                if read_until_error(links, &mut magnetometer).await == Ended::Upset {
                    // It answers: there is nothing to wait for.
                    count(&links.counters.sensor_upsets);
                    continue;
                }
            }
            Ok(Err(_)) | Err(_) => warning!("magnetometer does not answer"),
        }
        count(&links.counters.sensor_errors);
        count(&links.heartbeats.sensor);
        Timer::after(RETRY).await;
    }
}

async fn read_until_error(links: &Links, magnetometer: &mut impl Magnetometer) -> Ended {
    let mut verify_at = Instant::now() + VERIFY_EVERY;
    while let Ok(Ok(reading)) = with_timeout(PATIENCE, magnetometer.read()).await {
        let reading = stamped(reading);
        count(&links.counters.readings);
        count(&links.heartbeats.sensor);
        if reading.value.overrun {
            count(&links.counters.overruns);
        }
        links.offer(&links.readings, reading);
        // Right after a measurement the next is furthest away.
        if Instant::now() >= verify_at {
            verify_at += VERIFY_EVERY;
            match with_timeout(PATIENCE, magnetometer.verify()).await {
                Ok(Ok(())) => {}
                Ok(Err(Error::Configuration { .. })) => {
                    warning!("magnetometer upset");
                    return Ended::Upset;
                }
                Ok(Err(_)) | Err(_) => break,
            }
        }
    }
    warning!("magnetometer lost");
    Ended::Lost
}
