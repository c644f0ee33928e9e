//! Unit tests of `lis3mdl`.

use embassy_futures::block_on;
use embedded_hal_async::i2c::ErrorKind;
use testkit::simulation::run_script;

use super::*;
use crate::chip::registers::{SimulatedRegisters, assert_every_bit_is_verified, assert_only_stuck_axes_are_detected};

fn driver_with_config(config: Lis3mdlConfig) -> Lis3mdl<SimulatedRegisters> {
    Lis3mdl::new(SimulatedRegisters::new(AUTO_INCREMENT, &[(WHO_AM_I, WHO_AM_I_VALUE)]), config)
}

fn driver() -> Lis3mdl<SimulatedRegisters> {
    driver_with_config(Lis3mdlConfig::default())
}

/// Reading the data releases axes frozen by block data update.
#[test]
fn init_writes_the_configuration_of_the_data_sheet_and_reads_the_data() {
    let mut driver = driver();
    let identity = block_on(driver.init());
    assert_eq!(identity, Ok(Identity { model: MagnetometerModel::Lis3mdl, address: 0x1E }));
    // UHP 80 Hz, 4 gauss, continuous, UHP, BDU: data sheet sections 7.3 to 7.7.
    assert_eq!(driver.chip.i2c_bus.values[0x20..0x25], [0x7C, 0x00, 0x00, 0x0C, 0x40]);
    assert!(driver.chip.i2c_bus.was_read[0x28..0x2E].iter().all(|&was_read| was_read));
}

#[test]
fn a_chip_with_another_identity_is_not_configured() {
    let mut driver = driver();
    driver.chip.i2c_bus.values[0x0F] = 0x40;
    assert_eq!(block_on(driver.init()), Err(ChipError::WrongIdentity(0x40)));
    assert_eq!(driver.chip.i2c_bus.values[0x20..0x25], [0; 5]);
}

#[test]
fn a_control_register_that_reads_back_differently_is_reported() {
    let mut driver = driver();
    driver.chip.i2c_bus.write_protected = vec![0x24];
    assert_eq!(block_on(driver.init()), Err(ChipError::Configuration { written: 0x40, read: 0x00 }));
}

#[test]
fn every_configuration_bit_is_verified() {
    let mut driver = driver();
    block_on(assert_every_bit_is_verified(&mut driver, |driver| &mut driver.chip.i2c_bus, 0x20..0x25));
    driver.chip.i2c_bus.address = 0x1C;
    assert_eq!(block_on(driver.verify_configuration()), Err(ChipError::Bus(ErrorKind::Other)));
}

/// Half the data sheet's noise of 3.2 mgauss, 22 counts.
#[test]
fn noise_at_rest_seldom_resembles_a_stuck_axis() {
    assert_only_stuck_axes_are_detected(&driver(), 11.0);
}

#[test]
fn the_configured_address_is_used() {
    let mut driver = driver_with_config(Lis3mdlConfig { address: 0x1C, ..Lis3mdlConfig::default() });
    assert_eq!(block_on(driver.init()), Err(ChipError::Bus(ErrorKind::Other)));
    driver.chip.i2c_bus.address = 0x1C;
    assert_eq!(block_on(driver.init()), Ok(Identity { model: MagnetometerModel::Lis3mdl, address: 0x1C }));
}

/// Driver whose chip measures 0.5 gauss on x at +-4 gauss.
fn with_measurement(status: u8) -> Lis3mdl<SimulatedRegisters> {
    let mut driver = driver();
    driver.chip.i2c_bus.values[0x27] = status;
    driver.chip.i2c_bus.values[0x28..0x2A].copy_from_slice(&3421_i16.to_le_bytes());
    driver
}

#[test]
fn a_measurement_is_read_with_its_status() {
    for (status, overrun) in [(0x08, false), (0x0F, false), (0x78, false), (0x88, true)] {
        let mut driver = with_measurement(status);
        let reading = block_on(driver.read_measurement()).unwrap();
        assert_eq!(
            reading,
            Reading { field: Field::from_ut(50.0, 0.0, 0.0), is_saturated: false, was_overwritten: overrun }
        );
    }
    assert_eq!(with_measurement(0).period_us(), 12_500, "80 Hz");
}

/// Status bits of single axes or overruns are no new measurement.
#[test]
fn old_measurements_are_not_returned() {
    for status in [0x00, 0x07, 0xF7] {
        run_script(async move {
            assert_eq!(with_measurement(status).read_measurement().await, Err(ChipError::NoData));
        });
    }
}

/// Data sheet table 3, and bits 5 and 6 of control register 2; 1 gauss is 100 uT.
#[test]
fn every_range_has_its_register_bits_sensitivity_and_limits() {
    for (range, bits, counts_per_gauss, gauss) in [
        (Lis3mdlRange::Gauss4, 0x00, 6842_i16, 4),
        (Lis3mdlRange::Gauss8, 0x20, 3421, 8),
        (Lis3mdlRange::Gauss12, 0x40, 2281, 12),
        (Lis3mdlRange::Gauss16, 0x60, 1711, 16),
    ] {
        let mut driver = driver_with_config(Lis3mdlConfig { range, ..Lis3mdlConfig::default() });
        block_on(driver.init()).unwrap();
        assert_eq!(driver.chip.i2c_bus.values[0x21], bits, "{range:?}");
        let decoded = |counts: [i16; 3]| {
            decode_reading(0x08, counts.map(i16::to_le_bytes).as_flattened().try_into().unwrap(), range)
        };
        let reading = decoded([counts_per_gauss, -counts_per_gauss, 0]);
        let expected = nalgebra::Vector3::new(100.0, -100.0, 0.0);
        assert!((reading.field.ut - expected).amax() < 1e-4, "{range:?}: {}", reading.field.ut);
        let full_scale = gauss * counts_per_gauss;
        for (counts, is_saturated) in [(full_scale, false), (full_scale + 1, true), (i16::MAX, true)] {
            for counts in [[counts, 0, 0], [0, counts, 0], [0, 0, counts], [0, 0, -counts]] {
                assert_eq!(decoded(counts).is_saturated, is_saturated, "{range:?} {counts:?}");
            }
        }
        assert!(decoded([i16::MIN, 0, 0]).is_saturated, "{range:?}");
    }
}
