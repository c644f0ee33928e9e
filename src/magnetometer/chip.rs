//! What the drivers share: registers behind an I2C address, and asking for the next measurement in time.

use embassy_time::{Duration, Instant, Timer};
use embedded_hal_async::i2c::I2c;

use super::Error;

/// How often to ask once a measurement is due. It bounds the age of a measurement when it is read, at 4 % of the bus's
/// time.
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
    /// From a measurement until it is worth asking for the next.
    sleep: Duration,
    /// After so long without a measurement the chip has stopped.
    timeout: Duration,
    wake_at: Instant,
}

impl Polling {
    pub const fn new(sleep: Duration, timeout: Duration) -> Self {
        Self { sleep, timeout, wake_at: Instant::MIN }
    }

    /// A measurement was read, or the chip begins to measure.
    pub fn restart(&mut self) {
        self.wake_at = Instant::now() + self.sleep;
    }

    /// Waits for a new measurement; returns the answer that announced it.
    pub async fn next<T, E>(
        &mut self,
        mut ask: impl AsyncFnMut() -> Result<T, Error<E>>,
        is_new: impl Fn(&T) -> bool,
    ) -> Result<T, Error<E>> {
        Timer::at(self.wake_at).await;
        let give_up_at = Instant::now() + self.timeout;
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

/// A chip that is nothing but registers, for the drivers' tests.
#[cfg(test)]
pub(super) mod registers {
    use core::convert::Infallible;

    use embedded_hal_async::i2c::{ErrorType, I2c, Operation};
    // Brings the virtual clock.
    use testkit as _;

    pub struct Registers {
        pub values: [u8; 0x40],
        /// A register that refuses to be written.
        pub broken: Option<u8>,
        /// Bits of the address that are not the register's number.
        flags: u8,
    }

    impl Registers {
        pub fn new(flags: u8, set: &[(u8, u8)]) -> Self {
            let mut values = [0; 0x40];
            for &(register, value) in set {
                values[usize::from(register)] = value;
            }
            Self { values, broken: None, flags }
        }

        fn write(&mut self, message: &[u8]) -> u8 {
            let first = message[0] & !self.flags;
            for (register, &value) in (first..).zip(&message[1..]) {
                if self.broken != Some(register) {
                    self.values[usize::from(register)] = value;
                }
            }
            first
        }
    }

    impl ErrorType for Registers {
        type Error = Infallible;
    }

    impl I2c for Registers {
        async fn transaction(&mut self, _: u8, operations: &mut [Operation<'_>]) -> Result<(), Infallible> {
            let mut address = 0;
            for operation in operations {
                match operation {
                    Operation::Write(message) => address = usize::from(self.write(message)),
                    Operation::Read(buffer) => buffer.copy_from_slice(&self.values[address..address + buffer.len()]),
                }
            }
            Ok(())
        }
    }
}
