//! Unit tests of `correction`.

use super::*;

fn ardupilot_correction(values: &[(&str, f64)], compass_number: u8) -> InvertibleCorrection {
    InvertibleCorrection::from_ardupilot_parameters(&ParameterHistory::of_values(values), 0.0, compass_number)
}

fn px4_correction(values: &[(&str, f64)], index: u8) -> InvertibleCorrection {
    InvertibleCorrection::from_px4_parameters(&ParameterHistory::of_values(values), 0.0, index)
}

#[test]
fn ardupilots_correction_is_undone() {
    let offsets_and_scale = [("COMPASS_OFS2_X", 100.0), ("COMPASS_OFS2_Y", -50.0), ("COMPASS_SCALE2", 1.25)];
    let diagonal = [("COMPASS_DIA2_X", 1.1), ("COMPASS_DIA2_Y", 0.9), ("COMPASS_DIA2_Z", 1.2)];
    let off_diagonal = [("COMPASS_ODI2_X", 0.05), ("COMPASS_ODI2_Z", -0.1)];
    let motor = [("COMPASS_MOTCT", 2.0), ("COMPASS_MOT2_Y", 2.0)];
    let undo = ardupilot_correction(&[&offsets_and_scale[..], &diagonal, &off_diagonal, &motor].concat(), 2);
    // (raw + OFS) SCALE of the raw field 100, 130, -400 mG: 250, 100, -500.
    let logged = Vector3::new(275.0 + 5.0, 12.5 + 90.0 + 50.0, -10.0 - 600.0) * 0.1;
    assert!((undo.raw_ut(logged, Vector3::zeros()) - Vector3::new(10.0, 13.0, -40.0)).norm() < 1e-9);
    assert!((undo.correction.correct_field(Vector3::new(10.0, 13.0, -40.0), 0.0) - logged).norm() < 1e-9);
    let motor = undo.motor_compensation_ut(1.0) * 10.0;
    assert!((motor - Vector3::new(0.0, 2.0, 0.0)).norm() < 1e-9);
    assert!((undo.raw_ut(logged + motor, motor) - Vector3::new(10.0, 13.0, -40.0)).norm() < 1e-9);
}

/// PX4 compensates in sensor axes, before the offsets, in G/kA, and only for a battery's current (types 2 and 3).
#[test]
fn px4s_correction_for_the_current_is_undone() {
    for (compensation_type, share) in [(0.0, 0.0), (1.0, 0.0), (2.0, 1.0), (3.0, 1.0)] {
        let configured = [
            ("CAL_MAG0_XOFF", 0.1),
            ("CAL_MAG0_YSCALE", 1.1),
            ("CAL_MAG0_YCOMP", -5.0),
            // Orientation 4, yaw 180 deg: x and y are reversed.
            ("CAL_MAG0_ROT", 4.0),
            ("CAL_MAG_COMP_TYP", compensation_type),
        ];
        let undo = px4_correction(&configured, 0);
        // Body axes, microtesla. Compensation at 20 A: 5 G/kA are 0.5 uT/A, so 10 uT on the sensor's y.
        let raw = Vector3::new(20.0, 30.0, 40.0);
        let logged = Vector3::new(20.0 + 10.0, 1.1 * (30.0 + share * 10.0), 40.0);
        let corrected = undo.correction.correct_field(raw, 20.0);
        assert!((corrected - logged).norm() < 1e-9, "{compensation_type}: {corrected}");
        assert!((undo.raw_ut(logged, undo.motor_compensation_ut(20.0)) - raw).norm() < 1e-9, "{compensation_type}");
    }
}

#[test]
fn a_missing_parameter_has_its_default() {
    let configured = [("COMPASS_OFS_X", 10.0), ("COMPASS_DIA_X", 1.1), ("COMPASS_DIA_Z", 0.9), ("COMPASS_ODI_X", 0.05)];
    let matrix = ardupilot_correction(&configured, 1).correction.matrix;
    let expected = Matrix3::new(1.1, 0.05, 0.0, 0.05, 1.0, 0.0, 0.0, 0.0, 0.9);
    assert!((matrix - expected).norm() < 1e-9, "{matrix}");
}

#[test]
fn an_ardupilot_scale_out_of_range_means_one() {
    for (scale, used_scale) in [(1.6, 1.0), (1.4, 1.4), (0.6, 1.0), (0.7, 0.7), (0.0, 1.0)] {
        let undo = ardupilot_correction(&[("COMPASS_SCALE", scale)], 1);
        assert!((undo.correction.matrix - Matrix3::identity() * used_scale).norm() < 1e-9, "{scale}");
    }
}

/// A nearly singular matrix would amplify the logged field. A text log may hold any number: a determinant may overflow.
#[test]
fn a_matrix_that_cannot_be_inverted_is_ignored() {
    for diagonal in [[1.0, 0.0, 0.0], [1.0, 0.0, 1.0], [0.0; 3], [1e200; 3]] {
        let names = ["COMPASS_DIA_X", "COMPASS_DIA_Y", "COMPASS_DIA_Z"];
        let configured: Vec<(&str, f64)> = names.into_iter().zip(diagonal).collect();
        let undo = ardupilot_correction(&configured, 1);
        assert_eq!(undo.correction, FieldCorrection::identity(), "{diagonal:?}");
        let field = Vector3::new(20.0, 0.0, 40.0);
        assert_eq!(undo.raw_ut(field, Vector3::zeros()), field, "{diagonal:?}");
    }
    assert_eq!(ardupilot_correction(&[], 1).correction, FieldCorrection::identity());
}

/// An external compass turned by 90 deg: 0.5 G along the nose are -y of the sensor.
#[test]
fn px4s_correction_is_made_in_the_sensors_axes() {
    let undo = px4_correction(&[("CAL_MAG1_ROT", 2.0), ("CAL_MAG1_XOFF", 0.1), ("CAL_MAG1_YSCALE", 1.25)], 1);
    // Sensor (0.3, -0.4, 0) G: less offset (0.2, -0.4, 0), scaled (0.2, -0.5, 0), turned (0.5, 0.2, 0).
    let raw = undo.raw_ut(Vector3::new(50.0, 20.0, 0.0), Vector3::zeros());
    assert!((raw - Vector3::new(40.0, 30.0, 0.0)).norm() < 1e-9, "{raw}");
}

/// Type 1 compensates by throttle, whose input value is not logged.
#[test]
fn ardupilots_throttle_compensation_is_not_used_as_current() {
    for (compensation_type, motor_ut_per_a) in [(0.0, 0.0), (1.0, 0.0), (2.0, -0.5)] {
        let configured = [("COMPASS_MOTCT", compensation_type), ("COMPASS_MOT_X", 5.0)];
        let found = ardupilot_correction(&configured, 1).correction.motor_ut_per_a;
        assert!((found - Vector3::new(motor_ut_per_a, 0.0, 0.0)).norm() < 1e-9, "{compensation_type}: {found}");
    }
}

/// PX4 ignores scales that are not positive.
#[test]
fn px4s_non_positive_scales_mean_one() {
    for (scale, used_scale) in [(0.0, 1.0), (-1.0, 1.0), (0.5, 0.5)] {
        let undone = px4_correction(&[("CAL_MAG0_YSCALE", scale), ("CAL_MAG0_XOFF", 0.1)], 0).correction;
        let expected = Matrix3::from_diagonal(&Vector3::new(1.0, used_scale, 1.0));
        assert!((undone.matrix - expected).norm() < 1e-9, "{scale}: {undone:?}");
        assert!((undone.hard_iron_ut - Vector3::new(10.0, 0.0, 0.0)).norm() < 1e-9, "{scale}: {undone:?}");
    }
}
