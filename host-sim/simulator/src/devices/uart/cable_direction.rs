//! One direction of a cable.

use std::collections::VecDeque;
use std::task::{Poll, Waker};

use embedded_io_async::{Error, ErrorKind};

/// Condition that wakes a waiting reader at the module's end.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum WakeCondition {
    /// The reader wakes at every byte, as with an interrupt-driven receiver.
    EachByte,
    /// Line idle for one byte time, or buffer half full, as with a DMA receiver.
    IdleLine,
}

/// Byte with the arrival time of its last bit.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TimedByte {
    /// Simulation time at which the last bit arrives, microseconds.
    pub arrives_at_us: u64,
    /// The byte on the line.
    pub byte: u8,
}

/// Bits of a byte on the line: start bit, eight data bits, stop bit.
const BITS_PER_BYTE: u64 = 10;
const MICROSECONDS_PER_SECOND: u64 = 1_000_000;

pub(super) struct CableDirection {
    baud: u64,
    /// End of the last transmission in microseconds times baud, which avoids rounding.
    free_at_us_times_baud: u64,
    /// Sent bytes that have not been moved to the receive buffer.
    in_transit: VecDeque<TimedByte>,
    received: VecDeque<TimedByte>,
    receive_capacity: usize,
    lost_bytes: u64,
    pending_error: Option<UartError>,
    wake_condition: WakeCondition,
    reader_waker: Option<Waker>,
}

impl CableDirection {
    pub fn new(baud: u32, receive_capacity: usize, wake_condition: WakeCondition) -> Self {
        Self {
            baud: u64::from(baud),
            free_at_us_times_baud: 0,
            in_transit: VecDeque::new(),
            received: VecDeque::new(),
            receive_capacity,
            lost_bytes: 0,
            pending_error: None,
            wake_condition,
            reader_waker: None,
        }
    }

    pub fn send_bytes(&mut self, bytes: &[u8], now_us: u64) {
        self.deliver_arrived_bytes(now_us);
        self.free_at_us_times_baud = self.free_at_us_times_baud.max(now_us * self.baud);
        for &byte in bytes {
            self.free_at_us_times_baud += BITS_PER_BYTE * MICROSECONDS_PER_SECOND;
            self.in_transit.push_back(TimedByte { arrives_at_us: self.free_at_us(), byte });
        }
        if let Some(reader_waker) = self.reader_waker.take() {
            self.wake_on_delivery(&reader_waker);
            self.reader_waker = Some(reader_waker);
        }
    }

    /// Changes the speed at both ends; bytes in transmission keep their arrival times.
    pub fn set_baud(&mut self, baud: u32) {
        self.free_at_us_times_baud = self.free_at_us() * u64::from(baud);
        self.baud = baud.into();
    }

    /// Arrival time of the last sent byte.
    pub fn free_at_us(&self) -> u64 {
        self.free_at_us_times_baud.div_ceil(self.baud)
    }

    /// Number of bytes in transmission.
    pub fn bytes_in_transit(&self, now_us: u64) -> usize {
        self.in_transit.len() - self.in_transit.partition_point(|timed_byte| timed_byte.arrives_at_us <= now_us)
    }

    /// Drops bytes in transmission, as when the sender is switched off.
    pub fn drop_in_transit(&mut self, now_us: u64) {
        self.deliver_arrived_bytes(now_us);
        self.in_transit.clear();
        self.free_at_us_times_baud = now_us * self.baud;
    }

    /// Clears the receive buffer, as when the receiver is switched on.
    pub fn clear_received(&mut self, now_us: u64) {
        self.deliver_arrived_bytes(now_us);
        self.received.clear();
        self.pending_error = None;
        self.reader_waker = None;
    }

    /// Returns at most `max_bytes` received bytes.
    pub fn take_received(&mut self, max_bytes: usize, now_us: u64) -> Vec<TimedByte> {
        self.deliver_arrived_bytes(now_us);
        let count = max_bytes.min(self.received.len());
        self.received.drain(..count).collect()
    }

    pub fn inject_error(&mut self, error: UartError) {
        self.pending_error = Some(error);
        if let Some(reader_waker) = &self.reader_waker {
            reader_waker.wake_by_ref();
        }
    }

    pub fn take_error(&mut self) -> Option<UartError> {
        self.pending_error.take()
    }

    pub fn lost_bytes(&self) -> u64 {
        self.lost_bytes
    }

    /// Ready when a byte or an error is available.
    pub fn poll_readable(&mut self, now_us: u64, waker: &Waker) -> Poll<()> {
        self.deliver_arrived_bytes(now_us);
        if self.pending_error.is_some() || !self.received.is_empty() {
            self.reader_waker = None;
            return Poll::Ready(());
        }
        self.wake_on_delivery(waker);
        self.reader_waker = Some(waker.clone());
        Poll::Pending
    }

    pub fn wake_at_next_arrival(&self, now_us: u64, waker: &Waker) {
        if let Some(next) = self.in_transit.iter().find(|timed_byte| timed_byte.arrives_at_us > now_us) {
            embassy_time_driver::schedule_wake(next.arrives_at_us, waker);
        }
    }

    /// Moves arrived bytes into the receive buffer. An overflow loses bytes and sets the overrun error.
    fn deliver_arrived_bytes(&mut self, now_us: u64) {
        while let Some(timed_byte) = self.in_transit.pop_front_if(|timed_byte| timed_byte.arrives_at_us <= now_us) {
            if self.received.len() < self.receive_capacity {
                self.received.push_back(timed_byte);
            } else {
                self.lost_bytes += 1;
                self.pending_error = Some(UartError::Overrun);
            }
        }
    }

    fn wake_on_delivery(&self, waker: &Waker) {
        if let Some(at_us) = self.delivery_time_us() {
            embassy_time_driver::schedule_wake(at_us, waker);
        }
    }

    fn delivery_time_us(&self) -> Option<u64> {
        match self.wake_condition {
            WakeCondition::EachByte => self.in_transit.front().map(|timed_byte| timed_byte.arrives_at_us),
            WakeCondition::IdleLine => {
                // First byte that is followed by a pause or fills half of the buffer.
                let pause_us = 2 * self.byte_time_us();
                let half_capacity = self.receive_capacity / 2;
                let next =
                    self.in_transit.iter().skip(1).map(|timed_byte| Some(timed_byte.arrives_at_us)).chain([None]);
                self.in_transit.iter().zip(next).zip(1..).find_map(|((timed_byte, next), count)| {
                    let idle = next.is_none_or(|next_us| next_us > timed_byte.arrives_at_us + pause_us);
                    if count >= half_capacity {
                        Some(timed_byte.arrives_at_us)
                    } else {
                        idle.then(|| timed_byte.arrives_at_us + self.byte_time_us())
                    }
                })
            }
        }
    }

    fn byte_time_us(&self) -> u64 {
        (BITS_PER_BYTE * MICROSECONDS_PER_SECOND).div_ceil(self.baud)
    }
}

/// Receive error of the module.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum UartError {
    /// Bytes were lost because the receive buffer was full.
    Overrun,
    /// A stop bit was missing.
    Framing,
    /// Noise error: the receiver's samples of one bit disagreed.
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
