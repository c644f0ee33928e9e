//! Task of the instrument: passes readings and attitude to it, publishes its estimates and samples.

use embassy_futures::select::{Either4, select4};
use embassy_futures::yield_now;
use embassy_time::{Instant, Timer};

use super::task_links::{AttitudeInput, SensorDetection, Timestamped, increment_counter, now, subscribe};
use crate::app::task_links::TaskLinks;
use autoswing::attitude::HAS_OWN_ATTITUDE;
use autoswing::instrument::{ChangeReporter, Instrument, InstrumentConfig, TurnRequest};
use autoswing_module::messages::Message;

/// Reading period of the reference sensor, microseconds; used until a sensor is detected.
const DEFAULT_READING_PERIOD_US: u32 = 12_500;

/// Runs the instrument for ever.
pub async fn run_instrument(links: &TaskLinks) -> ! {
    let mut sensor = subscribe(&links.sensor);
    let mut correction = subscribe(&links.correction);
    let estimates = links.estimates.sender();
    let mut instrument = Instrument::new(InstrumentConfig::new(DEFAULT_READING_PERIOD_US));
    let mut change_report = ChangeReporter::NOTHING_REPORTED;
    let mut turn_request = TurnRequest::NO_GROWTH;
    let mut silent_at = silence_deadline(&instrument);
    loop {
        // Reports are received before readings, so that a reading uses attitude of its own instant.
        let event =
            select4(sensor.changed(), links.attitude_inputs.receive(), links.readings.receive(), Timer::at(silent_at))
                .await;
        increment_counter(&links.heartbeats.instrument);
        let has_new_estimate = matches!(event, Either4::Third(_) | Either4::Fourth(()));
        match event {
            Either4::First(found) => configure_sensor(&mut instrument, found),
            Either4::Second(Timestamped { timestamp, value: AttitudeInput::Own(estimate) }) => {
                if HAS_OWN_ATTITUDE {
                    instrument.on_inertial_attitude(timestamp, &estimate);
                }
            }
            Either4::Second(Timestamped { timestamp, value: AttitudeInput::Report(report) }) => {
                instrument.on_attitude(timestamp, report);
                // The motor current is polled on attitude reports, which are more frequent than currents and less
                // urgent than readings.
                if let Some(current) = links.motor_current.try_get() {
                    instrument.on_current(current.timestamp, current.value);
                }
            }
            Either4::Third(reading) => {
                let estimate = instrument.on_reading(reading.timestamp, reading.value);
                let requested_sigma_rad =
                    turn_request.update_request(&estimate).filter(|_| links.is_armed() != Some(false));
                estimates.send(estimate);
                if let Some(sigma_rad) = requested_sigma_rad {
                    links.broadcast_message(&Message::TurnRequested { sigma_rad });
                }
                silent_at = silence_deadline(&instrument);
            }
            Either4::Fourth(()) => {
                estimates.send(instrument.on_silence(now()));
                silent_at = silence_deadline(&instrument);
            }
        }
        while let Some(sample) = instrument.next_sample() {
            links.queue_or_count(&links.samples, sample);
        }
        // Work that takes longer than a heading, such as a new correction, follows an estimate: the next reading is
        // then furthest away.
        if has_new_estimate {
            // The executor first runs the task that was woken last. After one yield this task runs again; after two the
            // ports have run in between.
            yield_now().await;
            yield_now().await;
            links.event_counters.copy_instrument_counts(&instrument);
            if let Some(changed) = correction.try_changed() {
                instrument.set_correction(changed);
            }
            instrument.update_monitor();
            let is_armed = links.is_armed() == Some(true);
            if let Some(change) = change_report.report_if_changed(now(), is_armed, instrument.installation_change()) {
                links.broadcast_message(&change.map_or(Message::InstallationRestored, Message::InstallationChanged));
            }
        }
    }
}

fn silence_deadline(instrument: &Instrument) -> Instant {
    Instant::now() + embassy_time::Duration::from_micros(instrument.instrument_config().silence_timeout_us())
}

/// Reconfigures the instrument if another sensor was detected.
fn configure_sensor(instrument: &mut Instrument, sensor: SensorDetection) {
    let InstrumentConfig { reading_period_us, equal_readings_until_stuck, .. } = *instrument.instrument_config();
    if (sensor.period_us, Some(sensor.equal_readings_until_stuck)) != (reading_period_us, equal_readings_until_stuck) {
        instrument.set_sensor_parameters(sensor.period_us, Some(sensor.equal_readings_until_stuck));
    }
}
