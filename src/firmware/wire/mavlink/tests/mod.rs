//! The receiver.

mod inbound;
mod outbound;
mod parameter;
mod signature;

use super::*;
use autoswing::attitude::{AttitudeReport, BodyRates, Heartbeat};
use autoswing::frames::RollPitch;
use autoswing::time::WrappingMillis;
use autoswing_module::messages::ParameterName;
use mavlink_dialect::{MavAutopilot, MavParamType};
use testkit::frames::{bytes_from_hex, mavlink_attitude_payload, mavlink_v1_frame, mavlink_v2_frame, with_mavlink_crc};

/// Sender of the frames: system 12, component 34.
const SENDER: SenderId = SenderId::new(12 * 256 + 34);

/// ID, CRC extra byte, and payload lengths in versions 1 and 2, which the dialect's tests compare with the crate mavlink.
fn supported_messages() -> impl Iterator<Item = (u8, u8, usize, usize)> {
    SUPPORTED_MESSAGES
        .iter()
        .map(|message| (message.message_id as u8, message.extra_crc, message.payload_length, message.extended_length))
}

fn v1_frame(id: u8, extra: u8, payload: &[u8]) -> Vec<u8> {
    mavlink_v1_frame([12, 34], id, extra, payload)
}

fn v2_frame(id: u8, extra: u8, payload: &[u8]) -> Vec<u8> {
    mavlink_v2_frame([12, 34], id, extra, payload)
}

/// Roll, pitch, yaw, and their rates. No CRC ends with a start byte, which would complete a truncated frame.
const ANGLES_AND_RATES: [f32; 6] = [0.1, -0.2, 2.5, 0.4, -0.5, 0.6];

/// ATTITUDE in both versions.
fn attitude_frames(angles_and_rates: [f32; 6]) -> [Vec<u8>; 2] {
    let payload = mavlink_attitude_payload(4321, angles_and_rates);
    [v1_frame(30, 39, &payload), v2_frame(30, 39, &payload)]
}

/// HEARTBEAT in both versions: custom mode, kind of vehicle, kind of autopilot, base mode, state, MAVLink's version.
fn heartbeat_frames(mav_type: u8, autopilot: u8, base_mode: u8) -> [Vec<u8>; 2] {
    let payload = [0x78, 0x56, 0x34, 0x12, mav_type, autopilot, base_mode, 4, 3];
    [v1_frame(0, 50, &payload), v2_frame(0, 50, &payload)]
}

/// Decoded messages of a stream, and the number of rejected frames.
fn decoded_messages(bytes: &[u8]) -> (Vec<InboundMessage>, u32) {
    let mut receiver = MavlinkReceiver::default();
    let messages = bytes.iter().filter_map(|&byte| receiver.push_byte(byte)).collect();
    (messages, receiver.rejected_count())
}

fn attitude_message(body_rates: Option<BodyRates>) -> InboundMessage {
    InboundMessage::Attitude(AttitudeReport {
        sender: SENDER,
        sender_clock_at_sending: WrappingMillis::new(4321),
        attitude: RollPitch { roll_rad: 0.1, pitch_rad: -0.2 },
        body_rates,
    })
}

/// Asserts that a frame gives no message, and does not cost the next frame.
#[track_caller]
fn assert_ignored(frame: &[u8], rejected: u32, label: &str) {
    assert_eq!(decoded_messages(frame), (vec![], rejected), "{label}");
    for good in attitude_frames(ANGLES_AND_RATES) {
        assert_eq!(decoded_messages(&[frame, &good].concat()).0, decoded_messages(&good).0, "{label}");
    }
}

#[test]
fn every_field_of_an_attitude_message_is_decoded() {
    let expected = attitude_message(BodyRates::from_rad_s([0.4, -0.5, 0.6]));
    for frame in attitude_frames(ANGLES_AND_RATES) {
        assert_eq!(decoded_messages(&frame), (vec![expected], 0));
    }
}

/// An autopilot may round a half turn up by half a milliradian; a degree more is no angle.
#[test]
fn roll_beyond_180_and_pitch_beyond_90_deg_are_rejected() {
    const ROUNDING_RAD: f32 = 0.0005;
    let degrees = f32::to_radians;
    for sign in [1.0, -1.0] {
        for (roll, pitch, is_possible) in [
            (degrees(180.0) + ROUNDING_RAD, 0.0, true),
            (degrees(181.0), 0.0, false),
            (0.0, degrees(90.0) + ROUNDING_RAD, true),
            (0.0, degrees(91.0), false),
            (degrees(120.0), 0.0, true),
            (0.0, degrees(120.0), false),
            (f32::NAN, 0.0, false),
            (0.0, f32::NAN, false),
            (f32::INFINITY, 0.0, false),
            (0.0, f32::INFINITY, false),
        ] {
            for frame in attitude_frames([sign * roll, sign * pitch, f32::NAN, 0.0, 0.0, 0.0]) {
                let (messages, rejected) = decoded_messages(&frame);
                let expected = if is_possible { (1, 0) } else { (0, 1) };
                assert_eq!((messages.len(), rejected), expected, "{sign} {roll} {pitch}");
            }
        }
    }
}

/// Every kind but 8 is an autopilot, kinds unknown to this dialect included, unless the type is of a component. Of the
/// base mode only bit 128 counts.
#[test]
fn a_heartbeat_contains_autopilot_kind_and_armed_state() {
    let of_autopilots =
        [(0, true), (3, true), (7, true), (8, false), (9, true), (255, true)].map(|(a, is)| (255, a, is));
    let of_types = [(0, true), (2, true), (6, false), (18, false), (25, true), (26, false), (27, false), (35, true)];
    for (mav_type, autopilot, is_autopilot) in of_autopilots.into_iter().chain(of_types.map(|(t, is)| (t, 3, is))) {
        for (base_mode, is_armed) in [(0, false), (0x7F, false), (0x80, true), (0xFF, true)] {
            let heartbeat = Heartbeat { sender: SENDER, is_autopilot, is_armed };
            let expected = InboundMessage::Heartbeat(heartbeat, MavAutopilot(autopilot));
            for frame in heartbeat_frames(mav_type, autopilot, base_mode) {
                assert_eq!(decoded_messages(&frame), (vec![expected], 0), "{mav_type} {autopilot} {base_mode}");
            }
        }
    }
}

/// Version 2 truncates zeros, to one byte at least. A payload of another length is that of another message.
#[test]
fn version_2_payloads_may_be_truncated_and_version_1_may_not() {
    for (id, extra, v1_length, v2_length) in supported_messages() {
        let whole = vec![1; v2_length + 1];
        for length in 1..=v2_length {
            let zero_filled = [&whole[..length], &vec![0; v2_length - length]].concat();
            let truncated = decoded_messages(&v2_frame(id, extra, &whole[..length]));
            assert_eq!((truncated.0.len(), truncated.1), (1, 0), "{id} of {length} bytes");
            assert_eq!(truncated, decoded_messages(&v2_frame(id, extra, &zero_filled)), "{id} of {length} bytes");
        }
        let [v1, v2] = [v1_frame, v2_frame].map(|frame| decoded_messages(&frame(id, extra, &whole[..v1_length])));
        assert_eq!(v1, v2, "{id}");
        assert_ignored(&v2_frame(id, extra, &[]), 0, "empty");
        assert_ignored(&v2_frame(id, extra, &whole), 0, "too long");
        assert_ignored(&v1_frame(id, extra, &whole[..v1_length - 1]), 0, "version 1, too short");
        assert_ignored(&v1_frame(id, extra, &whole[..=v1_length]), 0, "version 1, too long");
    }
}

/// Each bit of the CRC, and the extra byte, which separates messages with equal layouts.
#[test]
fn a_wrong_crc_is_rejected_and_counted() {
    for (id, extra, length, _) in supported_messages() {
        for frame in [v1_frame, v2_frame].map(|frame| frame(id, extra, &vec![1; length])) {
            let (checked, _) = frame.split_at(frame.len() - 2);
            for bit in 0..16 {
                let mut broken = frame.clone();
                broken[checked.len() + bit / 8] ^= 1 << (bit % 8);
                assert_ignored(&broken, 1, "a bit of the CRC");
            }
            assert_ignored(&with_mavlink_crc(checked.to_vec(), extra ^ 1), 1, "extra byte");
        }
    }
}
