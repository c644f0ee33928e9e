//! Whether somebody at the autopilot's port is an autopilot: sends attitude, or answers in MSP.

use autoswing::wire::mavlink::{Message, Receiver};
use autoswing::wire::msp;

/// Who sent none for so long has gone. An autopilot that nobody has asked for more sends one a second.
const GONE_US: u64 = 3_000_000;

/// What comes from the autopilot's port.
#[derive(Debug, Default)]
pub struct Peer {
    receiver: Receiver,
    msp: msp::Receiver,
    heard_us: Option<u64>,
}

impl Peer {
    /// Listens to bytes of an instant.
    pub fn hear(&mut self, now_us: u64, bytes: &[u8]) {
        for &byte in bytes {
            let is_attitude = matches!(self.receiver.push(byte), Some(Message::Attitude(_)));
            if self.msp.push(byte).is_some() || is_attitude {
                self.heard_us = Some(now_us);
            }
        }
    }

    /// Whether it sends attitude.
    pub fn talks(&self, now_us: u64) -> bool {
        self.heard_us.is_some_and(|heard_us| now_us - heard_us < GONE_US)
    }
}
