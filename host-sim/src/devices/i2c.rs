//! An I2C bus in fast mode (400 kHz) with devices at their addresses.

use std::cell::RefCell;
use std::rc::Rc;

use embassy_time::{Duration, Timer};
use embedded_hal_async::i2c::{Error, ErrorKind, ErrorType, I2c, NoAcknowledgeSource, Operation, SevenBitAddress};

/// Nine clocks (eight bits and the acknowledge) at 400 kHz: 22.5 us a byte.
const NANOSECONDS_PER_BYTE: u64 = 22_500;

/// A device on the bus.
pub trait Target {
    /// Whether the device answers to this address now.
    fn acknowledges(&self, address: SevenBitAddress) -> bool;

    /// Bytes written to the device, from a start condition to the next start or stop.
    fn write(&mut self, bytes: &[u8]);

    /// Fills `bytes` as the device would.
    fn read(&mut self, bytes: &mut [u8]);
}

/// A device that is on the bus and in somebody's hands, who can make it fail.
pub type SharedTarget = Rc<RefCell<dyn Target>>;

/// What can go wrong on the bus.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BusError {
    /// Nothing answered at this address.
    NoAcknowledge(SevenBitAddress),
}

impl Error for BusError {
    fn kind(&self) -> ErrorKind {
        match self {
            Self::NoAcknowledge(_) => ErrorKind::NoAcknowledge(NoAcknowledgeSource::Address),
        }
    }
}

/// The bus: a handle, cloned freely. A transaction takes the time of its bytes and happens at its end.
#[derive(Clone, Default)]
pub struct Bus {
    targets: Rc<RefCell<Vec<SharedTarget>>>,
}

impl Bus {
    /// A bus with nothing on it.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// Connects a device.
    pub fn attach(&self, target: SharedTarget) {
        self.targets.borrow_mut().push(target);
    }

    fn target_at(&self, address: SevenBitAddress) -> Option<SharedTarget> {
        self.targets.borrow().iter().find(|target| target.borrow().acknowledges(address)).cloned()
    }
}

impl ErrorType for Bus {
    type Error = BusError;
}

impl I2c for Bus {
    async fn transaction(
        &mut self,
        address: SevenBitAddress,
        operations: &mut [Operation<'_>],
    ) -> Result<(), Self::Error> {
        let Some(target) = self.target_at(address) else {
            Timer::after(bus_time(1)).await;
            return Err(BusError::NoAcknowledge(address));
        };
        // Every operation repeats the address. (Adjacent operations of one kind would not: no driver here has them.)
        let bytes: usize = operations.iter().map(|operation| 1 + length(operation)).sum();
        Timer::after(bus_time(bytes)).await;
        let mut target = target.borrow_mut();
        for operation in operations {
            match operation {
                Operation::Write(bytes) => target.write(bytes),
                Operation::Read(bytes) => target.read(bytes),
            }
        }
        Ok(())
    }
}

fn length(operation: &Operation<'_>) -> usize {
    match operation {
        Operation::Write(bytes) => bytes.len(),
        Operation::Read(bytes) => bytes.len(),
    }
}

fn bus_time(bytes: usize) -> Duration {
    Duration::from_micros((bytes as u64 * NANOSECONDS_PER_BYTE).div_ceil(1000))
}
