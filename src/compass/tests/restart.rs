//! Restarts: the collection in RAM, and stored values.

use testkit::random::Random as Bits;

use super::*;
use crate::calibration::tests::synthetic::multirotor_samples;
use crate::settings::{PORT_COUNT, PortNumber, ProtocolKind};

const SILENT: [ProtocolKind; PORT_COUNT] = [ProtocolKind::Auto; PORT_COUNT];
const FOUND: [ProtocolKind; PORT_COUNT] = [ProtocolKind::Mavlink, ProtocolKind::Nmea];

/// RAM and flash contents, sample clock.
struct Module {
    kept: RetainedSamples,
    stored: StoredValues,
    now: u32,
    writes: u32,
}

impl Module {
    fn new() -> Self {
        Self { kept: RetainedSamples::EMPTY, stored: StoredValues::default(), now: 0, writes: 0 }
    }

    /// Starts the armed module at clock zero and runs a test on it.
    fn run<T>(&mut self, run: impl FnOnce(&mut Run<'_>) -> T) -> T {
        let mut compass = Compass::new(AcceptancePolicy::DEFAULT, &self.stored, &mut self.kept);
        compass.step(Event::SensorDetected(SENSOR, READINGS));
        compass.step(Event::Armed(Some(true)));
        self.now = 100;
        let mut started = Run { compass, stored: &mut self.stored, now: &mut self.now, writes: &mut self.writes };
        let result = run(&mut started);
        started.detect_protocols(SILENT);
        result
    }

    fn lose_power(&mut self) {
        let mut random = Bits(1);
        self.kept.transform_words(|_| random.bits() as u32);
    }
}

struct Run<'a> {
    compass: Compass<'a>,
    stored: &'a mut StoredValues,
    now: &'a mut u32,
    writes: &'a mut u32,
}

impl Run<'_> {
    fn command(&mut self, command: Command) -> Effect {
        self.compass.step(Event::Command(command, WrappingMillis::new(*self.now)))
    }

    /// Passes detected protocols as in idle time; saves if requested.
    fn detect_protocols(&mut self, detected: [ProtocolKind; PORT_COUNT]) {
        if let Effect::Save = self.compass.step(Event::ProtocolsDetected(detected, WrappingMillis::new(*self.now))) {
            let Some(StoreChange::StartupValues(startup_values)) = self.compass.pending_change() else { panic!() };
            self.stored.startup_values = startup_values;
            *self.writes += 1;
            assert!(matches!(self.compass.step(Event::Saved(Ok(()))), Effect::None));
        }
    }

    fn fly(&mut self, samples: &[Sample]) -> Option<SolveOutcome> {
        for sample in samples {
            *self.now += 250;
            let sample = Sample { time: WrappingMillis::new(*self.now), ..*sample };
            assert!(matches!(self.compass.step(Event::Sample(sample)), Effect::None));
            self.detect_protocols(SILENT);
            while self.compass.is_busy() {
                match self.compass.step(Event::Advance) {
                    Effect::None => self.detect_protocols(SILENT),
                    Effect::Save => {
                        let Some(StoreChange::StoredCalibrations { current, .. }) = self.compass.pending_change()
                        else {
                            panic!()
                        };
                        self.stored.stored_calibrations.current_calibration = current.copied();
                        self.stored.startup_values.is_collecting = false;
                        let Effect::Notify(Message::Solved(outcome)) = self.compass.step(Event::Saved(Ok(()))) else {
                            panic!()
                        };
                        return Some(outcome);
                    }
                    Effect::Notify(Message::Solved(outcome)) => return Some(outcome),
                    other => panic!("nobody asked: {other:?}"),
                }
            }
        }
        None
    }

    fn report(&mut self) -> StatusReport {
        let Effect::Reply(Ok(Reply::Report(report))) = self.command(Command::Status) else { panic!() };
        report
    }
}

fn hover() -> Vec<Sample> {
    multirotor_samples(&airframe(), 0.3, &mut Random(1))
}

/// The calibration's RMS error is that of a run without a restart, to 0.25 deg, after one restart or one every 15 s.
#[test]
fn a_restarted_collection_ends_with_the_same_accuracy() {
    let hover_samples = hover();
    let ends = |cuts: &[usize]| {
        let mut module = Module::new();
        let mut rest = &hover_samples[..];
        let mut began = 0;
        for &cut in cuts {
            let (now, later) = rest.split_at(cut - began);
            assert!(module.run(|run| run.fly(now)).is_none(), "{cuts:?}");
            (rest, began) = (later, cut);
        }
        let outcome = module.run(|run| run.fly(rest)).unwrap_or_else(|| panic!("{cuts:?}: no end"));
        assert!(outcome.is_ok(), "{cuts:?}: {outcome:?}");
        let calibration = module.stored.stored_calibrations.current_calibration.unwrap().calibration;
        rms(&airframe().errors_deg(&calibration))
    };
    let uninterrupted = ends(&[]);
    for cuts in [vec![1], vec![39], vec![60], vec![120], vec![200], (60..240).step_by(60).collect()] {
        let restarted = ends(&cuts);
        assert!((restarted - uninterrupted).abs() < 0.25, "{cuts:?}: {restarted} {uninterrupted}");
    }
}

#[test]
fn control_of_a_collection_survives_restarts() {
    let hover_samples = hover();
    let mut module = Module::new();
    module.run(|run| assert!(run.fly(&hover_samples[..60]).is_none() && run.report().is_automatic));
    let samples = module.run(|run| {
        let report = run.report();
        assert!(report.is_automatic && report.module_state == ModuleState::Collecting);
        run.compass.step(Event::Armed(Some(false)));
        assert!(run.fly(&hover_samples[60..100]).is_none() && run.report().awaits_arming);
        report.progress.left_turns.samples
    });
    module.run(|run| {
        assert_eq!(run.report().progress.left_turns.samples, samples);
        assert!(matches!(run.command(Command::CalStart(Procedure::Flight)), Effect::Reply(Ok(_))), "taken over");
    });
    module.run(|run| {
        let refusal = run.command(Command::CalStart(Procedure::Flight));
        assert!(matches!(refusal, Effect::Reply(Err(Refusal::Collecting { .. }))), "a person's: {refusal:?}");
        run.compass.collector.reset_restart_count();
        run.command(Command::CalStop);
    });
    module.run(|run| {
        assert!(run.fly(&hover_samples[100..160]).is_none());
        let report = run.report();
        assert_eq!(
            (report.module_state, report.progress.left_turns.samples),
            (ModuleState::Uncalibrated, samples),
            "nor does it begin"
        );
        assert!(matches!(run.command(Command::CalSolve(None)), Effect::Reply(Ok(Reply::Done(ModuleState::Solving)))));
    });
}

#[test]
fn samples_survive_a_restart_in_a_solve_but_not_its_end() {
    let hover_samples = hover();
    let mut module = Module::new();
    module.run(|run| {
        run.command(Command::CalStart(Procedure::Flight));
        for (i, sample) in hover_samples[..60].iter().enumerate() {
            run.compass.step(Event::Sample(Sample { time: WrappingMillis::new(250 * i as u32), ..*sample }));
            if run.compass.is_busy() {
                run.compass.step(Event::Advance);
                return;
            }
        }
        panic!("a trial after forty samples");
    });
    module.run(|run| {
        assert_eq!((run.compass.module_state(), run.report().is_automatic), (ModuleState::Collecting, false));
        run.command(Command::CalSolve(Some(Method::TwoPlane)));
        let mut steps = 0;
        while run.compass.is_busy() && steps < 1000 {
            run.compass.step(Event::Advance);
            steps += 1;
        }
        assert!(
            matches!(run.compass.last_outcome(), Some(Message::Solved(Err(_)))),
            "no turns: {:?}",
            run.compass.last_outcome()
        );
    });
    module.run(|run| {
        assert_eq!(
            (run.compass.module_state(), run.report().progress.left_turns.samples),
            (ModuleState::Uncalibrated, 0)
        );
        assert_eq!(run.compass.last_outcome(), None, "it was told");
    });
    module.run(|run| {
        run.command(Command::CalStart(Procedure::Flight));
        run.fly(&hover_samples[..30]);
        run.command(Command::CalAbort);
    });
    module.run(|run| assert_eq!(run.report().progress.left_turns.samples, 0));
}

#[test]
fn a_collection_whose_calibration_is_stored_is_discarded() {
    let mut module = Module::new();
    module.run(|run| assert!(run.fly(&hover()[..60]).is_none()));
    module.stored.stored_calibrations.current_calibration = Some(CalibrationRecord { sensor: SENSOR, ..record(1) });
    module.run(|run| {
        assert_eq!(
            (run.compass.module_state(), run.report().progress.left_turns.samples),
            (ModuleState::Calibrated, 0)
        );
        assert_eq!(run.compass.last_outcome(), None);
    });
}

/// Two writes per collection, at its first samples and its end; one if it ends with a calibration. A loss is reported
/// once.
#[test]
fn a_collection_lost_with_the_power_is_reported() {
    let hover_samples = hover();
    let mut module = Module::new();
    module.run(|run| {
        run.fly(&hover_samples[..4]);
        assert_eq!(*run.writes, 0, "nothing to lose yet");
        run.fly(&hover_samples[4..80]);
        assert_eq!(*run.writes, 1);
    });
    module.run(|run| assert_eq!((run.compass.last_outcome(), *run.writes), (None, 1), "it is not lost"));
    module.lose_power();
    module.run(|run| {
        assert_eq!(run.compass.last_outcome(), Some(&Message::CollectionLost));
        assert_eq!(run.compass.indicator_state(), IndicatorState::Idle, "no trouble");
        run.detect_protocols(SILENT);
        assert_eq!((run.stored.startup_values, *run.writes), (StartupValues::DEFAULT, 2));
    });
    module.lose_power();
    module.run(|run| assert_eq!((run.compass.last_outcome(), *run.writes), (None, 2), "told once"));
    module.run(|run| assert!(run.fly(&hover_samples).is_some_and(|end| end.is_ok())));
    module.lose_power();
    module.run(|run| assert_eq!((run.compass.last_outcome(), *run.writes), (None, 3), "stored with the calibration"));
}

/// Corrupted memory and repeated unexpected restarts count as a loss.
#[test]
fn a_damaged_collection_is_reported() {
    let hover_samples = hover();
    let mut module = Module::new();
    module.run(|run| assert!(run.fly(&hover_samples[..80]).is_none()));
    let mut damaged = Module { kept: module.kept.clone(), stored: module.stored, now: 0, writes: 0 };
    let mut at = 0;
    damaged.kept.transform_words(|word| {
        at += 1;
        if at == 100 { word ^ 1 } else { word }
    });
    damaged.run(|run| {
        assert_eq!(run.compass.last_outcome(), Some(&Message::CollectionLost));
        assert_eq!(run.report().progress.left_turns.samples, 0);
    });
    for _ in 0..3 {
        module.run(|run| assert_eq!(run.compass.last_outcome(), None));
    }
    module.run(|run| assert_eq!(run.compass.last_outcome(), Some(&Message::CollectionLost)));
}

#[test]
fn requested_restarts_and_trial_solves_reset_the_restart_count() {
    let hover_samples = hover();
    let mut module = Module::new();
    module.run(|run| assert!(run.fly(&hover_samples[..60]).is_none()));
    for _ in 0..6 {
        module.run(|run| {
            assert_eq!(run.compass.module_state(), ModuleState::Collecting);
            run.compass.step(Event::Armed(Some(false)));
            assert!(matches!(run.command(Command::Restart), Effect::Reply(Ok(_))));
        });
    }
    for _ in 0..6 {
        module.run(|run| {
            assert_eq!(run.compass.module_state(), ModuleState::Collecting);
            assert!(run.fly(&hover_samples[60..62]).is_none() && run.report().last_trial.is_some(), "a trial");
        });
    }
}

/// A protocol is written after 5 s of detection; silence and configured protocols are not written.
#[test]
fn detected_protocols_are_written_once() {
    let mut module = Module::new();
    let at = |run: &mut Run<'_>, ms: u32, spoken| {
        *run.now = ms;
        run.detect_protocols(spoken);
        // The other port may be NMEA, or detecting in a firmware without NMEA.
        let [found, _] = run.stored.startup_values.detected_protocols;
        (found, *run.writes)
    };
    let other = [ProtocolKind::Msp, ProtocolKind::Nmea];
    let [nothing, mavlink, msp] = [ProtocolKind::Auto, ProtocolKind::Mavlink, ProtocolKind::Msp];
    module.run(|run| {
        assert_eq!(at(run, 1000, SILENT), (nothing, 0));
        assert_eq!(at(run, 9000, FOUND), (nothing, 0));
        assert_eq!(at(run, 13_999, FOUND), (nothing, 0));
        assert_eq!(at(run, 14_000, FOUND), (mavlink, 1));
        assert_eq!(at(run, 19_000, FOUND), (mavlink, 1));
        assert_eq!(at(run, 30_000, SILENT), (mavlink, 1));
        assert_eq!(at(run, 40_000, SILENT), (mavlink, 1), "silence");
        assert_eq!(at(run, 41_000, other), (mavlink, 1));
        assert_eq!(at(run, 42_000, FOUND), (mavlink, 1), "not for long enough");
        assert_eq!(at(run, 46_500, other), (mavlink, 1));
        assert_eq!(at(run, 51_500, other), (msp, 2));
    });
    module.run(|run| {
        assert_eq!((at(run, 1000, other), at(run, 9000, other)), ((msp, 2), (msp, 2)), "as it was stored");
        let chosen = SettingChange::Protocol(PortNumber::One, ProtocolKind::Mavlink);
        assert!(matches!(run.command(Command::Set(chosen)), Effect::Save));
        run.compass.step(Event::Saved(Ok(())));
        assert_eq!((at(run, 10_000, FOUND), at(run, 20_000, FOUND)), ((msp, 2), (msp, 2)), "chosen");
    });
}

#[test]
fn a_failed_save_of_protocols_is_not_repeated() {
    let mut bench = TestBed::new();
    let mut saves = 0;
    for second in 0..60 {
        let now = WrappingMillis::new(second * 1000);
        if let Effect::Save = bench.compass.step(Event::ProtocolsDetected(FOUND, now)) {
            saves += 1;
            assert!(matches!(bench.compass.step(Event::Saved(Err(StoreError::Flash))), Effect::None));
        }
    }
    assert_eq!(saves, 1);
}

#[test]
fn no_flash_write_happens_during_a_solve() {
    let mut bench = TestBed::new();
    bench.done(Command::CalStart(Procedure::Turns));
    bench.fly(&turns(&airframe(), 1));
    assert!(bench.compass.is_busy());
    assert!(matches!(bench.compass.step(Event::ProtocolsDetected(SILENT, WrappingMillis::new(0))), Effect::None));
    assert!(matches!(bench.compass.step(Event::Advance), Effect::None));
    let end = bench.solve();
    assert!(bench.settle(end).is_ok());
    // A collection without stored flag needs no second write.
    assert!(matches!(bench.compass.step(Event::ProtocolsDetected(SILENT, WrappingMillis::new(0))), Effect::None));
}
