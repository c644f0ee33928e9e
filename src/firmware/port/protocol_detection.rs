//! A port with its protocols, and the detection of the autopilot's protocol.

use crate::port::mavlink::Mavlink;
use crate::port::msp::Msp;
use crate::port::nmea::Nmea;
use crate::port::received_message::ReceivedMessage;
use crate::port::snapshot::Snapshot;
use crate::port::transmit_buffer::TransmitBuffer;
use autoswing::attitude::HAS_OWN_ATTITUDE;
use autoswing::time::Timestamp;
use autoswing_module::compass::AutopilotAction;
use autoswing_module::settings::ProtocolKind;

/// Silence after which the protocol is detected anew, microseconds.
const DETECTION_EXPIRY_US: u64 = 10_000_000;

/// Autopilot port. While it sends NMEA sentences it still receives MAVLink, so that attitude may arrive on the same line.
#[derive(Debug)]
pub struct Port {
    configured_protocol: ProtocolKind,
    detection: ProtocolDetection,
    /// Receives results of commands, and texts, and has the actions on the autopilot, whatever the active protocol.
    pub mavlink: Mavlink,
    msp: Msp,
    nmea: Nmea,
    /// Bytes to write to the line.
    pub pending_output: TransmitBuffer,
}

/// Detected protocol, and the time of its last frame.
#[derive(Clone, Copy, Debug)]
struct ProtocolDetection {
    /// Detected protocol; `Auto` if none was detected.
    protocol: ProtocolKind,
    last_frame_at: Timestamp,
    /// Whether a frame was received since the start. A protocol detected before the restart is used at once, so that
    /// the same autopilot need not wait; the first received frame may replace it.
    has_received_frame: bool,
}

impl ProtocolDetection {
    /// Records a frame of a protocol; another protocol than the detected one changes nothing until that is silent.
    fn record_frame(&mut self, protocol: ProtocolKind, at: Timestamp) {
        if !self.has_received_frame || [protocol, ProtocolKind::Auto].contains(&self.unexpired_protocol(at)) {
            *self = Self { protocol, last_frame_at: at, has_received_frame: true };
        }
    }

    fn unexpired_protocol(&self, now: Timestamp) -> ProtocolKind {
        if now.us_since(self.last_frame_at) <= DETECTION_EXPIRY_US { self.protocol } else { ProtocolKind::Auto }
    }
}

impl Port {
    /// Creates a port at its start time, with the protocol detected before the restart, or `Auto`.
    #[must_use]
    pub fn new(configured: ProtocolKind, detected: ProtocolKind, start: Timestamp) -> Self {
        Self {
            configured_protocol: configured,
            detection: ProtocolDetection { protocol: detected, last_frame_at: start, has_received_frame: false },
            mavlink: Mavlink::default(),
            msp: Msp::default(),
            nmea: Nmea::default(),
            pending_output: TransmitBuffer::default(),
        }
    }

    /// Selects the protocol.
    pub const fn set_protocol(&mut self, configured: ProtocolKind) {
        self.configured_protocol = configured;
    }

    /// Protocol in use: if `auto` is set, the detected one, or `auto` during detection.
    #[must_use]
    pub fn active_protocol(&self, now: Timestamp) -> ProtocolKind {
        match self.configured_protocol {
            ProtocolKind::Auto => self.detection.unexpired_protocol(now),
            configured => configured,
        }
    }

    /// Processes a received byte.
    pub fn process_byte(&mut self, at: Timestamp, byte: u8) -> Option<ReceivedMessage> {
        // Until a frame is received, either protocol may be detected.
        let is_detected = self.detection.has_received_frame || self.configured_protocol != ProtocolKind::Auto;
        let active = if is_detected { self.active_protocol(at) } else { ProtocolKind::Auto };
        let msp_message = if matches!(active, ProtocolKind::Auto | ProtocolKind::Msp) {
            self.msp.process_byte(at, byte, self.mavlink.autopilot_session())
        } else {
            None
        };
        let mavlink_message = if active == ProtocolKind::Msp { None } else { self.mavlink.process_byte(at, byte) };
        let uses_speed = HAS_OWN_ATTITUDE && active == ProtocolKind::Nmea;
        let speed_m_s = if uses_speed { self.nmea.speed_receiver.push_byte(byte) } else { None };
        if msp_message.is_some() {
            self.detection.record_frame(ProtocolKind::Msp, at);
        }
        if mavlink_message.is_some() {
            self.detection.record_frame(ProtocolKind::Mavlink, at);
        }
        mavlink_message.or(msp_message).or(speed_m_s.map(ReceivedMessage::GroundSpeed))
    }

    /// Whether the autopilot is armed, if it has reported that recently.
    #[must_use]
    pub fn is_armed(&self, now: Timestamp) -> Option<bool> {
        self.mavlink.is_armed(now).or_else(|| self.msp.is_armed(now))
    }

    /// Number of broken or impossible frames; wraps.
    #[must_use]
    pub fn rejected_frame_count(&self) -> u32 {
        self.mavlink.rejected_frame_count().wrapping_add(self.msp.rejected_frame_count())
    }

    /// Appends due messages to the output. During detection the port sends MSP requests: an MSP autopilot sends nothing
    /// without a request and searches for its compass while it starts; a MAVLink autopilot ignores them.
    pub fn poll(&mut self, snapshot: &Snapshot<'_>) {
        match self.active_protocol(snapshot.now) {
            ProtocolKind::Mavlink => self.mavlink.poll(snapshot, &mut self.pending_output),
            ProtocolKind::Nmea => self.nmea.poll(snapshot, &mut self.pending_output),
            ProtocolKind::Auto | ProtocolKind::Msp => {
                self.msp.poll(snapshot, self.mavlink.autopilot_session(), &mut self.pending_output);
            }
        }
    }

    /// Begins an action on the autopilot.
    pub fn begin_autopilot_action(&mut self, now: Timestamp, action: AutopilotAction) {
        if self.active_protocol(now) == ProtocolKind::Msp {
            self.mavlink.autopilot_session().begin_action(action, self.msp.autopilot_kind());
        } else {
            self.mavlink.begin_autopilot_action(action);
        }
    }

    /// Whether the set protocol carries text messages, or may after detection.
    #[must_use]
    pub fn carries_texts(&self) -> bool {
        matches!(self.configured_protocol, ProtocolKind::Auto | ProtocolKind::Mavlink)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::port::snapshot::tests::test_snapshot;

    use autoswing::instrument::Estimate;
    use autoswing_module::messages::{AutopilotReport, Message};
    use autoswing_module::settings::Settings;
    use testkit::frames::{mavlink_heartbeat, msp_frame};

    fn heartbeat_frame() -> Vec<u8> {
        mavlink_heartbeat([1, 1], true, false)
    }

    fn msp_firmware_frame() -> Vec<u8> {
        msp_frame(b'>', 2, b"INAV")
    }

    const fn timestamp_ms(ms: u64) -> Timestamp {
        Timestamp::from_us(ms * 1000)
    }

    fn receive_bytes(port: &mut Port, ms: u64, bytes: &[u8]) {
        for &byte in bytes {
            let _ = port.process_byte(timestamp_ms(ms), byte);
        }
    }

    fn polled_output(port: &mut Port, ms: u64) -> Vec<u8> {
        let estimate = Estimate { timestamp: timestamp_ms(ms), ..Estimate::EMPTY };
        port.poll(&test_snapshot(&estimate, &Settings::DEFAULT));
        let bytes = port.pending_output.pending_bytes().to_vec();
        port.pending_output.consume_bytes(usize::MAX);
        bytes
    }

    /// Frames of another protocol, for example from a repeater, change nothing until the autopilot is silent.
    #[test]
    fn a_detected_protocol_is_kept_while_it_is_received() {
        let (mavlink, msp) = (heartbeat_frame(), msp_firmware_frame());
        let mut port = Port::new(ProtocolKind::Auto, ProtocolKind::Auto, timestamp_ms(0));
        receive_bytes(&mut port, 0, &mavlink);
        for ms in (0..20_000).step_by(1000) {
            receive_bytes(&mut port, ms, &mavlink);
            receive_bytes(&mut port, ms + 1, &msp);
            assert_eq!(port.active_protocol(timestamp_ms(ms + 1)), ProtocolKind::Mavlink);
        }
        for ms in (20_000..30_001).step_by(1000) {
            receive_bytes(&mut port, ms, &msp);
        }
        assert_eq!(port.active_protocol(timestamp_ms(30_001)), ProtocolKind::Msp);
    }

    /// A check that began by MAVLink does not go on by MSP, which the silent line gets then.
    #[test]
    fn an_action_ends_with_its_protocol() {
        let mut port = Port::new(ProtocolKind::Auto, ProtocolKind::Auto, timestamp_ms(0));
        receive_bytes(&mut port, 0, &heartbeat_frame());
        port.begin_autopilot_action(timestamp_ms(0), AutopilotAction::Check);
        polled_output(&mut port, 10_000);
        assert_eq!(port.mavlink.take_message(timestamp_ms(10_000)), None);
        polled_output(&mut port, 10_001);
        let ended = Message::Autopilot(AutopilotReport::NoReply);
        assert_eq!(port.mavlink.take_message(timestamp_ms(10_001)), Some(ended));
    }
}
