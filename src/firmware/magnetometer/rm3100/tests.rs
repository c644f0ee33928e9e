//! Unit tests of `rm3100`.

use embassy_time::Instant;
use testkit::simulation::{Level, Simulation};

use super::super::chip::registers::{SimulatedRegisters, assert_every_bit_is_verified};
use super::*;

/// A chip that has a measurement, and whose self-test gives `result`.
fn driver_with_test_result(result: u8) -> Rm3100<SimulatedRegisters> {
    let mut registers = SimulatedRegisters::new(0, &[(0x36, 0x22), (0x34, 0x80), (0x33, result)]);
    registers.write_protected = vec![0x33];
    Rm3100::new(registers)
}

fn driver() -> Rm3100<SimulatedRegisters> {
    driver_with_test_result(0xFF)
}

/// Runs a script in virtual time until it ends.
fn simulate<F: Future<Output = ()> + 'static>(script: F) {
    let mut simulation = Simulation::new();
    simulation.spawn(Level::Interrupt, "script", script);
    simulation.run_for(100_000_000);
    assert_eq!(simulation.task_count(), 0, "the script did not end");
}

/// Manual: BIST 0x8F and POLL 0x70 test the oscillators; 00 C8 is a cycle count of 200, TMRC 0x95 75 Hz, CMM 0x79
/// three axes with data ready after all of them. Writing TMRC ends continuous mode.
#[test]
fn init_stops_tests_configures_and_starts_in_this_order() {
    simulate(async {
        let mut driver = driver();
        assert_eq!(driver.init().await, Ok(Identity { model: MagnetometerModel::Rm3100, address: 0 }));
        let cycle_counts = (4..).zip([0x00, 0xC8, 0x00, 0xC8, 0x00, 0xC8]);
        let expected: Vec<(u8, u8)> = [(0x01, 0x00), (0x33, 0x8F), (0x00, 0x70), (0x33, 0x00)]
            .into_iter()
            .chain(cycle_counts)
            .chain([(0x0B, 0x95), (0x01, 0x79)])
            .collect();
        assert_eq!(driver.chip.spi_device.write_log, expected);
    });
}

/// Reading CMM ends continuous mode.
#[test]
fn the_continuous_mode_register_is_never_read() {
    simulate(async {
        let mut driver = driver();
        driver.init().await.unwrap();
        driver.read_measurement().await.unwrap();
        driver.verify_configuration().await.unwrap();
        assert!(!driver.chip.spi_device.was_read[0x01]);
        assert!(driver.chip.spi_device.was_read[0x24..0x2D].iter().all(|&was_read| was_read));
    });
}

/// A line at rest reads as 0xFF or 0x00.
#[test]
fn a_chip_with_another_identity_is_not_configured() {
    simulate(async {
        for other in [0x00, 0x21, 0x23, 0xFF] {
            let mut driver = driver();
            driver.chip.spi_device.values[0x36] = other;
            assert_eq!(driver.init().await, Err(MagnetometerError::WrongIdentity(other)));
            assert_eq!(driver.chip.spi_device.write_log, []);
        }
    });
}

/// Bits 4 to 6 are the axes; the result is valid while bit 7 is set.
#[test]
fn each_failed_oscillator_fails_the_self_test() {
    simulate(async {
        for bit in 4..8 {
            let result = !(1_u8 << bit);
            let mut driver = driver_with_test_result(result);
            assert_eq!(driver.init().await, Err(MagnetometerError::SelfTest(result)));
            assert!(!driver.chip.spi_device.write_log.contains(&(0x01, 0x79)), "not started");
        }
        let mut driver = driver_with_test_result(0xF0);
        assert!(driver.init().await.is_ok(), "bits 0 to 3 are settings");
    });
}

#[test]
fn a_self_test_without_an_end_is_reported() {
    simulate(async {
        let mut driver = driver();
        driver.chip.spi_device.values[0x34] = 0x7F;
        assert_eq!(driver.init().await, Err(MagnetometerError::NoData));
    });
}

#[test]
fn a_register_that_reads_back_differently_is_reported_before_the_start() {
    for (register, written) in [(0x05, 0xC8), (0x07, 0xC8), (0x09, 0xC8), (0x0B, 0x95)] {
        simulate(async move {
            let mut driver = driver();
            driver.chip.spi_device.write_protected.push(register);
            assert_eq!(driver.init().await, Err(MagnetometerError::Configuration { written, read: 0 }));
            assert!(!driver.chip.spi_device.write_log.contains(&(0x01, 0x79)), "not started");
        });
    }
}

#[test]
fn every_bit_of_cycle_counts_and_rate_is_verified() {
    simulate(async {
        let mut driver = driver();
        assert_every_bit_is_verified(&mut driver, |driver| &mut driver.chip.spi_device, 0x04..0x0A).await;
        assert_every_bit_is_verified(&mut driver, |driver| &mut driver.chip.spi_device, 0x0B..0x0C).await;
    });
}

/// Polls from 79 % of 13.333 ms for four periods, 0.5 ms apart.
#[test]
fn old_measurements_are_not_returned() {
    simulate(async {
        let mut driver = driver();
        driver.init().await.unwrap();
        driver.chip.spi_device.values[0x34] = 0x7F;
        let start = Instant::now();
        assert_eq!(driver.read_measurement().await, Err(MagnetometerError::NoData));
        assert_eq!(start.elapsed().as_micros(), 10_533 + 53_500);
    });
}

/// Minus one count on all axes; no chip drives the line, which also reads as data ready.
#[test]
fn data_of_ones_is_no_measurement() {
    simulate(async {
        let mut driver = driver();
        driver.chip.spi_device.values[0x24..0x2D].fill(0xFF);
        assert_eq!(driver.read_measurement().await, Err(MagnetometerError::NoData));
        driver.chip.spi_device.values[0x2C] = 0xFE;
        assert!(driver.read_measurement().await.is_ok());
    });
}

/// The sensitivity is 75 counts per microtesla.
#[test]
fn counts_become_microtesla_on_the_chips_axes() {
    let reading = decode_reading([0x00, 0x1D, 0x4C, 0xFF, 0xF1, 0x5A, 0x00, 0x00, 0x01]);
    assert_eq!(reading.field, Field::from_ut(100.0, -50.0, 1.0 / 75.0));
    assert!(!reading.is_saturated && !reading.was_overwritten);
}

/// 800 uT are 60,000 counts.
#[test]
fn either_end_of_the_range_is_saturation_on_any_axis() {
    for (counts, saturated) in
        [(60_000, false), (-60_000, false), (60_001, true), (-60_001, true), (0x7F_FFFF, true), (-0x80_0000, true)]
    {
        for axis in 0..3 {
            let mut data = [0; 9];
            data[3 * axis..3 * axis + 3].copy_from_slice(&i32::to_be_bytes(counts)[1..]);
            assert_eq!(decode_reading(data).is_saturated, saturated, "{counts} on {axis}");
        }
    }
}

/// Noise of half the manual's 15 nT, with the field at the middle of a count.
#[test]
fn noise_at_rest_seldom_resembles_a_stuck_axis() {
    let sigma_counts = 0.5 * 0.015 * 75.0;
    let most_frequent = libm::erf(0.5 / (sigma_counts * core::f64::consts::SQRT_2));
    let readings_a_day = 3.0 * 86_400e6 / f64::from(driver().period_us());
    let count = f64::from(driver().equal_readings_until_stuck());
    let runs_a_day = readings_a_day * most_frequent.powf(count) * (1.0 - most_frequent);
    assert!(runs_a_day < 1.0 / 365.0, "{runs_a_day}");
    assert!(count * 13.333e-3 < 0.7, "a turn is detected within 0.7 s");
}
