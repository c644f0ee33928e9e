//! Common parts of the drivers: register access, polling and errors.

mod error;
mod measuring_chip;

use embassy_time::{Duration, Instant, Timer};
use embedded_hal_async::i2c::I2c;
use embedded_hal_async::spi::{Operation, SpiDevice};

pub use error::ChipError;
pub use measuring_chip::MeasuringChip;

/// Polling interval once a measurement is due; bounds its age when read.
const POLL_INTERVAL: Duration = Duration::from_micros(500);

/// Chip registers at an I2C address.
#[derive(Debug)]
pub(crate) struct I2cRegisters<B> {
    pub i2c_bus: B,
    address: u8,
}

impl<B: I2c> I2cRegisters<B> {
    pub const fn new(bus: B, address: u8) -> Self {
        Self { i2c_bus: bus, address }
    }

    /// Reads `N` registers from `first` on.
    pub async fn read_registers<const N: usize>(&mut self, first: u8) -> Result<[u8; N], ChipError<B::Error>> {
        let mut values = [0; N];
        self.i2c_bus.write_read(self.address, &[first], &mut values).await.map_err(ChipError::Bus)?;
        Ok(values)
    }

    /// Writes a register address and values.
    pub async fn write_registers(&mut self, message: &[u8]) -> Result<(), ChipError<B::Error>> {
        self.i2c_bus.write(self.address, message).await.map_err(ChipError::Bus)
    }
}

/// Address flag of a read on an SPI bus.
const SPI_READ: u8 = 0x80;

/// Chip registers on an SPI bus.
#[derive(Debug)]
pub(crate) struct SpiRegisters<S> {
    pub spi_device: S,
}

impl<S: SpiDevice> SpiRegisters<S> {
    pub const fn new(device: S) -> Self {
        Self { spi_device: device }
    }

    /// Reads `N` registers from `first` on.
    pub async fn read_registers<const N: usize>(&mut self, first: u8) -> Result<[u8; N], ChipError<S::Error>> {
        let mut values = [0; N];
        let mut transfer = [Operation::Write(&[first | SPI_READ]), Operation::Read(&mut values)];
        self.spi_device.transaction(&mut transfer).await.map_err(ChipError::Bus)?;
        Ok(values)
    }

    /// Writes a register address and values.
    pub async fn write_registers(&mut self, message: &[u8]) -> Result<(), ChipError<S::Error>> {
        self.spi_device.write(message).await.map_err(ChipError::Bus)
    }
}

/// Compares written and read-back values.
pub(crate) fn compare_readback<E, const N: usize>(written: [u8; N], read: [u8; N]) -> Result<(), ChipError<E>> {
    match written.into_iter().zip(read).find(|(written, read)| written != read) {
        Some((written, read)) => Err(ChipError::Configuration { written, read }),
        None => Ok(()),
    }
}

/// Share of the period slept for an oscillator up to 10 % fast, whose period is 91 % of nominal.
pub(crate) const SLEEP_PERCENT: u32 = 88;

/// Sleeps most of the measurement period, then polls.
#[derive(Debug)]
pub(crate) struct PollingSchedule {
    /// Nominal measurement period.
    period: Duration,
    /// Sleep after a measurement.
    sleep_duration: Duration,
    wake_at: Instant,
}

impl PollingSchedule {
    /// Creates the schedule of a measurement period. The chip's shortest period must exceed `sleep_percent` of it:
    /// otherwise readings are up to a period old.
    pub const fn new(period_us: u32, sleep_percent: u32) -> Self {
        let sleep_us = period_us as u64 * sleep_percent as u64 / 100;
        Self {
            period: Duration::from_micros(period_us as u64),
            sleep_duration: Duration::from_micros(sleep_us),
            wake_at: Instant::MIN,
        }
    }

    /// Timeout of four periods.
    const fn poll_timeout(&self) -> Duration {
        Duration::from_micros(4 * self.period.as_micros())
    }

    /// Starts the sleep, after a measurement or at the start of measuring.
    pub fn start_sleep(&mut self) {
        self.wake_at = Instant::now() + self.sleep_duration;
    }

    /// Waits for a new measurement; returns the status that announced it.
    pub async fn wait_for_measurement<T, E>(
        &mut self,
        mut read_status: impl AsyncFnMut() -> Result<T, ChipError<E>>,
        is_new: impl Fn(&T) -> bool,
    ) -> Result<T, ChipError<E>> {
        Timer::at(self.wake_at).await;
        let timeout_at = Instant::now() + self.poll_timeout();
        loop {
            let status = read_status().await?;
            if is_new(&status) {
                self.start_sleep();
                return Ok(status);
            }
            if Instant::now() >= timeout_at {
                return Err(ChipError::NoData);
            }
            Timer::after(POLL_INTERVAL).await;
        }
    }
}

/// Register-level chip model for driver tests.
#[cfg(test)]
pub(crate) mod registers {
    use embedded_hal_async::i2c::{ErrorKind, ErrorType, I2c, Operation};
    use embedded_hal_async::spi::{self, SpiDevice};

    use crate::chip::ChipError;
    use crate::magnetometer::Magnetometer;

    pub struct SimulatedRegisters {
        pub values: [u8; 0x80],
        /// Registers that ignore writes.
        pub write_protected: Vec<u8>,
        /// Registers and values written so far.
        pub write_log: Vec<(u8, u8)>,
        /// Chip address; others are not acknowledged.
        pub address: u8,
        /// Registers read so far.
        pub was_read: [bool; 0x40],
        /// Flag bits of a register address.
        address_flags: u8,
    }

    impl SimulatedRegisters {
        pub fn new(address_flags: u8, initial_values: &[(u8, u8)]) -> Self {
            let mut values = [0; 0x80];
            for &(register, value) in initial_values {
                values[usize::from(register)] = value;
            }
            Self {
                values,
                write_protected: Vec::new(),
                write_log: Vec::new(),
                address: 0x1E,
                was_read: [false; 0x40],
                address_flags,
            }
        }

        /// First register of a transfer; longer transfers need the auto-increment flags.
        fn first_register(&self, message: u8, length: usize) -> u8 {
            assert!(length == 1 || message & self.address_flags == self.address_flags, "the address does not advance");
            message & !self.address_flags
        }

        fn read(&mut self, first: u8, buffer: &mut [u8]) {
            let registers = usize::from(first)..usize::from(first) + buffer.len();
            buffer.copy_from_slice(&self.values[registers.clone()]);
            self.was_read[registers].fill(true);
        }

        fn write(&mut self, first: u8, values: &[u8]) {
            for (register, &value) in (first..).zip(values) {
                self.write_log.push((register, value));
                if !self.write_protected.contains(&register) {
                    self.values[usize::from(register)] = value;
                }
            }
        }
    }

    /// Flips each bit of the registers of an initialised chip; the driver must detect it, and restore it by `init`, which
    /// fails if it cannot.
    pub async fn assert_every_bit_is_verified<D: Magnetometer<BusError: PartialEq>>(
        driver: &mut D,
        bus: impl Fn(&mut D) -> &mut SimulatedRegisters,
        registers: core::ops::Range<usize>,
    ) {
        driver.init().await.unwrap();
        assert_eq!(driver.verify_configuration().await, Ok(()));
        for register in registers {
            for bit in 0..8 {
                let written = bus(driver).values[register];
                bus(driver).values[register] ^= 1 << bit;
                let read = bus(driver).values[register];
                assert_eq!(driver.verify_configuration().await, Err(ChipError::Configuration { written, read }));
                bus(driver).write_protected.push(register as u8);
                assert_eq!(driver.init().await, Err(ChipError::Configuration { written, read }));
                bus(driver).write_protected.pop();
                driver.init().await.unwrap();
                assert_eq!(bus(driver).values[register], written);
            }
        }
    }

    /// Asserts that a stuck axis is detected before a turn has changed the field unnoticed, and that noise at rest of
    /// this standard deviation, counts, with the field at the middle of a count, resembles one less than once a year.
    pub fn assert_only_stuck_axes_are_detected(driver: &impl Magnetometer, sigma_counts: f64) {
        const MAX_DETECTION_S: f64 = 0.7;
        let (count, period_s) = (f64::from(driver.equal_readings_until_stuck()), f64::from(driver.period_us()) * 1e-6);
        let most_frequent = libm::erf(0.5 / (sigma_counts * core::f64::consts::SQRT_2));
        let runs_a_day = 3.0 * 86_400.0 / period_s * most_frequent.powf(count) * (1.0 - most_frequent);
        assert!(runs_a_day < 1.0 / 365.0, "{runs_a_day} a day");
        assert!(count * period_s < MAX_DETECTION_S, "{count} readings");
    }

    impl ErrorType for SimulatedRegisters {
        type Error = ErrorKind;
    }

    impl I2c for SimulatedRegisters {
        async fn transaction(&mut self, address: u8, operations: &mut [Operation<'_>]) -> Result<(), ErrorKind> {
            if address != self.address {
                return Err(ErrorKind::Other);
            }
            match operations {
                [Operation::Write(message)] => {
                    let first = self.first_register(message[0], message.len() - 1);
                    self.write(first, &message[1..]);
                }
                [Operation::Write(message), Operation::Read(buffer)] => {
                    let first = self.first_register(message[0], buffer.len());
                    self.read(first, buffer);
                }
                _ => unreachable!("drivers write, or write and read"),
            }
            Ok(())
        }
    }

    impl spi::ErrorType for SimulatedRegisters {
        type Error = spi::ErrorKind;
    }

    impl SpiDevice for SimulatedRegisters {
        async fn transaction(&mut self, operations: &mut [spi::Operation<'_, u8>]) -> Result<(), spi::ErrorKind> {
            match operations {
                [spi::Operation::Write([register @ 0..0x80, values @ ..])] => self.write(*register, values),
                [spi::Operation::Write([register @ 0x80..=0xFF, ..]), spi::Operation::Read(buffer)] => {
                    self.read(register & 0x7F, buffer);
                }
                _ => unreachable!("drivers write, or write an address with the flag of a read and read"),
            }
            Ok(())
        }
    }
}

#[cfg(test)]
mod tests;
