//! Bit-banged I2C bus of the sensor (SBCon of the MPS2). QEMU's bus needs no delays.

use embedded_hal_async::i2c::{ErrorKind, ErrorType, I2c, NoAcknowledgeSource, Operation};

use super::lockstep;
use super::registers::{Peripheral, Register};

/// Register of the line states; writing ones releases lines.
const SET_LINES: Register = Register::at_offset(Peripheral::SensorBus, 0x00);
/// Register in which writing ones pulls lines low.
const CLEAR_LINES: Register = Register::at_offset(Peripheral::SensorBus, 0x04);
const SCL: u32 = 1;
const SDA: u32 = 2;

/// Error of a transfer: the chip did not acknowledge a byte.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct NoAcknowledge(NoAcknowledgeSource);

impl embedded_hal_async::i2c::Error for NoAcknowledge {
    fn kind(&self) -> ErrorKind {
        ErrorKind::NoAcknowledge(self.0)
    }
}

pub struct SensorBus(());

/// Number of clocks after which a chip has completed any byte and seen the missing acknowledge.
const BUS_RECOVERY_CLOCKS: u32 = 9;

#[expect(clippy::unused_self, reason = "the wires move for nobody but the owner of the bus")]
impl SensorBus {
    /// A bus in the idle state.
    pub fn new() -> Self {
        let mut bus = Self(());
        bus.release_data_line();
        bus
    }

    /// Releases a data line held low by a chip.
    fn release_data_line(&mut self) {
        self.read_bits(BUS_RECOVERY_CLOCKS);
        self.stop_condition();
    }

    fn start_condition(&mut self) {
        SET_LINES.write_register(SDA);
        SET_LINES.write_register(SCL);
        CLEAR_LINES.write_register(SDA);
        CLEAR_LINES.write_register(SCL);
    }

    fn stop_condition(&mut self) {
        CLEAR_LINES.write_register(SDA);
        SET_LINES.write_register(SCL);
        SET_LINES.write_register(SDA);
    }

    /// Sends one bit in the fewest instructions: the instruction counts of a reading include them, unlike on a board
    /// with an I2C peripheral.
    fn write_bit(&mut self, bit: bool) {
        (if bit { SET_LINES } else { CLEAR_LINES }).write_register(SDA);
        SET_LINES.write_register(SCL);
        CLEAR_LINES.write_register(SCL);
    }

    /// Reads bits from the chip, most significant first. A broken data line reads high.
    fn read_bits(&mut self, count: u32) -> u32 {
        SET_LINES.write_register(SDA);
        let mut bits = 0;
        for _ in 0..count {
            SET_LINES.write_register(SCL);
            bits = bits << 1 | SET_LINES.read_register() & SDA;
            CLEAR_LINES.write_register(SCL);
        }
        if lockstep::sensor_is_broken() { u32::MAX } else { bits / SDA }
    }

    fn write_byte(&mut self, byte: u8, source: NoAcknowledgeSource) -> Result<(), NoAcknowledge> {
        for bit in (0..8).rev() {
            self.write_bit(byte >> bit & 1 != 0);
        }
        if self.read_bits(1) == 0 { Ok(()) } else { Err(NoAcknowledge(source)) }
    }

    fn read_byte(&mut self, is_last: bool) -> u8 {
        let byte = self.read_bits(8) as u8;
        self.write_bit(is_last);
        byte
    }

    fn perform_operation(&mut self, address: u8, operation: &mut Operation<'_>) -> Result<(), NoAcknowledge> {
        self.start_condition();
        let reads = matches!(operation, Operation::Read(_));
        self.write_byte(address << 1 | u8::from(reads), NoAcknowledgeSource::Address)?;
        match operation {
            Operation::Write(bytes) => {
                bytes.iter().try_for_each(|&byte| self.write_byte(byte, NoAcknowledgeSource::Data))
            }
            Operation::Read(buffer) => {
                let last = buffer.len().saturating_sub(1);
                for (i, byte) in buffer.iter_mut().enumerate() {
                    *byte = self.read_byte(i == last);
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
    /// Starts each operation with a start condition. The embedded-hal contract requires one only at a change of
    /// direction, where this firmware's drivers change operations.
    async fn transaction(&mut self, address: u8, operations: &mut [Operation<'_>]) -> Result<(), NoAcknowledge> {
        lockstep::wait_before_sensor_access();
        let result = operations.iter_mut().try_for_each(|operation| self.perform_operation(address, operation));
        if result.is_ok() {
            self.stop_condition();
        } else {
            self.release_data_line();
        }
        result
    }
}
