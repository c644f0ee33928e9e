//! Unit tests of `hard_iron_changes`.

use super::*;
use crate::replay::tests::compass_of_flown_turns;
use crate::test_flight::{HORIZONTAL_FIELD_UT, SOFT_IRON};

const TOTAL_UT: f64 = 50.0;

/// Changes found in the flown turns, by a flight with or without measured rates, with steps of the raw field: times,
/// seconds, and microtesla.
fn changes_by_steps(has_rates: bool, steps: &[(f64, [f32; 3])]) -> Vec<LoggedHardIronChange> {
    let (mut flight, mut compass) = compass_of_flown_turns();
    flight.has_measured_rates = has_rates;
    for row in &mut compass.rows {
        for (_, step_ut) in steps.iter().filter(|(at_s, _)| row.t_s >= *at_s) {
            row.raw_field.ut += Vector3::from(*step_ut);
        }
        row.logged_field = row.raw_field;
    }
    let initial = compass.parameter_fit.correction().unwrap();
    find_changes(&compass.rows, &flight, &initial, TOTAL_UT)
}

/// Times to a second, steps to a fifth, heading effects to a fifth of those by the soft iron of the flight.
fn assert_changes(found: &[LoggedHardIronChange], steps: &[(f64, [f32; 3])], about: &str) {
    assert_eq!(found.len(), steps.len(), "{about}: {found:?}");
    for (change, (at_s, step_ut)) in found.iter().zip(steps) {
        let step_ut = Vector3::from(*step_ut).map(f64::from);
        let off_ut = change.hard_iron_step.step_ut - step_ut;
        assert!((change.hard_iron_step.time_s - at_s).abs() < 1.0, "{about}: {change:?}");
        assert!(off_ut.norm() < 0.2 * step_ut.norm(), "{about}: {change:?}");
        let moved_ut = SOFT_IRON.try_inverse().unwrap() * step_ut;
        let effect_deg = libm::atan(moved_ut.xy().norm() / HORIZONTAL_FIELD_UT).to_degrees();
        assert!((change.heading_effect_deg / effect_deg - 1.0).abs() < 0.2, "{about}: {change:?} {effect_deg}");
    }
}

#[test]
fn steps_of_hard_iron_are_found_with_their_effect_on_headings() {
    for (has_rates, steps) in [
        (true, &[(120.0, [6.0, -4.0, 3.0])][..]),
        (true, &[(60.0, [-4.0, 6.0, 3.0])]),
        (true, &[(180.0, [5.0, 5.0, -4.0])]),
        (true, &[(75.0, [6.0, -4.0, 3.0]), (150.0, [-2.0, 7.0, 4.0])]),
        (true, &[]),
        (false, &[(120.0, [6.0, -4.0, 3.0])]),
        (false, &[(60.0, [-4.0, 6.0, 3.0])]),
        (false, &[(180.0, [5.0, 5.0, -4.0])]),
        (false, &[]),
    ] {
        assert_changes(&changes_by_steps(has_rates, steps), steps, &format!("{has_rates} {steps:?}"));
    }
}

#[test]
fn a_step_of_the_strength_of_the_earths_field_is_none_of_hard_iron() {
    assert_changes(&changes_by_steps(false, &[(120.0, [50.0, -20.0, 30.0])]), &[], "62 uT");
}

/// A copter turns for half a minute, then stands on one heading, where strength and inclination leave the horizontal
/// part of a step free along a circle. By the body rates, a reference, or without both the headings on each side, a step
/// along the circle is no change unless it turned the heading; a step along the field is one without that.
#[test]
fn a_step_that_did_not_turn_the_heading_is_no_change() {
    use autoswing::frames::{Field, Level, RollPitch};

    use crate::log::LoggedFlight;
    use crate::test_flight::flight_of_motion;

    let heading_rad = |t_s: f64| (0.3 * t_s.min(30.0)) as f32;
    let with_rates = flight_of_motion(10.0, 600, |t_s| {
        ([0.0, 0.0, heading_rad(t_s)], [0.0, 0.0, if t_s < 30.0 { 0.3 } else { 0.0 }])
    });
    let without_rates = LoggedFlight { has_measured_rates: false, ..with_rates.clone() };
    let rows = |step_ut: [f32; 3], has_reference: bool| -> Vec<ReplayRow> {
        let row = |i: i32| {
            let t_s = f64::from(i) / 10.0;
            let earth = Field::<Level>::earth_field(50.0, 60_f32.to_radians(), heading_rad(t_s)).ut;
            let field = earth + if t_s >= 35.0 { Vector3::from(step_ut) } else { Vector3::zeros() };
            let reference_deg = has_reference.then(|| f64::from(heading_rad(t_s).to_degrees()));
            ReplayRow { reference_deg, ..ReplayRow::of_field(t_s, Field::new(field), RollPitch::default()) }
        };
        (0..600).map(row).collect()
    };
    // On this heading the field is ahead by -22.6 uT and to the right by -10.7 uT: turned by 50 deg it is as strong.
    let across = [-9.0, -8.13].map(|heading_rad| {
        let (sin, cos) = libm::sincosf(heading_rad);
        [25.0 * cos, 25.0 * sin]
    });
    let along_circle = [across[1][0] - across[0][0], across[1][1] - across[0][1], 0.0];
    let along_field = [0.3 * across[0][0], 0.3 * across[0][1], 0.0];
    for (name, flight, has_reference, happened_ut, claimed_ut, is_possible) in [
        ("rates, none happened", &with_rates, false, [0.0; 3], along_circle, false),
        ("rates, happened", &with_rates, false, along_circle, along_circle, true),
        ("rates, along the field", &with_rates, false, along_field, along_field, true),
        ("reference, none happened", &without_rates, true, [0.0; 3], along_circle, false),
        ("reference, happened", &without_rates, true, along_circle, along_circle, true),
        ("one heading after it", &without_rates, false, along_circle, along_circle, false),
    ] {
        let step = HardIronStep {
            time_s: 35.0,
            step_ut: Vector3::from(claimed_ut).map(f64::from),
            sigma_ut: Vector3::repeat(0.1),
        };
        let rows = rows(happened_ut, has_reference);
        let turns = measured_turns(flight);
        let found = is_change_possible(flight, &rows, &turns, &step, &FieldCorrection::identity());
        assert_eq!(found, is_possible, "{name}");
    }
}
