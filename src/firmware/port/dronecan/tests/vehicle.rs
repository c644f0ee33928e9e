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

fn tunnel_transfer(transfer_id: u8, data: &[u8]) -> OutboundTransfer {
    let piece = Targetted {
        protocol: Targetted::MAVLINK_2_PROTOCOL,
        target: OWN_NODE,
        serial_line: 0,
        tunnel_options: 1,
        baud: 57_600,
        serial_bytes: data,
    };
    transfer_from_peer(DataType::TARGETTED, transfer_id, &piece.payload())
}

/// SYS_STATUS with 5 A at byte 16.
#[test]
fn a_battery_replaces_the_current_of_the_tunnel() {
    let status = mavlink_v2_frame(AUTOPILOT, 1, 124, &[&[0; 16][..], &500_i16.to_le_bytes()].concat());
    let mut bench = Bench::new();
    let attitude = mavlink_attitude(AUTOPILOT, 77, [0.1, 0.0, 0.0, 0.1, 0.0, 0.0]);
    let stream = [mavlink_heartbeat(AUTOPILOT, true, false), attitude, status.clone()].concat();
    bench.deliver_transfer(PEER_NODE, &tunnel_transfer(0, &stream));
    assert!(bench.delivered.contains(&ReceivedMessage::Current(5.0)), "{:?}", bench.delivered);
    bench.deliver_transfer(20, &battery_transfer(0, 12.5));
    bench.delivered.clear();
    bench.deliver_transfer(PEER_NODE, &tunnel_transfer(1, &status));
    assert_eq!(bench.delivered, []);
}
