//! Explanations of rejected calibrations on the console.

use mavlink_dialect::ATTITUDE_DATA;
use simulator::faults::Faults;
use simulator::faults::attitude::AttitudeFault;
use simulator::module::Module as _;
use simulator::rig::Rig;
use simulator::transcript::{self, Refusal};
use simulator::world::WorldConfig;
use simulator::world::autopilot::Leg;

use crate::fixtures::{full_status, run_until_legs_end};

/// Attitude in a wrong unit.
struct WrongUnit(f32);

impl AttitudeFault for WrongUnit {
    fn modify_message(&mut self, _: u64, message: &mut ATTITUDE_DATA) {
        message.roll *= self.0;
        message.pitch *= self.0;
    }
}

fn table1_rig() -> Rig {
    Rig::new(WorldConfig::of_table1(1))
}

const TURNS_TO_BOTH_SIDES: [(f64, f64); 2] = [(25.0, 800.0), (25.0, -800.0)];

/// Applies settings, flies, solves if necessary; returns code and text of the rejection.
fn refusal_code_and_text(rig: &mut Rig, settings: &[&str], turns: &[(f64, f64)]) -> (String, String) {
    rig.run_for_s(1.0);
    for line in settings.iter().chain(&["cal start turns"]) {
        let reply = rig.send_console_line(line);
        assert!(reply.contains("\r\nok "), "{reply}");
    }
    for &(bank_deg, heading_change_deg) in turns {
        rig.world.append_leg(Leg::Turn { bank_deg, heading_change_deg });
    }
    run_until_legs_end(rig);
    rig.run_for_s(3.0);
    let mut printed = rig.take_console_output();
    if transcript::parse_solve_notice(&printed).is_none() {
        printed += &rig.send_console_line("cal solve");
        rig.run_for_s(5.0);
        printed += &rig.take_console_output();
    }
    let refusal = transcript::parse_error(&printed).or_else(|| transcript::parse_solve_notice(&printed)?.err());
    let Refusal { code, explanation } = refusal.unwrap_or_else(|| panic!("not refused: {printed}"));
    let status = full_status(rig);
    let is_shown_later = status.contains(&format!("last solve: {code}: {explanation}\r\n"));
    assert!(is_shown_later || status.contains("last solve: none"), "{status}");
    (code, explanation)
}

fn assert_refused(rig: &mut Rig, settings: &[&str], turns: &[(f64, f64)], code: &str, expected_text: &str) {
    let refusal = refusal_code_and_text(rig, settings, turns);
    assert!(refusal.0 == code && refusal.1.contains(expected_text), "{code}, {expected_text}: {refusal:?}");
}

#[test]
fn too_little_bank_and_one_side_have_different_reasons() {
    let [right, left] = TURNS_TO_BOTH_SIDES;
    for (turns, code, expected_text) in [
        (&[(6.0, 200.0), (6.0, -200.0)][..], "no-samples", "too little bank, "),
        (&[right], "too-few-samples", "only right turns were flown; fly left turns, too"),
        (&[left], "too-few-samples", "only left turns were flown; fly right turns, too"),
    ] {
        assert_refused(&mut table1_rig(), &[], turns, code, expected_text);
    }
}

/// An eighth of a circle to each side in 45 s.
#[test]
fn a_turn_that_is_too_slow_is_refused_as_an_arc() {
    let mut config = WorldConfig::of_table1(1);
    config.aircraft.airspeed_m_s = 120.0;
    let mut rig = Rig::with_faults(config, Faults::default());
    let (code, explanation) = refusal_code_and_text(&mut rig, &[], &[(12.0, 45.0), (12.0, -45.0)]);
    assert!(explanation.contains(" of 12 sectors, too slow or too short"), "{code}: {explanation}");
}

/// Degrees interpreted as radians are rejected as attitude; radians converted once more are too small a tilt.
#[test]
fn attitude_in_a_wrong_unit_is_reported() {
    for (unit, expected_text) in [
        (1.0_f32.to_radians(), "check the unit of the attitude: radians for degrees?"),
        (1.0_f32.to_degrees(), "check their unit: MAVLink's is radians, not degrees"),
    ] {
        let faults = Faults { attitude_faults: vec![Box::new(WrongUnit(unit))], ..Faults::default() };
        let mut rig = Rig::with_faults(WorldConfig::of_table1(1), faults);
        assert_refused(&mut rig, &[], &TURNS_TO_BOTH_SIDES, "no-samples", expected_text);
    }
}

#[test]
fn attitude_at_1_hz_is_reported_as_too_slow() {
    let mut config = WorldConfig::of_table1(1);
    config.attitude_source.rate_hz = 1.0;
    let mut rig = Rig::with_faults(config, Faults::default());
    assert_refused(&mut rig, &[], &TURNS_TO_BOTH_SIDES, "no-samples", "send ATTITUDE ten times a second or more");
}

/// The sensor's range ends at 400 uT.
#[test]
fn a_saturated_sensor_is_reported() {
    let mut rig = table1_rig();
    rig.world.set_disturbance_ut([600.0, 0.0, 0.0]);
    assert_refused(
        &mut rig,
        &[],
        &TURNS_TO_BOTH_SIDES,
        "no-samples",
        "100 % of the readings were saturated; move the sensor",
    );
}

#[test]
fn a_wrong_setting_is_reported_with_the_right_value() {
    let explanation = "the sensor seems to be mounted none; set mount none, then cal solve";
    assert_refused(&mut table1_rig(), &["set mount yaw90"], &TURNS_TO_BOTH_SIDES, "mount-contradicted", explanation);
    let (code, explanation) = refusal_code_and_text(&mut table1_rig(), &["set inclination -54"], &TURNS_TO_BOTH_SIDES);
    assert!(code == "inclination-contradicted" && explanation.contains("; set inclination 5"), "{code}: {explanation}");
}
