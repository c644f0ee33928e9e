//! What the drivers share: registers behind an I2C address, and asking for the next measurement in time.

use embassy_time::{Duration, Instant, Timer};
use embedded_hal_async::i2c::I2c;

use super::Error;

/// How often to ask once a measurement is due. It bounds the age of a measurement when it is read, whatever the chip's
/// period.
const POLL: Duration = Duration::from_micros(500);

/// A chip's registers.
#[derive(Debug)]
pub(super) struct Chip<B> {
    pub bus: B,
    address: u8,
}

impl<B: I2c> Chip<B> {
    pub const fn new(bus: B, address: u8) -> Self {
        Self { bus, address }
    }

    /// So many registers from the first on.
    pub async fn registers<const N: usize>(&mut self, first: u8) -> Result<[u8; N], Error<B::Error>> {
        let mut values = [0; N];
        self.bus.write_read(self.address, &[first], &mut values).await.map_err(Error::Bus)?;
        Ok(values)
    }

    /// A register's address and what is to be written there.
    pub async fn write(&mut self, message: &[u8]) -> Result<(), Error<B::Error>> {
        self.bus.write(self.address, message).await.map_err(Error::Bus)
    }
}

/// Whether what was written reads back.
pub(super) fn same<E, const N: usize>(written: [u8; N], read: [u8; N]) -> Result<(), Error<E>> {
    match written.into_iter().zip(read).find(|(written, read)| written != read) {
        Some((written, read)) => Err(Error::Configuration { written, read }),
        None => Ok(()),
    }
}

/// Sleeps through most of the time between two measurements, then asks until there is one.
#[derive(Debug)]
pub(super) struct Polling {
    /// From one measurement to the next, as the data sheet says.
    period: Duration,
    wake_at: Instant,
}

impl Polling {
    /// For a chip that measures so often.
    pub const fn new(period_us: u32) -> Self {
        Self { period: Duration::from_micros(period_us as u64), wake_at: Instant::MIN }
    }

    /// From a measurement until it is worth asking for the next: most of the period, and early enough for a chip that
    /// runs 10 % fast (data sheets give no tolerance of the oscillator): that one's period is 91 % of this.
    const fn sleep(&self) -> Duration {
        Duration::from_micros(self.period.as_micros() * 88 / 100)
    }

    /// After four periods without a measurement the chip has stopped.
    const fn timeout(&self) -> Duration {
        Duration::from_micros(4 * self.period.as_micros())
    }

    /// A measurement was read, or the chip begins to measure.
    pub fn restart(&mut self) {
        self.wake_at = Instant::now() + self.sleep();
    }

    /// Waits for a new measurement; returns the answer that announced it.
    pub async fn next<T, E>(
        &mut self,
        mut ask: impl AsyncFnMut() -> Result<T, Error<E>>,
        is_new: impl Fn(&T) -> bool,
    ) -> Result<T, Error<E>> {
        Timer::at(self.wake_at).await;
        let give_up_at = Instant::now() + self.timeout();
        loop {
            let answer = ask().await?;
            if is_new(&answer) {
                self.restart();
                return Ok(answer);
            }
            if Instant::now() >= give_up_at {
                return Err(Error::NoData);
            }
            Timer::after(POLL).await;
        }
    }
}

#[cfg(test)]
mod tests {
    use std::cell::{Cell, RefCell};
    use std::rc::Rc;

    use testkit::simulation::{Level, Simulation};

    use super::*;

    /// A bus's error.
    #[derive(Clone, Copy, Debug, PartialEq)]
    struct Broken;

    /// How long one question takes on the bus.
    const TRANSFER: Duration = Duration::from_micros(90);

    /// A chip that has measured at every multiple of its period, until it stops.
    #[derive(Clone)]
    struct FakeChip {
        period_us: u64,
        stops_after: Option<u64>,
        /// The last measurement that was read.
        read: Rc<Cell<u64>>,
        /// When it was asked.
        asked_at_us: Rc<RefCell<Vec<u64>>>,
    }

    impl FakeChip {
        fn new(period_us: u64) -> Self {
            Self { period_us, stops_after: None, read: Rc::default(), asked_at_us: Rc::default() }
        }

        /// The number of a measurement that was not read yet.
        async fn ask(&self) -> Result<Option<u64>, Error<Broken>> {
            Timer::after(TRANSFER).await;
            let now_us = Instant::now().as_micros();
            self.asked_at_us.borrow_mut().push(now_us);
            let latest = (now_us / self.period_us).min(self.stops_after.unwrap_or(u64::MAX));
            Ok((latest > self.read.get()).then(|| {
                self.read.set(latest);
                latest
            }))
        }

        async fn next(&self, polling: &mut Polling) -> Result<u64, Error<Broken>> {
            polling.next(async || self.ask().await, Option::is_some).await.map(Option::unwrap)
        }
    }

    /// Runs a script in virtual time to its end.
    fn simulate<F: Future<Output = ()> + 'static>(script: F) {
        let mut simulation = Simulation::new();
        simulation.spawn(Level::Interrupt, "script", script);
        simulation.run_for(10_000_000);
        assert_eq!(simulation.tasks(), 0, "the script did not end");
    }

    /// At the rates of the drivers, at 155 and 200 Hz, and with an oscillator up to 10 % off either way: each
    /// measurement once, none lost, none older than two looks (0.5 ms and a transfer), and the bus is left alone for
    /// most of the time.
    #[test]
    fn every_measurement_is_found_whatever_the_period() {
        for period_us in [13_333, 12_500, 6_452, 5_000] {
            for actual_us in [period_us * 10 / 11, period_us, period_us * 11 / 10] {
                simulate(async move {
                    let chip = FakeChip::new(actual_us);
                    let mut polling = Polling::new(period_us as u32);
                    for number in 1..=50 {
                        assert_eq!(chip.next(&mut polling).await, Ok(number), "{actual_us} for {period_us} us");
                        let age_us = Instant::now().as_micros() - number * actual_us;
                        assert!(age_us <= 590, "{age_us} us old, {actual_us} for {period_us} us");
                    }
                    // Of a slow chip a fifth of the period is spent asking; the first is asked for from the start.
                    let asked = chip.asked_at_us.borrow().len() as u64;
                    assert!(asked <= 50 * (2 + actual_us / 5 / 590) + actual_us / 590, "{asked} for {actual_us}");
                });
            }
        }
    }

    /// 88 % of 12.5 ms are 11 ms; the first look is one transfer later. Then one every 0.5 ms and a transfer.
    #[test]
    fn looks_begin_at_88_percent_of_the_period_and_are_half_a_millisecond_apart() {
        for (period_us, first_us) in [(12_500, 11_000), (5_000, 4_400), (6_450, 5_676)] {
            simulate(async move {
                let chip = FakeChip::new(u64::from(period_us));
                let mut polling = Polling::new(period_us);
                polling.restart();
                chip.next(&mut polling).await.unwrap();
                let looks = chip.asked_at_us.borrow().clone();
                assert_eq!(looks[0], first_us + 90);
                assert!(looks.windows(2).all(|pair| pair[1] - pair[0] == 590), "{looks:?}");
                // And from the measurement on as long again.
                let found_us = Instant::now().as_micros();
                chip.next(&mut polling).await.unwrap();
                assert_eq!(chip.asked_at_us.borrow()[looks.len()], found_us + first_us + 90);
            });
        }
    }

    /// Four periods from the first look; the look that finds the time over is at most 0.5 ms and a transfer late.
    #[test]
    fn a_chip_that_stops_is_given_up_after_four_periods() {
        for period_us in [12_500, 6_452, 5_000] {
            simulate(async move {
                let chip = FakeChip { stops_after: Some(1), ..FakeChip::new(period_us) };
                let mut polling = Polling::new(period_us as u32);
                chip.next(&mut polling).await.unwrap();
                let from_us = Instant::now().as_micros() + period_us * 88 / 100;
                assert_eq!(chip.next(&mut polling).await, Err(Error::NoData));
                let waited_us = Instant::now().as_micros() - from_us;
                assert!((4 * period_us..=4 * period_us + 590).contains(&waited_us), "{waited_us} us of {period_us}");
            });
        }
    }

    /// A reader that comes late asks at once.
    #[test]
    fn a_late_reader_does_not_sleep() {
        simulate(async {
            let chip = FakeChip::new(12_500);
            let mut polling = Polling::new(12_500);
            chip.next(&mut polling).await.unwrap();
            Timer::after_millis(100).await;
            let start = Instant::now();
            chip.next(&mut polling).await.unwrap();
            assert_eq!(start.elapsed(), TRANSFER);
        });
    }

    #[test]
    fn a_bus_that_fails_is_reported_at_once() {
        simulate(async {
            let mut polling = Polling::new(12_500);
            let answer = polling.next(async || Err::<u8, _>(Error::Bus(Broken)), |_| true).await;
            assert_eq!(answer, Err(Error::Bus(Broken)));
            assert_eq!(Instant::now().as_micros(), 0);
        });
    }

    #[test]
    fn the_first_register_that_does_not_hold_is_named() {
        assert_eq!(same::<Broken, 3>([1, 2, 3], [1, 2, 3]), Ok(()));
        assert_eq!(same::<Broken, 3>([1, 2, 3], [1, 9, 8]), Err(Error::Configuration { written: 2, read: 9 }));
    }
}

/// A chip that is nothing but registers, for the drivers' tests.
#[cfg(test)]
pub(super) mod registers {
    use embedded_hal_async::i2c::{ErrorKind, ErrorType, I2c, Operation};
    // Brings the virtual clock.
    use testkit as _;

    use super::super::{Error, Magnetometer};

    pub struct Registers {
        pub values: [u8; 0x80],
        /// A register that refuses to be written.
        pub broken: Option<u8>,
        /// The chip's address; others are not answered.
        pub address: u8,
        /// Set at every register that was read.
        pub was_read: [bool; 0x40],
        /// Bits of the register's address that are not its number.
        flags: u8,
    }

    impl Registers {
        pub fn new(flags: u8, set: &[(u8, u8)]) -> Self {
            let mut values = [0; 0x80];
            for &(register, value) in set {
                values[usize::from(register)] = value;
            }
            Self { values, broken: None, address: 0x1E, was_read: [false; 0x40], flags }
        }

        /// Where a transfer of so many bytes begins: several need the flags that make the chip advance.
        fn first(&self, message: u8, length: usize) -> u8 {
            assert!(length == 1 || message & self.flags == self.flags, "the address does not advance");
            message & !self.flags
        }

        fn write(&mut self, first: u8, values: &[u8]) {
            for (register, &value) in (first..).zip(values) {
                if self.broken != Some(register) {
                    self.values[usize::from(register)] = value;
                }
            }
        }
    }

    /// Flips each bit of each of the registers of a chip that has been initialised: the driver finds it, and initialised
    /// again, as its owner does, mends it.
    pub async fn assert_every_bit_is_verified<D: Magnetometer<BusError = ErrorKind>>(
        driver: &mut D,
        bus: impl Fn(&mut D) -> &mut Registers,
        registers: core::ops::Range<usize>,
    ) {
        driver.init().await.unwrap();
        assert_eq!(driver.verify().await, Ok(()));
        for register in registers {
            for bit in 0..8 {
                let written = bus(driver).values[register];
                bus(driver).values[register] ^= 1 << bit;
                let read = bus(driver).values[register];
                assert_eq!(driver.verify().await, Err(Error::Configuration { written, read }));
                driver.init().await.unwrap();
                assert_eq!(bus(driver).values[register], written);
            }
        }
    }

    impl ErrorType for Registers {
        type Error = ErrorKind;
    }

    impl I2c for Registers {
        async fn transaction(&mut self, address: u8, operations: &mut [Operation<'_>]) -> Result<(), ErrorKind> {
            if address != self.address {
                return Err(ErrorKind::Other);
            }
            match operations {
                [Operation::Write(message)] => {
                    let first = self.first(message[0], message.len() - 1);
                    self.write(first, &message[1..]);
                }
                [Operation::Write(message), Operation::Read(buffer)] => {
                    let first = usize::from(self.first(message[0], buffer.len()));
                    let registers = first..first + buffer.len();
                    buffer.copy_from_slice(&self.values[registers.clone()]);
                    self.was_read[registers].fill(true);
                }
                _ => unreachable!("drivers write, or write and read"),
            }
            Ok(())
        }
    }
}
