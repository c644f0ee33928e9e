//! UARTs of the machine (ARM DDI0479, CMSDK APB UART).

use core::convert::Infallible;

use autoswing_firmware::app::SetBaud;
use autoswing_module::settings::BaudRate;
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::pipe::Pipe;
use embassy_time::{Duration, Timer};
use embedded_io_async::{ErrorType, Write};

use super::registers::{Peripheral, Register};

const UART_DATA: usize = 0x00;
const UART_STATE: usize = 0x04;
const UART_CONTROL: usize = 0x08;
const UART_CLEAR: usize = 0x0C;
const BAUD_DIVISOR: usize = 0x10;

/// Bit of the state register: the transmitter is busy.
const TX_FULL: u32 = 1;
/// Bit of the state register: a byte was received.
const RX_FULL: u32 = 2;
/// Value of `UART_CONTROL` that enables transmitter, receiver and receive interrupt.
const UART_ENABLED: u32 = 0b1011;
/// Bit of `UART_CLEAR` that clears the receive interrupt.
const RX_INTERRUPT: u32 = 2;

/// Input clock of the baud-rate divisor, Hz.
const CLOCK_HZ: u32 = 25_000_000;

/// Size of the receive buffer, bytes: 22 ms of input, as on the reference board.
const BUFFER_SIZE: usize = 256;

/// Polling interval of a busy transmitter: one byte at 115200 baud.
const BYTE_TIME: Duration = Duration::from_micros(87);

pub type ReceiveQueue = Pipe<CriticalSectionRawMutex, BUFFER_SIZE>;

pub struct Uart {
    peripheral: Peripheral,
    pub receive_queue: ReceiveQueue,
}

pub static CONSOLE: Uart = Uart::new(Peripheral::Uart0);
pub static AUTOPILOT: Uart = Uart::new(Peripheral::Uart1);
pub static INSTRUMENT: Uart = Uart::new(Peripheral::Uart3);
pub static LOCKSTEP: Uart = Uart::new(Peripheral::Uart2);

impl Uart {
    pub const fn new(peripheral: Peripheral) -> Self {
        Self { peripheral, receive_queue: Pipe::new() }
    }

    fn register(&self, offset: usize) -> Register {
        Register::at_offset(self.peripheral, offset)
    }

    /// Enables the UART at 115200 baud, 8N1.
    pub fn enable(&self) {
        self.set_baud(BaudRate::B115200);
        self.register(UART_CONTROL).write_register(UART_ENABLED);
    }

    /// Rounding error of the divisor: 0.5 % at 460,800 baud, otherwise less.
    fn set_baud(&self, baud: BaudRate) {
        let bits_per_s = baud.bits_per_s();
        self.register(BAUD_DIVISOR).write_register((CLOCK_HZ + bits_per_s / 2) / bits_per_s);
    }

    /// Reads a received byte.
    pub fn read_byte(&self) -> Option<u8> {
        if self.register(UART_STATE).read_register() & RX_FULL == 0 {
            return None;
        }
        self.register(UART_CLEAR).write_register(RX_INTERRUPT);
        Some(self.register(UART_DATA).read_register() as u8)
    }

    /// Moves a received byte to the buffer; returns whether there was a byte.
    pub fn receive_byte(&self) -> bool {
        let byte = self.read_byte();
        if let Some(byte) = byte {
            // An overrun loses the byte.
            let _ = self.receive_queue.try_write(&[byte]);
        }
        byte.is_some()
    }

    /// Sends a byte; false if the transmitter is busy.
    pub fn put_byte(&self, byte: u8) -> bool {
        let is_free = self.register(UART_STATE).read_register() & TX_FULL == 0;
        if is_free {
            self.register(UART_DATA).write_register(byte.into());
        }
        is_free
    }
}

/// Transmitter of a UART, with a callback after each write.
pub struct UartTx {
    pub uart: &'static Uart,
    pub on_written: fn(),
}

impl SetBaud for UartTx {
    fn set_baud(&mut self, baud: BaudRate) {
        self.uart.set_baud(baud);
    }
}

impl ErrorType for UartTx {
    type Error = Infallible;
}

impl Write for UartTx {
    /// Waits only before the first byte, so that a cancelled write has sent nothing.
    async fn write(&mut self, bytes: &[u8]) -> Result<usize, Infallible> {
        let Some((&first, rest)) = bytes.split_first() else { return Ok(0) };
        while !self.uart.put_byte(first) {
            Timer::after(BYTE_TIME).await;
        }
        let more = rest.iter().take_while(|&&byte| self.uart.put_byte(byte)).count();
        (self.on_written)();
        Ok(1 + more)
    }

    async fn flush(&mut self) -> Result<(), Infallible> {
        Ok(())
    }
}
