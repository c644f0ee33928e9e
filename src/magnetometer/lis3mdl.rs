//! ST LIS3MDL (data sheet DocID024204).
//!
//! The chip measures continuously at 80 Hz in its ultra-high-performance mode, the fastest of the plain data rates and
//! the mode of the lowest noise (0.35 microtesla RMS). Block data update is on, so that the two bytes of an axis are
//! always of one measurement.

use embedded_hal_async::i2c::I2c;

use super::chip::{self, Chip, Polling};
use super::{Error, Identity, Magnetometer, Model, Reading};
use crate::frames::Field;

/// Time between two measurements at 80 Hz.
const PERIOD_US: u32 = 12_500;

const WHO_AM_I: u8 = 0x0F;
const WHO_AM_I_VALUE: u8 = 0x3D;
const CTRL_REG1: u8 = 0x20;
const STATUS_REG: u8 = 0x27;
const OUT_X_L: u8 = 0x28;
/// Set in the register address to have it advance by itself in a longer transfer.
const AUTO_INCREMENT: u8 = 0x80;
/// `STATUS_REG`: a new measurement of all three axes is there.
const ZYXDA: u8 = 0x08;
/// `STATUS_REG`: a measurement was overwritten before it was read.
const ZYXOR: u8 = 0x80;

/// Measurement range of the chip.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Range {
    /// +-4 gauss = +-400 microtesla.
    Gauss4,
    /// +-8 gauss = +-800 microtesla.
    Gauss8,
    /// +-12 gauss = +-1200 microtesla.
    Gauss12,
    /// +-16 gauss = +-1600 microtesla.
    Gauss16,
}

impl Range {
    /// The range in gauss.
    const fn gauss(self) -> i32 {
        match self {
            Self::Gauss4 => 4,
            Self::Gauss8 => 8,
            Self::Gauss12 => 12,
            Self::Gauss16 => 16,
        }
    }

    /// Sensitivity in counts per gauss, data sheet table 3.
    const fn counts_per_gauss(self) -> i32 {
        match self {
            Self::Gauss4 => 6842,
            Self::Gauss8 => 3421,
            Self::Gauss12 => 2281,
            Self::Gauss16 => 1711,
        }
    }

    /// The FS bits of `CTRL_REG2`.
    const fn bits(self) -> u8 {
        (self as u8) << 5
    }
}

/// What can be chosen; the rest is fixed by what a compass needs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Config {
    /// 7-bit I2C address: 0x1C with pin SDO/SA1 low, 0x1E with it high.
    pub address: u8,
    /// Measurement range.
    pub range: Range,
}

impl Default for Config {
    /// +-4 gauss: six times the strongest Earth field (66 microtesla), so that hard iron of several times that field
    /// still fits, at the finest resolution (0.015 microtesla). Address 0x1E.
    fn default() -> Self {
        Self { address: 0x1E, range: Range::Gauss4 }
    }
}

/// A LIS3MDL on an I2C bus.
#[derive(Debug)]
pub struct Lis3mdl<B> {
    chip: Chip<B>,
    config: Config,
    polling: Polling,
}

impl<B: I2c> Lis3mdl<B> {
    /// A driver for the chip on this bus; [`init`](Magnetometer::init) is the first access to it.
    pub const fn new(bus: B, config: Config) -> Self {
        Self { chip: Chip::new(bus, config.address), config, polling: Polling::new(PERIOD_US) }
    }

    /// `CTRL_REG1` to `CTRL_REG5`.
    const fn control(&self) -> [u8; 5] {
        [
            0b0111_1100, // 1: x and y in ultra-high-performance mode, 80 Hz, temperature sensor off
            self.config.range.bits(),
            0b0000_0000, // 3: continuous conversion
            0b0000_1100, // 4: z in ultra-high-performance mode, little endian
            0b0100_0000, // 5: block data update
        ]
    }

    async fn registers<const N: usize>(&mut self, first: u8) -> Result<[u8; N], Error<B::Error>> {
        self.chip.registers(first | AUTO_INCREMENT).await
    }

    async fn write_control(&mut self) -> Result<(), Error<B::Error>> {
        let [c1, c2, c3, c4, c5] = self.control();
        self.chip.write(&[CTRL_REG1 | AUTO_INCREMENT, c1, c2, c3, c4, c5]).await
    }
}

impl<B: I2c> Magnetometer for Lis3mdl<B> {
    type BusError = B::Error;

    async fn init(&mut self) -> Result<Identity, Error<B::Error>> {
        match self.registers(WHO_AM_I).await? {
            [WHO_AM_I_VALUE] => {}
            [other] => return Err(Error::WrongIdentity(other)),
        }
        self.write_control().await?;
        self.verify().await?;
        // A transfer that broke off between the two bytes of an axis has left that axis frozen at an old measurement
        // (block data update). Reading all of them frees it.
        let _old: [u8; 6] = self.registers(OUT_X_L).await?;
        self.polling.restart();
        Ok(Identity { model: Model::Lis3mdl, address: self.config.address })
    }

    async fn read(&mut self) -> Result<Reading, Error<B::Error>> {
        let chip = &mut self.chip;
        let status =
            self.polling.next(async || chip.registers(STATUS_REG).await, |[status]| status & ZYXDA != 0).await?;
        let data = self.registers(OUT_X_L).await?;
        Ok(decode(status[0], data, self.config.range))
    }

    async fn verify(&mut self) -> Result<(), Error<B::Error>> {
        chip::same(self.control(), self.registers(CTRL_REG1).await?)
    }

    /// Its noise is 22 counts: two readings of an axis are equal once in eighty, and with a tenth of that noise once in
    /// six. Twelve are 0.15 s, in which a turn at 35 deg of bank is less than 3 deg.
    fn stuck_after(&self) -> u16 {
        12
    }

    fn period_us(&self) -> u32 {
        PERIOD_US
    }
}

/// A reading from the status register and the six bytes from `OUT_X_L` on. The chip's axes are right-handed.
fn decode(status: u8, data: [u8; 6], range: Range) -> Reading {
    let [x_low, x_high, y_low, y_high, z_low, z_high] = data;
    let counts = [[x_low, x_high], [y_low, y_high], [z_low, z_high]].map(i16::from_le_bytes);
    let full_scale = range.gauss() * range.counts_per_gauss();
    let microtesla_per_count = 100.0 / range.counts_per_gauss() as f32;
    let [x_ut, y_ut, z_ut] = counts.map(|count| f32::from(count) * microtesla_per_count);
    Reading {
        field: Field::from_ut(x_ut, y_ut, z_ut),
        saturated: counts.iter().any(|&count| i32::from(count).abs() > full_scale),
        overrun: status & ZYXOR != 0,
    }
}

#[cfg(test)]
mod tests {
    use embassy_futures::block_on;
    use embassy_time::Instant;
    use embedded_hal_async::i2c::ErrorKind;
    use testkit::simulation::{Level, Simulation};

    use super::super::chip::registers::{Registers, assert_every_bit_is_verified};
    use super::*;

    fn registers() -> Registers {
        Registers::new(AUTO_INCREMENT, &[(WHO_AM_I, WHO_AM_I_VALUE)])
    }

    #[test]
    fn init_writes_what_the_data_sheet_asks_for() {
        let mut driver = Lis3mdl::new(registers(), Config::default());
        let identity = block_on(driver.init());
        assert_eq!(identity, Ok(Identity { model: Model::Lis3mdl, address: 0x1E }));
        // UHP 80 Hz, 4 gauss, continuous, UHP, BDU: data sheet sections 7.3 to 7.7.
        assert_eq!(driver.chip.bus.values[0x20..0x25], [0x7C, 0x00, 0x00, 0x0C, 0x40]);
    }

    #[test]
    fn range_goes_to_bits_5_and_6_of_control_register_2() {
        for (range, bits) in
            [(Range::Gauss4, 0x00), (Range::Gauss8, 0x20), (Range::Gauss12, 0x40), (Range::Gauss16, 0x60)]
        {
            let mut driver = Lis3mdl::new(registers(), Config { range, ..Config::default() });
            block_on(driver.init()).unwrap();
            assert_eq!(driver.chip.bus.values[0x21], bits);
        }
    }

    #[test]
    fn another_chip_is_not_configured() {
        let mut driver = Lis3mdl::new(registers(), Config::default());
        driver.chip.bus.values[0x0F] = 0x40;
        assert_eq!(block_on(driver.init()), Err(Error::WrongIdentity(0x40)));
        assert_eq!(driver.chip.bus.values[0x20..0x25], [0; 5]);
    }

    #[test]
    fn a_control_register_that_does_not_hold_is_reported() {
        let mut driver = Lis3mdl::new(registers(), Config::default());
        driver.chip.bus.broken = Some(0x24);
        assert_eq!(block_on(driver.init()), Err(Error::Configuration { written: 0x40, read: 0x00 }));
    }

    /// Each bit of the five control registers: range, self-test, byte order, mode, all of them.
    #[test]
    fn every_bit_of_the_configuration_is_looked_at() {
        let mut driver = Lis3mdl::new(registers(), Config::default());
        block_on(assert_every_bit_is_verified(&mut driver, |driver| &mut driver.chip.bus, 0x20..0x25));
        driver.chip.bus.address = 0x1C;
        assert_eq!(block_on(driver.verify()), Err(Error::Bus(ErrorKind::Other)));
    }

    #[test]
    fn twelve_equal_readings_are_no_noise() {
        assert_eq!(Lis3mdl::new(registers(), Config::default()).stuck_after(), 12);
    }

    /// A driver that listens at the other address, and one that does not find its chip there.
    #[test]
    fn the_configured_address_is_used() {
        let mut driver = Lis3mdl::new(registers(), Config { address: 0x1C, ..Config::default() });
        assert_eq!(block_on(driver.init()), Err(Error::Bus(ErrorKind::Other)));
        driver.chip.bus.address = 0x1C;
        assert_eq!(block_on(driver.init()), Ok(Identity { model: Model::Lis3mdl, address: 0x1C }));
    }

    /// Whatever it reads: with block data update an axis that was half read before would stay frozen.
    #[test]
    fn init_reads_the_data_once() {
        let mut driver = Lis3mdl::new(registers(), Config::default());
        block_on(driver.init()).unwrap();
        assert!(driver.chip.bus.was_read[0x28..0x2E].iter().all(|&was_read| was_read));
    }

    /// Status and data of one measurement: 0.5 gauss on x at +-4 gauss.
    fn with_measurement(status: u8) -> Lis3mdl<Registers> {
        let mut driver = Lis3mdl::new(registers(), Config::default());
        driver.chip.bus.values[0x27] = status;
        driver.chip.bus.values[0x28..0x2A].copy_from_slice(&3421_i16.to_le_bytes());
        driver
    }

    #[test]
    fn a_measurement_is_read_with_its_status() {
        for (status, overrun) in [(0x08, false), (0x0F, false), (0x88, true)] {
            let mut driver = with_measurement(status);
            let reading = block_on(driver.read()).unwrap();
            assert_eq!(reading, Reading { field: Field::from_ut(50.0, 0.0, 0.0), saturated: false, overrun });
        }
        assert_eq!(with_measurement(0).period_us(), 12_500, "80 Hz");
    }

    /// Axes that are new one by one, or overwritten, are no new measurement of all three. The chip is asked from the
    /// end of the sleep (88 % of 12.5 ms) for four periods.
    #[test]
    fn what_is_not_new_is_waited_for() {
        for status in [0x00, 0x07, 0xF7] {
            let mut simulation = Simulation::new();
            simulation.spawn(Level::Interrupt, "script", async move {
                let mut driver = with_measurement(status);
                driver.init().await.unwrap();
                assert_eq!(driver.read().await, Err(Error::NoData));
                assert_eq!(Instant::now().as_micros(), 11_000 + 50_000);
            });
            simulation.run_for(1_000_000);
            assert_eq!(simulation.tasks(), 0);
        }
    }

    /// Sensitivities of data sheet table 3: counts of one gauss, 100 microtesla.
    #[test]
    fn every_range_has_its_sensitivity_and_its_ends() {
        for (range, counts_per_gauss, gauss) in
            [(Range::Gauss4, 6842, 4), (Range::Gauss8, 3421, 8), (Range::Gauss12, 2281, 12), (Range::Gauss16, 1711, 16)]
        {
            let [low, high] = i16::to_le_bytes(counts_per_gauss);
            let reading = decode(0x08, [low, high, 0, 0, 0, 0], range);
            assert!((reading.field.ut.x - 100.0).abs() < 1e-4, "{range:?}: {}", reading.field.ut);
            for (counts, saturated) in [(gauss * counts_per_gauss, false), (gauss * counts_per_gauss + 1, true)] {
                for counts in [counts, -counts] {
                    let [low, high] = counts.to_le_bytes();
                    for axis in 0..3 {
                        let mut data = [0; 6];
                        data[2 * axis..2 * axis + 2].copy_from_slice(&[low, high]);
                        assert_eq!(decode(0x08, data, range).saturated, saturated, "{range:?} {counts} on {axis}");
                    }
                }
            }
        }
    }

    /// 6842 counts are one gauss, 100 microtesla, at the range of 4 gauss (data sheet table 3).
    #[test]
    fn counts_become_microtesla_on_the_chips_axes() {
        let [x, y, z] = [6842_i16, -3421, 0].map(i16::to_le_bytes);
        let reading = decode(0x08, [x[0], x[1], y[0], y[1], z[0], z[1]], Range::Gauss4);
        assert_eq!(reading, Reading { field: Field::from_ut(100.0, -50.0, 0.0), saturated: false, overrun: false });
    }

    #[test]
    fn either_end_of_the_range_is_saturation() {
        for (counts, saturated) in
            [(27_368, false), (27_369, true), (-27_369, true), (i16::MAX, true), (i16::MIN, true)]
        {
            let [low, high] = counts.to_le_bytes();
            let reading = decode(ZYXDA, [0, 0, 0, 0, low, high], Range::Gauss4);
            assert_eq!(reading.saturated, saturated, "{counts}");
        }
    }

    #[test]
    fn overrun_is_seen_in_the_status() {
        assert!(decode(0x88, [0; 6], Range::Gauss4).overrun);
        assert!(!decode(0x78, [0; 6], Range::Gauss4).overrun, "what tells of single axes");
    }
}
