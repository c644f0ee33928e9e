//! LIS3MDL driver with the register-level chip model: fresh, complete data, and recovery from faults.

use std::cell::RefCell;
use std::rc::Rc;

use autoswing::frames::Field;
use autoswing::magnetometer::lis3mdl::{Lis3mdl, Lis3mdlConfig};
use autoswing::magnetometer::{Magnetometer, MagnetometerError};
use autoswing::reading::Reading;
use embassy_time::Instant;
use simulator::devices::i2c::{Bus, BusError};
use simulator::devices::lis3mdl as chip;
use testkit::simulation::{Level, Simulation};

/// Runs `script` with a driver and its chip. The field's x component is 1 nT per 100 us since start, so a sample
/// contains its time of measurement with a resolution of 15 nT = 1.5 ms.
fn with_driver<S, F>(script: S)
where
    S: FnOnce(Lis3mdl<Bus>, Rc<RefCell<chip::Lis3mdl>>) -> F + 'static,
    F: Future<Output = ()> + 'static,
{
    let mut simulation = Simulation::new();
    let config = chip::Lis3mdlConfig { noise_scale: 0.0, ..chip::Lis3mdlConfig::default() };
    let chip = chip::Lis3mdl::new(config, Box::new(|at_us| Field::from_ut(at_us as f32 * 1e-5, 0.0, 0.0)));
    let bus = Bus::new();
    bus.attach(chip.clone());
    simulation.spawn(Level::Interrupt, "script", script(Lis3mdl::new(bus, Lis3mdlConfig::default()), chip));
    simulation.run_for(60_000_000);
    assert_eq!(simulation.tasks(), 0, "the script did not end");
}

fn measured_at_us(reading: &Reading) -> f32 {
    reading.field.ut.x * 1e5
}

/// 160 samples in 2 s at 80 Hz. A sample is at most 1.3 ms old: 0.5 ms of polling, two transfers (0.09 and 0.2 ms), and
/// half a count of the field that encodes time.
#[test]
fn every_measurement_is_read_once_and_fresh() {
    with_driver(|mut driver, _| async move {
        driver.init().await.unwrap();
        let mut last_us = measured_at_us(&driver.read().await.unwrap());
        for _ in 0..160 {
            let reading = driver.read().await.unwrap();
            assert!(!reading.overrun);
            let (measured_us, now_us) = (measured_at_us(&reading), Instant::now().as_micros() as f32);
            assert!((-750.0..1_550.0).contains(&(now_us - measured_us)), "age {} us", now_us - measured_us);
            assert!((measured_us - last_us - 12_500.0).abs() <= 1_500.0, "{last_us} to {measured_us} us");
            last_us = measured_us;
        }
    });
}

#[test]
fn a_silent_chip_is_reported_and_works_again_after_init() {
    with_driver(|mut driver, chip| async move {
        driver.init().await.unwrap();
        chip.borrow_mut().set_silent(true);
        assert_eq!(driver.read().await, Err(MagnetometerError::Bus(BusError::NoAcknowledge(0x1E))));
        assert_eq!(driver.init().await, Err(MagnetometerError::Bus(BusError::NoAcknowledge(0x1E))));
        chip.borrow_mut().set_silent(false);
        driver.init().await.unwrap();
        driver.read().await.unwrap();
    });
}

/// After a power loss the chip is in power-down: no data, detected within four periods (50 ms) after the sleep of 11
/// ms.
#[test]
fn a_chip_that_lost_power_is_detected_and_reconfigured() {
    with_driver(|mut driver, chip| async move {
        driver.init().await.unwrap();
        driver.read().await.unwrap();
        chip.borrow_mut().power_cycle();
        let start = Instant::now();
        assert_eq!(driver.read().await, Err(MagnetometerError::NoData));
        assert!(start.elapsed().as_millis() <= 62, "{} ms", start.elapsed().as_millis());
        driver.init().await.unwrap();
        driver.read().await.unwrap();
    });
}

#[test]
fn a_late_reader_sees_the_overrun() {
    with_driver(|mut driver, _| async move {
        driver.init().await.unwrap();
        driver.read().await.unwrap();
        embassy_time::Timer::after_millis(100).await;
        assert!(driver.read().await.unwrap().overrun);
        assert!(!driver.read().await.unwrap().overrun);
    });
}
