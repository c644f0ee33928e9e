//! PNI RM3100 on an SPI bus, mode 0, at most 1 MHz (manual: PNI document 1017252 r02 to r04).
//!
//! Continuous measurement at 75 Hz with cycle count 200; docs/dronecan.md (The RM3100) compares rates and cycle counts.
//! The chip does not report overwritten measurements. Its data ready line is not used, because boards do not wire it.

use embassy_time::Timer;
use embedded_hal_async::spi::SpiDevice;

use crate::chip::{self, ChipError, MeasuringChip, PollingSchedule, SpiRegisters};
use crate::magnetometer::driver::Magnetometer;
use autoswing::frames::Field;
use autoswing::reading::{Identity, MagnetometerModel, Reading};

/// Measurement period at 75 Hz.
const PERIOD_US: u32 = 13_333;
/// Share of the period slept: the rate has a standard deviation of 7 % (manual, section 5.2.1); three of them shorten
/// the period to 83 %.
const SLEEP_PERCENT: u32 = 79;

const POLL_REGISTER: u8 = 0x00;
/// Continuous mode. Reading it ends the mode.
const CMM_REGISTER: u8 = 0x01;
const CCX1_REGISTER: u8 = 0x04;
/// Rate of the continuous mode. Writing it ends the mode.
const TMRC_REGISTER: u8 = 0x0B;
const MX2_REGISTER: u8 = 0x24;
const BIST_REGISTER: u8 = 0x33;
const STATUS_REGISTER: u8 = 0x34;
const REVID_REGISTER: u8 = 0x36;

const REVID_VALUE: u8 = 0x22;
/// Cycle count 200 of the three axes, the chip's default. ArduPilot's driver recognises the chip by it, also after a
/// restart that leaves the chip powered.
const CYCLE_COUNTS: [u8; 6] = [0x00, 200, 0x00, 200, 0x00, 200];
/// `TMRC`: 75 Hz.
const RATE_75_HZ: u8 = 0x95;
const CMM_STOPPED: u8 = 0x00;
/// `CMM`: three axes, data ready after the last of them.
const CONTINUOUS_MODE: u8 = 0b0111_1001;
/// `POLL`: three axes.
const ALL_AXES: u8 = 0b0111_0000;
/// `BIST`: four periods of each LR oscillator, within 120 us.
const TEST_ENABLED: u8 = 0b1000_1111;
const TEST_DISABLED: u8 = 0x00;
/// `BIST`: enabled, and the oscillators of the three axes work.
const TEST_PASSED: u8 = 0b1111_0000;
/// `STATUS`: new measurement; the other bits are undefined.
const DATA_READY: u8 = 0x80;

/// Sensitivity at cycle count 200 (manual, table 3-1).
const COUNTS_PER_UT: f32 = 75.0;
/// End of the range, 800 uT.
const FULL_SCALE_COUNTS: i32 = 60_000;

/// RM3100 on an SPI bus.
#[derive(Debug)]
pub struct Rm3100<S> {
    chip: SpiRegisters<S>,
    polling: PollingSchedule,
}

impl<S: SpiDevice> Rm3100<S> {
    /// Creates a driver; [`init`](MeasuringChip::init) is the first bus access.
    pub const fn new(device: S) -> Self {
        Self { chip: SpiRegisters::new(device), polling: PollingSchedule::new(PERIOD_US, SLEEP_PERCENT) }
    }

    /// Stops continuous mode and waits for the end of a measurement: until then the chip refuses single ones.
    async fn stop_continuous_mode(&mut self) -> Result<(), ChipError<S::Error>> {
        self.chip.write_registers(&[CMM_REGISTER, CMM_STOPPED]).await?;
        Timer::after_micros(PERIOD_US.into()).await;
        self.discard_measurement().await
    }

    /// Reads the data, which clears data ready.
    async fn discard_measurement(&mut self) -> Result<(), ChipError<S::Error>> {
        let _old: [u8; 9] = self.chip.read_registers(MX2_REGISTER).await?;
        Ok(())
    }

    async fn wait_for_measurement(&mut self) -> Result<(), ChipError<S::Error>> {
        let chip = &mut self.chip;
        let is_ready = |[status]: &[u8; 1]| status & DATA_READY != 0;
        self.polling.wait_for_measurement(async || chip.read_registers(STATUS_REGISTER).await, is_ready).await?;
        Ok(())
    }

    /// Runs the built-in self-test of the oscillators (manual, section 5.6.1).
    async fn run_self_test(&mut self) -> Result<(), ChipError<S::Error>> {
        self.chip.write_registers(&[BIST_REGISTER, TEST_ENABLED]).await?;
        self.chip.write_registers(&[POLL_REGISTER, ALL_AXES]).await?;
        self.polling.start_sleep();
        self.wait_for_measurement().await?;
        let [result] = self.chip.read_registers(BIST_REGISTER).await?;
        self.chip.write_registers(&[BIST_REGISTER, TEST_DISABLED]).await?;
        if result & TEST_PASSED == TEST_PASSED { Ok(()) } else { Err(ChipError::SelfTest(result)) }
    }
}

impl<S: SpiDevice> MeasuringChip for Rm3100<S> {
    type BusError = S::Error;
    type Identity = Identity;
    type Measurement = Reading;

    async fn init(&mut self) -> Result<Identity, ChipError<S::Error>> {
        match self.chip.read_registers(REVID_REGISTER).await? {
            [REVID_VALUE] => {}
            [other] => return Err(ChipError::WrongIdentity(other)),
        }
        self.stop_continuous_mode().await?;
        self.run_self_test().await?;
        let [x1, x0, y1, y0, z1, z0] = CYCLE_COUNTS;
        self.chip.write_registers(&[CCX1_REGISTER, x1, x0, y1, y0, z1, z0]).await?;
        self.chip.write_registers(&[TMRC_REGISTER, RATE_75_HZ]).await?;
        self.verify_configuration().await?;
        self.discard_measurement().await?;
        // Continuous mode is started last, because other accesses end it.
        self.chip.write_registers(&[CMM_REGISTER, CONTINUOUS_MODE]).await?;
        self.polling.start_sleep();
        Ok(Identity { model: MagnetometerModel::Rm3100, address: Identity::SPI_ADDRESS })
    }

    async fn read_measurement(&mut self) -> Result<Reading, ChipError<S::Error>> {
        self.wait_for_measurement().await?;
        match self.chip.read_registers(MX2_REGISTER).await? {
            // No chip drives the line: SPI has no acknowledge, and such a line also reads as data ready.
            [0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF] => Err(ChipError::NoData),
            data => Ok(decode_reading(data)),
        }
    }

    /// Verifies all but continuous mode, which a read of `CMM` would end: a chip that left continuous mode sends no
    /// data.
    async fn verify_configuration(&mut self) -> Result<(), ChipError<S::Error>> {
        chip::compare_readback(CYCLE_COUNTS, self.chip.read_registers(CCX1_REGISTER).await?)?;
        chip::compare_readback([RATE_75_HZ], self.chip.read_registers(TMRC_REGISTER).await?)
    }

    fn period_us(&self) -> u32 {
        PERIOD_US
    }
}

impl<S: SpiDevice> Magnetometer for Rm3100<S> {
    /// Noise of 1.1 counts repeats the middle value in every third reading, half of that noise in two of three. 48 in a
    /// row then occur every other year.
    fn equal_readings_until_stuck(&self) -> u16 {
        48
    }
}

/// Decodes nine bytes from `MX2` on: 24 bits of each axis, big-endian.
fn decode_reading(data: [u8; 9]) -> Reading {
    let [x2, x1, x0, y2, y1, y0, z2, z1, z0] = data;
    // The shift extends the sign.
    let counts = [[x2, x1, x0, 0], [y2, y1, y0, 0], [z2, z1, z0, 0]].map(|bytes| i32::from_be_bytes(bytes) >> 8);
    let [x_ut, y_ut, z_ut] = counts.map(|count| count as f32 / COUNTS_PER_UT);
    Reading {
        field: Field::from_ut(x_ut, y_ut, z_ut),
        is_saturated: counts.iter().any(|count| count.abs() > FULL_SCALE_COUNTS),
        was_overwritten: false,
    }
}

#[cfg(test)]
mod tests;
