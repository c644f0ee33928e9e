//! Sent frames, byte for byte as pymavlink (2.4.50, dialect ardupilotmega) writes them.

use super::*;
use autoswing::time::Timestamp;
use mavlink_dialect::{MavResult, MavSeverity, MavState};

const OWN_ADDRESS: Address = Address { system_id: 7, component_id: 158 };
pub const AUTOPILOT: Address = Address { system_id: 7, component_id: 1 };

pub fn assert_encoded(message: OutboundMessage, hex: &str) {
    assert_eq!(message.into_frame(OWN_ADDRESS, 201, &mut Signatures::default())[..], bytes_from_hex(hex)[..]);
}

/// Zeros at the end of a payload are cut off, to one byte at least.
#[test]
fn every_message_has_the_bytes_of_pymavlink() {
    let at = Timestamp::from_us(123_456_789_012);
    let requester = Address { system_id: 255, component_id: 190 };
    let zero_address = Address { system_id: 0, component_id: 0 };
    let [accepted, rejected] = [MavResult::MAV_RESULT_ACCEPTED, MavResult::MAV_RESULT_TEMPORARILY_REJECTED];
    let [info, warning] = [MavSeverity::MAV_SEVERITY_INFO, MavSeverity::MAV_SEVERITY_WARNING];
    let pose =
        Pose { timestamp: at, roll_pitch_yaw_rad: [0.1, -0.2, 3.0], yaw_variance_rad2: 0.0004, reset_counter: 2 };
    let zero_bytes = |count| "00".repeat(count);
    let (angles, unknown) = ("cdcccc3dcdcc4cbe00004040", "00247449");
    let chunk = format!("fd360000c9079efd000006{}020103a662", "78".repeat(50));
    for (message, hex) in [
        (OutboundMessage::heartbeat(MavState::MAV_STATE_ACTIVE), "fd090000c9079e000000000000001208000403d5c9"),
        (
            OutboundMessage::set_message_interval(AUTOPILOT, 30, 40),
            "fd200000c9079e4c00000000f0410050c3460000000000000000000000000000000000000000ff01070110d4",
        ),
        (
            OutboundMessage::external_yaw_estimate(AUTOPILOT, &pose),
            "fd200000c9079e4c00000000c07f0000c07f29e32b430000c07f0000c07f0000c07f5dad923f6c020701cb00",
        ),
        (OutboundMessage::request_attitude_stream(AUTOPILOT, 25), "fd060000c9079e420000190007010a0185a0"),
        (OutboundMessage::acknowledgement(requester, 42_424, rejected), "fd0a0000c9079e4d0000b8a5010000000000ffbee40a"),
        (OutboundMessage::acknowledgement(zero_address, 42_424, accepted), "fd020000c9079e4d0000b8a5d472"),
        (
            OutboundMessage::status_text(warning, b"autoswing: refused", 0, 0),
            "fd130000c9079efd0000046175746f7377696e673a2072656675736564c16b",
        ),
        (OutboundMessage::status_text(info, &[b'x'; 50], 258, 3), &chunk),
        (OutboundMessage::status_text(info, &[b'x'; 51], 258, 3), &chunk),
        (
            OutboundMessage::named_value(Timestamp::from_us(123_456_000), "hdg_sigma", 1.5),
            "fd110000c9079efb000040e201000000c03f6864675f7369676d61b85c",
        ),
        (
            OutboundMessage::pose_estimate(&pose),
            &format!(
                "fd750000c9079e660000141a99be1c000000{}{angles}{unknown}{}{unknown}{}{unknown}{}17b7d139021c43",
                zero_bytes(12),
                zero_bytes(4 * 5),
                zero_bytes(4 * 4),
                zero_bytes(4 * 8),
            ),
        ),
    ] {
        assert_encoded(message, hex);
    }
    let frame = |message: OutboundMessage| message.into_frame(OWN_ADDRESS, 0, &mut Signatures::default());
    let empty = frame(OutboundMessage::acknowledgement(zero_address, 0, accepted));
    assert_eq!((&empty[..11], empty.len()), (&[0xFD, 1, 0, 0, 0, 7, 158, 77, 0, 0, 0][..], 13));
    assert_eq!(frame(OutboundMessage::named_value(at, "longer than ten", 1.5))[18..28], *b"longer tha");
}
