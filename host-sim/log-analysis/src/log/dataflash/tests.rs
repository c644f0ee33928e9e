use super::messages::*;
use crate::log::flight::{AttitudeView, Gps, LogFormat};
use crate::log::time_series::TimedRow;
use crate::log::vtol_view::VtolView;

struct NumericMessage<'a>(&'a [(&'a str, f64)]);

impl LogMessage for NumericMessage<'_> {
    fn numeric_field(&self, name: &str) -> Option<f64> {
        self.0.iter().find(|(column, _)| *column == name).map(|(_, number)| *number)
    }

    fn has_column(&self, name: &str) -> bool {
        self.numeric_field(name).is_some()
    }

    fn text_field(&self, _: &str) -> Option<String> {
        None
    }

    fn is_plain_integer(&self, _: &str) -> bool {
        false
    }
}

fn read_messages<'a, C: AsRef<[(&'a str, f64)]>>(messages: &[(&str, C)]) -> crate::log::LoggedFlight {
    let mut builder = ardupilot_builder(LogFormat::DataFlash);
    for (name, numbers) in messages {
        record_message(&mut builder, name, &NumericMessage(numbers.as_ref()));
    }
    builder.finish_flight()
}

#[test]
fn the_gyro_bias_is_subtracted() {
    let flight = read_messages::<&[_]>(&[
        ("XKF1", &[("TimeUS", 1e6), ("GX", 1.0), ("GY", -2.0), ("GZ", 0.5)]),
        ("IMU", &[("TimeUS", 1.1e6), ("GyrX", 0.1), ("GyrY", 0.2), ("GyrZ", 0.3)]),
    ]);
    let expected = [0.1 - 1_f32.to_radians(), 0.2 + 2_f32.to_radians(), 0.3 - 0.5_f32.to_radians()];
    let [row] = flight.body_rates.rows() else { panic!("{:?}", flight.body_rates) };
    assert!(row.row_values.iter().zip(expected).all(|(rate, expected)| (rate - expected).abs() < 1e-6), "{row:?}");
}

/// CURR is the current message of logs before BAT; a 2D fix is rejected; yaw 0 means a single antenna.
#[test]
fn the_old_current_message_is_read_and_2d_fixes_are_rejected() {
    let fix = |time_us: f64, status: f64| {
        let position_columns =
            [("Lat", 48.0), ("Lng", 11.0), ("Alt", 500.0), ("Spd", 9.0), ("GCrs", 45.0), ("Yaw", 0.0)];
        [&[("TimeUS", time_us), ("Status", status)][..], &position_columns].concat()
    };
    let flight = read_messages::<&[_]>(&[
        ("CURR", &[("TimeUS", 1e6), ("Curr", 12.5)]),
        ("GPS", &fix(1.1e6, 2.0)),
        ("GPS", &fix(1.2e6, 3.0)),
    ]);
    let [current] = flight.battery_current.rows() else { panic!("{:?}", flight.battery_current) };
    assert!((current.row_values[0] - 12.5).abs() < 1e-6, "{current:?}");
    let [row] = flight.gps.rows() else { panic!("{:?}", flight.gps) };
    assert!(Gps::from_columns(row.row_values).yaw_deg.is_nan(), "{row:?}");
}

/// A message with roll, pitch 5 and yaw 30 deg.
fn attitude_message(name: &str, time_us: f64, roll_deg: f64) -> (&str, Vec<(&'static str, f64)>) {
    (name, vec![("TimeUS", time_us), ("Roll", roll_deg), ("Pitch", 5.0), ("Yaw", 30.0)])
}

#[test]
fn filter_attitude_replaces_a_missing_att_message() {
    let rolls = |flight: &crate::log::LoggedFlight| {
        flight.attitude.rows().iter().map(|row| row.row_values[0].to_degrees().round() as i32).collect::<Vec<_>>()
    };
    let mut second_core = attitude_message("XKF1", 1.1e6, 12.0);
    second_core.1.push(("C", 1.0));
    let mut messages = vec![attitude_message("AHR2", 1e6, 20.0), attitude_message("XKF1", 1.05e6, 11.0), second_core];
    let flight = read_messages(&messages);
    assert_eq!((rolls(&flight), flight.fallback_attitude_message), (vec![11], Some("XKF1")));
    let flight = read_messages(&messages[..1]);
    assert_eq!((rolls(&flight), flight.fallback_attitude_message), (vec![20], Some("AHR2")));
    messages.push(attitude_message("ATT", 1.2e6, 10.0));
    let flight = read_messages(&messages);
    assert_eq!((rolls(&flight), flight.fallback_attitude_message), (vec![10], None));
}

/// `Q_ENABLE` 1 is a quadplane, whose `ATT` is that of hover; AHR2 is another filter's.
#[test]
fn the_attitude_of_the_body_replaces_the_vtol_view() {
    let messages = [
        attitude_message("AHR2", 1e6, 20.0),
        attitude_message("ATT", 1.1e6, 10.0),
        attitude_message("XKF1", 1.2e6, 11.0),
    ];
    for (q_enable, count, roll_deg, attitude_view) in [
        (Some(1.0), 3, 11, AttitudeView::BodyForVtol("XKF1")),
        (Some(1.0), 2, 10, AttitudeView::Vtol(VtolView::Unknown("Q_TAILSIT_ENABLE"))),
        (Some(0.0), 3, 10, AttitudeView::Body),
        (None, 3, 10, AttitudeView::Body),
    ] {
        let mut builder = ardupilot_builder(LogFormat::DataFlash);
        if let Some(enabled) = q_enable {
            builder.set_parameter("Q_ENABLE", enabled);
        }
        for (name, numbers) in &messages[..count] {
            record_message(&mut builder, name, &NumericMessage(numbers));
        }
        let flight = builder.finish_flight();
        let [row] = flight.attitude.rows() else { panic!("{:?}", flight.attitude) };
        assert_eq!(row.row_values[0].to_degrees().round() as i32, roll_deg, "{q_enable:?} {count}");
        assert_eq!((flight.attitude_view, flight.fallback_attitude_message), (attitude_view, None));
    }
}

#[test]
fn the_best_substitute_attitude_is_used() {
    let root_half = 0.5_f64.sqrt();
    let q = |time_us: f64, core: f64| {
        vec![("TimeUS", time_us), ("C", core), ("Q1", root_half), ("Q2", root_half), ("Q3", 0.0), ("Q4", 0.0)]
    };
    let mut messages = Vec::new();
    for name in ["AHR2", "NKQ", "XKQ", "NKF1", "XKF1"] {
        let time_us = 1e6 + 1e5 * messages.len() as f64;
        let is_quaternion = name.ends_with('Q');
        messages.push(if is_quaternion { (name, q(time_us, 0.0)) } else { attitude_message(name, time_us, 20.0) });
        let best_source = read_messages(&messages).fallback_attitude_message;
        assert_eq!(best_source, Some(name));
    }
    // A quaternion of a roll by 90 deg; the second core is not used.
    assert!(read_messages(&[("XKQ", &q(1e6, 1.0))]).attitude.is_empty());
    let flight = read_messages(&[("XKQ", &q(1e6, 0.0))]);
    let [row] = flight.attitude.rows() else { panic!("{:?}", flight.attitude) };
    assert!((row.row_values[0].to_degrees() - 90.0).abs() < 1e-3 && row.row_values[2].abs() < 1e-6, "{row:?}");
}

#[test]
fn rows_without_time_get_the_time_of_the_previous_row() {
    let mag = |x: f64| [("MagX", x), ("MagY", 0.0), ("MagZ", 400.0)];
    let imu = |time_ms: f64| [("TimeMS", time_ms), ("GyrX", 0.0), ("GyrY", 0.0), ("GyrZ", 0.0)];
    let attitude = [("Roll", 1.0), ("Pitch", 2.0), ("Yaw", 3.0)];
    let flight = read_messages::<&[_]>(&[
        ("MAG", &mag(100.0)),
        ("IMU", &imu(5000.0)),
        ("MAG", &mag(200.0)),
        ("MAG", &mag(300.0)),
        ("ATT", &attitude),
        ("IMU", &imu(5100.0)),
        ("MAG", &mag(400.0)),
    ]);
    let time_and_x = |row: &TimedRow<6>| ((row.t_s * 1e3).round() as i32, row.row_values[0] as i32);
    let rows: Vec<(i32, i32)> = flight.compasses[0].field.rows().iter().map(time_and_x).collect();
    assert_eq!(rows, [(5000, 20), (5100, 40)]);
    assert_eq!((flight.attitude.rows().len(), flight.rows_without_time), (1, 4));
    let flight = read_messages::<&[_]>(&[("MAG", &mag(100.0)), ("ATT", &attitude)]);
    assert!(flight.compasses.is_empty() && flight.rows_without_time == 1);
    let damaged = [("TimeUS", -1.0), ("MagX", 100.0), ("MagY", 0.0), ("MagZ", 400.0)];
    assert!(read_messages::<&[_]>(&[("IMU", &imu(5000.0)), ("MAG", &damaged)]).compasses.is_empty());
}

/// Offsets within 1.5 mG of the parameter are rounding.
#[test]
fn offsets_estimated_in_flight_are_undone_per_row() {
    let row = |time_us: f64, x: f64, offset: f64| {
        let field = [("TimeUS", time_us), ("MagX", x), ("MagY", 0.0), ("MagZ", 400.0)];
        [&field[..], &[("OfsX", offset), ("OfsY", 0.0), ("OfsZ", 0.0)]].concat()
    };
    let mut builder = ardupilot_builder(LogFormat::DataFlash);
    builder.set_parameter("COMPASS_OFS_X", 30.7);
    for numbers in [row(1e6, 230.7, 30.0), row(1.1e6, 240.0, 40.0), row(1.2e6, 215.0, 15.0)] {
        record_message(&mut builder, "MAG", &NumericMessage(&numbers));
    }
    let flight = builder.finish_flight();
    for row in flight.compasses[0].field.rows() {
        assert!((row.row_values[0] - 20.0).abs() < 1e-4, "{row:?}");
    }
}
