//! Makes headings: pairs readings with attitude, corrects, sends sentences, and hands samples to the collection.

use embassy_time::{Duration, Instant, with_timeout};
use embedded_io_async::Write;

use super::Links;
use super::links::{Active, StampedReading, count};
use crate::attitude::Lookup;
use crate::collection::averager::Averager;
use crate::frames::{Attitude, Field, Sensor};
use crate::heading::{self, Heading, NoHeading};
use crate::wire::nmea;

/// A sensor silent for longer gets empty sentences: eight periods at 80 Hz.
const SENSOR_SILENCE: Duration = Duration::from_millis(100);

/// A port that does not take a sentence within this time has something wrong with it.
const WRITE_PATIENCE: Duration = Duration::from_millis(100);

/// Readings wait for their attitude no longer than this, microseconds.
const PAIRING_PATIENCE_US: u64 = 300_000;

/// Makes a heading of every reading and sends sentences at the rate that is set.
pub async fn run(links: &Links, mut tx: impl Write) -> ! {
    let mut pairing = Pairing::new();
    let mut pace = Pace::default();
    loop {
        let reading = with_timeout(SENSOR_SILENCE, links.readings.receive()).await;
        count(&links.heartbeats.stream);
        let active = links.active();
        let heading = match &reading {
            Ok(stamped) => {
                pairing.push(links, &active, stamped);
                heading_of(links, &active, stamped)
            }
            Err(_silent) => Err(NoHeading::SensorSilent),
        };
        links.set_heading(heading);
        let now_us = reading.as_ref().map_or_else(|_| Instant::now().as_micros(), |stamped| stamped.time_us);
        if active.settings.stream_on && pace.is_due(now_us, active.settings.stream_rate_hz) {
            send(links, &mut tx, heading, active.settings.declination_deg).await;
        }
    }
}

fn heading_of(links: &Links, active: &Active, stamped: &StampedReading) -> Result<Heading, NoHeading> {
    if stamped.reading.saturated {
        return Err(NoHeading::SensorSaturated);
    }
    let (calibration, uncertainty) = active.calibration.as_ref().ok_or(NoHeading::Uncalibrated)?;
    let attitude = links.attitude_at(stamped.time_us).ok_or(NoHeading::AttitudeStale)?;
    heading::heading(heading::Config::DEFAULT, calibration, uncertainty, stamped.reading.field, attitude)
        .map(|heading| heading.turned_by(active.settings.align_deg))
}

async fn send(links: &Links, tx: &mut impl Write, heading: Result<Heading, NoHeading>, declination_deg: Option<f32>) {
    let heading_deg = heading.as_ref().ok().map(Heading::magnetic_deg);
    count(&links.counters.sentences);
    if heading.is_err() {
        count(&links.counters.sentences_empty);
    }
    for sentence in [nmea::hdm(heading_deg), nmea::hdg(heading_deg, declination_deg), nmea::quality(&heading)] {
        if !matches!(with_timeout(WRITE_PATIENCE, tx.write_all(sentence.as_bytes())).await, Ok(Ok(()))) {
            count(&links.counters.stream_errors);
        }
    }
}

/// When the next sentence is due.
#[derive(Default)]
struct Pace {
    due_us: u64,
}

impl Pace {
    fn is_due(&mut self, now_us: u64, rate_hz: u8) -> bool {
        let period_us = 1_000_000 / u64::from(rate_hz.max(1));
        if now_us < self.due_us {
            return false;
        }
        // On the grid of the last due time, unless that is long past.
        let next_us = self.due_us + period_us;
        self.due_us = if next_us > now_us { next_us } else { now_us + period_us };
        true
    }
}

/// Readings that wait for the attitude after them, so that it can be interpolated to their instant.
struct Pairing {
    waiting: heapless::Deque<(u64, Field<Sensor>), 32>,
    averager: Averager,
}

impl Pairing {
    const fn new() -> Self {
        Self { waiting: heapless::Deque::new(), averager: Averager::new() }
    }

    fn push(&mut self, links: &Links, active: &Active, stamped: &StampedReading) {
        if active.without_attitude {
            if !stamped.reading.saturated {
                self.pair(links, stamped.time_us, stamped.reading.field, Attitude::default());
            }
            return;
        }
        if !stamped.reading.saturated {
            if self.waiting.is_full() {
                self.waiting.pop_front();
                count(&links.counters.unpaired);
            }
            // There is room: one was just taken out if there was none.
            let _ = self.waiting.push_back((stamped.time_us, stamped.reading.field));
        }
        while let Some(&(time_us, field)) = self.waiting.front() {
            match links.with_track(|track| track.at(time_us)) {
                Lookup::Interpolated(attitude) => self.pair(links, time_us, field, attitude),
                Lookup::Missing => count(&links.counters.unpaired),
                Lookup::Extrapolated(_) | Lookup::Stale => {
                    if stamped.time_us.saturating_sub(time_us) < PAIRING_PATIENCE_US {
                        return;
                    }
                    count(&links.counters.unpaired);
                }
            }
            self.waiting.pop_front();
        }
    }

    fn pair(&mut self, links: &Links, time_us: u64, field: Field<Sensor>, attitude: Attitude) {
        if let Some(sample) = self.averager.push(time_us, field, attitude)
            && links.samples.try_send(sample).is_err()
        {
            count(&links.counters.samples_dropped);
        }
    }
}
