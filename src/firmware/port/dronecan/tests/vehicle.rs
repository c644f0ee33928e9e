//! Other nodes: armed state, battery, satellites, and the tunnel of a serial line.

use super::*;
use crate::wire::dronecan::Targetted;
use testkit::frames::{mavlink_attitude, mavlink_heartbeat, mavlink_v2_frame};

fn send_arming_status(bench: &mut Bench, source: u8, is_armed: bool) {
    bench.deliver_transfer(source, &transfer_from_peer(DataType::ARMING_STATUS, 0, &[u8::from(is_armed) * 255]));
}

/// A forged report of disarming does not end a flight while the autopilot reports that it is armed.
#[test]
fn armed_counts_until_the_same_node_disarms() {
    let mut bench = Bench::new();
    assert_eq!(bench.node.is_armed(bench.now()), Some(false));
    send_arming_status(&mut bench, PEER_NODE, true);
    send_arming_status(&mut bench, 66, false);
    assert_eq!(bench.node.is_armed(bench.now()), Some(true));
    send_arming_status(&mut bench, PEER_NODE, false);
    assert_eq!(bench.node.is_armed(bench.now()), Some(false));
    send_arming_status(&mut bench, 66, true);
    assert_eq!(bench.node.is_armed(bench.now()), Some(true));
    bench.now_us += 10_000_000;
    assert_eq!(bench.node.is_armed(bench.now()), Some(true));
    bench.now_us += 1;
    assert_eq!(bench.node.is_armed(bench.now()), None, "silence");
    send_arming_status(&mut bench, PEER_NODE, false);
    assert_eq!(bench.node.is_armed(bench.now()), Some(false));
}

/// Current as half precision at byte 4, number of the battery at byte 18.
fn battery_transfer(number: u8, current_a: f32) -> OutboundTransfer {
    let mut payload = [0; 30];
    payload[4..6].copy_from_slice(&half::f16::from_f32(current_a).to_le_bytes());
    payload[18] = number;
    transfer_from_peer(DataType::BATTERY_INFO, 0, &payload)
}

#[test]
fn the_current_is_that_of_the_first_battery() {
    let mut bench = Bench::new();
    for (source, number, current_a) in [(20, 0, 12.5), (20, 1, 3.0), (21, 0, 4.0), (20, 0, 13.0)] {
        bench.deliver_transfer(source, &battery_transfer(number, current_a));
    }
    bench.deliver_transfer(20, &battery_transfer(0, f32::NAN));
    assert_eq!(bench.delivered, [12.5, 13.0].map(ReceivedMessage::Current));
    bench.now_us += 10_000_001;
    bench.deliver_transfer(21, &battery_transfer(0, 4.0));
    assert_eq!(bench.delivered[2], ReceivedMessage::Current(4.0));
}

const AUTOPILOT: [u8; 2] = [1, 1];

fn attitude_frame(roll_rad: f32) -> Vec<u8> {
    mavlink_attitude(AUTOPILOT, 77, [roll_rad, 0.0, 0.0, 0.1, 0.0, 0.0])
}

fn heartbeat_frame(is_armed: bool) -> Vec<u8> {
    mavlink_heartbeat(AUTOPILOT, true, is_armed)
}

fn tunnel_transfer(transfer_id: u8, target: u8, serial: i8, data: &[u8]) -> OutboundTransfer {
    let piece = Targetted {
        protocol: Targetted::MAVLINK_2_PROTOCOL,
        target,
        serial_line: serial,
        tunnel_options: 1,
        baud: 57_600,
        serial_bytes: data,
    };
    transfer_from_peer(DataType::TARGETTED, transfer_id, &piece.payload())
}

fn received_rolls_rad(bench: &Bench) -> Vec<f32> {
    let roll = |message: &ReceivedMessage| match message {
        ReceivedMessage::Attitude(report) => Some(report.attitude.roll_rad),
        _ => None,
    };
    bench.delivered.iter().filter_map(roll).collect()
}

/// The stream is split within a frame, and each piece is received twice.
#[test]
fn mavlink_is_received_through_the_tunnel() {
    let mut bench = Bench::new();
    let stream = [heartbeat_frame(true), attitude_frame(0.1), attitude_frame(0.2)].concat();
    let (first, second) = stream.split_at(50);
    for (transfer_id, data) in [(0, first), (0, first), (1, second), (1, second)] {
        bench.deliver_transfer(PEER_NODE, &tunnel_transfer(transfer_id, OWN_NODE, 0, data));
    }
    assert_eq!(received_rolls_rad(&bench), [0.1, 0.2]);
    assert_eq!(bench.node.is_armed(bench.now()), Some(true));
}

/// Requests, heartbeats and headings are sent to the serial line that the autopilot uses, and nothing while it is
/// silent.
#[test]
fn mavlink_is_sent_through_the_tunnel() {
    let mut bench = Bench::new();
    assert!(bench.sent_in_ms(DataType::TARGETTED, 2000).is_empty());
    let mut bytes = Vec::new();
    for transfer_id in 0..20 {
        bench.deliver_transfer(PEER_NODE, &tunnel_transfer(transfer_id, OWN_NODE, 3, &heartbeat_frame(false)));
        for sent in bench.sent_in_ms(DataType::TARGETTED, 500) {
            // Protocol, target and serial line, options, baud rate.
            assert_eq!(sent.payload[..6], [1, PEER_NODE << 1, 0x30, 0x00, 0xE1, 0x00], "{sent:?}");
            bytes.extend_from_slice(&sent.payload[6..]);
        }
    }
    let starts = bytes.windows(10).filter(|window| window[0] == 0xFD && window[5..7] == [1, 158]).count();
    assert!(starts > 100, "{starts} messages of component 158");
    bench.run_ms(3100);
    assert!(bench.sent_in_ms(DataType::TARGETTED, 5000).is_empty(), "the autopilot is silent");
}

/// SYS_STATUS with 5 A at byte 16.
#[test]
fn a_battery_replaces_the_current_of_the_tunnel() {
    let status = mavlink_v2_frame(AUTOPILOT, 1, 124, &[&[0; 16][..], &500_i16.to_le_bytes()].concat());
    let mut bench = Bench::new();
    let stream = [heartbeat_frame(false), attitude_frame(0.1), status.clone()].concat();
    bench.deliver_transfer(PEER_NODE, &tunnel_transfer(0, OWN_NODE, 0, &stream));
    assert!(bench.delivered.contains(&ReceivedMessage::Current(5.0)), "{:?}", bench.delivered);
    bench.deliver_transfer(20, &battery_transfer(0, 12.5));
    bench.delivered.clear();
    bench.deliver_transfer(PEER_NODE, &tunnel_transfer(1, OWN_NODE, 0, &status));
    assert_eq!(bench.delivered, []);
}
