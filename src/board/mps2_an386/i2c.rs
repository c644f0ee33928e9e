//! The sensor's I2C bus: two wires that software moves (SBCon of the MPS2). QEMU's bus takes no time, so no edge waits.

use embedded_hal_async::i2c::{ErrorKind, ErrorType, I2c, NoAcknowledgeSource, Operation};

use super::lockstep;
use super::registers::{Peripheral, Register};

/// Which wires are high; a write lets those wires go.
const SET: Register = Register::of(Peripheral::SensorBus, 0x00);
/// A write pulls those wires low.
const CLEAR: Register = Register::of(Peripheral::SensorBus, 0x04);
const SCL: u32 = 1;
const SDA: u32 = 2;

/// Nobody acknowledged.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct NoAcknowledge(NoAcknowledgeSource);

impl embedded_hal_async::i2c::Error for NoAcknowledge {
    fn kind(&self) -> ErrorKind {
        ErrorKind::NoAcknowledge(self.0)
    }
}

/// The master of the bus.
pub struct SensorBus(());

/// Clocks after which a chip has finished whatever byte it was sending, and seen that nobody acknowledges it.
const CLOCKS_TO_LET_GO: u32 = 9;

#[expect(clippy::unused_self, reason = "the wires move for nobody but the owner of the bus")]
impl SensorBus {
    /// The bus, cleared of what a reset may have broken off.
    pub fn new() -> Self {
        let mut bus = Self(());
        bus.clear();
        bus
    }

    /// Has a chip that holds the data wire let it go.
    fn clear(&mut self) {
        self.take_bits(CLOCKS_TO_LET_GO);
        self.stop();
    }

    fn start(&mut self) {
        SET.write(SDA);
        SET.write(SCL);
        CLEAR.write(SDA);
        CLEAR.write(SCL);
    }

    fn stop(&mut self) {
        CLEAR.write(SDA);
        SET.write(SCL);
        SET.write(SDA);
    }

    /// With as few instructions as there may be: a reading's way is counted, and no board with a bus of its own spends any.
    fn put_bit(&mut self, bit: bool) {
        (if bit { SET } else { CLEAR }).write(SDA);
        SET.write(SCL);
        CLEAR.write(SCL);
    }

    /// So many bits, the highest first, of a chip that has the data wire. A broken wire is high: nobody pulls it.
    fn take_bits(&mut self, number: u32) -> u32 {
        SET.write(SDA);
        let mut bits = 0;
        for _ in 0..number {
            SET.write(SCL);
            bits = bits << 1 | SET.read() & SDA;
            CLEAR.write(SCL);
        }
        if lockstep::sensor_is_broken() { u32::MAX } else { bits / SDA }
    }

    fn put(&mut self, byte: u8, source: NoAcknowledgeSource) -> Result<(), NoAcknowledge> {
        for bit in (0..8).rev() {
            self.put_bit(byte >> bit & 1 != 0);
        }
        if self.take_bits(1) == 0 { Ok(()) } else { Err(NoAcknowledge(source)) }
    }

    fn take(&mut self, is_last: bool) -> u8 {
        let byte = self.take_bits(8) as u8;
        self.put_bit(is_last);
        byte
    }

    fn perform(&mut self, address: u8, operation: &mut Operation<'_>) -> Result<(), NoAcknowledge> {
        self.start();
        let reads = matches!(operation, Operation::Read(_));
        self.put(address << 1 | u8::from(reads), NoAcknowledgeSource::Address)?;
        match operation {
            Operation::Write(bytes) => bytes.iter().try_for_each(|&byte| self.put(byte, NoAcknowledgeSource::Data)),
            Operation::Read(buffer) => {
                let last = buffer.len().saturating_sub(1);
                for (i, byte) in buffer.iter_mut().enumerate() {
                    *byte = self.take(i == last);
                }
                Ok(())
            }
        }
    }
}

impl ErrorType for SensorBus {
    type Error = NoAcknowledge;
}

impl I2c for SensorBus {
    /// Begins each operation with a start condition; the embedded-hal contract asks for one only where direction
    /// changes, which is where this firmware's drivers change operations.
    async fn transaction(&mut self, address: u8, operations: &mut [Operation<'_>]) -> Result<(), NoAcknowledge> {
        lockstep::before_sensor();
        let result = operations.iter_mut().try_for_each(|operation| self.perform(address, operation));
        if result.is_ok() {
            self.stop();
        } else {
            self.clear();
        }
        result
    }
}
