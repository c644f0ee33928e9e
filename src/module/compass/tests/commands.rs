//! Commands that are refused while armed, during a solve or a save.

use super::*;

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
