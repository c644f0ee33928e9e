//! Unit tests of `lsm6dsl` that need no measurement; those with one are in `the simulator, at its chip`.

use embassy_futures::block_on;

use super::*;
use crate::chip::registers::SimulatedRegisters;

fn driver() -> Lsm6dsl<SimulatedRegisters> {
    let mut registers = SimulatedRegisters::new(0, &[(WHO_AM_I, WHO_AM_I_VALUE)]);
    registers.address = 0x6A;
    Lsm6dsl::new(registers, 0x6A)
}

#[test]
fn a_chip_with_another_identity_is_not_configured() {
    let mut driver = driver();
    // An LSM6DSO.
    driver.chip.i2c_bus.values[usize::from(WHO_AM_I)] = 0x6C;
    assert_eq!(block_on(driver.init()), Err(ChipError::WrongIdentity(0x6C)));
    assert!(driver.chip.i2c_bus.write_log.is_empty());
}

#[test]
fn a_control_register_that_reads_back_differently_is_reported() {
    for (register, written) in (CTRL1_XL..).zip(CONTROL_REGISTERS).filter(|(_, written)| *written != 0) {
        let mut driver = driver();
        driver.chip.i2c_bus.write_protected = vec![register];
        assert_eq!(block_on(driver.init()), Err(ChipError::Configuration { written, read: 0 }));
    }
}

/// Table 3 and section 4.5 of the data sheet by hand: 1000 counts are 70 deg/s and 0.244 g.
#[test]
fn counts_are_decoded_with_the_sensitivities_of_the_data_sheet() {
    let counts: [i16; 7] = [-512, 1000, -1000, 0, 1000, 0, i16::MIN];
    let mut data = [0; 14];
    for (bytes, count) in data.chunks_mut(2).zip(counts) {
        bytes.copy_from_slice(&count.to_le_bytes());
    }
    let reading = decode_reading(data);
    let InertialSample { rates_rad_s, specific_force_m_s2 } = reading.sample;
    assert!((rates_rad_s - Vector3::new(70.0, -70.0, 0.0) * DEG).norm() < 1e-5, "{rates_rad_s}");
    assert!((specific_force_m_s2.x - 0.244 * 9.806_65).abs() < 1e-5, "{specific_force_m_s2}");
    assert!((reading.temperature_c - 23.0).abs() < 1e-5 && reading.is_saturated);
    data[13] = 0x81;
    assert!(!decode_reading(data).is_saturated);
}
