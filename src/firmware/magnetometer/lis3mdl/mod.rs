//! ST LIS3MDL (data sheet DocID024204).
//!
//! Continuous measurement at 80 Hz in ultra-high-performance mode: the fastest plain data rate, at the lowest noise
//! (0.35 uT RMS). Block data update keeps both bytes of an axis from one measurement.

use embedded_hal_async::i2c::I2c;

use crate::chip::{self, ChipError, I2cRegisters, MeasuringChip, PollingSchedule};
use crate::magnetometer::driver::Magnetometer;
use autoswing::frames::Field;
use autoswing::reading::{Identity, MagnetometerModel, Reading};

/// Measurement period at 80 Hz.
const PERIOD_US: u32 = 12_500;

const WHO_AM_I: u8 = 0x0F;
const WHO_AM_I_VALUE: u8 = 0x3D;
const CTRL_REG1: u8 = 0x20;
const STATUS_REG: u8 = 0x27;
const OUT_X_L: u8 = 0x28;
/// Address flag: auto-increment in longer transfers.
const AUTO_INCREMENT: u8 = 0x80;
/// `STATUS_REG`: new measurement of all axes.
const DATA_AVAILABLE_BIT: u8 = 0x08;
/// `STATUS_REG`: a measurement was overwritten before it was read.
const OVERRUN_BIT: u8 = 0x80;

/// 7-bit I2C address with pin SDO/SA1 high.
const I2C_ADDRESS: u8 = 0x1E;

/// `CTRL_REG1` to `CTRL_REG5`. The range of 4 gauss is six times the strongest Earth field (66 uT), to allow for hard
/// iron, at the finest resolution (0.015 uT).
const CONTROL_REGISTERS: [u8; 5] = [
    0b0111_1100, // 1: x and y in ultra-high-performance mode, 80 Hz, temperature sensor off
    0b0000_0000, // 2: +-4 gauss
    0b0000_0000, // 3: continuous conversion
    0b0000_1100, // 4: z in ultra-high-performance mode, little endian
    0b0100_0000, // 5: block data update
];

/// Sensitivity at +-4 gauss (data sheet table 3).
const COUNTS_PER_GAUSS: i32 = 6842;

/// End of the range.
const FULL_SCALE_COUNTS: i32 = 4 * COUNTS_PER_GAUSS;

/// LIS3MDL on an I2C bus.
#[derive(Debug)]
pub struct Lis3mdl<B> {
    chip: I2cRegisters<B>,
    polling: PollingSchedule,
}

impl<B: I2c> Lis3mdl<B> {
    /// Creates a driver; [`init`](MeasuringChip::init) is the first bus access.
    pub const fn new(bus: B) -> Self {
        Self {
            chip: I2cRegisters::new(bus, I2C_ADDRESS),
            polling: PollingSchedule::new(PERIOD_US, chip::SLEEP_PERCENT),
        }
    }

    async fn read_registers<const N: usize>(&mut self, first: u8) -> Result<[u8; N], ChipError<B::Error>> {
        self.chip.read_registers(first | AUTO_INCREMENT).await
    }
}

impl<B: I2c> MeasuringChip for Lis3mdl<B> {
    type BusError = B::Error;
    type Identity = Identity;
    type Measurement = Reading;

    async fn init(&mut self) -> Result<Identity, ChipError<B::Error>> {
        match self.read_registers(WHO_AM_I).await? {
            [WHO_AM_I_VALUE] => {}
            [other] => return Err(ChipError::WrongIdentity(other)),
        }
        let [c1, c2, c3, c4, c5] = CONTROL_REGISTERS;
        self.chip.write_registers(&[CTRL_REG1 | AUTO_INCREMENT, c1, c2, c3, c4, c5]).await?;
        self.verify_configuration().await?;
        // With block data update, a transfer interrupted between the bytes of an axis freezes that axis until all are
        // read.
        let _old: [u8; 6] = self.read_registers(OUT_X_L).await?;
        self.polling.start_sleep();
        Ok(Identity { model: MagnetometerModel::Lis3mdl, address: I2C_ADDRESS })
    }

    async fn read_measurement(&mut self) -> Result<Reading, ChipError<B::Error>> {
        let chip = &mut self.chip;
        let status = self
            .polling
            .wait_for_measurement(
                async || chip.read_registers(STATUS_REG).await,
                |[status]| status & DATA_AVAILABLE_BIT != 0,
            )
            .await?;
        let data = self.read_registers(OUT_X_L).await?;
        Ok(decode_reading(status[0], data))
    }

    async fn verify_configuration(&mut self) -> Result<(), ChipError<B::Error>> {
        chip::compare_readback(CONTROL_REGISTERS, self.read_registers(CTRL_REG1).await?)
    }

    fn period_us(&self) -> u32 {
        PERIOD_US
    }
}

impl<B: I2c> Magnetometer for Lis3mdl<B> {
    /// Noise of 22 counts repeats a value once in eighty readings, a tenth of that noise once in six. Twelve readings
    /// take 0.15 s, less than 3 deg of a turn at 35 deg of bank.
    fn equal_readings_until_stuck(&self) -> u16 {
        12
    }
}

/// Decodes the status register and six bytes from `OUT_X_L` on. The chip's axes are right-handed.
fn decode_reading(status: u8, data: [u8; 6]) -> Reading {
    let [x_low, x_high, y_low, y_high, z_low, z_high] = data;
    let counts = [[x_low, x_high], [y_low, y_high], [z_low, z_high]].map(i16::from_le_bytes);
    let [x_ut, y_ut, z_ut] = counts.map(|count| f32::from(count) * (100.0 / COUNTS_PER_GAUSS as f32));
    Reading {
        field: Field::from_ut(x_ut, y_ut, z_ut),
        is_saturated: counts.iter().any(|&count| i32::from(count).abs() > FULL_SCALE_COUNTS),
        was_overwritten: status & OVERRUN_BIT != 0,
    }
}

#[cfg(test)]
mod tests;
