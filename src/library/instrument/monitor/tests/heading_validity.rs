//! Sigma of the heading after a change, and headings that are withheld and return.

use super::*;

/// Three times the filter's variance of the heading at the attitude of that moment.
#[test]
fn heading_variance_is_inflated_after_a_detected_change() {
    let mut flight = Flight::new(5);
    flight.fly_seconds(40);
    let unchanged_rad2 = flight.monitor.monitor_output().heading_variance_rad2;
    assert!(unchanged_rad2 < 0.006 * 0.006, "nothing has changed: {unchanged_rad2}");
    flight.errors.hard_iron_ut = [0.0, 5.0, 0.0];
    flight.fly_seconds(15);
    let (attitude, euler_rates, heading_rad) = motion_at(flight.now_s());
    let field = attitude.to_body_frame(Field::earth_field(1.0, INCLINATION_RAD, heading_rad)).ut;
    let mount_turn_effect = MountTurnEffect::new(&flight.calibration, &field);
    let monitor_sample = MonitorSample { field, mount_turn_effect, attitude, euler_rates };
    let states = *flight.monitor.filter.mean();
    let predicted =
        PredictedField { heading_rad: Some(heading_rad), ..PredictedField::new(&states, INCLINATION_RAD, None) };
    let jacobian = MeasurementModel::new(&monitor_sample, &states, &predicted).heading_jacobian;
    let inflation =
        flight.monitor.monitor_output().heading_variance_rad2 / flight.monitor.filter.projected_variance(&jacobian);
    assert!((2.4..=3.6).contains(&inflation), "{inflation}");
    flight.errors.hard_iron_ut = [0.0; 3];
    flight.fly_seconds(200);
    assert!(flight.monitor.monitor_output().heading_variance_rad2 < 0.006 * 0.006);
}

#[test]
fn estimated_changes_beyond_their_limits_withhold_the_heading() {
    let watched_verdict = |index: usize, value: f32| {
        let mut flight = Flight::new(10);
        flight.fly_seconds(30);
        flight.monitor.filter.set_mean(index, value);
        let monitor_sample = MonitorSample {
            field: Vector3::new(0.5, 0.0, 0.8),
            mount_turn_effect: MountTurnEffect::new(&flight.calibration, &Vector3::zeros()),
            attitude: Attitude::default(),
            euler_rates: EulerRates::default(),
        };
        flight.monitor.assess_validity(flight.monitor.filter.mean(), &monitor_sample, &[0.0; STATE_COUNT], [0.0; 2])
    };
    for (index, limit, reason) in [
        (HARD_IRON_CHANGE_INDEX, 0.6, NoHeading::FieldChanged),
        (STRENGTH_CHANGE_INDEX, 0.2, NoHeading::FieldDisturbed),
        (INCLINATION_CHANGE_INDEX, 0.2, NoHeading::FieldDisturbed),
        (ROLL_BIAS_INDEX, 0.15, NoHeading::AttitudeContradicted),
        (PITCH_BIAS_INDEX, 0.15, NoHeading::AttitudeContradicted),
        (BANK_SCALE_ERROR_INDEX, 0.5, NoHeading::AttitudeContradicted),
    ] {
        for sign in [1.0, -1.0] {
            assert_eq!(watched_verdict(index, sign * 0.97 * limit), Ok(()), "{index}");
            assert_eq!(watched_verdict(index, sign * 1.03 * limit), Err(reason), "{index}");
        }
    }
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
        let seen = MonitorSample {
            field: Vector3::new(0.5, 0.0, 0.8),
            mount_turn_effect: MountTurnEffect::new(&Flight::new(0).calibration, &Vector3::zeros()),
            attitude: Attitude { roll_rad: -0.35, pitch_rad: 0.0 },
            euler_rates: EulerRates::default(),
        };
        let found = monitor.assess_validity(monitor.filter.mean(), &seen, &[0.0; STATE_COUNT], [0.0; 2]);
        assert_eq!(found, Err(reason), "{state} {value} {hard_iron}");
    }
}

/// Limits: 8 deg, and 11 deg with the inflation after a change. The reason names the states with the larger part of the
/// variance.
#[test]
fn a_heading_with_sigma_over_8_deg_is_withheld() {
    let mut flight = Flight::new(11);
    flight.fly_seconds(30);
    let monitor = &mut flight.monitor;
    let monitor_sample = MonitorSample {
        field: Vector3::new(0.5, 0.0, 0.8),
        mount_turn_effect: MountTurnEffect::new(&flight.calibration, &Vector3::zeros()),
        attitude: Attitude::default(),
        euler_rates: EulerRates::default(),
    };
    let mut row = [0.0; STATE_COUNT];
    (row[HARD_IRON_CHANGE_INDEX], row[ROLL_BIAS_INDEX]) = (1.0, 1.0);
    let mean = *monitor.filter.mean();
    assert_eq!(monitor.assess_validity(&mean, &monitor_sample, &row, [0.139 * 0.139, 0.199 * 0.199]), Ok(()));
    assert!(monitor.assess_validity(&mean, &monitor_sample, &row, [0.139 * 0.139, 0.201 * 0.201]).is_err());
    monitor.filter.inflate_variance(ROLL_BIAS_INDEX, 0.01);
    assert_eq!(
        monitor.assess_validity(&mean, &monitor_sample, &row, [0.0201; 2]),
        Err(NoHeading::AttitudeContradicted)
    );
    monitor.filter.inflate_variance(HARD_IRON_CHANGE_INDEX, 0.1);
    assert_eq!(monitor.assess_validity(&mean, &monitor_sample, &row, [0.1; 2]), Err(NoHeading::FieldChanged));
}

#[test]
fn a_source_without_rates_is_monitored() {
    let flight = Flight::new(12);
    let mut monitor = Monitor::new(SensorErrorSigmas::DEFAULT);
    let mut verdicts = Vec::new();
    for i in 0..240_u16 {
        let iron_ut = if i < 200 { 0.0 } else { 8.0 };
        let (attitude, _, heading_rad) = motion_at(f32::from(i) * STEP_S);
        let field = attitude.to_body_frame(Field::earth_field(TOTAL_UT, INCLINATION_RAD, heading_rad)).ut
            + Vector3::z() * iron_ut;
        let at = Timestamp::from_us(u64::from(i) * 100_000);
        let sample = Sample { time: at.wrapping_millis(), ..Sample::new(Field::new(field), attitude) };
        let monitored = flight.monitored_calibration();
        monitor.process_sample(&monitored, at, &sample, None);
        verdicts.push(monitor.monitor_output().validity);
    }
    assert!(verdicts[..201].iter().all(Result::is_ok));
    assert!(verdicts[201..].iter().all(|verdict| *verdict == Err(NoHeading::FieldDisturbed)));
    assert_eq!(monitor.monitor_output().run_and_heading_offset_variance, None);
}

#[test]
fn non_finite_samples_are_ignored() {
    let mut flight = Flight::new(13);
    flight.fly_seconds(30);
    let before = *flight.monitor.monitor_output();
    let monitored = MonitoredCalibration {
        calibration: &flight.calibration,
        uncertainty: &flight.uncertainty,
        readings_per_sample: 1,
    };
    let good = Sample::new(Field::from_ut(20.0, 3.0, 40.0), Attitude::default());
    let non_finite = Attitude { roll_rad: f32::NAN, pitch_rad: 0.0 };
    let turned = GyroHeading { relative_heading_rad: f32::INFINITY, ..GyroHeading::default() };
    for (sample, turning) in [
        (Sample { field: Field::from_ut(f32::NAN, 0.0, 0.0), ..good }, None),
        (Sample { attitude: non_finite, ..good }, None),
        (good, Some(turned)),
    ] {
        flight.monitor.process_sample(&monitored, Timestamp::from_us(60_000_000), &sample, turning);
        assert_eq!(*flight.monitor.monitor_output(), before);
    }
}

#[test]
fn a_heading_contradicted_by_the_gyro_is_withheld() {
    let mut flight = Flight::new(14);
    flight.fly_seconds(300);
    let adjustment = flight.monitor.monitor_output();
    let (run, offset_rad2) = adjustment.run_and_heading_offset_variance.unwrap();
    let euler_rates = EulerRates { heading_rad_s: 0.3, ..EulerRates::default() };
    let turning = GyroHeading { euler_rates, relative_heading_rad: 1.0, run_number: run };
    let by_gyro = 1.0 + adjustment.states[GYRO_HEADING_OFFSET_INDEX] + 0.3 * adjustment.states[ATTITUDE_LATENCY_INDEX];
    let sigma_rad = 0.02;
    let limit = 4.5 * (sigma_rad * sigma_rad + offset_rad2).sqrt();
    let agrees = |off_rad: f32, turning: Option<&GyroHeading>| {
        let heading = Heading { magnetic_rad: by_gyro + off_rad, sigma_rad, systematic_variance_rad2: 0.0 };
        adjustment.passes_reading_gate(heading, turning)
    };
    for sign in [1.0, -1.0] {
        assert!(agrees(sign * 0.98 * limit, Some(&turning)) && !agrees(sign * 1.02 * limit, Some(&turning)));
    }
    assert!(agrees(1.0, None) && agrees(1.0, Some(&GyroHeading { run_number: run.wrapping_add(1), ..turning })));
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
        MonitorOutput { states, coefficient_variance_factor: 0.5, sample_noise: variances, ..MonitorOutput::INITIAL }
            .correct_calibration(&monitored);
    let field = Field::from_ut(20.0, -10.0, 30.0);
    let moved = calibration.calibrated_field(field).ut - found.calibrated_field(field).ut;
    assert!((moved - Vector3::new(1.0, -2.0, 3.0)).norm() < 1e-4, "{moved}");
    assert!((found.total_ut - 55.0).abs() < 1e-4 && (found.inclination_rad - 0.95).abs() < 1e-6);
    // The mean of four readings has half the sigma of one.
    assert!((adapted.relative_sensor_sigma - 0.02).abs() < 1e-6 && (adapted.attitude_sigma_rad - 0.02).abs() < 1e-6);
    let unchanged = MonitorOutput::INITIAL.correct_calibration(&monitored);
    assert_eq!(adapted.reduced_covariance, [[5e-5; 10]; 6]);
    assert_eq!(unchanged, (calibration, uncertainty));
}
