//! I2C bus in fast mode (400 kHz).

use std::cell::{Cell, RefCell};
use std::rc::Rc;

use embassy_time::{Duration, Instant, Timer};
use embedded_hal_async::i2c::{Error, ErrorKind, ErrorType, I2c, NoAcknowledgeSource, Operation, SevenBitAddress};

/// Nine clocks (eight bits and the acknowledge) at 400 kHz: 22.5 us per byte.
const NANOSECONDS_PER_BYTE: u64 = 22_500;

/// Device on the bus.
pub trait SimulatedI2cDevice {
    /// Whether the device acknowledges this address now.
    fn acknowledges_address(&self, address: SevenBitAddress) -> bool;

    /// Bytes written between a start condition and the next start or stop.
    fn write_bytes(&mut self, bytes: &[u8]);

    /// Fills `bytes` with the device's data.
    fn read_bytes(&mut self, bytes: &mut [u8]);
}

/// Device shared between the bus and a test that injects faults.
pub type SharedI2cDevice = Rc<RefCell<dyn SimulatedI2cDevice>>;

/// Error of a transaction on the bus.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BusError {
    /// No device acknowledged this address.
    NoAcknowledge(SevenBitAddress),
}

impl Error for BusError {
    fn kind(&self) -> ErrorKind {
        match self {
            Self::NoAcknowledge(_) => ErrorKind::NoAcknowledge(NoAcknowledgeSource::Address),
        }
    }
}

/// Cloneable handle to the bus. A transaction waits for earlier ones, takes the time of its bytes and takes effect at its
/// end.
#[derive(Clone, Default)]
pub struct SimulatedI2cBus {
    devices: Rc<RefCell<Vec<SharedI2cDevice>>>,
    busy_until: Rc<Cell<Option<Instant>>>,
}

impl SimulatedI2cBus {
    /// A bus without devices.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// Connects a device to the bus.
    pub fn attach_device(&self, device: SharedI2cDevice) {
        self.devices.borrow_mut().push(device);
    }

    async fn wait_for_transfer(&self, bytes: usize) {
        let now = Instant::now();
        let end = self.busy_until.get().map_or(now, |until| until.max(now)) + transfer_duration(bytes);
        self.busy_until.set(Some(end));
        Timer::at(end).await;
    }

    fn device_at(&self, address: SevenBitAddress) -> Option<SharedI2cDevice> {
        self.devices.borrow().iter().find(|device| device.borrow().acknowledges_address(address)).cloned()
    }
}

impl ErrorType for SimulatedI2cBus {
    type Error = BusError;
}

impl I2c for SimulatedI2cBus {
    async fn transaction(
        &mut self,
        address: SevenBitAddress,
        operations: &mut [Operation<'_>],
    ) -> Result<(), Self::Error> {
        let Some(device) = self.device_at(address) else {
            self.wait_for_transfer(1).await;
            return Err(BusError::NoAcknowledge(address));
        };
        // Each operation sends the address. By embedded-hal adjacent writes, or reads, share one address, but no driver
        // has adjacent ones.
        let bytes: usize = operations.iter().map(|operation| 1 + operation_length(operation)).sum();
        self.wait_for_transfer(bytes).await;
        let mut device = device.borrow_mut();
        for operation in operations {
            match operation {
                Operation::Write(bytes) => device.write_bytes(bytes),
                Operation::Read(bytes) => device.read_bytes(bytes),
            }
        }
        Ok(())
    }
}

fn operation_length(operation: &Operation<'_>) -> usize {
    match operation {
        Operation::Write(bytes) => bytes.len(),
        Operation::Read(bytes) => bytes.len(),
    }
}

fn transfer_duration(bytes: usize) -> Duration {
    Duration::from_micros((bytes as u64 * NANOSECONDS_PER_BYTE).div_ceil(1000))
}
