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

/// Simulated chip for a [`SimulatedI2cBus`](crate::devices::i2c::SimulatedI2cBus). Each access first performs the
/// conversions due since the previous access.
pub struct SimulatedLis3mdl {
    registers: Lis3mdlRegisters,
    /// End of the running conversion, microseconds; `None` while powered down.
    next_completion_us: Option<u64>,
    field_source: FieldSource,
    noise: RandomStream,
    noise_scale: f64,
    is_silent: bool,
    is_frozen: bool,
}

impl SimulatedLis3mdl {
    /// A chip after power-on; the seed draws its noise, which is `noise_scale` times that of the data sheet.
    #[must_use]
    pub fn new(seed: u64, noise_scale: f64, field_source: FieldSource) -> Rc<RefCell<Self>> {
        Rc::new(RefCell::new(Self {
            registers: Lis3mdlRegisters::default(),
            next_completion_us: None,
            field_source,
            noise: RandomStream::new(seed, StreamPurpose::Magnetometer),
            noise_scale,
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
        self.next_completion_us = None;
    }

    /// Performs the last conversion that is due by now; earlier ones are overwritten unread.
    fn perform_due_conversions(&mut self) {
        let now_us = clock::now_us();
        let Some(first_us) = self.next_completion_us.filter(|&first_us| first_us <= now_us) else { return };
        let settings = self.registers.measurement_settings();
        let mut completed_us = first_us;
        if settings.conversion_mode == ConversionMode::Single {
            self.registers.power_down();
            self.next_completion_us = None;
        } else {
            let period_us = period_us(&settings);
            completed_us = now_us - (now_us - first_us) % period_us;
            self.next_completion_us = Some(completed_us + period_us);
        }
        if !self.is_frozen {
            let field = (self.field_source)(completed_us);
            self.registers.set_measurement(field_counts(&field, &settings, self.noise_scale, &mut self.noise));
        }
        self.registers.set_data_ready(completed_us > first_us);
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
                    let settings = self.registers.measurement_settings();
                    self.next_completion_us = (settings.conversion_mode != ConversionMode::PowerDown)
                        .then(|| clock::now_us() + period_us(&settings));
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
