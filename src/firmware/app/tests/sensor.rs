//! The sensor task: measurements, loss and recovery of the sensor.

use super::TaskBench;
use super::devices::{DETECTED_SENSOR, DeviceBehaviour, FakeMagnetometer};
use crate::app::sensor;

fn bench_with_sensor() -> (TaskBench, FakeMagnetometer) {
    let (mut bench, chip) = (TaskBench::new(), FakeMagnetometer::default());
    let magnetometer = chip.clone();
    bench.spawn_task("sensor", |links| async move { sensor::run_sensor(&links, magnetometer).await });
    (bench, chip)
}

#[test]
fn every_measurement_is_passed_on_with_its_instant() {
    let (mut bench, _) = bench_with_sensor();
    bench.run_for_ms(35);
    let readings: Vec<u64> = std::iter::from_fn(|| bench.links.readings.try_receive().ok())
        .map(|reading| reading.timestamp.as_us())
        .collect();
    assert_eq!(readings, [10_000, 20_000, 30_000]);
    assert_eq!(bench.links.event_counts().readings, 3);
    assert_eq!(bench.links.sensor.try_get(), Some(DETECTED_SENSOR));
}

#[test]
fn readings_dropped_from_a_full_queue_are_counted() {
    let (mut bench, _) = bench_with_sensor();
    bench.run_for_ms(65);
    assert_eq!((bench.links.event_counts().readings, bench.links.event_counts().samples_dropped), (6, 2));
}

#[test]
fn overwritten_measurements_are_counted() {
    let (mut bench, chip) = bench_with_sensor();
    for (was_overwritten, overruns) in [(false, 0), (true, 1), (false, 1)] {
        chip.was_overwritten.set(was_overwritten);
        bench.run_for_ms(10);
        assert_eq!(bench.links.event_counts().overruns, overruns);
    }
}

/// Verified after 0.1 s; a bus that hangs times out 0.4 s later.
#[test]
fn a_sensor_that_fails_its_verification_is_lost() {
    for (behaviour, lost_after_ms) in [(DeviceBehaviour::Fails, 100), (DeviceBehaviour::Hangs, 500)] {
        let (mut bench, chip) = bench_with_sensor();
        chip.verify_behaviour.set(behaviour);
        bench.run_for_ms(lost_after_ms - 10);
        assert_eq!(bench.links.event_counts().sensor_errors, 0, "{behaviour:?}");
        bench.run_for_ms(60);
        let counts = bench.links.event_counts();
        assert_eq!((counts.sensor_register_upsets, counts.sensor_errors), (0, 1), "{behaviour:?}");
        assert_eq!(bench.links.heartbeat_counts()[0], counts.readings + 1);
    }
}

/// A bus that hangs times out after 0.4 s. The pause of 0.2 s follows.
#[test]
fn a_missing_sensor_is_initialised_again_every_200_ms() {
    for (behaviour, init_count, error_count) in [(DeviceBehaviour::Fails, 5, 5), (DeviceBehaviour::Hangs, 2, 1)] {
        let (mut bench, chip) = bench_with_sensor();
        chip.init_behaviour.set(behaviour);
        bench.run_for_ms(999);
        assert_eq!(chip.init_count.get(), init_count, "{behaviour:?}");
        assert_eq!(bench.links.event_counts().sensor_errors, error_count, "{behaviour:?}");
        assert_eq!(bench.links.heartbeat_counts()[0], error_count, "{behaviour:?}");
        assert!(bench.links.sensor.try_get().is_none());
        chip.init_behaviour.set(DeviceBehaviour::Works);
        bench.run_for_ms(301);
        assert!(bench.links.event_counts().readings > 0, "{behaviour:?}");
    }
}
