//! Conversion timing, noise and quantisation of the LIS3MDL.

use autoswing::frames::{Field, Sensor};
use nalgebra::Vector3;

use super::registers::{ConversionMode, FAST_RATE_HZ, Lis3mdlRegisters, MeasurementSettings};
use crate::random::RandomStream;

/// Counts per gauss at full scale 4, 8, 12, 16 gauss (data sheet, table 2).
const COUNTS_PER_GAUSS: [f64; 4] = [6842.0, 3421.0, 2281.0, 1711.0];
const UT_PER_GAUSS: f64 = 100.0;
/// RMS noise of x and y, gauss, in ultra-high-performance mode at full scale 12 gauss (data sheet, table 2).
const NOISE_XY_GAUSS: f64 = 3.2e-3;
/// RMS noise of z, gauss, in the same mode (data sheet, table 2).
const NOISE_Z_GAUSS: f64 = 4.1e-3;

/// Self-test field, gauss: middle of the range specified in the data sheet, table 2.
const SELF_TEST_GAUSS: Vector3<f64> = Vector3::new(2.0, 2.0, 0.55);

pub(super) struct CompletedConversion {
    /// Time of the conversion's end, microseconds.
    pub completed_at_us: u64,
    /// Whether earlier conversions completed since the previous access, and were not read.
    pub has_overrun: bool,
}

#[derive(Default)]
pub(super) struct FieldConverter {
    next_completion_us: Option<u64>,
}

impl FieldConverter {
    /// Restarts conversion, as after a write to a control register.
    pub fn restart_conversion(&mut self, registers: &Lis3mdlRegisters, now_us: u64) {
        let settings = registers.measurement_settings();
        self.next_completion_us =
            (settings.conversion_mode != ConversionMode::PowerDown).then(|| now_us + period_us(&settings));
    }

    /// The last conversion completed by now, if any.
    pub fn take_completed(&mut self, registers: &mut Lis3mdlRegisters, now_us: u64) -> Option<CompletedConversion> {
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
pub(super) fn field_counts(
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
