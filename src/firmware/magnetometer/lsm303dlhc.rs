//! ST LSM303DLHC magnetometer (data sheet DocID018771).
//!
//! Continuous measurement at 75 Hz; the faster 220 Hz has more noise. The temperature sensor is off, since it
//! compensates no data. Twelve bits per axis in the order x, z, y, big-endian.

use embedded_hal_async::i2c::I2c;

use crate::chip::{self, ChipError, I2cRegisters, MeasuringChip, PollingSchedule};
use crate::magnetometer::driver::Magnetometer;
use autoswing::frames::Field;
use autoswing::reading::{Identity, MagnetometerModel, Reading};

/// Fixed I2C address of the chip.
const I2C_ADDRESS: u8 = 0x1E;
/// Measurement period at 75 Hz.
const PERIOD_US: u32 = 13_333;

const CRA_REG_M: u8 = 0x00;
const OUT_X_H_M: u8 = 0x03;
const SR_REG_M: u8 = 0x09;
const IRA_REG_M: u8 = 0x0A;
const IDENTITY_VALUES: [u8; 3] = *b"H43";
/// `SR_REG_M`: new measurement of all axes.
const DATA_READY: u8 = 0x01;
/// Value of an axis at the end of its range (data sheet section 7.2).
const OVERFLOW_COUNTS: i16 = -4096;

/// `CRA_REG_M`, `CRB_REG_M` and `MR_REG_M`.
const CONTROL_REGISTERS: [u8; 3] = [
    0b0001_1000, // temperature sensor off, 75 Hz
    0b0010_0000, // +-1.3 gauss, as the emulator's model has it
    0b0000_0000, // continuous conversion
];

/// Sensitivity of x and y, and of z, at +-1.3 gauss, counts per gauss (data sheet table 75).
const COUNTS_PER_GAUSS: [f32; 2] = [1100.0, 980.0];

/// LSM303DLHC magnetometer on an I2C bus.
#[derive(Debug)]
pub struct Lsm303dlhc<B> {
    chip: I2cRegisters<B>,
    polling: PollingSchedule,
}

impl<B: I2c> Lsm303dlhc<B> {
    /// Creates a driver; [`init`](MeasuringChip::init) is the first bus access.
    pub const fn new(bus: B) -> Self {
        Self {
            chip: I2cRegisters::new(bus, I2C_ADDRESS),
            polling: PollingSchedule::new(PERIOD_US, chip::SLEEP_PERCENT),
        }
    }
}

impl<B: I2c> MeasuringChip for Lsm303dlhc<B> {
    type BusError = B::Error;
    type Identity = Identity;
    type Measurement = Reading;

    async fn init(&mut self) -> Result<Identity, ChipError<B::Error>> {
        let identity: [u8; 3] = self.chip.read_registers(IRA_REG_M).await?;
        if let Some((_, &unexpected)) = IDENTITY_VALUES.iter().zip(&identity).find(|(expected, read)| expected != read)
        {
            return Err(ChipError::WrongIdentity(unexpected));
        }
        // The address auto-increments in reads, not in writes.
        for (register, value) in (CRA_REG_M..).zip(CONTROL_REGISTERS) {
            self.chip.write_registers(&[register, value]).await?;
        }
        self.verify_configuration().await?;
        // A partial read locks the data until the rest is read, and the first measurement after a range change may have
        // the old range.
        let _old: [u8; 6] = self.chip.read_registers(OUT_X_H_M).await?;
        self.polling.start_sleep();
        Ok(Identity { model: MagnetometerModel::Lsm303dlhc, address: I2C_ADDRESS })
    }

    async fn read_measurement(&mut self) -> Result<Reading, ChipError<B::Error>> {
        let chip = &mut self.chip;
        self.polling
            .wait_for_measurement(async || chip.read_registers(SR_REG_M).await, |[status]| status & DATA_READY != 0)
            .await?;
        let data = self.chip.read_registers(OUT_X_H_M).await?;
        Ok(decode_reading(data))
    }

    async fn verify_configuration(&mut self) -> Result<(), ChipError<B::Error>> {
        chip::compare_readback(CONTROL_REGISTERS, self.chip.read_registers(CRA_REG_M).await?)
    }

    fn period_us(&self) -> u32 {
        PERIOD_US
    }
}

impl<B: I2c> Magnetometer for Lsm303dlhc<B> {
    /// Noise of about one count repeats the middle value in every third reading, at half the noise in every second. 32
    /// in a row then occur about once a month.
    fn equal_readings_until_stuck(&self) -> u16 {
        32
    }
}

/// Decodes six bytes from `OUT_X_H_M` on. The chip's axes are right-handed; it does not report overwritten
/// measurements.
fn decode_reading(data: [u8; 6]) -> Reading {
    let [x_high, x_low, z_high, z_low, y_high, y_low] = data;
    let counts = [[x_high, x_low], [y_high, y_low], [z_high, z_low]].map(i16::from_be_bytes);
    let [xy, z] = COUNTS_PER_GAUSS.map(|counts_per_gauss| 100.0 / counts_per_gauss);
    let [x_count, y_count, z_count] = counts.map(f32::from);
    Reading {
        field: Field::from_ut(x_count * xy, y_count * xy, z_count * z),
        is_saturated: counts.contains(&OVERFLOW_COUNTS),
        was_overwritten: false,
    }
}

#[cfg(test)]
mod tests {
    use embassy_futures::block_on;
    use testkit::simulation::run_script;

    use super::*;
    use crate::chip::registers::{
        SimulatedRegisters, assert_every_bit_is_verified, assert_only_stuck_axes_are_detected,
    };

    fn driver() -> Lsm303dlhc<SimulatedRegisters> {
        Lsm303dlhc::new(SimulatedRegisters::new(0, &[(0x0A, 0x48), (0x0B, 0x34), (0x0C, 0x33)]))
    }

    #[test]
    fn every_configuration_bit_is_verified() {
        block_on(assert_every_bit_is_verified(&mut driver(), |driver| &mut driver.chip.i2c_bus, 0..3));
    }

    /// Noise of one count.
    #[test]
    fn noise_at_rest_seldom_resembles_a_stuck_axis() {
        assert_only_stuck_axes_are_detected(&driver(), 1.0);
    }

    #[test]
    fn init_writes_the_configuration_of_the_data_sheet() {
        let mut driver = driver();
        let identity = block_on(driver.init());
        assert_eq!(identity, Ok(Identity { model: MagnetometerModel::Lsm303dlhc, address: 0x1E }));
        // 75 Hz without temperature, 1.3 gauss, continuous: data sheet sections 7.2.1 to 7.2.3.
        assert_eq!(driver.chip.i2c_bus.values[..3], [0x18, 0x20, 0x00]);
        assert!(driver.chip.i2c_bus.was_read[0x03..0x09].iter().all(|&was_read| was_read), "the data are read once");
    }

    #[test]
    fn every_identity_register_is_checked() {
        for register in 0x0A..0x0D {
            let mut driver = driver();
            driver.chip.i2c_bus.values[register] = 0xEE;
            assert_eq!(block_on(driver.init()), Err(ChipError::WrongIdentity(0xEE)));
            assert_eq!(driver.chip.i2c_bus.values[..3], [0; 3], "not configured");
        }
    }

    /// -0.25 gauss on y: 275 counts.
    fn with_measurement(status: u8) -> Lsm303dlhc<SimulatedRegisters> {
        let mut driver = driver();
        driver.chip.i2c_bus.values[0x09] = status;
        driver.chip.i2c_bus.values[0x07..0x09].copy_from_slice(&(-275_i16).to_be_bytes());
        driver
    }

    #[test]
    fn a_measurement_is_read_when_the_status_reports_it() {
        for status in [0x01, 0x03] {
            let reading = block_on(with_measurement(status).read_measurement()).unwrap();
            assert!((reading.field.ut.y + 25.0).abs() < 1e-4 && !reading.is_saturated, "{reading:?}");
        }
        assert_eq!(with_measurement(0).period_us(), 13_333, "75 Hz");
    }

    /// The lock bit alone is no measurement.
    #[test]
    fn old_measurements_are_not_returned() {
        for status in [0x00, 0x02, 0xFE] {
            run_script(async move {
                assert_eq!(with_measurement(status).read_measurement().await, Err(ChipError::NoData));
            });
        }
    }

    /// 1 gauss on x, -0.5 on y, 0.25 on z at 1100 and 980 counts per gauss, order x, z, y.
    #[test]
    fn counts_become_microtesla_on_the_chips_axes() {
        let [x, y, z] = [1100_i16, -550, 245].map(i16::to_be_bytes);
        let reading = decode_reading([x[0], x[1], z[0], z[1], y[0], y[1]]);
        assert_eq!(reading.field, Field::from_ut(100.0, -50.0, 25.0));
        assert!(!reading.is_saturated && !reading.was_overwritten);
    }

    #[test]
    fn the_overflow_code_on_any_axis_is_saturation() {
        for axis in 0..3 {
            let mut data = [0; 6];
            data[2 * axis..2 * axis + 2].copy_from_slice(&[0xF0, 0x00]);
            assert!(decode_reading(data).is_saturated);
        }
        assert!(!decode_reading([0xF8, 0x00, 0x07, 0xFF, 0, 0]).is_saturated, "the ends of the range are data");
    }
}
