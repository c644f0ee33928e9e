//! Register-level model of the PNI RM3100 magnetometer on an SPI bus, after PNI's manual 1017252 r03 ("manual").
//!
//! Modelled: reset values, identity, continuous and single measurements with their time, rates, cycle counts with gain
//! and noise, data ready by the selected condition, self-test, address increment, the accesses that end continuous
//! mode. The axes are measured one after the other, each as the field at the middle of its time. Not modelled: alarms,
//! I2C, the register that selects what clears data ready (its default is used).

mod registers;

use std::cell::RefCell;
use std::rc::Rc;

use autoswing::frames::{Field, Sensor};
use testkit::clock;

use self::registers::{Rm3100Registers, RunningMeasurement};
use crate::devices::sensor::FieldSource;
use crate::devices::spi::SimulatedSpiDevice;
use crate::random::{RandomStream, StreamPurpose};

/// RMS noise at cycle count 200, microtesla (manual, table 3-1).
const NOISE_UT: f64 = 0.015;

/// Fault of the chip, or of its wires.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Rm3100Fault {
    /// No chip drives the data line, which reads as this byte: 0xFF or 0x00.
    MissingChip(u8),
    /// Wrong revision number in `REVID`.
    WrongRevision(u8),
    /// An axis, 0 to 2, repeats its last measurement.
    StuckAxis(usize),
    /// The oscillator of an axis, 0 to 2, fails the self-test.
    BrokenOscillator(usize),
    /// Measurements never end.
    NeverReady,
}

/// Simulated chip. Each access first completes the measurements due since the previous access.
pub struct SimulatedRm3100 {
    registers: Rm3100Registers,
    field_source: FieldSource,
    noise: RandomStream,
    noise_scale: f64,
    /// Period of the continuous mode relative to the nominal one; one standard deviation is 0.07 (manual, section
    /// 5.2.1).
    period_scale: f64,
    fault: Option<Rm3100Fault>,
    /// Address of the register that the next byte reads or writes.
    pointer: u8,
}

impl SimulatedRm3100 {
    /// A chip after power-on; the seed draws its noise, which is `noise_scale` times that of the manual, as the period
    /// of its continuous mode is `period_scale` times the nominal one.
    #[must_use]
    pub fn new(seed: u64, noise_scale: f64, period_scale: f64, field_source: FieldSource) -> Rc<RefCell<Self>> {
        Rc::new(RefCell::new(Self {
            registers: Rm3100Registers::default(),
            field_source,
            noise: RandomStream::new(seed, StreamPurpose::Magnetometer),
            noise_scale,
            period_scale,
            fault: None,
            pointer: 0,
        }))
    }

    /// Sets or ends a fault.
    pub fn set_fault(&mut self, fault: Option<Rm3100Fault>) {
        self.fault = fault;
    }

    /// Fault: a supply drop resets all registers, which ends continuous mode.
    pub fn power_cycle(&mut self) {
        self.registers = Rm3100Registers::default();
    }

    /// Fault: bits of a register flip.
    pub fn flip_register_bits(&mut self, register: u8, bits: u8) {
        self.registers.flip_register_bits(register, bits);
    }

    /// Value of a register, without the effects of an access.
    #[must_use]
    pub fn peek_register(&self, register: u8) -> u8 {
        self.registers.register_value(register)
    }

    fn is_missing(&self) -> bool {
        matches!(self.fault, Some(Rm3100Fault::MissingChip(_)))
    }

    fn complete_due_measurements(&mut self) {
        let now_us = clock::now_us();
        if self.fault == Some(Rm3100Fault::NeverReady) {
            return;
        }
        if let Some(ended) = self.registers.take_ended_measurement(now_us, self.period_scale) {
            match ended {
                RunningMeasurement::SelfTest { .. } => self.end_self_test(),
                RunningMeasurement::Field { ends_at_us, .. } => self.finish_measurement(ends_at_us),
            }
            self.registers.set_data_ready();
        }
    }

    fn end_self_test(&mut self) {
        for axis in 0..3 {
            self.registers.set_self_test_passed(axis, self.fault != Some(Rm3100Fault::BrokenOscillator(axis)));
        }
    }

    fn finish_measurement(&mut self, ended_at_us: u64) {
        for axis in 0..3 {
            let cycle_count = self.registers.cycle_count(axis);
            let after_us: u64 = (axis + 1..3).map(|later| self.registers.axis_duration_us(later)).sum();
            let middle_us = ended_at_us.saturating_sub(after_us + self.registers.axis_duration_us(axis) / 2);
            let field: Field<Sensor> = (self.field_source)(middle_us);
            let sigma_ut = NOISE_UT * (200.0 / f64::from(cycle_count.max(1))).sqrt() * self.noise_scale;
            let ut = f64::from(field.ut[axis]) + sigma_ut * self.noise.gaussian();
            if self.fault != Some(Rm3100Fault::StuckAxis(axis)) {
                self.registers.set_measurement(axis, (ut * counts_per_ut(cycle_count)).round() as i32);
            }
        }
    }
}

/// Gain, through the 20, 38 and 75 counts per microtesla of the manual's table 3-1 at cycle counts 50, 100 and 200.
fn counts_per_ut(cycle_count: u16) -> f64 {
    1.0 + 0.37 * f64::from(cycle_count)
}

impl SimulatedSpiDevice for SimulatedRm3100 {
    fn write_bytes(&mut self, bytes: &[u8]) {
        if self.is_missing() {
            return;
        }
        self.complete_due_measurements();
        let Some((&address, values)) = bytes.split_first() else { return };
        self.pointer = address & !registers::READ_FLAG;
        for &value in values {
            self.registers.write_register(self.pointer, value, clock::now_us(), self.period_scale);
            self.pointer = self.pointer.wrapping_add(1);
        }
    }

    fn read_bytes(&mut self, bytes: &mut [u8]) {
        if let Some(Rm3100Fault::MissingChip(idle_byte)) = self.fault {
            bytes.fill(idle_byte);
            return;
        }
        self.complete_due_measurements();
        for byte in bytes {
            *byte = match (self.pointer, self.fault) {
                (registers::REVID_REGISTER, Some(Rm3100Fault::WrongRevision(other))) => other,
                (register, _) => self.registers.read_register(register),
            };
            self.pointer = self.pointer.wrapping_add(1);
        }
    }
}

#[cfg(test)]
mod tests;
