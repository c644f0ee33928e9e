//! Synthetic flights at 10 Hz.

use super::*;
use crate::log::{FieldCorrection, Gps, LogFormat};

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
fn attitudes_between_distant_rows_are_returned() {
    let flight = level_flight(30);
    for (apart_s, expected_count) in [(0.14, 0), (0.2, 1), (1.0, 9), (4.9, 48), (5.2, 0)] {
        let attitudes = attitudes_between(&flight, 5.0, 5.0 + apart_s);
        assert_eq!(attitudes.len(), expected_count, "{apart_s} s");
        assert!(
            attitudes.iter().all(|attitudes| attitudes.t_s > 5.0 && attitudes.t_s < 5.0 + apart_s - 0.05),
            "{apart_s} s: {attitudes:?}"
        );
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
