//! Unit tests of `hard_iron_changes`.

use testkit::random::Random;

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
        let off_ut = Vector3::from(change.hard_iron_step.step_ut) - step_ut;
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

/// Time, size and noise of a step that the flown turns contain, and the step that an estimate claims.
struct Claim {
    at_s: f64,
    actual_ut: [f32; 3],
    claimed_ut: [f64; 3],
    sigma_ut: f64,
    noise_ut: f32,
}

impl Claim {
    fn exact(at_s: f64, actual_ut: [f32; 3], noise_ut: f32) -> Self {
        Self { at_s, actual_ut, claimed_ut: actual_ut.map(f64::from), sigma_ut: 0.05, noise_ut }
    }

    fn is_confirmed(&self) -> bool {
        let (_, mut compass) = compass_of_flown_turns();
        let mut random = Random(1);
        for row in &mut compass.rows {
            let step_ut = if row.t_s < self.at_s { Vector3::zeros() } else { self.actual_ut.into() };
            row.raw_field.ut += step_ut + Vector3::from_fn(|_, _| random.normal() * self.noise_ut);
        }
        let parts = split_at_times(&compass.rows, [self.at_s].into_iter());
        let parts = [parts[0], parts[1]];
        let hard_iron_step = HardIronStep { time_s: self.at_s, step_ut: self.claimed_ut, sigma_ut: [self.sigma_ut; 3] };
        confirmed_heading_effect_deg(&hard_iron_step, parts, &parts.map(solve_all_rows)).is_some()
    }
}

/// Before and after the better observed part of the flight. Noise of 1.5 uT is as large as the part of a step of 3 uT
/// that strength and vertical component show.
#[test]
fn a_step_is_confirmed_by_the_residuals_that_it_halves() {
    for at_s in [60.0, 180.0] {
        let claim = || Claim::exact(at_s, [6.0, -4.0, 3.0], 0.0);
        for (name, claim, is_confirmed) in [
            ("exact", claim(), true),
            ("no step", Claim { actual_ut: [0.0; 3], ..claim() }, false),
            ("of the opposite sign", Claim { claimed_ut: [-6.0, 4.0, -3.0], ..claim() }, false),
            ("insignificant", Claim { sigma_ut: 1.2, ..claim() }, false),
        ] {
            assert_eq!(claim.is_confirmed(), is_confirmed, "{name} at {at_s} s");
        }
    }
    let is_confirmed = |noise_ut: f32| Claim::exact(60.0, [2.0, -1.8, 1.5], noise_ut).is_confirmed();
    assert!(is_confirmed(0.3) && !is_confirmed(1.5));
}

fn change_at(time_s: f64, step_ut: [f64; 3]) -> LoggedHardIronChange {
    let hard_iron_step = HardIronStep { time_s, step_ut, sigma_ut: [0.1; 3] };
    LoggedHardIronChange { hard_iron_step, heading_effect_deg: 5.0 }
}

#[test]
fn a_temporary_change_ends_with_the_last_change() {
    let changes =
        [change_at(50.0, [1.0, 2.0, 3.0]), change_at(100.0, [4.0, 0.0, 1.0]), change_at(140.0, [-3.8, 0.2, -1.0])];
    assert_eq!(temporary_change_start_s(&changes), Some(100.0));
    assert_eq!(temporary_change_start_s(&changes[..2]), None);
    assert_eq!(temporary_change_start_s(&changes[..1]), None);
    assert_eq!(temporary_change_start_s(&[changes[1], changes[2], changes[0]]), None);
}

#[test]
fn a_step_near_a_jump_and_of_its_size_is_the_same_change() {
    let jump = change_at(100.0, [4.0, -2.0, 4.0]).hard_iron_step;
    for (time_s, step_ut, is_same) in [
        (101.0, [4.5, -2.0, 3.5], true),
        (99.0, [4.0, -2.0, 4.0], true),
        (103.0, [4.0, -2.0, 4.0], false),
        (97.0, [4.0, -2.0, 4.0], false),
        (100.0, [-4.0, 2.0, -4.0], false),
    ] {
        assert_eq!(is_same_change(&change_at(time_s, step_ut).hard_iron_step, &jump), is_same, "{time_s} {step_ut:?}");
    }
}

/// Components with sigmas of 0.36, 0.27 and 0.16 uT, as estimated from noise of 0.5 uT in a simulated flight.
#[test]
fn only_a_significant_horizontal_change_affects_headings() {
    let sigma_ut = Vector3::new(0.36, 0.27, 0.16);
    let effect_deg = |x, y, z| heading_effect_deg(&Vector3::new(x, y, z), &sigma_ut, 25.0);
    assert!(effect_deg(-0.7, -3.5, -4.9).is_some_and(|deg| (deg - 8.1).abs() < 0.1), "eight sigmas, mostly vertical");
    assert_eq!(effect_deg(1.6, 1.2, 4.9), None, "four sigmas across the heading");
    assert_eq!(effect_deg(0.2, 0.3, 9.0), None, "vertical");
    assert_eq!(heading_effect_deg(&Vector3::new(0.4, 0.0, 0.0), &(sigma_ut / 100.0), 25.0), None, "0.9 deg");
}

/// A copter turns for half a minute, then stands on one heading, where strength and inclination leave the horizontal
/// part of a step free along a circle. By the body rates, a reference, or without both the headings on each side, a step
/// along the circle is no change unless it turned the heading; a step along the field is one without that.
#[test]
fn a_step_that_did_not_turn_the_heading_is_no_change() {
    use autoswing::frames::{Field, Level, RollPitch};

    use crate::log::LoggedFlight;
    use crate::replay::tests::row_of_field;
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
            ReplayRow { reference_deg, ..row_of_field(t_s, Field::new(field), RollPitch::default()) }
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
        let step = HardIronStep { time_s: 35.0, step_ut: claimed_ut.map(f64::from), sigma_ut: [0.1; 3] };
        let rows = rows(happened_ut, has_reference);
        let turns = measured_turns(flight);
        let found = is_change_possible(flight, &rows, &turns, &step, &FieldCorrection::identity());
        assert_eq!(found, is_possible, "{name}");
    }
}
