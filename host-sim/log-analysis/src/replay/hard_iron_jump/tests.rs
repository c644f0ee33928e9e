//! Unit tests of `hard_iron_jump`.

use autoswing::frames::{Field, RollPitch};
use testkit::random::Random;

use super::*;
use crate::test_flight::body_rates_rad_s;

/// Strength, microtesla, and inclination, degrees, of the Earth's field.
const STRENGTH_UT: f32 = 50.0;
const INCLINATION_DEG: f32 = 60.0;

/// Row of a field without iron at a roll, a pitch and a heading, radians, while the heading turns at a rate, rad/s.
fn row_in_turn(t_s: f64, attitude: RollPitch, heading_rad: f32, turn_rad_s: f32) -> ReplayRow {
    let earth = Field::earth_field(STRENGTH_UT, INCLINATION_DEG.to_radians(), heading_rad);
    let field = Field::new(attitude.to_body_frame(earth).ut);
    let [roll_rad, pitch_rad] = [attitude.roll_rad, attitude.pitch_rad].map(f64::from);
    let rates_rad_s =
        body_rates_rad_s(&Vector3::new(roll_rad, pitch_rad, 0.0), &Vector3::new(0.0, 0.0, turn_rad_s.into()));
    ReplayRow { rates_rad_s: Some(rates_rad_s.map(|rate| rate as f32)), ..ReplayRow::of_field(t_s, field, attitude) }
}

/// 180 s at 10 Hz with a bank of `bank_deg`, turning at a rate, deg/s, of each row, with noise.
fn turning_rows(bank_deg: f32, noise_ut: f32, turn_deg_s: impl Fn(f32) -> f32) -> Vec<ReplayRow> {
    let (mut random, mut heading_rad) = (Random(1), 0.0);
    let row_at = |i: u16| {
        let turn_rad_s = |i: u16| turn_deg_s(f32::from(i) / 10.0).to_radians();
        heading_rad += 0.1 * turn_rad_s(i).midpoint(turn_rad_s(i.saturating_sub(1)));
        let mut row = row_in_turn(f64::from(i) / 10.0, RollPitch::from_deg(bank_deg, 0.0), heading_rad, turn_rad_s(i));
        row.raw_field.ut += Vector3::from_fn(|_, _| random.normal() * noise_ut);
        row.logged_field = row.raw_field;
        row
    };
    (0..1800).map(row_at).collect()
}

/// Adds iron along y, microtesla, by time, which the autopilot does not correct.
fn add_iron(mut rows: Vec<ReplayRow>, y_ut: impl Fn(f32) -> f32) -> Vec<ReplayRow> {
    for row in &mut rows {
        row.raw_field.ut.y += y_ut(row.t_s as f32);
        row.logged_field = row.raw_field;
    }
    rows
}

/// Rows turning at 10 deg/s with noise of 0.3 uT; hard iron of `added_iron_ut` along y while `has_added_iron`.
fn rows_with_added_iron(bank_deg: f32, added_iron_ut: f32, has_added_iron: impl Fn(f32) -> bool) -> Vec<ReplayRow> {
    let rows = turning_rows(bank_deg, 0.3, |_| 10.0);
    add_iron(rows, |t_s| if has_added_iron(t_s) { added_iron_ut } else { 0.0 })
}

/// Jumps before and after the times that the correction fits, seconds.
fn jumps_outside(fitted_range_s: [f64; 2], rows: &[ReplayRow]) -> Vec<HardIronStep> {
    let vertical_ut = f64::from(STRENGTH_UT * libm::sinf(INCLINATION_DEG.to_radians()));
    let earth_total_and_vertical_ut = [STRENGTH_UT.into(), vertical_ut];
    let correction = FieldCorrection::identity();
    find_jumps(rows, &FittedCorrection { correction, fitted_range_s, earth_total_and_vertical_ut })
}

fn jumps_found_in(rows: &[ReplayRow]) -> Vec<HardIronStep> {
    jumps_outside([0.0, 60.0], rows)
}

/// Asserts times to 0.5 s and steps to 1 uT: noise and a turn of 7 deg within the window blur a step. The noise alone has
/// a sigma of 0.17 uT in the difference of two medians of ten rows; the turn adds to it.
fn assert_steps(found: &[HardIronStep], expected: &[(f64, f64)], about: &str) {
    assert_eq!(found.len(), expected.len(), "{about}: {found:?}");
    for (step, (at_s, y_ut)) in found.iter().zip(expected) {
        let off_ut = step.step_ut - Vector3::new(0.0, *y_ut, 0.0);
        assert!((step.time_s - at_s).abs() < 0.5 && off_ut.norm() < 1.0, "{about}: {step:?}");
        assert!(step.sigma_ut.iter().all(|sigma_ut| (0.15..0.35).contains(sigma_ut)), "{about}: {step:?}");
    }
}

/// In level flight, strength and vertical component hardly show a step along y.
#[test]
fn a_step_is_found_up_to_two_seconds_from_either_end_and_on_any_bank() {
    for bank_deg in [0.0, 30.0] {
        for (is_later, at_s) in [(true, 90.0), (true, 160.0), (true, 178.0), (false, 2.0), (false, 20.0), (false, 90.0)]
        {
            let rows = rows_with_added_iron(bank_deg, 4.0, |t_s| (t_s >= at_s) == is_later);
            let (fitted_range_s, step_ut) = if is_later { ([0.0, 60.0], 4.0) } else { ([120.0, 180.0], -4.0) };
            let expected = [(f64::from(at_s), step_ut)];
            assert_steps(&jumps_outside(fitted_range_s, &rows), &expected, &format!("{bank_deg} deg, {at_s} s"));
            let [time_s] = find_jump_times_s(&rows, &FieldCorrection::identity())[..] else { panic!("{at_s}") };
            assert!((time_s - f64::from(at_s)).abs() < 0.5, "{at_s}: {time_s}");
        }
    }
}

/// Iron of 4 uT, or as named. Each jump is tested with the rows up to the next one. In a fast turn the logged rates show
/// 3 % less: between the windows' middles the horizontal field of 25 uT turns by 0.08 rad more. In a second of wrong
/// rates the field seems to turn by 30 deg, but strength and vertical component of the turns after it fit without a
/// shift.
#[test]
fn only_jumps_of_the_field_that_the_motion_does_not_explain_are_found() {
    let from_100_s = || rows_with_added_iron(20.0, 4.0, |t_s| t_s >= 100.0);
    let for_40_s = || rows_with_added_iron(20.0, 4.0, |t_s| (100.0..140.0).contains(&t_s));
    let mut gap = from_100_s();
    gap.retain(|row| !(99.5..100.5).contains(&row.t_s));
    let mut without_rates = from_100_s();
    for row in &mut without_rates {
        row.rates_rad_s = None;
    }
    let mut fast_turn = turning_rows(0.0, 0.3, |t_s| if (100.0..108.0).contains(&t_s) { 150.0 } else { 10.0 });
    for row in fast_turn.iter_mut().filter(|row| (100.0..108.0).contains(&row.t_s)) {
        row.rates_rad_s = row.rates_rad_s.map(|rates| rates.map(|rate| 0.97 * rate));
    }
    let mut wrong_rates = for_40_s();
    for row in wrong_rates.iter_mut().filter(|row| (120.0..121.0).contains(&row.t_s)) {
        row.rates_rad_s = row.rates_rad_s.map(|[p, q, r]| [p, q, r + 0.5]);
    }
    let opposite = add_iron(turning_rows(20.0, 0.3, |_| 5.0), |t_s| match t_s {
        ..100.0 => 0.0,
        100.0..108.0 => 4.0,
        _ => -4.0,
    });
    let (start, end) = ([0.0, 60.0], [165.0, 180.0]);
    for (name, rows, fitted_range_s, expected) in [
        ("40 s", for_40_s(), start, &[(100.0, 4.0), (140.0, -4.0)][..]),
        ("40 s before the fitted rows", for_40_s(), end, &[(100.0, 4.0), (140.0, -4.0)]),
        ("40 s with wrong rates", wrong_rates.clone(), start, &[(100.0, 4.0), (140.0, -4.0)]),
        ("wrong rates before the fitted rows", wrong_rates, end, &[(100.0, 4.0), (140.0, -4.0)]),
        ("two jumps 8 s apart", opposite, start, &[(100.0, 4.0), (108.0, -8.0)]),
        ("3 s", rows_with_added_iron(20.0, 4.0, |t_s| (100.0..103.0).contains(&t_s)), start, &[]),
        ("1 uT", rows_with_added_iron(20.0, 1.0, |t_s| t_s >= 100.0), start, &[]),
        ("spikes", rows_with_added_iron(20.0, 100.0, |t_s| (t_s * 10.0).round() % 50.0 == 0.0), start, &[]),
        ("in a gap", gap, start, &[]),
        ("without rates", without_rates, start, &[]),
        ("in the fitted rows", rows_with_added_iron(20.0, 4.0, |t_s| t_s >= 30.0), start, &[]),
        ("150 deg/s", fast_turn, start, &[]),
    ] {
        assert_steps(&jumps_outside(fitted_range_s, &rows), expected, name);
    }
}

#[test]
fn a_jump_that_the_autopilot_mostly_compensates_is_not_reported() {
    for (compensated_fraction, expected) in [(0.2, &[(100.0, 4.0)][..]), (0.8, &[])] {
        let mut rows = rows_with_added_iron(20.0, 4.0, |t_s| t_s >= 100.0);
        for row in rows.iter_mut().filter(|row| row.t_s >= 100.0) {
            row.logged_field.ut.y -= 4.0 * compensated_fraction;
        }
        assert_steps(&jumps_found_in(&rows), expected, &format!("{compensated_fraction}"));
    }
}

/// Iron that changes by 0.4 uT/s during 40 s is no jump; fields beyond it fit no longer, so that neither do jumps there,
/// nor a jump before it if most of the rows beyond are changed.
#[test]
fn no_jump_is_reported_beyond_a_change_that_was_missed() {
    for (drift_s, jumps_s, expected_s) in
        [(150.0, &[80.0][..], &[80.0][..]), (100.0, &[80.0, 90.0, 160.0], &[80.0]), (112.0, &[80.0], &[])]
    {
        let rows = add_iron(turning_rows(30.0, 0.3, |_| 4.0), |t_s| {
            let jumps = jumps_s.iter().filter(|at_s| t_s >= **at_s).count();
            (0.4 * (t_s - drift_s)).clamp(0.0, 16.0) + 6.0 * f32::from(jumps as u8)
        });
        let found_s: Vec<f64> = jumps_found_in(&rows).iter().map(|step| step.time_s.round()).collect();
        assert_eq!(found_s, expected_s, "drift from {drift_s} s, jumps at {jumps_s:?}");
    }
}
