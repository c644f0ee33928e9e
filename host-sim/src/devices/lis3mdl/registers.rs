//! The register file of the LIS3MDL.

use nalgebra::Vector3;

/// Addresses of registers that mean something to the model.
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
    pub const TEMP_OUT_L: u8 = 0x2E;
    pub const INT_CFG: u8 = 0x30;
    pub const INT_THS_L: u8 = 0x32;
    pub const INT_THS_H: u8 = 0x33;
}
use address::{
    CTRL_REG1, CTRL_REG2, CTRL_REG3, CTRL_REG4, CTRL_REG5, INT_CFG, INT_THS_H, INT_THS_L, OUT_X_L, OUT_Z_H, STATUS_REG,
    TEMP_OUT_L, WHO_AM_I,
};

const COUNT: usize = 0x40;
const ADDRESS_MASK: u8 = 0x3F;
const AUTO_INCREMENT: u8 = 0x80;
const TEMPERATURE_ENABLE: u8 = 0x80;
const SOFT_RESET_OR_REBOOT: u8 = 0x0C;
const POWER_DOWN: u8 = 0x03;
const BLOCK_DATA_UPDATE: u8 = 0x40;
const SELF_TEST: u8 = 0x01;
const BIG_ENDIAN: u8 = 0x02;
const ALL_AXES: u8 = 0x07;
const ANY_AXIS_FLAG: u8 = 0x08;

/// What the control registers ask for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Mode {
    pub conversion: Conversion,
    /// Averaging of x and y, 0 (low power) to 3 (ultra-high performance).
    pub averaging_xy: usize,
    /// Averaging of z, likewise.
    pub averaging_z: usize,
    /// Index of the full scale: 4, 8, 12, 16 gauss.
    pub full_scale: usize,
    /// Measurements per second.
    pub rate_hz: f64,
    /// A field of its own is added to what is measured.
    pub self_test: bool,
}

/// Bits MD1:0 of `CTRL_REG3`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Conversion {
    Continuous,
    Single,
    PowerDown,
}

/// Measurements per second with `FAST_ODR`, by averaging of x and y.
pub(super) const FAST_RATE_HZ: [f64; 4] = [1000.0, 560.0, 300.0, 155.0];

/// Registers, the address pointer of the bus interface, and measurements held back by block data update.
pub(super) struct Registers {
    bytes: [u8; COUNT],
    pointer: u8,
    auto_increment: bool,
    /// Axes of which the low byte has been read and the high byte has not.
    half_read: u8,
    /// The last measurement in counts; axes that are half read get it late.
    latest: Vector3<i16>,
}

impl Default for Registers {
    fn default() -> Self {
        let mut bytes = [0; COUNT];
        for (register, reset) in [(WHO_AM_I, 0x3D), (CTRL_REG1, 0x10), (CTRL_REG3, POWER_DOWN), (INT_CFG, 0xE8)] {
            bytes[usize::from(register)] = reset;
        }
        Self { bytes, pointer: 0, auto_increment: false, half_read: 0, latest: Vector3::zeros() }
    }
}

impl Registers {
    /// The first byte of a write: where the next access goes, and whether it moves on.
    pub fn point_to(&mut self, sub_address: u8) {
        self.pointer = sub_address & ADDRESS_MASK;
        self.auto_increment = sub_address & AUTO_INCREMENT != 0;
    }

    /// Writes the register at the pointer. True when the way of measuring may have changed.
    pub fn write(&mut self, value: u8) -> bool {
        let register = self.pointer;
        self.advance();
        match register {
            CTRL_REG2 if value & SOFT_RESET_OR_REBOOT != 0 => *self = Self::default(),
            CTRL_REG1..=CTRL_REG5 | INT_CFG | INT_THS_L | INT_THS_H => self.bytes[usize::from(register)] = value,
            // Everything else is read-only or reserved.
            _ => return false,
        }
        matches!(register, CTRL_REG1..=CTRL_REG3)
    }

    /// Reads the register at the pointer.
    pub fn read(&mut self) -> u8 {
        let register = self.pointer;
        self.advance();
        let value = self.bytes[usize::from(register)];
        if (OUT_X_L..=OUT_Z_H).contains(&register) {
            self.note_output_read(register - OUT_X_L);
        }
        value
    }

    /// After the last output register comes the first: temperature is not part of a burst (confirmed by ST for this
    /// chip, though the data sheet does not say so).
    fn advance(&mut self) {
        if self.auto_increment {
            self.pointer = if self.pointer == OUT_Z_H { OUT_X_L } else { (self.pointer + 1) & ADDRESS_MASK };
        }
    }

    /// Reading the low byte of an axis holds the pair until the high byte is read; that clears the axis's flags.
    fn note_output_read(&mut self, offset: u8) {
        let axis = offset / 2;
        let bit = 1 << axis;
        if offset.is_multiple_of(2) {
            self.half_read |= bit;
        } else {
            self.half_read &= !bit;
            let ready = self.status() & ALL_AXES & !bit;
            let overrun = (self.status() >> 4) & ALL_AXES & !bit;
            self.set_status(ready, overrun);
            self.show(usize::from(axis));
        }
    }

    /// A measurement is there, in counts.
    pub fn set_measurement(&mut self, counts: Vector3<i16>) {
        self.latest = counts;
        for axis in 0..3 {
            self.show(axis);
        }
    }

    /// Sets the data-ready flags, and the overrun flags of axes whose data were not read; when conversions were
    /// `missed` in between, those are all axes.
    pub fn announce(&mut self, missed: bool) {
        let unread = if missed { ALL_AXES } else { self.status() & ALL_AXES };
        let overrun = (self.status() >> 4) & ALL_AXES;
        self.set_status(ALL_AXES, overrun | unread);
    }

    /// Temperature: 8 counts a degree, 0 at 25 degrees Celsius.
    pub fn set_temperature_c(&mut self, temperature_c: f64) {
        if self.get(CTRL_REG1) & TEMPERATURE_ENABLE != 0 {
            let counts = ((temperature_c - 25.0) * 8.0).round() as i16;
            self.put_pair(TEMP_OUT_L, counts);
        }
    }

    /// A single conversion is finished.
    pub fn power_down(&mut self) {
        self.bytes[usize::from(CTRL_REG3)] |= POWER_DOWN;
    }

    /// What the control registers ask for.
    pub fn mode(&self) -> Mode {
        let control1 = self.get(CTRL_REG1);
        let averaging_xy = usize::from(control1 >> 5 & 3);
        let fast = control1 & 0x02 != 0;
        Mode {
            conversion: match self.get(CTRL_REG3) & 3 {
                0 => Conversion::Continuous,
                1 => Conversion::Single,
                _ => Conversion::PowerDown,
            },
            averaging_xy,
            averaging_z: usize::from(self.get(CTRL_REG4) >> 2 & 3),
            full_scale: usize::from(self.get(CTRL_REG2) >> 5 & 3),
            rate_hz: if fast { FAST_RATE_HZ[averaging_xy] } else { 0.625 * f64::from(1 << (control1 >> 2 & 7)) },
            self_test: control1 & SELF_TEST != 0,
        }
    }

    /// Puts the latest measurement of an axis where it can be read, unless block data update holds it back.
    fn show(&mut self, axis: usize) {
        let held = self.get(CTRL_REG5) & BLOCK_DATA_UPDATE != 0 && self.half_read & (1 << axis) != 0;
        if !held {
            self.put_pair(OUT_X_L + 2 * axis as u8, self.latest[axis]);
        }
    }

    fn get(&self, register: u8) -> u8 {
        self.bytes[usize::from(register)]
    }

    fn status(&self) -> u8 {
        self.get(STATUS_REG)
    }

    /// ZYXDA tells that all axes are new, ZYXOR that any was lost.
    fn set_status(&mut self, ready: u8, overrun: u8) {
        let all_ready = if ready == ALL_AXES { ANY_AXIS_FLAG } else { 0 };
        let any_overrun = if overrun == 0 { 0 } else { ANY_AXIS_FLAG };
        self.bytes[usize::from(STATUS_REG)] = (overrun | any_overrun) << 4 | ready | all_ready;
    }

    fn put_pair(&mut self, low: u8, value: i16) {
        let measured = (OUT_X_L..=OUT_Z_H).contains(&low);
        let swapped = measured && self.get(CTRL_REG4) & BIG_ENDIAN != 0;
        let low = usize::from(low);
        self.bytes[low..low + 2].copy_from_slice(&if swapped { value.to_be_bytes() } else { value.to_le_bytes() });
    }
}
