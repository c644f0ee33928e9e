//! Sent frames, byte for byte as pymavlink (2.4.50, dialect ardupilotmega) writes them.

use super::inbound::bytes_of_hex;
use super::*;
use autoswing::time::Timestamp;
use mavlink_dialect::{MavResult, MavSeverity, MavState};

const OWN_ADDRESS: Address = Address { system_id: 7, component_id: 158 };
pub const AUTOPILOT: Address = Address { system_id: 7, component_id: 1 };

pub fn assert_encoded(message: OutboundMessage, hex: &str) {
    assert_eq!(message.into_frame(OWN_ADDRESS, 201, &mut Signatures::new())[..], bytes_of_hex(hex)[..]);
}

#[test]
fn heartbeats_are_sent_as_an_onboard_controller() {
    assert_encoded(
        OutboundMessage::heartbeat(MavState::MAV_STATE_ACTIVE),
        "fd090000c9079e000000000000001208000403d5c9",
    );
}

#[test]
fn attitude_is_requested_by_message_interval_and_by_stream() {
    assert_encoded(
        OutboundMessage::set_message_interval(AUTOPILOT, 30, 40),
        "fd200000c9079e4c00000000f0410050c3460000000000000000000000000000000000000000ff01070110d4",
    );
    assert_encoded(OutboundMessage::request_attitude_stream(AUTOPILOT, 25), "fd060000c9079e420000190007010a0185a0");
}

#[test]
fn an_acknowledgement_is_addressed_to_the_requester() {
    let to = Address { system_id: 255, component_id: 190 };
    let rejected = MavResult::MAV_RESULT_TEMPORARILY_REJECTED;
    assert_encoded(
        OutboundMessage::acknowledgement(to, 42_424, rejected),
        "fd0a0000c9079e4d0000b8a5010000000000ffbee40a",
    );
}

#[test]
fn a_status_text_is_encoded_in_chunks_of_50() {
    let warning = MavSeverity::MAV_SEVERITY_WARNING;
    assert_encoded(
        OutboundMessage::status_text(warning, b"autoswing: refused", 0, 0),
        "fd130000c9079efd0000046175746f7377696e673a2072656675736564c16b",
    );
    let full = format!("fd360000c9079efd000006{}020103a662", "78".repeat(50));
    assert_encoded(OutboundMessage::status_text(MavSeverity::MAV_SEVERITY_INFO, &[b'x'; 50], 258, 3), &full);
    assert_encoded(OutboundMessage::status_text(MavSeverity::MAV_SEVERITY_INFO, &[b'x'; 51], 258, 3), &full);
}

#[test]
fn a_named_value_has_a_name_of_up_to_ten_characters() {
    let at = Timestamp::from_us(123_456_000);
    assert_encoded(
        OutboundMessage::named_value(at, "hdg_sigma", 1.5),
        "fd110000c9079efb000040e201000000c03f6864675f7369676d61b85c",
    );
    let frame =
        OutboundMessage::named_value(at, "longer than ten", 1.5).into_frame(OWN_ADDRESS, 0, &mut Signatures::new());
    assert_eq!(frame[18..28], *b"longer tha");
}

#[test]
fn progress_has_the_running_state_until_100_percent() {
    let direction = [0.5, -0.25, 0.75];
    assert_encoded(
        OutboundMessage::mag_cal_progress(40, direction),
        "fd110000c9079ebf00000000003f000080be0000403f0001020128aea7",
    );
    assert_encoded(
        OutboundMessage::mag_cal_progress(100, direction),
        "fd110000c9079ebf00000000003f000080be0000403f0001030164d354",
    );
}

#[test]
fn a_calibration_report_contains_the_parameters_of_a_success() {
    let report = MagCalReport {
        is_success: true,
        fitness_mg: 3.5,
        offset_mg: [-120.0, 80.0, -200.0],
        diagonal: [1.1, 0.9, 1.05],
        off_diagonal: [0.02, -0.03, 0.04],
    };
    assert_encoded(
        OutboundMessage::mag_cal_report(&report),
        "fd2c0000c9079ec00000000060400000f0c20000a042000048c3cdcc8c3f6666663f6666863f0ad7a33c8fc2f5bc0ad7233d0001040159ac",
    );
    let failure = MagCalReport {
        is_success: false,
        fitness_mg: 0.0,
        offset_mg: [0.0; 3],
        diagonal: [1.0; 3],
        off_diagonal: [0.0; 3],
    };
    assert_encoded(
        OutboundMessage::mag_cal_report(&failure),
        &format!("fd2b0000c9079ec00000{}{}{}0001051f97", "00".repeat(16), "0000803f".repeat(3), "00".repeat(12)),
    );
}

#[test]
fn a_pose_contains_the_heading_variance() {
    let pose = Pose {
        timestamp: Timestamp::from_us(123_456_789_012),
        roll_pitch_yaw_rad: [0.1, -0.2, 3.0],
        yaw_variance_rad2: 0.0004,
        reset_counter: 2,
    };
    let angles = "cdcccc3dcdcc4cbe00004040";
    let unknown = "00247449";
    let hex = format!(
        "fd750000c9079e660000141a99be1c000000{}{angles}{unknown}{}{unknown}{}{unknown}{}17b7d139021c43",
        "00".repeat(12),
        "00".repeat(4 * 5),
        "00".repeat(4 * 4),
        "00".repeat(4 * 8),
    );
    assert_encoded(OutboundMessage::pose_estimate(&pose), &hex);
}

#[test]
fn zeros_at_the_end_are_cut_off() {
    let zero_address = Address { system_id: 0, component_id: 0 };
    let ack = |command| OutboundMessage::acknowledgement(zero_address, command, MavResult::MAV_RESULT_ACCEPTED);
    assert_encoded(ack(42_424), "fd020000c9079e4d0000b8a5d472");
    assert_eq!(
        ack(0).into_frame(OWN_ADDRESS, 0, &mut Signatures::new())[..11],
        [0xFD, 1, 0, 0, 0, 7, 158, 77, 0, 0, 0]
    );
    assert_eq!(ack(0).into_frame(OWN_ADDRESS, 0, &mut Signatures::new()).len(), 13);
}
