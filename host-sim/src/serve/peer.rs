//! Whether somebody at the autopilot's port sends attitude.

use autoswing::wire::mavlink::{Message, Receiver};

/// Who sent none for so long has gone. An autopilot that nobody has asked for more sends one a second.
const GONE_US: u64 = 3_000_000;

/// What comes from the autopilot's port.
#[derive(Debug, Default)]
pub struct Peer {
    receiver: Receiver,
    heard_us: Option<u64>,
}

impl Peer {
    /// Listens to bytes of an instant.
    pub fn hear(&mut self, now_us: u64, bytes: &[u8]) {
        let mut messages = bytes.iter().filter_map(|&byte| self.receiver.push(byte));
        if messages.by_ref().any(|message| matches!(message, Message::Attitude(_))) {
            self.heard_us = Some(now_us);
        }
        // The receiver has to see all of them.
        messages.for_each(drop);
    }

    /// Whether it sends attitude.
    pub fn talks(&self, now_us: u64) -> bool {
        self.heard_us.is_some_and(|heard_us| now_us - heard_us < GONE_US)
    }
}
