//! Restarts: the collection in RAM, and stored values.

use testkit::random::Random as Bits;

use super::*;
use crate::settings::{PORT_COUNT, PortNumber, ProtocolKind};
use crate::synthetic::multirotor_samples;
use autoswing::calibration::CollectionPart;

const NO_PROTOCOLS: [ProtocolKind; PORT_COUNT] = [ProtocolKind::Auto; PORT_COUNT];
const DETECTED_PROTOCOLS: [ProtocolKind; PORT_COUNT] = [ProtocolKind::Mavlink, ProtocolKind::Nmea];

/// RAM and flash contents, sample clock.
struct Module {
    retained_samples: RetainedSamples,
    stored_values: StoredValues,
    now_ms: u32,
    write_count: u32,
}

impl Module {
    fn new() -> Self {
        Self {
            retained_samples: RetainedSamples::EMPTY,
            stored_values: StoredValues::default(),
            now_ms: 0,
            write_count: 0,
        }
    }

    /// Starts the armed module at clock zero and runs a test on it.
    fn run_module<T>(&mut self, run: impl FnOnce(&mut RunningModule<'_>) -> T) -> T {
        let mut compass = Compass::new(AcceptancePolicy::DEFAULT, &self.stored_values, &mut self.retained_samples);
        compass.process_event(Event::SensorDetected(SENSOR, READINGS_PER_SAMPLE));
        compass.process_event(Event::ArmedStateReported(Some(true)));
        self.now_ms = 100;
        let mut started = RunningModule {
            compass,
            stored_values: &mut self.stored_values,
            now_ms: &mut self.now_ms,
            write_count: &mut self.write_count,
        };
        let result = run(&mut started);
        started.report_detected_protocols(NO_PROTOCOLS);
        result
    }

    fn lose_power(&mut self) {
        let mut random = Bits(1);
        self.retained_samples.transform_words(|_| random.bits() as u32);
    }
}

struct RunningModule<'a> {
    compass: Compass<'a>,
    stored_values: &'a mut StoredValues,
    now_ms: &'a mut u32,
    write_count: &'a mut u32,
}

impl RunningModule<'_> {
    fn send_command(&mut self, command: Command) -> Effect {
        self.compass.process_event(Event::Command(command, WrappingMillis::new(*self.now_ms)))
    }

    /// Passes detected protocols as in idle time; saves if requested.
    fn report_detected_protocols(&mut self, detected: [ProtocolKind; PORT_COUNT]) {
        if let Effect::Save =
            self.compass.process_event(Event::ProtocolsDetected(detected, WrappingMillis::new(*self.now_ms)))
        {
            let Some(StoreChange::StartupValues(startup_values)) = self.compass.pending_change() else { panic!() };
            self.stored_values.startup_values = startup_values;
            *self.write_count += 1;
            assert!(matches!(self.compass.process_event(Event::Saved(Ok(()))), Effect::None));
        }
    }

    fn collect_flight(&mut self, samples: &[Sample]) -> Option<SolveOutcome> {
        for sample in samples {
            *self.now_ms += 250;
            let sample = Sample { time: WrappingMillis::new(*self.now_ms), ..*sample };
            assert!(matches!(self.compass.process_event(Event::Sample(sample)), Effect::None));
            self.report_detected_protocols(NO_PROTOCOLS);
            while self.compass.needs_solve_step() {
                match self.compass.process_event(Event::AdvanceSolve) {
                    Effect::None => self.report_detected_protocols(NO_PROTOCOLS),
                    Effect::Save => {
                        let Some(StoreChange::StoredCalibrations { current, .. }) = self.compass.pending_change()
                        else {
                            panic!()
                        };
                        self.stored_values.stored_calibrations.current_calibration = current.copied();
                        self.stored_values.startup_values.is_collecting = false;
                        let Effect::Notify(Message::Solved(outcome)) = self.compass.process_event(Event::Saved(Ok(())))
                        else {
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

    fn status_report(&mut self) -> StatusReport {
        let Effect::Reply(Ok(Reply::Report(report))) = self.send_command(Command::Status) else { panic!() };
        report
    }
}

fn hover_samples() -> Vec<Sample> {
    multirotor_samples(&airframe(), 0.3, &mut Random(1))
}

/// The calibration's RMS error is that of a run without a restart, to 0.25 deg, after one restart or one every 15 s.
#[test]
fn a_restarted_collection_ends_with_the_same_accuracy() {
    let hover_samples = hover_samples();
    let ends = |cuts: &[usize]| {
        let mut module = Module::new();
        let mut rest = &hover_samples[..];
        let mut began = 0;
        for &cut in cuts {
            let (now, later) = rest.split_at(cut - began);
            assert!(module.run_module(|run| run.collect_flight(now)).is_none(), "{cuts:?}");
            (rest, began) = (later, cut);
        }
        let outcome = module.run_module(|run| run.collect_flight(rest)).unwrap_or_else(|| panic!("{cuts:?}: no end"));
        assert!(outcome.is_ok(), "{cuts:?}: {outcome:?}");
        let calibration = module.stored_values.stored_calibrations.current_calibration.unwrap().calibration;
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
    let hover_samples = hover_samples();
    let mut module = Module::new();
    module.run_module(|run| {
        assert!(run.collect_flight(&hover_samples[..60]).is_none() && run.status_report().is_automatic);
    });
    let samples = module.run_module(|run| {
        let report = run.status_report();
        assert!(report.is_automatic && report.module_state == ModuleState::Collecting);
        run.compass.process_event(Event::ArmedStateReported(Some(false)));
        assert!(run.collect_flight(&hover_samples[60..100]).is_none() && run.status_report().awaits_arming);
        report.collection_progress.coverage_of(CollectionPart::FREE).fit_count
    });
    module.run_module(|run| {
        assert_eq!(run.status_report().collection_progress.coverage_of(CollectionPart::FREE).fit_count, samples);
        assert!(matches!(run.send_command(Command::CalStart(Procedure::Flight)), Effect::Reply(Ok(_))), "taken over");
    });
    module.run_module(|run| {
        let refusal = run.send_command(Command::CalStart(Procedure::Flight));
        assert!(matches!(refusal, Effect::Reply(Err(Refusal::Collecting { .. }))), "a person's: {refusal:?}");
        run.compass.collector.reset_restart_count();
        run.send_command(Command::CalStop);
    });
    module.run_module(|run| {
        assert!(run.collect_flight(&hover_samples[100..160]).is_none());
        let report = run.status_report();
        assert_eq!(
            (report.module_state, report.collection_progress.coverage_of(CollectionPart::FREE).fit_count),
            (ModuleState::Uncalibrated, samples),
            "nor does it begin"
        );
        assert!(matches!(
            run.send_command(Command::CalSolve(None)),
            Effect::Reply(Ok(Reply::Done(ModuleState::Solving)))
        ));
    });
}

#[test]
fn samples_survive_a_restart_in_a_solve_but_not_its_end() {
    let hover_samples = hover_samples();
    let mut module = Module::new();
    module.run_module(|run| {
        run.send_command(Command::CalStart(Procedure::Flight));
        for (i, sample) in hover_samples[..60].iter().enumerate() {
            run.compass.process_event(Event::Sample(Sample { time: WrappingMillis::new(250 * i as u32), ..*sample }));
            if run.compass.needs_solve_step() {
                run.compass.process_event(Event::AdvanceSolve);
                return;
            }
        }
        panic!("a trial after forty samples");
    });
    module.run_module(|run| {
        assert_eq!((run.compass.module_state(), run.status_report().is_automatic), (ModuleState::Collecting, false));
        run.send_command(Command::CalSolve(Some(Method::TwoPlane)));
        let mut steps = 0;
        while run.compass.needs_solve_step() && steps < 1000 {
            run.compass.process_event(Event::AdvanceSolve);
            steps += 1;
        }
        assert!(
            matches!(run.compass.last_collection_outcome(), Some(Message::Solved(Err(_)))),
            "no turns: {:?}",
            run.compass.last_collection_outcome()
        );
        assert!(run.collect_flight(&hover_samples[60..62]).is_none());
        assert_eq!(run.compass.module_state(), ModuleState::Uncalibrated, "the user remains in control");
    });
    module.run_module(|run| {
        assert_eq!(
            (
                run.compass.module_state(),
                run.status_report().collection_progress.coverage_of(CollectionPart::FREE).fit_count
            ),
            (ModuleState::Uncalibrated, 0)
        );
        assert_eq!(run.compass.last_collection_outcome(), None, "the loss was reported before");
    });
    module.run_module(|run| {
        run.send_command(Command::CalStart(Procedure::Flight));
        run.collect_flight(&hover_samples[..30]);
        run.send_command(Command::CalAbort);
    });
    module.run_module(|run| {
        assert_eq!(run.status_report().collection_progress.coverage_of(CollectionPart::FREE).fit_count, 0);
    });
}

#[test]
fn a_collection_whose_calibration_is_stored_is_discarded() {
    let mut module = Module::new();
    module.run_module(|run| assert!(run.collect_flight(&hover_samples()[..60]).is_none()));
    module.stored_values.stored_calibrations.current_calibration =
        Some(CalibrationRecord { sensor: SENSOR, ..calibration_record(1) });
    module.run_module(|run| {
        assert_eq!(
            (
                run.compass.module_state(),
                run.status_report().collection_progress.coverage_of(CollectionPart::FREE).fit_count
            ),
            (ModuleState::Calibrated, 0)
        );
        assert_eq!(run.compass.last_collection_outcome(), None);
    });
}

/// Two writes per collection, at its first samples and its end; one if it ends with a calibration. A loss is reported
/// once.
#[test]
fn a_collection_lost_with_the_power_is_reported() {
    let hover_samples = hover_samples();
    let mut module = Module::new();
    module.run_module(|run| {
        run.collect_flight(&hover_samples[..4]);
        assert_eq!(*run.write_count, 0, "nothing to lose yet");
        run.collect_flight(&hover_samples[4..80]);
        assert_eq!(*run.write_count, 1);
    });
    module.run_module(|run| {
        assert_eq!((run.compass.last_collection_outcome(), *run.write_count), (None, 1), "it is not lost");
    });
    module.lose_power();
    module.run_module(|run| {
        assert_eq!(run.compass.last_collection_outcome(), Some(&Message::CollectionLost));
        assert_eq!(run.compass.indicator_state(), IndicatorState::Idle, "no trouble");
        run.report_detected_protocols(NO_PROTOCOLS);
        assert_eq!((run.stored_values.startup_values, *run.write_count), (StartupValues::DEFAULT, 2));
    });
    module.lose_power();
    module.run_module(|run| {
        assert_eq!((run.compass.last_collection_outcome(), *run.write_count), (None, 2), "the loss is reported once");
    });
    module.run_module(|run| assert!(run.collect_flight(&hover_samples).is_some_and(|end| end.is_ok())));
    module.lose_power();
    module.run_module(|run| {
        assert_eq!((run.compass.last_collection_outcome(), *run.write_count), (None, 3), "stored with the calibration");
    });
}

/// Corrupted memory and repeated unexpected restarts count as a loss.
#[test]
fn a_damaged_collection_is_reported() {
    let hover_samples = hover_samples();
    let mut module = Module::new();
    module.run_module(|run| assert!(run.collect_flight(&hover_samples[..80]).is_none()));
    let mut damaged = Module {
        retained_samples: module.retained_samples.clone(),
        stored_values: module.stored_values,
        now_ms: 0,
        write_count: 0,
    };
    let mut at = 0;
    damaged.retained_samples.transform_words(|word| {
        at += 1;
        if at == 100 { word ^ 1 } else { word }
    });
    damaged.run_module(|run| {
        assert_eq!(run.compass.last_collection_outcome(), Some(&Message::CollectionLost));
        assert_eq!(run.status_report().collection_progress.coverage_of(CollectionPart::FREE).fit_count, 0);
    });
    for _ in 0..3 {
        module.run_module(|run| assert_eq!(run.compass.last_collection_outcome(), None));
    }
    module.run_module(|run| assert_eq!(run.compass.last_collection_outcome(), Some(&Message::CollectionLost)));
}

#[test]
fn requested_restarts_and_trial_solves_reset_the_restart_count() {
    let hover_samples = hover_samples();
    let mut module = Module::new();
    module.run_module(|run| assert!(run.collect_flight(&hover_samples[..60]).is_none()));
    for _ in 0..6 {
        module.run_module(|run| {
            assert_eq!(run.compass.module_state(), ModuleState::Collecting);
            run.compass.process_event(Event::ArmedStateReported(Some(false)));
            assert!(matches!(run.send_command(Command::Restart), Effect::Reply(Ok(_))));
        });
    }
    for _ in 0..6 {
        module.run_module(|run| {
            assert_eq!(run.compass.module_state(), ModuleState::Collecting);
            assert!(
                run.collect_flight(&hover_samples[60..62]).is_none() && run.status_report().last_trial.is_some(),
                "a trial"
            );
        });
    }
}

/// A protocol is written after 5 s of detection; silence and configured protocols are not written.
#[test]
fn detected_protocols_are_written_once() {
    let mut module = Module::new();
    let at = |run: &mut RunningModule<'_>, ms: u32, spoken| {
        *run.now_ms = ms;
        run.report_detected_protocols(spoken);
        // The other port may be NMEA, or detecting in a firmware without NMEA.
        let [found, _] = run.stored_values.startup_values.detected_protocols;
        (found, *run.write_count)
    };
    let other = [ProtocolKind::Msp, ProtocolKind::Nmea];
    let [nothing, mavlink, msp] = [ProtocolKind::Auto, ProtocolKind::Mavlink, ProtocolKind::Msp];
    module.run_module(|run| {
        assert_eq!(at(run, 1000, NO_PROTOCOLS), (nothing, 0));
        assert_eq!(at(run, 9000, DETECTED_PROTOCOLS), (nothing, 0));
        assert_eq!(at(run, 13_999, DETECTED_PROTOCOLS), (nothing, 0));
        assert_eq!(at(run, 14_000, DETECTED_PROTOCOLS), (mavlink, 1));
        assert_eq!(at(run, 19_000, DETECTED_PROTOCOLS), (mavlink, 1));
        assert_eq!(at(run, 30_000, NO_PROTOCOLS), (mavlink, 1));
        assert_eq!(at(run, 40_000, NO_PROTOCOLS), (mavlink, 1), "silence");
        assert_eq!(at(run, 41_000, other), (mavlink, 1));
        assert_eq!(at(run, 42_000, DETECTED_PROTOCOLS), (mavlink, 1), "not for long enough");
        assert_eq!(at(run, 46_500, other), (mavlink, 1));
        assert_eq!(at(run, 51_500, other), (msp, 2));
    });
    module.run_module(|run| {
        assert_eq!((at(run, 1000, other), at(run, 9000, other)), ((msp, 2), (msp, 2)), "as it was stored");
        let chosen = SettingChange::Protocol(PortNumber::One, ProtocolKind::Mavlink);
        assert!(matches!(run.send_command(Command::Set(chosen)), Effect::Save));
        run.compass.process_event(Event::Saved(Ok(())));
        assert_eq!(
            (at(run, 10_000, DETECTED_PROTOCOLS), at(run, 20_000, DETECTED_PROTOCOLS)),
            ((msp, 2), (msp, 2)),
            "chosen"
        );
    });
}

#[test]
fn a_failed_save_of_protocols_is_not_repeated() {
    let mut bench = TestBed::new();
    let mut saves = 0;
    for second in 0..60 {
        let now = WrappingMillis::new(second * 1000);
        if let Effect::Save = bench.compass.process_event(Event::ProtocolsDetected(DETECTED_PROTOCOLS, now)) {
            saves += 1;
            assert!(matches!(bench.compass.process_event(Event::Saved(Err(StoreError::Flash))), Effect::None));
        }
    }
    assert_eq!(saves, 1);
}

#[test]
fn no_flash_write_happens_during_a_solve() {
    let mut bench = TestBed::new();
    bench.expect_done(Command::CalStart(Procedure::Turns));
    bench.fly_turns(&complete_turns(&airframe(), 1));
    assert!(bench.compass.needs_solve_step());
    assert!(matches!(
        bench.compass.process_event(Event::ProtocolsDetected(NO_PROTOCOLS, WrappingMillis::new(0))),
        Effect::None
    ));
    assert!(matches!(bench.compass.process_event(Event::AdvanceSolve), Effect::None));
    let end = bench.run_solve();
    assert!(bench.outcome_after_save(end).is_ok());
    // A collection without stored flag needs no second write.
    assert!(matches!(
        bench.compass.process_event(Event::ProtocolsDetected(NO_PROTOCOLS, WrappingMillis::new(0))),
        Effect::None
    ));
}
