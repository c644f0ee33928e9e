//! ST LSM303DLHC, its magnetometer (data sheet DocID018771).
//!
//! The chip measures continuously at 75 Hz, the rate below 220 Hz, whose noise is larger. Its temperature sensor, which
//! takes part in no compensation of the data, stays off. Twelve bits an axis, in the order x, z, y, most significant
//! byte first.

use embedded_hal_async::i2c::I2c;

use super::chip::{self, Chip, Polling};
use super::{Error, Identity, Magnetometer, Model, Reading};
use crate::frames::Field;

/// The only address there is.
const ADDRESS: u8 = 0x1E;
/// Time between two measurements at 75 Hz.
const PERIOD_US: u32 = 13_333;

const CRA_REG_M: u8 = 0x00;
const OUT_X_H_M: u8 = 0x03;
const SR_REG_M: u8 = 0x09;
const IRA_REG_M: u8 = 0x0A;
const IDENTITY: [u8; 3] = *b"H43";
/// `SR_REG_M`: a new measurement of all three axes is there.
const DRDY: u8 = 0x01;
/// What an axis reads when its converter is at the end of its range (data sheet section 7.2).
const OVERFLOW: i16 = -4096;

/// Measurement range of the chip, by the GN bits of `CRB_REG_M`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Range {
    /// +-1.3 gauss = +-130 microtesla.
    Gauss1_3 = 1,
    /// +-1.9 gauss = +-190 microtesla.
    Gauss1_9,
    /// +-2.5 gauss = +-250 microtesla.
    Gauss2_5,
    /// +-4.0 gauss = +-400 microtesla.
    Gauss4_0,
    /// +-4.7 gauss = +-470 microtesla.
    Gauss4_7,
    /// +-5.6 gauss = +-560 microtesla.
    Gauss5_6,
    /// +-8.1 gauss = +-810 microtesla.
    Gauss8_1,
}

impl Range {
    /// Sensitivity in counts per gauss of x and y, and of z (data sheet table 75).
    const fn counts_per_gauss(self) -> [f32; 2] {
        match self {
            Self::Gauss1_3 => [1100.0, 980.0],
            Self::Gauss1_9 => [855.0, 760.0],
            Self::Gauss2_5 => [670.0, 600.0],
            Self::Gauss4_0 => [450.0, 400.0],
            Self::Gauss4_7 => [400.0, 355.0],
            Self::Gauss5_6 => [330.0, 295.0],
            Self::Gauss8_1 => [230.0, 205.0],
        }
    }
}

/// What can be chosen; the rest is fixed by what a compass needs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Config {
    /// Measurement range.
    pub range: Range,
}

impl Default for Config {
    /// +-2.5 gauss: four times the strongest Earth field (66 microtesla), at a resolution (0.15 microtesla) below the
    /// chip's noise (0.2 microtesla).
    fn default() -> Self {
        Self { range: Range::Gauss2_5 }
    }
}

/// An LSM303DLHC on an I2C bus.
#[derive(Debug)]
pub struct Lsm303dlhc<B> {
    chip: Chip<B>,
    config: Config,
    polling: Polling,
}

impl<B: I2c> Lsm303dlhc<B> {
    /// A driver for the chip on this bus; [`init`](Magnetometer::init) is the first access to it.
    pub const fn new(bus: B, config: Config) -> Self {
        Self { chip: Chip::new(bus, ADDRESS), config, polling: Polling::new(PERIOD_US) }
    }

    /// `CRA_REG_M`, `CRB_REG_M` and `MR_REG_M`.
    const fn control(&self) -> [u8; 3] {
        [
            0b0001_1000, // temperature sensor off, 75 Hz
            (self.config.range as u8) << 5,
            0b0000_0000, // continuous conversion
        ]
    }
}

impl<B: I2c> Magnetometer for Lsm303dlhc<B> {
    type BusError = B::Error;

    async fn init(&mut self) -> Result<Identity, Error<B::Error>> {
        let identity: [u8; 3] = self.chip.registers(IRA_REG_M).await?;
        if let Some((_, &other)) = IDENTITY.iter().zip(&identity).find(|(expected, read)| expected != read) {
            return Err(Error::WrongIdentity(other));
        }
        // The chip counts its address up when it is read, not when it is written.
        for (register, value) in (CRA_REG_M..).zip(self.control()) {
            self.chip.write(&[register, value]).await?;
        }
        self.verify().await?;
        // A measurement that was read in part locks the data until the rest is read; and the first one after a change
        // of range may be of the old range.
        let _old: [u8; 6] = self.chip.registers(OUT_X_H_M).await?;
        self.polling.restart();
        Ok(Identity { model: Model::Lsm303dlhc, address: ADDRESS })
    }

    async fn read(&mut self) -> Result<Reading, Error<B::Error>> {
        let chip = &mut self.chip;
        self.polling.next(async || chip.registers(SR_REG_M).await, |[status]| status & DRDY != 0).await?;
        let data = self.chip.registers(OUT_X_H_M).await?;
        Ok(decode(data, self.config.range))
    }

    async fn verify(&mut self) -> Result<(), Error<B::Error>> {
        chip::same(self.control(), self.chip.registers(CRA_REG_M).await?)
    }

    /// Its noise is little more than a count: at rest every third reading of an axis is in the middle one, in a chip
    /// with half the noise every second. 32 in a row are then a chance of once in a month.
    fn stuck_after(&self) -> u16 {
        32
    }

    fn period_us(&self) -> u32 {
        PERIOD_US
    }
}

/// A reading from the six bytes from `OUT_X_H_M` on. The chip's axes are right-handed. It does not tell of measurements
/// that were overwritten.
fn decode(data: [u8; 6], range: Range) -> Reading {
    let [x_high, x_low, z_high, z_low, y_high, y_low] = data;
    let counts = [[x_high, x_low], [y_high, y_low], [z_high, z_low]].map(i16::from_be_bytes);
    let [xy, z] = range.counts_per_gauss().map(|counts_per_gauss| 100.0 / counts_per_gauss);
    let [x_count, y_count, z_count] = counts.map(f32::from);
    Reading {
        field: Field::from_ut(x_count * xy, y_count * xy, z_count * z),
        saturated: counts.contains(&OVERFLOW),
        overrun: false,
    }
}

#[cfg(test)]
mod tests {
    use embassy_futures::block_on;
    use embassy_time::Instant;
    use testkit::simulation::{Level, Simulation};

    use super::super::chip::registers::{Registers, assert_every_bit_is_verified};
    use super::*;

    fn registers() -> Registers {
        Registers::new(0, &[(0x0A, 0x48), (0x0B, 0x34), (0x0C, 0x33)])
    }

    /// Each bit of the three control registers.
    #[test]
    fn every_bit_of_the_configuration_is_looked_at() {
        let mut driver = Lsm303dlhc::new(registers(), Config::default());
        block_on(assert_every_bit_is_verified(&mut driver, |driver| &mut driver.chip.bus, 0..3));
    }

    #[test]
    fn thirty_two_equal_readings_are_no_noise() {
        assert_eq!(Lsm303dlhc::new(registers(), Config::default()).stuck_after(), 32);
    }

    #[test]
    fn init_writes_what_the_data_sheet_asks_for() {
        let mut driver = Lsm303dlhc::new(registers(), Config::default());
        let identity = block_on(driver.init());
        assert_eq!(identity, Ok(Identity { model: Model::Lsm303dlhc, address: 0x1E }));
        // 75 Hz without temperature, 2.5 gauss, continuous: data sheet sections 7.2.1 to 7.2.3.
        assert_eq!(driver.chip.bus.values[..3], [0x18, 0x60, 0x00]);
    }

    #[test]
    fn another_chip_is_not_configured() {
        let mut driver = Lsm303dlhc::new(registers(), Config::default());
        driver.chip.bus.values[0x0B] = 0x35;
        assert_eq!(block_on(driver.init()), Err(Error::WrongIdentity(0x35)));
        assert_eq!(driver.chip.bus.values[..3], [0; 3]);
    }

    #[test]
    fn a_control_register_that_does_not_hold_is_reported() {
        let mut driver = Lsm303dlhc::new(registers(), Config::default());
        driver.chip.bus.broken = Some(0x01);
        assert_eq!(block_on(driver.init()), Err(Error::Configuration { written: 0x60, read: 0x00 }));
    }

    /// Each of the three identity registers counts.
    #[test]
    fn every_identity_register_is_looked_at() {
        for register in 0x0A..0x0D {
            let mut driver = Lsm303dlhc::new(registers(), Config::default());
            driver.chip.bus.values[register] = 0xEE;
            assert_eq!(block_on(driver.init()), Err(Error::WrongIdentity(0xEE)));
        }
    }

    /// The GN bits of data sheet table 75 and the counts of one gauss, of x and y and of z.
    #[test]
    fn every_range_has_its_bits_and_its_sensitivity() {
        for (range, bits, xy, z) in [
            (Range::Gauss1_3, 0x20, 1100_i16, 980_i16),
            (Range::Gauss1_9, 0x40, 855, 760),
            (Range::Gauss2_5, 0x60, 670, 600),
            (Range::Gauss4_0, 0x80, 450, 400),
            (Range::Gauss4_7, 0xA0, 400, 355),
            (Range::Gauss5_6, 0xC0, 330, 295),
            (Range::Gauss8_1, 0xE0, 230, 205),
        ] {
            let mut driver = Lsm303dlhc::new(registers(), Config { range });
            block_on(driver.init()).unwrap();
            assert_eq!(driver.chip.bus.values[1], bits, "{range:?}");
            let (xy, z) = (xy.to_be_bytes(), z.to_be_bytes());
            let one_gauss = decode([xy[0], xy[1], z[0], z[1], xy[0], xy[1]], range).field.ut;
            assert!((one_gauss - nalgebra::Vector3::repeat(100.0)).amax() < 1e-4, "{range:?}: {one_gauss}");
        }
    }

    #[test]
    fn init_reads_the_data_once() {
        let mut driver = Lsm303dlhc::new(registers(), Config::default());
        block_on(driver.init()).unwrap();
        assert!(driver.chip.bus.was_read[0x03..0x09].iter().all(|&was_read| was_read));
    }

    /// -0.25 gauss on y at 2.5 gauss: 167.5 counts, here 168.
    fn with_measurement(status: u8) -> Lsm303dlhc<Registers> {
        let mut driver = Lsm303dlhc::new(registers(), Config::default());
        driver.chip.bus.values[0x09] = status;
        driver.chip.bus.values[0x07..0x09].copy_from_slice(&(-168_i16).to_be_bytes());
        driver
    }

    #[test]
    fn a_measurement_is_read_when_the_status_tells_of_one() {
        for status in [0x01, 0x03] {
            let reading = block_on(with_measurement(status).read()).unwrap();
            assert!((reading.field.ut.y + 25.07).abs() < 0.01 && !reading.saturated, "{reading:?}");
        }
        assert_eq!(with_measurement(0).period_us(), 13_333, "75 Hz");
    }

    /// The lock bit alone is no measurement. Asked from the end of the sleep (88 % of 13.333 ms) for four periods, to
    /// the next look of those that are 0.5 ms apart.
    #[test]
    fn what_is_not_new_is_waited_for() {
        for status in [0x00, 0x02, 0xFE] {
            let mut simulation = Simulation::new();
            simulation.spawn(Level::Interrupt, "script", async move {
                let mut driver = with_measurement(status);
                driver.init().await.unwrap();
                assert_eq!(driver.read().await, Err(Error::NoData));
                assert_eq!(Instant::now().as_micros(), 11_733 + 53_500);
            });
            simulation.run_for(1_000_000);
            assert_eq!(simulation.tasks(), 0);
        }
    }

    /// One gauss on x, -0.5 on y, 0.25 on z at a range of 1.3 gauss: 1100 and 980 counts per gauss, x, z, y.
    #[test]
    fn counts_become_microtesla_on_the_chips_axes() {
        let [x, y, z] = [1100_i16, -550, 245].map(i16::to_be_bytes);
        let reading = decode([x[0], x[1], z[0], z[1], y[0], y[1]], Range::Gauss1_3);
        assert_eq!(reading.field, Field::from_ut(100.0, -50.0, 25.0));
        assert!(!reading.saturated && !reading.overrun);
    }

    #[test]
    fn the_overflow_code_on_any_axis_is_saturation() {
        for axis in 0..3 {
            let mut data = [0; 6];
            data[2 * axis..2 * axis + 2].copy_from_slice(&[0xF0, 0x00]);
            assert!(decode(data, Range::Gauss2_5).saturated);
        }
        assert!(!decode([0xF8, 0x00, 0x07, 0xFF, 0, 0], Range::Gauss2_5).saturated, "the ends of the range are data");
    }
}
