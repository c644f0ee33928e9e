//! Tasks of the thread executor: the state machine with its flash, and the console.

use std::cell::{Cell, RefCell};
use std::rc::Rc;
use std::sync::atomic::Ordering;

use embassy_futures::yield_now;
use testkit::flash::SilentFault;

use super::devices::{DeviceBehaviour, FakeReceiver, FakeTransmitter};
use super::{Flash, PAGE_COUNT, TaskBench};
use crate::app::task_links::{AutopilotLine, CommandSource, publish_value};
use crate::app::{Platform, console, port};
use crate::health::ResetCause;
use crate::synthetic::{Airframe, Flight, Random, multirotor_samples};
use autoswing::calibration::method_selection::Procedure;
use autoswing::calibration::{CollectionPart, Sample};
use autoswing::instrument::SampleAttitude;
use autoswing::time::WrappingMillis;
use autoswing_module::compass::{Command, IndicatorState, ModuleState, Reply};
use autoswing_module::messages::SampleLoss;
use autoswing_module::messages::{Message, Refusal, RefusalCause};
use autoswing_module::settings::{PortNumber, ProtocolKind, SettingChange, Settings};
use autoswing_module::store::StoreError;

const PORT_1: AutopilotLine = AutopilotLine::Port(PortNumber::One);
const PORT_2: AutopilotLine = AutopilotLine::Port(PortNumber::Two);

#[test]
fn a_failed_save_is_reported_and_counted() {
    let mut flash = Flash::new(PAGE_COUNT);
    flash.unreadable = Some((0..2048 * PAGE_COUNT, usize::MAX));
    let mut bench = TaskBench::with_compass_and_flash(flash);
    assert_eq!(bench.links.event_counts().store_errors, 1, "of the load, once");
    assert_eq!(bench.links.console_messages.try_receive(), Ok(Message::StoreFailed(StoreError::Flash)));
    let reply = bench.execute_command(Command::Set(SettingChange::named("STREAM_RATE", 20.0).unwrap()));
    assert!(matches!(reply, Err(Refusal::Store(StoreError::Flash))), "{reply:?}");
    assert_eq!(bench.links.settings.try_get(), Some(Settings::DEFAULT));
    assert_eq!((bench.links.event_counts().saves, bench.links.event_counts().store_errors), (0, 2));
}

/// An erase that never completes: the command is refused after half a second, and the next ones are executed. A save
/// without a command is reported by a message.
#[test]
fn a_save_that_never_completes_times_out_and_is_reported() {
    let mut flash = Flash::new(PAGE_COUNT);
    flash.silent_fault = Some(SilentFault::WritesHang);
    let mut bench = TaskBench::with_compass_and_flash(flash);
    bench.send_command(CommandSource::Console, Command::CalClear);
    bench.run_for_ms(498);
    assert!(bench.links.replies.try_receive().is_err());
    bench.run_for_ms(1);
    let reply = bench.links.replies.try_receive();
    assert!(matches!(reply, Ok(Err(Refusal::Store(StoreError::Timeout)))), "{reply:?}");
    assert_eq!((bench.links.event_counts().saves, bench.links.event_counts().store_errors), (0, 1));
    assert!(matches!(bench.execute_command(Command::Status), Ok(Reply::Report(_))));
    bench.links.update_line_state(PORT_1, ProtocolKind::Mavlink, None);
    for is_armed in [true, false] {
        publish_value(&bench.links.armed_state, Some(is_armed));
        bench.run_for_ms(5_500);
    }
    let message = Ok(Message::StoreFailed(StoreError::Timeout));
    assert_eq!(bench.links.console_messages.try_receive(), message);
    assert_eq!(bench.links.links_of_line(PORT_1).messages.try_receive(), message);
    assert_eq!(bench.links.event_counts().store_errors, 2);
    assert!(matches!(bench.execute_command(Command::Status), Ok(Reply::Report(_))));
}

/// Readings lost before the collection do not count. The button's `cal start` has no reply: the console receives only
/// the replies to its own commands.
#[test]
fn readings_lost_during_the_collection_are_the_cause_of_a_refusal() {
    let mut bench = TaskBench::with_compass();
    bench.detect_sensor();
    let record_losses = |bench: &TaskBench, saturated| {
        bench.links.event_counters.readings.fetch_add(1000, Ordering::Relaxed);
        bench.links.event_counters.saturated.fetch_add(saturated, Ordering::Relaxed);
    };
    record_losses(&bench, 500);
    bench.send_command(CommandSource::Button, Command::CalStart(Procedure::Flight));
    assert_eq!(bench.links.indicator_state.try_get(), Some(IndicatorState::Collecting(0)));
    assert!(bench.links.replies.is_empty());
    record_losses(&bench, 200);
    let cause = RefusalCause::SampleLoss(SampleLoss::Saturated(20));
    let refused = bench.execute_command(Command::CalSolve(None)).unwrap_err();
    assert_eq!(refused, Refusal::InsufficientSamples { code: "no-samples", expected_rms_deg: None, cause });
    assert!(matches!(bench.execute_command(Command::CalUndo), Err(Refusal::NoPreviousCalibration)));
}

/// The state machine makes a correction from a detected sensor and samples of turns, without `cal solve`.
#[test]
fn samples_become_a_correction() {
    let mut bench = TaskBench::with_compass();
    assert!(matches!(bench.execute_command(Command::CalStart(Procedure::Turns)), Err(Refusal::NoSensor)));
    bench.detect_sensor();
    assert!(matches!(
        bench.execute_command(Command::CalStart(Procedure::Turns)),
        Ok(Reply::Done(ModuleState::Collecting))
    ));
    let airframe = Airframe::random(&mut Random(11), 0.1, 1.0, 5.0, [55.0, 55.0]);
    let recorded = Flight { samples_per_side: 190, ..Flight::TYPICAL }.fly(&airframe, &mut Random(1));
    for (i, sample) in recorded.left.iter().chain(&recorded.right).enumerate() {
        let time = WrappingMillis::new(i as u32 * 500);
        bench.links.queue_or_count(&bench.links.samples, Sample { time, ..*sample });
        bench.run_for_ms(1);
    }
    assert!(matches!(bench.links.console_messages.try_receive(), Ok(Message::Solved(Ok(_)))));
    let correction = bench.links.correction.try_get().unwrap();
    let (calibration, uncertainty) = correction.calibration.unwrap();
    assert_eq!(correction.sample_attitude, SampleAttitude::Interpolated);
    // Noise of a reading at 100 Hz: sqrt(10) times that of a sample, 0.12 uT of about 50 uT.
    let reading_ut = uncertainty.relative_sensor_sigma * calibration.total_ut;
    assert!((0.25..0.55).contains(&reading_ut), "{reading_ut}");
    assert_eq!(bench.links.event_counts().saves, 2, "that there is a collection, and its calibration");
    assert_eq!(bench.links.indicator_state.try_get(), Some(IndicatorState::Calibrated));
    for line in [PORT_1, PORT_2] {
        let message = bench.links.links_of_line(line).messages.try_receive();
        assert!(matches!(message, Ok(Message::Solved(Ok(_)))), "{line:?}: {message:?}");
    }
    // The console is answered between the steps of a solve.
    assert!(matches!(bench.execute_command(Command::CalSolve(None)), Ok(Reply::Done(ModuleState::Solving))));
    bench.run_for_ms(100);
    // Commands during the solve use the armed state reported meanwhile.
    let replies: Rc<RefCell<Vec<Result<Reply, Refusal>>>> = Rc::default();
    let answered = Rc::clone(&replies);
    bench.spawn_task("person", |links| async move {
        for command in [Command::CalSolve(None), Command::Restart, Command::CalUndo] {
            publish_value(&links.armed_state, Some(command == Command::CalUndo));
            links.commands.send((CommandSource::Console, command)).await;
            let reply = links.replies.receive().await;
            answered.borrow_mut().push(reply);
        }
    });
    bench.run_for_ms(1);
    let replies = replies.borrow();
    let [Ok(Reply::Done(ModuleState::Solving)), Ok(Reply::Done(ModuleState::Solving)), Err(Refusal::Armed)] =
        &replies[..]
    else {
        panic!("{replies:?}")
    };
}

/// A sample with every step of the executor: more than the queue holds arrive during a trial solve.
#[test]
fn no_sample_is_dropped_during_a_trial_solve() {
    let mut bench = TaskBench::with_compass();
    bench.detect_sensor();
    assert!(bench.execute_command(Command::CalStart(Procedure::Flight)).is_ok());
    let airframe = Airframe::random(&mut Random(11), 0.1, 1.0, 5.0, [55.0, 55.0]);
    let flown = multirotor_samples(&airframe, 0.3, &mut Random(1));
    bench.spawn_task("instrument", |links| async move {
        for (i, sample) in (0..75).zip(flown) {
            links.queue_or_count(&links.samples, Sample { time: WrappingMillis::new(i * 250), ..sample });
            yield_now().await;
        }
    });
    bench.run_for_ms(1);
    let Ok(Reply::Report(report)) = bench.execute_command(Command::Status) else { panic!("no report") };
    assert!(report.last_trial.is_some());
    let coverage = report.collection_progress.coverage_of(CollectionPart::FREE);
    assert_eq!(coverage.fit_count + coverage.held_back_count, 75);
    assert_eq!(bench.links.event_counts().samples_dropped, 0);
}

/// The state machine admits the command of any source, and signals the console to restart the module.
#[test]
fn a_restart_commanded_on_a_port_needs_a_disarmed_autopilot() {
    let mut bench = TaskBench::with_compass();
    for (is_armed, result) in [(true, Err(Refusal::Armed)), (false, Ok(()))] {
        publish_value(&bench.links.armed_state, Some(is_armed));
        bench.send_command(CommandSource::Line(PORT_2), Command::Restart);
        assert_eq!(bench.links.restart_request.signaled(), result.is_ok());
        let [one, two] = [PORT_1, PORT_2].map(|line| bench.links.links_of_line(line).command_results.try_take());
        assert_eq!((one, two), (None, Some((Command::Restart, result))));
    }
}

#[derive(Clone, Default)]
struct FakePlatform(Rc<Cell<u32>>);

impl Platform for FakePlatform {
    fn reboot(&mut self) {
        self.0.set(self.0.get() + 1);
    }
}

/// Console task with its greeting removed from the output.
fn bench_with_console() -> (TaskBench, FakeReceiver, FakeTransmitter, FakePlatform) {
    let mut bench = TaskBench::with_compass();
    let (line, port, board) = (FakeReceiver::default(), FakeTransmitter::default(), FakePlatform::default());
    let (rx, tx, platform) = (line.clone(), port.clone(), board.clone());
    bench.spawn_task("console", |links| async move {
        console::run_console(&links, rx, tx, platform, ResetCause::Watchdog).await;
    });
    bench.run_for_ms(1);
    assert!(port.take_text().contains("started by watchdog"));
    (bench, line, port, board)
}

fn type_line(bench: &mut TaskBench, receiver: &FakeReceiver, transmitter: &FakeTransmitter, text: &str) -> String {
    receiver.queue_bytes(text.as_bytes());
    receiver.queue_bytes(b"\r");
    bench.run_for_ms(5);
    transmitter.take_text()
}

/// On a board whose only UART serves a port, no console executes the restart.
#[test]
fn a_module_without_a_console_restarts_on_command() {
    let mut bench = TaskBench::with_compass();
    let board = FakePlatform::default();
    let platform = board.clone();
    bench.spawn_task("restart", |links| async move { console::restart_without_terminal(&links, platform).await });
    bench.send_command(CommandSource::Line(AutopilotLine::Can), Command::Restart);
    bench.run_for_ms(48);
    assert_eq!(board.0.get(), 0);
    bench.run_for_ms(2);
    assert_eq!(board.0.get(), 1);
}

/// The only UART of a board is the console unless a protocol is selected for port 1, and not before the settings are
/// known.
#[test]
fn a_selected_protocol_is_found_once_the_settings_are_known() {
    for (selected, expected) in
        [(None, None), (Some(ProtocolKind::Auto), Some(false)), (Some(ProtocolKind::Msp), Some(true))]
    {
        let (mut bench, found) = (TaskBench::new(), Rc::new(Cell::new(None)));
        let result = Rc::clone(&found);
        bench.spawn_task(
            "uart",
            |links| async move { result.set(Some(port::has_protocol(&links, PortNumber::One).await)) },
        );
        if let Some(protocol) = selected {
            publish_value(&bench.links.settings, Settings { port1_protocol: protocol, ..Settings::DEFAULT });
        }
        bench.run_for_ms(10);
        assert_eq!(found.get(), expected, "{selected:?}");
    }
}

#[test]
fn a_message_is_shown_and_the_partly_typed_line_restored() {
    let (mut bench, line, port, _) = bench_with_console();
    line.queue_bytes(b"versio");
    bench.run_for_ms(1);
    assert_eq!(port.take_text(), "versio");
    bench.links.broadcast_message(&Message::StoreFailed(StoreError::Corrupt));
    bench.run_for_ms(1);
    let text = port.take_text();
    assert!(text.contains("note refused store-corrupt: "), "{text:?}");
    // The partly typed line is still shown.
    assert!(text.ends_with("\r\n\r\x1b[2K> versio"), "{text:?}");
    assert!(type_line(&mut bench, &line, &port, "n").contains("ok autoswing"));
}

#[test]
fn the_oldest_message_is_dropped_from_a_full_queue() {
    let bench = TaskBench::new();
    for percent in 0..5 {
        bench.links.broadcast_message(&Message::Collecting(percent));
    }
    let waiting: Vec<_> = std::iter::from_fn(|| bench.links.console_messages.try_receive().ok()).collect();
    assert_eq!(waiting, [2, 3, 4].map(Message::Collecting));
}

/// The console continues after line errors, and with a terminal that accepts no bytes.
#[test]
fn line_errors_do_not_stop_the_console() {
    let (mut bench, line, port, _) = bench_with_console();
    for behaviour in [DeviceBehaviour::Fails, DeviceBehaviour::EndOfInput] {
        line.behaviour.set(behaviour);
        let before = line.read_count.get();
        bench.run_for_ms(10);
        let reads = line.read_count.get() - before;
        assert!((40..=60).contains(&reads), "{behaviour:?} {reads}: a pause of 0.2 ms after each");
    }
    line.behaviour.set(DeviceBehaviour::Works);
    port.behaviour.set(DeviceBehaviour::Hangs);
    assert_eq!(type_line(&mut bench, &line, &port, "version"), "");
    // While the port hangs, the echo of each character times out after half a second; wait for all.
    bench.run_for_ms(8_000);
    port.behaviour.set(DeviceBehaviour::Works);
    bench.run_for_ms(1_000);
    let _ = port.take_text();
    assert!(type_line(&mut bench, &line, &port, "version").contains("ok autoswing"));
}
