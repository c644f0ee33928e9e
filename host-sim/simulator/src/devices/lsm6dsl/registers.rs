//! Register file of the LSM6DSL.

use autoswing::inertial::GRAVITY_M_S2;
use log_analysis::numbers::f32_as_f64;
use nalgebra::Vector3;

use super::measurement_errors::InertialTruth;

const WHO_AM_I: u8 = 0x0F;
const CTRL1_XL: u8 = 0x10;
const CTRL2_G: u8 = 0x11;
const CTRL3_C: u8 = 0x12;
const CTRL5_C: u8 = 0x14;
const CTRL9_XL: u8 = 0x18;
const CTRL10_C: u8 = 0x19;
const STATUS_REG: u8 = 0x1E;
const OUT_TEMP_L: u8 = 0x20;
const OUTX_L_G: u8 = 0x22;
const OUTX_L_XL: u8 = 0x28;

/// Bits of `CTRL3_C`.
const SOFTWARE_RESET: u8 = 0x01;
const ADDRESS_INCREMENT: u8 = 0x04;

/// Flags of `STATUS_REG`: specific force, rates, temperature.
const DATA_READY_FLAGS: u8 = 0x07;

/// Sample rate of the highest data rate code, 10; each lower code halves it (section 4.1: 6.66 kHz to 12.5 Hz).
const HIGHEST_RATE_HZ: f64 = 6_664.0;
const HIGHEST_RATE_CODE: u8 = 10;

/// Ranges by the bits `FS_XL` and `FS_G`: g (table 52) and deg/s (table 55).
const FORCE_RANGES_G: [f64; 4] = [2.0, 16.0, 4.0, 8.0];
const RATE_RANGES_DEG_S: [f64; 4] = [250.0, 500.0, 1000.0, 2000.0];

/// Sensitivities in the smallest of these ranges (table 3): mg and mdps a count.
const MG_PER_COUNT_AT_2_G: f64 = 0.061;
const MDPS_PER_COUNT_AT_250_DEG_S: f64 = 8.75;

/// Changes by the self-test: middle of the limits of table 3, deg/s and g.
const SELF_TEST_DEG_S: f64 = 425.0;
const SELF_TEST_G: f64 = 0.9;

/// Registers and the address pointer.
pub(super) struct Lsm6dslRegisters {
    bytes: [u8; 0x80],
    pointer: u8,
}

impl Default for Lsm6dslRegisters {
    fn default() -> Self {
        let mut bytes = [0; 0x80];
        for (register, reset) in [(WHO_AM_I, 0x6A), (CTRL3_C, ADDRESS_INCREMENT), (CTRL9_XL, 0xE0)] {
            bytes[usize::from(register)] = reset;
        }
        Self { bytes, pointer: 0 }
    }
}

impl Lsm6dslRegisters {
    pub fn set_pointer(&mut self, address: u8) {
        self.pointer = address & 0x7F;
    }

    pub fn value(&self, register: u8) -> u8 {
        self.bytes[usize::from(register & 0x7F)]
    }

    pub fn flip_bits(&mut self, register: u8, bits: u8) {
        self.bytes[usize::from(register & 0x7F)] ^= bits;
    }

    /// Writes the register at the pointer; read-only and reserved registers ignore it.
    pub fn write_register(&mut self, value: u8) {
        let register = self.pointer;
        self.advance_pointer();
        match register {
            CTRL3_C if value & SOFTWARE_RESET != 0 => *self = Self::default(),
            CTRL1_XL..=CTRL10_C => self.bytes[usize::from(register)] = value,
            _ => {}
        }
    }

    /// Reads the register at the pointer. The highest byte of an output clears its flag.
    pub fn read_register(&mut self) -> u8 {
        let register = self.pointer;
        self.advance_pointer();
        let cleared = match register {
            0x21 => 0x04,
            0x27 => 0x02,
            0x2D => 0x01,
            _ => 0,
        };
        self.bytes[usize::from(STATUS_REG)] &= !cleared;
        self.value(register)
    }

    fn advance_pointer(&mut self) {
        if self.value(CTRL3_C) & ADDRESS_INCREMENT != 0 {
            self.pointer = (self.pointer + 1) & 0x7F;
        }
    }

    /// Period of the samples; `None` unless both sensors run at one rate.
    pub fn period_us(&self) -> Option<u64> {
        let [accelerometer, gyro] = [CTRL1_XL, CTRL2_G].map(|register| self.value(register) >> 4);
        let is_running = accelerometer == gyro && (1..=HIGHEST_RATE_CODE).contains(&gyro);
        is_running.then(|| (1e6 / HIGHEST_RATE_HZ * f64::from(1_u32 << (HIGHEST_RATE_CODE - gyro))).round() as u64)
    }

    /// Change of the outputs by the self-test, positive or negative.
    pub fn self_test_change(&self) -> InertialTruth {
        let bits = self.value(CTRL5_C);
        let sign = |bits: u8, negative: u8| match bits & 3 {
            1 => 1.0,
            bits if bits == negative => -1.0,
            _ => 0.0,
        };
        let all_axes = |change: f64| Vector3::repeat(change);
        InertialTruth {
            rates_rad_s: all_axes(sign(bits >> 2, 3) * SELF_TEST_DEG_S.to_radians()),
            specific_force_m_s2: all_axes(sign(bits, 2) * SELF_TEST_G * f32_as_f64(GRAVITY_M_S2)),
            temperature_c: 0.0,
        }
    }

    /// Stores a sample, quantised and clipped.
    pub fn set_measurement(&mut self, measured: &InertialTruth) {
        let range_of = |register: u8, ranges: &[f64; 4]| ranges[usize::from(self.value(register) >> 2 & 3)];
        let deg_s_per_count = MDPS_PER_COUNT_AT_250_DEG_S * 1e-3 * range_of(CTRL2_G, &RATE_RANGES_DEG_S) / 250.0;
        let g_per_count = MG_PER_COUNT_AT_2_G * 1e-3 * range_of(CTRL1_XL, &FORCE_RANGES_G) / 2.0;
        self.write_axes(OUTX_L_G, &measured.rates_rad_s, deg_s_per_count.to_radians());
        self.write_axes(OUTX_L_XL, &measured.specific_force_m_s2, g_per_count * f32_as_f64(GRAVITY_M_S2));
        // 256 counts a degree, zero at 25 deg (table 5).
        self.write_counts(OUT_TEMP_L, (measured.temperature_c - 25.0) * 256.0);
        self.set_data_ready();
    }

    pub fn set_data_ready(&mut self) {
        self.bytes[usize::from(STATUS_REG)] = DATA_READY_FLAGS;
    }

    fn write_axes(&mut self, first: u8, value: &Vector3<f64>, unit: f64) {
        for (register, component) in (first..).step_by(2).zip(value) {
            self.write_counts(register, component / unit);
        }
    }

    /// The cast saturates at the range.
    fn write_counts(&mut self, low_register: u8, counts: f64) {
        let low = usize::from(low_register);
        self.bytes[low..low + 2].copy_from_slice(&(counts.round() as i16).to_le_bytes());
    }
}
