//! Unit tests of `lis3mdl`; `tests/promises/magnetometer.rs` has those of its measurements.

use embassy_futures::block_on;

use super::*;
use crate::chip::registers::{SimulatedRegisters, assert_every_bit_is_verified, assert_only_stuck_axes_are_detected};

fn driver() -> Lis3mdl<SimulatedRegisters> {
    Lis3mdl::new(SimulatedRegisters::new(AUTO_INCREMENT, &[(WHO_AM_I, WHO_AM_I_VALUE)]))
}

/// Reading the data releases axes frozen by block data update.
#[test]
fn init_writes_the_configuration_of_the_data_sheet_and_reads_the_data() {
    let mut driver = driver();
    driver.chip.i2c_bus.values[0x0F] = 0x40;
    assert_eq!(block_on(driver.init()), Err(ChipError::WrongIdentity(0x40)));
    assert_eq!(driver.chip.i2c_bus.values[0x20..0x25], [0; 5]);
    driver.chip.i2c_bus.values[0x0F] = 0x3D;
    assert_eq!(block_on(driver.init()), Ok(Identity { model: MagnetometerModel::Lis3mdl, address: 0x1E }));
    // UHP 80 Hz, 4 gauss, continuous, UHP, BDU: data sheet sections 7.3 to 7.7.
    assert_eq!(driver.chip.i2c_bus.values[0x20..0x25], [0x7C, 0x00, 0x00, 0x0C, 0x40]);
    assert!(driver.chip.i2c_bus.was_read[0x28..0x2E].iter().all(|&was_read| was_read));
}

#[test]
fn every_configuration_bit_is_verified() {
    block_on(assert_every_bit_is_verified(&mut driver(), |driver| &mut driver.chip.i2c_bus, 0x20..0x25));
}

/// Half the data sheet's noise of 3.2 mgauss, 22 counts.
#[test]
fn noise_at_rest_seldom_resembles_a_stuck_axis() {
    assert_only_stuck_axes_are_detected(&driver(), 11.0);
}

/// 1 gauss is 100 uT, and 6842 counts at +-4 gauss (data sheet table 3). Bits of the status beside bit 7 are no overrun.
#[test]
fn counts_have_the_sensitivity_and_limits_of_the_range() {
    let decoded = |status, counts: [i16; 3]| {
        decode_reading(status, counts.map(i16::to_le_bytes).as_flattened().try_into().unwrap())
    };
    let expected = nalgebra::Vector3::new(100.0, -100.0, 0.0);
    assert!((decoded(0x08, [6842, -6842, 0]).field.ut - expected).amax() < 1e-4);
    assert_eq!([0x08, 0x78, 0x88].map(|status| decoded(status, [0; 3]).was_overwritten), [false, false, true]);
    for (counts, is_saturated) in [(4 * 6842, false), (4 * 6842 + 1, true), (i16::MAX, true), (i16::MIN + 1, true)] {
        for counts in [[counts, 0, 0], [0, counts, 0], [0, 0, counts], [0, 0, -counts]] {
            assert_eq!(decoded(0x08, counts).is_saturated, is_saturated, "{counts:?}");
        }
    }
}
