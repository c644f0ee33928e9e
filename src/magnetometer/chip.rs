//! Common parts of the drivers: register access and polling.

use embassy_time::{Duration, Instant, Timer};
use embedded_hal_async::i2c::I2c;
use embedded_hal_async::spi::{Operation, SpiDevice};

use super::MagnetometerError;

/// Polling interval once a measurement is due; bounds its age when read.
const POLL_INTERVAL: Duration = Duration::from_micros(500);

/// Chip registers at an I2C address.
#[derive(Debug)]
pub(super) struct I2cRegisters<B> {
    pub i2c_bus: B,
    address: u8,
}

impl<B: I2c> I2cRegisters<B> {
    pub const fn new(bus: B, address: u8) -> Self {
        Self { i2c_bus: bus, address }
    }

    /// Reads `N` registers from `first` on.
    pub async fn read_registers<const N: usize>(&mut self, first: u8) -> Result<[u8; N], MagnetometerError<B::Error>> {
        let mut values = [0; N];
        self.i2c_bus.write_read(self.address, &[first], &mut values).await.map_err(MagnetometerError::Bus)?;
        Ok(values)
    }

    /// Writes a register address and values.
    pub async fn write_registers(&mut self, message: &[u8]) -> Result<(), MagnetometerError<B::Error>> {
        self.i2c_bus.write(self.address, message).await.map_err(MagnetometerError::Bus)
    }
}

/// Address flag of a read on an SPI bus.
const SPI_READ: u8 = 0x80;

/// Chip registers on an SPI bus.
#[derive(Debug)]
pub(super) struct SpiRegisters<S> {
    pub spi_device: S,
}

impl<S: SpiDevice> SpiRegisters<S> {
    pub const fn new(device: S) -> Self {
        Self { spi_device: device }
    }

    /// Reads `N` registers from `first` on.
    pub async fn read_registers<const N: usize>(&mut self, first: u8) -> Result<[u8; N], MagnetometerError<S::Error>> {
        let mut values = [0; N];
        let mut transfer = [Operation::Write(&[first | SPI_READ]), Operation::Read(&mut values)];
        self.spi_device.transaction(&mut transfer).await.map_err(MagnetometerError::Bus)?;
        Ok(values)
    }

    /// Writes a register address and values.
    pub async fn write_registers(&mut self, message: &[u8]) -> Result<(), MagnetometerError<S::Error>> {
        self.spi_device.write(message).await.map_err(MagnetometerError::Bus)
    }
}

/// Compares written and read-back values.
pub(super) fn compare_readback<E, const N: usize>(written: [u8; N], read: [u8; N]) -> Result<(), MagnetometerError<E>> {
    match written.into_iter().zip(read).find(|(written, read)| written != read) {
        Some((written, read)) => Err(MagnetometerError::Configuration { written, read }),
        None => Ok(()),
    }
}

/// Share of the period slept for an oscillator up to 10 % fast, whose period is 91 % of nominal.
pub(super) const SLEEP_PERCENT: u32 = 88;

/// Sleeps most of the measurement period, then polls.
#[derive(Debug)]
pub(super) struct PollingSchedule {
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
        mut read_status: impl AsyncFnMut() -> Result<T, MagnetometerError<E>>,
        is_new: impl Fn(&T) -> bool,
    ) -> Result<T, MagnetometerError<E>> {
        Timer::at(self.wake_at).await;
        let timeout_at = Instant::now() + self.poll_timeout();
        loop {
            let status = read_status().await?;
            if is_new(&status) {
                self.start_sleep();
                return Ok(status);
            }
            if Instant::now() >= timeout_at {
                return Err(MagnetometerError::NoData);
            }
            Timer::after(POLL_INTERVAL).await;
        }
    }
}

#[cfg(test)]
mod tests {
    use std::cell::{Cell, RefCell};
    use std::rc::Rc;

    use testkit::simulation::{Level, Simulation};

    use super::*;

    /// Bus error.
    #[derive(Clone, Copy, Debug, PartialEq)]
    struct BusFailure;

    /// Duration of a status transfer.
    const STATUS_TRANSFER_TIME: Duration = Duration::from_micros(90);

    /// Simulated chip that measures at multiples of its period.
    #[derive(Clone)]
    struct FakeChip {
        period_us: u64,
        stops_after_measurement: Option<u64>,
        /// Last measurement read.
        last_read_number: Rc<Cell<u64>>,
        /// Times of status requests.
        status_requested_at_us: Rc<RefCell<Vec<u64>>>,
    }

    impl FakeChip {
        fn new(period_us: u64) -> Self {
            Self {
                period_us,
                stops_after_measurement: None,
                last_read_number: Rc::default(),
                status_requested_at_us: Rc::default(),
            }
        }

        /// Number of an unread measurement.
        async fn poll_status(&self) -> Result<Option<u64>, MagnetometerError<BusFailure>> {
            Timer::after(STATUS_TRANSFER_TIME).await;
            let now_us = Instant::now().as_micros();
            self.status_requested_at_us.borrow_mut().push(now_us);
            let latest = (now_us / self.period_us).min(self.stops_after_measurement.unwrap_or(u64::MAX));
            Ok((latest > self.last_read_number.get()).then(|| {
                self.last_read_number.set(latest);
                latest
            }))
        }

        async fn wait_for_measurement(
            &self,
            polling: &mut PollingSchedule,
        ) -> Result<u64, MagnetometerError<BusFailure>> {
            polling.wait_for_measurement(async || self.poll_status().await, Option::is_some).await.map(Option::unwrap)
        }
    }

    /// Runs a script in virtual time until it ends.
    fn simulate<F: Future<Output = ()> + 'static>(script: F) {
        let mut simulation = Simulation::new();
        simulation.spawn(Level::Interrupt, "script", script);
        simulation.run_for(10_000_000);
        assert_eq!(simulation.task_count(), 0, "the script did not end");
    }

    /// Rates of 75 to 200 Hz, oscillators off by 10 %, an RM3100's by 21 %. Each measurement is read once within two
    /// polls (0.5 ms and a transfer each), and the bus is mostly idle.
    #[test]
    fn every_measurement_is_found_whatever_the_period() {
        for (period_us, tolerance, sleep_percent) in
            [(13_333, 10, 88), (12_500, 10, 88), (6_452, 10, 88), (5_000, 10, 88), (13_333, 21, 79)]
        {
            for actual_us in [period_us * 100 / (100 + tolerance), period_us, period_us * (100 + tolerance) / 100] {
                simulate(async move {
                    let chip = FakeChip::new(actual_us);
                    let mut polling = PollingSchedule::new(period_us as u32, sleep_percent);
                    for number in 1..=50 {
                        assert_eq!(
                            chip.wait_for_measurement(&mut polling).await,
                            Ok(number),
                            "{actual_us} for {period_us} us"
                        );
                        let age_us = Instant::now().as_micros() - number * actual_us;
                        assert!(age_us <= 590, "{age_us} us old, {actual_us} for {period_us} us");
                    }
                    // The chip is polled for the rest of each period, and for the whole of the first one.
                    let polls = chip.status_requested_at_us.borrow().len() as u64;
                    let polled_us = actual_us - period_us * u64::from(sleep_percent) / 100;
                    assert!(polls <= 50 * (2 + polled_us / 590) + actual_us / 590, "{polls} for {actual_us}");
                });
            }
        }
    }

    /// 88 % of 12.5 ms are 11 ms; each poll is 0.5 ms plus a transfer.
    #[test]
    fn polls_begin_at_88_percent_of_the_period_half_a_millisecond_apart() {
        for (period_us, first_us) in [(12_500, 11_000), (5_000, 4_400), (6_450, 5_676)] {
            simulate(async move {
                let chip = FakeChip::new(u64::from(period_us));
                let mut polling = PollingSchedule::new(period_us, SLEEP_PERCENT);
                polling.start_sleep();
                chip.wait_for_measurement(&mut polling).await.unwrap();
                let poll_times_us = chip.status_requested_at_us.borrow().clone();
                assert_eq!(poll_times_us[0], first_us + 90);
                assert!(poll_times_us.windows(2).all(|pair| pair[1] - pair[0] == 590), "{poll_times_us:?}");
                // The driver sleeps from the measurement on.
                let found_us = Instant::now().as_micros();
                chip.wait_for_measurement(&mut polling).await.unwrap();
                assert_eq!(chip.status_requested_at_us.borrow()[poll_times_us.len()], found_us + first_us + 90);
            });
        }
    }

    /// Four periods from the first poll, at most one poll late.
    #[test]
    fn a_stopped_chip_times_out_after_four_periods() {
        for period_us in [12_500, 6_452, 5_000] {
            simulate(async move {
                let chip = FakeChip { stops_after_measurement: Some(1), ..FakeChip::new(period_us) };
                let mut polling = PollingSchedule::new(period_us as u32, SLEEP_PERCENT);
                chip.wait_for_measurement(&mut polling).await.unwrap();
                let from_us = Instant::now().as_micros() + period_us * 88 / 100;
                assert_eq!(chip.wait_for_measurement(&mut polling).await, Err(MagnetometerError::NoData));
                let waited_us = Instant::now().as_micros() - from_us;
                assert!((4 * period_us..=4 * period_us + 590).contains(&waited_us), "{waited_us} us of {period_us}");
            });
        }
    }

    #[test]
    fn a_late_reader_polls_at_once() {
        simulate(async {
            let chip = FakeChip::new(12_500);
            let mut polling = PollingSchedule::new(12_500, SLEEP_PERCENT);
            chip.wait_for_measurement(&mut polling).await.unwrap();
            Timer::after_millis(100).await;
            let start = Instant::now();
            chip.wait_for_measurement(&mut polling).await.unwrap();
            assert_eq!(start.elapsed(), STATUS_TRANSFER_TIME);
        });
    }

    #[test]
    fn a_bus_failure_is_reported_at_once() {
        simulate(async {
            let mut polling = PollingSchedule::new(12_500, SLEEP_PERCENT);
            let answer =
                polling.wait_for_measurement(async || Err::<u8, _>(MagnetometerError::Bus(BusFailure)), |_| true).await;
            assert_eq!(answer, Err(MagnetometerError::Bus(BusFailure)));
            assert_eq!(Instant::now().as_micros(), 0);
        });
    }

    #[test]
    fn the_first_register_that_reads_back_differently_is_reported() {
        assert_eq!(compare_readback::<BusFailure, 3>([1, 2, 3], [1, 2, 3]), Ok(()));
        assert_eq!(
            compare_readback::<BusFailure, 3>([1, 2, 3], [1, 9, 8]),
            Err(MagnetometerError::Configuration { written: 2, read: 9 })
        );
    }
}

/// Register-level chip model for driver tests.
#[cfg(test)]
pub(super) mod registers {
    use embedded_hal_async::i2c::{ErrorKind, ErrorType, I2c, Operation};
    use embedded_hal_async::spi::{self, SpiDevice};
    // Links the virtual clock.
    use testkit as _;

    use super::super::{Magnetometer, MagnetometerError};

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

    /// Flips each bit of the registers of an initialised chip; the driver must detect it, and restore it by `init`.
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
                assert_eq!(
                    driver.verify_configuration().await,
                    Err(MagnetometerError::Configuration { written, read })
                );
                driver.init().await.unwrap();
                assert_eq!(bus(driver).values[register], written);
            }
        }
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
