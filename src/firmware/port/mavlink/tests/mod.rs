//! Tests of the component. The interaction with autopilots is tested with simulated ones.

mod collection;
mod commands;
mod component;
mod own_parameters;
mod requests;
mod sender;

use super::*;
use crate::port::snapshot::tests::test_snapshot;
use crate::port::transmit_buffer::TRANSMIT_CAPACITY;
use autoswing::calibration::HeadingUncertainty;
use autoswing::frames::RollPitch;
use autoswing::heading::Heading;
use autoswing::instrument::Estimate;
use autoswing_module::settings::Settings;
use testkit::frames::{MavlinkAddress, mavlink_attitude, mavlink_command, mavlink_heartbeat, mavlink_v2_frame};

const ACCEPTED: u8 = 0;
const DENIED: u8 = 2;
const IN_PROGRESS: u8 = 5;

const AUTOPILOT: MavlinkAddress = [1, 1];
const SECOND_AUTOPILOT: MavlinkAddress = [2, 1];
const GIMBAL: MavlinkAddress = [1, 154];
const GROUND_STATION: MavlinkAddress = [255, 190];

fn attitude_frame(sender: MavlinkAddress, boot_ms: u32) -> Vec<u8> {
    mavlink_attitude(sender, boot_ms, [0.1, 0.2, 0.0, 0.0, 0.0, 0.0])
}

/// Sent frame; the payload includes truncated zeros.
#[derive(Clone, Debug, PartialEq)]
struct SentMessage {
    sent_at_ms: u64,
    sequence: u8,
    sender: MavlinkAddress,
    message_id: u8,
    payload: Vec<u8>,
}

impl SentMessage {
    fn float_at(&self, at: usize) -> f32 {
        f32::from_le_bytes(self.payload[at..at + 4].try_into().unwrap())
    }
}

/// Protocol under test, a clock in milliseconds, and the module's state.
struct MavlinkBench {
    mavlink: Mavlink,
    now_ms: u64,
    clock_offset_us: u64,
    estimate: Estimate,
    settings: Settings,
    indicator_state: IndicatorState,
    calibration: Option<(Calibration, HeadingUncertainty)>,
    /// Free bytes in the output, if limited.
    free_output_bytes: Option<usize>,
    sent_messages: Vec<SentMessage>,
}

impl MavlinkBench {
    /// Bench an hour after the start, without a known autopilot, whose component is settled.
    fn new() -> Self {
        let mut mavlink = Mavlink::default();
        mavlink.component_claim.update(Timestamp::START, Settings::DEFAULT.component, true);
        Self {
            mavlink,
            now_ms: 3_600_000,
            clock_offset_us: 0,
            estimate: Estimate::EMPTY,
            settings: Settings::DEFAULT,
            indicator_state: IndicatorState::Idle,
            calibration: None,
            free_output_bytes: None,
            sent_messages: vec![],
        }
    }

    /// Bench with a disarmed autopilot that sends attitude.
    fn with_autopilot() -> Self {
        let mut bench = Self::new();
        bench.receive(&mavlink_heartbeat(AUTOPILOT, true, false));
        bench.receive(&attitude_frame(AUTOPILOT, 0));
        bench
    }

    fn now(&self) -> Timestamp {
        Timestamp::from_us(1000 * self.now_ms + self.clock_offset_us)
    }

    fn receive(&mut self, bytes: &[u8]) -> Vec<ReceivedMessage> {
        let now = self.now();
        let received = bytes.iter().filter_map(|&byte| self.mavlink.process_byte(now, byte));
        received.filter(|received| *received != ReceivedMessage::Other).collect()
    }

    /// Polls until no message is due.
    fn poll(&mut self) {
        while self.poll_once() {}
    }

    fn poll_once(&mut self) -> bool {
        let snapshot = Snapshot {
            now: self.now(),
            indicator_state: self.indicator_state,
            calibration: self.calibration.as_ref(),
            ..test_snapshot(&self.estimate, &self.settings)
        };
        let mut out = TransmitBuffer::default();
        let others = self.free_output_bytes.map_or(0, |room| TRANSMIT_CAPACITY - room);
        assert!(out.append_message(&[&vec![0; others]]));
        self.mavlink.poll(&snapshot, &mut out);
        let rest = &out.pending_bytes()[others..];
        let [0xFD, length, 0, 0, sequence, system, component, id, 0, 0, ..] = *rest else {
            assert!(rest.is_empty());
            return false;
        };
        let end = 10 + usize::from(length);
        assert_eq!(rest.len(), end + 2, "more than a message");
        let mut payload = rest[10..end].to_vec();
        payload.resize(120, 0);
        self.sent_messages.push(SentMessage {
            sent_at_ms: self.now_ms,
            sequence,
            sender: [system, component],
            message_id: id,
            payload,
        });
        true
    }

    /// Polls every 10 ms for this time, milliseconds.
    fn run_ms(&mut self, ms: u64) {
        for _ in 0..ms / 10 {
            self.poll();
            self.now_ms += 10;
        }
    }

    /// Removes and returns the sent frames of a message.
    fn take_messages(&mut self, id: u8) -> Vec<SentMessage> {
        let (taken, others) =
            std::mem::take(&mut self.sent_messages).into_iter().partition(|sent| sent.message_id == id);
        self.sent_messages = others;
        taken
    }

    /// Removes and returns the sent texts, joined from their chunks without the spaces that fill them, with severities.
    fn take_texts(&mut self) -> Vec<(u8, String)> {
        let mut texts: Vec<(u8, u16, String)> = vec![];
        for sent in self.take_messages(253) {
            let chunk: Vec<u8> = sent.payload[1..51].iter().copied().take_while(|&byte| byte != 0).collect();
            let chunk = String::from_utf8(chunk).unwrap();
            let number = u16::from_le_bytes([sent.payload[51], sent.payload[52]]);
            match texts.last_mut() {
                Some((_, last, text)) if number != 0 && *last == number => text.push_str(&chunk),
                _ => {
                    assert_eq!(sent.payload[53], 0, "the first piece");
                    texts.push((sent.payload[0], number, chunk));
                }
            }
        }
        let without_fill = |text: String| text.split_whitespace().collect::<Vec<_>>().join(" ");
        texts.into_iter().map(|(severity, _, text)| (severity, without_fill(text))).collect()
    }
}

fn heading(magnetic_deg: f32, sigma_deg: f32) -> Heading {
    Heading {
        magnetic_rad: magnetic_deg.to_radians(),
        sigma_rad: sigma_deg.to_radians(),
        systematic_variance_rad2: 0.0,
    }
}
