//! Value types of the calibration.

use super::synthetic::typical_quality;
use crate::calibration::{
    AngleRates, AttitudeEnvelope, Axis, Calibration, CollectionPart, HeadingMark, Method, MotorCurrentInterference,
    Orientation, Quality, Sample, matrix_rows,
};
use crate::frames::{Field, RollPitch};

fn sample_of_field(x_ut: f32) -> Sample {
    Sample::new(Field::from_ut(x_ut, 0.0, 0.0), RollPitch::default())
}

/// 1,024 samples of a flight are kept in RAM.
#[test]
fn a_sample_takes_36_bytes() {
    assert_eq!((size_of::<Sample>(), size_of::<HeadingMark>()), (36, 40));
}

/// Roll wraps at 180 deg, pitch does not; both are constant without rates.
#[test]
fn attitude_is_extrapolated_with_its_rates() {
    let attitude = RollPitch { roll_rad: 3.1, pitch_rad: 0.2 };
    let turning = Sample { attitude, rates: AngleRates::from_rad_s([1.0, -0.5, 0.0]), ..sample_of_field(1.0) };
    let later = turning.latency_compensated_attitude(0.1);
    assert!((later.roll_rad - (3.2 - core::f32::consts::TAU)).abs() < 1e-5 && (later.pitch_rad - 0.15).abs() < 1e-6);
    let earlier = turning.latency_compensated_attitude(-0.1);
    assert!((earlier.roll_rad - 3.0).abs() < 1e-5 && (earlier.pitch_rad - 0.25).abs() < 1e-6);
    assert_eq!(turning.latency_compensated_attitude(0.0), attitude);
    assert_eq!(Sample { rates: AngleRates::UNKNOWN, ..turning }.latency_compensated_attitude(1.0), attitude);
    let calibration = Calibration { latency_s: 0.1, ..test_calibration() };
    let expected = later.to_level_frame(calibration.calibrated_field(turning.field));
    assert_eq!(calibration.corrected_level_field(&turning), expected);
}

fn test_calibration() -> Calibration {
    Calibration {
        w: [[1.0, 2.0, 0.0], [0.0, 1.0, -1.0], [3.0, 0.0, 2.0]],
        b_ut: [10.0, -20.0, 30.0],
        inclination_rad: 1.0,
        total_ut: 50.0,
        latency_s: -0.02,
        motor_current: MotorCurrentInterference::NO_INTERFERENCE,
    }
}

/// Liu 2007 eq. 8 by hand: (1, 2, 3) remains after the hard iron is subtracted.
#[test]
fn a_calibration_subtracts_hard_iron_before_the_matrix() {
    let corrected = test_calibration().calibrated_field(Field::from_ut(11.0, -18.0, 33.0));
    assert_eq!(corrected, Field::from_ut(5.0, -1.0, 9.0));
    assert_eq!(test_calibration().w_matrix() * nalgebra::Vector3::new(1.0, 2.0, 3.0), corrected.ut);
    assert_eq!(matrix_rows(&test_calibration().w_matrix()), test_calibration().w);
    assert_eq!(test_calibration().b_vector_ut(), nalgebra::Vector3::new(10.0, -20.0, 30.0));
}

#[test]
fn uncalibrated_applies_the_mounting_only() {
    let yaw90 = Orientation::from_name("yaw90").unwrap();
    let none = Calibration::uncalibrated(yaw90);
    assert_eq!(none.calibrated_field(Field::from_ut(1.0, 2.0, 3.0)), Field::from_ut(-2.0, 1.0, 3.0));
    assert!(none.is_finite());
}

#[test]
fn a_nonfinite_coefficient_is_detected() {
    assert!(test_calibration().is_finite());
    for bad in [f32::NAN, f32::INFINITY] {
        let changes: [&dyn Fn(&mut Calibration); 9] = [
            &|calibration| calibration.w[0][1] = bad,
            &|calibration| calibration.w[2][2] = bad,
            &|calibration| calibration.b_ut[2] = bad,
            &|calibration| calibration.inclination_rad = bad,
            &|calibration| calibration.total_ut = bad,
            &|calibration| calibration.latency_s = bad,
            &|calibration| calibration.motor_current.ut_per_a[1] = bad,
            &|calibration| calibration.motor_current.sigma_ut_per_a = bad,
            &|calibration| calibration.motor_current.current_sigma_a = bad,
        ];
        for change in changes {
            let mut calibration = test_calibration();
            change(&mut calibration);
            assert!(!calibration.is_finite(), "{calibration:?}");
        }
    }
}

#[test]
fn names_of_axes_parts_and_methods_are_stable() {
    assert_eq!([Axis::X, Axis::Y, Axis::Z].map(Axis::axis_name), ["x", "y", "z"]);
    let parts = [
        CollectionPart::LEFT,
        CollectionPart::RIGHT,
        CollectionPart::LEVEL,
        CollectionPart::MARKS,
        CollectionPart::FREE,
    ];
    assert_eq!(
        parts.map(CollectionPart::part_name),
        ["left turns", "right turns", "level headings", "marks", "all attitudes"]
    );
    let names = ["level", "four-ellipse", "two-plane", "maximum-likelihood", "compass-swing", "ellipsoid"];
    assert_eq!(Method::ALL_METHODS.map(Method::method_name), names);
}

#[test]
fn only_banked_samples_with_attitude_determine_all_coefficients() {
    for (method, envelope, is_determined) in [
        (Method::MaximumLikelihood, AttitudeEnvelope::Banked, true),
        (Method::CompassSwing, AttitudeEnvelope::Banked, true),
        (Method::CompassSwing, AttitudeEnvelope::Level, false),
        (Method::Level, AttitudeEnvelope::Level, false),
        (Method::Ellipsoid, AttitudeEnvelope::Banked, false),
        (Method::Ellipsoid, AttitudeEnvelope::Level, false),
    ] {
        let quality = Quality { method, envelope, ..typical_quality(0.3) };
        assert_eq!(quality.determines_all_coefficients(), is_determined, "{method:?} {envelope:?}");
    }
}
