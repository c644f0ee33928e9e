//! ST LSM6DSL (data sheet DocID028475 rev. 7, application note AN5040).
//!
//! Gyro and accelerometer at 208 Hz in high-performance mode, from one clock: bits of both are set together. A reading
//! of temperature, rates and specific force is one transfer of 17 bytes, 0.4 ms at 400 kHz.

use embassy_time::Timer;
use embedded_hal_async::i2c::I2c;
use nalgebra::Vector3;

use super::driver::{InertialReading, InertialSensor};
use crate::chip::{self, ChipError, I2cRegisters, MeasuringChip, PollingSchedule};
use autoswing::inertial::{GRAVITY_M_S2, InertialSample, InertialSensorErrors};
use autoswing::trig::DEG;

/// Measurement period at 208 Hz.
const PERIOD_US: u32 = 4_808;

const WHO_AM_I: u8 = 0x0F;
const WHO_AM_I_VALUE: u8 = 0x6A;
const CTRL1_XL: u8 = 0x10;
const CTRL3_C: u8 = 0x12;
const CTRL5_C: u8 = 0x14;
const STATUS_REG: u8 = 0x1E;
const OUT_TEMP_L: u8 = 0x20;

/// `STATUS_REG`: new rates and new specific force.
const DATA_AVAILABLE_BITS: u8 = 0x03;

/// `CTRL1_XL` to `CTRL10_C`. Ranges of 2000 deg/s and 8 g: faster and harder than any manoeuvre with its vibration. The
/// others are coarser than half of the noise in 67 Hz only in the accelerometer's 16 g.
const CONTROL_REGISTERS: [u8; 10] = [
    0b0101_1100, // 1: accelerometer at 208 Hz, 8 g
    0b0101_1100, // 2: gyro at 208 Hz, 2000 deg/s
    0b0100_0100, // 3: block data update, address increments
    0b0000_0000, // 4: not asleep
    0b0000_0000, // 5: no self-test
    0b0000_0000, // 6: accelerometer in high-performance mode
    0b0000_0000, // 7: gyro in high-performance mode, without high-pass filter
    0b0000_0000, // 8: accelerometer filtered at half of the rate
    0b1110_0000, // 9: reset value, for data enable stamps, which are not used
    0b0000_0000, // 10: no embedded functions
];

/// `CTRL5_C`: positive self-test of both sensors.
const SELF_TEST_ON: u8 = 0b0000_0101;

/// Rate of a count, rad/s: 70 mdps (table 3).
const RAD_S_PER_COUNT: f32 = 0.07 * DEG;

/// Specific force of a count, m/s^2: 0.244 mg (table 3).
const M_S2_PER_COUNT: f32 = 0.244e-3 * GRAVITY_M_S2;

/// Counts per degree Celsius, zero at 25 deg (table 5).
const COUNTS_PER_DEGREE: f32 = 256.0;

/// Time for which the outputs settle after a change of the self-test, milliseconds (AN5040, section on self-tests).
const SETTLING_MS: u64 = 100;

/// Measurements averaged before and during the self-test (AN5040).
const SELF_TEST_READINGS: u8 = 5;

/// Changes of the rates in the self-test, rad/s (table 3: 150 to 700 deg/s).
const SELF_TEST_RATES_RAD_S: core::ops::RangeInclusive<f32> = 150.0 * DEG..=700.0 * DEG;

/// Changes of the specific force in the self-test, m/s^2 (table 3: 90 to 1700 mg).
const SELF_TEST_FORCES_M_S2: core::ops::RangeInclusive<f32> = 0.09 * GRAVITY_M_S2..=1.7 * GRAVITY_M_S2;

/// LSM6DSL on an I2C bus.
#[derive(Debug)]
pub struct Lsm6dsl<B> {
    chip: I2cRegisters<B>,
    polling: PollingSchedule,
}

impl<B: I2c> Lsm6dsl<B> {
    /// Address with pin SDO/SA0 low; 0x6B with it high.
    pub const ADDRESS_SA0_LOW: u8 = 0x6A;

    /// Creates a driver; [`init`](MeasuringChip::init) is the first bus access.
    pub const fn new(bus: B, address: u8) -> Self {
        Self { chip: I2cRegisters::new(bus, address), polling: PollingSchedule::new(PERIOD_US, chip::SLEEP_PERCENT) }
    }

    async fn write_control_registers(&mut self) -> Result<(), ChipError<B::Error>> {
        let [c1, c2, c3, c4, c5, c6, c7, c8, c9, c10] = CONTROL_REGISTERS;
        // Without its increment bit, which an upset may have cleared, the longer transfer would write one register.
        self.chip.write_registers(&[CTRL3_C, c3]).await?;
        self.chip.write_registers(&[CTRL1_XL, c1, c2, c3, c4, c5, c6, c7, c8, c9, c10]).await
    }

    /// Measures with and without the self-test's forces. A turn of 150 deg/s between the two hides a fault, or looks like
    /// one, which the next `init` finds.
    async fn test_sensors(&mut self) -> Result<(), ChipError<B::Error>> {
        let without = self.settled_mean().await?;
        self.chip.write_registers(&[CTRL5_C, SELF_TEST_ON]).await?;
        let with = self.settled_mean().await?;
        self.chip.write_registers(&[CTRL5_C, 0]).await?;
        let failed_axes = |change: Vector3<f32>, limits: core::ops::RangeInclusive<f32>| {
            (0..3).filter(|&axis| !limits.contains(&change[axis].abs())).map(|axis| 1 << axis).sum::<u8>()
        };
        let failed_rates = failed_axes(with.rates_rad_s - without.rates_rad_s, SELF_TEST_RATES_RAD_S);
        let failed_forces = failed_axes(with.specific_force_m_s2 - without.specific_force_m_s2, SELF_TEST_FORCES_M_S2);
        match failed_rates << 4 | failed_forces {
            0 => Ok(()),
            failed => Err(ChipError::SelfTest(failed)),
        }
    }

    async fn settled_mean(&mut self) -> Result<InertialSample, ChipError<B::Error>> {
        Timer::after_millis(SETTLING_MS).await;
        let mut mean = InertialSample { rates_rad_s: Vector3::zeros(), specific_force_m_s2: Vector3::zeros() };
        for _ in 0..SELF_TEST_READINGS {
            let InertialReading { sample, .. } = self.read_measurement().await?;
            mean.rates_rad_s += sample.rates_rad_s / f32::from(SELF_TEST_READINGS);
            mean.specific_force_m_s2 += sample.specific_force_m_s2 / f32::from(SELF_TEST_READINGS);
        }
        Ok(mean)
    }
}

impl<B: I2c> MeasuringChip for Lsm6dsl<B> {
    type BusError = B::Error;
    type Identity = ();
    type Measurement = InertialReading;

    async fn init(&mut self) -> Result<(), ChipError<B::Error>> {
        match self.chip.read_registers(WHO_AM_I).await? {
            [WHO_AM_I_VALUE] => {}
            [other] => return Err(ChipError::WrongIdentity(other)),
        }
        self.write_control_registers().await?;
        self.verify_configuration().await?;
        self.test_sensors().await?;
        self.verify_configuration().await?;
        // The output still settles after the self-test.
        Timer::after_millis(SETTLING_MS).await;
        self.read_measurement().await.map(|_| ())
    }

    async fn read_measurement(&mut self) -> Result<InertialReading, ChipError<B::Error>> {
        let chip = &mut self.chip;
        self.polling
            .wait_for_measurement(
                async || chip.read_registers(STATUS_REG).await,
                |[status]| status & DATA_AVAILABLE_BITS == DATA_AVAILABLE_BITS,
            )
            .await?;
        Ok(decode_reading(self.chip.read_registers(OUT_TEMP_L).await?))
    }

    async fn verify_configuration(&mut self) -> Result<(), ChipError<B::Error>> {
        chip::compare_readback(CONTROL_REGISTERS, self.chip.read_registers(CTRL1_XL).await?)
    }

    fn period_us(&self) -> u32 {
        PERIOD_US
    }
}

impl<B: I2c> InertialSensor for Lsm6dsl<B> {
    /// Table 3: zero-rate level 3 deg/s, zero-g level 40 mg, sensitivity 1 %. Cross-axis sensitivity: half of the 2 % of the
    /// MPU-6000 (PS-MPU-6000A rev. 3.4), because ST gives none.
    fn sensor_errors(&self) -> InertialSensorErrors {
        InertialSensorErrors {
            gyro_offset_rad_s: 3.0 * DEG,
            gyro_scale: 0.01,
            gyro_cross_axis: 0.01,
            accelerometer_offset_m_s2: 0.04 * GRAVITY_M_S2,
        }
    }
}

/// Decodes fourteen bytes from `OUT_TEMP_L` on: temperature, rates, specific force.
fn decode_reading(data: [u8; 14]) -> InertialReading {
    let counts: [i16; 7] = core::array::from_fn(|i| i16::from_le_bytes([data[2 * i], data[2 * i + 1]]));
    let [temperature, p, q, r, x, y, z] = counts;
    let scaled = |counts: [i16; 3], unit: f32| Vector3::from(counts.map(|count| f32::from(count) * unit));
    let is_at_limit = |count: &i16| *count == i16::MAX || *count == i16::MIN;
    InertialReading {
        sample: InertialSample {
            rates_rad_s: scaled([p, q, r], RAD_S_PER_COUNT),
            specific_force_m_s2: scaled([x, y, z], M_S2_PER_COUNT),
        },
        temperature_c: 25.0 + f32::from(temperature) / COUNTS_PER_DEGREE,
        is_saturated: counts[1..].iter().any(is_at_limit),
    }
}

#[cfg(test)]
mod tests;
