//! Fuzz test of a port with both protocols and protocol detection.

use autoswing::frames::Field;
use autoswing::instrument::Estimate;
use autoswing::time::Timestamp;
use autoswing_firmware::port::{Port, ReceivedMessage, Snapshot};
use autoswing_module::compass::IndicatorState;
use autoswing_module::settings::{ProtocolKind, Settings};
use proptest::prelude::*;

use crate::stream::{self, Piece};
use crate::{PropertyResult, check_property, mavlink, msp};

/// Silence after which a port discards the detected protocol, microseconds.
const SILENCE_US: u64 = 10_000_000;

/// HEARTBEAT of ArduPilot.
const HEARTBEAT: &[u8] = &[0xFD, 9, 0, 0, 0, 1, 1, 0, 0, 0, 0, 0, 0, 0, 2, 3, 81, 4, 3, 0xE7, 0x1E];
/// INAV's reply to MSP_FC_VARIANT.
const VARIANT_REPLY: &[u8] = b"$X>\x00\x02\x00\x04\x00INAV\x94";

/// Pieces of both protocols with the preceding time, milliseconds.
fn any_stream() -> impl Strategy<Value = Vec<(u16, Piece)>> {
    let frames = prop_oneof![mavlink::any_frame().boxed(), msp::any_frame().boxed()];
    stream::any_pieces(frames, &[0xFE, 0xFD, b'$']).prop_flat_map(|pieces| {
        let times = proptest::collection::vec(0..3_000_u16, pieces.len());
        (times, Just(pieces)).prop_map(|(times, pieces)| times.into_iter().zip(pieces).collect())
    })
}

/// Polls a port and returns the number of output bytes.
fn poll_output_length(port: &mut Port, now: Timestamp) -> usize {
    let compass = Some(Field::from_ut(20.0, 0.0, 40.0));
    let estimate = Estimate { timestamp: now, compass_field: compass, ..Estimate::EMPTY };
    let settings = Settings { sends_vision_yaw: true, ..Settings::DEFAULT };
    let snapshot = Snapshot {
        now,
        estimate: &estimate,
        settings: &settings,
        indicator_state: IndicatorState::Collecting(7),
        calibration: None,
        can_node: None,
    };
    port.poll(&snapshot);
    let sent_length = port.pending_output.pending_bytes().len();
    port.pending_output.consume_bytes(usize::MAX);
    sent_length
}

fn is_attitude_in_frames(bytes: &[u8], roll_rad: f32, pitch_rad: f32) -> bool {
    mavlink::intact_frames(bytes).iter().any(|frame| frame.has_angles(roll_rad, pitch_rad))
        || msp::intact_frames(bytes).iter().any(|frame| frame.has_angles(roll_rad.to_degrees(), pitch_rad.to_degrees()))
}

/// A reported attitude was in an intact frame. Without a MAVLink peer, output per sample is at most a compass sample
/// and two requests. After a silence the protocol is detected from the first frame after at most one longest frame, or
/// after another silence if noise was mistaken for the other protocol.
#[test]
fn a_port_detects_the_protocol_of_its_peer() {
    check_property((any_stream(), any::<bool>()), |(pieces, is_msp)| -> PropertyResult {
        let mut port = Port::new(ProtocolKind::Auto, ProtocolKind::Auto, Timestamp::START);
        let (mut now_us, mut bytes) = (0, Vec::new());
        for (pause_ms, piece) in &pieces {
            for _ in 0..pause_ms / 500 {
                now_us += 500_000;
                let sent_length = poll_output_length(&mut port, Timestamp::from_us(now_us));
                let is_mavlink = port.active_protocol(Timestamp::from_us(now_us)) == ProtocolKind::Mavlink;
                prop_assert!(sent_length <= if is_mavlink { 384 } else { 20 + 2 * 9 }, "{sent_length} bytes");
            }
            for byte in stream::joined_bytes(std::slice::from_ref(piece)) {
                bytes.push(byte);
                if let Some(ReceivedMessage::Attitude(report)) = port.process_byte(Timestamp::from_us(now_us), byte) {
                    let (roll_rad, pitch_rad) = (report.attitude.roll_rad, report.attitude.pitch_rad);
                    prop_assert!(
                        is_attitude_in_frames(&bytes, roll_rad, pitch_rad),
                        "{report:?} is in no intact frame"
                    );
                }
            }
        }
        let (frame, expected_protocol) =
            if is_msp { (VARIANT_REPLY, ProtocolKind::Msp) } else { (HEARTBEAT, ProtocolKind::Mavlink) };
        for _ in 0..2 {
            now_us += SILENCE_US + 1;
            for byte in std::iter::repeat_n(frame, 73_usize.div_ceil(frame.len()) + 1).flatten() {
                let _ = port.process_byte(Timestamp::from_us(now_us), *byte);
            }
            if port.active_protocol(Timestamp::from_us(now_us)) == expected_protocol {
                return Ok(());
            }
        }
        prop_assert!(false, "{expected_protocol:?} is not found");
        Ok(())
    });
}
