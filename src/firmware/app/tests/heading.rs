//! The instrument task: readings and attitude in, estimates out.

use std::rc::Rc;

use super::TaskBench;
use super::devices::DETECTED_SENSOR;
use crate::app::instrument;
use crate::app::task_links::{AttitudeInput, SensorDetection, Timestamped, now, publish_value, subscribe};
use autoswing::attitude::{AttitudeReport, SenderId};
use autoswing::calibration::{Calibration, HeadingUncertainty, Orientation};
use autoswing::frames::{Field, RollPitch};
use autoswing::heading::NoHeading;
use autoswing::instrument::{Correction, Estimate};
use autoswing::reading::Reading;
use autoswing::time::{Timestamp, WrappingMillis};

fn test_calibration() -> Calibration {
    Calibration { inclination_rad: 1.0, total_ut: 50.0, ..Calibration::uncalibrated(Orientation::IDENTITY_ROTATION) }
}

fn test_correction() -> Correction {
    Correction {
        calibration: Some((test_calibration(), HeadingUncertainty::NO_UNCERTAINTY)),
        ..Correction::UNCALIBRATED
    }
}

fn bench_with_instrument() -> TaskBench {
    let mut bench = TaskBench::new();
    bench.spawn_task("instrument", |links| async move { instrument::run_instrument(&links).await });
    bench
}

/// Sends a level reading with this heading.
fn send_reading(bench: &TaskBench, heading_rad: f32) {
    let field = Field::new(RollPitch::default().to_body_frame(Field::earth_field(50.0, 1.0, heading_rad)).ut);
    bench.links.queue_or_count(
        &bench.links.readings,
        Timestamped { timestamp: now(), value: Reading { field, is_saturated: false, was_overwritten: false } },
    );
}

fn send_level_attitude(bench: &TaskBench) {
    let report = AttitudeReport {
        sender: SenderId::default(),
        sender_clock_at_sending: WrappingMillis::default(),
        attitude: RollPitch::default(),
        body_rates: None,
    };
    let input = Timestamped { timestamp: now(), value: AttitudeInput::Report(report) };
    bench.links.queue_or_count(&bench.links.attitude_inputs, input);
}

fn latest_estimate(bench: &TaskBench) -> Estimate {
    bench.links.estimates.try_get().unwrap_or(Estimate::EMPTY)
}

#[test]
fn readings_become_estimates_and_a_correction_applies_one_reading_later() {
    let mut bench = bench_with_instrument();
    bench.run_for_ms(20);
    send_level_attitude(&bench);
    send_reading(&bench, 0.5);
    bench.run_for_ms(1);
    assert_eq!(latest_estimate(&bench).heading, Err(NoHeading::Uncalibrated));
    assert_eq!(latest_estimate(&bench).timestamp, Timestamp::from_us(20_000));
    publish_value(&bench.links.correction, test_correction());
    bench.run_for_ms(10);
    assert_eq!(latest_estimate(&bench).heading, Err(NoHeading::Uncalibrated), "of the reading before");
    // The heading of a reading comes first: applying the new calibration before it would delay it.
    send_reading(&bench, 0.5);
    send_level_attitude(&bench);
    bench.run_for_ms(10);
    assert_eq!(latest_estimate(&bench).heading, Err(NoHeading::Uncalibrated), "of the reading that came first");
    // An attitude report of the same instant is processed before the reading, although it arrives later.
    send_reading(&bench, 0.5);
    send_level_attitude(&bench);
    bench.run_for_ms(1);
    let heading = latest_estimate(&bench).heading.unwrap();
    assert!((heading.magnetic_rad - 0.5).abs() < 1e-3, "{heading:?}");
}

/// An estimate follows 100 ms after the last reading, and every 100 ms from then on, so that ports keep their rates.
#[test]
fn a_silent_sensor_is_reported_to_the_ports() {
    let mut bench = bench_with_instrument();
    let links = Rc::clone(&bench.links);
    let mut estimates = subscribe(&links.estimates);
    bench.run_for_ms(50);
    send_reading(&bench, 0.5);
    bench.run_for_ms(99);
    assert_eq!(estimates.try_changed().unwrap().heading, Err(NoHeading::Uncalibrated));
    assert!(estimates.try_changed().is_none());
    for silence_ms in [150, 250, 350] {
        bench.run_for_ms(if silence_ms == 150 { 1 } else { 100 });
        let estimate = estimates.try_changed().unwrap();
        let expected = (Err(NoHeading::SensorSilent), Timestamp::from_us(silence_ms * 1000));
        assert_eq!((estimate.heading, estimate.timestamp), expected);
    }
    assert_eq!(bench.links.heartbeat_counts()[1], 4);
}

/// The silence limit and the samples follow the sensor's rate: at 50 ms, two readings make a sample.
#[test]
fn the_instrument_follows_the_sensor_that_was_found() {
    let mut bench = bench_with_instrument();
    publish_value(&bench.links.sensor, SensorDetection { period_us: 50_000, ..DETECTED_SENSOR });
    bench.run_for_ms(20);
    for _ in 0..4 {
        send_level_attitude(&bench);
        send_reading(&bench, 0.5);
        bench.run_for_ms(50);
    }
    send_level_attitude(&bench);
    bench.run_for_ms(1);
    assert_eq!(bench.links.samples.len(), 2);
    let links = Rc::clone(&bench.links);
    let mut estimates = subscribe(&links.estimates);
    let _ = estimates.try_changed();
    bench.run_for_ms(200);
    assert!(estimates.try_changed().is_none(), "0.25 s are a few periods");
    bench.run_for_ms(250);
    assert_eq!(estimates.try_changed().unwrap().heading, Err(NoHeading::SensorSilent));
}

#[test]
fn readings_without_attitude_are_counted() {
    let mut bench = bench_with_instrument();
    for _ in 0..40 {
        bench.run_for_ms(12);
        send_reading(&bench, 0.5);
        bench.run_for_ms(1);
    }
    // Readings of the last 0.3 s still wait for attitude.
    assert_eq!(bench.links.event_counts().unpaired_readings, 40 - 24);
}
