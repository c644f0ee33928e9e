//! Tests of the readers with one flight in every format, intact and damaged.

mod archive;
mod ardupilot;
mod blackbox;
mod decoded;
mod hostile;
mod link;
mod px4;
mod table;
mod table_set;

use autoswing::calibration::Orientation;
use autoswing::earth::Date;
use nalgebra::{Rotation3, Vector3};

use super::csv::FieldUnit;
use super::flight::SkippedCounts;
use super::log_writers::{
    FlightRecording, FlightSample, encode_blackbox, encode_csv, encode_dataflash, encode_dataflash_text, encode_tlog,
    encode_ulog,
};
use super::time_series::TimedRow;
use super::*;
use testkit::random::Random;

/// ArduPilot's parameters of two compasses; every correction is exercised.
const ARDUPILOT_PARAMETERS: [(&str, f64); 22] = [
    ("COMPASS_DEV_ID", 97_539.0),
    ("COMPASS_DEV_ID2", 131_874.0),
    ("COMPASS_PRIO1_ID", 97_539.0),
    ("COMPASS_PRIO2_ID", 131_874.0),
    ("COMPASS_OFS_X", 120.0),
    ("COMPASS_OFS_Y", -60.0),
    ("COMPASS_OFS_Z", 35.0),
    ("COMPASS_DIA_X", 1.1),
    ("COMPASS_DIA_Y", 0.95),
    ("COMPASS_DIA_Z", 1.02),
    ("COMPASS_ODI_X", 0.04),
    ("COMPASS_ODI_Y", -0.03),
    ("COMPASS_ODI_Z", 0.02),
    ("COMPASS_SCALE", 1.2),
    ("COMPASS_MOTCT", 2.0),
    ("COMPASS_MOT_X", 3.0),
    ("COMPASS_MOT_Z", -2.0),
    ("COMPASS_USE", 1.0),
    ("COMPASS_USE2", 0.0),
    ("COMPASS_OFS2_X", -40.0),
    ("COMPASS_DIA2_X", 0.0),
    ("COMPASS_SCALE2", 0.0),
];

const PX4_PARAMETERS: [(&str, f64); 9] = [
    ("CAL_MAG0_ID", 396_809.0),
    ("CAL_MAG1_ID", 263_202.0),
    ("CAL_MAG0_ROT", 2.0),
    ("CAL_MAG0_XOFF", 0.12),
    ("CAL_MAG0_YOFF", -0.05),
    ("CAL_MAG0_ZSCALE", 1.1),
    ("CAL_MAG0_XODIAG", 0.05),
    ("CAL_MAG1_ROT", -1.0),
    ("SENS_BOARD_ROT", 4.0),
];

/// 30 s of turning with two compasses of different hard iron.
fn two_compass_recording(parameters: &[(&str, f64)]) -> FlightRecording {
    let instants = (0..300_u64).map(|i| {
        let t_s = i as f64 / 10.0;
        let (roll, pitch, yaw) = (0.4 * libm::sin(t_s / 3.0), 0.1 * libm::cos(t_s / 2.0), libm::sin(t_s / 4.0) * 3.0);
        let earth = Vector3::new(22.7, 0.0, 44.6);
        let field = Rotation3::from_euler_angles(roll, pitch, yaw).inverse_transform_vector(&earth);
        let second = Vector3::new(field.x * 1.1 + 10.0, field.y, field.z - 20.0);
        FlightSample {
            time_us: 40_000_000 + i * 100_000,
            field_ut: vec![field.into(), second.into()],
            attitude_rad: [roll, pitch, yaw],
            rates_rad_s: [0.1, -0.2, 0.3],
            heading_rad: yaw,
            velocity_m_s: [-9.0, -12.0],
            current_a: 10.0 + t_s / 10.0,
            is_armed: true,
            ..FlightSample::default()
        }
    });
    FlightRecording {
        samples: instants.collect(),
        start_position: Some([48.0, 11.3, 500.0]),
        ..FlightRecording::default()
    }
    .with_parameters(parameters)
}

/// The flight in each format, and the format's field resolution, microtesla.
fn log_in_each_format() -> [(LogFormat, Vec<u8>, f64); 6] {
    let (ardupilot, px4) = (two_compass_recording(&ARDUPILOT_PARAMETERS), two_compass_recording(&PX4_PARAMETERS));
    [
        (LogFormat::DataFlash, encode_dataflash(&ardupilot), 0.12),
        (LogFormat::DataFlashText, encode_dataflash_text(&ardupilot), 0.12),
        (LogFormat::TLog, encode_tlog(&ardupilot), 0.12),
        (LogFormat::ULog, encode_ulog(&px4), 0.001),
        (LogFormat::Csv, encode_csv(&ardupilot), 0.01),
        // Scaled to the strength of the model there, 48.7 uT in place of 50.05.
        (LogFormat::Blackbox, encode_blackbox(&ardupilot), 1.0),
    ]
}

/// Raw field of a row, microtesla.
fn raw_ut(row: &TimedRow<6>) -> Vector3<f64> {
    Vector3::from_row_slice(&row.row_values[..3]).map(f64::from)
}

/// Field of a row as the autopilot corrected it, microtesla.
fn logged_ut(row: &TimedRow<6>) -> Vector3<f64> {
    Vector3::from_row_slice(&row.row_values[3..]).map(f64::from)
}

fn read_bytes(bytes: &[u8]) -> Result<LoggedFlight, LogError> {
    let mut source = bytes;
    only_flight(&mut |visit| visit_unchecked(&mut source, (FieldUnit::Milligauss, None), visit))
}

#[test]
fn every_format_gives_the_raw_field_in_body_axes() {
    let original = two_compass_recording(&[]);
    for (format, bytes, exactly_ut) in log_in_each_format() {
        let flight = read_bytes(&bytes).unwrap();
        assert_eq!(flight.log_format, format);
        let compasses = if matches!(format, LogFormat::Csv | LogFormat::Blackbox) { 1 } else { 2 };
        assert_eq!(
            flight.compasses.iter().map(|compass| compass.compass_number).collect::<Vec<_>>(),
            [1, 2][..compasses],
            "{format:?}"
        );
        for (index, compass) in flight.compasses.iter().enumerate() {
            // Rows before a link's first heartbeat are ignored.
            let skipped_rows = original.samples.len() - compass.field.rows().len();
            assert!(skipped_rows <= 1, "{format:?}: {skipped_rows}");
            for (row, instant) in compass.field.rows().iter().zip(&original.samples[skipped_rows..]) {
                let off_ut = (raw_ut(row) - Vector3::from(instant.field_ut[index])).norm();
                // Bound: the resolution, scaled by the inverse soft-iron matrix.
                assert!(off_ut < exactly_ut * 1.5, "{format:?} compass {}: {off_ut} uT at {}", index + 1, row.t_s);
            }
        }
        let (row, instant) = (&flight.attitude.rows()[100], &original.samples[100]);
        let attitude = Vector3::from(row.row_values).map(f64::from);
        let off_rad = attitude - Vector3::from(instant.attitude_rad);
        // A table has no yaw.
        let angle_count = if format == LogFormat::Csv { 2 } else { 3 };
        // INAV logs tenths of a degree.
        let max_rad = if format == LogFormat::Blackbox { 9e-4 } else { 2e-4 };
        assert!(off_rad.iter().take(angle_count).all(|angle| angle.abs() < max_rad), "{format:?}: {off_rad}");
        let rates = Vector3::from(flight.body_rates.interpolate(row.t_s, 1.0).unwrap());
        assert!((rates - Vector3::new(0.1, -0.2, 0.3)).amax() < 1e-4, "{format:?}: {rates}");
        let [current] = flight.battery_current.interpolate_or_hold(row.t_s, 2.0).unwrap();
        assert!((f64::from(current) - instant.current_a).abs() < 0.1, "{format:?}: {current}");
        let gps = Gps::from_columns(flight.gps.rows()[5].row_values);
        assert!((gps.latitude_deg - 48.0).abs() < 1e-4 && (gps.height_m - 500.0).abs() < 0.1, "{format:?}: {gps:?}");
        let speed_and_course = [gps.speed_m_s, gps.course_deg.rem_euclid(360.0)];
        let is_right = (speed_and_course[0] - 15.0).abs() < 0.01 && (speed_and_course[1] - 233.13).abs() < 0.04;
        assert!(is_right, "{format:?}: {gps:?}");
        assert_eq!(flight.skipped_counts, SkippedCounts::default(), "{format:?}");
        assert!(!flight.is_copter, "{format:?}");
        assert!(flight.true_attitude.is_empty() || format == LogFormat::Csv);
    }
}

#[test]
fn autopilot_firmware_and_armed_state_are_read() {
    let flights = log_in_each_format().map(|(_, bytes, _)| read_bytes(&bytes).unwrap());
    let [bin, text, link, px4, table, inav] = flights;
    for flight in [&bin, &text] {
        assert_eq!(flight.firmware_name.as_deref(), Some("ArduPlane V4.6.0 (host-sim)"));
    }
    assert_eq!(px4.firmware_name.as_deref(), Some("PX4 1.15.0"));
    assert_eq!(inav.firmware_name.as_deref(), Some("INAV 8.0.1 (host-sim)"));
    assert_eq!(
        [bin.autopilot, link.autopilot, px4.autopilot, inav.autopilot],
        [AutopilotKind::ArduPilot, AutopilotKind::ArduPilot, AutopilotKind::Px4, AutopilotKind::Inav]
    );
    assert_eq!(bin.compasses[0].is_used_for_heading.zip(bin.compasses[1].is_used_for_heading), Some((true, false)));
    assert_eq!(
        [&bin, &link, &px4, &table, &inav].map(|flight| flight.flight_date.map(Date::year_month_day)),
        [Some((2026, 1, 4)), Some((2026, 1, 4)), Some((2026, 1, 4)), None, Some((2026, 1, 4))]
    );
    assert_eq!((link.is_armed(45.0), table.is_armed(45.0), bin.is_armed(45.0)), (Some(true), Some(true), None));
}

#[test]
fn a_copter_is_identified_in_every_format() {
    let copter = |parameters| FlightRecording { is_copter: true, ..two_compass_recording(parameters) };
    let (ardupilot, px4) = (copter(&ARDUPILOT_PARAMETERS), copter(&PX4_PARAMETERS));
    for bytes in [
        encode_dataflash(&ardupilot),
        encode_dataflash_text(&ardupilot),
        encode_tlog(&ardupilot),
        encode_ulog(&px4),
        encode_blackbox(&ardupilot),
    ] {
        let flight = read_bytes(&bytes).unwrap();
        assert!(flight.is_copter, "{:?}", flight.log_format);
    }
}

#[test]
fn unknown_and_empty_logs_are_rejected() {
    assert!(matches!(read_bytes(b""), Err(LogError::Empty)));
    for bytes in [&b"hello"[..], b"time,x\n1,2\n", b"\x89PNG\r\n\x1a\n0000000000000000", &[0; 5000]] {
        assert!(matches!(read_bytes(bytes), Err(LogError::UnknownFormat)), "{bytes:?}");
    }
    let empty_recording = FlightRecording { samples: Vec::new(), ..two_compass_recording(&[]) };
    assert!(matches!(
        read_bytes(&encode_dataflash(&empty_recording)),
        Err(LogError::NoMagnetometer(LogFormat::DataFlash, 0))
    ));
    assert!(matches!(read_bytes(&encode_ulog(&empty_recording)), Err(LogError::NoMagnetometer(LogFormat::ULog, 0))));
}

#[test]
fn damage_in_the_middle_costs_few_rows() {
    for (format, bytes, _) in log_in_each_format() {
        let undamaged_rows = read_bytes(&bytes).unwrap().compasses[0].field.rows().len();
        let mut damaged = bytes.clone();
        let middle_byte = bytes.len() / 2;
        damaged.splice(middle_byte..middle_byte, *b"\n\x00garbage\xff\xa3\x95\xfd\n");
        let flight = read_bytes(&damaged).unwrap();
        let rows = flight.compasses[0].field.rows().len();
        assert!(
            rows + 12 >= undamaged_rows && flight.skipped_counts.garbage > 0,
            "{format:?}: {rows} of {undamaged_rows}, {:?}",
            flight.skipped_counts
        );
        let cut = read_bytes(&bytes[..=bytes.len() * 3 / 4]).unwrap();
        assert!(cut.compasses[0].field.rows().len() > undamaged_rows * 2 / 3, "{format:?}");
    }
}

/// Without the first 40 bytes a log is read; without all that defines its messages the cause is named.
#[test]
fn a_log_without_its_start_is_read_or_named() {
    for (format, bytes, _) in log_in_each_format() {
        if !matches!(format, LogFormat::DataFlash | LogFormat::ULog) {
            continue;
        }
        let rows = |bytes: &[u8]| read_bytes(bytes).map(|flight| flight.compasses[0].field.rows().len());
        assert!(rows(&bytes[40..]).unwrap() + 3 > rows(&bytes).unwrap(), "{format:?}");
        let error = rows(&bytes[bytes.len() / 2 + 7..]).unwrap_err().to_string();
        assert!(error.contains("start of the file is missing"), "{format:?}: {error}");
    }
}

#[test]
fn a_restart_within_a_log_continues_ten_seconds_later() {
    let mut doubled_recording = two_compass_recording(&ARDUPILOT_PARAMETERS);
    let mut repeated_samples = doubled_recording.samples.clone();
    for instant in &mut repeated_samples {
        instant.time_us -= 35_000_000;
    }
    doubled_recording.samples.extend(repeated_samples);
    for bytes in [
        encode_dataflash(&doubled_recording),
        encode_dataflash_text(&doubled_recording),
        encode_csv(&doubled_recording),
        encode_ulog(&doubled_recording),
    ] {
        let flight = read_bytes(&bytes).unwrap();
        assert_eq!(flight.skipped_counts.restarts, 1);
        let rows = flight.compasses[0].field.rows();
        assert!(rows.len() >= 598, "{}", rows.len());
        let steps: Vec<f64> =
            rows.windows(2).map(|pair| pair[1].t_s - pair[0].t_s).filter(|step| *step > 1.0).collect();
        assert!(steps.len() == 1 && steps[0] > 9.0 && steps[0] < 12.0, "{steps:?}");
    }
}

/// The sensors of both compasses in fact are turned by another 90 deg.
#[test]
fn a_given_orientation_replaces_the_logged_one() {
    let turn = Rotation3::from_axis_angle(&Vector3::z_axis(), std::f64::consts::FRAC_PI_2);
    let log_with = |parameters: &[(&str, f64)], names: [&str; 2]| {
        two_compass_recording(&[parameters, &names.map(|name| (name, 2.0))].concat())
    };
    let (ardupilot_names, px4_names) = (["COMPASS_ORIENT", "COMPASS_ORIENT2"], ["CAL_MAG0_ROT", "CAL_MAG1_ROT"]);
    for (bytes, names) in [
        (encode_dataflash(&log_with(&ARDUPILOT_PARAMETERS, ardupilot_names)), ardupilot_names),
        (encode_ulog(&log_with(&PX4_PARAMETERS, px4_names)), px4_names),
    ] {
        let logged = read_bytes(&bytes).unwrap();
        let mut given = logged.clone();
        given.set_orientation(Orientation::from_name("yaw180").unwrap(), Some(1)).unwrap();
        assert_eq!(names.map(|name| given.parameters.last_value(name)), [Some(4.0), Some(2.0)]);
        assert_eq!(given.compasses[1].field.rows(), logged.compasses[1].field.rows());
        let [one, other] = [&given, &logged].map(|flight| &flight.compasses[0]);
        for (one_row, other_row) in one.field.rows().iter().zip(other.field.rows()) {
            assert!((raw_ut(one_row) - turn * raw_ut(other_row)).norm() < 1e-4, "{one_row:?} {other_row:?}");
            assert_eq!(logged_ut(one_row), logged_ut(other_row));
            let [one_ut, other_ut] = [(one, one_row), (other, other_row)]
                .map(|(compass, row)| compass.correction.as_ref().unwrap().correct_field(raw_ut(row), 10.0));
            assert!((one_ut - other_ut).norm() < 1e-4, "{one_ut} {other_ut}");
        }
    }
    let internal = two_compass_recording(&[&ARDUPILOT_PARAMETERS[..], &[("COMPASS_EXTERNAL", 0.0)]].concat());
    let mut internal = read_bytes(&encode_dataflash(&internal)).unwrap();
    let orientation = Orientation::from_name("yaw180").unwrap();
    assert_eq!(internal.set_orientation(orientation, None), Err(1));
    assert_eq!(internal.set_orientation(orientation, Some(2)), Ok(()));
}

#[test]
fn a_log_of_a_known_format_that_is_not_read_is_named() {
    let sdlog2 = [&[0xA3, 0x95, 0x80, 129, 11][..], b"TIME\x51", &[0; 15], b"StartTime", &[0; 55]].concat();
    let dji = [&[0; 16][..], b"BUILDJul 28 2018"].concat();
    for (bytes, name) in [
        (sdlog2.as_slice(), "sdlog2"),
        (b"#ROSBAG V2.0\n", "ROS bag"),
        (b"\x89MCAP0\r\n\x01", "ROS 2 bag"),
        (b"MATLAB 5.0 MAT-file, Platform: GLNXA64", "MATLAB"),
        (&dji, "DJI"),
    ] {
        let error = read_bytes(bytes).unwrap_err();
        assert!(matches!(error, LogError::UnreadFormat(_)) && error.to_string().contains(name), "{error}");
    }
}

/// Two outputs, of which one is constant, the currents of two speed controllers, and that of a second battery.
#[test]
fn loads_are_read_from_each_format_that_logs_them() {
    let with_loads = |parameters: &[(&str, f64)]| {
        let mut recording = two_compass_recording(parameters);
        for (i, sample) in recording.samples.iter_mut().enumerate() {
            let fraction = i as f64 / 400.0;
            sample.outputs = vec![fraction, 0.5];
            sample.esc_currents_a = vec![10.0 + fraction, 20.0 + fraction];
            sample.further_currents_a = vec![5.0 + fraction];
        }
        recording
    };
    let (ardupilot, px4) = (with_loads(&ARDUPILOT_PARAMETERS), with_loads(&PX4_PARAMETERS));
    let expected = [
        (LoadSource::Battery(2), 5.0),
        (LoadSource::Esc(1), 10.0),
        (LoadSource::Esc(2), 20.0),
        (LoadSource::Output(1), 0.0),
    ];
    for bytes in
        [encode_dataflash(&ardupilot), encode_dataflash_text(&ardupilot), encode_tlog(&ardupilot), encode_ulog(&px4)]
    {
        let flight = read_bytes(&bytes).unwrap();
        assert_eq!(flight.loads.len(), expected.len(), "{:?}: {:?}", flight.log_format, flight.loads.len());
        for ((found, values), (source, first)) in flight.loads.iter().zip(expected) {
            let [value] = values.interpolate(60.0, 1.0).unwrap();
            assert_eq!(*found, source, "{:?}", flight.log_format);
            assert!((f64::from(value) - first - 0.5).abs() < 0.05, "{:?} {source:?}: {value}", flight.log_format);
        }
    }
}
