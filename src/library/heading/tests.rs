//! Unit tests of `heading`.

use super::*;
use crate::calibration::Orientation;
use crate::frames::wrap_pi;

fn ideal_calibration() -> Calibration {
    Calibration { inclination_rad: 1.0, total_ut: 50.0, ..Calibration::uncalibrated(Orientation::IDENTITY_ROTATION) }
}

fn measured_field(total_ut: f32, inclination_rad: f32, heading_rad: f32, attitude: Attitude) -> Field<Sensor> {
    Field::new(attitude.to_body_frame(Field::earth_field(total_ut, inclination_rad, heading_rad)).ut)
}

/// Tolerance for f32 rounding of a few 1e-5 deg.
#[test]
fn heading_is_exact_at_any_attitude() {
    for heading_deg in (0_u16..360).step_by(15) {
        for (roll_deg, pitch_deg) in [(0.0, 0.0), (25.0, 3.0), (-60.0, -20.0), (170.0, 10.0), (10.0, 80.0)] {
            let attitude = Attitude::from_deg(roll_deg, pitch_deg);
            let field = measured_field(50.0, 1.0, f32::from(heading_deg).to_radians(), attitude);
            let found = compute_heading(
                HeadingLimits::DEFAULT,
                &ideal_calibration(),
                &HeadingUncertainty::NO_UNCERTAINTY,
                field,
                attitude,
            )
            .unwrap();
            let error = wrap_pi(found.magnetic_rad - f32::from(heading_deg).to_radians()).to_degrees();
            assert!(error.abs() < 0.001, "heading {heading_deg} roll {roll_deg} pitch {pitch_deg}: {error}");
        }
    }
}

/// Whether a heading results from this field at 0.5 rad.
fn is_accepted(config: HeadingLimits, total_ut: f32, inclination_rad: f32, attitude: Attitude) -> bool {
    let field = measured_field(total_ut, inclination_rad, 0.5, attitude);
    match compute_heading(config, &ideal_calibration(), &HeadingUncertainty::NO_UNCERTAINTY, field, attitude) {
        Ok(_) => true,
        Err(reason) => {
            assert_eq!(reason, NoHeading::FieldDisturbed);
            false
        }
    }
}

const ATTITUDES_DEG: [(f32, f32); 3] = [(0.0, 0.0), (40.0, 5.0), (-30.0, -15.0)];

#[test]
fn a_field_strength_off_by_over_20_percent_is_rejected() {
    for (total_ut, expected) in [(50.0, true), (59.9, true), (60.1, false), (40.1, true), (39.9, false)] {
        for (roll_deg, pitch_deg) in ATTITUDES_DEG {
            let attitude = Attitude::from_deg(roll_deg, pitch_deg);
            assert_eq!(
                is_accepted(HeadingLimits::DEFAULT, total_ut, 1.0, attitude),
                expected,
                "{total_ut} uT {attitude:?}"
            );
        }
    }
}

#[test]
fn a_field_inclination_off_by_over_12_deg_is_rejected() {
    for (deviation_deg, expected) in [(0.0, true), (11.9, true), (12.1, false), (-11.9, true), (-12.1, false)] {
        for (roll_deg, pitch_deg) in ATTITUDES_DEG {
            let attitude = Attitude::from_deg(roll_deg, pitch_deg);
            let inclination_rad = 1.0 + f32::to_radians(deviation_deg);
            let found = is_accepted(HeadingLimits::DEFAULT, 50.0, inclination_rad, attitude);
            assert_eq!(found, expected, "{deviation_deg} deg {attitude:?}");
        }
    }
    assert!(!is_accepted(HeadingLimits::DEFAULT, 50.0, -1.0, Attitude::default()));
}

#[test]
fn a_non_finite_field_is_disturbed() {
    for (total_ut, inclination_rad) in [(f32::NAN, 1.0), (f32::INFINITY, 1.0), (50.0, f32::NAN)] {
        assert!(!is_accepted(HeadingLimits::DEFAULT, total_ut, inclination_rad, Attitude::default()));
    }
    let non_finite = Attitude { roll_rad: f32::NAN, pitch_rad: 0.0 };
    let field = measured_field(50.0, 1.0, 0.5, Attitude::default());
    let found = compute_heading(
        HeadingLimits::DEFAULT,
        &ideal_calibration(),
        &HeadingUncertainty::NO_UNCERTAINTY,
        field,
        non_finite,
    );
    assert_eq!(found, Err(NoHeading::FieldDisturbed));
}

#[test]
fn the_inclination_limit_can_be_disabled() {
    let config = HeadingLimits::DEFAULT.without_inclination_limit();
    for inclination_rad in [1.0, -1.0, 0.0, 1.5] {
        assert!(is_accepted(config, 50.0, inclination_rad, Attitude::default()), "{inclination_rad}");
    }
    assert!(
        !is_accepted(config, 60.1, 1.0, Attitude::default()) && !is_accepted(config, 39.9, 1.0, Attitude::default())
    );
}

#[test]
fn all_field_limits_can_be_disabled() {
    for (total_ut, inclination_rad) in [(5.0, 1.0), (500.0, 1.0), (50.0, -1.0), (50.0, 0.0)] {
        assert!(is_accepted(HeadingLimits::ANY_FIELD, total_ut, inclination_rad, Attitude::default()));
    }
    let lenient = HeadingLimits { max_strength_deviation: Some(1.5), ..HeadingLimits::DEFAULT };
    assert!(is_accepted(lenient, 1.0, 1.0, Attitude::default()));
    assert!(!is_accepted(lenient, 126.0, 1.0, Attitude::default()));
}

#[test]
fn sigma_includes_attitude_and_sensor_noise() {
    let mut uncertainty = HeadingUncertainty::NO_UNCERTAINTY;
    uncertainty.attitude_sigma_rad = 0.5_f32.to_radians();
    let field = measured_field(50.0, 1.0, 0.5, Attitude::default());
    let found = compute_heading(HeadingLimits::DEFAULT, &ideal_calibration(), &uncertainty, field, Attitude::default())
        .unwrap();
    let expected_deg = 0.5 * 1.0_f32.tan();
    assert!((found.sigma_deg() - expected_deg).abs() < 1e-3, "{} {expected_deg}", found.sigma_deg());
    // Sensor noise of 1 % of the field is divided by the horizontal field.
    let mut uncertainty = HeadingUncertainty::NO_UNCERTAINTY;
    uncertainty.relative_sensor_sigma = 0.01;
    let found = compute_heading(HeadingLimits::DEFAULT, &ideal_calibration(), &uncertainty, field, Attitude::default())
        .unwrap();
    let expected_deg = (0.01 / 1.0_f32.cos()).to_degrees();
    assert!((found.sigma_deg() - expected_deg).abs() < 1e-3, "{} {expected_deg}", found.sigma_deg());
}

#[test]
fn a_rotated_heading_wraps_and_keeps_its_sigma() {
    let heading = Heading { magnetic_rad: 350_f32.to_radians(), sigma_rad: 0.01, systematic_variance_rad2: 5e-5 };
    for (by_deg, to_deg) in [(20.0, 10.0), (-20.0, 330.0), (0.0, 350.0), (-355.0, 355.0)] {
        let turned = heading.rotated_by_deg(by_deg);
        assert!((turned.magnetic_deg() - to_deg).abs() < 1e-3, "{by_deg}: {turned:?}");
        assert!((turned.sigma_deg() - 0.572_96).abs() < 1e-4);
        assert_eq!(turned.systematic_variance_rad2.to_bits(), 5e-5_f32.to_bits());
    }
}

#[test]
fn every_reason_for_an_empty_heading_has_a_code() {
    let codes = [
        NoHeading::SensorSilent,
        NoHeading::SensorSaturated,
        NoHeading::SensorClipped,
        NoHeading::SensorStuck,
        NoHeading::SensorSpike,
        NoHeading::AttitudeStale,
        NoHeading::AttitudeFrozen,
        NoHeading::Uncalibrated,
        NoHeading::FieldDisturbed,
        NoHeading::FieldChanged,
        NoHeading::AttitudeContradicted,
        NoHeading::SafeMode,
    ]
    .map(NoHeading::stable_code);
    let expected = [
        "sensor-silent",
        "sensor-saturated",
        "sensor-clipped",
        "sensor-stuck",
        "sensor-spike",
        "attitude-stale",
        "attitude-frozen",
        "uncalibrated",
        "field-disturbed",
        "field-changed",
        "attitude-contradicted",
        "safe-mode",
    ];
    assert_eq!(codes, expected);
}
