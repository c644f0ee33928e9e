mod auto;
mod commands;
mod earth;
mod flight;
mod marks;
mod restart;

use super::state::SAMPLES_DURING_SOLVE_CAPACITY;
use super::*;
use crate::messages::{Message, SolveOutcome};
use crate::settings::{HeadingKind, OutOfRange, PORT_COUNT, ProtocolKind, SettingChange, Settings};
use crate::store::tests::calibration_record;
use crate::store::{CalibrationRecord, StartupValues, StoreChange, StoreError, StoredCalibrations};
use crate::synthetic::{Airframe, Flight, Random, RecordedTurns, in_mount, multirotor_samples};
use autoswing::calibration::{Calibration, CollectionPart, Method, Orientation, SolveError};
use autoswing::frames::{Field, RollPitch, Sensor};
use autoswing::instrument::{Correction, SampleAttitude, SensorErrorSigmas};
use autoswing::reading::{Identity, MagnetometerModel};

const SENSOR: Identity = Identity { model: MagnetometerModel::Lis3mdl, address: 0x1E };
const READINGS_PER_SAMPLE: u16 = 8;
const NO_PROTOCOLS: [ProtocolKind; PORT_COUNT] = [ProtocolKind::Auto; PORT_COUNT];

/// State machine with its sample clock, and the flash as its saves leave it.
struct TestBed<'a> {
    compass: Compass<'a>,
    now_ms: u32,
    flash: StoredValues,
    /// Saves of values for the next start, which no command requests.
    startup_save_count: u32,
}

impl TestBed<'static> {
    fn new() -> Self {
        Self::with_calibrations(&[])
    }

    /// A module with stored calibrations: the current, then the previous one.
    fn with_calibrations(newest_first: &[CalibrationRecord]) -> Self {
        let mut newest_first = newest_first.iter().copied();
        let stored_calibrations =
            StoredCalibrations { current_calibration: newest_first.next(), previous_calibration: newest_first.next() };
        let flash = StoredValues { stored_calibrations, ..StoredValues::default() };
        Self::start_module(&flash, Box::leak(Box::new(RetainedSamples::EMPTY)))
    }

    fn with_setting(setting: SettingChange) -> Self {
        let mut bed = Self::new();
        bed.set(setting);
        bed
    }

    /// Collects in flight until this accuracy.
    fn with_accuracy(accuracy_deg: f32) -> Self {
        let mut bed = Self::with_setting(setting_change("ACCURACY", accuracy_deg));
        bed.start(Procedure::Flight);
        bed
    }
}

impl<'a> TestBed<'a> {
    /// A module whose sample clock wraps after 20 s.
    fn start_module(flash: &StoredValues, memory: &'a mut RetainedSamples) -> Self {
        let compass = Compass::new(flash, memory);
        let mut bed = Self { compass, now_ms: u32::MAX - 20_000, flash: *flash, startup_save_count: 0 };
        bed.expect_none(Event::SensorDetected(SENSOR, READINGS_PER_SAMPLE));
        bed
    }

    fn time(&self) -> WrappingMillis {
        WrappingMillis::new(self.now_ms)
    }

    fn advance_clock(&mut self, ms: u32) {
        self.now_ms = self.now_ms.wrapping_add(ms);
    }

    fn state(&self) -> ModuleState {
        self.compass.module_state()
    }

    fn expect_none(&mut self, event: Event) {
        let effect = self.compass.process_event(event);
        assert!(matches!(effect, Effect::None), "{event:?}: {effect:?}");
    }

    fn report_armed(&mut self, armed_state: Option<bool>) {
        self.expect_none(Event::ArmedStateReported(armed_state));
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

    fn start(&mut self, procedure: Procedure) {
        assert_eq!(self.expect_done(Command::CalStart(procedure)), ModuleState::Collecting);
    }

    fn status_report(&mut self) -> StatusReport {
        match self.request_reply(Command::Status) {
            Ok(Reply::Report(report)) => report,
            other => panic!("{other:?}"),
        }
    }

    /// State, and number of fit samples in free flight.
    fn state_and_fit_count(&mut self) -> (ModuleState, u16) {
        (self.state(), self.status_report().collection_progress.coverage_of(CollectionPart::FREE).fit_count)
    }

    /// Writes the pending change to flash.
    fn save(&mut self) -> Effect {
        match self.compass.pending_change().expect("a change") {
            StoreChange::Settings(settings) => self.flash.settings = *settings,
            StoreChange::StartupValues(startup_values) => self.flash.startup_values = startup_values,
            calibrations => {
                let (current, previous) = match calibrations {
                    StoreChange::StoredCalibrations { current, previous } => (current.copied(), previous.copied()),
                    _ => (None, None),
                };
                self.flash.stored_calibrations =
                    StoredCalibrations { current_calibration: current, previous_calibration: previous };
                self.flash.startup_values.is_collecting = false;
            }
        }
        self.compass.process_event(Event::Saved(Ok(())))
    }

    /// Sends a command with a reply after a save.
    fn expect_saved(&mut self, command: Command) -> ModuleState {
        assert!(matches!(self.send_command(command), Effect::Save), "{command:?}");
        match self.save() {
            Effect::Reply(Ok(Reply::Done(state))) => state,
            other => panic!("{command:?}: {other:?}"),
        }
    }

    fn set(&mut self, setting: SettingChange) -> ModuleState {
        self.expect_saved(Command::Set(setting))
    }

    /// Idle time, with these protocols detected on the ports.
    fn process_idle_time(&mut self, detected: [ProtocolKind; PORT_COUNT]) {
        let now = self.time();
        if let Effect::Save = self.compass.process_event(Event::ProtocolsDetected(detected, now)) {
            assert!(matches!(self.compass.pending_change(), Some(StoreChange::StartupValues(_))));
            self.startup_save_count += 1;
            assert!(matches!(self.save(), Effect::None));
        }
    }

    /// Processes samples, 4 a second, and trial solves until the collection ends.
    fn collect_until_end(&mut self, samples: &[Sample]) -> Option<SolveOutcome> {
        for sample in samples {
            self.advance_clock(250);
            self.expect_none(Event::Sample(Sample { time: self.time(), ..*sample }));
            self.process_idle_time(NO_PROTOCOLS);
            while self.compass.needs_solve_step() {
                assert_eq!(self.state(), ModuleState::Collecting, "no user requested a solve");
                match self.compass.process_event(Event::AdvanceSolve) {
                    Effect::None => self.process_idle_time(NO_PROTOCOLS),
                    end => return Some(self.outcome_after_save(end)),
                }
            }
        }
        None
    }

    /// Processes samples that do not end the collection.
    fn collect(&mut self, samples: &[Sample]) {
        assert!(self.collect_until_end(samples).is_none());
    }

    /// Processes samples until a trial solve begins; returns their number.
    fn collect_until_trial(&mut self, samples: &[Sample]) -> usize {
        for (sample, count) in samples.iter().zip(1..) {
            self.advance_clock(250);
            self.expect_none(Event::Sample(Sample { time: self.time(), ..*sample }));
            if self.compass.needs_solve_step() {
                return count;
            }
        }
        panic!("no trial solve after {} samples", samples.len());
    }

    fn collect_at_rest(&mut self, field: Field<Sensor>, samples: u32) {
        for _ in 0..samples {
            self.expect_none(Event::Sample(Sample { time: self.time(), ..Sample::new(field, RollPitch::default()) }));
            self.advance_clock(100);
        }
    }

    /// Processes a sample, 2 a second: samples are distinct, and turns have no gap.
    fn process_sample(&mut self, field: Field<Sensor>, attitude: RollPitch) {
        self.expect_none(Event::Sample(Sample { time: self.time(), ..Sample::new(field, attitude) }));
        self.advance_clock(500);
    }

    /// Flies left then right turns until a solve starts.
    fn fly_turns(&mut self, recorded: &RecordedTurns) {
        for sample in recorded.left.iter().chain(&recorded.right) {
            if !self.compass.needs_solve_step() {
                self.process_sample(sample.field, sample.attitude);
            }
        }
    }

    fn tumble(&mut self) {
        let airframe = Airframe::random(&mut Random(3), 0.1, 1.0, 0.0, [55.0, 55.0]);
        let mut random = Random(4);
        for _ in 0..240 {
            let attitude =
                RollPitch { roll_rad: random.uniform(-3.1, 3.1), pitch_rad: random.uniform(-1.0, 1.0).asin() };
            let field = airframe.field(attitude, random.uniform(0.0, core::f32::consts::TAU));
            self.process_sample(field, RollPitch::default());
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

    fn run_trial_solve(&mut self) {
        while self.compass.needs_solve_step() {
            self.expect_none(Event::AdvanceSolve);
        }
    }

    fn outcome_after_save(&mut self, end: Effect) -> SolveOutcome {
        match if let Effect::Save = end { self.save() } else { end } {
            Effect::Notify(Message::Solved(outcome)) => outcome,
            other => panic!("{other:?}"),
        }
    }

    /// Runs a solve in progress to its end.
    fn finish_solve(&mut self) -> SolveOutcome {
        let end = self.run_solve();
        self.outcome_after_save(end)
    }

    fn solve(&mut self) -> SolveOutcome {
        assert_eq!(self.expect_done(Command::CalSolve(None)), ModuleState::Solving);
        self.finish_solve()
    }

    fn calibrate(&mut self, recorded: &RecordedTurns) -> SolveOutcome {
        self.start(Procedure::Turns);
        self.fly_turns(recorded);
        if self.compass.needs_solve_step() { self.finish_solve() } else { self.solve() }
    }

    fn active_record(&self) -> CalibrationRecord {
        *self.compass.active_record().expect("an active calibration")
    }

    fn calibrated_inclination_deg(&self) -> f32 {
        self.active_record().calibration.inclination_rad.to_degrees()
    }
}

/// Change of the setting with this parameter name.
fn setting_change(parameter_name: &str, number: impl Into<Option<f32>>) -> SettingChange {
    SettingChange::named(parameter_name, number).unwrap()
}

fn mount_change(mount: Orientation) -> SettingChange {
    setting_change("MOUNT", f32::from(mount.number()))
}

fn airframe() -> Airframe {
    Airframe::random(&mut Random(11), 0.1, 1.0, 5.0, [55.0, 55.0])
}

/// A complete collection: two and a half circles each way.
fn complete_turns(seed: u64) -> RecordedTurns {
    Flight { samples_per_side: 190, ..Flight::TYPICAL }.fly(&airframe(), &mut Random(seed))
}

/// Enough for `cal solve`: one circle each way.
fn few_turns(seed: u64) -> RecordedTurns {
    Flight { samples_per_side: 60, ..Flight::TYPICAL }.fly(&airframe(), &mut Random(seed))
}

/// 100 s of a multirotor, 4 samples/s: 40 s of yaw turns, then tilts to all sides.
fn hover_samples(seed: u64) -> Vec<Sample> {
    multirotor_samples(&airframe(), 0.3, &mut Random(seed))
}

fn test_field() -> Field<Sensor> {
    airframe().field(RollPitch::default(), 0.7)
}

/// The mounting is output only for a known sensor.
#[test]
fn a_correction_contains_mounting_armed_state_and_expected_errors() {
    let memory = &mut RetainedSamples::EMPTY.clone();
    let mut compass = Compass::new(&StoredValues::default(), memory);
    assert_eq!(compass.instrument_correction(), Correction::UNCALIBRATED);
    compass.process_event(Event::ArmedStateReported(Some(false)));
    assert_eq!(compass.instrument_correction(), Correction { is_armed: Some(false), ..Correction::UNCALIBRATED });
    let mount = Orientation::from_name("yaw90").unwrap();
    let mut bed = TestBed::with_setting(mount_change(mount));
    assert_eq!(bed.compass.instrument_correction(), Correction { mount: Some(mount), ..Correction::UNCALIBRATED });
    bed.set(setting_change("GYRO_ERROR", 50.0 / 8.0));
    bed.set(setting_change("IRON_DRIFT", 0.5));
    assert_eq!(
        bed.compass.instrument_correction().sensor_errors,
        SensorErrorSigmas { gyro_scale: 0.0625, hard_iron_drift_per_minute: 0.005 }
    );
}

#[test]
fn without_a_sensor_calibration_is_refused() {
    let memory = &mut RetainedSamples::EMPTY.clone();
    let mut compass = Compass::new(&StoredValues::default(), memory);
    for command in [Command::CalStart(Procedure::Turns), Command::CalSolve(None)] {
        let effect = compass.process_event(Event::Command(command, WrappingMillis::default()));
        assert!(matches!(effect, Effect::Reply(Err(Refusal::NoSensor))), "{effect:?}");
    }
}

#[test]
fn serial_numbers_wrap() {
    let last = CalibrationRecord { serial_number: u32::MAX, ..calibration_record(1) };
    let mut bed = TestBed::with_calibrations(&[last]);
    bed.calibrate(&complete_turns(1)).unwrap();
    assert_eq!(bed.active_record().serial_number, 0);
}

#[test]
fn a_record_is_used_only_with_its_sensor_and_mounting() {
    let mut bed = TestBed::with_calibrations(&[calibration_record(4)]);
    assert_eq!(bed.state(), ModuleState::Calibrated);
    // An equal chip at another address is another sensor.
    for other in [Identity { address: 0x1C, ..SENSOR }, Identity { model: MagnetometerModel::Lsm303dlhc, ..SENSOR }] {
        bed.expect_none(Event::SensorDetected(other, READINGS_PER_SAMPLE));
        assert_eq!(bed.state(), ModuleState::Uncalibrated, "{other:?}");
        assert!(bed.compass.instrument_correction().calibration.is_none());
        assert_eq!(bed.expect_refusal(Command::Align(Some(10.0))), Refusal::NoCalibration);
    }
    bed.expect_none(Event::SensorDetected(SENSOR, READINGS_PER_SAMPLE));
    assert_eq!(bed.state(), ModuleState::Calibrated);
    let turned = Orientation::from_name("yaw90").unwrap();
    assert_eq!(bed.set(mount_change(turned)), ModuleState::Uncalibrated);
    assert_eq!(bed.set(setting_change("MOUNT", 0.0)), ModuleState::Calibrated);
    let memory = &mut RetainedSamples::EMPTY.clone();
    assert!(Compass::new(&bed.flash, memory).active_record().is_none(), "no sensor yet");
}

#[test]
fn a_solve_uses_the_configured_mounting_inclination_and_attitude_error() {
    let mount = Orientation::from_name("roll180-yaw90").unwrap();
    let mut bed = TestBed::with_setting(mount_change(mount));
    bed.calibrate(&complete_turns(1).map_samples(|sample| in_mount(sample, mount))).unwrap();
    assert_eq!(bed.active_record().mount, mount);
    // An inclination 2 deg off shifts the estimate; one 5 deg off is refused.
    let solve_with = |inclination_deg| {
        let mut bed = TestBed::with_setting(setting_change("INCLINATION", inclination_deg));
        bed.calibrate(&few_turns(1)).map(|_| bed.calibrated_inclination_deg())
    };
    let (free, given) = (solve_with(None).unwrap(), solve_with(Some(57.0)).unwrap());
    assert!(given > free + 0.008, "{given} {free}");
    let contradicted = SolveError::InclinationContradicted { found_deg: 55 };
    assert_eq!(solve_with(Some(60.0)), Err(Refusal::Solve(contradicted)));
    let expected_deg = |bias_deg, bank_percent| {
        let bias = setting_change("ATT_ERROR_DEG", bias_deg);
        let mut bed = TestBed::with_setting(bias);
        bed.set(setting_change("ATT_ERROR_BANK", bank_percent));
        let quality = bed.calibrate(&few_turns(1)).unwrap().quality;
        let Ok(Reply::Advice(advice)) = bed.request_reply(Command::CalAdvise) else { panic!("none") };
        assert!((advice.expected_deg - quality.expected_rms_deg).abs() < 1e-4, "{advice:?}");
        quality.expected_rms_deg
    };
    let without_error = expected_deg(0.0, 0.0);
    let as_delivered = TestBed::new().calibrate(&few_turns(1)).unwrap().quality.expected_rms_deg;
    assert!(without_error < as_delivered && (as_delivered - expected_deg(0.2, 1.0)).abs() < 1e-6);
    for larger_error_deg in [expected_deg(1.0, 0.0), expected_deg(0.0, 5.0)] {
        assert!(larger_error_deg > 1.2 * without_error, "{larger_error_deg} {without_error}");
    }
}

#[test]
fn a_change_that_cannot_be_stored_has_no_effect() {
    let failed = || Event::Saved(Err(StoreError::ReadBackDiffers));
    let refusal = Refusal::Store(StoreError::ReadBackDiffers);
    let mut bed = TestBed::with_calibrations(&[calibration_record(2), calibration_record(1)]);
    for command in
        [Command::CalUndo, Command::CalClear, Command::Set(setting_change("STREAM", 0.0)), Command::Align(None)]
    {
        assert!(matches!(bed.send_command(command), Effect::Save));
        let effect = bed.compass.process_event(failed());
        assert!(matches!(&effect, Effect::Reply(Err(found)) if *found == refusal), "{command:?}: {effect:?}");
        assert_eq!(bed.compass.storage.values().stored_calibrations, bed.flash.stored_calibrations);
        assert_eq!(*bed.compass.stored_settings(), Settings::DEFAULT);
        assert!(bed.compass.pending_change().is_none());
    }
    let mut bed = TestBed::new();
    bed.start(Procedure::Turns);
    bed.fly_turns(&complete_turns(1));
    assert!(matches!(bed.run_solve(), Effect::Save));
    let message = Message::Solved(Err(refusal));
    let effect = bed.compass.process_event(failed());
    assert!(matches!(&effect, Effect::Notify(found) if *found == message), "{effect:?}");
    assert_eq!(bed.state(), ModuleState::Uncalibrated);
    assert_eq!(bed.status_report().last_collection_outcome, Some(message));
}

#[test]
fn settings_out_of_range_are_refused_and_not_written() {
    let mut bed = TestBed::new();
    let refused = bed.expect_refusal(Command::Set(setting_change("STREAM_RATE", 81.0)));
    assert_eq!(refused, Refusal::OutOfRange(OutOfRange("stream-rate is 1 to 80 Hz")));
    assert!(bed.compass.pending_change().is_none());
    bed.set(setting_change("STREAM_RATE", 80.0));
    assert_eq!(bed.flash.settings, Settings { stream_rate_hz: 80, ..Settings::DEFAULT });
}

/// Turned about the body's x axis, the calibrated field keeps its strength and loses its inclination.
#[test]
fn a_calibration_with_a_wrong_vertical_is_replaced() {
    let mut bed = TestBed::new();
    bed.calibrate(&complete_turns(1)).unwrap();
    let mut record = bed.active_record();
    let (sin, cos) = 20.0_f32.to_radians().sin_cos();
    let [x, y, z] = record.calibration.w;
    let combined = |a: f32, b: f32| core::array::from_fn(|i| a * y[i] + b * z[i]);
    record.calibration.w = [x, combined(cos, -sin), combined(sin, cos)];
    TestBed::with_calibrations(&[record]).calibrate(&complete_turns(2)).unwrap();
}
