//! States of the filter: process noise, decay, inflation after a detected change.

use super::*;

#[test]
fn each_state_receives_all_of_its_process_noise() {
    let mut samples = [0; STATE_COUNT];
    for (i, interval) in (0..NOISE_SCHEDULE_STEPS).map(noise_schedule) {
        samples[i] += interval;
    }
    assert_eq!(samples, [NOISE_SCHEDULE_STEPS; STATE_COUNT]);
}

fn state_variances(monitor: &Monitor) -> StateVector {
    array::from_fn(|i| monitor.filter.state_variance(i))
}

/// The first 5 s of a disturbance may be a turn of the module: in level flight it starts again from that turn, in a
/// bank the turn is only less certain. Later an estimated turn of more than 2.3 deg must still explain the field.
#[test]
fn a_mount_turn_is_assumed_only_in_the_first_5_s() {
    const HEADING_RESIDUAL_RAD: f32 = 0.3;
    let initial_rad2 = state_noise(MOUNT_TURN_INDEX, SensorErrorSigmas::DEFAULT).initial_sigma.powi(2);
    let inflated = |sigma_rad: f32| initial_rad2 + sigma_rad * sigma_rad;
    let (by_heading, unchanged) = (inflated(HEADING_RESIDUAL_RAD), initial_rad2);
    // Time withheld, level flight, estimate, explanation of the field; expected estimate, its variance.
    for (withheld_s, is_level, estimated_rad, turn_rad, expected_rad, variance) in [
        (4.9, true, 0.0, Some(0.2), 0.2, by_heading),
        (4.9, true, 0.5, Some(0.0), 0.0, inflated(0.5)),
        (4.9, false, 0.1, Some(0.2), 0.1, by_heading),
        (4.9, false, 0.1, Some(0.5), 0.1, inflated(0.4)),
        (4.9, true, 0.1, None, 0.1, unchanged),
        (5.1, true, 0.0, Some(0.2), 0.0, unchanged),
        (5.1, false, 0.1, Some(0.13), 0.1, unchanged),
        (5.1, true, -0.1, Some(-0.07), -0.1, unchanged),
        (5.1, true, 0.039, None, 0.039, unchanged),
        (5.1, true, -0.041, None, 0.0, by_heading),
        (5.1, true, 0.1, Some(0.15), 0.0, by_heading),
        (5.1, true, 0.1, Some(-0.1), 0.0, by_heading),
        (5.1, true, 0.5, None, 0.0, inflated(0.5)),
        // The sigma is limited to 34 deg.
        (4.9, true, 0.5, Some(-0.5), -0.5, inflated(0.6)),
    ] {
        let case = format!("{withheld_s} s, level {is_level}, {estimated_rad}, {turn_rad:?}");
        let mut monitor = withholding_monitor(withheld_s);
        monitor.filter.set_mean(MOUNT_TURN_INDEX, estimated_rad);
        for axis in HARD_IRON_INDICES {
            monitor.filter.set_mean(axis, 0.2);
        }
        monitor.attribute_to_mount_turn(turn_rad, is_level, [0.0, 0.0, HEADING_RESIDUAL_RAD]);
        assert!((monitor.filter.mean()[MOUNT_TURN_INDEX] - expected_rad).abs() < 1e-6, "{case}");
        assert!((monitor.filter.state_variance(MOUNT_TURN_INDEX) / variance - 1.0).abs() < 1e-4, "{case}");
        let is_restarted = (expected_rad - estimated_rad).abs() > 1e-6;
        let hard_iron = if is_restarted { 0.0 } else { 0.2 };
        assert!(HARD_IRON_INDICES.iter().all(|axis| (monitor.filter.mean()[*axis] - hard_iron).abs() < 1e-6), "{case}");
    }
}

/// A change that strength shows as 0.06, inclination as 0.1 and the heading as 0.4 rad: hard iron across the field is
/// the heading's times `cos I`; a tilt error has half of the larger of inclination and heading over `tan I`, and in a
/// bank of 0.5 rad twice that as an error in proportion to the bank. The Earth's field has 0.3 of its change.
#[test]
fn a_detected_change_inflates_the_states_that_explain_it() {
    // Inclination of the field; residuals; expected sigmas of hard iron, strength and inclination, attitude bias.
    for (roll_rad, (inclination_rad, residuals, [hard_iron, field, tilt_rad])) in [
        (1.0_f32, [0.06, 0.1, 0.4], [0.216_12, 0.03, 0.128_42]),
        (-1.0, [0.06, 0.1, 0.4], [0.216_12, 0.03, 0.128_42]),
        (1.0, [0.06, 0.1, 0.0], [0.1, 0.03, 0.05]),
        (1.0, [0.2, 0.1, 0.0], [0.2, 0.06, 0.05]),
        // Limits: half the field, 17 deg of tilt.
        (1.0, [0.9, 0.0, 3.0], [0.5, 0.15, 0.15]),
        // At the magnetic equator the share of the attitude is that of 17 deg of inclination.
        (0.0, [0.0, 0.0, 0.06], [0.06, 0.0, 0.1]),
    ]
    .into_iter()
    .flat_map(|case| [0.0, 0.16, 0.5, -0.5].map(|roll_rad| (roll_rad, case)))
    {
        let mut monitor = Monitor::new(SensorErrorSigmas::DEFAULT);
        let states = *monitor.filter.mean();
        let monitor_sample = MonitorSample {
            field: Field::<crate::frames::Level>::earth_field(1.0, inclination_rad, 0.0).ut,
            mount_turn_effect: MountTurnEffect::new(&Flight::new(0).calibration, &Vector3::x()),
            attitude: Attitude::default(),
            euler_rates: EulerRates::default(),
        };
        let model =
            MeasurementModel::new(&monitor_sample, &states, &PredictedField::new(&states, inclination_rad, None));
        let before = state_variances(&monitor);
        monitor.inflate_covariance(&model, residuals, roll_rad);
        let added: StateVector = array::from_fn(|i| sqrt((state_variances(&monitor)[i] - before[i]).max(0.0)));
        let mut expected = [0.0; STATE_COUNT];
        expected[..3].fill(hard_iron);
        expected[STRENGTH_CHANGE_INDEX..=INCLINATION_CHANGE_INDEX].fill(field);
        expected[ROLL_BIAS_INDEX..=PITCH_BIAS_INDEX].fill(tilt_rad);
        expected[BANK_SCALE_ERROR_INDEX] = if roll_rad.abs() > 0.17 { 2.0 * tilt_rad } else { 0.0 };
        for (i, (added, expected)) in added.into_iter().zip(expected).enumerate() {
            assert!(
                (added - expected).abs() < 2e-4,
                "{roll_rad} {inclination_rad} {residuals:?}: {i}: {added}, not {expected}"
            );
        }
        assert_eq!(monitor.is_strength_test_failed, residuals[0] > 0.0);
        assert!((monitor.post_change_remaining_s - 60.0).abs() < 1e-6);
    }
}

/// In 100 s, a tenth of the time constant. Changes beyond 1.5 uT of 50 and 2.3 deg are real and persist, as do the
/// gyro's states and the place.
#[test]
fn unobserved_states_decay_and_detected_changes_persist() {
    for (hard_iron, mount_turn_rad) in [(0.01_f32, 0.039_f32), (0.01, -0.041), (0.03, 0.039), (0.03, 0.041)] {
        let mut monitor = Monitor::new(SensorErrorSigmas::DEFAULT);
        let mut expected = [0.1; STATE_COUNT];
        expected[..3].fill(hard_iron);
        expected[MOUNT_TURN_INDEX] = mount_turn_rad;
        expected.iter().enumerate().for_each(|(i, state)| monitor.filter.set_mean(i, *state));
        monitor.predict_state(100.0);
        if hard_iron < 0.02 {
            expected[..3].iter_mut().for_each(|state| *state *= 0.9);
        }
        if mount_turn_rad.abs() < 0.04 {
            expected[MOUNT_TURN_INDEX] *= 0.9;
        }
        expected[ROLL_BIAS_INDEX..GYRO_HEADING_OFFSET_INDEX].iter_mut().for_each(|state| *state *= 0.9);
        for (i, (state, expected)) in monitor.filter.mean().iter().zip(expected).enumerate() {
            assert!((state - expected).abs() < 1e-6, "{hard_iron} {mount_turn_rad}: {i}: {state}");
        }
    }
}

/// Without measurements no variance grows beyond its initial one, but that of the gyro's heading, by 0.06 deg in a
/// second; after a detected change that of hard iron as well, for a minute.
#[test]
fn process_noise_ends_at_the_initial_variance() {
    let errors = SensorErrorSigmas { hard_iron_drift_per_minute: 0.001, ..SensorErrorSigmas::DEFAULT };
    let mut monitor = Monitor::new(errors);
    let initial = state_variances(&monitor);
    for _ in 0..20 * NOISE_SCHEDULE_STEPS {
        monitor.predict_state(STEP_S);
    }
    let now = state_variances(&monitor);
    for i in (0..STATE_COUNT).filter(|i| *i != GYRO_HEADING_OFFSET_INDEX) {
        assert_eq!(now[i].to_bits(), initial[i].to_bits(), "{i}");
    }
    let elapsed_s = 20.0 * NOISE_SCHEDULE_STEPS as f32 * STEP_S;
    assert!((now[GYRO_HEADING_OFFSET_INDEX] - initial[GYRO_HEADING_OFFSET_INDEX] - 1e-6 * elapsed_s).abs() < 1e-4);
    monitor.post_change_remaining_s = POST_CHANGE_S;
    for _ in 0..40 * NOISE_SCHEDULE_STEPS {
        monitor.predict_state(STEP_S);
    }
    // Process noise of 1e-6 per second for 60 s, added every 3.6 s.
    for axis in HARD_IRON_INDICES {
        let grown = monitor.filter.state_variance(axis) - initial[axis];
        assert!((grown - 6e-5).abs() < 0.37e-5, "{axis}: {grown}");
    }
    assert_eq!(
        monitor.filter.state_variance(STRENGTH_CHANGE_INDEX).to_bits(),
        initial[STRENGTH_CHANGE_INDEX].to_bits()
    );
}

/// After a restart of the gyro's integration, or a gap of more than 3 s, the magnetic heading sets the offset.
#[test]
fn the_gyro_heading_offset_restarts_after_a_gap() {
    for (run_number, step_s, is_restarted) in [(0, 3.0, false), (0, 3.1, true), (1, 0.1, true), (0, 0.1, false)] {
        let mut flight = Flight::new(3);
        flight.fly_seconds(30);
        let (attitude, euler_rates, heading_rad) = motion_at(flight.now_s());
        let monitor_sample = MonitorSample {
            field: attitude.to_body_frame(Field::earth_field(1.0, INCLINATION_RAD, heading_rad)).ut,
            mount_turn_effect: MountTurnEffect::new(&flight.calibration, &Vector3::x()),
            attitude,
            euler_rates,
        };
        let before = (
            flight.monitor.filter.mean()[GYRO_HEADING_OFFSET_INDEX],
            flight.monitor.filter.state_variance(GYRO_HEADING_OFFSET_INDEX),
        );
        let gyro_heading = GyroHeading { euler_rates, relative_heading_rad: 3.0, run_number };
        flight.monitor.initialise_gyro_heading_offset(&monitor_sample, Some(gyro_heading), step_s);
        let after = (
            flight.monitor.filter.mean()[GYRO_HEADING_OFFSET_INDEX],
            flight.monitor.filter.state_variance(GYRO_HEADING_OFFSET_INDEX),
        );
        if is_restarted {
            // Three sigmas of the heading error by attitude states, which are not estimated yet.
            assert!(wrap_pi(after.0 - (heading_rad - 3.0)).abs() < 0.03 && after.0.abs() <= PI, "{after:?}");
            assert!((after.1 - before.1 - 10.0).abs() < 1e-4, "{after:?}");
        } else {
            assert_eq!(after, before);
        }
        assert_eq!(flight.monitor.gyro_run_number, Some(run_number));
    }
}

/// Without a recent detection, hard iron or a mount that remains changed inflates the heading variance threefold.
#[test]
fn a_remaining_change_inflates_the_heading_variance() {
    let sigma_deg = |state, value| {
        let mut flight = Flight::new(3);
        flight.fly_seconds(90);
        flight.monitor.filter.set_mean(state, value);
        let (_, sigma_deg) = flight.fly_sample().unwrap();
        assert!(flight.monitor.post_change_remaining_s <= 0.0);
        sigma_deg
    };
    let unchanged_deg = sigma_deg(HARD_IRON_CHANGE_INDEX, 0.0);
    for (state, value) in [(HARD_IRON_CHANGE_INDEX, 0.05), (HARD_IRON_CHANGE_INDEX, -0.05), (MOUNT_TURN_INDEX, 0.06)] {
        assert!(sigma_deg(state, value) > 1.5 * unchanged_deg, "{state} {value}: {unchanged_deg}");
    }
}

/// Threefold at the detection, once the minute is over as before it.
#[test]
fn the_inflation_after_a_change_ends_within_a_minute() {
    let heading_variance_rad2 = |remaining_s| {
        let mut flight = Flight::new(3);
        flight.fly_seconds(90);
        flight.monitor.post_change_remaining_s = remaining_s;
        flight.fly_sample().unwrap();
        flight.monitor.monitor_output().heading_variance_rad2
    };
    let [begin, middle, end] = [60.0, 30.0, 0.2].map(heading_variance_rad2);
    assert!(
        (middle / begin - 2.0 / 3.0).abs() < 0.05 && (end / begin - 1.0 / 3.0).abs() < 0.05,
        "{begin} {middle} {end}"
    );
}

/// A drift of 0.01 of the field per minute adds twice its square per minute to hard iron and, banked, the mount.
#[test]
fn a_drift_inflates_hard_iron_and_in_a_bank_the_mount() {
    for (drift, roll_rad, [hard_iron, mount]) in
        [(0.01, 0.16, [1.0, 0.0]), (-0.01, 0.18, [1.0, 1.0]), (0.01, -0.18, [1.0, 1.0]), (0.0039, 0.18, [0.0, 0.0])]
    {
        let mut monitor = Monitor::new(SensorErrorSigmas::DEFAULT);
        let before = state_variances(&monitor);
        monitor.filter.set_mean(HARD_IRON_CHANGE_INDEX, drift);
        monitor.inflate_by_drift(roll_rad, 1e-3);
        let rate = 2.0 * drift * drift * 1e-3 / 60.0;
        let mut expected = [0.0; STATE_COUNT];
        expected[..3].fill(hard_iron * rate);
        expected[MOUNT_TURN_INDEX] = mount * rate;
        for (i, (now, before)) in state_variances(&monitor).into_iter().zip(before).enumerate() {
            assert!((now - before - expected[i]).abs() < 0.02 * rate, "{drift} {roll_rad}: {i}");
        }
        // No inflation within the time after a detected change.
        monitor.post_change_remaining_s = 1.0;
        let before = state_variances(&monitor);
        monitor.inflate_by_drift(roll_rad, 1e-3);
        assert_eq!(state_variances(&monitor).map(f32::to_bits), before.map(f32::to_bits));
    }
}

/// Heading noise is three quarters of the tilt's variance times the squared tangent of the inclination, above floors.
/// Rotation adds 10 ms of tilt. The mean of four readings has half the sigma of one.
#[test]
fn measurement_noise_follows_inclination_and_rotation() {
    let variances = |inclination_rad: f32, pitch_rad_s: f32| {
        let mut flight = Flight::new(0);
        flight.uncertainty.relative_sensor_sigma = 2.0 * STRENGTH_SIGMA;
        let states = *flight.monitor.filter.mean();
        let monitor_sample = MonitorSample {
            field: Field::<crate::frames::Level>::earth_field(1.0, inclination_rad, 0.0).ut,
            mount_turn_effect: MountTurnEffect::new(&flight.calibration, &Vector3::x()),
            attitude: Attitude::default(),
            euler_rates: EulerRates { pitch_rad_s, ..EulerRates::default() },
        };
        let model =
            MeasurementModel::new(&monitor_sample, &states, &PredictedField::new(&states, inclination_rad, None));
        let monitored = MonitoredCalibration {
            calibration: &flight.calibration,
            uncertainty: &flight.uncertainty,
            readings_per_sample: 4,
        };
        let [strength, tilt, heading] =
            flight.monitor.measurement_variances(&monitored, &monitor_sample, &model, &Vector3::x(), STEP_S);
        let correlation = flight.monitor.adaptive_noise.unwrap().correlated_noise_factor();
        ([strength - 9e-6, tilt - 9e-6, heading - 1.44e-4], correlation)
    };
    for inclination_rad in [0.5_f32, -1.2] {
        let ([strength, tilt, heading], correlation) = variances(inclination_rad, 0.0);
        let expected = 0.75 * inclination_rad.tan().powi(2) * tilt;
        assert!((heading / expected - 1.0).abs() < 1e-3, "{heading} {expected}");
        assert!((strength / (4.0 * STRENGTH_SIGMA * STRENGTH_SIGMA) - 1.0).abs() < 0.01, "{strength}");
        let added = variances(inclination_rad, 0.5).0[1] - tilt;
        assert!((added / (correlation * 0.005 * 0.005) - 1.0).abs() < 0.01, "{added}");
    }
}
