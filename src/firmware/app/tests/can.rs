//! Task of a CAN bus beside the other tasks.

use super::TaskBench;
use super::port::heartbeat_and_attitude_frames;
use super::safe_mode::{FakeCanBus, OWN_NODE, RESTART_PAYLOAD};
use crate::app::can::NoBootLoader;
use crate::app::task_links::{AutopilotLine, publish_value};
use crate::wire::dronecan::{DataType, Targetted};
use autoswing::instrument::Estimate;
use autoswing_module::messages::Message;
use autoswing_module::settings::{PortNumber, ProtocolKind, Settings, SigningKey};

const SETTINGS_WITH_NODE: Settings = Settings { can_node: OWN_NODE, can_is_terminated: true, ..Settings::DEFAULT };

fn publish_settings(bench: &TaskBench, settings: Settings) {
    publish_value(&bench.links.settings, settings);
    publish_value(&bench.links.stored_settings, settings);
}

fn publish_estimates(bench: &mut TaskBench, ms: u64) {
    bench.publish_estimates(Estimate::EMPTY.heading, ms);
}

fn bench_with_node() -> (TaskBench, FakeCanBus) {
    let (mut bench, bus) = (TaskBench::new(), FakeCanBus::default());
    run_node(&mut bench, &bus);
    (bench, bus)
}

fn run_node(bench: &mut TaskBench, bus: &FakeCanBus) {
    publish_settings(bench, SETTINGS_WITH_NODE);
    bus.run_node(bench, bus.clone(), false);
    bus.queue_message(DataType::ARMING_STATUS, &[0]);
    publish_estimates(bench, 100);
    bus.take_sent_data(DataType::NODE_STATUS);
}

#[test]
fn the_termination_is_as_set() {
    let (mut bench, bus) = bench_with_node();
    assert_eq!(bus.termination_states.take(), [true]);
    publish_settings(&bench, Settings { can_is_terminated: false, ..SETTINGS_WITH_NODE });
    publish_estimates(&mut bench, 50);
    assert_eq!(bus.termination_states.take(), [false]);
}

#[test]
fn requests_do_not_wait_for_an_estimate() {
    let (mut bench, bus) = bench_with_node();
    bus.queue_message(DataType::GET_NODE_INFO, &[]);
    bench.run_for_ms(5);
    assert!(!bus.take_sent_data(DataType::GET_NODE_INFO).is_empty());
}

/// An autopilot on a port, or a node of the bus, reports that the vehicle is armed.
#[test]
fn armed_states_of_ports_and_bus_count_for_each_other() {
    let (mut bench, bus) = (TaskBench::with_compass(), FakeCanBus::default());
    run_node(&mut bench, &bus);
    let port = AutopilotLine::Port(PortNumber::One);
    bench.links.update_line_state(port, ProtocolKind::Mavlink, Some(true));
    bus.queue_message(DataType::RESTART_NODE, &RESTART_PAYLOAD);
    publish_estimates(&mut bench, 50);
    assert_eq!(bus.take_sent_data(DataType::RESTART_NODE)[0][0], 0);
    bench.links.update_line_state(port, ProtocolKind::Mavlink, None);
    assert_eq!(bench.links.is_armed(), Some(false));
    bus.queue_message(DataType::ARMING_STATUS, &[255]);
    publish_estimates(&mut bench, 50);
    assert_eq!(bench.links.is_armed(), Some(true));
}

#[test]
fn module_messages_are_sent_as_log_messages() {
    let (mut bench, bus) = bench_with_node();
    bench.links.broadcast_message(&Message::InstallationRestored);
    publish_estimates(&mut bench, 500);
    let text: Vec<u8> =
        bus.take_sent_data(DataType::LOG_MESSAGE).iter().flat_map(|data| data[..data.len() - 1].to_vec()).collect();
    let text = String::from_utf8_lossy(&text);
    assert!(text.ends_with(&Message::InstallationRestored.to_string()), "{text}");
}

/// An unsigned heartbeat of an armed autopilot, through the tunnel.
#[test]
fn a_changed_signing_key_applies_to_the_tunnel() {
    let heartbeat = heartbeat_and_attitude_frames(true);
    let piece = Targetted {
        protocol: Targetted::MAVLINK_2_PROTOCOL,
        target: OWN_NODE,
        serial_line: 0,
        tunnel_options: 0,
        baud: 57_600,
        serial_bytes: &heartbeat,
    };
    for (signing_key, is_accepted) in [(None, true), (Some(SigningKey([7; 32])), false)] {
        let (mut bench, bus) = bench_with_node();
        publish_settings(&bench, Settings { signing_key, ..SETTINGS_WITH_NODE });
        publish_estimates(&mut bench, 50);
        bus.queue_message(DataType::TARGETTED, &piece.payload());
        publish_estimates(&mut bench, 50);
        assert_eq!(bench.links.is_armed(), Some(is_accepted));
        // An autopilot that reports its state on the bus alone has no parameters there.
        let lines: Vec<_> = bench.links.lines_with_autopilot(ProtocolKind::Mavlink).collect();
        assert_eq!(lines, if is_accepted { vec![AutopilotLine::Can] } else { vec![] });
    }
}

/// The first byte after the CRC is the update's result: 255, unknown.
#[test]
fn a_board_without_a_boot_loader_refuses_updates() {
    let (mut bench, bus) = (TaskBench::new(), FakeCanBus::default());
    publish_settings(&bench, SETTINGS_WITH_NODE);
    bus.run_node(&mut bench, NoBootLoader, false);
    bus.queue_message(DataType::BEGIN_FIRMWARE_UPDATE, b"\0a.bin");
    publish_estimates(&mut bench, 100);
    assert_eq!(bus.take_sent_data(DataType::BEGIN_FIRMWARE_UPDATE)[0][2], 255);
    assert!(bench.links.commands.is_empty());
}
