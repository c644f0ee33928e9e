//! Port tasks: received messages are distributed, due messages are sent.

use std::rc::Rc;

use mavlink::dialects::common::{ATTITUDE_DATA, HEARTBEAT_DATA, MavAutopilot, MavModeFlag};
use mavlink::{MAVLinkV2MessageRaw, MavHeader, MessageData};

use super::TaskBench;
use super::devices::{DeviceBehaviour, FakeReceiver, FakeTransmitter};
use crate::app::port;
use crate::app::task_links::{Timestamped, publish_value, subscribe};
use autoswing::attitude::AttitudeReport;
use autoswing::heading::{Heading, NoHeading};
use autoswing::instrument::Estimate;
use autoswing::time::Timestamp;
use autoswing_module::messages::Message;
use autoswing_module::settings::{BaudRate, PortNumber, ProtocolKind};
use autoswing_module::settings::{SettingChange, Settings};

fn attitude_frame(roll: f32) -> Vec<u8> {
    mavlink_frame(1, &ATTITUDE_DATA { time_boot_ms: 77, roll, ..Default::default() })
}

fn mavlink_frame(system_id: u32, data: &impl MessageData) -> Vec<u8> {
    let mut raw = MAVLinkV2MessageRaw::new();
    raw.serialize_message_data(MavHeader { system_id, component_id: 1, sequence: 0 }, data);
    raw.raw_bytes().to_vec()
}

fn spawn_port(bench: &mut TaskBench, number: PortNumber) -> (FakeReceiver, FakeTransmitter) {
    let (line, port) = (FakeReceiver::default(), FakeTransmitter::default());
    let (rx, tx) = (line.clone(), port.clone());
    publish_value(&bench.links.settings, Settings::DEFAULT);
    bench.spawn_task("port", move |links| async move { port::run_port(&links, number, rx, tx).await });
    bench.run_for_ms(1);
    (line, port)
}

fn bench_with_receiver() -> (TaskBench, FakeReceiver) {
    let mut bench = TaskBench::new();
    let (line, _) = spawn_port(&mut bench, PortNumber::One);
    (bench, line)
}

fn bench_with_transmitter() -> (TaskBench, FakeTransmitter) {
    let mut bench = TaskBench::new();
    let (_, port) = spawn_port(&mut bench, PortNumber::Two);
    (bench, port)
}

fn received_rolls_rad(bench: &TaskBench) -> Vec<f32> {
    let reports = std::iter::from_fn(|| bench.links.attitude_reports.try_receive().ok());
    reports.map(|report| report.value.attitude.roll_rad).collect()
}

/// Publishes estimates every 12.5 ms for this time.
fn publish_estimates(bench: &mut TaskBench, heading: Result<Heading, NoHeading>, ms: u64) {
    let end_us = bench.simulation.now_us() + ms * 1000;
    while bench.simulation.now_us() < end_us {
        let at = Timestamp::from_us(bench.simulation.now_us());
        bench.links.estimates.sender().send(Estimate { timestamp: at, heading, ..Estimate::EMPTY });
        bench.simulation.run_for(12_500);
    }
}

const NORTH: Result<Heading, NoHeading> =
    Ok(Heading { magnetic_rad: 0.0, sigma_rad: 0.01, systematic_variance_rad2: 0.0 });

#[test]
fn reports_are_passed_on_with_their_arrival_and_counted() {
    let (mut bench, line) = bench_with_receiver();
    bench.run_for_ms(4);
    let mut broken = attitude_frame(0.2);
    broken[15] ^= 1;
    line.queue_bytes(&[attitude_frame(0.1), broken, attitude_frame(0.3)].concat());
    bench.run_for_ms(1);
    let reports: Vec<Timestamped<AttitudeReport>> =
        std::iter::from_fn(|| bench.links.attitude_reports.try_receive().ok()).collect();
    let rolls: Vec<f32> = reports.iter().map(|report| report.value.attitude.roll_rad).collect();
    assert_eq!(rolls, [0.1, 0.3]);
    assert!(reports.iter().all(|report| (5_000..=6_000).contains(&report.timestamp.as_us())), "{reports:?}");
    // Rejected frames are counted with the next estimate.
    publish_estimates(&mut bench, NORTH, 10);
    let counts = bench.links.event_counts();
    assert_eq!((counts.attitude_reports, counts.attitude_frames_rejected, counts.attitude_line_errors), (2, 1, 0));
}

/// Two aircraft on one line; only the second sends heartbeats of an autopilot.
#[test]
fn attitude_of_other_senders_is_counted_and_dropped() {
    let (mut bench, line) = bench_with_receiver();
    line.queue_bytes(&attitude_frame(0.1));
    bench.run_for_ms(1);
    let other_attitude = ATTITUDE_DATA { roll: 0.2, ..Default::default() };
    let heartbeat =
        HEARTBEAT_DATA { autopilot: MavAutopilot::MAV_AUTOPILOT_ARDUPILOTMEGA, ..HEARTBEAT_DATA::default() };
    line.queue_bytes(
        &[
            mavlink_frame(2, &other_attitude),
            mavlink_frame(2, &heartbeat),
            attitude_frame(0.3),
            mavlink_frame(2, &other_attitude),
        ]
        .concat(),
    );
    bench.run_for_ms(1);
    assert_eq!(received_rolls_rad(&bench), [0.1, 0.2]);
    let counts = bench.links.event_counts();
    assert_eq!((counts.attitude_reports, counts.attitude_of_other_senders, counts.attitude_frames_rejected), (2, 2, 0));
}

/// Attitude on both ports, with rates on the second: the first is selected until the second delivers.
#[test]
fn attitude_is_used_from_one_port_at_a_time() {
    let mut bench = TaskBench::new();
    let (one, _) = spawn_port(&mut bench, PortNumber::One);
    let (two, _) = spawn_port(&mut bench, PortNumber::Two);
    let with_rates = |roll| mavlink_frame(1, &ATTITUDE_DATA { roll, rollspeed: 0.1, ..Default::default() });
    for (line, report) in
        [(&one, attitude_frame(0.1)), (&two, with_rates(0.2)), (&one, attitude_frame(0.3)), (&two, with_rates(0.4))]
    {
        line.queue_bytes(&report);
        bench.run_for_ms(1);
    }
    assert_eq!(received_rolls_rad(&bench), [0.1, 0.2, 0.4]);
    assert_eq!(bench.links.event_counts().attitude_of_other_senders, 1);
}

pub(super) const ARMED_BASE_MODE: MavModeFlag = MavModeFlag::MAV_MODE_FLAG_SAFETY_ARMED;

/// Frames of an autopilot's heartbeat and attitude.
pub(super) fn heartbeat_and_attitude_frames(base_mode: MavModeFlag) -> Vec<u8> {
    [mavlink_frame(1, &HEARTBEAT_DATA { base_mode, ..HEARTBEAT_DATA::default() }), attitude_frame(0.1)].concat()
}

/// The armed state expires on a silent line, too.
#[test]
fn armed_state_is_published_on_change_and_expires_after_10_s() {
    let (mut bench, line) = bench_with_receiver();
    let links = Rc::clone(&bench.links);
    let mut armed = subscribe(&links.armed_state);
    line.queue_bytes(&heartbeat_and_attitude_frames(ARMED_BASE_MODE));
    bench.run_for_ms(1);
    assert_eq!(armed.try_changed(), Some(Some(true)));
    publish_estimates(&mut bench, NORTH, 9_900);
    assert_eq!(armed.try_changed(), None);
    publish_estimates(&mut bench, NORTH, 200);
    assert_eq!(armed.try_changed(), Some(None));
    line.queue_bytes(&heartbeat_and_attitude_frames(ARMED_BASE_MODE));
    bench.run_for_ms(1);
    assert_eq!(armed.try_changed(), Some(Some(true)));
    line.queue_bytes(&heartbeat_and_attitude_frames(MavModeFlag::empty()));
    bench.run_for_ms(1);
    assert_eq!(armed.try_changed(), Some(Some(false)));
}

#[test]
fn armed_on_any_port_is_armed() {
    let mut bench = TaskBench::new();
    let lines = PortNumber::ALL_PORTS.map(|number| spawn_port(&mut bench, number).0);
    let links = Rc::clone(&bench.links);
    let mut armed_after_heartbeat = |line: usize, base_mode| {
        lines[line].queue_bytes(&heartbeat_and_attitude_frames(base_mode));
        bench.run_for_ms(1);
        links.armed_state.try_get().flatten()
    };
    assert_eq!(armed_after_heartbeat(1, MavModeFlag::empty()), Some(false));
    assert_eq!(armed_after_heartbeat(0, ARMED_BASE_MODE), Some(true));
    assert_eq!(armed_after_heartbeat(1, MavModeFlag::empty()), Some(true));
    assert_eq!(armed_after_heartbeat(1, ARMED_BASE_MODE), Some(true));
    assert_eq!(armed_after_heartbeat(0, MavModeFlag::empty()), Some(true));
    assert_eq!(armed_after_heartbeat(1, MavModeFlag::empty()), Some(false));
}

/// The task pauses for 0.2 ms after an error or the end of the line, and keeps sending.
#[test]
fn a_line_error_is_counted_and_followed_by_a_pause() {
    let mut bench = TaskBench::new();
    let (line, port) = spawn_port(&mut bench, PortNumber::Two);
    line.behaviour.set(DeviceBehaviour::EndOfInput);
    bench.run_for_ms(10);
    let ended = bench.links.event_counts().attitude_line_errors;
    assert!((45..=55).contains(&ended), "{ended}");
    line.behaviour.set(DeviceBehaviour::Fails);
    bench.run_for_ms(10);
    let errors = bench.links.event_counts().attitude_line_errors;
    assert!((90..=110).contains(&errors), "{errors}");
    publish_estimates(&mut bench, NORTH, 1_000);
    assert_eq!(port.take_text().matches("$HCHDM").count(), 11, "one of them at once");
    line.behaviour.set(DeviceBehaviour::Works);
    line.queue_bytes(&attitude_frame(0.1));
    bench.run_for_ms(1);
    assert_eq!(bench.links.event_counts().attitude_reports, 1);
}

#[test]
fn a_port_writes_at_its_rate_and_counts() {
    let (mut bench, port) = bench_with_transmitter();
    publish_estimates(&mut bench, NORTH, 1_000);
    let text = port.take_text();
    assert_eq!(text.matches("$HCHDM,000.0,M").count(), 10, "{text}");
    assert_eq!(text.matches("\r\n").count(), 30, "{text}");
    let counts = bench.links.event_counts();
    assert_eq!((counts.messages, counts.messages_empty, counts.write_errors), (10, 0, 0));
    publish_estimates(&mut bench, Err(NoHeading::Uncalibrated), 1_000);
    let counts = bench.links.event_counts();
    assert_eq!((counts.messages, counts.messages_empty), (20, 10));
    assert_eq!(port.take_text().matches("$PASWH,,,uncalibrated").count(), 10);
    assert_eq!(bench.links.heartbeat_counts(), [0, 0, 0, 0, 160, 0], "one for each estimate");
}

#[test]
fn a_port_follows_its_settings() {
    let (mut bench, port) = bench_with_transmitter();
    publish_value(&bench.links.settings, Settings { stream_rate_hz: 40, ..Settings::DEFAULT });
    publish_estimates(&mut bench, NORTH, 1_000);
    assert_eq!(port.take_text().matches("$HCHDM").count(), 40);
    publish_value(&bench.links.settings, Settings { stream_on: false, ..Settings::DEFAULT });
    publish_estimates(&mut bench, NORTH, 1_000);
    assert_eq!(port.take_text(), "");
    publish_value(&bench.links.settings, Settings { declination_deg: Some(2.0), ..Settings::DEFAULT });
    publish_estimates(&mut bench, NORTH, 200);
    assert!(port.take_text().contains("$HCHDG,000.0,,,2.0,E"));
    assert_eq!(bench.links.port_protocols(), [ProtocolKind::Auto, ProtocolKind::Nmea]);
    let other =
        Settings::DEFAULT.with_setting(SettingChange::Protocol(PortNumber::Two, ProtocolKind::Mavlink)).unwrap();
    publish_value(&bench.links.settings, other);
    publish_estimates(&mut bench, NORTH, 1_000);
    assert!(!port.take_text().contains('$'));
    assert_eq!(bench.links.port_protocols(), [ProtocolKind::Auto, ProtocolKind::Mavlink]);
}

/// Messages that arrive while another protocol is set are dropped.
#[test]
fn a_message_is_sent_as_mavlink_status_text() {
    let mut bench = TaskBench::new();
    let (line, port) = spawn_port(&mut bench, PortNumber::Two);
    let sent = |bench: &mut TaskBench, message: &Message| {
        bench.links.broadcast_message(message);
        line.queue_bytes(&heartbeat_and_attitude_frames(MavModeFlag::empty()));
        publish_estimates(bench, NORTH, 500);
        let bytes = port.written.take();
        move |text: &str| bytes.windows(text.len()).any(|window| window == text.as_bytes())
    };
    assert!(!sent(&mut bench, &Message::InstallationRestored)("autoswing"), "sentences");
    let other =
        Settings::DEFAULT.with_setting(SettingChange::Protocol(PortNumber::Two, ProtocolKind::Mavlink)).unwrap();
    publish_value(&bench.links.settings, other);
    let text = sent(&mut bench, &Message::Collecting(40));
    assert!(text("autoswing: collecting: 40 %") && !text("iron-back"));
}

/// The baud rate is set once for each change.
#[test]
fn each_port_uses_its_configured_baud_rate() {
    let mut bench = TaskBench::new();
    let ports = PortNumber::ALL_PORTS.map(|number| spawn_port(&mut bench, number).1);
    let bauds = || [ports[0].baud_changes.take(), ports[1].baud_changes.take()];
    publish_estimates(&mut bench, NORTH, 100);
    assert_eq!(bauds(), [vec![], vec![]]);
    let settings = Settings::DEFAULT.with_setting(SettingChange::Baud(PortNumber::Two, BaudRate::B460800)).unwrap();
    publish_value(&bench.links.settings, settings);
    publish_estimates(&mut bench, NORTH, 100);
    publish_value(&bench.links.settings, Settings { stream_on: false, ..settings });
    publish_estimates(&mut bench, NORTH, 100);
    assert_eq!(bauds(), [vec![], vec![BaudRate::B460800]]);
}

/// A failing port and a port that accepts no bytes: errors are counted, and later messages are up to date.
#[test]
fn errors_of_a_failing_port_are_counted_and_the_port_recovers() {
    let (mut bench, port) = bench_with_transmitter();
    port.behaviour.set(DeviceBehaviour::Fails);
    publish_estimates(&mut bench, NORTH, 1_000);
    assert_eq!((bench.links.event_counts().messages, bench.links.event_counts().write_errors), (10, 10));
    port.behaviour.set(DeviceBehaviour::Hangs);
    publish_estimates(&mut bench, NORTH, 1_000);
    let errors = bench.links.event_counts().write_errors - 10;
    assert!((5..=8).contains(&errors), "four or five are buffered: {errors}");
    port.behaviour.set(DeviceBehaviour::Works);
    publish_estimates(&mut bench, NORTH, 1_000);
    let sentences = port.take_text().matches("$HCHDM").count();
    assert!((10..=15).contains(&sentences), "{sentences}");
}
