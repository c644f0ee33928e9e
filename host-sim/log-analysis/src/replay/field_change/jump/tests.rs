//! Unit tests of jumps, and of the changes that they measure.

use autoswing::frames::{Field, RollPitch};
use testkit::random::Random;

use super::*;
use crate::log::{LogFormat, LoggedFlight};
use crate::replay::field_change::{HardIronChange, find_changes};
use crate::test_flight::body_rates_rad_s;

/// Strength, microtesla, and inclination, degrees, of the Earth's field.
const STRENGTH_UT: f32 = 50.0;
const INCLINATION_DEG: f32 = 60.0;

/// 180 s at 10 Hz with a bank of `bank_deg`, turning at a rate, deg/s, of each row, with noise. From 25 to 80 s the aircraft
/// rolls and pitches, which determines the calibration.
fn turning_rows(bank_deg: f64, noise_ut: f32, turn_deg_s: impl Fn(f32) -> f32) -> Vec<ReplayRow> {
    let (mut random, mut heading_rad) = (Random(1), 0.0);
    let row_at = |i: u16| {
        let t_s = f64::from(i) / 10.0;
        let turn_rad_s = |i: u16| turn_deg_s(f32::from(i) / 10.0).to_radians();
        heading_rad += 0.1 * turn_rad_s(i).midpoint(turn_rad_s(i.saturating_sub(1)));
        let size = if (25.0..80.0).contains(&t_s) { 1.0 } else { 0.0 };
        // Whole periods from 25 s on.
        let swing = |frequency: f64, deg: f64| {
            let (sin, cos) = libm::sincos(frequency * (t_s - 25.0) * std::f64::consts::TAU / 55.0);
            [size * deg.to_radians() * sin, size * deg.to_radians() * cos * frequency * std::f64::consts::TAU / 55.0]
        };
        let ([roll_rad, roll_rad_s], [pitch_rad, pitch_rad_s]) = (swing(3.0, 25.0), swing(4.0, 12.0));
        let angles_rad = Vector3::new(bank_deg.to_radians() + roll_rad, pitch_rad, 0.0);
        let rates = body_rates_rad_s(&angles_rad, &Vector3::new(roll_rad_s, pitch_rad_s, turn_rad_s(i).into()));
        let attitude = RollPitch { roll_rad: angles_rad.x as f32, pitch_rad: angles_rad.y as f32 };
        let earth = Field::earth_field(STRENGTH_UT, INCLINATION_DEG.to_radians(), heading_rad);
        let noise_ut = Vector3::from_fn(|_, _| random.normal() * noise_ut);
        let field = Field::new(attitude.to_body_frame(earth).ut + noise_ut);
        ReplayRow { rates_rad_s: Some(rates.map(|rate| rate as f32)), ..ReplayRow::of_field(t_s, field, attitude) }
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
fn rows_with_added_iron(bank_deg: f64, added_iron_ut: f32, has_added_iron: impl Fn(f32) -> bool) -> Vec<ReplayRow> {
    let rows = turning_rows(bank_deg, 0.3, |_| 10.0);
    add_iron(rows, |t_s| if has_added_iron(t_s) { added_iron_ut } else { 0.0 })
}

/// Changes of rows with complete body rates, whose field has no iron at first.
fn changes_of(rows: &[ReplayRow]) -> Vec<HardIronChange> {
    let mut flight = LoggedFlight::new(LogFormat::Csv);
    for row in rows {
        flight.attitude.push_row(row.t_s, [row.attitude.roll_rad, row.attitude.pitch_rad, f32::NAN]);
        row.rates_rad_s.into_iter().for_each(|rates| flight.body_rates.push_row(row.t_s, rates));
    }
    find_changes(rows, &flight, &FieldCorrection::identity(), f64::INFINITY).unwrap()
}

/// Asserts times to 0.5 s and steps to 1 uT: noise and a turn of 7 deg within the window blur a step.
fn assert_steps(found: &[HardIronChange], expected: &[(f64, f64)], about: &str) {
    assert_eq!(found.len(), expected.len(), "{about}: {found:?}");
    for (change, (at_s, y_ut)) in found.iter().zip(expected) {
        let off_ut = change.step_ut - Vector3::new(0.0, *y_ut, 0.0);
        assert!((change.time_s - at_s).abs() < 0.5 && off_ut.norm() < 1.0, "{about}: {change:?}");
    }
}

/// In level flight, strength and vertical component hardly show a step along y.
#[test]
fn a_step_is_found_up_to_five_seconds_from_either_end_and_on_any_bank() {
    for bank_deg in [0.0, 30.0] {
        for (is_later, at_s) in [(true, 90.0), (true, 160.0), (true, 175.0), (false, 5.0), (false, 20.0), (false, 90.0)]
        {
            let rows = rows_with_added_iron(bank_deg, 4.0, |t_s| (t_s >= at_s) == is_later);
            let expected = [(f64::from(at_s), if is_later { 4.0 } else { -4.0 })];
            assert_steps(&changes_of(&rows), &expected, &format!("{bank_deg} deg, {at_s} s"));
            let [Jump { time_s, .. }] = find_jumps(&rows, &FieldCorrection::identity())[..] else { panic!("{at_s}") };
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
    for (name, rows, expected) in [
        ("40 s", for_40_s(), &[(100.0, 4.0), (140.0, -4.0)][..]),
        ("40 s with wrong rates", wrong_rates, &[(100.0, 4.0), (140.0, -4.0)]),
        ("two jumps 8 s apart", opposite, &[(100.0, 4.0), (108.0, -8.0)]),
        ("3 s", rows_with_added_iron(20.0, 4.0, |t_s| (100.0..103.0).contains(&t_s)), &[]),
        ("1 uT", rows_with_added_iron(20.0, 1.0, |t_s| t_s >= 100.0), &[]),
        ("spikes", rows_with_added_iron(20.0, 100.0, |t_s| (t_s * 10.0).round() % 50.0 == 0.0), &[]),
        ("in a gap", gap, &[(100.5, 4.0)]),
        ("without rates", without_rates, &[(100.0, 4.0)]),
        ("150 deg/s", fast_turn, &[]),
    ] {
        assert_steps(&changes_of(&rows), expected, name);
    }
}

#[test]
fn a_jump_that_the_autopilot_mostly_compensates_is_none() {
    for (compensated_fraction, is_found) in [(0.2, true), (0.8, false)] {
        let mut rows = rows_with_added_iron(20.0, 4.0, |t_s| t_s >= 100.0);
        for row in rows.iter_mut().filter(|row| row.t_s >= 100.0) {
            row.logged_field.ut.y -= 4.0 * compensated_fraction;
        }
        let found = find_jumps(&rows, &FieldCorrection::identity());
        assert_eq!(found.len(), usize::from(is_found), "{compensated_fraction}: {found:?}");
    }
}
