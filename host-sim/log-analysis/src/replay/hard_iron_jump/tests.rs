//! Unit tests of `hard_iron_jump`.

use autoswing::frames::{Attitude, Field};
use testkit::random::Random;

use super::*;

/// Strength, microtesla, and inclination, degrees, of the Earth's field.
const STRENGTH_UT: f32 = 50.0;
const INCLINATION_DEG: f32 = 60.0;

/// 180 s at 10 Hz with a bank of `bank_deg`, turning at 10 deg/s, noise 0.3 uT; hard iron of `added_iron_ut` along y
/// while `has_added_iron`.
fn rows_with_added_iron(bank_deg: f32, added_iron_ut: f32, has_added_iron: impl Fn(f32) -> bool) -> Vec<ReplayRow> {
    let mut random = Random(1);
    let turn_rad_s = 10_f32.to_radians();
    let row_at = |i: u16| {
        let t_s = f32::from(i) / 10.0;
        let attitude = Attitude::from_deg(bank_deg, 0.0);
        let earth = Field::earth_field(STRENGTH_UT, INCLINATION_DEG.to_radians(), turn_rad_s * t_s);
        let noise = Vector3::from_fn(|_, _| random.normal() * 0.3);
        let moved = Vector3::new(0.0, if has_added_iron(t_s) { added_iron_ut } else { 0.0 }, 0.0);
        let field = Field::new(attitude.to_body_frame(earth).ut + noise + moved);
        let (sin_roll, cos_roll) = libm::sincosf(attitude.roll_rad);
        ReplayRow {
            t_s: f64::from(i) / 10.0,
            raw_field: field,
            logged_field: field,
            attitude,
            rates_rad_s: Some([0.0, turn_rad_s * sin_roll, turn_rad_s * cos_roll]),
            current_a: None,
            is_usable: true,
            reference_deg: None,
        }
    };
    (0..1800).map(row_at).collect()
}

/// Jumps before and after the times that the correction fits, seconds.
fn jumps_outside(fitted_range_s: [f64; 2], rows: &[ReplayRow]) -> Vec<HardIronStep> {
    let vertical_ut = f64::from(STRENGTH_UT * libm::sinf(INCLINATION_DEG.to_radians()));
    let earth_total_and_vertical_ut = [STRENGTH_UT.into(), vertical_ut];
    find_jumps(
        rows,
        &FittedCorrection { correction: FieldCorrection::identity(), fitted_range_s, earth_total_and_vertical_ut },
    )
}

fn jumps_found_in(rows: &[ReplayRow]) -> Vec<HardIronStep> {
    jumps_outside([0.0, 60.0], rows)
}

/// Asserts times to 0.5 s and steps to 1 uT: noise and a turn of 7 deg within the window blur a step. The noise alone has
/// a sigma of 0.17 uT in the difference of two medians of ten rows; the turn adds to it.
fn assert_steps(found: &[HardIronStep], expected: &[(f64, f64)], about: &str) {
    assert_eq!(found.len(), expected.len(), "{about}: {found:?}");
    for (step, (at_s, y_ut)) in found.iter().zip(expected) {
        let off_ut = Vector3::from(step.step_ut) - Vector3::new(0.0, *y_ut, 0.0);
        assert!((step.time_s - at_s).abs() < 0.5 && off_ut.norm() < 1.0, "{about}: {step:?}");
        assert!(step.sigma_ut.iter().all(|sigma_ut| (0.15..0.35).contains(sigma_ut)), "{about}: {step:?}");
    }
}

/// In level flight, strength and vertical component hardly show a step along y.
#[test]
fn a_step_is_found_up_to_the_last_two_seconds_and_on_any_bank() {
    for bank_deg in [0.0, 30.0] {
        for at_s in [90.0, 160.0, 178.0] {
            let flown = rows_with_added_iron(bank_deg, 4.0, |t_s| t_s >= at_s);
            assert_steps(&jumps_found_in(&flown), &[(f64::from(at_s), 4.0)], &format!("{bank_deg} deg, {at_s} s"));
        }
    }
}

/// Steps before the rows that the correction fits.
#[test]
fn a_step_is_found_from_the_first_two_seconds_on() {
    for bank_deg in [0.0, 30.0] {
        for at_s in [2.0, 20.0, 90.0] {
            let flown = rows_with_added_iron(bank_deg, 4.0, |t_s| t_s < at_s);
            let found = jumps_outside([120.0, 180.0], &flown);
            assert_steps(&found, &[(f64::from(at_s), -4.0)], &format!("{bank_deg} deg, {at_s} s"));
        }
    }
}

#[test]
fn temporary_iron_is_two_steps_unless_brief() {
    let for_40_s = rows_with_added_iron(20.0, 4.0, |t_s| (100.0..140.0).contains(&t_s));
    for fitted_range_s in [[0.0, 60.0], [145.0, 180.0]] {
        assert_steps(&jumps_outside(fitted_range_s, &for_40_s), &[(100.0, 4.0), (140.0, -4.0)], "40 s");
    }
    assert_steps(&jumps_found_in(&rows_with_added_iron(20.0, 4.0, |t_s| (100.0..103.0).contains(&t_s))), &[], "3 s");
}

#[test]
fn small_steps_spikes_and_gaps_are_no_jumps() {
    assert_steps(&jumps_found_in(&rows_with_added_iron(20.0, 1.0, |t_s| t_s >= 100.0)), &[], "1 uT");
    let spikes = rows_with_added_iron(20.0, 100.0, |t_s| (t_s * 10.0).round() % 50.0 == 0.0);
    assert_steps(&jumps_found_in(&spikes), &[], "spikes of one row");
    let mut gap = rows_with_added_iron(20.0, 4.0, |t_s| t_s >= 100.0);
    gap.retain(|row| !(99.5..100.5).contains(&row.t_s));
    assert_steps(&jumps_found_in(&gap), &[], "a step in a gap");
    let mut without_rates = rows_with_added_iron(20.0, 4.0, |t_s| t_s >= 100.0);
    for row in &mut without_rates {
        row.rates_rad_s = None;
    }
    assert_steps(&jumps_found_in(&without_rates), &[], "no rates");
}

#[test]
fn a_jump_that_the_autopilot_compensates_is_not_reported() {
    let mut compensated = rows_with_added_iron(20.0, 4.0, |t_s| t_s >= 100.0);
    for (row, unmoved) in compensated.iter_mut().zip(rows_with_added_iron(20.0, 0.0, |_| false)) {
        row.logged_field = unmoved.logged_field;
    }
    assert_steps(&jumps_found_in(&compensated), &[], "compensated");
}
