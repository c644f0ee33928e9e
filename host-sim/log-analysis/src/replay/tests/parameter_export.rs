use autoswing::calibration::Calibration;
use autoswing::frames::{Field, Level, RollPitch};
use nalgebra::{Matrix3, Rotation3, Vector3};

use super::*;
use crate::log::CustomRotation;
use crate::numbers::{mean, rms};
use crate::replay::parameter_export::orientation::{FixedOrientation, OrientationParameters};
use crate::replay::parameter_export::{
    HeldBackScore, field_by_exported_parameters, format_parameter_file, may_compensate_current,
};
use crate::score::wrap_180;

fn export_module(compass: &CompassEvaluation, format: ParameterFormat) -> ExportedCorrection {
    let calibration = &compass.parameter_fit.solution().unwrap().calibration;
    export_inputs(&compass.rows, format).export_simplest(calibration).unwrap().1
}

fn set_coefficients(calibration: &mut Calibration, matrix: &Matrix3<f64>, hard_iron_ut: &Vector3<f64>) {
    calibration.w = std::array::from_fn(|i| std::array::from_fn(|j| matrix[(i, j)] as f32));
    calibration.b_ut = hard_iron_ut.map(|axis| axis as f32).into();
}

/// Turns at one bank leave a scale and an offset along z that cancel each other there. The sensor is turned by
/// 1.5, -2 and 4 deg; the best symmetric matrix has 2.0 deg RMS over banks to 45 deg, that of the flown rows alone 5.9.
#[test]
fn parameters_hold_at_attitudes_that_were_not_flown() {
    let (_, mut compass) = compass_of_flown_turns();
    let calibration = &mut compass.parameter_fit.fit.as_mut().unwrap().solution.calibration;
    let turn = Rotation3::from_euler_angles(0.026, -0.035, 0.07);
    let soft_iron = Matrix3::new(1.08, 0.02, 0.01, 0.02, 0.95, -0.04, 0.01, -0.04, 1.02);
    let measured = turn.matrix().transpose() * soft_iron;
    let hard_iron_ut = Vector3::new(12.0, -8.5, 20.0);
    let correction_matrix = measured.try_inverse().unwrap();
    set_coefficients(calibration, &correction_matrix, &hard_iron_ut);
    let Calibration { total_ut, inclination_rad, .. } = *calibration;
    let field = |attitude: &RollPitch, heading_deg: f32| {
        let level_field = Field::<Level>::earth_field(total_ut, inclination_rad, heading_deg.to_radians());
        let raw = measured * attitude.to_body_frame(level_field).ut.map(f64::from) + hard_iron_ut;
        Field::new(raw.map(|axis| axis as f32))
    };
    compass.rows.retain(|row| row.attitude.roll_rad.abs() < 0.5);
    for (i, row) in compass.rows.iter_mut().enumerate() {
        row.raw_field = field(&row.attitude, i as f32);
    }
    let export = export_module(&compass, ParameterFormat::ArduPilot);
    let mut errors_deg = Vec::new();
    for bank_deg in [-40.0, -20.0, 0.0, 20.0, 40.0] {
        for pitch_deg in [-10.0, 10.0] {
            for heading_deg in (0_u8..24).map(|i| f32::from(i) * 15.0) {
                let attitude = RollPitch::from_deg(bank_deg, pitch_deg);
                let row = ReplayRow { raw_field: field(&attitude, heading_deg), attitude, ..compass.rows[0] };
                let exported_deg = row::heading_deg(&row, row.corrected_field(&export.correction));
                errors_deg.push(wrap_180(exported_deg - f64::from(heading_deg)));
            }
        }
    }
    let mean_deg = mean(errors_deg.iter().copied());
    let rms_deg = rms(errors_deg.iter().map(|error| error - mean_deg));
    assert!(rms_deg < 2.5, "{rms_deg}: {}", export.correction.matrix);
    let matrix_difference =
        export.correction.matrix - correction_matrix * (export.correction.matrix.trace() / correction_matrix.trace());
    assert!(matrix_difference.diagonal().amax() < 0.1, "{}", export.correction.matrix);
}

#[test]
fn inavs_offsets_include_interference_at_the_mean_current() {
    let (_, mut compass) = compass_of_flown_turns();
    let motor_ut_per_a = Vector3::new(0.5_f32, -0.3, 0.0);
    let calibration = &mut compass.parameter_fit.fit.as_mut().unwrap().solution.calibration;
    (calibration.motor_current.ut_per_a, calibration.motor_current.mean_current_a) = (motor_ut_per_a.into(), 20.0);
    for row in &mut compass.rows {
        row.current_a = Some(20.0);
        row.raw_field.ut += motor_ut_per_a * 20.0;
    }
    let exported = |format| export_module(&compass, format);
    let (inav, ardupilot) = (exported(ParameterFormat::Inav), exported(ParameterFormat::ArduPilot));
    let added_ut = inav.correction.hard_iron_ut - ardupilot.correction.hard_iron_ut;
    assert!((added_ut.xy() - Vector3::new(10.0, -6.0, 0.0).xy()).norm() < 1.0, "{added_ut}");
    assert_eq!(inav.correction.motor_ut_per_a, Vector3::zeros());
    let warns_of_current = |export: &ExportedCorrection| {
        export.warnings.iter().any(|warning| warning.contains("motor-current interference"))
    };
    assert!(warns_of_current(&inav) && !warns_of_current(&ardupilot), "{:?} {:?}", inav.warnings, ardupilot.warnings);
}

fn export_of_compass(compass_number: u8) -> ExportedCorrection {
    ExportedCorrection { compass_number, ..export_of(FieldCorrection::identity()) }
}

/// Flight with three compasses, numbered as their slots.
fn flight_with_parameters(format: ParameterFormat, parameters: &[(&str, f64)]) -> LoggedFlight {
    let compass = |compass_number| {
        let index = compass_number - u8::from(format == ParameterFormat::Px4);
        log::LoggedCompass::without_readings(compass_number, Ok(index))
    };
    LoggedFlight {
        compasses: [1, 2, 3].map(compass).into(),
        parameters: log::ParameterHistory::of_values(parameters),
        ..LoggedFlight::new(log::LogFormat::DataFlash)
    }
}

fn parameter_lines(
    parameters: &[(&str, f64)],
    export: &[ExportedCorrection],
    format: ParameterFormat,
    filter_text: &str,
) -> Vec<String> {
    format_parameter_file(&flight_with_parameters(format, parameters), export, format)
        .lines()
        .filter(|line| line.contains(filter_text))
        .map(str::to_owned)
        .collect()
}

/// A flight of an autopilot by its firmware, with these parameters.
fn flight_of_firmware(format: ParameterFormat, firmware_name: &str, parameters: &[(&str, f64)]) -> LoggedFlight {
    let mut flight = flight_with_parameters(format, parameters);
    flight.autopilot =
        if format == ParameterFormat::Px4 { log::AutopilotKind::Px4 } else { log::AutopilotKind::ArduPilot };
    flight.firmware_name = Some(firmware_name.to_owned());
    flight
}

/// The export of a compass of slot 1 or index 0 whose sensor is turned by angles against its orientation in the log,
/// degrees, with the simplest orientation and the fields that it is for.
fn export_of_turned(
    flight: &LoggedFlight,
    format: ParameterFormat,
    angles_deg: [f64; 3],
) -> (ExportedCorrection, Vec<ReplayRow>) {
    let (_, mut compass) = compass_of_flown_turns();
    let [roll, pitch, yaw] = angles_deg.map(f64::to_radians);
    let correction_matrix = Rotation3::from_euler_angles(roll, pitch, yaw).matrix() * SYMMETRIC;
    let (hard_iron_ut, motor_ut_per_a) = (Vector3::new(12.0, -8.5, 20.0), Vector3::new(0.3, -0.2, 0.15));
    let calibration = &mut compass.parameter_fit.fit.as_mut().unwrap().solution.calibration;
    set_coefficients(calibration, &correction_matrix, &hard_iron_ut);
    calibration.motor_current.ut_per_a = motor_ut_per_a.map(|axis| axis as f32).into();
    (calibration.total_ut, calibration.inclination_rad, calibration.motor_current.mean_current_a) = (50.0, 1.0, 15.0);
    for (i, row) in (0_u16..).zip(&mut compass.rows) {
        let heading_deg = f32::from(i % 360);
        let level_field = Field::<Level>::earth_field(50.0, 1.0, heading_deg.to_radians());
        let current_a = f64::from(i % 31);
        let raw = correction_matrix.try_inverse().unwrap() * row.attitude.to_body_frame(level_field).ut.map(f64::from);
        row.raw_field = Field::new((raw + hard_iron_ut + motor_ut_per_a * current_a).map(|axis| axis as f32));
        (row.current_a, row.reference_deg) = (Some(current_a as f32), Some(f64::from(heading_deg)));
    }
    let orientation = OrientationParameters::from_log(flight, 1, format, &[]);
    let inputs = ExportInputs { total_ut: Some(47.5), orientation, ..export_inputs(&compass.rows, format) };
    (inputs.export_simplest(calibration).unwrap().1, compass.rows)
}

const EXTERNAL: (&str, f64) = ("COMPASS_EXTERNAL", 1.0);

/// Firmware, parameters of the log, rotation of the sensor, and what orients it in the file, besides the angles.
type OrientationCase =
    (ParameterFormat, &'static str, &'static [(&'static str, f64)], [f64; 3], &'static [&'static str]);

/// The file of a turned sensor is exact: headings are right at all rows, and the field has the strength of the Earth's,
/// by the autopilot's formula with the digits of the file. Yaw 90 (2) onto yaw 90 is yaw 180 (4).
#[test]
fn a_turned_sensor_is_oriented_by_the_simplest_parameters() {
    use ParameterFormat::{ArduPilot, Px4};
    const PX4_ANGLES: &[(&str, f64)] = &[("CAL_MAG0_ROT", 2.0), ("CAL_MAG0_ROLL", 0.0), ("SENS_BOARD_Y_OFF", 5.0)];
    let cases: [OrientationCase; 13] = [
        (ArduPilot, "V4.6.0", &[EXTERNAL, ("COMPASS_ORIENT", 6.0)], [0.0; 3], &["COMPASS_ORIENT,6"]),
        (ArduPilot, "V4.6.0", &[EXTERNAL, ("COMPASS_ORIENT", 2.0)], [0.0, 0.0, 90.0], &["COMPASS_ORIENT,4"]),
        (ArduPilot, "V4.6.0", &[EXTERNAL, ("COMPASS_ORIENT", 2.0)], [0.0, 0.0, -45.0], &["COMPASS_ORIENT,1"]),
        (ArduPilot, "V4.6.0", &[EXTERNAL, ("COMPASS_ORIENT", 0.0)], [0.0, 180.0, 90.0], &["COMPASS_ORIENT,14"]),
        (ArduPilot, "V3.6.0", &[EXTERNAL, ("COMPASS_ORIENT", 0.0)], [90.0, 0.0, 0.0], &["COMPASS_ORIENT,16"]),
        (
            ArduPilot,
            "V4.6.0",
            &[EXTERNAL, ("COMPASS_ORIENT", 2.0)],
            [0.0, 0.0, 30.0],
            &["CUST_ROT_ENABLE,1", "CUST_ROT1_ROLL,0", "CUST_ROT1_PITCH,0", "CUST_ROT1_YAW,120", "COMPASS_ORIENT,101"],
        ),
        (
            ArduPilot,
            "V4.2.3",
            &[EXTERNAL, ("COMPASS_ORIENT", 0.0)],
            [20.0, 0.0, 30.0],
            &["COMPASS_CUS_ROLL,20", "COMPASS_CUS_PIT,0", "COMPASS_CUS_YAW,30", "COMPASS_ORIENT,100"],
        ),
        (
            ArduPilot,
            "V4.6.0",
            &[EXTERNAL, ("COMPASS_ORIENT", 102.0), ("CUST_ROT2_YAW", 10.0), ("AHRS_ORIENTATION", 101.0)],
            [0.0, 0.0, 20.0],
            &["CUST_ROT_ENABLE,1", "CUST_ROT2_ROLL,0", "CUST_ROT2_PITCH,0", "CUST_ROT2_YAW,30", "COMPASS_ORIENT,102"],
        ),
        (Px4, "PX4 1.13.0", &[("CAL_MAG0_ROT", 2.0)], [0.0, 0.0, 90.0], &["CAL_MAG0_ROT\t4"]),
        (Px4, "PX4 1.13.0", &[("CAL_MAG0_ROT", -1.0)], [0.0; 3], &[]),
        (
            Px4,
            "PX4 1.13.0",
            PX4_ANGLES,
            [0.0, 30.0, 30.0],
            &["CAL_MAG0_ROT\t100", "CAL_MAG0_ROLL\t", "CAL_MAG0_PITCH\t", "CAL_MAG0_YAW\t"],
        ),
        (
            Px4,
            "PX4 1.15.0",
            &[("CAL_MAG0_ROT", 0.0)],
            [0.0, 0.0, -30.0],
            &["CAL_MAG0_ROT\t100", "CAL_MAG0_ROLL\t0", "CAL_MAG0_PITCH\t0", "CAL_MAG0_YAW\t-30"],
        ),
        (
            Px4,
            "PX4 1.15.0",
            &[("CAL_MAG0_ROT", 100.0), ("CAL_MAG0_YAW", 30.0)],
            [0.0, 0.0, 60.0],
            &["CAL_MAG0_ROT\t2", "CAL_MAG0_ROLL\t0", "CAL_MAG0_PITCH\t0", "CAL_MAG0_YAW\t0"],
        ),
    ];
    for (format, firmware, parameters, angles_deg, expected) in cases {
        let flight = flight_of_firmware(format, firmware, parameters);
        let (export, rows) = export_of_turned(&flight, format, angles_deg);
        let text = format_parameter_file(&flight, std::slice::from_ref(&export), format);
        let orients =
            |line: &&str| ["ORIENT", "_ROT", "CUS", "ROLL", "PITCH", "YAW"].iter().any(|part| line.contains(part));
        let lines: Vec<&str> = text.lines().filter(|line| !line.starts_with('#')).filter(orients).collect();
        let is_right = |(line, expected): (&&str, &&str)| line.trim_start_matches("1\t1\t").starts_with(expected);
        let about = format!("{format:?} {firmware} {parameters:?} {angles_deg:?}: {lines:?}");
        assert!(lines.len() == expected.len() && lines.iter().zip(expected).all(is_right), "{about}");
        let is_turned = angles_deg.iter().any(|deg| *deg != 0.0);
        assert_eq!(export.warnings.iter().any(|warning| warning.contains("is turned by")), is_turned, "{about}");
        let field = field_by_exported_parameters(&flight, &export, format);
        for row in &rows {
            let corrected = field(row);
            let error_deg = wrap_180(heading_deg(row, corrected) - row.reference_deg.unwrap());
            // The file has five decimals of the matrix, three of the interference, and two of the angles.
            assert!(
                (corrected.norm() - 47.5).abs() < 0.01 && error_deg.abs() < 0.05,
                "{about} {corrected} {error_deg}"
            );
        }
    }
}

/// Why a file gives no rotation by any angles: docs/how-replay-works.md.
#[test]
fn an_orientation_that_parameters_do_not_express_is_left() {
    use ParameterFormat::{ArduPilot, Inav, Px4};
    const ORIENT: (&str, f64) = ("COMPASS_ORIENT", 0.0);
    const CAN_NODE: [(&str, f64); 2] = [("COMPASS_DEV_ID", 97_539.0), ("COMPASS_CUS_ROLL", 0.0)];
    let none_free = [EXTERNAL, ORIENT, ("AHRS_ORIENTATION", 101.0), ("CUST_ROT2_PITCH", 10.0)];
    for (format, firmware, parameters, reason) in [
        (ArduPilot, "V4.6.0", &[EXTERNAL, ORIENT][..], None),
        (ArduPilot, "V4.6.0", &[ORIENT], Some(FixedOrientation::NotLogged)),
        (ArduPilot, "V4.6.0", &[EXTERNAL], Some(FixedOrientation::NotLogged)),
        (ArduPilot, "V4.6.0", &[("COMPASS_EXTERNAL", 0.0), ORIENT], Some(FixedOrientation::Internal)),
        (ArduPilot, "V4.0.3", &[EXTERNAL, ORIENT], Some(FixedOrientation::NoCustomRotation)),
        (ArduPilot, "V4.6.0", &[EXTERNAL, ORIENT, ("AHRS_ORIENTATION", 0.0)], Some(FixedOrientation::NoCustomRotation)),
        (ArduPilot, "custom build", &[EXTERNAL, ORIENT], Some(FixedOrientation::UnknownFirmware)),
        (ArduPilot, "custom build", &[EXTERNAL, ORIENT, ("CUST_ROT_ENABLE", 0.0)], None),
        (ArduPilot, "V4.6.0", &none_free, Some(FixedOrientation::NoneFree)),
        (ArduPilot, "V4.1.0", &[&[EXTERNAL, ORIENT], &CAN_NODE[..]].concat(), Some(FixedOrientation::NodeOfBus)),
        (Px4, "PX4 1.15.0", &[("CAL_MAG0_ROT", 0.0)], None),
        (Px4, "PX4 1.15.0", &[("CAL_MAG0_ROT", -1.0)], Some(FixedOrientation::Internal)),
        (Px4, "PX4 1.14.0", &[("CAL_MAG0_ROT", 0.0)], Some(FixedOrientation::NoCustomRotation)),
        (Px4, "PX4", &[("CAL_MAG0_ROT", 0.0)], Some(FixedOrientation::UnknownFirmware)),
        (Inav, "V4.6.0", &[EXTERNAL, ORIENT], Some(FixedOrientation::OtherAutopilot)),
    ] {
        let mut flight = flight_of_firmware(format, firmware, parameters);
        flight.compasses[0].device_id = log::DeviceId::from_parameter(97_539.0);
        let custom = OrientationParameters::from_log(&flight, 1, format, &[]).and_then(|of| of.custom_rotation);
        assert_eq!(custom.err(), reason, "{format:?} {firmware} {parameters:?}");
    }
    let flight = flight_of_firmware(ArduPilot, "V4.6.0", &[EXTERNAL, ORIENT]);
    let used = [CustomRotation::Ardupilot(1)];
    let second = OrientationParameters::from_log(&flight, 1, ArduPilot, &used).unwrap().custom_rotation;
    assert_eq!(second, Ok(CustomRotation::Ardupilot(2)));
}

#[test]
fn only_one_compass_is_exported_to_inav() {
    let mut second = export_of_compass(2);
    second.correction.hard_iron_ut.x = 30.0;
    let zero_lines = parameter_lines(&[], &[export_of_compass(1), second], ParameterFormat::Inav, "magzero_x");
    assert_eq!(zero_lines, ["set magzero_x = 0"]);
}

/// Symmetric matrix with all elements different.
const SYMMETRIC: Matrix3<f64> = Matrix3::new(1.08, 0.02, -0.03, 0.02, 0.95, 0.04, -0.03, 0.04, 1.02);

/// The correction by the parameters of the file is that of the export.
#[test]
fn autopilots_correct_by_the_file_as_exported() {
    let full = FieldCorrection {
        matrix: SYMMETRIC,
        hard_iron_ut: Vector3::new(12.0, -8.5, 20.0),
        motor_ut_per_a: Vector3::new(0.3, -0.2, 0.15),
    };
    let diagonal = FieldCorrection::without_current(Matrix3::from_diagonal(&SYMMETRIC.diagonal()), full.hard_iron_ut);
    let row = ReplayRow {
        raw_field: Field::from_ut(30.0, -20.0, 45.0),
        current_a: Some(12.0),
        ..compass_of_flown_turns().1.rows[0]
    };
    // Parameters of INAV are integers: 0.5 mG, and 0.05 % of the gain.
    for (format, compass_number, parameters, correction, most_ut) in [
        (ParameterFormat::ArduPilot, 1, &[][..], full, 2e-3),
        (ParameterFormat::ArduPilot, 2, &[("COMPASS_SCALE2", 1.1), ("COMPASS_MOTCT", 1.0)], full, 2e-3),
        (ParameterFormat::Px4, 1, &[], full, 2e-3),
        (ParameterFormat::Px4, 2, &[("CAL_MAG1_ROT", 6.0)], full, 2e-3),
        (ParameterFormat::Px4, 3, &[("CAL_MAG2_ROT", -1.0), ("SENS_BOARD_ROT", 2.0)], full, 2e-3),
        (ParameterFormat::Inav, 1, &[], diagonal, 0.1),
    ] {
        let export = ExportedCorrection { correction, ..export_of_compass(compass_number) };
        let field = field_by_exported_parameters(&flight_with_parameters(format, parameters), &export, format);
        let difference = field(&row) - correction.correct_field(row.raw_field.ut.map(f64::from), 12.0);
        assert!(difference.norm() < most_ut, "{format:?} {compass_number}: {difference}");
    }
}

/// `COMPASS_MOTCT` applies to all compasses: the others keep their compensation by throttle, and the first that by motor.
#[test]
fn the_current_is_compensated_only_if_no_other_compass_needs_another_compensation() {
    let (by_throttle, by_current, by_motor) = (("COMPASS_MOTCT", 1.0), ("COMPASS_MOTCT", 2.0), ("COMPASS_MOTCT", 3.0));
    let (first, third) = (("COMPASS_MOT_X", 1.5), ("COMPASS_MOT3_Z", -2.0));
    for (parameters, compass_number, expected) in [
        (&[][..], 2, true),
        (&[by_throttle], 2, true),
        (&[by_throttle, first], 1, true),
        (&[by_throttle, first], 2, false),
        (&[by_throttle, third], 1, false),
        (&[by_current, first, third], 2, true),
        (&[by_motor], 1, true),
        (&[by_motor], 2, false),
    ] {
        let flight = flight_with_parameters(ParameterFormat::ArduPilot, parameters);
        let is_given = may_compensate_current(&flight, compass_number, ParameterFormat::ArduPilot);
        assert_eq!(is_given, expected, "{parameters:?} {compass_number}");
    }
    let flight = flight_with_parameters(ParameterFormat::Px4, &[by_motor]);
    assert!(may_compensate_current(&flight, 2, ParameterFormat::Px4));
}

/// The first compass has the parameters of the second slot, the second unknown ones.
#[test]
fn parameters_are_those_of_the_slot_of_the_compass() {
    let mut flight = flight_with_parameters(ParameterFormat::ArduPilot, &[("COMPASS_ORIENT2", 4.0)]);
    flight.autopilot = log::AutopilotKind::ArduPilot;
    flight.parameters.set_value(5.0, "COMPASS_ORIENT2", 2.0);
    flight.compasses[0].slot = Ok(2);
    flight.compasses[1].slot = Err(log::UnknownSlot::NoParameters);
    let mut exports = [1, 2].map(export_of_compass);
    exports[0].correction.hard_iron_ut.x = 3.0;
    let text = format_parameter_file(&flight, &exports, ParameterFormat::ArduPilot);
    let lines = text.lines().filter(|line| !line.starts_with('#'));
    let names: Vec<&str> = lines.filter_map(|line| line.split_once(',')).map(|(name, _)| name).collect();
    assert!(names.contains(&"COMPASS_OFS2_X") && names.contains(&"COMPASS_ORIENT2"), "{text}");
    assert!(names.iter().all(|name| name.contains('2')), "{text}");
    assert!(text.contains("# compass 2: no parameters, because the log has no calibration parameters"), "{text}");
    let row = ReplayRow { raw_field: Field::from_ut(30.0, -20.0, 45.0), ..level_row(0.0, 0.0) };
    for (export, x_ut) in exports.iter().zip([27.0, 30.0]) {
        let field = field_by_exported_parameters(&flight, export, ParameterFormat::ArduPilot);
        assert!((field(&row).x - x_ut).abs() < 1e-3, "{}", field(&row));
    }
    assert_eq!(log::mounting_parameter_changes(&flight, 1), [("COMPASS_ORIENT2".to_owned(), 5.0)]);
    assert_eq!(log::mounting_parameter_changes(&flight, 2), []);
}

#[test]
fn the_file_states_the_score_of_its_parameters() {
    let held_back =
        HeldBackScore { rms_deg: 1.234, as_logged_rms_deg: 4.567, is_estimate: true, field_scatter_deg: 0.0 };
    let export = ExportedCorrection {
        held_back_score: Some(held_back),
        fitted_range_s: Some([12.3, 98.7]),
        heading_loss_deg: [0.126, 0.0],
        warnings: vec!["check it".to_owned()],
        ..export_of_compass(2)
    };
    for (format, file_name) in [
        (ParameterFormat::ArduPilot, "compass.param"),
        (ParameterFormat::Px4, "compass.params"),
        (ParameterFormat::Inav, "compass.txt"),
    ] {
        assert_eq!(format.file_name(), file_name);
        assert_eq!(
            parameter_lines(&[], std::slice::from_ref(&export), format, "# ")[..3],
            [
                "# compass 2: 1.23 deg RMS on held-back rows, 4.57 as logged (estimated); fitted to 12 to 99 s of the log",
                "# 0.13 deg RMS are lost, which these parameters cannot express",
                "# check it",
            ]
        );
    }
}
