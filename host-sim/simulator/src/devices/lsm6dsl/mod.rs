//! Register-level model of the ST LSM6DSL inertial sensor, after data sheet DocID028475 rev. 7 and application note
//! AN5040.
//!
//! Modelled: identity, reset values, data rates, ranges, data-ready flags, address increment, self-test, software reset,
//! temperature. A sample is rate and specific force at its instant: vibration above half of the rate is aliased. Not
//! modelled: FIFO, interrupt pins, filters, low-power modes, embedded functions, block data update, which transfers of
//! all outputs do not need here.

mod measurement_errors;
mod registers;

use std::cell::RefCell;
use std::rc::Rc;

use testkit::clock;

use crate::devices::i2c::SimulatedI2cDevice;
pub use measurement_errors::{InertialFault, InertialSource, InertialTruth, MeasurementErrors};
use registers::Lsm6dslRegisters;

/// 7-bit address with pin SDO/SA0 low, as on ST's boards.
pub const ADDRESS: u8 = 0x6A;

/// Simulated chip for a [`SimulatedI2cBus`](crate::devices::i2c::SimulatedI2cBus). Each access first takes the sample
/// that is due since the previous access.
pub struct SimulatedLsm6dsl {
    registers: Lsm6dslRegisters,
    errors: MeasurementErrors,
    source: InertialSource,
    /// End of the next sample, microseconds; `None` while powered down.
    next_sample_us: Option<u64>,
    faults: Vec<Box<dyn InertialFault>>,
    is_silent: bool,
    is_frozen: bool,
    has_failed_sensor: bool,
}

impl SimulatedLsm6dsl {
    /// A chip after power-on; the seed draws its errors, which are `error_scale` times those of the data sheet.
    #[must_use]
    pub fn new(seed: u64, error_scale: f64, source: InertialSource) -> Rc<RefCell<Self>> {
        Rc::new(RefCell::new(Self {
            registers: Lsm6dslRegisters::default(),
            errors: MeasurementErrors::new(seed, error_scale),
            source,
            next_sample_us: None,
            faults: Vec::new(),
            is_silent: false,
            is_frozen: false,
            has_failed_sensor: false,
        }))
    }

    /// Adds faults.
    pub fn set_faults(&mut self, faults: Vec<Box<dyn InertialFault>>) {
        self.faults = faults;
    }

    /// Fault: the chip does not acknowledge while `is_silent`.
    pub fn set_silent(&mut self, is_silent: bool) {
        self.is_silent = is_silent;
    }

    /// Fault: while `is_frozen`, data-ready flags are set but values do not change.
    pub fn set_frozen(&mut self, is_frozen: bool) {
        self.is_frozen = is_frozen;
    }

    /// Fault: the self-test's forces do not move the gyro's x axis.
    pub fn set_failed_sensor(&mut self, has_failed_sensor: bool) {
        self.has_failed_sensor = has_failed_sensor;
    }

    /// Fault: a supply drop resets all registers.
    pub fn power_cycle(&mut self) {
        self.registers = Lsm6dslRegisters::default();
        self.next_sample_us = None;
    }

    /// Fault: bits of a register flip.
    pub fn flip_register_bits(&mut self, register: u8, bits: u8) {
        self.registers.flip_bits(register, bits);
    }

    /// Value of a register.
    #[must_use]
    pub fn register_value(&self, register: u8) -> u8 {
        self.registers.value(register)
    }

    /// Takes the last sample that is due by now; earlier ones are overwritten unread.
    fn take_due_sample(&mut self) {
        let Some(period_us) = self.registers.period_us() else {
            self.next_sample_us = None;
            return;
        };
        let now_us = clock::now_us();
        let next_us = *self.next_sample_us.get_or_insert(now_us + period_us);
        if next_us > now_us {
            return;
        }
        let sampled_us = now_us - (now_us - next_us) % period_us;
        self.next_sample_us = Some(sampled_us + period_us);
        if self.is_frozen {
            self.registers.set_data_ready();
            return;
        }
        let mut measured = self.errors.measure(&(self.source)(sampled_us), 1e6 / period_us as f64);
        for fault in &mut self.faults {
            fault.modify_measurement(sampled_us, &mut measured);
            if let Some((register, bits)) = fault.register_upset(now_us) {
                self.registers.flip_bits(register, bits);
            }
        }
        let self_test = self.registers.self_test_change();
        measured.rates_rad_s += self_test.rates_rad_s;
        measured.specific_force_m_s2 += self_test.specific_force_m_s2;
        if self.has_failed_sensor {
            measured.rates_rad_s.x -= self_test.rates_rad_s.x;
        }
        self.registers.set_measurement(&measured);
    }
}

impl SimulatedI2cDevice for SimulatedLsm6dsl {
    fn acknowledges_address(&self, address: u8) -> bool {
        let is_silent = self.is_silent || self.faults.iter().any(|fault| fault.is_silent(clock::now_us()));
        !is_silent && address == ADDRESS
    }

    fn write_bytes(&mut self, bytes: &[u8]) {
        self.take_due_sample();
        if let Some((&pointer, data)) = bytes.split_first() {
            self.registers.set_pointer(pointer);
            for &byte in data {
                self.registers.write_register(byte);
            }
        }
        self.take_due_sample();
    }

    fn read_bytes(&mut self, bytes: &mut [u8]) {
        self.take_due_sample();
        bytes.fill_with(|| self.registers.read_register());
    }
}

#[cfg(test)]
mod tests;
