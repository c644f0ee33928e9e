//! The sensor task: measurements, loss and recovery of the sensor.

use std::rc::Rc;

use super::TaskBench;
use super::devices::{Chip, DeviceBehaviour, SENSOR};
use crate::app::links::{DetectedSensor, subscribe};
use crate::app::sensor;

fn bed() -> (TaskBench, Chip) {
    let (mut bed, chip) = (TaskBench::new(), Chip::default());
    let magnetometer = chip.clone();
    bed.run("sensor", |links| async move { sensor::run(&links, magnetometer).await });
    (bed, chip)
}

#[test]
fn every_measurement_is_passed_on_with_its_instant() {
    let (mut bed, _) = bed();
    bed.ms(35);
    let readings: Vec<u64> =
        std::iter::from_fn(|| bed.links.readings.try_receive().ok()).map(|reading| reading.at.as_us()).collect();
    assert_eq!(readings, [10_000, 20_000, 30_000]);
    assert_eq!(bed.links.counts().readings, 3);
    let found = DetectedSensor { identity: SENSOR, period_us: Chip::PERIOD_US, stuck_after: Chip::STUCK_AFTER };
    assert_eq!(bed.links.sensor.try_get(), Some(found));
}

#[test]
fn what_nobody_reads_is_counted() {
    let (mut bed, _) = bed();
    bed.ms(65);
    assert_eq!((bed.links.counts().readings, bed.links.counts().samples_dropped), (6, 2));
}

#[test]
fn measurements_that_were_overwritten_are_counted() {
    let (mut bed, chip) = bed();
    for (overrun, overruns) in [(false, 0), (true, 1), (false, 1)] {
        chip.flags.set((false, overrun));
        bed.ms(10);
        assert_eq!(bed.links.counts().overruns, overruns);
    }
}

/// The sensor is initialised at once, without the delay after a lost sensor.
#[test]
fn a_changed_configuration_is_found_within_a_second_and_mended() {
    let (mut bed, chip) = bed();
    bed.ms(3_500);
    assert_eq!((chip.verifies.get(), chip.inits.get()), (3, 1));
    chip.verify.set(DeviceBehaviour::Upset);
    bed.ms(509);
    assert_eq!((chip.verifies.get(), chip.inits.get()), (4, 2));
    let counts = bed.links.counts();
    assert_eq!((counts.sensor_upsets, counts.sensor_errors), (1, 0));
    chip.verify.set(DeviceBehaviour::Works);
    let before = counts.readings;
    bed.ms(990);
    assert_eq!(bed.links.counts().readings, before + 99, "no measurement was lost over it");
}

#[test]
fn a_sensor_that_fails_when_it_is_verified_is_lost() {
    for mood in [DeviceBehaviour::Fails, DeviceBehaviour::Hangs] {
        let (mut bed, chip) = bed();
        chip.verify.set(mood);
        bed.ms(1_450);
        let counts = bed.links.counts();
        assert_eq!((counts.sensor_upsets, counts.sensor_errors), (0, 1), "{mood:?}");
        assert_eq!(bed.links.heartbeat_counts()[0], counts.readings + 1);
    }
}

/// Each attempt sends a heartbeat.
#[test]
fn a_missing_sensor_is_looked_for_every_fifth_of_a_second() {
    let (mut bed, chip) = bed();
    chip.init.set(DeviceBehaviour::Fails);
    bed.ms(999);
    assert_eq!(chip.inits.get(), 5, "at 0, 200, 400, 600 and 800 ms");
    assert_eq!(bed.links.counts().sensor_errors, 5);
    assert_eq!(bed.links.heartbeat_counts()[0], 5);
    assert!(bed.links.sensor.try_get().is_none());
    chip.init.set(DeviceBehaviour::Works);
    bed.ms(1);
    bed.ms(100);
    assert_eq!(bed.links.counts().readings, 10);
}

/// Timeout of 0.4 s.
#[test]
fn a_bus_that_hangs_is_given_up() {
    let (mut bed, chip) = bed();
    chip.init.set(DeviceBehaviour::Hangs);
    bed.ms(399);
    assert_eq!(bed.links.counts().sensor_errors, 0);
    bed.ms(1);
    assert_eq!(bed.links.counts().sensor_errors, 1);
    chip.init.set(DeviceBehaviour::Works);
    bed.ms(250);
    assert_eq!(bed.links.counts().readings, 5);
    chip.read.set(DeviceBehaviour::Hangs);
    bed.ms(420);
    assert_eq!(bed.links.counts().sensor_errors, 2);
}

#[test]
fn a_lost_sensor_is_found_again() {
    let (mut bed, chip) = bed();
    let links = Rc::clone(&bed.links);
    let mut found = subscribe(&links.sensor);
    bed.ms(15);
    assert!(found.try_changed().is_some());
    chip.read.set(DeviceBehaviour::Fails);
    bed.ms(10);
    chip.read.set(DeviceBehaviour::Works);
    assert_eq!((chip.inits.get(), bed.links.counts().sensor_errors), (1, 1));
    assert!(found.try_changed().is_none());
    bed.ms(200);
    assert_eq!(chip.inits.get(), 2);
    assert!(found.try_changed().is_some());
}
