mod auto;
mod earth;
mod flight;
mod restart;

use super::state::SAMPLES_DURING_SOLVE_CAPACITY;
use super::*;
use crate::acceptance::Rejection;
use crate::calibration::tests::synthetic::{Airframe, Flight, Random, RecordedTurns, rms};
use crate::calibration::{Calibration, CollectionPart, Method, Orientation, SamplePart, Side, SolveError};
use crate::collection::CollectionProblem;
use crate::frames::{Attitude, Field, Sensor};
use crate::instrument::{Correction, SampleAttitude, SensorErrorSigmas};
use crate::messages::{ExpectedAccuracy, Message, SolveOutcome};
use crate::reading::{Identity, MagnetometerModel};
use crate::settings::{AttitudeError, HeadingKind, OutOfRange, SensorError, Settings};
use crate::store::tests::calibration_record;
use crate::store::{CalibrationRecord, StartupValues, StoreChange, StoreError, StoredCalibrations};

const SENSOR: Identity = Identity { model: MagnetometerModel::Lis3mdl, address: 0x1E };
const READINGS_PER_SAMPLE: u16 = 8;

/// Sample interval, milliseconds: samples are distinct, and turns have no gap.
const STEP_MS: u32 = 500;

fn leaked_retained_samples() -> &'static mut RetainedSamples {
    Box::leak(Box::new(RetainedSamples::EMPTY))
}

/// State machine and sample clock.
struct TestBed {
    compass: Compass<'static>,
    now_ms: u32,
}

impl TestBed {
    fn new() -> Self {
        Self::with_state(AcceptancePolicy::DEFAULT, StoredCalibrations::default())
    }

    #[expect(clippy::large_types_passed_by_value, reason = "each call makes one of its own")]
    fn with_state(policy: AcceptancePolicy, stored_calibrations: StoredCalibrations) -> Self {
        let mut bench = Self {
            compass: Compass::new(
                policy,
                &StoredValues { stored_calibrations, ..StoredValues::default() },
                leaked_retained_samples(),
            ),
            now_ms: u32::MAX - 20_000,
        };
        bench.compass.process_event(Event::SensorDetected(SENSOR, READINGS_PER_SAMPLE));
        bench
    }

    fn time(&self) -> WrappingMillis {
        WrappingMillis::new(self.now_ms)
    }

    fn send_command(&mut self, command: Command) -> Effect {
        let now = self.time();
        self.compass.process_event(Event::Command(command, now))
    }

    /// Sends a command with an immediate reply.
    fn request_reply(&mut self, command: Command) -> Result<Reply, Refusal> {
        match self.send_command(command) {
            Effect::Reply(reply) => reply,
            other => panic!("{command:?}: {other:?}"),
        }
    }

    fn expect_refusal(&mut self, command: Command) -> Refusal {
        self.request_reply(command).map(|_| ()).expect_err("a refusal")
    }

    fn expect_done(&mut self, command: Command) -> ModuleState {
        match self.request_reply(command) {
            Ok(Reply::Done(state)) => state,
            other => panic!("{command:?}: {other:?}"),
        }
    }

    /// Sends a command with a reply after saving.
    fn save_by_command(&mut self, command: Command) -> Result<Reply, Refusal> {
        assert!(matches!(self.send_command(command), Effect::Save), "{command:?}");
        assert!(self.compass.pending_change().is_some());
        match self.compass.process_event(Event::Saved(Ok(()))) {
            Effect::Reply(reply) => reply,
            other => panic!("{command:?}: {other:?}"),
        }
    }

    fn process_sample(&mut self, field: Field<Sensor>, attitude: Attitude) -> Effect {
        let effect =
            self.compass.process_event(Event::Sample(Sample { time: self.time(), ..Sample::new(field, attitude) }));
        self.now_ms = self.now_ms.wrapping_add(STEP_MS);
        effect
    }

    fn collect_at_rest(&mut self, field: Field<Sensor>, samples: u32) {
        for _ in 0..samples {
            self.compass
                .process_event(Event::Sample(Sample { time: self.time(), ..Sample::new(field, Attitude::default()) }));
            self.now_ms = self.now_ms.wrapping_add(100);
        }
    }

    /// Flies left then right turns until a solve starts.
    fn fly_turns(&mut self, recorded: &RecordedTurns) {
        for sample in recorded.left.iter().chain(&recorded.right) {
            if !self.compass.needs_solve_step() {
                assert!(matches!(self.process_sample(sample.field, sample.attitude), Effect::None));
            }
        }
    }

    fn run_solve(&mut self) -> Effect {
        for _ in 0..1000 {
            match self.compass.process_event(Event::AdvanceSolve) {
                Effect::None => assert!(self.compass.needs_solve_step(), "it waits for nothing"),
                end => return end,
            }
        }
        panic!("it never ends");
    }

    fn calibrate(&mut self, recorded: &RecordedTurns) -> SolveOutcome {
        assert_eq!(self.expect_done(Command::CalStart(Procedure::Turns)), ModuleState::Collecting);
        self.fly_turns(recorded);
        if !self.compass.needs_solve_step() {
            assert_eq!(self.expect_done(Command::CalSolve(None)), ModuleState::Solving);
        }
        let end = self.run_solve();
        self.outcome_after_save(end)
    }

    fn tumble(&mut self) {
        let airframe = Airframe::random(&mut Random(3), 0.1, 1.0, 0.0, [55.0, 55.0]);
        let mut random = Random(4);
        for _ in 0..240 {
            let attitude =
                Attitude { roll_rad: random.uniform(-3.1, 3.1), pitch_rad: random.uniform(-1.0, 1.0).asin() };
            let field = airframe.field(attitude, random.uniform(0.0, core::f32::consts::TAU));
            self.process_sample(field, Attitude::default());
        }
    }

    fn outcome_after_save(&mut self, end: Effect) -> SolveOutcome {
        match end {
            Effect::Notify(Message::Solved(outcome)) => outcome,
            Effect::Save => match self.compass.process_event(Event::Saved(Ok(()))) {
                Effect::Notify(Message::Solved(outcome)) => outcome,
                other => panic!("{other:?}"),
            },
            other => panic!("{other:?}"),
        }
    }

    fn status_report(&mut self) -> StatusReport {
        match self.request_reply(Command::Status) {
            Ok(Reply::Report(report)) => report,
            other => panic!("{other:?}"),
        }
    }
}

fn airframe() -> Airframe {
    Airframe::random(&mut Random(11), 0.1, 1.0, 5.0, [55.0, 55.0])
}

/// A complete collection: two and a half circles each way.
fn complete_turns(airframe: &Airframe, seed: u64) -> RecordedTurns {
    Flight { samples_per_side: 190, ..Flight::TYPICAL }.fly(airframe, &mut Random(seed))
}

/// Enough for `cal solve`: one circle each way.
fn few_turns(airframe: &Airframe, seed: u64) -> RecordedTurns {
    Flight { samples_per_side: 60, ..Flight::TYPICAL }.fly(airframe, &mut Random(seed))
}

fn test_field() -> Field<Sensor> {
    airframe().field(Attitude::default(), 0.7)
}

/// The mounting is output only for a known sensor.
#[test]
fn a_correction_contains_mounting_armed_state_and_expected_errors() {
    let mut compass = Compass::new(AcceptancePolicy::DEFAULT, &StoredValues::default(), leaked_retained_samples());
    assert_eq!(compass.instrument_correction(), Correction::UNCALIBRATED);
    compass.process_event(Event::ArmedStateReported(Some(false)));
    assert_eq!(compass.instrument_correction(), Correction { is_armed: Some(false), ..Correction::UNCALIBRATED });
    let mut bench = TestBed::new();
    let mount = Orientation::from_name("yaw90").unwrap();
    bench.save_by_command(Command::Set(SettingChange::Mount(mount))).unwrap();
    assert_eq!(bench.compass.instrument_correction(), Correction { mount: Some(mount), ..Correction::UNCALIBRATED });
    let error = SensorError { gyro_percent: 50.0 / 8.0, drift_percent: 0.5 };
    bench.save_by_command(Command::Set(SettingChange::SensorError(error))).unwrap();
    assert_eq!(
        bench.compass.instrument_correction().sensor_errors,
        SensorErrorSigmas { gyro_scale: 0.0625, hard_iron_drift_per_minute: 0.005 }
    );
}

#[test]
fn full_turns_to_both_sides_give_a_calibration() {
    let mut bench = TestBed::new();
    assert_eq!(bench.compass.module_state(), ModuleState::Uncalibrated);
    assert_eq!(
        bench.compass.instrument_correction(),
        Correction { mount: Some(Orientation::IDENTITY_ROTATION), ..Correction::UNCALIBRATED }
    );
    bench.expect_done(Command::CalStart(Procedure::Turns));
    bench.fly_turns(&complete_turns(&airframe(), 1));
    assert_eq!(bench.compass.module_state(), ModuleState::Solving);
    while bench.compass.module_state() == ModuleState::Solving {
        assert!(matches!(bench.compass.process_event(Event::AdvanceSolve), Effect::None));
    }
    assert_eq!(bench.compass.module_state(), ModuleState::Verifying);
    assert!(matches!(bench.compass.process_event(Event::AdvanceSolve), Effect::Save));
    assert_eq!(bench.compass.module_state(), ModuleState::Verifying, "until it is written");
    assert!(bench.compass.active_record().is_none());
    let Some(StoreChange::StoredCalibrations { current: Some(written), previous: None }) =
        bench.compass.pending_change()
    else {
        panic!("{:?}", bench.compass.pending_change())
    };
    let written = *written;
    let Effect::Notify(Message::Solved(Ok(verdict))) = bench.compass.process_event(Event::Saved(Ok(()))) else {
        panic!("no message")
    };
    assert_eq!(bench.compass.module_state(), ModuleState::Calibrated);
    assert_eq!(bench.compass.active_record(), Some(&written));
    assert_eq!((written.serial_number, written.sensor, written.mount), (1, SENSOR, Orientation::IDENTITY_ROTATION));
    assert_eq!(verdict, ExpectedAccuracy::new(written.quality, &written.calibration));
    assert!(bench.compass.pending_change().is_none());
    assert!(rms(&airframe().errors_deg(&written.calibration)) < 3.0 * verdict.quality.expected_rms_deg);
    assert_eq!(bench.compass.instrument_correction().calibration, Some((written.calibration, written.uncertainty)));
    let report = bench.status_report();
    assert_eq!(
        (report.module_state, report.can_undo, report.last_collection_outcome.is_some()),
        (ModuleState::Calibrated, false, true)
    );
    assert_eq!(report.stored_calibration.as_ref().map(|summary| summary.serial_number), Some(1));
    assert_eq!(report.stored_calibration.map(|summary| summary.expected_accuracy()), Some(verdict));
}

#[test]
fn settings_of_a_running_solve_cannot_change() {
    let mut bench = TestBed::new();
    bench.expect_done(Command::CalStart(Procedure::Turns));
    bench.fly_turns(&complete_turns(&airframe(), 1));
    assert_eq!(bench.compass.module_state(), ModuleState::Solving);
    for command in [
        Command::CalStart(Procedure::Turns),
        Command::CalMark(10.0),
        Command::CalStop,
        Command::CalSolve(None),
        Command::CalClear,
        Command::CalUndo,
        Command::Align(Some(10.0)),
        Command::Align(None),
        Command::AlignConfirmed(10.0),
        Command::Set(SettingChange::Mount(Orientation::IDENTITY_ROTATION)),
        Command::Set(SettingChange::Inclination(Some(50.0))),
        Command::Set(SettingChange::AttitudeError(AttitudeError::DEFAULT)),
    ] {
        assert_eq!(bench.expect_refusal(command), Refusal::Busy, "{command:?}");
    }
    // Settings not used by solves can be saved during a solve.
    for setting in [
        SettingChange::StreamOn(false),
        SettingChange::StreamRateHz(5),
        SettingChange::StreamHeading(HeadingKind::Raw),
        SettingChange::Declination(Some(3.0)),
    ] {
        assert!(
            matches!(bench.save_by_command(Command::Set(setting)), Ok(Reply::Done(ModuleState::Solving))),
            "{setting:?}"
        );
    }
    assert_eq!(bench.status_report().module_state, ModuleState::Solving);
    assert_eq!(bench.expect_done(Command::Restart), ModuleState::Solving, "a solve is no reason to stay");
    assert_eq!(bench.expect_refusal(Command::CalAdvise), Refusal::NotSolved);
    let end = bench.run_solve();
    assert!(bench.outcome_after_save(end).is_ok());
    let Settings { stream_on, stream_rate_hz, declination_deg, .. } = *bench.compass.stored_settings();
    assert_eq!((stream_on, stream_rate_hz, declination_deg), (false, 5, Some(3.0)));
}

#[test]
fn ground_commands_are_refused_while_armed() {
    let stored_calibrations = StoredCalibrations {
        current_calibration: Some(calibration_record(2)),
        previous_calibration: Some(calibration_record(1)),
    };
    let mut bench = TestBed::with_state(AcceptancePolicy::DEFAULT, stored_calibrations);
    let for_the_ground = [
        Command::CalStart(Procedure::Swing),
        Command::CalStartNew(Some(Procedure::Swing)),
        Command::CalMark(10.0),
        Command::CalClear,
        Command::CalUndo,
        Command::Set(SettingChange::Mount(Orientation::IDENTITY_ROTATION)),
        Command::SetFromBus(SettingChange::StreamRateHz(20)),
        Command::ResetSettings,
        Command::Restart,
    ];
    assert_eq!(bench.status_report().is_armed, None, "before anything is known");
    assert!(matches!(bench.compass.process_event(Event::ArmedStateReported(Some(true))), Effect::None));
    for command in for_the_ground {
        assert_eq!(bench.expect_refusal(command), Refusal::Armed, "{command:?}");
    }
    assert_eq!(bench.status_report().is_armed, Some(true));
    assert_eq!(bench.compass.stored_calibrations, stored_calibrations);
    bench.compass.process_event(Event::ArmedStateReported(Some(false)));
    assert_eq!(bench.expect_done(Command::Restart), ModuleState::Calibrated);
    assert_eq!(bench.expect_done(Command::CalStart(Procedure::Swing)), ModuleState::Collecting);
    bench.collect_at_rest(test_field(), 8);
    assert!(matches!(bench.request_reply(Command::CalMark(10.0)), Ok(Reply::MarkCount(1))));
    for command in
        [Command::CalUndo, Command::Set(SettingChange::Mount(Orientation::IDENTITY_ROTATION)), Command::CalClear]
    {
        bench.save_by_command(command).unwrap();
    }
}

#[test]
fn marks_are_refused_while_armed() {
    let mut bench = TestBed::new();
    bench.expect_done(Command::CalStart(Procedure::Swing));
    bench.collect_at_rest(test_field(), 8);
    bench.compass.process_event(Event::ArmedStateReported(Some(true)));
    assert_eq!(bench.expect_refusal(Command::CalMark(10.0)), Refusal::Armed);
    assert_eq!(bench.expect_refusal(Command::CalStartNew(None)), Refusal::Armed, "it is a swing again");
    assert_eq!(bench.expect_done(Command::CalStop), ModuleState::Uncalibrated);
}

#[test]
fn commands_other_than_ground_commands_are_accepted_while_armed() {
    let mut bench = TestBed::new();
    bench.compass.process_event(Event::ArmedStateReported(Some(true)));
    for procedure in [Procedure::Level, Procedure::Tumble, Procedure::Turns] {
        assert_eq!(bench.expect_done(Command::CalStart(procedure)), ModuleState::Collecting);
        assert_eq!(bench.expect_done(Command::CalStartNew(None)), ModuleState::Collecting);
        assert_eq!(bench.expect_done(Command::CalStop), ModuleState::Uncalibrated);
    }
    assert_eq!(bench.expect_done(Command::CalAbort), ModuleState::Uncalibrated);
    for setting in [
        SettingChange::StreamOn(false),
        SettingChange::StreamRateHz(5),
        SettingChange::StreamHeading(HeadingKind::Raw),
        SettingChange::Declination(Some(3.0)),
        SettingChange::Inclination(None),
        SettingChange::AttitudeError(AttitudeError::DEFAULT),
    ] {
        assert!(bench.save_by_command(Command::Set(setting)).is_ok(), "{setting:?}");
    }
    bench.calibrate(&few_turns(&airframe(), 1)).unwrap();
    assert!(matches!(bench.request_reply(Command::CalAdvise), Ok(Reply::Advice(_))));
    bench.collect_at_rest(test_field(), 8);
    assert!(bench.save_by_command(Command::AlignConfirmed(100.0)).is_ok());
    assert!(bench.save_by_command(Command::Align(None)).is_ok());
}

#[test]
fn commands_that_change_state_are_refused_during_a_save() {
    let mut bench = TestBed::new();
    bench.expect_done(Command::CalStart(Procedure::Turns));
    bench.fly_turns(&complete_turns(&airframe(), 1));
    assert!(matches!(bench.run_solve(), Effect::Save));
    for command in [
        Command::CalAbort,
        Command::Restart,
        Command::CalClear,
        Command::CalStart(Procedure::Turns),
        Command::Set(SettingChange::StreamOn(false)),
        Command::Align(None),
    ] {
        assert_eq!(bench.expect_refusal(command), Refusal::Busy, "{command:?}");
    }
    assert_eq!(bench.status_report().module_state, ModuleState::Verifying);
    assert!(matches!(bench.compass.process_event(Event::Saved(Ok(()))), Effect::Notify(Message::Solved(Ok(_)))));
    assert_eq!(bench.expect_done(Command::CalAbort), ModuleState::Calibrated);
}

#[test]
fn an_abort_ends_a_solve_and_discards_the_samples() {
    let mut bench = TestBed::new();
    bench.expect_done(Command::CalStart(Procedure::Turns));
    bench.fly_turns(&complete_turns(&airframe(), 1));
    assert_eq!(bench.expect_done(Command::CalAbort), ModuleState::Uncalibrated);
    assert!(!bench.compass.needs_solve_step());
    assert_eq!(bench.expect_refusal(Command::CalSolve(None)), Refusal::NoSamples);
    bench.expect_done(Command::CalStart(Procedure::Level));
    assert_eq!(bench.expect_done(Command::CalAbort), ModuleState::Uncalibrated);
    assert_eq!(bench.expect_refusal(Command::CalStop), Refusal::NotCollecting);
}

/// With a wrong mounting the indicator is idle before the solve, and shows the refusal after it until there is a
/// calibration.
#[test]
fn the_indicator_shows_a_refused_solve() {
    let mut bench = TestBed::new();
    bench.save_by_command(Command::Set(SettingChange::Mount(Orientation::from_name("yaw90").unwrap()))).unwrap();
    assert_eq!(bench.compass.indicator_state(), IndicatorState::Idle);
    assert_eq!(bench.calibrate(&complete_turns(&airframe(), 1)).unwrap_err().stable_code(), "mount-contradicted");
    assert_eq!(bench.compass.indicator_state(), IndicatorState::Refused);
    bench.save_by_command(Command::Set(SettingChange::Mount(Orientation::IDENTITY_ROTATION))).unwrap();
    bench.calibrate(&complete_turns(&airframe(), 1)).unwrap();
    assert_eq!(bench.compass.indicator_state(), IndicatorState::Calibrated);
}

#[test]
fn a_stopped_collection_keeps_its_samples() {
    let mut bench = TestBed::new();
    bench.expect_done(Command::CalStart(Procedure::Turns));
    bench.fly_turns(&few_turns(&airframe(), 1));
    let collected = bench.status_report().collection_progress;
    let [left, right] = [CollectionPart::LEFT, CollectionPart::RIGHT].map(|part| collected.coverage_of(part).fit_count);
    assert!(left >= 30 && right >= 30, "{collected:?}");
    assert_eq!(bench.expect_done(Command::CalStop), ModuleState::Uncalibrated);
    assert_eq!(bench.expect_refusal(Command::CalStop), Refusal::NotCollecting);
    bench.fly_turns(&few_turns(&airframe(), 2));
    assert_eq!(bench.status_report().collection_progress, collected, "nothing is collected any more");
    assert_eq!(bench.expect_done(Command::CalSolve(None)), ModuleState::Solving);
    let end = bench.run_solve();
    assert!(bench.outcome_after_save(end).is_ok());
}

#[test]
fn a_new_collection_starts_without_samples() {
    for stopped in [false, true] {
        let mut bench = TestBed::new();
        bench.expect_done(Command::CalStart(Procedure::Turns));
        bench.fly_turns(&few_turns(&airframe(), 1));
        if stopped {
            bench.expect_done(Command::CalStop);
            bench.expect_done(Command::CalStart(Procedure::Turns));
        } else {
            let refused = bench.expect_refusal(Command::CalStart(Procedure::Turns));
            assert_eq!(refused.stable_code(), "collecting");
            assert!(bench.status_report().collection_progress.coverage_of(CollectionPart::LEFT).fit_count > 0);
            bench.expect_done(Command::CalStartNew(None));
        }
        assert_eq!(bench.expect_refusal(Command::CalSolve(None)), Refusal::NoSamples);
    }
}

#[test]
fn without_a_sensor_calibration_is_refused() {
    let mut compass = Compass::new(AcceptancePolicy::DEFAULT, &StoredValues::default(), leaked_retained_samples());
    for command in [Command::CalStart(Procedure::Turns), Command::CalSolve(None)] {
        let effect = compass.process_event(Event::Command(command, WrappingMillis::default()));
        assert!(matches!(effect, Effect::Reply(Err(Refusal::NoSensor))), "{effect:?}");
    }
}

#[test]
fn a_failed_solve_is_refused_with_the_solver_s_reason() {
    let mut bench = TestBed::new();
    assert_eq!(bench.expect_refusal(Command::CalSolve(None)), Refusal::NoSamples);
    bench.expect_done(Command::CalStart(Procedure::Turns));
    let RecordedTurns { left, .. } = few_turns(&airframe(), 1);
    bench.fly_turns(&RecordedTurns { left, right: Vec::new() });
    // A known cause replaces the solver's error.
    let one_side = bench.expect_refusal(Command::CalSolve(None));
    let lack = CollectionProblem::OneSideOnly(Side::Left);
    assert_eq!(
        one_side,
        Refusal::InsufficientSamples { code: "too-few-samples", expected_rms_deg: None, cause: lack.into() }
    );
    // A given method is always tried.
    bench.expect_done(Command::CalSolve(Some(Method::Ellipsoid)));
    let end = bench.run_solve();
    let refused = bench.outcome_after_save(end).unwrap_err();
    assert_eq!(
        refused,
        Refusal::InsufficientSamples { code: "not-determined", expected_rms_deg: None, cause: lack.into() }
    );
    assert_eq!(bench.status_report().last_collection_outcome, Some(Message::Solved(Err(refused))));
    assert_eq!(bench.compass.module_state(), ModuleState::Uncalibrated);
}

#[test]
fn a_rejected_calibration_is_not_used() {
    let strict = AcceptancePolicy { max_expected_rms_deg: 0.01, ..AcceptancePolicy::DEFAULT };
    let strict_policy = AcceptancePolicy { min_held_back_samples: 1000, ..AcceptancePolicy::DEFAULT };
    for (policy, code) in [(strict, "not-accurate"), (strict_policy, "too-few-held-back")] {
        let mut bench = TestBed::with_state(policy, StoredCalibrations::default());
        let refused = bench.calibrate(&complete_turns(&airframe(), 1)).unwrap_err();
        assert_eq!(refused.stable_code(), code);
        assert!(matches!(refused, Refusal::Rejected(_)));
        assert_eq!(bench.compass.module_state(), ModuleState::Uncalibrated);
        assert!(bench.compass.pending_change().is_none());
    }
}

#[test]
fn a_second_calibration_is_judged_against_the_first() {
    let mut bench = TestBed::new();
    bench.calibrate(&complete_turns(&airframe(), 1)).unwrap();
    let first = *bench.compass.active_record().unwrap();
    let short_flight =
        Flight { samples_per_side: 40, attitude_noise_deg: 1.5, ..Flight::TYPICAL }.fly(&airframe(), &mut Random(5));
    let refused = bench.calibrate(&short_flight).unwrap_err();
    let rejected = matches!(
        refused,
        Refusal::Rejected(
            Rejection::LessInformative { .. } | Rejection::NotBetter { .. } | Rejection::TooFewHeldBack { .. }
        )
    );
    assert!(rejected, "{refused:?}");
    assert_eq!(bench.compass.active_record(), Some(&first));
    assert_eq!(bench.compass.module_state(), ModuleState::Calibrated);
    let changed_airframe = Airframe { b_ut: airframe().b_ut * 0.2, ..airframe() };
    bench.calibrate(&complete_turns(&changed_airframe, 2)).unwrap();
    let second = *bench.compass.active_record().unwrap();
    assert_eq!(second.serial_number, 2);
    assert!(bench.status_report().can_undo);
    assert!(matches!(bench.save_by_command(Command::CalUndo), Ok(Reply::Done(ModuleState::Calibrated))));
    assert_eq!(bench.compass.active_record(), Some(&first));
    bench.save_by_command(Command::CalUndo).unwrap();
    assert_eq!(bench.compass.active_record(), Some(&second));
}

/// `tan(54 deg) = 1.38`, for either sign of inclination.
#[test]
fn heading_error_per_attitude_error_is_the_tangent_of_inclination() {
    let CalibrationRecord { quality, calibration, .. } = calibration_record(1);
    for (inclination_deg, cost) in [(54.0_f32, 1.376_382), (-54.0, 1.376_382), (0.0, 0.0), (70.0, 2.747_477)] {
        let calibration = Calibration { inclination_rad: inclination_deg.to_radians(), ..calibration };
        let found = ExpectedAccuracy::new(quality, &calibration).heading_deg_per_attitude_deg.unwrap();
        assert!((found - cost).abs() < 1e-4, "{inclination_deg}: {found}");
    }
}

#[test]
fn serial_numbers_wrap() {
    let last = CalibrationRecord { serial_number: u32::MAX, ..calibration_record(1) };
    let mut bench = TestBed::with_state(
        AcceptancePolicy::DEFAULT,
        StoredCalibrations { current_calibration: Some(last), previous_calibration: None },
    );
    bench.calibrate(&complete_turns(&airframe(), 1)).unwrap();
    assert_eq!(bench.compass.active_record().unwrap().serial_number, 0);
}

#[test]
fn a_record_is_used_only_with_its_sensor_and_mounting() {
    let current = Some(calibration_record(4));
    let stored_calibrations = StoredCalibrations { current_calibration: current, previous_calibration: None };
    let mut bench = TestBed::with_state(AcceptancePolicy::DEFAULT, stored_calibrations);
    assert_eq!(bench.compass.module_state(), ModuleState::Calibrated);
    // An equal chip at another address is another sensor.
    for other in [Identity { address: 0x1C, ..SENSOR }, Identity { model: MagnetometerModel::Lsm303dlhc, ..SENSOR }] {
        bench.compass.process_event(Event::SensorDetected(other, READINGS_PER_SAMPLE));
        assert_eq!(bench.compass.module_state(), ModuleState::Uncalibrated, "{other:?}");
        assert!(bench.compass.instrument_correction().calibration.is_none());
        assert_eq!(bench.expect_refusal(Command::Align(Some(10.0))), Refusal::NoCalibration);
    }
    bench.compass.process_event(Event::SensorDetected(SENSOR, READINGS_PER_SAMPLE));
    assert_eq!(bench.compass.module_state(), ModuleState::Calibrated);
    let turned = Orientation::from_name("yaw90").unwrap();
    bench.save_by_command(Command::Set(SettingChange::Mount(turned))).unwrap();
    assert_eq!(bench.compass.module_state(), ModuleState::Uncalibrated);
    bench.save_by_command(Command::Set(SettingChange::Mount(Orientation::IDENTITY_ROTATION))).unwrap();
    assert_eq!(bench.compass.module_state(), ModuleState::Calibrated);
    let unknown = Compass::new(
        AcceptancePolicy::DEFAULT,
        &StoredValues { stored_calibrations, ..StoredValues::default() },
        leaked_retained_samples(),
    );
    assert!(unknown.active_record().is_none());
}

#[test]
fn a_solve_uses_configured_mounting_and_inclination() {
    let mount = Orientation::from_name("roll180-yaw90").unwrap();
    let mut bench = TestBed::new();
    bench.save_by_command(Command::Set(SettingChange::Mount(mount))).unwrap();
    bench.calibrate(&complete_turns(&airframe(), 1).in_mount(mount)).unwrap();
    assert_eq!(bench.compass.active_record().unwrap().mount, mount);
    // An inclination prior 2 deg off shifts the estimate; 5 deg off is rejected.
    let found_deg = |given: Option<f32>| {
        let mut bench = TestBed::new();
        bench.save_by_command(Command::Set(SettingChange::Inclination(given))).unwrap();
        bench.calibrate(&few_turns(&airframe(), 1)).unwrap();
        bench.compass.active_record().unwrap().calibration.inclination_rad.to_degrees()
    };
    let (free, given) = (found_deg(None), found_deg(Some(57.0)));
    assert!(given > free + 0.008, "{given} {free}");
    let expected_deg = |bias_deg, bank_percent| {
        let mut bench = TestBed::new();
        let error = AttitudeError { bias_deg, bank_percent };
        bench.save_by_command(Command::Set(SettingChange::AttitudeError(error))).unwrap();
        let quality = bench.calibrate(&few_turns(&airframe(), 1)).unwrap().quality;
        let Ok(Reply::Advice(advice)) = bench.request_reply(Command::CalAdvise) else { panic!("none") };
        assert!((advice.expected_deg - quality.expected_rms_deg).abs() < 1e-4, "{advice:?}");
        quality.expected_rms_deg
    };
    let nothing = expected_deg(0.0, 0.0);
    let as_delivered = TestBed::new().calibrate(&few_turns(&airframe(), 1)).unwrap().quality.expected_rms_deg;
    assert!(nothing < as_delivered && (as_delivered - expected_deg(0.2, 1.0)).abs() < 1e-6, "{nothing} {as_delivered}");
    for larger_error_deg in [expected_deg(1.0, 0.0), expected_deg(0.0, 5.0)] {
        assert!(larger_error_deg > 1.2 * nothing, "{larger_error_deg} {nothing}");
    }
    let mut bench = TestBed::new();
    bench.save_by_command(Command::Set(SettingChange::Inclination(Some(60.0)))).unwrap();
    let contradicted = Refusal::Solve(SolveError::InclinationContradicted { found_deg: 55 });
    assert_eq!(bench.calibrate(&few_turns(&airframe(), 1)).unwrap_err(), contradicted);
}

#[test]
fn each_mark_uses_its_own_second_of_samples() {
    let mut bench = TestBed::new();
    assert_eq!(bench.expect_refusal(Command::CalMark(10.0)), Refusal::NotSwinging);
    bench.expect_done(Command::CalStart(Procedure::Turns));
    assert_eq!(bench.expect_refusal(Command::CalMark(10.0)), Refusal::NotSwinging);
    bench.collect_at_rest(test_field(), 8);
    bench.expect_done(Command::CalStop);
    bench.expect_done(Command::CalStart(Procedure::Swing));
    assert_eq!(bench.expect_refusal(Command::CalMark(10.0)), Refusal::NotStationary);
    bench.collect_at_rest(test_field(), 8);
    for outside in [-0.1, 360.1, f32::NAN] {
        assert_eq!(bench.expect_refusal(Command::CalMark(outside)).stable_code(), "out-of-range");
    }
    assert!(matches!(bench.request_reply(Command::CalMark(360.0)), Ok(Reply::MarkCount(1))));
    assert_eq!(bench.expect_refusal(Command::CalMark(0.0)), Refusal::NotStationary);
    bench.collect_at_rest(test_field(), 7);
    assert_eq!(bench.expect_refusal(Command::CalMark(0.0)), Refusal::NotStationary);
    bench.collect_at_rest(test_field(), 1);
    assert!(matches!(bench.request_reply(Command::CalMark(0.0)), Ok(Reply::MarkCount(2))));
    // Samples older than 1 s are ignored.
    bench.collect_at_rest(test_field(), 8);
    bench.now_ms = bench.now_ms.wrapping_add(3000);
    assert_eq!(bench.expect_refusal(Command::CalMark(0.0)), Refusal::NotStationary);
}

#[test]
fn there_is_room_for_36_marks() {
    let mut bench = TestBed::new();
    bench.expect_done(Command::CalStart(Procedure::Swing));
    for number in 1..=36 {
        bench.collect_at_rest(test_field(), 8);
        assert!(matches!(bench.request_reply(Command::CalMark(10.0)), Ok(Reply::MarkCount(n)) if n == number));
    }
    bench.collect_at_rest(test_field(), 8);
    assert_eq!(bench.expect_refusal(Command::CalMark(10.0)), Refusal::TooManyMarks);
}

#[test]
fn alignment_removes_a_constant_heading_error() {
    let stored_calibrations =
        StoredCalibrations { current_calibration: Some(calibration_record(1)), previous_calibration: None };
    let mut bench = TestBed::with_state(AcceptancePolicy::DEFAULT, stored_calibrations);
    assert_eq!(bench.expect_refusal(Command::Align(Some(100.0))), Refusal::NotStationary);
    assert_eq!(bench.expect_refusal(Command::Align(Some(360.5))).stable_code(), "out-of-range");
    let calibration = calibration_record(1).calibration;
    for (shown_deg, given_heading_deg, align_deg) in [(90.0, 100.0, 10.0), (5.0, 350.0, -15.0), (350.0, 5.0, 15.0)] {
        let earth = Field::earth_field(48.0, 1.0, f32::to_radians(shown_deg));
        bench.collect_at_rest(Field::new(earth.ut + calibration.b_vector_ut()), 8);
        bench.save_by_command(Command::Align(Some(given_heading_deg))).unwrap();
        let found_deg = bench.compass.stored_settings().align_deg;
        assert!((found_deg - align_deg).abs() < 0.01, "{shown_deg} at {given_heading_deg}: {found_deg}");
        assert!((bench.compass.instrument_correction().align_deg - align_deg).abs() < 0.01);
    }
    bench.save_by_command(Command::Align(None)).unwrap();
    assert!(bench.compass.stored_settings().align_deg.abs() < f32::EPSILON);
}

#[test]
fn a_large_alignment_must_be_confirmed() {
    let calibration = calibration_record(1).calibration;
    let mut bench = TestBed::with_state(
        AcceptancePolicy::DEFAULT,
        StoredCalibrations { current_calibration: Some(calibration_record(1)), previous_calibration: None },
    );
    let earth = Field::earth_field(48.0, 1.0, f32::to_radians(90.0));
    let stand = |bench: &mut TestBed| bench.collect_at_rest(Field::new(earth.ut + calibration.b_vector_ut()), 8);
    for (given_heading_deg, align_deg) in [(109.9, 19.9), (70.1, -19.9)] {
        stand(&mut bench);
        bench.save_by_command(Command::Align(Some(given_heading_deg))).unwrap();
        assert!((bench.compass.stored_settings().align_deg - align_deg).abs() < 0.01);
    }
    for (given_heading_deg, align_deg, words) in [
        (110.5, 20.5, "every heading would be turned by 20.5 deg, "),
        (69.5, -20.5, "every heading would be turned by -20.5 deg, "),
        (271.0, -179.0, "every heading would be turned by -179.0 deg, "),
    ] {
        let before_deg = bench.compass.stored_settings().align_deg;
        stand(&mut bench);
        let refused = bench.expect_refusal(Command::Align(Some(given_heading_deg)));
        assert!(bench.compass.stored_settings().align_deg.to_bits() == before_deg.to_bits(), "nothing has changed");
        let repeat = format!("; if that is right: set align {given_heading_deg} yes");
        let refusal_text = refused.to_string();
        assert!(
            refused.stable_code() == "needs-word" && refusal_text.starts_with(words) && refusal_text.ends_with(&repeat),
            "{refusal_text}"
        );
        bench.save_by_command(Command::AlignConfirmed(given_heading_deg)).unwrap();
        assert!((bench.compass.stored_settings().align_deg - align_deg).abs() < 0.01);
    }
    assert_eq!(bench.expect_refusal(Command::AlignConfirmed(360.5)).stable_code(), "out-of-range");
    bench.now_ms = bench.now_ms.wrapping_add(60_000);
    assert_eq!(bench.expect_refusal(Command::AlignConfirmed(100.0)), Refusal::NotStationary);
}

#[test]
fn a_refusal_reports_the_problem_of_the_flight() {
    let mut bench = TestBed::new();
    bench.expect_done(Command::CalStart(Procedure::Turns));
    assert_eq!(bench.expect_refusal(Command::CalSolve(None)), Refusal::NoSamples);
    bench.now_ms = bench.now_ms.wrapping_add(STEP_MS);
    let hold = |bench: &mut TestBed, roll_deg: f32, samples: usize| {
        for _ in 0..samples {
            bench.process_sample(test_field(), Attitude::from_deg(roll_deg, 0.0));
        }
    };
    hold(&mut bench, 6.0, 60);
    let refused = bench.expect_refusal(Command::CalSolve(None));
    assert_eq!(refused.stable_code(), "no-samples");
    assert_eq!(refused.to_string(), "too little bank, 6.0 deg at most; fly turns at 15 deg of bank or more each way");
    hold(&mut bench, -25.0, 60);
    let refused = bench.expect_refusal(Command::CalSolve(None));
    assert_eq!(refused.stable_code(), "too-few-samples");
    assert_eq!(refused.to_string(), "only left turns were flown; fly right turns, too");
    bench.expect_done(Command::CalStartNew(None));
    assert_eq!(bench.expect_refusal(Command::CalSolve(None)), Refusal::NoSamples);
}

#[test]
fn collection_problems_explain_only_refusals_for_missing_samples() {
    let lack = Some(CollectionProblem::OneSideOnly(Side::Left));
    let too_few = SolveError::TooFewSamples { part: SamplePart::Turns(Side::Right), have: 3, need: 12 };
    for (refusal, code, words) in [
        (Refusal::NoSamples, "no-samples", "only left turns"),
        (Refusal::Solve(too_few), "too-few-samples", "only left turns"),
        (Refusal::Solve(SolveError::SamePlane), "same-plane", "only left turns"),
        (Refusal::Solve(SolveError::NotAnEllipse(SamplePart::Turns(Side::Left))), "not-an-ellipse", "only left turns"),
        (Refusal::Solve(SolveError::NotDetermined(SamplePart::All)), "not-determined", "only left turns"),
        (Refusal::Rejected(Rejection::TooFewHeldBack { have: 3, need: 8 }), "too-few-held-back", "only left turns"),
        (
            Refusal::Rejected(Rejection::NotAccurate { expected_rms_deg: 4.26 }),
            "not-accurate",
            "expected error 4.3 deg; only left turns",
        ),
    ] {
        assert_eq!(refusal.clone().with_cause(None::<CollectionProblem>), refusal);
        let explained = refusal.with_cause(lack);
        assert!(
            explained.stable_code() == code && explained.to_string().starts_with(words),
            "{explained:?}: {explained}"
        );
    }
    // Mounting or turn direction estimated from an arc are not reported.
    let found = Orientation::from_name("yaw90").unwrap();
    for error in [SolveError::NotConverged, SolveError::TurnsReversed, SolveError::MountContradicted { found }] {
        let arc = CollectionProblem::ArcOnly { side: Side::Left, sectors: 2 };
        let code = Refusal::Solve(error).stable_code();
        let explained = Refusal::Solve(error).with_cause(Some(arc));
        assert_eq!(explained, Refusal::InsufficientSamples { code, expected_rms_deg: None, cause: arc.into() });
        assert_eq!(Refusal::Solve(error).with_cause(lack), Refusal::Solve(error));
    }
    let marks = SolveError::TooFewSamples { part: SamplePart::Marks, have: 3, need: 4 };
    for other in [
        Refusal::Armed,
        Refusal::NoSensor,
        Refusal::Solve(marks),
        Refusal::Solve(SolveError::TurnsReversed),
        Refusal::Rejected(Rejection::NotBetter { candidate_score: 1.0, incumbent_score: 0.5 }),
        Refusal::Store(StoreError::Full),
    ] {
        assert_eq!(other.clone().with_cause(lack), other);
    }
}

#[test]
fn clear_removes_all_calibrations_and_undo_needs_a_previous_one() {
    let mut bench = TestBed::with_state(
        AcceptancePolicy::DEFAULT,
        StoredCalibrations { current_calibration: Some(calibration_record(2)), previous_calibration: None },
    );
    assert_eq!(bench.expect_refusal(Command::CalUndo), Refusal::NoPreviousCalibration);
    bench.compass.stored_calibrations.previous_calibration = Some(calibration_record(1));
    assert!(matches!(bench.send_command(Command::CalClear), Effect::Save));
    assert!(matches!(bench.compass.pending_change(), Some(StoreChange::Clear)));
    assert!(bench.compass.active_record().is_some(), "until it is written");
    assert!(matches!(
        bench.compass.process_event(Event::Saved(Ok(()))),
        Effect::Reply(Ok(Reply::Done(ModuleState::Uncalibrated)))
    ));
    assert!(bench.compass.active_record().is_none());
    assert_eq!(bench.expect_refusal(Command::CalUndo), Refusal::NoPreviousCalibration);
}

#[test]
fn a_change_that_cannot_be_stored_has_no_effect() {
    let failed = || Event::Saved(Err(StoreError::ReadBackDiffers));
    let stored_calibrations = StoredCalibrations {
        current_calibration: Some(calibration_record(2)),
        previous_calibration: Some(calibration_record(1)),
    };
    let mut bench = TestBed::with_state(AcceptancePolicy::DEFAULT, stored_calibrations);
    for command in
        [Command::CalUndo, Command::CalClear, Command::Set(SettingChange::StreamOn(false)), Command::Align(None)]
    {
        assert!(matches!(bench.send_command(command), Effect::Save));
        let effect = bench.compass.process_event(failed());
        assert!(
            matches!(effect, Effect::Reply(Err(Refusal::Store(StoreError::ReadBackDiffers)))),
            "{command:?}: {effect:?}"
        );
        assert_eq!(bench.compass.stored_calibrations, stored_calibrations);
        assert_eq!(*bench.compass.stored_settings(), Settings::DEFAULT);
        assert!(bench.compass.pending_change().is_none());
    }
    let mut bench = TestBed::new();
    bench.expect_done(Command::CalStart(Procedure::Turns));
    bench.fly_turns(&complete_turns(&airframe(), 1));
    assert!(matches!(bench.run_solve(), Effect::Save));
    assert!(matches!(
        bench.compass.process_event(failed()),
        Effect::Notify(Message::Solved(Err(Refusal::Store(StoreError::ReadBackDiffers))))
    ));
    assert_eq!(bench.compass.module_state(), ModuleState::Uncalibrated);
    assert_eq!(
        bench.status_report().last_collection_outcome,
        Some(Message::Solved(Err(Refusal::Store(StoreError::ReadBackDiffers))))
    );
}

#[test]
fn unexpected_events_are_ignored() {
    let mut bench = TestBed::new();
    assert!(matches!(bench.compass.process_event(Event::AdvanceSolve), Effect::None));
    assert!(matches!(bench.compass.process_event(Event::Saved(Ok(()))), Effect::None));
    bench.expect_done(Command::CalStart(Procedure::Turns));
    assert!(matches!(bench.compass.process_event(Event::AdvanceSolve), Effect::None));
    assert_eq!(bench.compass.module_state(), ModuleState::Collecting);
}

#[test]
fn settings_out_of_range_are_refused_and_not_written() {
    let mut bench = TestBed::new();
    let refused = bench.expect_refusal(Command::Set(SettingChange::StreamRateHz(81)));
    assert_eq!(refused, Refusal::OutOfRange(OutOfRange("a rate is 1 to 80 sentences a second")));
    assert!(bench.compass.pending_change().is_none());
    assert!(matches!(bench.send_command(Command::Set(SettingChange::StreamRateHz(80))), Effect::Save));
    assert!(matches!(bench.compass.pending_change(), Some(StoreChange::Settings(Settings { stream_rate_hz: 80, .. }))));
}

#[test]
fn a_tumbling_needs_no_attitude() {
    let mut bench = TestBed::new();
    bench.expect_done(Command::CalStart(Procedure::Tumble));
    assert_eq!(bench.compass.instrument_correction().sample_attitude, SampleAttitude::Unknown);
    bench.tumble();
    bench.expect_done(Command::CalSolve(None));
    assert_eq!(bench.compass.instrument_correction().sample_attitude, SampleAttitude::Interpolated);
    let end = bench.run_solve();
    let verdict = bench.outcome_after_save(end).unwrap();
    assert_eq!((verdict.quality.method, verdict.heading_deg_per_attitude_deg), (Method::Ellipsoid, None));
    assert!(!bench.compass.instrument_correction().has_valid_inclination);
    bench.expect_done(Command::CalStart(Procedure::Level));
    assert_eq!(bench.compass.instrument_correction().sample_attitude, SampleAttitude::Interpolated);
}

/// Turned about the body's x axis, the calibrated field keeps its strength and loses its inclination.
#[test]
fn a_calibration_with_a_wrong_vertical_is_replaced() {
    let mut bench = TestBed::new();
    bench.calibrate(&complete_turns(&airframe(), 1)).unwrap();
    let mut record = *bench.compass.active_record().unwrap();
    let (sin, cos) = 20.0_f32.to_radians().sin_cos();
    let [x, y, z] = record.calibration.w;
    let combined = |a: f32, b: f32| core::array::from_fn(|i| a * y[i] + b * z[i]);
    record.calibration.w = [x, combined(cos, -sin), combined(sin, cos)];
    let stored = StoredCalibrations { current_calibration: Some(record), previous_calibration: None };
    let mut bench = TestBed::with_state(AcceptancePolicy::DEFAULT, stored);
    bench.calibrate(&complete_turns(&airframe(), 2)).unwrap();
}

#[test]
fn advice_requires_a_solve() {
    let mut bench = TestBed::new();
    assert_eq!(bench.expect_refusal(Command::CalAdvise), Refusal::NotSolved);
    bench.calibrate(&few_turns(&airframe(), 1)).unwrap();
    let Ok(Reply::Advice(advice)) = bench.request_reply(Command::CalAdvise) else { panic!("none") };
    assert!(advice.expected_deg > 0.0);
}

#[test]
fn states_have_names() {
    let states = [
        ModuleState::Uncalibrated,
        ModuleState::Collecting,
        ModuleState::Solving,
        ModuleState::Verifying,
        ModuleState::Calibrated,
    ];
    let names = ["uncalibrated", "collecting", "solving", "verifying", "calibrated"];
    assert_eq!(states.map(ModuleState::state_name), names);
}
