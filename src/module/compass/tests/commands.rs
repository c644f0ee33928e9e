//! Commands that are refused while armed, during a solve or a save.

use super::*;

/// Settings that no solve uses.
fn other_settings() -> [SettingChange; 4] {
    [
        setting_change("STREAM", 0.0),
        setting_change("STREAM_RATE", 5.0),
        setting_change("STREAM_HEADING", f32::from(HeadingKind::Raw as u8)),
        setting_change("DECLINATION", 3.0),
    ]
}

#[test]
fn settings_of_a_running_solve_cannot_change() {
    let mut bed = TestBed::new();
    bed.start(Procedure::Turns);
    bed.fly_turns(&complete_turns(1));
    assert_eq!(bed.state(), ModuleState::Solving);
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
        Command::Set(setting_change("MOUNT", 0.0)),
        Command::Set(setting_change("INCLINATION", 50.0)),
        Command::Set(setting_change("ATT_ERROR_DEG", 0.2)),
    ] {
        assert_eq!(bed.expect_refusal(command), Refusal::Busy, "{command:?}");
    }
    for setting in other_settings() {
        assert_eq!(bed.set(setting), ModuleState::Solving, "{setting:?}");
    }
    assert_eq!(bed.status_report().module_state, ModuleState::Solving);
    assert_eq!(bed.expect_done(Command::Restart), ModuleState::Solving, "a solve does not prevent a restart");
    assert_eq!(bed.expect_refusal(Command::CalAdvise), Refusal::NotSolved);
    assert!(bed.finish_solve().is_ok());
    let Settings { stream_on, stream_rate_hz, declination_deg, .. } = *bed.compass.stored_settings();
    assert_eq!((stream_on, stream_rate_hz, declination_deg), (false, 5, Some(3.0)));
}

#[test]
fn ground_commands_are_refused_while_armed() {
    let ground_commands = [
        Command::CalStart(Procedure::Swing),
        Command::CalStartNew(Some(Procedure::Swing)),
        Command::CalMark(10.0),
        Command::CalClear,
        Command::CalUndo,
        Command::Set(setting_change("MOUNT", 0.0)),
        Command::SetFromBus(setting_change("STREAM_RATE", 20.0)),
        Command::ResetSettings,
        Command::Restart,
    ];
    let mut bed = TestBed::with_calibrations(&[calibration_record(2), calibration_record(1)]);
    assert_eq!(bed.status_report().is_armed, None, "before anything is known");
    bed.report_armed(Some(true));
    for command in ground_commands {
        assert_eq!(bed.expect_refusal(command), Refusal::Armed, "{command:?}");
    }
    assert_eq!(bed.status_report().is_armed, Some(true));
    assert_eq!(bed.compass.storage.values().stored_calibrations, bed.flash.stored_calibrations);
    bed.report_armed(Some(false));
    assert_eq!(bed.expect_done(Command::Restart), ModuleState::Calibrated);
    bed.start(Procedure::Swing);
    bed.collect_at_rest(test_field(), 8);
    assert!(matches!(bed.request_reply(Command::CalMark(10.0)), Ok(Reply::MarkCount(1))));
    bed.collect_at_rest(test_field(), 8);
    bed.report_armed(Some(true));
    assert_eq!(bed.expect_refusal(Command::CalMark(10.0)), Refusal::Armed);
    assert_eq!(bed.expect_refusal(Command::CalStartNew(None)), Refusal::Armed, "it is a swing again");
    assert_eq!(bed.expect_done(Command::CalStop), ModuleState::Calibrated);
    bed.report_armed(Some(false));
    for command in [Command::CalUndo, Command::Set(setting_change("MOUNT", 0.0)), Command::CalClear] {
        bed.expect_saved(command);
    }
}

#[test]
fn commands_other_than_ground_commands_are_accepted_while_armed() {
    let mut bed = TestBed::new();
    bed.report_armed(Some(true));
    for procedure in [Procedure::Level, Procedure::Tumble, Procedure::Turns] {
        bed.start(procedure);
        assert_eq!(bed.expect_done(Command::CalStartNew(None)), ModuleState::Collecting);
        assert_eq!(bed.expect_done(Command::CalStop), ModuleState::Uncalibrated);
    }
    assert_eq!(bed.expect_done(Command::CalAbort), ModuleState::Uncalibrated);
    let used_by_solves = [setting_change("INCLINATION", None), setting_change("ATT_ERROR_DEG", 0.2)];
    for setting in other_settings().into_iter().chain(used_by_solves) {
        bed.set(setting);
    }
    bed.calibrate(&few_turns(1)).unwrap();
    assert!(matches!(bed.request_reply(Command::CalAdvise), Ok(Reply::Advice(_))));
    bed.collect_at_rest(test_field(), 8);
    bed.expect_saved(Command::AlignConfirmed(100.0));
    bed.expect_saved(Command::Align(None));
}

#[test]
fn commands_that_change_state_are_refused_during_a_save() {
    let mut bed = TestBed::new();
    bed.start(Procedure::Turns);
    bed.fly_turns(&complete_turns(1));
    assert!(matches!(bed.run_solve(), Effect::Save));
    for command in [
        Command::CalAbort,
        Command::Restart,
        Command::CalClear,
        Command::CalStart(Procedure::Turns),
        Command::Set(setting_change("STREAM", 0.0)),
        Command::Align(None),
    ] {
        assert_eq!(bed.expect_refusal(command), Refusal::Busy, "{command:?}");
    }
    assert_eq!(bed.status_report().module_state, ModuleState::Verifying);
    assert!(matches!(bed.save(), Effect::Notify(Message::Solved(Ok(_)))));
    assert_eq!(bed.expect_done(Command::CalAbort), ModuleState::Calibrated);
}

/// With a wrong mounting the indicator is idle before the solve, and shows the refusal after it until there is a
/// calibration.
#[test]
fn the_indicator_shows_a_refused_solve() {
    let mut bed = TestBed::with_setting(mount_change(Orientation::from_name("yaw90").unwrap()));
    assert_eq!(bed.compass.indicator_state(), IndicatorState::Idle);
    assert_eq!(bed.calibrate(&complete_turns(1)).unwrap_err().stable_code(), "mount-contradicted");
    assert_eq!(bed.compass.indicator_state(), IndicatorState::Refused);
    bed.set(setting_change("MOUNT", 0.0));
    bed.calibrate(&complete_turns(1)).unwrap();
    assert_eq!(bed.compass.indicator_state(), IndicatorState::Calibrated);
}
