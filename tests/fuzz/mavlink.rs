//! Fuzz test of the MAVLink receiver.

use autoswing_firmware::wire::mavlink::{InboundMessage, MavlinkReceiver, ReceivedParameterRequest};
use proptest::collection::vec;
use proptest::prelude::*;

use crate::stream::{self, NoiseAndGoodFrames, Piece};
use crate::{PropertyResult, check_property};

/// ID, CRC seed and longest payload of the decoded messages, from the protocol definition (common.xml).
const MESSAGE_SPECS: [(u8, u8, usize); 13] = [
    (30, 39, 28),
    (1, 124, 43),
    (0, 50, 9),
    (33, 104, 28),
    (147, 154, 54),
    (2, 137, 12),
    (76, 152, 33),
    (75, 158, 35),
    (77, 143, 10),
    (22, 220, 25),
    (20, 214, 20),
    (21, 159, 2),
    (23, 168, 23),
];

/// Longest frame: version 2, signed, with the longest payload.
const MAX_FRAME_LENGTH: usize = 10 + 54 + 2 + 13;

fn frame_crc(bytes: impl IntoIterator<Item = u8>) -> [u8; 2] {
    let mut crc = 0xFFFF_u16;
    for byte in bytes {
        crc ^= u16::from(byte);
        for _ in 0..8 {
            crc = if crc & 1 == 0 { crc >> 1 } else { crc >> 1 ^ 0x8408 };
        }
    }
    crc.to_le_bytes()
}

/// Frame with a correct CRC; the length field may differ from the payload.
fn frame_with_crc(
    is_v2: bool,
    is_signed: bool,
    [system, component]: [u8; 2],
    id: u8,
    claimed_length: u8,
    payload: &[u8],
) -> Vec<u8> {
    let mut frame = if is_v2 {
        vec![0xFD, claimed_length, u8::from(is_signed), 0, 0, system, component, id, 0, 0]
    } else {
        vec![0xFE, claimed_length, 0, system, component, id]
    };
    frame.extend_from_slice(payload);
    let extra = MESSAGE_SPECS.iter().find(|message| message.0 == id).map_or(0, |message| message.1);
    let crc = frame_crc(frame[1..].iter().copied().chain([extra]));
    frame.extend(crc);
    if is_v2 && is_signed {
        frame.extend([0xFD; 13]);
    }
    frame
}

/// Frame of any message, mostly decoded ones, from one of a few senders.
pub fn any_frame() -> impl Strategy<Value = Vec<u8>> {
    let message =
        prop_oneof![13 => proptest::sample::select(&MESSAGE_SPECS[..]), 1 => (any::<u8>(), any::<u8>(), 0..40_usize)];
    let length_error = prop_oneof![6 => Just(0_i8), 1 => any::<i8>()];
    let sender = proptest::sample::select(&[[1, 1], [1, 1], [2, 1], [1, 158], [255, 190]][..]);
    (message, any::<[bool; 4]>(), sender, length_error, vec(any::<u8>(), 55)).prop_map(
        |((id, _, longest), [is_v2, is_signed, is_small, is_cut], sender, length_error, mut payload)| {
            payload.truncate(longest);
            if is_small {
                // Plausible angles and trailing zeros, which version 2 may truncate.
                payload.iter_mut().skip(4).for_each(|byte| *byte = 0);
                payload.truncate(if is_v2 && is_cut { 4 } else { longest });
            }
            let claims = (payload.len() as u8).wrapping_add_signed(length_error);
            frame_with_crc(is_v2, is_signed, sender, id, claims, &payload)
        },
    )
}

pub fn any_stream() -> impl Strategy<Value = Vec<Piece>> {
    stream::any_pieces(any_frame(), &[0xFE, 0xFD])
}

/// Intact frame, found independently of the receiver by a search from every byte.
pub struct IntactFrame {
    end: usize,
    id: u8,
    sender: u16,
    payload: [u8; 56],
}

/// All intact frames in the bytes, also nested ones.
pub fn intact_frames(bytes: &[u8]) -> Vec<IntactFrame> {
    let mut intact_frames = Vec::new();
    for start in 0..bytes.len() {
        let from_start = &bytes[start..];
        let (header, id, [system, component], signature) = match *from_start {
            [0xFE, _, _, system, component, id, ..] => (6, id, [system, component], 0),
            [0xFD, _, flags @ 0..=1, _, _, system, component, id, 0, 0, ..] => {
                (10, id, [system, component], 13 * usize::from(flags))
            }
            _ => continue,
        };
        let length = usize::from(from_start[1]);
        let Some(&(_, extra, longest)) = MESSAGE_SPECS.iter().find(|message| message.0 == id) else { continue };
        let Some(frame) = from_start.get(..header + length + 2 + signature) else { continue };
        if length > longest
            || frame_crc(frame[1..header + length].iter().copied().chain([extra]))[..] != frame[header + length..][..2]
        {
            continue;
        }
        let mut payload = [0; 56];
        payload[..length].copy_from_slice(&frame[header..header + length]);
        intact_frames.push(IntactFrame {
            end: start + frame.len(),
            id,
            sender: u16::from_be_bytes([system, component]),
            payload,
        });
    }
    intact_frames
}

impl IntactFrame {
    fn u32(&self, offset: usize) -> u32 {
        u32::from_le_bytes([0, 1, 2, 3].map(|byte| self.payload[offset + byte]))
    }

    /// Whether it is ATTITUDE with these angles.
    pub fn has_angles(&self, roll_rad: f32, pitch_rad: f32) -> bool {
        self.id == 30 && [self.u32(4), self.u32(8)] == [roll_rad, pitch_rad].map(f32::to_bits)
    }
}

impl stream::IntactFrame<InboundMessage> for IntactFrame {
    fn end(&self) -> usize {
        self.end
    }

    fn matches_message(&self, message: &InboundMessage) -> bool {
        let (id, sender) = (self.id, self.sender);
        match message {
            InboundMessage::Attitude(report) => {
                let (roll_rad, pitch_rad) = (report.attitude.roll_rad, report.attitude.pitch_rad);
                // Angles within half and quarter circle, allowing for rounding; NaN is excluded.
                let can_be = roll_rad.abs() < 3.15 && pitch_rad.abs() < 1.58;
                can_be && self.has_angles(roll_rad, pitch_rad) && sender == report.sender.packed_number()
            }
            InboundMessage::Heartbeat(heartbeat, firmware) => {
                let is_armed = self.payload[6] & 128 != 0;
                (id, sender, is_armed, self.payload[5])
                    == (0, heartbeat.sender.packed_number(), heartbeat.is_armed, firmware.0)
            }
            InboundMessage::Position(source, _) => (id, sender) == (33, source.packed_number()),
            InboundMessage::Current(source, current) => {
                let current_offset = if id == 1 { 16 } else { 30 };
                let encoded_current =
                    f32::from(i16::from_le_bytes([self.payload[current_offset], self.payload[current_offset + 1]]))
                        * 0.01;
                [1, 147].contains(&id)
                    && sender == source.packed_number()
                    && current.is_none_or(|amperes| amperes.to_bits() == encoded_current.to_bits())
            }
            InboundMessage::Date(source, _) => (id, sender) == (2, source.packed_number()),
            InboundMessage::NamedValue(source, _) => (id, sender) == (251, source.packed_number()),
            InboundMessage::Command(command) => {
                let command_number = u16::from_le_bytes([self.payload[28], self.payload[29]]);
                [75, 76].contains(&id)
                    && (sender, command_number) == (command.sender_id.packed_number(), command.command_number)
            }
            InboundMessage::Acknowledgement(ack) => {
                (id, sender, self.payload[2]) == (77, ack.sender_id.packed_number(), ack.result)
            }
            InboundMessage::Parameter(source, parameter) => {
                (id, sender, self.u32(0)) == (22, source.packed_number(), parameter.value_bits)
            }
            InboundMessage::ParameterRequest(target, request) => {
                let (request_id, target_offset) = match request {
                    ReceivedParameterRequest::Read { .. } => (20, 2),
                    ReceivedParameterRequest::List => (21, 0),
                    ReceivedParameterRequest::Write(_) => (23, 4),
                };
                (id, self.payload[target_offset]) == (request_id, target.system_id)
            }
        }
    }
}

/// ATTITUDE with a roll of 0.5 rad, without start-of-frame bytes.
fn good_frame() -> Vec<u8> {
    let mut payload = [1; 28];
    payload[4..8].copy_from_slice(&0.5_f32.to_le_bytes());
    payload[8..12].fill(0);
    frame_with_crc(true, false, [1, 1], 30, 28, &payload)
}

#[test]
fn only_mavlink_frames_with_correct_crc_are_accepted() {
    check_property(any_stream(), |pieces| -> PropertyResult {
        let mut bytes = stream::joined_bytes(&pieces);
        let wire = NoiseAndGoodFrames::new(&mut bytes, &good_frame(), MAX_FRAME_LENGTH);
        let mut receiver = MavlinkReceiver::default();
        stream::assert_decoder_properties(
            &wire,
            &intact_frames(wire.bytes),
            |byte| (receiver.push_byte(byte), receiver.rejected_count()),
            is_good_message,
        )
    });
}

fn is_good_message(message: &InboundMessage) -> bool {
    matches!(message, InboundMessage::Attitude(report) if (report.attitude.roll_rad - 0.5).abs() < 1e-6)
}
