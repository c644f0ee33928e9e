//! Unit tests of `rm3100`; `tests/promises/magnetometer.rs` has those with its faults.

use testkit::simulation::run_script;

use super::*;
use crate::chip::registers::{SimulatedRegisters, assert_every_bit_is_verified, assert_only_stuck_axes_are_detected};

/// A chip that has a measurement, and passes its self-test.
fn driver() -> Rm3100<SimulatedRegisters> {
    let mut registers = SimulatedRegisters::new(0, &[(0x36, 0x22), (0x34, 0x80), (0x33, 0xF0)]);
    registers.write_protected = vec![0x33];
    Rm3100::new(registers)
}

/// Manual: BIST 0x8F and POLL 0x70 test the oscillators; 00 C8 is a cycle count of 200, TMRC 0x95 75 Hz, CMM 0x79
/// three axes with data ready after all of them. Writing TMRC ends continuous mode.
#[test]
fn init_stops_tests_configures_and_starts_in_this_order() {
    run_script(async {
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

#[test]
fn every_bit_of_cycle_counts_and_rate_is_verified() {
    run_script(async {
        let mut driver = driver();
        assert_every_bit_is_verified(&mut driver, |driver| &mut driver.chip.spi_device, 0x04..0x0A).await;
        assert_every_bit_is_verified(&mut driver, |driver| &mut driver.chip.spi_device, 0x0B..0x0C).await;
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

/// Half the manual's noise of 15 nT.
#[test]
fn noise_at_rest_seldom_resembles_a_stuck_axis() {
    assert_only_stuck_axes_are_detected(&driver(), 0.5 * 0.015 * 75.0);
}
