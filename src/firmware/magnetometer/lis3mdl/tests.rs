//! Unit tests of `lis3mdl`.

use embassy_futures::block_on;
use embassy_time::Instant;
use embedded_hal_async::i2c::ErrorKind;
use testkit::simulation::{Level, Simulation};

use super::super::chip::registers::{SimulatedRegisters, assert_every_bit_is_verified};
use super::*;

fn registers() -> SimulatedRegisters {
    SimulatedRegisters::new(AUTO_INCREMENT, &[(WHO_AM_I, WHO_AM_I_VALUE)])
}

#[test]
fn init_writes_the_configuration_of_the_data_sheet() {
    let mut driver = Lis3mdl::new(registers(), Lis3mdlConfig::default());
    let identity = block_on(driver.init());
    assert_eq!(identity, Ok(Identity { model: MagnetometerModel::Lis3mdl, address: 0x1E }));
    // UHP 80 Hz, 4 gauss, continuous, UHP, BDU: data sheet sections 7.3 to 7.7.
    assert_eq!(driver.chip.i2c_bus.values[0x20..0x25], [0x7C, 0x00, 0x00, 0x0C, 0x40]);
}

#[test]
fn range_goes_to_bits_5_and_6_of_control_register_2() {
    for (range, bits) in [
        (Lis3mdlRange::Gauss4, 0x00),
        (Lis3mdlRange::Gauss8, 0x20),
        (Lis3mdlRange::Gauss12, 0x40),
        (Lis3mdlRange::Gauss16, 0x60),
    ] {
        let mut driver = Lis3mdl::new(registers(), Lis3mdlConfig { range, ..Lis3mdlConfig::default() });
        block_on(driver.init()).unwrap();
        assert_eq!(driver.chip.i2c_bus.values[0x21], bits);
    }
}

#[test]
fn a_chip_with_another_identity_is_not_configured() {
    let mut driver = Lis3mdl::new(registers(), Lis3mdlConfig::default());
    driver.chip.i2c_bus.values[0x0F] = 0x40;
    assert_eq!(block_on(driver.init()), Err(MagnetometerError::WrongIdentity(0x40)));
    assert_eq!(driver.chip.i2c_bus.values[0x20..0x25], [0; 5]);
}

#[test]
fn a_control_register_that_reads_back_differently_is_reported() {
    let mut driver = Lis3mdl::new(registers(), Lis3mdlConfig::default());
    driver.chip.i2c_bus.write_protected = vec![0x24];
    assert_eq!(block_on(driver.init()), Err(MagnetometerError::Configuration { written: 0x40, read: 0x00 }));
}

#[test]
fn every_configuration_bit_is_verified() {
    let mut driver = Lis3mdl::new(registers(), Lis3mdlConfig::default());
    block_on(assert_every_bit_is_verified(&mut driver, |driver| &mut driver.chip.i2c_bus, 0x20..0x25));
    driver.chip.i2c_bus.address = 0x1C;
    assert_eq!(block_on(driver.verify_configuration()), Err(MagnetometerError::Bus(ErrorKind::Other)));
}

#[test]
fn twelve_equal_readings_indicate_a_stuck_axis() {
    assert_eq!(Lis3mdl::new(registers(), Lis3mdlConfig::default()).equal_readings_until_stuck(), 12);
}

#[test]
fn the_configured_address_is_used() {
    let mut driver = Lis3mdl::new(registers(), Lis3mdlConfig { address: 0x1C, ..Lis3mdlConfig::default() });
    assert_eq!(block_on(driver.init()), Err(MagnetometerError::Bus(ErrorKind::Other)));
    driver.chip.i2c_bus.address = 0x1C;
    assert_eq!(block_on(driver.init()), Ok(Identity { model: MagnetometerModel::Lis3mdl, address: 0x1C }));
}

/// Reading the data releases axes frozen by block data update.
#[test]
fn init_reads_the_data_once() {
    let mut driver = Lis3mdl::new(registers(), Lis3mdlConfig::default());
    block_on(driver.init()).unwrap();
    assert!(driver.chip.i2c_bus.was_read[0x28..0x2E].iter().all(|&was_read| was_read));
}

/// Driver whose chip measures 0.5 gauss on x at +-4 gauss.
fn with_measurement(status: u8) -> Lis3mdl<SimulatedRegisters> {
    let mut driver = Lis3mdl::new(registers(), Lis3mdlConfig::default());
    driver.chip.i2c_bus.values[0x27] = status;
    driver.chip.i2c_bus.values[0x28..0x2A].copy_from_slice(&3421_i16.to_le_bytes());
    driver
}

#[test]
fn a_measurement_is_read_with_its_status() {
    for (status, overrun) in [(0x08, false), (0x0F, false), (0x88, true)] {
        let mut driver = with_measurement(status);
        let reading = block_on(driver.read_measurement()).unwrap();
        assert_eq!(
            reading,
            Reading { field: Field::from_ut(50.0, 0.0, 0.0), is_saturated: false, was_overwritten: overrun }
        );
    }
    assert_eq!(with_measurement(0).period_us(), 12_500, "80 Hz");
}

/// Status bits of single axes or overruns are no new measurement. Polls from 88 % of 12.5 ms for four periods.
#[test]
fn old_measurements_are_not_returned() {
    for status in [0x00, 0x07, 0xF7] {
        let mut simulation = Simulation::new();
        simulation.spawn(Level::Interrupt, "script", async move {
            let mut driver = with_measurement(status);
            driver.init().await.unwrap();
            assert_eq!(driver.read_measurement().await, Err(MagnetometerError::NoData));
            assert_eq!(Instant::now().as_micros(), 11_000 + 50_000);
        });
        simulation.run_for(1_000_000);
        assert_eq!(simulation.task_count(), 0);
    }
}

/// Data sheet table 3; 1 gauss is 100 uT.
#[test]
fn every_range_has_its_sensitivity_and_saturation_limits() {
    for (range, counts_per_gauss, gauss) in [
        (Lis3mdlRange::Gauss4, 6842, 4),
        (Lis3mdlRange::Gauss8, 3421, 8),
        (Lis3mdlRange::Gauss12, 2281, 12),
        (Lis3mdlRange::Gauss16, 1711, 16),
    ] {
        let [low, high] = i16::to_le_bytes(counts_per_gauss);
        let reading = decode_reading(0x08, [low, high, 0, 0, 0, 0], range);
        assert!((reading.field.ut.x - 100.0).abs() < 1e-4, "{range:?}: {}", reading.field.ut);
        for (counts, saturated) in [(gauss * counts_per_gauss, false), (gauss * counts_per_gauss + 1, true)] {
            for counts in [counts, -counts] {
                let [low, high] = counts.to_le_bytes();
                for axis in 0..3 {
                    let mut data = [0; 6];
                    data[2 * axis..2 * axis + 2].copy_from_slice(&[low, high]);
                    assert_eq!(
                        decode_reading(0x08, data, range).is_saturated,
                        saturated,
                        "{range:?} {counts} on {axis}"
                    );
                }
            }
        }
    }
}

/// 6842 counts per gauss at +-4 gauss (data sheet table 3).
#[test]
fn counts_become_microtesla_on_the_chips_axes() {
    let [x, y, z] = [6842_i16, -3421, 0].map(i16::to_le_bytes);
    let reading = decode_reading(0x08, [x[0], x[1], y[0], y[1], z[0], z[1]], Lis3mdlRange::Gauss4);
    assert_eq!(
        reading,
        Reading { field: Field::from_ut(100.0, -50.0, 0.0), is_saturated: false, was_overwritten: false }
    );
}

#[test]
fn either_end_of_the_range_is_saturation() {
    for (counts, saturated) in [(27_368, false), (27_369, true), (-27_369, true), (i16::MAX, true), (i16::MIN, true)] {
        let [low, high] = counts.to_le_bytes();
        let reading = decode_reading(DATA_AVAILABLE_BIT, [0, 0, 0, 0, low, high], Lis3mdlRange::Gauss4);
        assert_eq!(reading.is_saturated, saturated, "{counts}");
    }
}

#[test]
fn overrun_is_reported_by_the_status() {
    assert!(decode_reading(0x88, [0; 6], Lis3mdlRange::Gauss4).was_overwritten);
    assert!(!decode_reading(0x78, [0; 6], Lis3mdlRange::Gauss4).was_overwritten, "what tells of single axes");
}
