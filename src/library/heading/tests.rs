//! Unit tests of `heading`.

use super::*;
use crate::calibration::Orientation;
use crate::frames::wrap_pi;

fn ideal_calibration() -> Calibration {
    Calibration { inclination_rad: 1.0, total_ut: 50.0, ..Calibration::uncalibrated(Orientation::IDENTITY_ROTATION) }
}

fn measured_field(total_ut: f32, inclination_rad: f32, heading_rad: f32, attitude: RollPitch) -> Field<Sensor> {
    Field::new(attitude.to_body_frame(Field::earth_field(total_ut, inclination_rad, heading_rad)).ut)
}

fn default_heading(
    uncertainty: &HeadingUncertainty,
    field: Field<Sensor>,
    attitude: RollPitch,
) -> Result<Heading, NoHeading> {
    compute_heading(HeadingLimits::DEFAULT, &ideal_calibration(), uncertainty, field, attitude)
}

/// Tolerance for f32 rounding of a few 1e-5 deg.
#[test]
fn heading_is_exact_at_any_attitude() {
    for heading_deg in (0_u16..360).step_by(15) {
        for (roll_deg, pitch_deg) in [(0.0, 0.0), (25.0, 3.0), (-60.0, -20.0), (170.0, 10.0), (10.0, 80.0)] {
            let attitude = RollPitch::from_deg(roll_deg, pitch_deg);
            let heading_rad = f32::from(heading_deg).to_radians();
            let field = measured_field(50.0, 1.0, heading_rad, attitude);
            let found = default_heading(&HeadingUncertainty::NO_UNCERTAINTY, field, attitude).unwrap();
            let error = wrap_pi(found.magnetic_rad - heading_rad).to_degrees();
            assert!(error.abs() < 0.001, "heading {heading_deg} roll {roll_deg} pitch {pitch_deg}: {error}");
        }
    }
}

/// Whether a heading results from this field at 0.5 rad.
fn is_accepted(config: HeadingLimits, total_ut: f32, inclination_rad: f32, attitude: RollPitch) -> bool {
    let field = measured_field(total_ut, inclination_rad, 0.5, attitude);
    match compute_heading(config, &ideal_calibration(), &HeadingUncertainty::NO_UNCERTAINTY, field, attitude) {
        Ok(_) => true,
        Err(reason) => {
            assert_eq!(reason, NoHeading::FieldDisturbed);
            false
        }
    }
}

/// The field may differ from the calibration's by 20 % of its strength and by 12 deg of inclination.
#[test]
fn a_field_beyond_the_limits_is_rejected_at_any_attitude() {
    for (total_ut, inclination_deviation_deg, expected) in [
        (50.0, 0.0, true),
        (59.5, 0.0, true),
        (60.5, 0.0, false),
        (40.5, 0.0, true),
        (39.5, 0.0, false),
        (50.0, 11.5, true),
        (50.0, 12.5, false),
        (50.0, -11.5, true),
        (50.0, -12.5, false),
        // On the other hemisphere.
        (50.0, -114.6, false),
    ] {
        for (roll_deg, pitch_deg) in [(0.0, 0.0), (40.0, 5.0), (-30.0, -15.0)] {
            let attitude = RollPitch::from_deg(roll_deg, pitch_deg);
            let inclination_rad = 1.0 + f32::to_radians(inclination_deviation_deg);
            let found = is_accepted(HeadingLimits::DEFAULT, total_ut, inclination_rad, attitude);
            assert_eq!(found, expected, "{total_ut} uT, {inclination_deviation_deg} deg, {attitude:?}");
        }
    }
}

/// A tilt error turns the heading by `tan I`; sensor noise is divided by the horizontal field.
#[test]
fn sigma_includes_attitude_and_sensor_noise() {
    let field = measured_field(50.0, 1.0, 0.5, RollPitch::default());
    for (attitude_sigma_rad, relative_sensor_sigma, expected_rad) in
        [(0.01, 0.0, 0.01 * 1_f32.tan()), (0.0, 0.01, 0.01 / 1_f32.cos())]
    {
        let uncertainty =
            HeadingUncertainty { relative_sensor_sigma, attitude_sigma_rad, ..HeadingUncertainty::NO_UNCERTAINTY };
        let found = default_heading(&uncertainty, field, RollPitch::default()).unwrap();
        assert!((found.sigma_rad - expected_rad).abs() < 2e-5, "{found:?} {expected_rad}");
    }
}

/// An attitude error of 0.5 deg is 2.9 deg at a pitch of 80 deg, and 8 deg at 86.4. The field is horizontal, so that
/// the tilt alone does not turn the heading.
#[test]
fn the_sigma_grows_near_the_vertical_until_the_heading_is_empty() {
    let uncertainty = HeadingUncertainty { attitude_sigma_rad: 0.5 * DEG, ..HeadingUncertainty::NO_UNCERTAINTY };
    let calibration = Calibration { inclination_rad: 0.0, ..ideal_calibration() };
    for (pitch_deg, expected_deg) in
        [(0.0, Some(0.0)), (74.0, Some(0.0)), (80.0, Some(2.88)), (-80.0, Some(2.88)), (86.0, Some(7.17)), (86.8, None)]
    {
        let attitude = RollPitch::from_deg(20.0, pitch_deg);
        let field = measured_field(50.0, 0.0, 0.5, attitude);
        let found = compute_heading(HeadingLimits::DEFAULT, &calibration, &uncertainty, field, attitude);
        match expected_deg {
            Some(deg) => assert!((found.unwrap().sigma_deg() - deg).abs() < 0.03, "{pitch_deg}: {found:?}"),
            None => assert_eq!(found, Err(NoHeading::AttitudeInaccurate), "{pitch_deg}"),
        }
    }
}

#[test]
fn every_reason_for_an_empty_heading_has_a_code() {
    for (reason, code) in [
        (NoHeading::SensorSilent, "sensor-silent"),
        (NoHeading::SensorSaturated, "sensor-saturated"),
        (NoHeading::SensorClipped, "sensor-clipped"),
        (NoHeading::SensorStuck, "sensor-stuck"),
        (NoHeading::SensorSpike, "sensor-spike"),
        (NoHeading::AttitudeStale, "attitude-stale"),
        (NoHeading::AttitudeFrozen, "attitude-frozen"),
        (NoHeading::AttitudeInaccurate, "attitude-inaccurate"),
        (NoHeading::Uncalibrated, "uncalibrated"),
        (NoHeading::FieldDisturbed, "field-disturbed"),
        (NoHeading::FieldChanged, "field-changed"),
        (NoHeading::AttitudeContradicted, "attitude-contradicted"),
        (NoHeading::SafeMode, "safe-mode"),
    ] {
        assert_eq!(reason.stable_code(), code);
    }
}
