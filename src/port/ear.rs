//! interim
use super::{Facts, Heard, Output, Protocol};
use crate::attitude::Senders;
use crate::time::Timestamp;
use crate::wire::mavlink::{Message, Receiver};

/// interim
#[derive(Debug, Default)]
pub struct Mavlink {
    receiver: Receiver,
    senders: Senders,
    heard_at: Option<Timestamp>,
}

impl Mavlink {
    /// interim
    #[must_use]
    pub const fn new() -> Self {
        Self { receiver: Receiver::new(), senders: Senders::new(), heard_at: None }
    }
}

impl Mavlink {
    /// interim
    #[must_use]
    pub const fn heard_at(&self) -> Option<Timestamp> {
        self.heard_at
    }
}

impl Protocol for Mavlink {
    fn byte(&mut self, at: Timestamp, byte: u8) -> Option<Heard> {
        let message = self.receiver.push(byte)?;
        self.heard_at = Some(at);
        match message {
            Message::Heartbeat(heartbeat) => {
                self.senders.hear(at, heartbeat);
                None
            }
            Message::Attitude(report) if self.senders.takes(at, report.source) => Some(Heard::Attitude(report)),
            Message::Attitude(_) => Some(Heard::Foreign),
        }
    }

    fn is_armed(&self, now: Timestamp) -> Option<bool> {
        self.senders.is_armed(now)
    }

    fn rejected(&self) -> u32 {
        self.receiver.rejected
    }

    fn poll(&mut self, _facts: &Facts<'_>, _out: &mut Output) {}
}
