//! A UART cable between the module and whoever is at the other end.
//!
//! Bytes take ten bit times each and arrive one after the other. The module's end is asynchronous, has a receive
//! buffer that can overflow and a transmit buffer that can be full, and is made anew at each start of the module; the
//! far end is for pilots and tests: it never blocks and never loses a byte.

mod line;

use std::cell::RefCell;
use std::future::poll_fn;
use std::rc::Rc;
use std::task::Poll;

use autoswing::app::SetBaud;
use autoswing::settings::Baud;
use embassy_time::{Instant, Timer};
use embedded_io_async::{Error, ErrorKind, ErrorType, Read, Write};

use self::line::Line;
use crate::clock;

/// When a waiting reader at the module's end is woken.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Delivery {
    /// At every byte, as an interrupt-driven receiver does.
    EachByte,
    /// When the line has been idle for the time of one byte, or the buffer is half full, as a DMA receiver does.
    IdleLine,
}

/// Properties of the cable and of the module's UART.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Config {
    /// Bits per second, both ways.
    pub baud: u32,
    /// Bytes the module's receiver can hold.
    pub receive_buffer: usize,
    /// Bytes the module's transmitter accepts before a write waits.
    pub transmit_buffer: usize,
    /// When the module's reader is woken.
    pub delivery: Delivery,
}

impl Default for Config {
    fn default() -> Self {
        Self { baud: 115_200, receive_buffer: 512, transmit_buffer: 256, delivery: Delivery::IdleLine }
    }
}

/// What the module's receiver can report.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum UartError {
    /// Bytes came faster than they were read and were lost.
    Overrun,
    /// A stop bit was missing.
    Framing,
    /// The samples of a bit disagreed.
    Noise,
}

impl std::fmt::Display for UartError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Overrun => "receive buffer overrun",
            Self::Framing => "framing error",
            Self::Noise => "noise on the line",
        })
    }
}

impl std::error::Error for UartError {}

impl Error for UartError {
    fn kind(&self) -> ErrorKind {
        ErrorKind::Other
    }
}

/// A cable. Keep it as long as the simulation lives.
pub struct Cable {
    to_module: Rc<RefCell<Line>>,
    to_host: Rc<RefCell<Line>>,
    transmit_buffer: usize,
}

impl Cable {
    /// A cable with nothing on it.
    #[must_use]
    pub fn new(config: Config) -> Self {
        Self {
            to_module: Rc::new(RefCell::new(Line::new(config.baud, config.receive_buffer, config.delivery))),
            to_host: Rc::new(RefCell::new(Line::new(config.baud, usize::MAX, Delivery::EachByte))),
            transmit_buffer: config.transmit_buffer,
        }
    }

    /// The far end.
    #[must_use]
    pub fn host(&self) -> HostEnd {
        HostEnd { to_module: Rc::clone(&self.to_module), to_host: Rc::clone(&self.to_host) }
    }

    /// The module's end, just switched on: what arrived before is gone. Call it once per start of the module.
    #[must_use]
    pub fn module(&self) -> (Receiver, Transmitter) {
        self.to_module.borrow_mut().clear_received(clock::now_us());
        let transmitter = Transmitter {
            line: Rc::clone(&self.to_host),
            back: Rc::clone(&self.to_module),
            buffer: self.transmit_buffer,
        };
        (Receiver { line: Rc::clone(&self.to_module) }, transmitter)
    }
}

/// A byte and when its last bit arrived.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Timed {
    /// Microseconds of the virtual clock.
    pub at_us: u64,
    /// The byte.
    pub byte: u8,
}

/// The far end of a cable: a handle, cloned freely. Clones share what has been received.
#[derive(Clone)]
pub struct HostEnd {
    to_module: Rc<RefCell<Line>>,
    to_host: Rc<RefCell<Line>>,
}

impl HostEnd {
    /// Sends bytes, the first one now or as soon as the line is free.
    pub fn send(&self, bytes: &[u8]) {
        self.to_module.borrow_mut().send(bytes, clock::now_us());
    }

    /// Takes what has arrived.
    #[must_use]
    pub fn receive(&self) -> Vec<u8> {
        self.receive_timed().into_iter().map(|timed| timed.byte).collect()
    }

    /// Takes what has arrived, with the time of each byte.
    #[must_use]
    pub fn receive_timed(&self) -> Vec<Timed> {
        self.to_host.borrow_mut().take(usize::MAX, clock::now_us())
    }

    /// Bytes sent that have not arrived.
    #[must_use]
    pub fn unsent(&self) -> usize {
        self.to_module.borrow().outstanding(clock::now_us())
    }

    /// Waits until there is something to [`receive`](Self::receive).
    pub async fn readable(&self) {
        poll_fn(|context| self.to_host.borrow_mut().poll_readable(clock::now_us(), context.waker())).await;
    }

    /// Fault: the module's next read fails with this error.
    pub fn inject_error(&self, error: UartError) {
        self.to_module.borrow_mut().fail(error);
    }

    /// Bytes that the module lost because it did not read in time, including those sent while it was off.
    #[must_use]
    pub fn lost_bytes(&self) -> u64 {
        self.to_module.borrow().lost_bytes()
    }
}

/// The module's receiver. Reads are free of side effects when cancelled.
pub struct Receiver {
    line: Rc<RefCell<Line>>,
}

impl ErrorType for Receiver {
    type Error = UartError;
}

impl Read for Receiver {
    async fn read(&mut self, buffer: &mut [u8]) -> Result<usize, UartError> {
        if buffer.is_empty() {
            return Ok(0);
        }
        poll_fn(|context| self.line.borrow_mut().poll_readable(clock::now_us(), context.waker())).await;
        let mut line = self.line.borrow_mut();
        if let Some(error) = line.take_error() {
            return Err(error);
        }
        let received = line.take(buffer.len(), clock::now_us());
        for (slot, timed) in buffer.iter_mut().zip(&received) {
            *slot = timed.byte;
        }
        Ok(received.len())
    }
}

/// The module's transmitter. Dropping it, as a power cut does, loses what is not out yet.
pub struct Transmitter {
    line: Rc<RefCell<Line>>,
    /// The other direction, which is as fast.
    back: Rc<RefCell<Line>>,
    buffer: usize,
}

impl ErrorType for Transmitter {
    type Error = UartError;
}

impl Write for Transmitter {
    async fn write(&mut self, bytes: &[u8]) -> Result<usize, UartError> {
        if bytes.is_empty() {
            return Ok(0);
        }
        let free = poll_fn(|context| {
            let line = self.line.borrow();
            match self.buffer.saturating_sub(line.outstanding(clock::now_us())) {
                0 => {
                    line.wake_at_next_arrival(clock::now_us(), context.waker());
                    Poll::Pending
                }
                free => Poll::Ready(free),
            }
        })
        .await;
        let accepted = bytes.len().min(free);
        self.line.borrow_mut().send(&bytes[..accepted], clock::now_us());
        Ok(accepted)
    }

    async fn flush(&mut self) -> Result<(), UartError> {
        let sent_us = self.line.borrow().free_at_us();
        Timer::at(Instant::from_micros(sent_us)).await;
        Ok(())
    }
}

/// Whoever is at the far end is set alike.
impl SetBaud for Transmitter {
    fn set_baud(&mut self, baud: Baud) {
        for line in [&self.line, &self.back] {
            line.borrow_mut().set_baud(baud.bits_per_s());
        }
    }
}

impl Drop for Transmitter {
    fn drop(&mut self) {
        self.line.borrow_mut().cut(clock::now_us());
    }
}

#[cfg(test)]
mod tests;
