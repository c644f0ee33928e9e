//! SPI bus at 1 MHz with one device.

use std::cell::RefCell;
use std::convert::Infallible;
use std::rc::Rc;

use embassy_time::{Duration, Timer};
use embedded_hal_async::spi::{ErrorType, Operation, SpiDevice};

/// Duration of a byte on the SPI bus: eight clocks at 1 MHz.
const MICROSECONDS_PER_BYTE: u64 = 8;

/// Device on the bus.
pub trait SimulatedSpiDevice {
    /// Bytes written by the master, the first of them the register address.
    fn write_bytes(&mut self, bytes: &[u8]);

    /// Fills `bytes` with the device's data, from the register address written before in the same selection.
    fn read_bytes(&mut self, bytes: &mut [u8]);
}

/// Device selected by its own chip select. A transaction takes the time of its bytes and takes effect at its end.
#[derive(Clone)]
pub struct SelectedDevice(Rc<RefCell<dyn SimulatedSpiDevice>>);

impl SelectedDevice {
    /// Connects a device to its own bus.
    #[must_use]
    pub fn new(target: Rc<RefCell<dyn SimulatedSpiDevice>>) -> Self {
        Self(target)
    }
}

impl ErrorType for SelectedDevice {
    type Error = Infallible;
}

impl SpiDevice for SelectedDevice {
    async fn transaction(&mut self, operations: &mut [Operation<'_, u8>]) -> Result<(), Infallible> {
        Timer::after(operations.iter().map(transfer_duration).sum()).await;
        let mut target = self.0.borrow_mut();
        for operation in operations {
            match operation {
                Operation::Write(bytes) => target.write_bytes(bytes),
                Operation::Read(bytes) => target.read_bytes(bytes),
                Operation::Transfer(..) | Operation::TransferInPlace(_) => unimplemented!("no driver uses them"),
                Operation::DelayNs(_) => {}
            }
        }
        Ok(())
    }
}

fn transfer_duration(operation: &Operation<'_, u8>) -> Duration {
    let bytes = match operation {
        Operation::Write(bytes) => bytes.len(),
        Operation::Read(bytes) | Operation::Transfer(bytes, _) | Operation::TransferInPlace(bytes) => bytes.len(),
        Operation::DelayNs(ns) => return Duration::from_micros(u64::from(*ns).div_ceil(1000)),
    };
    Duration::from_micros(bytes as u64 * MICROSECONDS_PER_BYTE)
}
