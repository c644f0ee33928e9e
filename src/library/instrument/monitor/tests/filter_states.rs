//! States of the filter: process noise, decay, inflation after a detected change.

use super::*;
use crate::attitude::BodyRates;

#[test]
fn each_state_receives_all_of_its_process_noise() {
    let mut samples = [0; STATE_COUNT];
    for (i, interval) in (0..NOISE_SCHEDULE_STEPS).map(noise_schedule) {
        samples[i] += interval;
    }
    assert_eq!(samples, [NOISE_SCHEDULE_STEPS; STATE_COUNT]);
}

/// In level flight the filter starts again from the turn that explains a new disturbance; in a bank its own estimate is
/// only less certain. A field disturbed for long is not explained by a turn, and contradicts an estimated
/// one.
#[test]
fn only_a_new_disturbance_may_be_a_mount_turn() {
    const HEADING_RESIDUAL_RAD: f32 = 0.3;
    const HARD_IRON: f32 = 0.2;
    const STAYING_IRON: f32 = 0.05;
    let initial_rad2 = state_noise(MOUNT_TURN_INDEX, SensorErrorSigmas::DEFAULT, false).initial_sigma.powi(2);
    // Time withheld, level flight, estimated turn, turn that explains the field; expected turn and its added sigma.
    for (withheld_s, is_level, estimated_rad, explaining_rad, [expected_rad, added_sigma_rad]) in [
        (1.0, true, 0.0, Some(0.2), [0.2, HEADING_RESIDUAL_RAD]),
        (1.0, true, 0.5, Some(0.0), [0.0, 0.5]),
        // The sigma is limited to 34 deg.
        (1.0, true, 0.5, Some(-0.5), [-0.5, 0.6]),
        (1.0, false, 0.1, Some(0.5), [0.1, 0.0]),
        (1.0, true, 0.1, None, [0.1, 0.0]),
        (10.0, true, 0.0, Some(0.2), [0.0, 0.0]),
        (10.0, true, -0.1, Some(-0.09), [-0.1, 0.0]),
        (10.0, true, 0.02, None, [0.02, 0.0]),
        (10.0, true, 0.1, Some(-0.1), [0.0, HEADING_RESIDUAL_RAD]),
        (10.0, true, -0.5, None, [0.0, 0.5]),
    ] {
        let case = format!("{withheld_s} s, level {is_level}, {estimated_rad}, {explaining_rad:?}");
        let mut monitor = withholding_monitor(withheld_s);
        monitor.filter.set_mean(MOUNT_TURN_INDEX, estimated_rad);
        monitor.filter.set_mean(HARD_IRON_CHANGE_INDEX, HARD_IRON);
        let staying_iron = Vector3::new(STAYING_IRON, 0.0, 0.0);
        let turn = explaining_rad.map(|turn_rad| ExplainedTurn { turn_rad, hard_iron_change: staying_iron });
        monitor.attribute_to_mount_turn(turn, is_level, [0.0, 0.0, HEADING_RESIDUAL_RAD]);
        let states = monitor.filter.mean();
        assert!((states[MOUNT_TURN_INDEX] - expected_rad).abs() < 1e-6, "{case}");
        let expected_rad2 = initial_rad2 + added_sigma_rad * added_sigma_rad;
        assert!((monitor.filter.state_variance(MOUNT_TURN_INDEX) / expected_rad2 - 1.0).abs() < 1e-4, "{case}");
        let hard_iron = match expected_rad {
            rad if (rad - estimated_rad).abs() < 1e-6 => HARD_IRON,
            rad if explaining_rad.is_some_and(|explaining| (rad - explaining).abs() < 1e-6) => STAYING_IRON,
            _ => 0.0,
        };
        assert!((states[HARD_IRON_CHANGE_INDEX] - hard_iron).abs() < 1e-6, "{case}");
    }
}

/// Hard iron across the field turns the heading by it over `cos I`. The attitude has half of the change, of which a
/// tilt error turns the heading by `tan I`; the Earth's field 0.3 of it.
#[test]
fn a_detected_change_inflates_the_states_that_explain_it() {
    // Inclination; residuals of strength, inclination and heading; added sigmas of hard iron, Earth's field, tilt and, in a
    // bank, the mount's turn.
    for (inclination_rad, residuals, [hard_iron, earth_field, tilt_rad, mount_turn_rad]) in [
        (1.0, [0.06, 0.1, 0.4], [0.216, 0.03, 0.128, 0.4]),
        (-1.0, [0.2, 0.1, 0.0], [0.2, 0.06, 0.05, 0.1]),
        // Limits: half the field, 17 deg of tilt, 34 deg of the mount.
        (1.0, [0.9, 0.0, 3.0], [0.5, 0.15, 0.15, 0.6]),
        // At the magnetic equator the share of the attitude is that of 17 deg of inclination.
        (0.0, [0.0, 0.0, 0.06], [0.06, 0.0, 0.1, 0.06]),
    ] {
        for (roll_rad, bank_scale_error) in [(0.0, 0.0), (0.5, 2.0 * tilt_rad), (-0.5, 2.0 * tilt_rad)] {
            let mut monitor = Monitor::new(SensorErrorSigmas::DEFAULT);
            let (states, before) = (*monitor.filter.mean(), state_variances(&monitor));
            let predicted = PredictedField::new(&states, inclination_rad, None);
            let sample = sample_at_rest(inclination_rad, RollPitch::default());
            monitor.inflate_covariance(&MeasurementModel::new(&sample, &states, &predicted), residuals, roll_rad);
            let mut expected = [0.0; STATE_COUNT];
            expected[..3].fill(hard_iron);
            expected[STRENGTH_CHANGE_INDEX..=INCLINATION_CHANGE_INDEX].fill(earth_field);
            expected[ROLL_BIAS_INDEX..=PITCH_BIAS_INDEX].fill(tilt_rad);
            expected[BANK_SCALE_ERROR_INDEX] = bank_scale_error;
            expected[MOUNT_TURN_INDEX] = if roll_rad == 0.0 { 0.0 } else { mount_turn_rad };
            for (i, variance) in state_variances(&monitor).into_iter().enumerate() {
                let added = sqrt((variance - before[i]).max(0.0));
                assert!((added - expected[i]).abs() < 2e-3, "{inclination_rad} {residuals:?} {roll_rad}: {i}: {added}");
            }
            assert_eq!(monitor.is_strength_test_failed, residuals[0] > 0.0);
        }
    }
}

/// In 100 s, a tenth of the time constant. Changed hard iron and a turned mount are real and persist, as do the place
/// and the gyro's states.
#[test]
fn unobserved_states_decay_and_detected_changes_persist() {
    for (hard_iron, mount_turn_rad, remaining) in [(0.01, -0.02, 0.9), (0.05, -0.06, 1.0)] {
        let mut monitor = Monitor::new(SensorErrorSigmas::DEFAULT);
        let mut states = [0.1; STATE_COUNT];
        states[..3].fill(hard_iron);
        states[MOUNT_TURN_INDEX] = mount_turn_rad;
        states.iter().enumerate().for_each(|(i, state)| monitor.filter.set_mean(i, *state));
        monitor.predict_state(0.0, 100.0);
        for (i, (found, before)) in monitor.filter.mean().iter().zip(states).enumerate() {
            let share = match i {
                ..STRENGTH_CHANGE_INDEX => remaining,
                ROLL_BIAS_INDEX..GYRO_HEADING_OFFSET_INDEX => 0.9,
                _ => 1.0,
            };
            assert!((found - share * before).abs() < 1e-6, "{hard_iron}: {i}: {found}");
        }
    }
}

/// Errors of the reported attitude with a correlation time of 0.25 s, half of the assumed time, turn the gyro's heading by its
/// process noise. The variance of 400 walks of 20 s has a standard error of 7 %. In a level turn without pitching the heading does
/// not depend on the errors.
#[test]
fn the_gyro_heading_walks_by_errors_of_the_attitude() {
    const ERROR_STEP_S: f32 = 0.01;
    let flight = Flight::new(1);
    let monitored = monitored_calibration(&flight.calibration, &flight.uncertainty);
    let mut random = Random(3);
    for (attitude_deg, pitch_rad_s, heading_rad_s) in
        [([40.0, 30.0], 0.0, 0.4), ([-20.0, 10.0], 0.5, 0.0), ([10.0, -35.0], -0.4, 0.6), ([40.0, 0.0], 0.0, 0.4)]
    {
        let attitude = RollPitch::from_deg(attitude_deg[0], attitude_deg[1]);
        let euler_rates = EulerRates { pitch_rad_s, heading_rad_s, ..EulerRates::default() };
        let body_rates = BodyRates::from_rad_s(euler_rates.to_body_rates(attitude)).unwrap();
        let mut walk_rad = || {
            let (mut error, mut turned_rad) = ([0.0; 2], 0.0);
            for _ in 0..2000 {
                let kept = 1.0 - ERROR_STEP_S / 0.25;
                error = error.map(|error| kept * error + sqrt(1.0 - kept * kept) * TILT_SIGMA_RAD * random.normal());
                let [roll_rad, pitch_rad] = [attitude.roll_rad + error[0], attitude.pitch_rad + error[1]];
                let reported = EulerRates::from_body_rates(body_rates, RollPitch { roll_rad, pitch_rad });
                turned_rad += (reported.heading_rad_s - heading_rad_s) * ERROR_STEP_S;
            }
            turned_rad
        };
        let walked = (0..400).map(|_| square(walk_rad())).sum::<f32>() / 400.0;
        let rows = GyroErrorRows::new(attitude, &euler_rates);
        let expected = 20.0 * flight.monitor.heading_noise_by_tilt(&monitored, &rows);
        assert!((walked - expected).abs() <= 0.25 * expected + 1e-8, "{attitude_deg:?}: {walked} {expected}");
    }
}

/// Without measurements no variance grows beyond its initial one, but that of the gyro's heading, by 0.06 deg in a
/// second; after a detected change that of hard iron as well, for a minute.
#[test]
fn process_noise_ends_at_the_initial_variance() {
    let errors = SensorErrorSigmas { hard_iron_drift_per_minute: 0.001, ..SensorErrorSigmas::DEFAULT };
    let mut monitor = Monitor::new(errors);
    let initial = state_variances(&monitor);
    let predict_rounds = |monitor: &mut Monitor, rounds: usize| {
        (0..rounds * NOISE_SCHEDULE_STEPS).for_each(|_| monitor.predict_state(0.0, STEP_S));
        state_variances(monitor)
    };
    let now = predict_rounds(&mut monitor, 20);
    let elapsed_s = 20.0 * NOISE_SCHEDULE_STEPS as f32 * STEP_S;
    assert!((now[GYRO_HEADING_OFFSET_INDEX] - initial[GYRO_HEADING_OFFSET_INDEX] - 1e-6 * elapsed_s).abs() < 1e-4);
    for i in (0..STATE_COUNT).filter(|i| *i != GYRO_HEADING_OFFSET_INDEX) {
        assert_eq!(now[i].to_bits(), initial[i].to_bits(), "{i}");
    }
    monitor.post_change_remaining_s = POST_CHANGE_S;
    let now = predict_rounds(&mut monitor, 40);
    for i in (0..STATE_COUNT).filter(|i| *i != GYRO_HEADING_OFFSET_INDEX) {
        // Process noise of 1e-6 per second for 60 s, added every 3.6 s.
        let expected = if HARD_IRON_INDICES.contains(&i) { 6e-5 } else { 0.0 };
        assert!((now[i] - initial[i] - expected).abs() < 0.37e-5, "{i}");
    }
}

/// The magnetic heading then sets it. Otherwise the gyro's jump by 57 deg contradicts the field: a sensor that stuck in the gap is found.
#[test]
fn the_gyro_heading_offset_restarts_after_a_gap() {
    // Gap in seconds, another run of the gyro's integration; whether the offset restarts.
    for (gap_s, is_new_run, is_restarted) in
        [(0, false, false), (2, false, false), (20, false, false), (61, false, true), (0, true, true)]
    {
        let mut flight = Flight::new(3);
        flight.fly_seconds(30);
        flight.sample_count += 10 * gap_s;
        flight.gyro_run_number += u8::from(is_new_run);
        flight.gyro_heading_offset_rad += 1.0;
        let after_jump = flight.fly_seconds(10);
        let case = format!("{gap_s} s, new run {is_new_run}");
        assert_eq!(after_jump.empty_reasons.is_empty(), is_restarted, "{case}: {after_jump:?}");
        assert!(!is_restarted || after_jump.worst_error_deg < 4.5, "{case}: {after_jump:?}");
    }
}

type MonitorChange = fn(&mut Monitor);

/// The states may not model a change that was detected within the last minute, or that remains.
#[test]
fn the_heading_variance_is_threefold_while_a_change_remains_and_falls_within_a_minute_of_it() {
    let heading_variance_rad2 = |change: MonitorChange| {
        let mut flight = Flight::new(3);
        flight.fly_seconds(90);
        change(&mut flight.monitor);
        flight.fly_sample().unwrap();
        flight.monitor.monitor_output().heading_variance_rad2
    };
    let unchanged_rad2 = heading_variance_rad2(|monitor| monitor.post_change_remaining_s = 0.2);
    let cases: [(&str, MonitorChange, [f32; 2]); 4] = [
        // The filter's own variance grows as well, because the state contradicts the field.
        ("hard iron", |monitor| monitor.filter.set_mean(HARD_IRON_CHANGE_INDEX, -0.05), [2.25, 6.0]),
        ("mount", |monitor| monitor.filter.set_mean(MOUNT_TURN_INDEX, 0.06), [2.25, 6.0]),
        ("just detected", |monitor| monitor.post_change_remaining_s = 60.0, [2.85, 3.15]),
        ("detected 30 s ago", |monitor| monitor.post_change_remaining_s = 30.0, [1.9, 2.1]),
    ];
    for (case, change, [lowest, highest]) in cases {
        let inflation = heading_variance_rad2(change) / unchanged_rad2;
        assert!((lowest..highest).contains(&inflation), "{case}: {inflation}");
    }
}

/// Other axes of the hard iron may have drifted as much as the observed one; a turn of the mount shows in a bank only.
#[test]
fn a_drift_inflates_hard_iron_and_in_a_bank_the_mount() {
    // Drift along x relative to the field, samples since, bank, remaining time after a detected change, axis across the
    // horizontal field; whether hard iron and mount are inflated.
    for (drift, samples, roll_rad, post_change_s, across, is_inflated) in [
        (-0.01, 1, 0.05, 0.0, 1, [true, false]),
        (0.01, 1, 0.4, 0.0, 1, [true, true]),
        (0.01, 1, -0.4, 0.0, 1, [true, true]),
        (0.002, 1, 0.4, 0.0, 1, [false, false]),
        // A change that was detected has ended after some seconds.
        (0.01, 1, 0.4, 1.0, 1, [true, true]),
        (0.01, 40, 0.4, 1.0, 1, [false, false]),
        (0.01, 40, 0.4, 0.0, 1, [true, true]),
        // An error of the gyro's offset moves this axis.
        (0.01, 1, 0.4, 0.0, 0, [false, false]),
        // With the derivative below, 34 deg of heading.
        (0.3, 1, 0.4, 1.0, 1, [false, false]),
        (0.3, 1, 0.4, 0.0, 1, [true, true]),
    ] {
        let mut monitor = Monitor::new(SensorErrorSigmas::DEFAULT);
        monitor.filter.set_mean(HARD_IRON_CHANGE_INDEX, drift);
        monitor.post_change_remaining_s = post_change_s;
        let mut heading_jacobian = [0.0; STATE_COUNT];
        heading_jacobian[HARD_IRON_CHANGE_INDEX + across] = 2.0;
        (1..samples).for_each(|_| monitor.inflate_by_drift(roll_rad, &heading_jacobian, STEP_S));
        let before = state_variances(&monitor);
        monitor.inflate_by_drift(roll_rad, &heading_jacobian, STEP_S);
        let now = state_variances(&monitor);
        let is_larger = |i: usize| now[i] > before[i];
        let case = format!("{drift} {samples} {roll_rad} {post_change_s} {across}");
        assert_eq!(HARD_IRON_INDICES.map(is_larger), [is_inflated[0]; 3], "{case}");
        assert_eq!(is_larger(MOUNT_TURN_INDEX), is_inflated[1], "{case}");
        assert!((STRENGTH_CHANGE_INDEX..STATE_COUNT).all(|i| !is_larger(i)), "{case}");
    }
}

/// A heading that is off by 0.3 rad at an inclination of 60 deg: a third of the horizontal field's 0.15 in a sample,
/// less the variance of the innovation.
#[test]
fn an_unexplained_change_inflates_hard_iron_except_in_a_turn() {
    let added_variance = |residual: f32, heading_rad_s: f32| {
        let mut monitor = Monitor::new(SensorErrorSigmas::DEFAULT);
        let states = *monitor.filter.mean();
        let sample = sample_at_rest(60_f32.to_radians(), RollPitch::default());
        let model = MeasurementModel::new(&sample, &states, &PredictedField::new(&states, 60_f32.to_radians(), None));
        let offset = GyroOffsetEstimate { offset_rad_s: 0.0, variance: 1e-6 };
        (0..50).for_each(|_| monitor.heading_drift.update_drift(offset, heading_rad_s, STEP_S));
        let before = state_variances(&monitor)[HARD_IRON_CHANGE_INDEX];
        let innovations = [None, None, Some(Innovation { residual, variance: 0.01 })];
        monitor.inflate_by_unexplained_change(&model, innovations, STEP_S);
        state_variances(&monitor)[HARD_IRON_CHANGE_INDEX] - before
    };
    for (residual, heading_rad_s, expected) in
        [(0.3, 0.0, 0.08 / 4.0 / 3.0), (-0.3, 0.0, 0.08 / 4.0 / 3.0), (0.09, 0.0, 0.0), (0.3, 0.2, 0.0)]
    {
        let found = added_variance(residual, heading_rad_s);
        assert!((found - expected).abs() < 1e-5, "{residual} {heading_rad_s}: {found}");
    }
}

/// Roll bias of 0.1 rad with an effect of 1.5 on the heading, a turn of the mount of 0.2 rad with 1.
#[test]
fn other_causes_beside_changed_hard_iron_count_as_variance() {
    let (mut jacobian, mut states) = ([0.0; STATE_COUNT], [0.0; STATE_COUNT]);
    (jacobian[ROLL_BIAS_INDEX], states[ROLL_BIAS_INDEX]) = (1.5, 0.1);
    (jacobian[PITCH_BIAS_INDEX], states[PITCH_BIAS_INDEX]) = (-1.0, 0.2);
    for (hard_iron_change, expected) in [(0.0, 0.0), (0.029, 0.0), (0.1, 0.4 * (0.0225 + 0.04))] {
        let change = Vector3::new(0.0, hard_iron_change, 0.0);
        let found = alternative_cause_variance_rad2(&change, &jacobian, &states);
        assert!((found - expected).abs() < 1e-6, "{hard_iron_change}: {found}");
    }
}

#[test]
fn measurement_noise_follows_inclination_rotation_and_averaging() {
    let added_variances = |inclination_rad: f32, pitch_rad_s: f32, readings_per_sample: u16| {
        let mut flight = Flight::new(0);
        flight.uncertainty.relative_sensor_sigma = 4.0 * STRENGTH_SIGMA;
        let sample = MonitorSample {
            euler_rates: EulerRates { pitch_rad_s, ..EulerRates::default() },
            ..sample_at_rest(inclination_rad, RollPitch::default())
        };
        let states = *flight.monitor.filter.mean();
        let model = MeasurementModel::new(&sample, &states, &PredictedField::new(&states, inclination_rad, None));
        let monitored = MonitoredCalibration {
            readings_per_sample,
            ..monitored_calibration(&flight.calibration, &flight.uncertainty)
        };
        let found = flight.monitor.measurement_variances(&monitored, &sample, &model, &Vector3::x(), STEP_S);
        [0, 1, 2].map(|kind| found[kind] - VARIANCE_FLOORS[kind])
    };
    let [strength, tilt, heading] = added_variances(0.5, 0.0, 1);
    let [_, _, steep_heading] = added_variances(-1.2, 0.0, 1);
    let tangent_ratio = 1.2_f32.tan() / 0.5_f32.tan();
    assert!((steep_heading / heading / tangent_ratio.powi(2) - 1.0).abs() < 0.01, "{heading} {steep_heading}");
    // 10 ms at 0.5 rad/s are a tilt of one sigma of the attitude.
    let [_, rotating_tilt, _] = added_variances(0.5, 0.5, 1);
    assert!((rotating_tilt / tilt - 2.0).abs() < 0.02, "{rotating_tilt} {tilt}");
    // The mean of four readings has half the sigma of one.
    let [mean_strength, ..] = added_variances(0.5, 0.0, 4);
    assert!((strength / mean_strength - 4.0).abs() < 0.04, "{strength} {mean_strength}");
}
