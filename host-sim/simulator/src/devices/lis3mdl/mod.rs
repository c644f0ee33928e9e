//! Register-level model of the ST LIS3MDL magnetometer, after data sheet DocID024204 and application note AN4602.
//!
//! Modelled: identity, reset values, power-down / single / continuous conversion, data rates including `FAST_ODR`, full
//! scales, operating modes (rate and noise), data-ready and overrun flags, block data update, byte order, self-test,
//! address auto-increment with its wrap from the last output register to the first, soft reset, temperature. Interrupt
//! registers only store values. Not modelled: interrupt generator, SPI, averaging during a conversion (a measurement is
//! the field at the end of its conversion).

mod conversion;
mod registers;

use std::cell::RefCell;
use std::rc::Rc;

use testkit::clock;

use self::conversion::{CompletedConversion, FieldConverter};
use self::registers::Lis3mdlRegisters;
use crate::devices::i2c::SimulatedI2cDevice;
use crate::devices::sensor::FieldSource;
use crate::random::{RandomStream, StreamPurpose};

/// Address with the SA1 pin high, as on ST's boards.
const ADDRESS: u8 = 0x1E;

/// Settings of a chip.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SimulatedLis3mdlConfig {
    /// Seed of the noise.
    pub seed: u64,
    /// Noise relative to the data sheet; 0 leaves only quantisation.
    pub noise_scale: f64,
}

impl Default for SimulatedLis3mdlConfig {
    fn default() -> Self {
        Self { seed: 0, noise_scale: 1.0 }
    }
}

/// Simulated chip for a [`SimulatedI2cBus`](crate::devices::i2c::SimulatedI2cBus). Each access first performs the
/// conversions due since the previous access.
pub struct SimulatedLis3mdl {
    config: SimulatedLis3mdlConfig,
    registers: Lis3mdlRegisters,
    converter: FieldConverter,
    field_source: FieldSource,
    noise: RandomStream,
    is_silent: bool,
    is_frozen: bool,
}

impl SimulatedLis3mdl {
    /// A chip after power-on.
    #[must_use]
    pub fn new(config: SimulatedLis3mdlConfig, field_source: FieldSource) -> Rc<RefCell<Self>> {
        Rc::new(RefCell::new(Self {
            config,
            registers: Lis3mdlRegisters::default(),
            converter: FieldConverter::default(),
            field_source,
            noise: RandomStream::new(config.seed, StreamPurpose::Magnetometer),
            is_silent: false,
            is_frozen: false,
        }))
    }

    /// Fault: the chip does not acknowledge while `is_silent`.
    pub fn set_silent(&mut self, is_silent: bool) {
        self.is_silent = is_silent;
    }

    /// Fault: while `is_frozen`, data-ready flags are set but values do not change.
    pub fn set_frozen(&mut self, is_frozen: bool) {
        self.is_frozen = is_frozen;
    }

    /// Fault: a supply drop resets all registers.
    pub fn power_cycle(&mut self) {
        self.registers = Lis3mdlRegisters::default();
        self.converter = FieldConverter::default();
    }

    fn perform_due_conversions(&mut self) {
        if let Some(due) = self.converter.take_completed(&mut self.registers, clock::now_us()) {
            self.finish_conversion(&due);
        }
    }

    fn finish_conversion(&mut self, due: &CompletedConversion) {
        if !self.is_frozen {
            let field = (self.field_source)(due.completed_at_us);
            let counts = conversion::field_counts(
                &field,
                &self.registers.measurement_settings(),
                self.config.noise_scale,
                &mut self.noise,
            );
            self.registers.set_measurement(counts);
        }
        self.registers.set_data_ready(due.has_overrun);
    }
}

impl SimulatedI2cDevice for SimulatedLis3mdl {
    fn acknowledges_address(&self, address: u8) -> bool {
        !self.is_silent && address == ADDRESS
    }

    fn write_bytes(&mut self, bytes: &[u8]) {
        self.perform_due_conversions();
        if let Some((&pointer, data)) = bytes.split_first() {
            self.registers.set_pointer(pointer);
            for &byte in data {
                if self.registers.write_register(byte) {
                    self.converter.restart_conversion(&self.registers, clock::now_us());
                }
            }
        }
    }

    fn read_bytes(&mut self, bytes: &mut [u8]) {
        self.perform_due_conversions();
        bytes.fill_with(|| self.registers.read_register());
    }
}

#[cfg(test)]
mod tests;
