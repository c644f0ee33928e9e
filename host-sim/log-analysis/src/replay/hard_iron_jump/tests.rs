//! Unit tests of `hard_iron_jump`.

use autoswing::frames::{Attitude, Field, Level};
use nalgebra::Matrix3;
use testkit::random::Random;

use super::*;
use crate::test_flight::body_rates_rad_s;

/// Strength, microtesla, and inclination, degrees, of the Earth's field.
const STRENGTH_UT: f32 = 50.0;
const INCLINATION_DEG: f32 = 60.0;

/// Row of a field without iron at a roll, a pitch and a heading, radians, while the heading turns at a rate, rad/s.
fn row_in_turn(t_s: f64, attitude: Attitude, heading_rad: f32, turn_rad_s: f32) -> ReplayRow {
    let earth = Field::earth_field(STRENGTH_UT, INCLINATION_DEG.to_radians(), heading_rad);
    let field = Field::new(attitude.to_body_frame(earth).ut);
    let [roll_rad, pitch_rad] = [attitude.roll_rad, attitude.pitch_rad].map(f64::from);
    let rates_rad_s =
        body_rates_rad_s(&Vector3::new(roll_rad, pitch_rad, 0.0), &Vector3::new(0.0, 0.0, turn_rad_s.into()));
    ReplayRow {
        t_s,
        raw_field: field,
        logged_field: field,
        attitude,
        rates_rad_s: Some(rates_rad_s.map(|rate| rate as f32)),
        current_a: None,
        is_usable: true,
        reference_deg: None,
    }
}

/// 180 s at 10 Hz with a bank of `bank_deg`, turning at a rate, deg/s, of each row, with noise.
fn turning_rows(bank_deg: f32, noise_ut: f32, turn_deg_s: impl Fn(f32) -> f32) -> Vec<ReplayRow> {
    let (mut random, mut heading_rad) = (Random(1), 0.0);
    let row_at = |i: u16| {
        let turn_rad_s = |i: u16| turn_deg_s(f32::from(i) / 10.0).to_radians();
        heading_rad += 0.1 * turn_rad_s(i).midpoint(turn_rad_s(i.saturating_sub(1)));
        let mut row = row_in_turn(f64::from(i) / 10.0, Attitude::from_deg(bank_deg, 0.0), heading_rad, turn_rad_s(i));
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
fn jumps_by_correction(correction: FieldCorrection, fitted_range_s: [f64; 2], rows: &[ReplayRow]) -> Vec<HardIronStep> {
    let vertical_ut = f64::from(STRENGTH_UT * libm::sinf(INCLINATION_DEG.to_radians()));
    let earth_total_and_vertical_ut = [STRENGTH_UT.into(), vertical_ut];
    find_jumps(rows, &FittedCorrection { correction, fitted_range_s, earth_total_and_vertical_ut })
}

fn jumps_outside(fitted_range_s: [f64; 2], rows: &[ReplayRow]) -> Vec<HardIronStep> {
    jumps_by_correction(FieldCorrection::identity(), fitted_range_s, rows)
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
            let [time_s] = find_jump_times_s(&flown, &FieldCorrection::identity())[..] else { panic!("{at_s}") };
            assert!((time_s - f64::from(at_s)).abs() < 0.5, "{at_s}: {time_s}");
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

/// The limit is half of the jump.
#[test]
fn a_jump_that_the_autopilot_mostly_compensates_is_not_reported() {
    for (compensated_fraction, expected) in [(0.0, &[(100.0, 4.0)][..]), (0.3, &[(100.0, 4.0)]), (0.7, &[]), (1.0, &[])]
    {
        let mut rows = rows_with_added_iron(20.0, 4.0, |t_s| t_s >= 100.0);
        for row in rows.iter_mut().filter(|row| row.t_s >= 100.0) {
            row.logged_field.ut.y -= 4.0 * compensated_fraction;
        }
        assert_steps(&jumps_found_in(&rows), expected, &format!("{compensated_fraction}"));
    }
}

/// The trapezoidal rule is exact for a heading rate that is linear in time. Errors are those of `f32` fields.
#[test]
fn levelled_fields_do_not_turn_with_the_heading() {
    let row_at = |i: u16| {
        let t_s = f64::from(i) * 0.1 + f64::from(i % 3) * 0.03;
        let (heading_rad, turn_rad_s) = (0.3 * t_s + 0.01 * t_s * t_s, 0.3 + 0.02 * t_s);
        (row_in_turn(t_s, Attitude::from_deg(25.0, -10.0), heading_rad as f32, turn_rad_s as f32), heading_rad)
    };
    let (rows, headings_rad): (Vec<ReplayRow>, Vec<f64>) = (0..200).map(row_at).unzip();
    let search = JumpSearch::new(&rows, &FieldCorrection::identity());
    for (i, heading_rad) in headings_rad.into_iter().enumerate() {
        let earth = Field::<Level>::earth_field(STRENGTH_UT, INCLINATION_DEG.to_radians(), 0.0).ut;
        let off_ut = search.rotations[i] * search.fields[i] - earth.map(f64::from);
        assert!(off_ut.norm() < 1e-4, "{i}: {off_ut}");
        assert!((search.rotation_sum_rad[i] - heading_rad).abs() < 1e-5, "{i}: {}", search.rotation_sum_rad[i]);
    }
}

/// Intervals with an exact binary value, so that the window's end is compared exactly.
#[test]
fn a_window_of_a_second_needs_five_rows_with_rates_and_no_gap_of_0_55_s() {
    let windows = |interval_s: f64, removed: std::ops::Range<usize>, has_rates: bool| {
        let mut rows: Vec<ReplayRow> =
            (0..60).map(|i| row_in_turn(f64::from(i) * interval_s, Attitude::from_deg(0.0, 0.0), 0.0, 0.1)).collect();
        rows[28].rates_rad_s = rows[28].rates_rad_s.filter(|_| has_rates);
        rows.drain(removed);
        let search = JumpSearch::new(&rows, &FieldCorrection::identity());
        [search.window_after(20), search.window_before(40.min(rows.len() - 1))]
    };
    assert_eq!(windows(0.0625, 0..0, true), [Some(20..36), Some(24..40)]);
    assert_eq!(windows(0.0625, 0..0, false), [None, None], "a row without rates");
    assert_eq!(windows(0.0625, 22..29, true), [Some(20..29), Some(24..40)], "a gap of 0.5 s");
    assert_eq!(windows(0.0625, 22..30, true), [None, Some(24..40)], "a gap of 0.5625 s");
    assert_eq!(windows(0.0625, 29..37, true)[1], None, "a gap of 0.5625 s");
    assert_eq!(windows(0.1875, 0..0, true), [Some(20..26), Some(34..40)]);
    assert_eq!(windows(0.25, 0..0, true), [None, None], "four rows");
    let rows = turning_rows(0.0, 0.0, |_| 10.0);
    let search = JumpSearch::new(&rows, &FieldCorrection::identity());
    assert!(search.window_before(8).is_none() && search.window_after(1792).is_none(), "before and after the rows");
}

/// Noise of 3 uT scatters the difference of two medians of ten rows by 1.7 uT in each component: its 90 % quantile is
/// 4.2 uT, the limit 13 uT.
#[test]
fn a_jump_must_exceed_the_noise_of_the_flight() {
    let noisy_rows = || turning_rows(20.0, 3.0, |_| 10.0);
    let steps_ut = |y_ut: f32| jumps_found_in(&add_iron(noisy_rows(), |t_s| if t_s >= 100.0 { y_ut } else { 0.0 }));
    assert_eq!(steps_ut(8.0), []);
    let [found] = steps_ut(20.0)[..] else { panic!("{:?}", steps_ut(20.0)) };
    // Five standard deviations.
    assert!((found.time_s - 100.0).abs() < 0.5 && (found.step_ut[1] - 20.0).abs() < 8.5, "{found:?}");
    assert!(found.sigma_ut.iter().all(|sigma_ut| (1.4..2.2).contains(sigma_ut)), "{found:?}");
}

/// Eight seconds of yaw at 150 deg/s, of which the logged rates show 3 % less: between the windows' middles the
/// horizontal field of 25 uT turns by 0.08 rad more.
#[test]
fn the_scale_error_of_rates_in_a_fast_turn_is_no_jump() {
    let mut rows = turning_rows(0.0, 0.3, |t_s| if (100.0..108.0).contains(&t_s) { 150.0 } else { 10.0 });
    for row in rows.iter_mut().filter(|row| (100.0..108.0).contains(&row.t_s)) {
        row.rates_rad_s = row.rates_rad_s.map(|rates| rates.map(|rate| 0.97 * rate));
    }
    assert_steps(&jumps_found_in(&rows), &[], "150 deg/s");
}

/// In a second of wrong rates the field seems to turn by 30 deg, but strength and vertical component of the turns after
/// it fit without a shift. A step after it is found nevertheless.
#[test]
fn a_fault_of_the_rates_is_no_jump() {
    for fitted_range_s in [[0.0, 60.0], [165.0, 180.0]] {
        let mut rows = rows_with_added_iron(20.0, 4.0, |t_s| (80.0..140.0).contains(&t_s));
        for row in rows.iter_mut().filter(|row| (110.0..111.0).contains(&row.t_s)) {
            row.rates_rad_s = row.rates_rad_s.map(|[p, q, r]| [p, q, r + 0.5]);
        }
        assert_steps(&jumps_outside(fitted_range_s, &rows), &[(80.0, 4.0), (140.0, -4.0)], "30 deg");
    }
}

/// Each jump is tested with the rows up to the next one.
#[test]
fn jumps_eight_seconds_apart_are_both_found() {
    let y_ut = |t_s: f32| {
        if t_s < 100.0 {
            0.0
        } else if t_s < 108.0 {
            4.0
        } else {
            -4.0
        }
    };
    let rows = add_iron(turning_rows(20.0, 0.3, |_| 5.0), y_ut);
    assert_steps(&jumps_found_in(&rows), &[(100.0, 4.0), (108.0, -8.0)], "8 s");
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

#[test]
fn a_jump_of_the_raw_field_is_found_by_a_correction_of_any_shape() {
    let soft_iron = Matrix3::new(1.2, 0.1, -0.05, -0.08, 0.8, 0.1, 0.05, -0.1, 1.1);
    let hard_iron_ut = Vector3::new(20.0, -10.0, 15.0);
    let mut rows = turning_rows(20.0, 0.3, |_| 10.0);
    for row in &mut rows {
        row.raw_field.ut = soft_iron * row.raw_field.ut + hard_iron_ut;
    }
    let rows = add_iron(rows, |t_s| if t_s >= 100.0 { 6.0 } else { 0.0 });
    let matrix = soft_iron.map(f64::from).try_inverse().unwrap();
    let correction = FieldCorrection::without_current(matrix, hard_iron_ut.map(f64::from));
    assert_steps(&jumps_by_correction(correction, [0.0, 60.0], &rows), &[(100.0, 6.0)], "soft iron");
}

/// The correction fits the rows within the range, so that no jump can be in it except near its ends.
#[test]
fn jumps_are_searched_outside_the_fitted_range_and_within_a_second_of_its_ends() {
    for (at_s, is_found) in [(30.0, false), (58.5, false), (59.5, true), (61.0, true)] {
        let rows = rows_with_added_iron(20.0, 4.0, |t_s| t_s >= at_s);
        assert_eq!(!jumps_found_in(&rows).is_empty(), is_found, "{at_s}");
        let rows = rows_with_added_iron(20.0, 4.0, |t_s| t_s < 180.0 - at_s);
        assert_eq!(!jumps_outside([120.0, 180.0], &rows).is_empty(), is_found, "{at_s} before the end");
    }
}

/// The remainder is up to 35 % of the larger step.
#[test]
fn steps_cancel_each_other_if_opposite_and_of_similar_size() {
    let one_ut = Vector3::new(4.0, 0.0, -2.0);
    for (other_ut, is_cancelled) in [
        (Vector3::new(-4.0, 0.0, 2.0), true),
        (Vector3::new(-3.0, 0.9, 2.0), true),
        (Vector3::new(-3.0, 1.5, 2.0), false),
        (Vector3::new(-2.0, 0.0, 1.0), false),
        (Vector3::new(4.0, 0.0, -2.0), false),
    ] {
        assert_eq!(cancel_each_other(&one_ut, &other_ut), is_cancelled, "{other_ut}");
        assert_eq!(cancel_each_other(&other_ut, &one_ut), is_cancelled, "{other_ut}");
    }
}

#[test]
fn temporary_changes_of_less_than_five_seconds_are_removed() {
    let rows = turning_rows(0.0, 0.0, |_| 10.0);
    let rows: Vec<&ReplayRow> = rows.iter().collect();
    let mut jumps: Vec<Jump> =
        [(10, 4.0), (30, 3.0), (70, -3.2), (200, -4.0), (240, -2.0), (285, 2.0), (400, 5.0), (451, -5.0)]
            .map(|(row_index, y_ut)| Jump { row_index, step_ut: Vector3::new(0.0, y_ut, 0.0) })
            .into();
    remove_brief_temporary_changes(&mut jumps, &rows);
    let remaining: Vec<usize> = jumps.iter().map(|jump| jump.row_index).collect();
    assert_eq!(remaining, [10, 200, 400, 451]);
}
