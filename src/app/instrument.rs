//! Feeds the instrument and forwards what comes out of it.

use embassy_futures::select::{Either4, select4};
use embassy_futures::yield_now;
use embassy_time::{Instant, Timer};

use super::Links;
use super::links::{FoundSensor, count, listen, now};
use crate::calibration::CURRENT_IS_LOOKED_FOR;
use crate::instrument::{Config, Instrument, IronNews};

/// The period of the reference sensor: what silence is measured by until one has answered.
const FIRST_PERIOD_US: u32 = 12_500;

/// Runs the instrument for ever.
pub async fn run(links: &Links) -> ! {
    let mut sensor = listen(&links.sensor);
    let mut correction = listen(&links.correction);
    let estimates = links.estimates.sender();
    let mut instrument = Instrument::new(Config::new(FIRST_PERIOD_US));
    let mut news = IronNews::NONE;
    let mut silent_at = silence_from_now(&instrument);
    loop {
        // Reports before readings: what is known of an instant counts at that instant.
        let event =
            select4(sensor.changed(), links.reports.receive(), links.readings.receive(), Timer::at(silent_at)).await;
        count(&links.heartbeats.instrument);
        let has_told = matches!(event, Either4::Third(_) | Either4::Fourth(()));
        match event {
            Either4::First(found) => adapt(&mut instrument, found),
            Either4::Second(report) => {
                instrument.on_attitude(report.at, report.value);
                // Who tells a current tells an attitude, and oftener; a reading is in more of a hurry.
                if CURRENT_IS_LOOKED_FOR && let Some(told) = links.current.try_get() {
                    instrument.on_current(told.at, told.value);
                }
            }
            Either4::Third(reading) => {
                estimates.send(instrument.on_reading(reading.at, reading.value));
                silent_at = silence_from_now(&instrument);
            }
            Either4::Fourth(()) => {
                estimates.send(instrument.on_silence(now()));
                silent_at = silence_from_now(&instrument);
            }
        }
        while let Some(sample) = instrument.next_sample() {
            links.offer(&links.samples, sample);
        }
        // What takes longer than a heading, a new correction too, has its time when one has just been told, and the next
        // reading is far.
        if has_told {
            // The executor takes what was woken last first: of one turn given away this task gets the first again, of two the
            // ports have theirs in between.
            yield_now().await;
            yield_now().await;
            links.counters.take(&instrument.counts());
            if let Some(changed) = correction.try_changed() {
                instrument.correct_with(changed);
            }
            if instrument.has_to_watch() {
                instrument.watch();
            }
            if let Some(iron) = news.see(instrument.iron()) {
                links.iron.signal(iron);
            }
        }
    }
}

fn silence_from_now(instrument: &Instrument) -> Instant {
    Instant::now() + embassy_time::Duration::from_micros(instrument.config().silence_us())
}

/// Another sensor than the last makes another instrument.
fn adapt(instrument: &mut Instrument, found: FoundSensor) {
    let Config { reading_period_us, stuck_after, .. } = *instrument.config();
    if (found.period_us, Some(found.stuck_after)) != (reading_period_us, stuck_after) {
        instrument.set_sensor(found.period_us, Some(found.stuck_after));
    }
}
