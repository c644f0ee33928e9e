//! Register-level model of the ST LIS3MDL magnetometer, after data sheet DocID024204 and application note AN4602.
//!
//! Modelled: identity, reset values, power-down / single / continuous conversion, data rates including `FAST_ODR`, full
//! scales, operating modes (rate and noise), data-ready and overrun flags, block data update, byte order, self-test,
//! address auto-increment with its wrap from the last output register to the first, soft reset, temperature. Interrupt
//! registers only store values. Not modelled: interrupt generator, SPI, averaging during a conversion (a measurement is
//! the field at the end of its conversion).

mod registers;

use std::cell::RefCell;
use std::rc::Rc;

use autoswing::frames::{Field, Sensor};
use nalgebra::Vector3;
use testkit::clock;

use crate::devices::i2c::SimulatedI2cDevice;
use crate::devices::sensor::FieldSource;
use crate::random::{RandomStream, StreamPurpose};
use registers::{ConversionMode, FAST_RATE_HZ, Lis3mdlRegisters, MeasurementSettings};

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
            let counts =
                field_counts(&field, &self.registers.measurement_settings(), self.config.noise_scale, &mut self.noise);
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

/// Counts per gauss at full scale 4, 8, 12, 16 gauss (data sheet, table 2).
const COUNTS_PER_GAUSS: [f64; 4] = [6842.0, 3421.0, 2281.0, 1711.0];
const UT_PER_GAUSS: f64 = 100.0;
/// RMS noise of x and y, gauss, in ultra-high-performance mode at full scale 12 gauss (data sheet, table 2).
const NOISE_XY_GAUSS: f64 = 3.2e-3;
/// RMS noise of z, gauss, in the same mode (data sheet, table 2).
const NOISE_Z_GAUSS: f64 = 4.1e-3;

/// Self-test field, gauss: middle of the range specified in the data sheet, table 2.
const SELF_TEST_GAUSS: Vector3<f64> = Vector3::new(2.0, 2.0, 0.55);

struct CompletedConversion {
    /// Time of the conversion's end, microseconds.
    completed_at_us: u64,
    /// Whether earlier conversions completed since the previous access, and were not read.
    has_overrun: bool,
}

#[derive(Default)]
struct FieldConverter {
    next_completion_us: Option<u64>,
}

impl FieldConverter {
    /// Restarts conversion, as after a write to a control register.
    fn restart_conversion(&mut self, registers: &Lis3mdlRegisters, now_us: u64) {
        let settings = registers.measurement_settings();
        self.next_completion_us =
            (settings.conversion_mode != ConversionMode::PowerDown).then(|| now_us + period_us(&settings));
    }

    /// The last conversion completed by now, if any.
    fn take_completed(&mut self, registers: &mut Lis3mdlRegisters, now_us: u64) -> Option<CompletedConversion> {
        let first_us = self.next_completion_us.filter(|&next_completion_us| next_completion_us <= now_us)?;
        let settings = registers.measurement_settings();
        if settings.conversion_mode == ConversionMode::Single {
            registers.power_down();
            self.next_completion_us = None;
            return Some(CompletedConversion { completed_at_us: first_us, has_overrun: false });
        }
        let period_us = period_us(&settings);
        let further_conversions = (now_us - first_us) / period_us;
        let at_us = first_us + further_conversions * period_us;
        self.next_completion_us = Some(at_us + period_us);
        Some(CompletedConversion { completed_at_us: at_us, has_overrun: further_conversions > 0 })
    }
}

fn period_us(settings: &MeasurementSettings) -> u64 {
    (1e6 / settings.rate_hz).round() as u64
}

/// Field as the chip reports it: with noise, quantised, clamped to 16 bits.
fn field_counts(
    field: &Field<Sensor>,
    settings: &MeasurementSettings,
    noise_scale: f64,
    noise: &mut RandomStream,
) -> Vector3<i16> {
    let xy = NOISE_XY_GAUSS * noise_ratio(settings.averaging_xy);
    let z = NOISE_Z_GAUSS * noise_ratio(settings.averaging_z);
    let sigma = Vector3::new(xy, xy, z) * noise_scale;
    let added = if settings.has_self_test_field { SELF_TEST_GAUSS } else { Vector3::zeros() };
    let gauss = field.ut.cast::<f64>() / UT_PER_GAUSS + added + noise.normal_vector().component_mul(&sigma);
    // A float-to-integer cast saturates, as the chip's converter does.
    (gauss * COUNTS_PER_GAUSS[settings.full_scale]).map(|counts| counts.round() as i16)
}

/// Noise relative to ultra-high-performance mode, the only one in the data sheet. Other modes average in proportion to
/// their conversion time; noise falls with the square root of it.
fn noise_ratio(averaging: usize) -> f64 {
    (FAST_RATE_HZ[averaging] / FAST_RATE_HZ[3]).sqrt()
}

#[cfg(test)]
mod tests;
