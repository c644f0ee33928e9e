//! The tasks that may take long: the state machine with its flash, and the console.

use std::cell::{Cell, RefCell};
use std::rc::Rc;

use testkit::flash::RamFlash;

use super::Bed;
use super::devices::{Chip, Line, Mood, Port, SENSOR};
use crate::app::links::{FoundSensor, publish};
use crate::app::{Platform, compass, console};
use crate::calibration::Sample;
use crate::calibration::ladder::Procedure;
use crate::calibration::tests::synthetic::{Airframe, Flight, Random};
use crate::collection::Kept;
use crate::compass::{Command, Refusal, Reply, State};
#[cfg(feature = "wmm")]
use crate::earth::{Day, EarthField, Place};
use crate::frames::Attitude;
use crate::heading::Heading;
use crate::health::{ResetCause, StackUse};
use crate::instrument::{Estimate, SampleAttitude};
use crate::settings::{Setting, Settings};
use crate::store::{Store, StoreError};
use crate::time::WrappingMillis;

type Flash = RamFlash<2048>;
const PAGES: usize = 8;

fn store(flash: Flash) -> Store<Flash> {
    Store::new(flash, 0..(2048 * PAGES) as u32)
}

fn with_compass(flash: Flash) -> Bed {
    let mut bed = Bed::new();
    bed.run(
        "compass",
        |links| async move { Box::pin(compass::run(&links, store(flash), &mut Kept::EMPTY.clone())).await },
    );
    bed.ms(1);
    bed
}

/// Asks the state machine, as the console does.
pub(super) fn ask(bed: &mut Bed, command: Command) -> Result<Reply, Refusal> {
    bed.links.requests.try_send(command).unwrap();
    bed.ms(1);
    bed.links.replies.try_receive().expect("an answer")
}

#[test]
fn settings_are_written_published_and_counted() {
    let mut bed = with_compass(Flash::new(PAGES));
    assert_eq!(bed.links.settings.try_get(), Some(Settings::DEFAULT));
    let reply = ask(&mut bed, Command::Set(Setting::StreamRateHz(20)));
    assert!(matches!(reply, Ok(Reply::Done(State::Uncalibrated))), "{reply:?}");
    assert_eq!(bed.links.settings.try_get(), Some(Settings { stream_rate_hz: 20, ..Settings::DEFAULT }));
    assert_eq!((bed.links.counts().saves, bed.links.counts().store_errors), (1, 0));
}

/// From whichever ports they come; what was entered wins, and the flash knows nothing of it.
#[cfg(feature = "wmm")]
#[test]
fn place_and_day_put_settings_in_force() {
    let (place, day) = (Place::new(51.1, 13.7, 100.0).unwrap(), Day::from_unix_s(20_779 * 86_400).unwrap());
    let field = EarthField::of(place, day).unwrap();
    let mut bed = with_compass(Flash::new(PAGES));
    publish(&bed.links.day, day);
    bed.ms(1);
    assert_eq!(bed.links.settings.try_get(), Some(Settings::DEFAULT));
    publish(&bed.links.place, place);
    bed.ms(1);
    let inclination_deg = Some(field.inclination_deg);
    let by_model = Settings { declination_deg: field.declination_deg, inclination_deg, ..Settings::DEFAULT };
    assert_eq!(bed.links.settings.try_get(), Some(by_model));
    assert!(ask(&mut bed, Command::Set(Setting::Declination(Some(3.0)))).is_ok());
    assert_eq!(bed.links.settings.try_get(), Some(Settings { declination_deg: Some(3.0), ..by_model }));
    assert_eq!(bed.links.counts().saves, 1);
}

/// A flash that takes nothing: told, counted, and the settings are what they were.
#[test]
fn a_failed_save_is_told_and_counted() {
    let mut flash = Flash::new(PAGES);
    flash.unreadable = Some((0..2048 * PAGES, usize::MAX));
    let mut bed = with_compass(flash);
    assert_eq!(bed.links.counts().store_errors, 1, "of the load, once");
    assert_eq!(bed.links.notices.try_take(), Some(Err(Refusal::Store(StoreError::Flash))));
    let reply = ask(&mut bed, Command::Set(Setting::StreamRateHz(20)));
    assert!(matches!(reply, Err(Refusal::Store(StoreError::Flash))), "{reply:?}");
    assert_eq!(bed.links.settings.try_get(), Some(Settings::DEFAULT));
    assert_eq!((bed.links.counts().saves, bed.links.counts().store_errors), (0, 2));
}

/// From the sensor that was found over the samples of turns to a correction, without anybody asking for the solve.
#[test]
fn samples_become_a_correction() {
    let mut bed = with_compass(Flash::new(PAGES));
    assert!(matches!(ask(&mut bed, Command::CalStart(Procedure::Turns)), Err(Refusal::NoSensor)));
    publish(
        &bed.links.sensor,
        FoundSensor { identity: SENSOR, period_us: Chip::PERIOD_US, stuck_after: Chip::STUCK_AFTER },
    );
    bed.ms(1);
    assert!(matches!(ask(&mut bed, Command::CalStart(Procedure::Turns)), Ok(Reply::Done(State::Collecting))));
    let airframe = Airframe::random(&mut Random(11), 0.1, 1.0, 5.0, [55.0, 55.0]);
    let recorded = Flight { samples: 190, ..Flight::REAL }.fly(&airframe, &mut Random(1));
    for (i, sample) in recorded.left.iter().chain(&recorded.right).enumerate() {
        let time = WrappingMillis::new(i as u32 * 500);
        bed.links.offer(&bed.links.samples, Sample { time, ..*sample });
        bed.ms(1);
    }
    assert!(matches!(bed.links.notices.try_take(), Some(Ok(_))));
    let correction = bed.links.correction.try_get().unwrap();
    let (calibration, uncertainty) = correction.calibration.unwrap();
    assert_eq!(correction.sample_attitude, SampleAttitude::Interpolated);
    // A reading of 100 Hz has sqrt(10) times the noise of the samples, 0.12 uT of some 50.
    let reading_ut = uncertainty.sensor_sigma * calibration.total_ut;
    assert!((0.25..0.55).contains(&reading_ut), "{reading_ut}");
    assert_eq!(bed.links.counts().saves, 2, "that there is a collection, and its calibration");
    // The console is answered between the steps of a solve.
    assert!(matches!(ask(&mut bed, Command::CalSolve(None)), Ok(Reply::Done(State::Solving))));
    bed.ms(100);
    // By what the autopilot says meanwhile.
    let replies: Rc<RefCell<Vec<Result<Reply, Refusal>>>> = Rc::default();
    let answered = Rc::clone(&replies);
    bed.run("person", |links| async move {
        for command in [Command::CalSolve(None), Command::Restart, Command::CalUndo] {
            publish(&links.armed, Some(command == Command::CalUndo));
            links.requests.send(command).await;
            let reply = links.replies.receive().await;
            answered.borrow_mut().push(reply);
        }
    });
    bed.ms(1);
    let replies = replies.borrow();
    let [Ok(Reply::Done(State::Solving)), Ok(Reply::Done(State::Solving)), Err(Refusal::Armed)] = &replies[..] else {
        panic!("{replies:?}")
    };
}

/// A command is judged by what the autopilot said before it.
#[test]
fn the_state_machine_hears_that_the_autopilot_is_armed() {
    let mut bed = with_compass(Flash::new(PAGES));
    assert!(matches!(ask(&mut bed, Command::Restart), Ok(Reply::Done(_))));
    publish(&bed.links.armed, Some(true));
    assert!(matches!(ask(&mut bed, Command::Restart), Err(Refusal::Armed)));
    publish(&bed.links.armed, Some(false));
    assert!(matches!(ask(&mut bed, Command::Restart), Ok(Reply::Done(_))));
}

#[derive(Clone, Default)]
struct Board(Rc<Cell<u32>>);

impl Platform for Board {
    fn reboot(&mut self) {
        self.0.set(self.0.get() + 1);
    }

    fn stack(&self) -> Option<StackUse> {
        Some(StackUse { used: 1234, size: 24576 })
    }
}

/// A console on the wires of a state machine, with its greeting taken off.
fn with_console() -> (Bed, Line, Port, Board) {
    let mut bed = with_compass(Flash::new(PAGES));
    let (line, port, board) = (Line::default(), Port::default(), Board::default());
    let (rx, tx, platform) = (line.clone(), port.clone(), board.clone());
    bed.run("console", |links| async move {
        console::run(&links, rx, tx, platform, ResetCause::Watchdog).await;
    });
    bed.ms(1);
    assert!(port.text().contains("started by watchdog"));
    (bed, line, port, board)
}

/// Types a line; what it is answered.
fn type_line(bed: &mut Bed, line: &Line, port: &Port, text: &str) -> String {
    line.put(text.as_bytes());
    line.put(b"\r");
    bed.ms(5);
    port.text()
}

#[test]
fn every_kind_of_request_is_answered() {
    let (mut bed, line, port, _) = with_console();
    for (text, answer) in [
        ("version", "ok autoswing "),
        ("status", "ok uncalibrated"),
        ("cal show", "error no-calibration: "),
        ("cal abort", "ok uncalibrated"),
        ("cal undo", "error nothing-to-undo: "),
        ("set accuracy 0.7", "ok accuracy 0.7 deg wanted\r\n"),
        ("set mount yaw90", "ok mount yaw90"),
        ("set align none", "ok align 0.0 deg"),
        ("help set accuracy", "ok set accuracy DEG: "),
        ("nonsense", "error unknown-command: "),
    ] {
        let reply = type_line(&mut bed, &line, &port, text);
        assert!(reply.contains(&format!("\r\n{answer}")), "{text}: {reply}");
        assert!(reply.ends_with("> "), "{text}: {reply}");
    }
}

/// What the other tasks know, as a person reads it.
#[test]
fn status_shows_the_module_s_health() {
    let (mut bed, line, port, _) = with_console();
    let status = type_line(&mut bed, &line, &port, "status");
    for expected in ["sensor: not found", "attitude: none", "heading: none, sensor-silent", "started by watchdog"] {
        assert!(status.contains(expected), "{expected}: {status}");
    }
    publish(
        &bed.links.sensor,
        FoundSensor { identity: SENSOR, period_us: Chip::PERIOD_US, stuck_after: Chip::STUCK_AFTER },
    );
    let heading = Ok(Heading { magnetic_rad: 1.0, sigma_rad: 0.02, systematic_rad2: 0.0 });
    let attitude = Some(Attitude::from_deg(12.0, -3.0));
    bed.links.estimates.sender().send(Estimate { heading, attitude, ..Estimate::NOTHING });
    bed.ms(12_000);
    let status = type_line(&mut bed, &line, &port, "status");
    for expected in [
        "sensor: LIS3MDL at 1e",
        "attitude: roll 12.0 deg, pitch -3.0 deg",
        "heading: 57.3 deg magnetic, sigma 1.1 deg",
        "stack: 1234 of 24576 bytes used at most",
        "up: 12 s, started by watchdog",
    ] {
        assert!(status.contains(expected), "{expected}: {status}");
    }
}

/// The reply leaves the port before the board restarts: 50 ms for last words.
#[test]
fn a_reboot_is_announced_first() {
    let (mut bed, line, port, board) = with_console();
    assert!(type_line(&mut bed, &line, &port, "reboot").contains("ok restarting"));
    bed.ms(40);
    assert_eq!(board.0.get(), 0);
    bed.ms(10);
    assert_eq!(board.0.get(), 1);
}

/// In the air the heading is needed.
#[test]
fn an_armed_module_does_not_reboot() {
    let (mut bed, line, port, board) = with_console();
    publish(&bed.links.armed, Some(true));
    let reply = type_line(&mut bed, &line, &port, "reboot");
    assert!(reply.contains("\r\nerror armed: the autopilot is armed") && !reply.contains("ok"), "{reply}");
    bed.ms(1_000);
    assert_eq!(board.0.get(), 0);
    assert!(type_line(&mut bed, &line, &port, "status").contains("\r\narmed: yes\r\n"));
    publish(&bed.links.armed, Some(false));
    assert!(type_line(&mut bed, &line, &port, "status").contains("\r\narmed: no\r\n"));
    assert!(type_line(&mut bed, &line, &port, "reboot").contains("ok restarting"));
    bed.ms(50);
    assert_eq!(board.0.get(), 1);
}

#[test]
fn a_note_comes_unasked() {
    let (mut bed, line, port, _) = with_console();
    line.put(b"versio");
    bed.ms(1);
    assert_eq!(port.text(), "versio");
    bed.links.notices.signal(Err(Refusal::Store(StoreError::Corrupt)));
    bed.ms(1);
    let text = port.text();
    assert!(text.contains("note refused store-corrupt: "), "{text:?}");
    // What was being typed is still there.
    assert!(text.ends_with("\r\n\r\x1b[2K> versio"), "{text:?}");
    assert!(type_line(&mut bed, &line, &port, "n").contains("ok autoswing"));
}

/// A line in error, a terminal that takes nothing: the console lives on.
#[test]
fn broken_wires_do_not_stop_the_console() {
    let (mut bed, line, port, _) = with_console();
    for mood in [Mood::Fails, Mood::Ends] {
        line.mood.set(mood);
        let before = line.reads.get();
        bed.ms(10);
        let reads = line.reads.get() - before;
        assert!((40..=60).contains(&reads), "{mood:?} {reads}: a pause of 0.2 ms after each");
    }
    line.mood.set(Mood::Works);
    port.mood.set(Mood::Hangs);
    assert_eq!(type_line(&mut bed, &line, &port, "version"), "");
    // Each of its characters is given half a second to go.
    bed.ms(8_000);
    port.mood.set(Mood::Works);
    bed.ms(1_000);
    let _ = port.text();
    assert!(type_line(&mut bed, &line, &port, "version").contains("ok autoswing"));
}
