//! Register file of the LIS3MDL.

use nalgebra::Vector3;

pub(super) mod address {
    pub const WHO_AM_I: u8 = 0x0F;
    pub const CTRL_REG1: u8 = 0x20;
    pub const CTRL_REG2: u8 = 0x21;
    pub const CTRL_REG3: u8 = 0x22;
    pub const CTRL_REG4: u8 = 0x23;
    pub const CTRL_REG5: u8 = 0x24;
    pub const STATUS_REG: u8 = 0x27;
    pub const OUT_X_L: u8 = 0x28;
    pub const OUT_Z_H: u8 = 0x2D;
    pub const INT_CFG: u8 = 0x30;
    pub const INT_THS_L: u8 = 0x32;
    pub const INT_THS_H: u8 = 0x33;
}
use address::{
    CTRL_REG1, CTRL_REG2, CTRL_REG3, CTRL_REG4, CTRL_REG5, INT_CFG, INT_THS_H, INT_THS_L, OUT_X_L, OUT_Z_H, STATUS_REG,
    WHO_AM_I,
};

const REGISTER_COUNT: usize = 0x40;
const ADDRESS_MASK: u8 = 0x3F;
const AUTO_INCREMENT: u8 = 0x80;
const SOFT_RESET_OR_REBOOT: u8 = 0x0C;
const POWER_DOWN: u8 = 0x03;
const BLOCK_DATA_UPDATE: u8 = 0x40;
const SELF_TEST_ENABLE: u8 = 0x01;
const BIG_ENDIAN: u8 = 0x02;
const ALL_AXES: u8 = 0x07;
const COMBINED_AXES_FLAG: u8 = 0x08;

#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct MeasurementSettings {
    pub conversion_mode: ConversionMode,
    /// Averaging of x and y, 0 (low power) to 3 (ultra-high performance).
    pub averaging_xy: usize,
    /// Averaging of z, 0 to 3.
    pub averaging_z: usize,
    /// Index of the full scale: 4, 8, 12, 16 gauss.
    pub full_scale: usize,
    /// Measurement rate, Hz.
    pub rate_hz: f64,
    /// Whether the self-test field is added.
    pub has_self_test_field: bool,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum ConversionMode {
    Continuous,
    Single,
    PowerDown,
}

/// Measurements per second with `FAST_ODR`, by averaging of x and y.
pub(super) const FAST_RATE_HZ: [f64; 4] = [1000.0, 560.0, 300.0, 155.0];

/// Registers, address pointer, and measurements delayed by block data update.
pub(super) struct Lis3mdlRegisters {
    bytes: [u8; REGISTER_COUNT],
    pointer: u8,
    is_auto_incrementing: bool,
    /// Bit mask of axes whose low byte was read and high byte was not.
    half_read_axes: u8,
    /// Last measurement in counts; block data update delays it for half-read axes.
    latest_counts: Vector3<i16>,
}

impl Default for Lis3mdlRegisters {
    fn default() -> Self {
        let mut bytes = [0; REGISTER_COUNT];
        for (register, reset) in [(WHO_AM_I, 0x3D), (CTRL_REG1, 0x10), (CTRL_REG3, POWER_DOWN), (INT_CFG, 0xE8)] {
            bytes[usize::from(register)] = reset;
        }
        Self { bytes, pointer: 0, is_auto_incrementing: false, half_read_axes: 0, latest_counts: Vector3::zeros() }
    }
}

impl Lis3mdlRegisters {
    /// Sets address and auto-increment from the first byte of a write.
    pub fn set_pointer(&mut self, sub_address: u8) {
        self.pointer = sub_address & ADDRESS_MASK;
        self.is_auto_incrementing = sub_address & AUTO_INCREMENT != 0;
    }

    /// Writes the register at the pointer; returns true if the measurement settings may have changed.
    pub fn write_register(&mut self, value: u8) -> bool {
        let register = self.pointer;
        self.advance_pointer();
        match register {
            CTRL_REG2 if value & SOFT_RESET_OR_REBOOT != 0 => *self = Self::default(),
            CTRL_REG1..=CTRL_REG5 | INT_CFG | INT_THS_L | INT_THS_H => self.bytes[usize::from(register)] = value,
            // Writes to read-only and reserved registers have no effect.
            _ => return false,
        }
        matches!(register, CTRL_REG1..=CTRL_REG3)
    }

    /// Reads the register at the pointer.
    pub fn read_register(&mut self) -> u8 {
        let register = self.pointer;
        self.advance_pointer();
        let value = self.bytes[usize::from(register)];
        if (OUT_X_L..=OUT_Z_H).contains(&register) {
            self.lock_axis_while_read(register - OUT_X_L);
        }
        value
    }

    /// The last output register wraps to the first; temperature is not part of a burst (confirmed by ST, missing in the
    /// data sheet).
    fn advance_pointer(&mut self) {
        if self.is_auto_incrementing {
            self.pointer = if self.pointer == OUT_Z_H { OUT_X_L } else { (self.pointer + 1) & ADDRESS_MASK };
        }
    }

    /// Reading a low byte locks the axis until its high byte is read, which clears the axis's flags.
    fn lock_axis_while_read(&mut self, offset: u8) {
        let axis = offset / 2;
        let bit = 1 << axis;
        if offset.is_multiple_of(2) {
            self.half_read_axes |= bit;
        } else {
            self.half_read_axes &= !bit;
            let ready = self.status_register() & ALL_AXES & !bit;
            let overrun = (self.status_register() >> 4) & ALL_AXES & !bit;
            self.set_status(ready, overrun);
            self.update_output_registers(usize::from(axis));
        }
    }

    /// Stores a new measurement, counts.
    pub fn set_measurement(&mut self, counts: Vector3<i16>) {
        self.latest_counts = counts;
        for axis in 0..3 {
            self.update_output_registers(axis);
        }
    }

    /// Sets the data-ready flags and the overrun flags of unread axes; of all axes if a conversion was not read
    /// (`has_overrun`).
    pub fn set_data_ready(&mut self, has_overrun: bool) {
        let unread = if has_overrun { ALL_AXES } else { self.status_register() & ALL_AXES };
        let overrun = (self.status_register() >> 4) & ALL_AXES;
        self.set_status(ALL_AXES, overrun | unread);
    }

    /// Ends a single conversion.
    pub fn power_down(&mut self) {
        self.bytes[usize::from(CTRL_REG3)] |= POWER_DOWN;
    }

    /// Decoded measurement settings.
    pub fn measurement_settings(&self) -> MeasurementSettings {
        let control1 = self.register_value(CTRL_REG1);
        let averaging_xy = usize::from(control1 >> 5 & 3);
        let fast = control1 & 0x02 != 0;
        MeasurementSettings {
            conversion_mode: match self.register_value(CTRL_REG3) & 3 {
                0 => ConversionMode::Continuous,
                1 => ConversionMode::Single,
                _ => ConversionMode::PowerDown,
            },
            averaging_xy,
            averaging_z: usize::from(self.register_value(CTRL_REG4) >> 2 & 3),
            full_scale: usize::from(self.register_value(CTRL_REG2) >> 5 & 3),
            rate_hz: if fast { FAST_RATE_HZ[averaging_xy] } else { 0.625 * f64::from(1 << (control1 >> 2 & 7)) },
            has_self_test_field: control1 & SELF_TEST_ENABLE != 0,
        }
    }

    /// Copies the latest measurement of an axis to its output registers unless block data update locks them.
    fn update_output_registers(&mut self, axis: usize) {
        let is_locked =
            self.register_value(CTRL_REG5) & BLOCK_DATA_UPDATE != 0 && self.half_read_axes & (1 << axis) != 0;
        if !is_locked {
            let counts = self.latest_counts[axis];
            let swapped = self.register_value(CTRL_REG4) & BIG_ENDIAN != 0;
            let low = usize::from(OUT_X_L) + 2 * axis;
            self.bytes[low..low + 2].copy_from_slice(&if swapped {
                counts.to_be_bytes()
            } else {
                counts.to_le_bytes()
            });
        }
    }

    fn register_value(&self, register: u8) -> u8 {
        self.bytes[usize::from(register)]
    }

    fn status_register(&self) -> u8 {
        self.register_value(STATUS_REG)
    }

    /// ZYXDA is set if all axes have new data, ZYXOR if any axis was overrun.
    fn set_status(&mut self, ready: u8, overrun: u8) {
        let all_ready = if ready == ALL_AXES { COMBINED_AXES_FLAG } else { 0 };
        let any_overrun = if overrun == 0 { 0 } else { COMBINED_AXES_FLAG };
        self.bytes[usize::from(STATUS_REG)] = (overrun | any_overrun) << 4 | ready | all_ready;
    }
}
