//! The module checks and sets up the autopilot's parameters.

use autoswing_module::compass::AutopilotAction;
use autoswing_module::replaced_numbers::{AutopilotKind, ParameterOwner, ReplacedNumber, ReplacedNumbers};

use super::*;

/// ArduPilot's device ids: a compass on I2C bus 0 at address 14, and the module as node 125.
const OWN_COMPASS_ID: f64 = 658_945.0;
const MODULE_ID: f64 = 97_539.0;

/// ArduPilot with a calibrated compass of its own in slot 1, and the module in slot 2, by priority the other way round.
fn bench_with_two_compasses() -> Bench {
    let mut bench = Bench::new(MavlinkFirmware::ArduPilot);
    for (name, number) in [
        ("COMPASS_DEV_ID", OWN_COMPASS_ID),
        ("COMPASS_DEV_ID2", MODULE_ID),
        ("COMPASS_PRIO1_ID", MODULE_ID),
        ("COMPASS_PRIO2_ID", OWN_COMPASS_ID),
        ("COMPASS_OFS_X", 33.0),
        ("COMPASS_OFS2_X", 120.5),
        ("COMPASS_ORIENT2", 6.0),
        ("PTCH_TRIM_DEG", 2.0),
        ("AHRS_TRIM_Y", 0.0175),
    ] {
        bench.autopilot.parameters.set_number(name, number);
    }
    bench.run_for_s(8);
    bench
}

/// Text about offsets of the autopilot's own, read every 30 s.
const CORRECTED_TWICE: &str = "corrected-twice: ";

/// Texts of an action.
fn run_action(bench: &mut Bench, action: AutopilotAction) -> Vec<String> {
    bench.module.begin_autopilot_action(action);
    bench.notices.clear();
    bench.run_for_s(60);
    bench.notices.iter().filter(|text| !text.starts_with(CORRECTED_TWICE)).cloned().collect()
}

fn numbers<const COUNT: usize>(bench: &Bench, names: [&str; COUNT]) -> [String; COUNT] {
    names.map(|name| bench.autopilot.parameters.number(name).unwrap().to_string())
}

const OWN_COMPASS_TEXT: &str = "compass: slot 1, priority 2: another compass, I2C bus 0 address 14 (id 658945)";
const MODULE_TEXT: &str = "compass: slot 2, priority 1: this module, DroneCAN bus 0 node 125 (id 97539)";

/// Offsets and orientation go by slot, the use by priority: here `COMPASS_OFS2_X` and `COMPASS_USE`.
#[test]
fn a_check_names_the_modules_compass_and_what_is_wrong() {
    let mut bench = bench_with_two_compasses();
    assert_eq!(
        run_action(&mut bench, AutopilotAction::Check),
        [
            OWN_COMPASS_TEXT,
            MODULE_TEXT,
            "parameter-wrong: COMPASS_USE is 1, wanted 0: its field is raw until the module is calibrated",
            "parameter-wrong: SCHED_LOOP_RATE is 50, wanted 100: at 50 Hz a calibration took 184 s of flight, at 100 up to 103 s",
            "parameter-wrong: COMPASS_ORIENT2 is 6, wanted 0: its field is in body axes",
            "parameter-wrong: COMPASS_OFS2_X is 120.5, wanted 1: more would correct its field twice, 1 mG marks it as calibrated",
            "trims: the autopilot's attitude lacks 0.0 deg of roll, 3.0 of pitch; removed",
            "autopilot: parameters of the autopilot: 15 right, 4 wrong, 0 changed; to write them: autopilot setup yes",
        ]
    );
    assert_eq!(numbers(&bench, ["COMPASS_USE", "COMPASS_ORIENT2", "COMPASS_OFS2_X"]), ["1", "6", "120.5"]);
}

/// First before the calibration, then after it; every third reply is lost. The other compass is not touched.
#[test]
fn a_setup_writes_what_is_wrong_in_two_halves() {
    let mut bench = bench_with_two_compasses();
    bench.autopilot.parameters.faults.lost_reply_period = 3;
    let mine = ["COMPASS_USE", "COMPASS_ORIENT2", "COMPASS_OFS2_X"];
    let others = ["COMPASS_USE2", "COMPASS_OFS_X", "COMPASS_DEV_ID", "COMPASS_PRIO2_ID"];
    let others_before = numbers(&bench, others);
    let texts = run_action(&mut bench, AutopilotAction::Setup);
    assert!(
        texts.contains(&"parameter-set: COMPASS_ORIENT2 changed from 6 to 0: its field is in body axes".to_owned())
    );
    assert!(texts.last().unwrap().contains("19 right, 0 wrong, 4 changed; restart it: autopilot restart"), "{texts:?}");
    assert_eq!(numbers(&bench, mine), ["0", "0", "1"]);
    bench.indicator_state = IndicatorState::Calibrated;
    let texts = run_action(&mut bench, AutopilotAction::Setup);
    assert!(texts.last().unwrap().contains("18 right, 1 wrong, 0 changed"), "no heading: {texts:?}");
    bench.heading = Ok(Heading { magnetic_rad: 1.0, sigma_rad: 0.01, systematic_variance_rad2: 0.0 });
    let texts = run_action(&mut bench, AutopilotAction::Check);
    assert!(texts.iter().any(|text| text.starts_with("heading: 57.3 deg magnetic now")), "{texts:?}");
    let texts = run_action(&mut bench, AutopilotAction::Setup);
    assert!(texts.last().unwrap().ends_with("19 right, 0 wrong, 1 changed"), "no restart: {texts:?}");
    assert_eq!(numbers(&bench, mine), ["1", "0", "1"]);
    assert_eq!(numbers(&bench, others), others_before);
    let texts = run_action(&mut bench, AutopilotAction::Check);
    assert_eq!(texts.last().unwrap(), "autopilot: parameters of the autopilot: 19 right, 0 wrong, 0 changed");
}

/// Copters have 400 Hz.
#[test]
fn a_setup_does_not_slow_the_autopilots_loop() {
    let mut bench = bench_with_two_compasses();
    bench.autopilot.parameters.set_number("SCHED_LOOP_RATE", 400.0);
    run_action(&mut bench, AutopilotAction::Setup);
    assert_eq!(numbers(&bench, ["SCHED_LOOP_RATE"]), ["400"]);
}

/// Writes that do not last are reported: by a ground station that writes at the same time, to a read-only
/// parameter, to a parameter that this version lacks.
#[test]
fn a_setup_reports_what_it_could_not_write() {
    let mut bench = bench_with_two_compasses();
    bench.autopilot.parameters.faults.rival_write = Some(("COMPASS_ORIENT2", 4.0));
    bench.autopilot.parameters.set_read_only("COMPASS_OFS2_X");
    bench.autopilot.parameters.remove_parameter("COMPASS_SCALE2");
    let texts = run_action(&mut bench, AutopilotAction::Setup);
    for text in [
        "parameter-refused: COMPASS_ORIENT2 was set to 0, and is 4",
        "parameter-refused: COMPASS_OFS2_X was set to 1, and is 120.5",
        "parameter-missing: no answer for COMPASS_SCALE2, wanted 0: its field is corrected already",
    ] {
        assert!(texts.iter().any(|shown| shown == text), "{text}: {texts:?}");
    }
    assert!(texts.last().unwrap().contains("16 right, 2 wrong, 2 changed, 1 missing"), "{texts:?}");
}

/// Replies are lost from the middle of the setup on.
#[test]
fn a_check_explains_what_a_setup_without_a_link_has_left() {
    let mut bench = bench_with_two_compasses();
    bench.module.begin_autopilot_action(AutopilotAction::Setup);
    bench.run_for_s(1);
    assert_eq!(numbers(&bench, ["COMPASS_USE", "COMPASS_OFS2_X"]), ["0", "120.5"], "in the middle");
    bench.autopilot.parameters.faults.lost_reply_period = 1;
    bench.run_for_s(200);
    let summary = bench.notices.last().unwrap();
    assert!(summary.contains("2 right, 0 wrong, 2 changed, 17 missing"), "{summary}");
    bench.autopilot.parameters.faults.lost_reply_period = 0;
    let texts = run_action(&mut bench, AutopilotAction::Check);
    assert!(texts[2].starts_with("parameter-wrong: COMPASS_ORIENT2 is 6, wanted 0: "), "{texts:?}");
    assert!(texts[3].starts_with("parameter-wrong: COMPASS_OFS2_X is 120.5, wanted 1: "), "{texts:?}");
    assert!(texts.last().unwrap().contains("17 right, 2 wrong, 0 changed; to write them: "), "{texts:?}");
}

/// Also after both halves, of which both write `COMPASS_USE`, and with every third reply lost. A second undo finds nothing.
#[test]
fn an_undo_writes_every_number_of_before_the_setup() {
    let mut bench = bench_with_two_compasses();
    bench.autopilot.parameters.faults.lost_reply_period = 3;
    let mine = ["COMPASS_USE", "COMPASS_ORIENT2", "COMPASS_OFS2_X", "COMPASS_OFS2_Y", "SCHED_LOOP_RATE"];
    let before = numbers(&bench, mine);
    run_action(&mut bench, AutopilotAction::Setup);
    bench.indicator_state = IndicatorState::Calibrated;
    bench.heading = Ok(Heading { magnetic_rad: 1.0, sigma_rad: 0.01, systematic_variance_rad2: 0.0 });
    run_action(&mut bench, AutopilotAction::Setup);
    assert_ne!(numbers(&bench, mine), before);
    let texts = run_action(&mut bench, AutopilotAction::Undo);
    assert!(
        texts.contains(&"parameter-set: COMPASS_ORIENT2 changed from 0 to 6: as before the setup".to_owned()),
        "{texts:?}"
    );
    assert!(texts.last().unwrap().contains("4 right, 0 wrong, 3 changed; restart it"), "{texts:?}");
    assert_eq!(numbers(&bench, mine), before);
    let texts = run_action(&mut bench, AutopilotAction::Undo);
    assert_eq!(texts, ["nothing-replaced: no setup has replaced a number of the autopilot's"]);
}

/// Behind the same module: the numbers stay until that autopilot is back, or another setup replaces them.
#[test]
fn an_undo_writes_no_number_of_another_autopilot() {
    let mut inav = crate::world::msp_autopilot::tests::setup::bench_with_own_calibration();
    let mut ardupilot = bench_with_two_compasses();
    let mut px4 = Bench::new(MavlinkFirmware::Px4);
    px4.run_for_s(2);
    inav.run_action(AutopilotAction::Setup);
    run_action(&mut ardupilot, AutopilotAction::Setup);
    run_action(&mut px4, AutopilotAction::Setup);
    let owner = ParameterOwner { kind: AutopilotKind::Px4, compass: (0, 0) };
    let replaced_yaw_source = ReplacedNumber { owner, row: 0, number: Some(15.0) };
    let [of_inav, of_ardupilot, of_px4, of_px4_without_compass] = [
        inav.settings.replaced_numbers,
        ardupilot.settings.replaced_numbers,
        px4.settings.replaced_numbers,
        ReplacedNumbers::NONE.with_number(replaced_yaw_source),
    ];
    let refusal = [
        "other-autopilot: a setup has replaced numbers of another autopilot, and none of this one; connect that one for an undo",
    ];
    for replaced_numbers in [of_ardupilot, of_px4, of_px4_without_compass] {
        inav.settings.replaced_numbers = replaced_numbers;
        assert_eq!(inav.run_action(AutopilotAction::Undo), refusal);
    }
    for (bench, others) in
        [(&mut ardupilot, &[of_inav, of_px4, of_px4_without_compass][..]), (&mut px4, &[of_inav, of_ardupilot])]
    {
        for replaced_numbers in others {
            bench.settings.replaced_numbers = *replaced_numbers;
            assert_eq!(run_action(bench, AutopilotAction::Undo), refusal);
            assert_eq!(bench.settings.replaced_numbers, *replaced_numbers);
        }
    }
    px4.settings.replaced_numbers = of_px4_without_compass;
    px4.autopilot.parameters.set_number("EKF2_EV_CTRL", 8.0);
    run_action(&mut px4, AutopilotAction::Undo);
    assert_eq!(numbers(&px4, ["EKF2_EV_CTRL"]), ["15"]);
}

#[test]
fn nothing_is_written_that_could_not_be_undone() {
    let mut bench = bench_with_two_compasses();
    bench.can_store = false;
    let texts = run_action(&mut bench, AutopilotAction::Setup);
    assert!(texts.last().unwrap().starts_with("number-not-kept: "), "{texts:?}");
    assert_eq!(numbers(&bench, ["COMPASS_USE", "COMPASS_ORIENT2", "COMPASS_OFS2_X"]), ["1", "6", "120.5"]);
}

#[test]
fn nothing_is_written_while_armed() {
    let mut bench = bench_with_two_compasses();
    bench.inputs.is_armed = true;
    bench.run_for_s(2);
    let texts = run_action(&mut bench, AutopilotAction::Setup);
    assert!(texts.last().unwrap().starts_with("armed: "), "{texts:?}");
    assert_eq!(numbers(&bench, ["COMPASS_USE"]), ["1"]);
}

/// PX4's integers are sent as their bytes.
#[test]
fn px4_is_set_up_for_a_yaw_from_outside() {
    let mut bench = Bench::new(MavlinkFirmware::Px4);
    bench.settings.sends_vision_yaw = true;
    bench.run_for_s(2);
    let texts = run_action(&mut bench, AutopilotAction::Setup);
    assert_eq!(texts[0], "parameter-set: EKF2_EV_CTRL changed from 15 to 8: of a pose only yaw is used");
    assert_eq!(numbers(&bench, ["EKF2_EV_CTRL"]), ["8"]);
}

/// PX4 with a compass of its own in slot 0 does not arm with a compass that no slot has, or has offsets of its own for
/// that, learnt in flight.
#[test]
fn px4_gets_the_modules_compass_in_a_free_slot() {
    const NODE_125: &str = "8944899";
    let mut bench = Bench::new(MavlinkFirmware::Px4);
    bench.autopilot.parameters.set_number("CAL_MAG0_ID", 396_809.0);
    bench.autopilot.parameters.set_number("CAL_MAG0_XOFF", 0.12);
    bench.run_for_s(2);
    let names = ["CAL_MAG1_ID", "CAL_MAG1_PRIO", "CAL_MAG1_ROT", "CAL_MAG1_XOFF", "CAL_MAG0_XOFF"];
    let before = numbers(&bench, names);
    let own = "compass: CAL_MAG0: another compass, I2C bus 1 address 14 (id 396809)";
    let texts = run_action(&mut bench, AutopilotAction::Check);
    assert_eq!(texts[0], own);
    let unknown = "parameter-wrong: CAL_MAG1_ID is 0, wanted 8944899: PX4 does not arm with a compass that no slot has; on CAN 2 the id is 8 more";
    assert_eq!(texts[1], unknown);
    let texts = run_action(&mut bench, AutopilotAction::Setup);
    assert!(texts.last().unwrap().contains("15 right, 0 wrong, 3 changed; restart it: autopilot restart"), "{texts:?}");
    assert_eq!(numbers(&bench, names), [NODE_125, "0", "0", "0", "0.12"]);
    bench.autopilot.parameters.set_number("CAL_MAG1_XOFF", 0.0625);
    bench.indicator_state = IndicatorState::Calibrated;
    bench.heading = Ok(Heading { magnetic_rad: 1.0, sigma_rad: 0.01, systematic_variance_rad2: 0.0 });
    let texts = run_action(&mut bench, AutopilotAction::Check);
    assert_eq!(texts[1], "compass: CAL_MAG1: this module, DroneCAN bus 0 node 125 (id 8944899)");
    assert_eq!(texts[2], "parameter-wrong: CAL_MAG1_XOFF is 0.0625, wanted 0: its field is corrected already");
    run_action(&mut bench, AutopilotAction::Setup);
    assert_eq!(numbers(&bench, names), [NODE_125, "75", "0", "0", "0.12"]);
    run_action(&mut bench, AutopilotAction::Undo);
    assert_eq!(numbers(&bench, names), [&before[0], &before[1], &before[2], "0.0625", "0.12"]);
}

#[test]
fn a_check_without_an_answer_ends_with_the_reason() {
    for (firmware, code) in
        [(MavlinkFirmware::IgnoresRequests, "no-parameters: "), (MavlinkFirmware::ArduPilot, "no-compass: ")]
    {
        let mut bench = Bench::new(firmware);
        bench.run_for_s(40);
        let texts = run_action(&mut bench, AutopilotAction::Check);
        assert!(texts.len() == 1 && texts[0].starts_with(code), "{texts:?}");
    }
}

/// The attitude of a quadplane has its pitch trim in one of two modes.
#[test]
fn an_ambiguous_pitch_trim_is_reported_once() {
    for (option, expected) in [(0.0, 1), (256.0, 0)] {
        let mut bench = Bench::new(MavlinkFirmware::ArduPilot);
        for (name, number) in [("Q_ENABLE", 1.0), ("PTCH_TRIM_DEG", 2.0), ("FLIGHT_OPTIONS", option)] {
            bench.autopilot.parameters.set_number(name, number);
        }
        bench.run_for_s(90);
        let reports = bench.notices.iter().filter(|text| text.starts_with("trims-ambiguous: "));
        assert_eq!(reports.count(), expected, "FLIGHT_OPTIONS={option}");
    }
}

/// ArduPilot's own calibration of the module's compass succeeds, too. Offsets of the other compass are its own.
#[test]
fn offsets_that_correct_a_second_time_are_reported_once() {
    let mut bench = bench_with_two_compasses();
    bench.run_for_s(120);
    let report_count = |bench: &Bench| bench.notices.iter().filter(|text| text.starts_with(CORRECTED_TWICE)).count();
    assert_eq!(report_count(&bench), 1, "{:?}", bench.notices);
    assert!(bench.notices.iter().any(|text| text.contains("compass slot 2, 120 mG, ")), "{:?}", bench.notices);
    for (offset_mg, reports) in [(1.0, 1), (-60.0, 2)] {
        bench.autopilot.parameters.set_number("COMPASS_OFS2_X", offset_mg);
        bench.run_for_s(120);
        assert_eq!(report_count(&bench), reports, "{offset_mg} mG: {:?}", bench.notices);
    }
}

/// Notes of each action, as the console shows them: before the calibration, after it, and back.
fn recorded_session(title: &str, mut act: impl FnMut(bool, AutopilotAction) -> Vec<String>) -> String {
    let mut session = format!("{title}\n{}\n", "-".repeat(title.len()));
    for (is_calibrated, command, action) in [
        (false, "check", AutopilotAction::Check),
        (false, "setup yes", AutopilotAction::Setup),
        (true, "check", AutopilotAction::Check),
        (true, "setup yes", AutopilotAction::Setup),
        (true, "undo", AutopilotAction::Undo),
    ] {
        let state = if is_calibrated { "calibrated" } else { "uncalibrated" };
        let notes: String = act(is_calibrated, action).iter().flat_map(|text| ["note ", text, "\n"]).collect();
        session.extend(["\n> autopilot ", command, "    (", state, ")\n", &notes]);
    }
    session
}

#[test]
fn the_documented_sessions_are_those_of_the_module() {
    let mavlink_session = |title, mut bench: Bench| {
        recorded_session(title, |is_calibrated, action| {
            if is_calibrated {
                bench.indicator_state = IndicatorState::Calibrated;
                bench.heading = Ok(Heading { magnetic_rad: 1.0, sigma_rad: 0.01, systematic_variance_rad2: 0.0 });
            }
            run_action(&mut bench, action)
        })
    };
    let mut px4 = Bench::new(MavlinkFirmware::Px4);
    px4.autopilot.parameters.set_number("CAL_MAG0_ID", 396_809.0);
    px4.settings.sends_vision_yaw = true;
    px4.run_for_s(2);
    let mut inav = crate::world::msp_autopilot::tests::setup::bench_with_own_calibration();
    let sessions = [
        mavlink_session("ArduPilot with a compass of its own; the module by DroneCAN", bench_with_two_compasses()),
        mavlink_session("PX4 with a compass of its own; the module by DroneCAN, with set vision on", px4),
        recorded_session("INAV, with a calibration of its own; the module by MSP", |is_calibrated, action| {
            inav.is_calibrated = is_calibrated;
            inav.run_action(action)
        }),
    ];
    testkit::documents::assert_document_is("docs/autopilot-setup.txt", &sessions.join("\n\n"));
}
