//! The receiver.

mod inbound;
mod outbound;
mod random_bytes;
mod signature;

use super::*;
use autoswing::attitude::{AttitudeReport, BodyRates, Heartbeat};
use autoswing::frames::Attitude;
use autoswing::time::WrappingMillis;
use mavlink::dialects::common::{ATTITUDE_DATA, HEARTBEAT_DATA, MavAutopilot, MavModeFlag};
use mavlink::{MAVLinkV1MessageRaw, MAVLinkV2MessageRaw, MavHeader};
use testkit::random::Random;

fn attitude_data(roll: f32) -> ATTITUDE_DATA {
    ATTITUDE_DATA { time_boot_ms: 1234, roll, pitch: -0.1, yaw: f32::NAN, ..Default::default() }
}

fn library_v2_frame(data: &ATTITUDE_DATA) -> Vec<u8> {
    let mut raw = MAVLinkV2MessageRaw::new();
    raw.serialize_message_data(MavHeader { system_id: 1, component_id: 1, sequence: 7 }, data);
    raw.raw_bytes().to_vec()
}

fn library_v1_frame(data: &ATTITUDE_DATA) -> Vec<u8> {
    let mut raw = MAVLinkV1MessageRaw::new();
    raw.serialize_message_data(MavHeader { system_id: 1, component_id: 1, sequence: 7 }, data);
    raw.raw_bytes().to_vec()
}

fn decoded_messages(bytes: &[u8]) -> (Vec<InboundMessage>, u32) {
    let mut receiver = Receiver::new();
    let messages = bytes.iter().filter_map(|&byte| receiver.push_byte(byte)).collect();
    (messages, receiver.rejected_count)
}

/// Attitude reports in a stream, and the number of rejected frames.
fn received_reports(bytes: &[u8]) -> (Vec<AttitudeReport>, u32) {
    let (messages, rejected) = decoded_messages(bytes);
    let report = |message| match message {
        InboundMessage::Attitude(report) => Some(report),
        _ => None,
    };
    (messages.into_iter().filter_map(report).collect(), rejected)
}

#[test]
fn attitude_is_decoded_from_both_versions_without_yaw() {
    let bytes = [library_v1_frame(&attitude_data(0.25)), library_v2_frame(&attitude_data(-0.5))].concat();
    let (reports, rejected) = received_reports(&bytes);
    let rolls: Vec<f32> = reports.iter().map(|r| r.attitude.roll_rad).collect();
    assert_eq!(rolls, [0.25, -0.5]);
    assert_eq!((reports[0].sender_clock_at_sending.as_ms(), rejected), (1234, 0));
}

#[test]
fn a_truncated_frame_costs_no_later_frame() {
    // A truncated frame, then a whole one within the length that the first claims.
    let whole = library_v2_frame(&attitude_data(0.3));
    for cut in 0..whole.len() {
        let (reports, _) = received_reports(&[&whole[..cut], &whole[..]].concat());
        assert_eq!(reports.len(), 1, "cut at {cut}");
    }
}

#[test]
fn a_frame_with_a_flipped_bit_is_never_accepted() {
    let whole = library_v2_frame(&attitude_data(0.3));
    for bit in 0..whole.len() * 8 {
        let mut broken = whole.clone();
        broken[bit / 8] ^= 1 << (bit % 8);
        let (reports, _) = received_reports(&[&broken[..], &whole[..]].concat());
        assert!(reports.iter().all(|r| (r.attitude.roll_rad - 0.3).abs() < 1e-6), "bit {bit}");
        assert!(!reports.is_empty(), "bit {bit} cost the next frame");
    }
}

#[test]
fn impossible_angles_are_rejected() {
    for roll in [f32::NAN, f32::INFINITY, 4.0] {
        let (reports, rejected) = received_reports(&library_v2_frame(&attitude_data(roll)));
        assert!(reports.is_empty());
        assert_eq!(rejected, 1);
    }
}

#[test]
fn random_bytes_never_panic_and_frames_between_them_are_found() {
    let mut random = Random(1);
    let mut receiver = Receiver::new();
    let mut found = 0;
    for _ in 0..2000 {
        for _ in 0..50 {
            // Every fourth byte starts a frame of either version: far worse than noise.
            let byte = random.byte();
            receiver.push_byte(if byte < 0x40 { 0xFD + byte % 2 } else { random.byte() });
        }
        for byte in library_v2_frame(&attitude_data(0.3)) {
            found += usize::from(receiver.push_byte(byte).is_some());
        }
    }
    // A false header that overlaps the frame only delays it until enough bytes arrive to reject the header.
    assert!(found >= 1990, "{found} of 2000");
}

/// CRC-16/MCRF4XX without the first byte, with the message's extra byte; implemented from MAVLink's guide, independent
/// of the receiver's library.
fn crc_bytes(bytes: &[u8], extra: u8) -> [u8; 2] {
    let mut crc = 0xFFFF_u16;
    for byte in bytes.iter().chain([&extra]) {
        let mut mixed = byte ^ crc as u8;
        mixed ^= mixed << 4;
        let mixed = u16::from(mixed);
        crc = (crc >> 8) ^ (mixed << 8) ^ (mixed << 3) ^ (mixed >> 4);
    }
    crc.to_le_bytes()
}

/// Appends the CRC of ATTITUDE, whose extra byte is 39.
fn with_crc(frame: Vec<u8>) -> Vec<u8> {
    with_crc_of(39, frame)
}

fn with_crc_of(extra: u8, mut frame: Vec<u8>) -> Vec<u8> {
    frame.extend(crc_bytes(&frame[1..], extra));
    frame
}

/// Payload of ATTITUDE: time, roll, pitch, yaw and the three rates, little endian.
fn attitude_payload(numbers: [f32; 6]) -> Vec<u8> {
    let mut payload = 4321_u32.to_le_bytes().to_vec();
    payload.extend(numbers.iter().flat_map(|number| number.to_le_bytes()));
    payload
}

fn handmade_v1_frame(id: u8, payload: &[u8]) -> Vec<u8> {
    with_crc([&[0xFE, payload.len() as u8, 0, 1, 1, id], payload].concat())
}

fn handmade_v2_frame(incompatibility: u8, id: [u8; 3], payload: &[u8]) -> Vec<u8> {
    let header = [0xFD, payload.len() as u8, incompatibility, 0, 0, 1, 1];
    with_crc([&header, &id[..], payload].concat())
}

const ATTITUDE_ID: [u8; 3] = [30, 0, 0];
const ATTITUDE_FIELD_VALUES: [f32; 6] = [0.1, -0.2, 3.0, 0.4, -0.5, 0.6];

fn attitude_frames(roll: f32) -> [Vec<u8>; 2] {
    let payload = attitude_payload([roll, -0.2, 3.0, 0.4, -0.5, 0.6]);
    [handmade_v1_frame(30, &payload), handmade_v2_frame(0, ATTITUDE_ID, &payload)]
}

fn assert_ignored(frame: &[u8], rejected: u32, label: &str) {
    assert_eq!(received_reports(frame), (vec![], rejected), "{label}");
    for good in attitude_frames(0.7) {
        let (reports, _) = received_reports(&[frame, &good[..]].concat());
        assert_eq!(reports.iter().map(|r| r.attitude.roll_rad).collect::<Vec<_>>(), [0.7], "{label}");
    }
}

#[test]
fn every_field_of_an_attitude_message_is_decoded() {
    let expected = AttitudeReport {
        sender: SenderId::new(0x0101),
        sender_clock_at_sending: WrappingMillis::new(4321),
        attitude: Attitude { roll_rad: 0.1, pitch_rad: -0.2 },
        body_rates: BodyRates::from_rad_s([0.4, -0.5, 0.6]),
    };
    for frame in [
        handmade_v1_frame(30, &attitude_payload(ATTITUDE_FIELD_VALUES)),
        handmade_v2_frame(0, ATTITUDE_ID, &attitude_payload(ATTITUDE_FIELD_VALUES)),
    ] {
        assert_eq!(received_reports(&frame), (vec![expected], 0));
    }
}

/// A signature has 13 bytes of any content; the report is returned with its last byte.
#[test]
fn an_attitude_is_returned_with_the_last_byte_of_its_frame() {
    let signed =
        [&handmade_v2_frame(1, ATTITUDE_ID, &attitude_payload(ATTITUDE_FIELD_VALUES))[..], &[0xFD; 13]].concat();
    let [v1, v2] = attitude_frames(0.1);
    for frame in [v1, v2, signed.clone()] {
        let mut receiver = Receiver::new();
        for _ in 0..3 {
            let (last, rest) = frame.split_last().unwrap();
            assert!(rest.iter().all(|&byte| receiver.push_byte(byte).is_none()));
            assert!(receiver.push_byte(*last).is_some());
        }
        assert_eq!(receiver.rejected_count, 0);
    }
}

#[test]
fn frames_with_unknown_incompatibility_flags_are_ignored() {
    for flags in [0x02, 0x03, 0x40, 0x80, 0xFE, 0xFF] {
        assert_ignored(&handmade_v2_frame(flags, ATTITUDE_ID, &attitude_payload(ATTITUDE_FIELD_VALUES)), 0, "flags");
    }
}

/// Compatibility flags are byte 3 of the header.
#[test]
fn compatibility_flags_are_ignored() {
    let mut frame = handmade_v2_frame(0, ATTITUDE_ID, &attitude_payload(ATTITUDE_FIELD_VALUES));
    frame.truncate(10 + 28);
    frame[3] = 0xFF;
    assert_eq!(received_reports(&with_crc(frame)).0.len(), 1);
}

#[test]
fn other_messages_are_skipped() {
    for id in [[31, 0, 0], [29, 0, 0], [30, 1, 0], [30, 0, 1], [0, 0, 30]] {
        assert_ignored(&handmade_v2_frame(0, id, &attitude_payload(ATTITUDE_FIELD_VALUES)), 0, "id");
    }
    for id in [29, 31, 0, 255] {
        assert_ignored(&handmade_v1_frame(id, &attitude_payload(ATTITUDE_FIELD_VALUES)), 0, "id");
    }
}

/// Version 2 truncates zeros, to one byte at least; shorter and longer payloads are skipped.
#[test]
fn version_2_payloads_may_be_truncated_and_version_1_may_not() {
    let whole = attitude_payload(ATTITUDE_FIELD_VALUES);
    for length in 1..=28 {
        let mut filled = whole[..length].to_vec();
        let frame = handmade_v2_frame(0, ATTITUDE_ID, &filled);
        filled.resize(28, 0);
        let (reports, rejected) = received_reports(&frame);
        let (expected, _) = received_reports(&handmade_v1_frame(30, &filled));
        assert_eq!((reports.len(), rejected), (1, 0), "{length}");
        assert_eq!(reports, expected, "{length}");
    }
    assert_ignored(&handmade_v2_frame(0, ATTITUDE_ID, &[]), 0, "length 0");
    assert_ignored(&handmade_v2_frame(0, ATTITUDE_ID, &[&whole[..], &[0]].concat()), 0, "length 29");
    assert_ignored(&handmade_v1_frame(30, &whole[..27]), 0, "version 1, length 27");
    assert_ignored(&handmade_v1_frame(30, &[&whole[..], &[0]].concat()), 0, "version 1, length 29");
}

/// The limits have a margin of 0.001 rad for rounding.
#[test]
fn roll_beyond_180_and_pitch_beyond_90_deg_are_rejected() {
    use core::f32::consts::{FRAC_PI_2, PI};
    for sign in [1.0, -1.0] {
        for (roll, pitch, possible) in [
            (PI + 0.000_95, 0.0, true),
            (PI + 0.001_05, 0.0, false),
            (0.0, FRAC_PI_2 + 0.000_95, true),
            (0.0, FRAC_PI_2 + 0.001_05, false),
            (0.0, 2.0, false),
            (2.0, 0.0, true),
            (0.0, f32::NAN, false),
            (f32::NAN, 0.0, false),
            (0.0, f32::INFINITY, false),
        ] {
            let payload = attitude_payload([sign * roll, sign * pitch, 0.0, 0.0, 0.0, 0.0]);
            for frame in [handmade_v1_frame(30, &payload), handmade_v2_frame(0, ATTITUDE_ID, &payload)] {
                let (reports, rejected) = received_reports(&frame);
                let expected = if possible { (1, 0) } else { (0, 1) };
                assert_eq!((reports.len(), rejected), expected, "{sign} {roll} {pitch}");
            }
        }
    }
}

#[test]
fn with_a_non_finite_rate_a_report_has_no_rates() {
    for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
        for axis in 0..3 {
            let mut numbers = ATTITUDE_FIELD_VALUES;
            numbers[3 + axis] = bad;
            let (reports, _) = received_reports(&handmade_v2_frame(0, ATTITUDE_ID, &attitude_payload(numbers)));
            assert_eq!((reports.len(), reports[0].body_rates), (1, None));
        }
    }
}

/// Each bit of the CRC, and the extra byte, which separates ATTITUDE from a message with an equal layout.
#[test]
fn a_wrong_crc_is_rejected_and_counted() {
    for frame in attitude_frames(0.3) {
        for bit in 0..16 {
            let mut broken = frame.clone();
            let at = broken.len() - 2 + bit / 8;
            broken[at] ^= 1 << (bit % 8);
            assert_ignored(&broken, 1, "bit");
        }
        let mut other = frame[..frame.len() - 2].to_vec();
        other.extend(crc_bytes(&frame[1..frame.len() - 2], 38));
        assert_ignored(&other, 1, "extra byte");
    }
}

#[test]
fn the_count_of_rejected_frames_wraps() {
    let mut receiver = Receiver { rejected_count: u32::MAX - 1, ..Receiver::new() };
    let mut broken = handmade_v1_frame(30, &attitude_payload(ATTITUDE_FIELD_VALUES));
    *broken.last_mut().unwrap() ^= 1;
    let mut counts = Vec::new();
    for _ in 0..3 {
        for &byte in &broken {
            assert_eq!(receiver.push_byte(byte), None);
        }
        counts.push(receiver.rejected_count);
    }
    assert_eq!(counts, [u32::MAX, 0, 1]);
}

/// Magic bytes, truncated headers, frames of other messages, text. The frame is received no later than the end of the
/// longest false frame before it.
#[test]
fn the_frame_after_every_kind_of_garbage_is_found() {
    let whole = attitude_payload(ATTITUDE_FIELD_VALUES);
    let mut garbage: Vec<Vec<u8>> = vec![vec![0xFD], vec![0xFE], vec![0xFD, 0xFE], vec![0xFE; 7], vec![0xFD; 11]];
    for frame in [
        handmade_v1_frame(30, &whole),
        handmade_v2_frame(0, ATTITUDE_ID, &whole),
        handmade_v2_frame(1, ATTITUDE_ID, &whole),
        handmade_v2_frame(0, [76, 0, 0], &[7; 33]),
    ] {
        garbage.extend((1..frame.len()).map(|cut| frame[..cut].to_vec()));
        garbage.extend((1..frame.len()).map(|cut| frame[cut..].to_vec()));
    }
    garbage.push(b"$GPHDT,123.4,T*31\r\n".to_vec());
    let flush = [0; MAX_FRAME_LENGTH];
    for before in &garbage {
        for good in attitude_frames(0.7) {
            let (reports, _) = received_reports(&[&before[..], &good, &flush].concat());
            let found = reports.iter().filter(|report| (report.attitude.roll_rad - 0.7).abs() < 1e-6).count();
            assert_eq!(found, 1, "{before:02X?}");
        }
    }
}

/// Sender of the heartbeats: system 12, component 34.
const SENDER: SenderId = SenderId::new(12 * 256 + 34);

/// Payload of HEARTBEAT: custom mode, kind of vehicle, kind of autopilot, base mode, state, MAVLink's version.
fn heartbeat_payload(vehicle: u8, autopilot: u8, base_mode: u8) -> [u8; 9] {
    [0x78, 0x56, 0x34, 0x12, vehicle, autopilot, base_mode, 4, 3]
}

/// HEARTBEAT in each version, with CRC extra byte 50.
fn heartbeat_frames(payload: &[u8]) -> [Vec<u8>; 2] {
    let length = payload.len() as u8;
    [
        with_crc_of(50, [&[0xFE, length, 0, 12, 34, 0], payload].concat()),
        with_crc_of(50, [&[0xFD, length, 0, 0, 0, 12, 34, 0, 0, 0], payload].concat()),
    ]
}

fn expected_heartbeat(is_autopilot: bool, is_armed: bool) -> (Vec<InboundMessage>, u32) {
    (vec![InboundMessage::Heartbeat(Heartbeat { sender: SENDER, is_autopilot, is_armed })], 0)
}

/// Every kind but 8 is an autopilot, kinds unknown to this dialect included. Of the base mode only bit 128 counts.
#[test]
fn a_heartbeat_contains_autopilot_kind_and_armed_state() {
    for (autopilot, is_autopilot) in [(0, true), (3, true), (7, true), (8, false), (9, true), (12, true), (255, true)] {
        for (base_mode, is_armed) in [(0, false), (0x7F, false), (0x80, true), (0xFF, true)] {
            for vehicle in [1, 255] {
                for frame in heartbeat_frames(&heartbeat_payload(vehicle, autopilot, base_mode)) {
                    assert_eq!(
                        decoded_messages(&frame),
                        expected_heartbeat(is_autopilot, is_armed),
                        "{autopilot} {base_mode}"
                    );
                }
            }
        }
    }
}

/// Written by the library of the simulated autopilot.
#[test]
fn a_heartbeat_of_the_mavlink_library_is_decoded() {
    let data = HEARTBEAT_DATA {
        custom_mode: 0,
        mavtype: mavlink::dialects::common::MavType::MAV_TYPE_GCS,
        autopilot: MavAutopilot::MAV_AUTOPILOT_INVALID,
        base_mode: MavModeFlag::MAV_MODE_FLAG_SAFETY_ARMED,
        system_status: mavlink::dialects::common::MavState::MAV_STATE_ACTIVE,
        mavlink_version: 3,
    };
    let header = MavHeader { system_id: 12, component_id: 34, sequence: 200 };
    let (mut v1, mut v2) = (MAVLinkV1MessageRaw::new(), MAVLinkV2MessageRaw::new());
    v1.serialize_message_data(header, &data);
    v2.serialize_message_data(header, &data);
    for frame in [v1.raw_bytes(), v2.raw_bytes()] {
        assert_eq!(decoded_messages(frame), expected_heartbeat(false, true));
    }
}

#[test]
fn an_attitude_report_contains_its_sender() {
    let payload = attitude_payload(ATTITUDE_FIELD_VALUES);
    let v1 = with_crc([&[0xFE, 28, 0, 12, 34, 30], &payload[..]].concat());
    let v2 = with_crc([&[0xFD, 28, 0, 0, 0, 12, 34, 30, 0, 0], &payload[..]].concat());
    for frame in [v1, v2] {
        let (reports, _) = received_reports(&frame);
        assert_eq!(reports.iter().map(|report| report.sender).collect::<Vec<_>>(), [SENDER]);
    }
    let swapped = with_crc([&[0xFE, 28, 0, 34, 12, 30], &payload[..]].concat());
    assert_ne!(received_reports(&swapped).0[0].sender, SENDER);
}

#[test]
fn heartbeats_are_skipped_if_too_long_or_cut_in_version_1() {
    let whole = heartbeat_payload(1, 3, 0x80);
    for length in 1..=9 {
        let [v1, v2] = heartbeat_frames(&whole[..length]);
        if length < 9 {
            assert_ignored(&v1, 0, "version 1 is never cut");
        }
        // Truncated bytes are zero: kind 0 is an autopilot, mode 0 is disarmed.
        assert_eq!(decoded_messages(&v2), expected_heartbeat(true, length > 6), "{length}");
    }
    for too_long in [&[&whole[..], &[0]].concat()[..], &[1; 28], &[1; 29]] {
        for frame in heartbeat_frames(too_long) {
            assert_ignored(&frame, 0, "too long");
        }
    }
    assert_ignored(&handmade_v1_frame(30, &whole), 0, "attitude as long as a heartbeat");
}

#[test]
fn a_heartbeat_with_wrong_crc_is_rejected_and_counted() {
    for frame in heartbeat_frames(&heartbeat_payload(1, 3, 0)) {
        for bit in 0..16 {
            let mut broken = frame.clone();
            let at = broken.len() - 2 + bit / 8;
            broken[at] ^= 1 << (bit % 8);
            assert_eq!(decoded_messages(&broken), (vec![], 1));
        }
        let frame_without_crc = frame[..frame.len() - 2].to_vec();
        assert_ignored(&with_crc_of(39, frame_without_crc), 1, "attitude's extra byte");
    }
}

#[test]
fn a_damaged_heartbeat_costs_no_other_frame() {
    let good = heartbeat_payload(2, 3, 0x80);
    for frame in heartbeat_frames(&good) {
        let mut broken: Vec<Vec<u8>> = (0..frame.len()).map(|cut| frame[..cut].to_vec()).collect();
        broken.extend((0..frame.len() * 8).map(|bit| {
            let mut flipped = frame.clone();
            flipped[bit / 8] ^= 1 << (bit % 8);
            flipped
        }));
        for before in broken {
            for next in heartbeat_frames(&good).into_iter().chain(attitude_frames(0.7)) {
                // Zeros end any pending false frame.
                let (found, _) = decoded_messages(&[&before[..], &next, &[0; MAX_FRAME_LENGTH]].concat());
                assert_eq!(found, decoded_messages(&next).0, "{before:02X?}");
            }
        }
    }
}
