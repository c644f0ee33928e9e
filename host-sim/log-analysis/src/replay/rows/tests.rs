//! Synthetic flights at 10 Hz.

use nalgebra::Vector3;

use super::*;
use crate::log::{FieldCorrection, Gps, LogFormat};
use crate::test_flight::body_rates_rad_s;

fn level_flight(seconds: i32) -> Flight {
    let mut flight = Flight::new(LogFormat::ULog);
    for i in 0..=10 * seconds {
        flight.attitude.push_row(f64::from(i) / 10.0, [0.0; 3]);
        flight.body_rates.push_row(f64::from(i) / 10.0, [0.0; 3]);
    }
    flight
}

/// Readings of 20, 0, 40 uT over an interval in seconds.
fn compass_with_readings(from_s: i32, to_s: i32) -> Compass {
    let mut compass = Compass { compass_number: 1, ..Compass::default() };
    for i in 10 * from_s..10 * to_s {
        compass.field.push_row(f64::from(i) / 10.0, [20.0, 0.0, 40.0, 20.0, 0.0, 40.0]);
    }
    compass
}

/// First and last time of usable rows, and the number of unusable rows.
fn usable_range_and_unusable_count(flight: &Flight, compass: &Compass, latency_s: f64) -> ([f64; 2], usize) {
    let (rows, row_counts) = build_rows(flight, compass, latency_s, None);
    let used_s: Vec<f64> = rows.iter().filter(|row| row.is_usable).map(|row| row.t_s).collect();
    assert_eq!(used_s.len(), row_counts.used);
    ([used_s[0], used_s[used_s.len() - 1]], rows.len() - used_s.len())
}

/// A log that was never armed is used whole.
#[test]
fn disarmed_rows_are_excluded_if_the_log_was_ever_armed() {
    let (mut flight, compass) = (level_flight(30), compass_with_readings(0, 30));
    for (armed, unused) in [(vec![], 0), (vec![(0.0, false)], 0), (vec![(10.05, true), (20.05, false)], 200)] {
        flight.armed_changes = armed;
        assert_eq!(usable_range_and_unusable_count(&flight, &compass, 0.0).1, unused, "{:?}", flight.armed_changes);
    }
    assert_eq!(build_rows(&flight, &compass, 0.0, None).1.disarmed, 200);
}

#[test]
fn excluded_rows_are_selected_by_their_logged_time() {
    let (mut flight, compass) = (level_flight(30), compass_with_readings(1, 21));
    for i in 10..210 {
        flight.row_usability.push_row(f64::from(i) / 10.0, [if i < 60 { 0.0 } else { 1.0 }]);
    }
    let latency_s = 0.45;
    let ([from_s, to_s], unused) = usable_range_and_unusable_count(&flight, &compass, latency_s);
    assert!((from_s - (6.0 - latency_s)).abs() < 1e-6 && (to_s - (20.9 - latency_s)).abs() < 1e-6, "{from_s} {to_s}");
    assert_eq!((unused, build_rows(&flight, &compass, latency_s, None).1.excluded), (50, 50));
}

/// A receiver at rest drifts at up to 2 m/s. Movement of less than 20 s is no flight.
#[test]
fn rows_before_and_after_the_movement_are_excluded() {
    for (m_s, moves_s, unused) in [(4.0, 25, 750), (2.0, 25, 0), (4.0, 15, 0)] {
        let mut flight = level_flight(100);
        for i in 0..100 {
            let is_moving = (30..=30 + moves_s).contains(&i);
            let (speed_m_s, course_deg, yaw_deg) = (if is_moving { m_s } else { 0.5 }, 0.0, f32::NAN);
            let gps = Gps { latitude_deg: 48.0, longitude_deg: 11.0, height_m: 0.0, speed_m_s, course_deg, yaw_deg };
            flight.gps.push_row(f64::from(i), gps.columns());
        }
        let (span_s, left_out) = usable_range_and_unusable_count(&flight, &compass_with_readings(0, 100), 0.0);
        assert!(left_out.abs_diff(unused) <= 1, "{m_s} m/s, {moves_s} s: {span_s:?} {left_out}");
        assert!(unused == 0 || (span_s[0] - 30.0).abs() < 0.11 && (span_s[1] - 55.0).abs() < 0.11, "{span_s:?}");
    }
}

#[test]
fn attitude_is_interpolated_over_one_lost_report() {
    for (gap_s, is_known) in [(0.67, true), (0.8, false)] {
        let mut flight = Flight::new(LogFormat::ULog);
        for i in 0..20 {
            flight.attitude.push_row(f64::from(i) * gap_s, [0.0; 3]);
            flight.body_rates.push_row(f64::from(i) * gap_s, [0.0; 3]);
        }
        let at_middle = attitude_at(&flight, 4.5 * gap_s);
        assert_eq!(at_middle.is_some(), is_known, "{gap_s}");
    }
}

/// Roll with amplitude 0.5 rad and 2 rad/s, sampled at 3 Hz: linear interpolation errs by up to 0.028 rad, the cubic by
/// `A w^4 h^4 / 384` = 0.0003 rad. Rates in a wrong unit are dropped.
#[test]
fn attitude_is_interpolated_with_the_body_rates() {
    let roll = |t_s: f64| (0.5 * libm::sin(2.0 * t_s)) as f32;
    for (unit, most_rad) in [(1.0_f64, 0.0006), (180.0 / std::f64::consts::PI, 0.03)] {
        let mut flight = Flight::new(LogFormat::ULog);
        for i in 0..60 {
            let t_s = f64::from(i) / 3.0;
            flight.attitude.push_row(t_s, [roll(t_s), 0.0, 0.0]);
            flight.body_rates.push_row(t_s, [(libm::cos(2.0 * t_s) * unit) as f32, 0.0, 0.0]);
        }
        let errors = (0..180).map(|i| {
            let t_s = f64::from(i) / 10.0;
            let (attitude, _) = attitude_at(&flight, t_s).unwrap();
            (attitude.roll_rad - roll(t_s)).abs()
        });
        let largest_error = errors.fold(0.0, f32::max);
        assert!(largest_error < most_rad, "{unit}: {largest_error}");
    }
}

/// A jump of 5 deg without rates: 10 s after the start it is alignment, so everything before is dropped; after 100 s
/// only its window. Noise of 1 deg and turns with matching rates are accepted.
#[test]
fn attitude_jumps_without_rates_are_excluded() {
    let unsettled_by = |jump_s: f64, by_deg: f32, rate_deg_s: f32| {
        let mut flight = Flight::new(LogFormat::ULog);
        for i in 0..2000 {
            let t_s = f64::from(i) / 10.0;
            let is_jump = (t_s - jump_s).abs() < 0.01;
            flight.attitude.push_row(t_s, [if t_s > jump_s - 0.01 { by_deg.to_radians() } else { 0.0 }, 0.0, 0.0]);
            flight.body_rates.push_row(t_s, [if is_jump { rate_deg_s.to_radians() } else { 0.0 }, 0.0, 0.0]);
        }
        build_rows(&flight, &compass_with_readings(0, 199), 0.0, None).1.contradicting_attitude
    };
    // Readings are rejected until the jump has left the window.
    assert!((105..=115).contains(&unsettled_by(10.0, 5.0, 0.0)), "{}", unsettled_by(10.0, 5.0, 0.0));
    assert!((10..=25).contains(&unsettled_by(100.0, 5.0, 0.0)), "{}", unsettled_by(100.0, 5.0, 0.0));
    assert_eq!(unsettled_by(100.0, 1.0, 0.0), 0);
    assert_eq!(unsettled_by(100.0, 5.0, 40.0), 0);
}

/// Limit in a window of 1 s: twice the rates plus 2 deg, so 12 deg/s at gyro rates of 5 deg/s.
#[test]
fn tilt_may_change_by_twice_the_rates() {
    for (roll_deg_s, is_flown) in [(11.0_f32, true), (14.0, false)] {
        let mut flight = Flight::new(LogFormat::ULog);
        for i in 0_u16..1000 {
            let phase_s = f32::from(i % 80) / 10.0;
            let roll_deg = roll_deg_s * phase_s.min(8.0 - phase_s);
            flight.attitude.push_row(f64::from(i) / 10.0, [roll_deg.to_radians(), 0.0, 0.0]);
            flight.body_rates.push_row(f64::from(i) / 10.0, [5_f32.to_radians(), 0.0, 0.0]);
        }
        let unsettled = build_rows(&flight, &compass_with_readings(0, 99), 0.0, None).1.contradicting_attitude;
        assert_eq!(unsettled == 0, is_flown, "{roll_deg_s} deg/s: {unsettled}");
    }
}

/// A jump 18 s after a gap of two seconds in attitude or rates is alignment.
#[test]
fn a_jump_soon_after_a_gap_is_alignment() {
    for (name, has_attitude, has_rates, expected) in
        [("none", true, true, 10..=25), ("attitude", false, true, 180..=200), ("rates", true, false, 180..=200)]
    {
        let mut flight = Flight::new(LogFormat::ULog);
        for i in 0..2000 {
            let t_s = f64::from(i) / 10.0;
            let is_gap = (100.05..102.05).contains(&t_s);
            if has_attitude || !is_gap {
                let roll_rad = if t_s > 119.95 { 5_f32.to_radians() } else { 0.0 };
                flight.attitude.push_row(t_s, [roll_rad, 0.0, 0.0]);
            }
            if has_rates || !is_gap {
                flight.body_rates.push_row(t_s, [0.0; 3]);
            }
        }
        let unsettled = build_rows(&flight, &compass_with_readings(0, 199), 0.0, None).1.contradicting_attitude;
        assert!(expected.contains(&unsettled), "a gap of {name}: {unsettled}");
    }
}

#[test]
fn attitudes_between_distant_rows_are_evenly_spaced() {
    let mut flight = level_flight(30);
    for row in flight.attitude.rows_mut() {
        row.row_values[0] = (row.t_s / 50.0) as f32;
    }
    for row in flight.body_rates.rows_mut() {
        row.row_values[0] = 0.02;
    }
    for (apart_s, expected_count) in [(0.14, 0), (0.2, 1), (1.0, 9), (4.9, 48), (5.2, 0)] {
        let attitudes = attitudes_between(&flight, 5.0, 5.0 + apart_s);
        assert_eq!(attitudes.len(), expected_count, "{apart_s} s");
        let step_s = apart_s / (expected_count + 1) as f64;
        for (i, attitude) in attitudes.iter().enumerate() {
            assert!((attitude.t_s - 5.0 - step_s * (i + 1) as f64).abs() < 1e-9, "{apart_s} s: {attitude:?}");
            assert!((f64::from(attitude.attitude.roll_rad) - attitude.t_s / 50.0).abs() < 1e-6, "{attitude:?}");
            assert_eq!(attitude.rates_rad_s, Some([0.02, 0.0, 0.0]));
        }
    }
}

/// Inverted flight across 180 deg.
#[test]
fn the_mean_roll_of_a_row_wraps_at_180_deg() {
    let mut flight = Flight::new(LogFormat::ULog);
    let mut compass = Compass { compass_number: 1, ..Compass::default() };
    for (i, roll_deg) in (0_u8..).zip([179.0_f32, -179.0]) {
        let t_s = f64::from(i) * 0.05;
        flight.attitude.push_row(t_s, [roll_deg.to_radians(), 0.0, 0.0]);
        compass.field.push_row(t_s, [20.0, 0.0, -40.0, 20.0, 0.0, -40.0]);
    }
    let (rows, _) = build_rows(&flight, &compass, 0.0, None);
    assert_eq!(rows.len(), 1);
    assert!((rows[0].attitude.roll_rad.to_degrees().abs() - 180.0).abs() < 1e-3, "{}", rows[0].attitude.roll_rad);
}

/// The current is interpolated over a gap of two lost reports at 1 Hz.
#[test]
fn a_current_is_known_within_three_seconds_of_a_report() {
    let mut flight = level_flight(30);
    for (t_s, amperes) in [(0.0, 10.0), (2.9, 20.0), (12.0, 30.0)] {
        flight.battery_current.push_row(t_s, [amperes]);
    }
    for (t_s, current_a) in [(1.45, Some(15.0)), (7.0, None), (14.9, Some(30.0)), (15.1, None)] {
        assert_eq!(current_at(&flight, t_s), current_a, "{t_s}");
    }
    let (mut rows, _) = build_rows(&flight, &compass_with_readings(0, 30), 0.0, None);
    let correction = FieldCorrection { motor_ut_per_a: Vector3::new(0.5, 0.0, -0.25), ..FieldCorrection::identity() };
    let mut corrected = |current_a| {
        rows[0].current_a = current_a;
        rows[0].corrected_field(&correction)
    };
    assert_eq!(corrected(Some(10.0)), Vector3::new(15.0, 0.0, 42.5));
    assert_eq!(corrected(None), Vector3::new(20.0, 0.0, 40.0));
}

/// In a turn of 17 deg/s a jump of 29 deg for two rows is dropped, with the rows about it, and nothing else.
#[test]
fn a_jump_of_the_attitude_drops_the_rows_about_it() {
    let mut flight = Flight::new(LogFormat::ULog);
    for i in 0..1000 {
        let roll_rad = if (500..502).contains(&i) { 0.5 } else { 0.0 };
        flight.attitude.push_row(f64::from(i) / 10.0, [roll_rad, 0.0, 0.0]);
        flight.body_rates.push_row(f64::from(i) / 10.0, [0.0, 0.0, 0.3]);
    }
    let counts = build_rows(&flight, &compass_with_readings(0, 99), 0.0, None).1;
    assert!((3..=5).contains(&counts.contradicting_attitude), "{counts:?}");
}

/// Attitude from roll and pitch as polynomials of time with these coefficients, and body rates of a steady turn with
/// it, every `step_s` for 3 s.
fn push_attitudes(flight: &mut Flight, step_s: f64, [roll, pitch]: [[f64; 4]; 2]) {
    const TURN_RATE_RAD_S: f64 = 0.4;
    for i in 0..=(3.0 / step_s).round() as u32 {
        let t_s = f64::from(i) * step_s;
        let slope = |[_, b, c, d]: [f64; 4]| b + t_s * (2.0 * c + t_s * 3.0 * d);
        let euler_rad = Vector3::new(value_at(roll, t_s), value_at(pitch, t_s), 0.0);
        let rates = body_rates_rad_s(&euler_rad, &Vector3::new(slope(roll), slope(pitch), TURN_RATE_RAD_S));
        flight.attitude.push_row(t_s, [euler_rad.x as f32, euler_rad.y as f32, 0.0]);
        flight.body_rates.push_row(t_s, rates.map(|rate| rate as f32));
    }
}

fn value_at([a, b, c, d]: [f64; 4], t_s: f64) -> f64 {
    a + t_s * (b + t_s * (c + t_s * d))
}

/// Hermite interpolation reproduces cubic polynomials; a line between the reports errs by 0.01 rad and more.
#[test]
fn a_cubic_motion_is_interpolated_exactly() {
    let motion = [[0.2, 0.3, -0.25, 0.06], [-0.1, -0.2, 0.15, -0.04]];
    let mut flight = Flight::new(LogFormat::ULog);
    push_attitudes(&mut flight, 0.5, motion);
    let mut largest_deviation = 0.0_f64;
    for i in 0..30 {
        let t_s = f64::from(i) / 10.0;
        let (attitude, rates) = attitude_at(&flight, t_s).unwrap();
        assert_eq!(rates, flight.body_rates.interpolate(t_s, 0.5));
        for (angle, found_rad) in [attitude.roll_rad, attitude.pitch_rad].into_iter().enumerate() {
            assert!((f64::from(found_rad) - value_at(motion[angle], t_s)).abs() < 1e-6, "{t_s} s, {attitude:?}");
            let by_line = flight.attitude.interpolate(t_s, 0.5).unwrap()[angle];
            largest_deviation = largest_deviation.max(f64::from((by_line - found_rad).abs()));
        }
    }
    assert!(largest_deviation > 0.01, "{largest_deviation}");
}

/// The mean of linear functions of time is their value at the mean time. Three readings at uneven times make a row.
#[test]
fn a_row_of_several_readings_holds_the_values_of_its_time() {
    let (latency_s, motion) = (0.03, [[0.2, -0.1, 0.0, 0.0], [-0.1, 0.05, 0.0, 0.0]]);
    let field_at = |t_s: f64| [1.0, 2.0, 4.0, 5.0, 7.0, 8.0].map(|axis| (axis * (3.0 - t_s) - 6.0) as f32);
    let mut flight = Flight::new(LogFormat::ULog);
    push_attitudes(&mut flight, 0.1, motion);
    for t_s in [0.0, 3.0] {
        flight.battery_current.push_row(t_s, [(5.0 + 2.0 * t_s) as f32]);
    }
    for i in 0..=30 {
        flight.reference_heading.push_row(f64::from(i) / 10.0, [0.2 * i as f32 / 10.0]);
    }
    let mut compass = Compass::default();
    for t_s in (2..25).flat_map(|i| [0.0, 0.01, 0.06].map(|offset_s| f64::from(i) / 10.0 + offset_s)) {
        compass.field.push_row(t_s, field_at(t_s));
    }
    let (rows, row_counts) = build_rows(&flight, &compass, latency_s, Some(&ReferenceHeading::Column));
    assert_eq!((row_counts.readings, row_counts.used, rows.len()), (69, 23, 23));
    for (i, row) in rows.iter().enumerate() {
        // The mean of the offsets is 0.07 / 3 s.
        let t_s = 0.2 + i as f64 / 10.0 + 0.07 / 3.0 - latency_s;
        assert!((row.t_s - t_s).abs() < 1e-9, "{i}: {} s", row.t_s);
        let [x, y, z, logged_x, logged_y, logged_z] = field_at(t_s + latency_s);
        let rates = flight.body_rates.interpolate(t_s, 0.2).unwrap();
        let [[roll_rad, pitch_rad], [current_a, reference_deg]] =
            [motion.map(|angle| value_at(angle, t_s)), [5.0 + 2.0 * t_s, (0.2 * t_s).to_degrees()]];
        let found = [
            row.raw_field.ut - Vector3::new(x, y, z),
            row.logged_field.ut - Vector3::new(logged_x, logged_y, logged_z),
            Vector3::from(row.rates_rad_s.unwrap()) - Vector3::from(rates),
            Vector3::new(row.attitude.roll_rad - roll_rad as f32, row.attitude.pitch_rad - pitch_rad as f32, 0.0),
            Vector3::new(row.current_a.unwrap() - current_a as f32, 0.0, 0.0),
            Vector3::new((row.reference_deg.unwrap() - reference_deg) as f32, 0.0, 0.0),
        ];
        // f32 at 16 uT, and the curvature of the rates between two reports.
        assert!(found.iter().all(|difference| difference.amax() < 1e-4), "{i}: {found:?}");
    }
    flight.body_rates = Series::new();
    assert!(build_rows(&flight, &compass, latency_s, None).0.iter().all(|row| row.rates_rad_s.is_none()));
}

/// A row that several causes exclude is counted once, by the first of them.
#[test]
fn each_excluded_row_is_counted_by_one_cause() {
    let mut flight = level_flight(60);
    for i in 0..600_i16 {
        let t_s = f64::from(i) / 10.0;
        flight.row_usability.push_row(t_s, [if i < 60 { 0.0 } else { 1.0 }]);
        let speed_m_s = if (130..=500).contains(&i) { 20.0 } else { 0.0 };
        flight.gps.push_row(t_s, [48.0, 11.0, 0.0, speed_m_s, 0.0, f32::NAN]);
    }
    flight.armed_changes = vec![(9.95, true), (54.95, false)];
    let (_, row_counts) = build_rows(&flight, &compass_with_readings(0, 62), 0.0, None);
    let expected = RowCounts {
        readings: 620,
        without_attitude: 19,
        used: 371,
        excluded: 60,
        disarmed: 40 + 51,
        on_the_ground: 30 + 49,
        ..RowCounts::default()
    };
    assert_eq!(row_counts, expected);
    assert_eq!(
        row_counts.rejection_texts(),
        [
            "91 disarmed",
            "79 on the ground",
            "19 without an attitude near it",
            "60 excluded by the log or outside the chosen time"
        ]
    );
    assert_eq!(row_counts.main_rejection(), (91, "disarmed"));
}

/// A frozen field while the aircraft rolls; rows that are disarmed are not counted again.
#[test]
fn usable_rows_with_a_frozen_field_are_excluded() {
    let mut flight = level_flight(60);
    for row in flight.attitude.rows_mut() {
        row.row_values[0] = 0.03 * libm::sin(row.t_s) as f32;
    }
    flight.armed_changes = vec![(19.95, true)];
    let (_, row_counts) = build_rows(&flight, &compass_with_readings(0, 60), 0.0, None);
    assert_eq!((row_counts.disarmed, row_counts.frozen_field, row_counts.used), (200, 400, 0));
}

/// Intervals that contradict the rates, of a flight at 10 Hz from 5 s to 205 s that yaws at `rate_rad_s`. Roll is 0
/// before the first change and has each value from its time on.
fn intervals_of_roll_changes(rate_rad_s: f32, changes: &[(f64, f32)]) -> Vec<[f64; 2]> {
    let mut flight = Flight::new(LogFormat::ULog);
    for i in 50..=2050 {
        let t_s = f64::from(i) / 10.0;
        let roll_rad = changes.iter().take_while(|(from_s, _)| *from_s <= t_s).last().map_or(0.0, |change| change.1);
        flight.attitude.push_row(t_s, [roll_rad, 0.0, 0.0]);
        flight.body_rates.push_row(t_s, [0.0, 0.0, rate_rad_s]);
    }
    intervals_contradicting_rates(&flight)
}

/// A change of tilt contradicts the rates in every window of 1 s that contains it. The window of the first minute begins
/// at the start. The limit is 0.035 rad plus twice the integrated rates.
#[test]
fn a_contradiction_lasts_while_its_window_contains_the_change() {
    assert_eq!(intervals_of_roll_changes(0.02, &[(100.0, 0.08)]), [[99.0, 100.9]]);
    assert_eq!(intervals_of_roll_changes(0.02, &[(100.0, 0.07)]), [[0.0; 2]; 0]);
    assert_eq!(intervals_of_roll_changes(0.0, &[(100.0, 0.05), (100.5, 0.0)]), [[99.0, 101.4]]);
    assert_eq!(intervals_of_roll_changes(0.0, &[(100.0, 0.05), (103.0, 0.0)]), [[99.0, 100.9], [102.0, 103.9]]);
    for (change_s, from_s) in [(63.9, 5.0), (66.0, 65.0)] {
        assert_eq!(intervals_of_roll_changes(0.0, &[(change_s, 0.05)]), [[from_s, change_s + 0.9]]);
    }
}

/// The limit of a step is 0.1 rad plus twice the rate: at 0.5 rad/s and 10 Hz 0.2 rad, where a window of 1 s allows
/// 1.035 rad. A second jump within 3 s ends the wrong attitude.
#[test]
fn the_attitude_is_wrong_between_two_jumps() {
    assert_eq!(intervals_of_roll_changes(0.5, &[(100.0, 0.19)]), [[0.0; 2]; 0]);
    assert_eq!(intervals_of_roll_changes(0.5, &[(100.0, 0.21)]), [[99.9, 100.0]]);
    assert_eq!(intervals_of_roll_changes(0.5, &[(100.0, 0.21), (102.9, 0.0)]), [[99.9, 102.9], [102.8, 102.9]]);
    assert_eq!(intervals_of_roll_changes(0.5, &[(100.0, 0.21), (103.3, 0.0)]), [[99.9, 100.0], [103.2, 103.3]]);
}
