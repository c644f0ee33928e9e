//! Synthetic flights at 10 Hz.

use super::*;
use crate::log::{FieldCorrection, LogFormat};
use crate::test_flight::{body_rates_rad_s, flight_of_motion};

fn level_flight(seconds: u16) -> LoggedFlight {
    flight_of_motion(10.0, 10 * seconds + 1, |_| ([0.0; 3], [0.0; 3]))
}

/// Readings of 20, 0, 40 uT over an interval in seconds.
fn compass_with_readings(from_s: i32, to_s: i32) -> LoggedCompass {
    let mut compass = LoggedCompass::without_readings(1, Ok(1));
    for i in 10 * from_s..10 * to_s {
        compass.field.push_row(f64::from(i) / 10.0, [20.0, 0.0, 40.0, 20.0, 0.0, 40.0]);
    }
    compass
}

/// First and last time of usable rows, and the number of unusable rows.
fn usable_range_and_unusable_count(
    flight: &LoggedFlight,
    compass: &LoggedCompass,
    latency_s: f64,
) -> ([f64; 2], usize) {
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

/// A receiver at rest drifts at up to 2 m/s. A movement of 10 s is no flight.
#[test]
fn rows_before_and_after_the_movement_are_excluded() {
    for (m_s, moves_s, unused) in [(4.0, 25, 750), (2.0, 25, 0), (4.0, 10, 0)] {
        let mut flight = level_flight(100);
        for i in 0..100 {
            let speed_m_s = if (30..=30 + moves_s).contains(&i) { m_s } else { 0.5 };
            flight.gps.push_row(f64::from(i), [48.0, 11.0, 0.0, speed_m_s, 0.0, f32::NAN]);
        }
        let (span_s, unused_count) = usable_range_and_unusable_count(&flight, &compass_with_readings(0, 100), 0.0);
        assert!(unused_count.abs_diff(unused) <= 1, "{m_s} m/s, {moves_s} s: {span_s:?} {unused_count}");
        assert!(unused == 0 || (span_s[0] - 30.0).abs() < 0.11 && (span_s[1] - 55.0).abs() < 0.11, "{span_s:?}");
    }
}

/// With one report in two lost of an attitude at 3 Hz, and with two in three lost.
#[test]
fn attitude_is_interpolated_over_one_lost_report() {
    for (rate_hz, is_known) in [(1.5, true), (1.0, false)] {
        let flight = flight_of_motion(rate_hz, 20, |_| ([0.0; 3], [0.0; 3]));
        assert_eq!(attitude_at(&flight, 4.5 / rate_hz).is_some(), is_known, "{rate_hz} Hz");
    }
}

#[test]
fn attitudes_between_distant_rows_are_evenly_spaced() {
    let flight = flight_of_motion(10.0, 301, |t_s| ([(t_s / 50.0) as f32, 0.0, 0.0], [0.02, 0.0, 0.0]));
    for (apart_s, expected_count) in [(0.1, 0), (0.2, 1), (1.0, 9), (4.5, 44), (8.0, 0)] {
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
    let mut flight = LoggedFlight::new(LogFormat::ULog);
    let mut compass = LoggedCompass::without_readings(1, Ok(1));
    for (t_s, roll_deg) in [(0.0, 179.0_f32), (0.05, -179.0)] {
        flight.attitude.push_row(t_s, [roll_deg.to_radians(), 0.0, 0.0]);
        compass.field.push_row(t_s, [20.0, 0.0, -40.0, 20.0, 0.0, -40.0]);
    }
    let (rows, _) = build_rows(&flight, &compass, 0.0, None);
    assert_eq!(rows.len(), 1);
    assert!((rows[0].attitude.roll_rad.to_degrees().abs() - 180.0).abs() < 1e-3, "{}", rows[0].attitude.roll_rad);
}

/// The current is interpolated over a gap of two lost reports at 1 Hz.
#[test]
fn a_current_is_known_near_its_reports_only() {
    let mut flight = level_flight(30);
    for (t_s, amperes) in [(0.0, 10.0), (2.9, 20.0), (12.0, 30.0)] {
        flight.battery_current.push_row(t_s, [amperes]);
    }
    for (t_s, current_a) in [(1.45, Some(15.0)), (7.0, None), (14.0, Some(30.0)), (20.0, None)] {
        assert_eq!(current_at(&flight, t_s), current_a, "{t_s}");
    }
    let (mut rows, _) = build_rows(&flight, &compass_with_readings(0, 30), 0.0, None);
    let correction = FieldCorrection { motor_ut_per_a: Vector3::new(0.5, 0.0, -0.25), ..FieldCorrection::identity() };
    for (current_a, corrected_ut) in [(Some(10.0), [15.0, 0.0, 42.5]), (None, [20.0, 0.0, 40.0])] {
        rows[0].current_a = current_a;
        assert_eq!(rows[0].corrected_field(&correction), Vector3::from(corrected_ut));
    }
}

/// Attitude from roll and pitch as polynomials of time with these coefficients, and body rates of a steady turn with
/// it, during 3 s.
fn polynomial_flight(rate_hz: f64, [roll, pitch]: [[f64; 4]; 2]) -> LoggedFlight {
    const TURN_RATE_RAD_S: f64 = 0.4;
    let slope = |[_, b, c, d]: [f64; 4], t_s: f64| b + t_s * (2.0 * c + t_s * 3.0 * d);
    flight_of_motion(rate_hz, (3.0 * rate_hz) as u16 + 1, |t_s| {
        let euler_rad = Vector3::new(value_at(roll, t_s), value_at(pitch, t_s), 0.0);
        let rates = body_rates_rad_s(&euler_rad, &Vector3::new(slope(roll, t_s), slope(pitch, t_s), TURN_RATE_RAD_S));
        (euler_rad.map(|angle| angle as f32).into(), rates.map(|rate| rate as f32))
    })
}

fn value_at([a, b, c, d]: [f64; 4], t_s: f64) -> f64 {
    a + t_s * (b + t_s * (c + t_s * d))
}

/// Hermite interpolation reproduces cubic polynomials; a line between the reports errs by 0.01 rad and more. Rates in
/// degrees contradict the attitude by far, and are not used.
#[test]
fn a_cubic_motion_is_interpolated_exactly_with_the_body_rates() {
    let motion = [[0.2, 0.3, -0.25, 0.06], [-0.1, -0.2, 0.15, -0.04]];
    let flight = polynomial_flight(2.0, motion);
    let mut in_degrees = flight.clone();
    for row in in_degrees.body_rates.rows_mut() {
        row.row_values = row.row_values.map(f32::to_degrees);
    }
    let [mut largest_deviation, mut largest_error_in_degrees] = [0.0_f64; 2];
    for t_s in (0..30).map(|i| f64::from(i) / 10.0) {
        let [sample, sample_in_degrees] = [&flight, &in_degrees].map(|flight| attitude_at(flight, t_s).unwrap());
        assert_eq!(sample.rates_rad_s, flight.body_rates.interpolate(t_s, 0.5));
        let by_line = flight.attitude.interpolate(t_s, 0.5).unwrap();
        let angles = |sample: &AttitudeSample| [sample.attitude.roll_rad, sample.attitude.pitch_rad].map(f64::from);
        for angle in 0..2 {
            let expected_rad = value_at(motion[angle], t_s);
            assert!((angles(&sample)[angle] - expected_rad).abs() < 1e-6, "{t_s} s, {sample:?}");
            largest_deviation = largest_deviation.max((f64::from(by_line[angle]) - expected_rad).abs());
            largest_error_in_degrees =
                largest_error_in_degrees.max((angles(&sample_in_degrees)[angle] - expected_rad).abs());
        }
    }
    assert!(largest_deviation > 0.01, "{largest_deviation}");
    assert!(largest_error_in_degrees < 0.1, "{largest_error_in_degrees}");
}

/// The mean of linear functions of time is their value at the mean time. Three readings at uneven times make a row.
#[test]
fn a_row_of_several_readings_holds_the_values_of_its_time() {
    let (latency_s, motion) = (0.03, [[0.2, -0.1, 0.0, 0.0], [-0.1, 0.05, 0.0, 0.0]]);
    let field_at = |t_s: f64| [1.0, 2.0, 4.0, 5.0, 7.0, 8.0].map(|axis| (axis * (3.0 - t_s) - 6.0) as f32);
    let mut flight = polynomial_flight(10.0, motion);
    for t_s in [0.0, 3.0] {
        flight.battery_current.push_row(t_s, [(5.0 + 2.0 * t_s) as f32]);
    }
    for i in 0..=30 {
        flight.reference_heading.push_row(f64::from(i) / 10.0, [0.2 * i as f32 / 10.0]);
    }
    let mut compass = LoggedCompass::without_readings(1, Ok(1));
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
}

/// A frozen field while the aircraft rolls; rows that are disarmed are not counted again.
#[test]
fn usable_rows_with_a_frozen_field_are_excluded() {
    let mut flight = flight_of_motion(10.0, 601, |t_s| ([0.03 * libm::sin(t_s) as f32, 0.0, 0.0], [0.0; 3]));
    flight.armed_changes = vec![(19.95, true)];
    let (_, row_counts) = build_rows(&flight, &compass_with_readings(0, 60), 0.0, None);
    assert_eq!((row_counts.disarmed, row_counts.frozen_field, row_counts.used), (200, 400, 0));
}

/// A flight of 200 s at 10 Hz that yaws at a rate. Roll is 0 before the first change and has each value from its time
/// on, seconds and radians.
fn flight_with_roll_changes(yaw_rate_rad_s: f32, changes: &[(f64, f32)]) -> LoggedFlight {
    flight_of_motion(10.0, 2001, |t_s| {
        let roll_rad = changes.iter().take_while(|(from_s, _)| *from_s <= t_s).last().map_or(0.0, |change| change.1);
        ([roll_rad, 0.0, 0.0], [0.0, 0.0, yaw_rate_rad_s])
    })
}

/// A change of tilt that the rates do not explain excludes the window of 1 s in which it occurs. In the first minute the
/// filter of the autopilot aligns itself: all before the change is wrong. A jump is larger than turning can explain;
/// the attitude is wrong until a second jump soon after it.
#[test]
fn an_attitude_that_contradicts_the_rates_is_excluded() {
    for (name, yaw_rate_rad_s, changes, expected) in [
        ("explained by the rates", 0.5, &[(100.0, 0.1)][..], &[][..]),
        ("noise of 1 deg", 0.0, &[(100.0, 0.017)], &[]),
        ("two changes", 0.0, &[(100.0, 0.05), (103.0, 0.0)], &[[99.0, 100.9], [102.0, 103.9]]),
        ("two changes within a window", 0.0, &[(100.0, 0.05), (100.5, 0.0)], &[[99.0, 101.4]]),
        ("alignment", 0.0, &[(40.0, 0.05)], &[[0.0, 40.9]]),
        ("a jump", 0.5, &[(100.0, 0.4)], &[[99.9, 100.0]]),
        ("a jump there and back", 0.5, &[(100.0, 0.4), (102.0, 0.0)], &[[99.9, 102.0], [101.9, 102.0]]),
        ("two distant jumps", 0.5, &[(100.0, 0.4), (110.0, 0.0)], &[[99.9, 100.0], [109.9, 110.0]]),
    ] {
        let intervals_s = intervals_contradicting_rates(&flight_with_roll_changes(yaw_rate_rad_s, changes));
        assert_eq!(intervals_s, expected, "{name}");
    }
    // In a turn of 17 deg/s a jump of 29 deg for two rows is dropped, with the rows about it, and nothing else.
    let jumping = flight_with_roll_changes(0.3, &[(50.0, 0.5), (50.2, 0.0)]);
    let counts = build_rows(&jumping, &compass_with_readings(0, 99), 0.0, None).1;
    assert!((3..=5).contains(&counts.contradicting_attitude), "{counts:?}");
}

/// A change of tilt 18 s after a gap of two seconds in attitude or rates is alignment.
#[test]
fn a_filter_aligns_itself_after_a_gap() {
    let whole = flight_with_roll_changes(0.0, &[(120.0, 0.05)]);
    let [mut without_attitude, mut without_rates] = [whole.clone(), whole.clone()];
    for series in [&mut without_attitude.attitude, &mut without_rates.body_rates] {
        series.retain_rows(|_, row| !(100.05..102.05).contains(&row.t_s));
    }
    for (name, flight, from_s) in [
        ("none", whole, 119.0..119.1),
        ("attitude", without_attitude, 102.0..102.2),
        ("rates", without_rates, 101.9..102.2),
    ] {
        let [[found_s, to_s]] = intervals_contradicting_rates(&flight)[..] else { panic!("a gap of {name}") };
        assert!(from_s.contains(&found_s) && (to_s - 120.9).abs() < 1e-9, "a gap of {name}: {found_s} to {to_s} s");
    }
}

/// A nose-up hover whose belly turns past the sky: roll jumps by 180 deg, and the vertical moves by 4 deg. A row above 75
/// deg of pitch has no Euler heading to be scored by.
#[test]
fn a_vertical_attitude_is_interpolated_by_its_vertical_and_not_scored() {
    for (pitch_deg, rolls_deg, expected_deg) in
        [(88.0_f32, [0.0_f32, 180.0], Some(90.0)), (80.0, [10.0, 10.0], Some(80.0)), (70.0, [10.0, 10.0], None)]
    {
        let mut flight = LoggedFlight::new(LogFormat::Csv);
        for (i, roll_deg) in rolls_deg.into_iter().enumerate() {
            flight.attitude.push_row(i as f64 / 5.0, [roll_deg.to_radians(), pitch_deg.to_radians(), 0.0]);
            flight.reference_heading.push_row(i as f64 / 5.0, [1.0]);
        }
        let (rows, _) = build_rows(&flight, &compass_with_readings(0, 1), 0.0, Some(&ReferenceHeading::Column));
        let row = rows.iter().find(|row| (row.t_s - 0.1).abs() < 1e-6).unwrap();
        assert_eq!(row.reference_deg.is_none(), expected_deg.is_some(), "{pitch_deg}");
        let found_deg = row.attitude.pitch_rad.to_degrees();
        assert!((found_deg - expected_deg.unwrap_or(70.0)).abs() < 0.1, "{pitch_deg}: {found_deg}");
    }
}
