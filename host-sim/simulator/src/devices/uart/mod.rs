//! UART cable between the module and a host.
//!
//! Bytes take ten bit times each. The module's end is asynchronous, with limited receive and transmit buffers, and is
//! recreated at each start of the module. The host's end never blocks and never loses a byte.

mod cable_direction;

use std::cell::RefCell;
use std::future::poll_fn;
use std::rc::Rc;
use std::task::Poll;

use autoswing_firmware::app::SetBaud;
use autoswing_module::settings::BaudRate;
use embassy_time::{Instant, Timer};
use embedded_io_async::{ErrorType, Read, Write};
use testkit::clock;

use self::cable_direction::CableDirection;
pub use cable_direction::{TimedByte, UartError, WakeCondition};

/// Settings of the cable and of the module's UART.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct UartConfig {
    /// Bits per second in both directions.
    pub baud: u32,
    /// Receive buffer of the module, bytes.
    pub receive_buffer_bytes: usize,
    /// Transmit buffer of the module, bytes; a write waits while it is full.
    pub transmit_buffer_bytes: usize,
    /// Condition that wakes the module's reader.
    pub wake_condition: WakeCondition,
}

impl Default for UartConfig {
    fn default() -> Self {
        Self {
            baud: 115_200,
            receive_buffer_bytes: 512,
            transmit_buffer_bytes: 256,
            wake_condition: WakeCondition::IdleLine,
        }
    }
}

/// Cable with both directions. Keep it for the whole simulation.
pub struct SerialCable {
    to_module: Rc<RefCell<CableDirection>>,
    to_host: Rc<RefCell<CableDirection>>,
    transmit_buffer_bytes: usize,
}

impl SerialCable {
    /// A cable on which nothing has been sent.
    #[must_use]
    pub fn new(config: UartConfig) -> Self {
        Self {
            to_module: Rc::new(RefCell::new(CableDirection::new(
                config.baud,
                config.receive_buffer_bytes,
                config.wake_condition,
            ))),
            to_host: Rc::new(RefCell::new(CableDirection::new(config.baud, usize::MAX, WakeCondition::EachByte))),
            transmit_buffer_bytes: config.transmit_buffer_bytes,
        }
    }

    /// The host's end of the cable.
    #[must_use]
    pub fn host_end(&self) -> HostEnd {
        HostEnd { to_module: Rc::clone(&self.to_module), to_host: Rc::clone(&self.to_host) }
    }

    /// The module's end after power-on; clears the receive buffer. Call it once per start of the module.
    #[must_use]
    pub fn module_ends(&self) -> (UartReceiver, UartTransmitter) {
        self.to_module.borrow_mut().clear_received(clock::now_us());
        let transmitter = UartTransmitter {
            direction: Rc::clone(&self.to_host),
            opposite_direction: Rc::clone(&self.to_module),
            buffer_bytes: self.transmit_buffer_bytes,
        };
        (UartReceiver { direction: Rc::clone(&self.to_module) }, transmitter)
    }
}

/// Cloneable handle to the host's end. Clones share the received bytes.
#[derive(Clone)]
pub struct HostEnd {
    to_module: Rc<RefCell<CableDirection>>,
    to_host: Rc<RefCell<CableDirection>>,
}

impl HostEnd {
    /// Sends bytes as soon as the line is free.
    pub fn send_bytes(&self, bytes: &[u8]) {
        self.to_module.borrow_mut().send_bytes(bytes, clock::now_us());
    }

    /// Returns and removes the received bytes.
    #[must_use]
    pub fn receive_bytes(&self) -> Vec<u8> {
        self.receive_timed().into_iter().map(|timed_byte| timed_byte.byte).collect()
    }

    /// Returns and removes the received bytes with their arrival times.
    #[must_use]
    pub fn receive_timed(&self) -> Vec<TimedByte> {
        self.to_host.borrow_mut().take_received(usize::MAX, clock::now_us())
    }

    /// Number of bytes in transmission to the module.
    #[must_use]
    pub fn bytes_in_transit(&self) -> usize {
        self.to_module.borrow().bytes_in_transit(clock::now_us())
    }

    /// Fault: the module's next read returns this error.
    pub fn inject_error(&self, error: UartError) {
        self.to_module.borrow_mut().inject_error(error);
    }

    /// Number of bytes lost at the module, including those sent while it was off.
    #[must_use]
    pub fn lost_bytes(&self) -> u64 {
        self.to_module.borrow().lost_bytes()
    }
}

/// The module's receiver. Cancelling a read has no side effects.
pub struct UartReceiver {
    direction: Rc<RefCell<CableDirection>>,
}

impl ErrorType for UartReceiver {
    type Error = UartError;
}

impl Read for UartReceiver {
    async fn read(&mut self, buffer: &mut [u8]) -> Result<usize, UartError> {
        if buffer.is_empty() {
            return Ok(0);
        }
        poll_fn(|context| self.direction.borrow_mut().poll_readable(clock::now_us(), context.waker())).await;
        let mut direction = self.direction.borrow_mut();
        if let Some(error) = direction.take_error() {
            return Err(error);
        }
        let received = direction.take_received(buffer.len(), clock::now_us());
        for (slot, timed_byte) in buffer.iter_mut().zip(&received) {
            *slot = timed_byte.byte;
        }
        Ok(received.len())
    }
}

/// The module's transmitter. Dropping it, as at a power cut, loses bytes in transmission.
pub struct UartTransmitter {
    direction: Rc<RefCell<CableDirection>>,
    /// The opposite direction, which has the same speed.
    opposite_direction: Rc<RefCell<CableDirection>>,
    buffer_bytes: usize,
}

impl ErrorType for UartTransmitter {
    type Error = UartError;
}

impl Write for UartTransmitter {
    async fn write(&mut self, bytes: &[u8]) -> Result<usize, UartError> {
        if bytes.is_empty() {
            return Ok(0);
        }
        let free = poll_fn(|context| {
            let direction = self.direction.borrow();
            match self.buffer_bytes.saturating_sub(direction.bytes_in_transit(clock::now_us())) {
                0 => {
                    direction.wake_at_next_arrival(clock::now_us(), context.waker());
                    Poll::Pending
                }
                free => Poll::Ready(free),
            }
        })
        .await;
        let accepted = bytes.len().min(free);
        self.direction.borrow_mut().send_bytes(&bytes[..accepted], clock::now_us());
        Ok(accepted)
    }

    async fn flush(&mut self) -> Result<(), UartError> {
        let sent_us = self.direction.borrow().free_at_us();
        Timer::at(Instant::from_micros(sent_us)).await;
        Ok(())
    }
}

impl SetBaud for UartTransmitter {
    fn set_baud(&mut self, baud: BaudRate) {
        for direction in [&self.direction, &self.opposite_direction] {
            direction.borrow_mut().set_baud(baud.bits_per_s());
        }
    }
}

impl Drop for UartTransmitter {
    fn drop(&mut self) {
        self.direction.borrow_mut().drop_in_transit(clock::now_us());
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use testkit::simulation::{ExecutorLevel, Simulation};

    type ReadLog<T> = Rc<RefCell<Vec<T>>>;

    fn spawn_reader(
        simulation: &mut Simulation,
        mut receiver: UartReceiver,
    ) -> ReadLog<(u64, Result<Vec<u8>, UartError>)> {
        let log = ReadLog::default();
        let reads = Rc::clone(&log);
        simulation.spawn(ExecutorLevel::Thread, "reader", async move {
            let mut buffer = [0; 64];
            loop {
                let result = receiver.read(&mut buffer).await.map(|count| buffer[..count].to_vec());
                reads.borrow_mut().push((clock::now_us(), result));
            }
        });
        log
    }

    /// At 115,200 baud 10 bits take 86.806 us; arrival times are rounded up to microseconds.
    #[test]
    fn bytes_arrive_at_the_baud_rate_to_the_microsecond() {
        let mut simulation = Simulation::new();
        let cable = SerialCable::new(UartConfig { wake_condition: WakeCondition::EachByte, ..UartConfig::default() });
        let (receiver, _transmitter) = cable.module_ends();
        let reads = spawn_reader(&mut simulation, receiver);
        cable.host_end().send_bytes(b"ab");
        simulation.run_until(1000);
        cable.host_end().send_bytes(b"c");
        simulation.run_until(2000);
        let expected = [(87, b"a"), (174, b"b"), (1087, b"c")].map(|(at_us, byte)| (at_us, Ok(byte.to_vec())));
        assert_eq!(*reads.borrow(), expected);
    }

    /// A DMA receiver delivers a burst one byte time after its end: 3 x 87 us.
    #[test]
    fn idle_line_delivers_bursts_whole() {
        let mut simulation = Simulation::new();
        let cable = SerialCable::new(UartConfig { receive_buffer_bytes: 8, ..UartConfig::default() });
        let (receiver, _transmitter) = cable.module_ends();
        let reads = spawn_reader(&mut simulation, receiver);
        cable.host_end().send_bytes(b"ab");
        simulation.run_until(5000);
        cable.host_end().send_bytes(b"cdefgh");
        simulation.run_until(10_000);
        let reads = reads.borrow();
        assert_eq!(reads[0], (261, Ok(b"ab".to_vec())));
        assert_eq!(reads[1], (5348, Ok(b"cdef".to_vec())), "half of the buffer is full");
        assert_eq!(reads[2], (5608, Ok(b"gh".to_vec())));
    }

    #[test]
    fn a_slow_reader_loses_the_newest_bytes_and_gets_one_overrun() {
        let mut simulation = Simulation::new();
        let cable = SerialCable::new(UartConfig { receive_buffer_bytes: 4, ..UartConfig::default() });
        let (receiver, _transmitter) = cable.module_ends();
        cable.host_end().send_bytes(b"abcdefg");
        simulation.run_until(10_000);
        let reads = spawn_reader(&mut simulation, receiver);
        simulation.run_until(20_000);
        let results: Vec<_> = reads.borrow().iter().map(|(_, result)| result.clone()).collect();
        assert_eq!(results, [Err(UartError::Overrun), Ok(b"abcd".to_vec())]);
        assert_eq!(cable.host_end().lost_bytes(), 3);
    }

    #[test]
    fn an_injected_error_wakes_the_reader() {
        let mut simulation = Simulation::new();
        let cable = SerialCable::new(UartConfig::default());
        let (receiver, _transmitter) = cable.module_ends();
        let reads = spawn_reader(&mut simulation, receiver);
        simulation.run_until(500);
        cable.host_end().inject_error(UartError::Framing);
        simulation.run_until(600);
        assert_eq!(*reads.borrow(), [(500, Err(UartError::Framing))]);
    }

    #[test]
    fn a_write_waits_while_the_transmit_buffer_is_full() {
        let mut simulation = Simulation::new();
        let cable = SerialCable::new(UartConfig { transmit_buffer_bytes: 2, ..UartConfig::default() });
        let (_receiver, mut transmitter) = cable.module_ends();
        simulation.spawn(ExecutorLevel::Thread, "writer", async move {
            transmitter.write_all(b"abcd").await.unwrap();
            assert_eq!(clock::now_us(), 174, "the fourth byte is accepted when the second is out");
            std::future::pending::<()>().await;
        });
        simulation.run_until(1000);
        assert_eq!(cable.host_end().receive_bytes(), b"abcd");
    }

    #[test]
    fn power_off_truncates_output_and_discards_received_bytes() {
        let mut simulation = Simulation::new();
        let cable = SerialCable::new(UartConfig::default());
        let (receiver, mut transmitter) = cable.module_ends();
        simulation.spawn(ExecutorLevel::Thread, "writer", async move {
            transmitter.write_all(b"$HCHDM,1").await.unwrap();
            std::future::pending::<()>().await;
        });
        simulation.run_until(300);
        simulation.power_off();
        drop(receiver);
        cable.host_end().send_bytes(b"lost");
        simulation.run_until(10_000);
        assert_eq!(cable.host_end().receive_bytes(), b"$HC", "three bytes of 86.8 us fit into 300 us");

        let (receiver, _transmitter) = cable.module_ends();
        let reads = spawn_reader(&mut simulation, receiver);
        cable.host_end().send_bytes(b"new");
        simulation.run_until(20_000);
        assert_eq!(*reads.borrow(), [(10_000 + 261 + 87, Ok(b"new".to_vec()))]);
    }
}
