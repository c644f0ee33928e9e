//! Detection of an external autopilot at the autopilot port, by MAVLink attitude or MSP messages.

use autoswing_firmware::wire::mavlink::{InboundMessage, MavlinkReceiver};
use autoswing_firmware::wire::msp;

/// Timeout, microseconds. An autopilot without message requests sends attitude once a second.
const ATTITUDE_TIMEOUT_US: u64 = 3_000_000;

/// Detector for messages at the autopilot port.
#[derive(Debug, Default)]
pub struct ExternalAutopilot {
    receiver: MavlinkReceiver,
    msp: msp::MspReceiver,
    last_message_us: Option<u64>,
}

impl ExternalAutopilot {
    /// Processes bytes received at `now_us`.
    pub fn process_bytes(&mut self, now_us: u64, bytes: &[u8]) {
        for &byte in bytes {
            let is_attitude = matches!(self.receiver.push_byte(byte), Some(InboundMessage::Attitude(_)));
            if self.msp.push_byte(byte).is_some() || is_attitude {
                self.last_message_us = Some(now_us);
            }
        }
    }

    /// Whether an autopilot has sent within the timeout.
    pub fn is_active(&self, now_us: u64) -> bool {
        self.last_message_us.is_some_and(|heard_us| now_us - heard_us < ATTITUDE_TIMEOUT_US)
    }
}
