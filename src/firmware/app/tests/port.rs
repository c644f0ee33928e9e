//! Port tasks: received messages are distributed, due messages are sent.

use std::rc::Rc;

use testkit::frames::{mavlink_attitude, mavlink_heartbeat};

use super::TaskBench;
use super::devices::{DeviceBehaviour, FakeReceiver, FakeTransmitter};
use crate::app::port;
use crate::app::task_links::{AttitudeInput, AutopilotLine, Timestamped, publish_value, subscribe};
use autoswing::attitude::AttitudeReport;
use autoswing::heading::{Heading, NoHeading};
use autoswing::time::Timestamp;
use autoswing_module::settings::{PortNumber, ProtocolKind, Settings};

const AUTOPILOT: [u8; 2] = [1, 1];

fn attitude_frame(roll_rad: f32) -> Vec<u8> {
    mavlink_attitude(AUTOPILOT, 77, [roll_rad, 0.0, 0.0, 0.0, 0.0, 0.0])
}

/// Frames of an autopilot's heartbeat and attitude.
pub(super) fn heartbeat_and_attitude_frames(is_armed: bool) -> Vec<u8> {
    [mavlink_heartbeat(AUTOPILOT, true, is_armed), attitude_frame(0.1)].concat()
}

fn spawn_port(bench: &mut TaskBench, number: PortNumber) -> (FakeReceiver, FakeTransmitter) {
    let (line, port) = (FakeReceiver::default(), FakeTransmitter::default());
    let (rx, tx) = (line.clone(), port.clone());
    publish_value(&bench.links.settings, Settings::DEFAULT);
    bench.spawn_task("port", move |links| async move { port::run_port(&links, number, rx, tx).await });
    bench.run_for_ms(1);
    (line, port)
}

fn bench_with_port(number: PortNumber) -> (TaskBench, FakeReceiver, FakeTransmitter) {
    let mut bench = TaskBench::new();
    let (line, port) = spawn_port(&mut bench, number);
    (bench, line, port)
}

fn received_rolls_rad(bench: &TaskBench) -> Vec<f32> {
    received_reports(bench).into_iter().map(|(_, report)| report.attitude.roll_rad).collect()
}

fn received_reports(bench: &TaskBench) -> Vec<(Timestamp, AttitudeReport)> {
    let inputs = std::iter::from_fn(|| bench.links.attitude_inputs.try_receive().ok());
    inputs
        .map(|Timestamped { timestamp, value }| match value {
            AttitudeInput::Report(report) => (timestamp, report),
            AttitudeInput::Own(estimate) => panic!("{estimate:?}"),
        })
        .collect()
}

const NORTH: Result<Heading, NoHeading> =
    Ok(Heading { magnetic_rad: 0.0, sigma_rad: 0.01, systematic_variance_rad2: 0.0 });

/// Attitude on both ports, with rates on the second: the first is selected until the second delivers.
#[test]
fn attitude_is_used_from_one_port_at_a_time() {
    let mut bench = TaskBench::new();
    let (one, _) = spawn_port(&mut bench, PortNumber::One);
    let (two, _) = spawn_port(&mut bench, PortNumber::Two);
    let with_rates = |roll_rad| mavlink_attitude(AUTOPILOT, 77, [roll_rad, 0.0, 0.0, 0.1, 0.0, 0.0]);
    for (line, report) in
        [(&one, attitude_frame(0.1)), (&two, with_rates(0.2)), (&one, attitude_frame(0.3)), (&two, with_rates(0.4))]
    {
        line.queue_bytes(&report);
        bench.run_for_ms(1);
    }
    assert_eq!(received_rolls_rad(&bench), [0.1, 0.2, 0.4]);
    assert_eq!(bench.links.event_counts().attitude_of_other_senders, 1);
}

/// The armed state expires on a silent line, too.
#[test]
fn armed_state_is_published_on_change_and_expires_after_10_s() {
    let (mut bench, line, _) = bench_with_port(PortNumber::One);
    let links = Rc::clone(&bench.links);
    let mut armed = subscribe(&links.armed_state);
    for (is_armed, silence_ms, published) in
        [(true, 0, Some(true)), (false, 0, Some(false)), (true, 9_900, Some(true)), (true, 10_200, None)]
    {
        line.queue_bytes(&heartbeat_and_attitude_frames(is_armed));
        bench.run_for_ms(1);
        bench.publish_estimates(NORTH, silence_ms);
        let last = std::iter::from_fn(|| armed.try_changed()).last();
        assert_eq!((last, links.armed_state.try_get()), (Some(published), Some(published)), "{silence_ms} ms");
    }
}

/// The autopilot forwards the heartbeats of the module's other line to this one.
#[test]
fn a_second_line_to_the_autopilot_does_not_wait_for_another_module() {
    let is_heartbeat = |frame: &[u8]| matches!(frame, [0xFD, 9, 0, 0, _, 1, 158, 0, 0, 0]);
    for (has_other_line, is_claimed) in [(true, true), (false, false)] {
        let (mut bench, line, port) = bench_with_port(PortNumber::One);
        let other_armed_state = has_other_line.then_some(false);
        bench.links.update_line_state(AutopilotLine::Can, ProtocolKind::Mavlink, other_armed_state);
        line.queue_bytes(&heartbeat_and_attitude_frames(false));
        bench.publish_estimates(NORTH, 500);
        assert_eq!(port.written.take().windows(10).any(is_heartbeat), is_claimed);
    }
}

/// The task pauses for 0.2 ms after an error or the end of the line, and keeps sending.
#[test]
fn a_line_error_is_counted_and_followed_by_a_pause() {
    let (mut bench, line, port) = bench_with_port(PortNumber::Two);
    line.behaviour.set(DeviceBehaviour::EndOfInput);
    bench.run_for_ms(10);
    let ended = bench.links.event_counts().attitude_line_errors;
    assert!((45..=55).contains(&ended), "{ended}");
    line.behaviour.set(DeviceBehaviour::Fails);
    bench.run_for_ms(10);
    let errors = bench.links.event_counts().attitude_line_errors;
    assert!((90..=110).contains(&errors), "{errors}");
    bench.publish_estimates(NORTH, 1_000);
    assert_eq!(port.take_text().matches("$HCHDM").count(), 11, "one of them at once");
    line.behaviour.set(DeviceBehaviour::Works);
    line.queue_bytes(&attitude_frame(0.1));
    bench.run_for_ms(1);
    assert_eq!(bench.links.event_counts().attitude_reports, 1);
}

#[test]
fn a_port_writes_at_its_rate_and_counts() {
    let (mut bench, _, port) = bench_with_port(PortNumber::Two);
    bench.publish_estimates(NORTH, 1_000);
    let text = port.take_text();
    assert_eq!(text.matches("$HCHDM,000.0,M").count(), 10, "{text}");
    assert_eq!(text.matches("\r\n").count(), 30, "{text}");
    let counts = bench.links.event_counts();
    assert_eq!((counts.messages, counts.messages_empty, counts.write_errors), (10, 0, 0));
    bench.publish_estimates(Err(NoHeading::Uncalibrated), 1_000);
    let counts = bench.links.event_counts();
    assert_eq!((counts.messages, counts.messages_empty), (20, 10));
    assert_eq!(port.take_text().matches("$PASWH,,,uncalibrated").count(), 10);
    assert_eq!(bench.links.heartbeat_counts(), [0, 0, 0, 0, 160, 0], "one for each estimate");
}

/// A failing port and a port that accepts no bytes: errors are counted, and later messages are up to date.
#[test]
fn errors_of_a_failing_port_are_counted_and_the_port_recovers() {
    let (mut bench, _, port) = bench_with_port(PortNumber::Two);
    port.behaviour.set(DeviceBehaviour::Fails);
    bench.publish_estimates(NORTH, 1_000);
    assert_eq!((bench.links.event_counts().messages, bench.links.event_counts().write_errors), (10, 10));
    port.behaviour.set(DeviceBehaviour::Hangs);
    bench.publish_estimates(NORTH, 1_000);
    let errors = bench.links.event_counts().write_errors - 10;
    assert!((5..=8).contains(&errors), "four or five are buffered: {errors}");
    port.behaviour.set(DeviceBehaviour::Works);
    bench.publish_estimates(NORTH, 1_000);
    let sentences = port.take_text().matches("$HCHDM").count();
    assert!((10..=15).contains(&sentences), "{sentences}");
}
