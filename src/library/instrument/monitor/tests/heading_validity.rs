//! Sigma of the heading after a change, and headings that are withheld and return.

use super::*;

/// Validity of a heading in a bank, with the filter's variance of it and the variance that is sent. It depends on hard
/// iron along x and on the roll bias.
fn validity_with_variances(monitor: &Monitor, variances_rad2: [f32; 2]) -> Result<(), NoHeading> {
    let sample = sample_at_rest(INCLINATION_RAD, RollPitch { roll_rad: -0.35, pitch_rad: 0.0 });
    let mut heading_jacobian = [0.0; STATE_COUNT];
    (heading_jacobian[HARD_IRON_CHANGE_INDEX], heading_jacobian[ROLL_BIAS_INDEX]) = (1.0, 1.0);
    monitor.assess_validity(monitor.filter.mean(), &sample, &heading_jacobian, variances_rad2)
}

/// Hard iron of 60 % of the field, a mount turned by 34 deg, the Earth's field 2000 km away, 9 deg of attitude bias,
/// half of the bank.
#[test]
fn estimated_changes_beyond_their_limits_withhold_the_heading() {
    let changes = [
        (HARD_IRON_CHANGE_INDEX, 0.6, NoHeading::FieldChanged),
        (MOUNT_TURN_INDEX, 0.6, NoHeading::FieldChanged),
        (STRENGTH_CHANGE_INDEX, 0.2, NoHeading::FieldDisturbed),
        (INCLINATION_CHANGE_INDEX, 0.2, NoHeading::FieldDisturbed),
        (ROLL_BIAS_INDEX, 0.15, NoHeading::AttitudeContradicted),
        (PITCH_BIAS_INDEX, 0.15, NoHeading::AttitudeContradicted),
        (BANK_SCALE_ERROR_INDEX, 0.5, NoHeading::AttitudeContradicted),
    ];
    for (index, limit, reason) in changes {
        for (value, expected) in [(0.8, Ok(())), (-0.8, Ok(())), (1.2, Err(reason)), (-1.2, Err(reason))] {
            let mut monitor = Monitor::new(SensorErrorSigmas::DEFAULT);
            monitor.filter.set_mean(index, value * limit);
            assert_eq!(validity_with_variances(&monitor, [0.0; 2]), expected, "{index}: {value} of the limit");
        }
    }
}

/// The sensor may be stuck, or the attitude that of another vehicle, whose sender a changed field releases.
#[test]
fn a_field_that_turns_with_the_aircraft_has_changed() {
    let mut flight = Flight::new(3);
    let field = RollPitch::default().to_body_frame(Field::earth_field(TOTAL_UT, INCLINATION_RAD, 0.5));
    for i in 0..100_u8 {
        flight.sample_count += 1;
        let euler_rates = EulerRates { heading_rad_s: 0.2, ..EulerRates::default() };
        let gyro_heading = GyroHeading { euler_rates, relative_heading_rad: 0.02 * f32::from(i), run_number: 0 };
        flight.process_sample(Sample::new(Field::new(field.ut), RollPitch::default()), Some(gyro_heading));
    }
    assert_eq!(flight.monitor.monitor_output().validity, Err(NoHeading::FieldChanged));
    let states = *flight.monitor.filter.mean();
    assert!(states.iter().all(|state| *state == 0.0), "it starts again: {states:?}");
}

/// 5 uT are significant at a sigma of 0.5 uT, but not if errors of the coefficients may look like 1.5 uT.
#[test]
fn coefficient_errors_are_not_reported_as_hard_iron() {
    for (coefficient_sigma, is_reported) in [(0.01_f32, true), (0.03, false)] {
        let mut monitor =
            Monitor { filter: UdFilter::new(&[0.01; STATE_COUNT]), ..Monitor::new(SensorErrorSigmas::DEFAULT) };
        monitor.coefficient_variances[1] = coefficient_sigma.powi(2);
        let change = monitor.detect_change(&Vector3::new(0.0, 0.1, 0.0), TOTAL_UT, 20.0);
        assert_eq!(change.is_some(), is_reported, "{coefficient_sigma}");
    }
}

/// After 16 s of withheld headings: the 4 s of a detected change, then 60 deg of turn at 16.4 deg/s.
#[test]
fn headings_return_after_a_turn_of_60_deg() {
    let mut flight = Flight::new(17);
    flight.fly_seconds(STRAIGHT_S as u32);
    flight.monitor.innovation_gate = withholding_monitor(20.0).innovation_gate;
    let withheld = (0..200).take_while(|_| flight.fly_sample().is_err()).count();
    assert!((74..=80).contains(&withheld), "{withheld}");
}

/// Of tilt error and hard iron, the larger one is the reason, but the field if its strength has changed: 7 % of the
/// field against 4 deg by a bank scale error of 0.2 at 20 deg, or by a bias.
#[test]
fn the_reason_for_a_withheld_heading_is_the_larger_error() {
    for (state, value, hard_iron, is_strength_test_failed, reason) in [
        (BANK_SCALE_ERROR_INDEX, -0.2, 0.06, false, NoHeading::AttitudeContradicted),
        (BANK_SCALE_ERROR_INDEX, 0.2, 0.08, false, NoHeading::FieldDisturbed),
        (PITCH_BIAS_INDEX, -0.07, 0.06, false, NoHeading::AttitudeContradicted),
        (PITCH_BIAS_INDEX, 0.07, 0.06, true, NoHeading::FieldDisturbed),
    ] {
        let mut monitor = Monitor { is_strength_test_failed, ..withholding_monitor(0.0) };
        monitor.filter.set_mean(state, value);
        monitor.filter.set_mean(HARD_IRON_CHANGE_INDEX, hard_iron);
        let found = validity_with_variances(&monitor, [0.0; 2]);
        assert_eq!(found, Err(reason), "{state} {value} {hard_iron}");
    }
}

/// Limits: 8 deg, and 11 deg with the inflation after a change. The reason names the states with the larger part of the
/// variance.
#[test]
fn a_heading_with_sigma_over_8_deg_is_withheld() {
    let mut monitor = Monitor::new(SensorErrorSigmas::DEFAULT);
    let variances_rad2 = |sigmas_deg: [f32; 2]| sigmas_deg.map(|sigma_deg| sigma_deg.to_radians().powi(2));
    assert_eq!(validity_with_variances(&monitor, variances_rad2([7.5, 10.5])), Ok(()));
    assert!(validity_with_variances(&monitor, variances_rad2([7.5, 12.0])).is_err());
    monitor.filter.inflate_variance(HARD_IRON_CHANGE_INDEX, 0.004);
    monitor.filter.inflate_variance(ROLL_BIAS_INDEX, 0.01);
    let too_large_rad2 = variances_rad2([8.5; 2]);
    assert_eq!(validity_with_variances(&monitor, too_large_rad2), Err(NoHeading::AttitudeContradicted));
    monitor.filter.inflate_variance(HARD_IRON_CHANGE_INDEX, 0.1);
    assert_eq!(validity_with_variances(&monitor, too_large_rad2), Err(NoHeading::FieldChanged));
}

#[test]
fn non_finite_samples_are_ignored() {
    let mut flight = Flight::new(13);
    flight.fly_seconds(30);
    let before = *flight.monitor.monitor_output();
    let good = Sample::new(Field::from_ut(20.0, 3.0, 40.0), RollPitch::default());
    let non_finite = RollPitch { roll_rad: f32::NAN, pitch_rad: 0.0 };
    for (sample, gyro_heading) in [
        (Sample { field: Field::from_ut(f32::NAN, 0.0, 0.0), ..good }, None),
        (Sample { attitude: non_finite, ..good }, None),
        (good, Some(GyroHeading { relative_heading_rad: f32::INFINITY, ..GyroHeading::default() })),
    ] {
        flight.sample_count += 1;
        flight.process_sample(sample, gyro_heading);
        assert_eq!(*flight.monitor.monitor_output(), before);
    }
}

#[test]
fn a_heading_contradicted_by_the_gyro_is_withheld() {
    let mut flight = Flight::new(14);
    flight.fly_seconds(300);
    let output = flight.monitor.monitor_output();
    let (run_number, offset_rad2) = output.run_and_heading_offset_variance.unwrap();
    let euler_rates = EulerRates { heading_rad_s: 0.3, ..EulerRates::default() };
    let turning = GyroHeading { euler_rates, relative_heading_rad: 1.0, run_number };
    let by_gyro_rad = 1.0 + output.states[GYRO_HEADING_OFFSET_INDEX] + 0.3 * output.states[ATTITUDE_LATENCY_INDEX];
    let passes = |off_sigmas: f32, turning: Option<GyroHeading>| {
        let sigma_rad = 0.002_f32;
        let magnetic_rad = by_gyro_rad + off_sigmas * sigma_rad.hypot(offset_rad2.sqrt());
        let heading = Heading { magnetic_rad, sigma_rad, systematic_variance_rad2: 0.0 };
        output.passes_reading_gate(heading, turning.as_ref())
    };
    for (off_sigmas, expected) in [(0.0, true), (4.0, true), (-4.0, true), (5.0, false), (-5.0, false)] {
        assert_eq!(passes(off_sigmas, Some(turning)), expected, "{off_sigmas}");
    }
    let other_run = GyroHeading { run_number: run_number.wrapping_add(1), ..turning };
    assert!(passes(20.0, None) && passes(20.0, Some(other_run)));
}

#[test]
fn estimated_changes_are_applied_to_the_calibration() {
    let w = [[1.1, 0.1, 0.0], [0.0, 0.9, -0.1], [0.05, 0.0, 1.0]];
    let calibration = Calibration {
        w,
        b_ut: [1.0, 2.0, 3.0],
        inclination_rad: 1.0,
        total_ut: 50.0,
        ..Calibration::uncalibrated(Orientation::IDENTITY_ROTATION)
    };
    let uncertainty = HeadingUncertainty { reduced_covariance: [[1e-4; 10]; 6], ..HeadingUncertainty::NO_UNCERTAINTY };
    let monitored =
        MonitoredCalibration { calibration: &calibration, uncertainty: &uncertainty, readings_per_sample: 4 };
    let mut states = [0.0; STATE_COUNT];
    states[..3].copy_from_slice(&[0.02, -0.04, 0.06]);
    (states[STRENGTH_CHANGE_INDEX], states[INCLINATION_CHANGE_INDEX]) = (0.1, -0.05);
    let variances = Some(SampleNoise { strength_variance: 1e-4, tilt_variance_rad2: 4e-4 });
    let (found, adapted) =
        MonitorOutput { states, sample_noise: variances, ..MonitorOutput::INITIAL }.correct_calibration(&monitored);
    let field = Field::from_ut(20.0, -10.0, 30.0);
    let removed_ut = calibration.calibrated_field(field).ut - found.calibrated_field(field).ut;
    assert!((removed_ut - Vector3::new(1.0, -2.0, 3.0)).norm() < 1e-4, "{removed_ut}");
    assert!((found.total_ut - 55.0).abs() < 1e-4 && (found.inclination_rad - 0.95).abs() < 1e-6);
    // The mean of four readings has half the sigma of one.
    assert!((adapted.relative_sensor_sigma - 0.02).abs() < 1e-6 && (adapted.attitude_sigma_rad - 0.02).abs() < 1e-6);
    let unchanged = MonitorOutput::INITIAL.correct_calibration(&monitored);
    assert_eq!(adapted.reduced_covariance, uncertainty.reduced_covariance);
    assert_eq!(unchanged, (calibration, uncertainty));
}
