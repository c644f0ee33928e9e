//! Changes of hard iron, mount, place, attitude and gyro that the monitor estimates.

use super::*;

/// 3 uT or more in level flight, in any direction: detected at once; heading usable within seconds; estimated within 30
/// % after a circle to either side.
#[test]
fn a_hard_iron_change_is_detected_and_reported() {
    for (i, change_ut) in
        [[3.0, 0.0, 0.0], [0.0, -5.0, 0.0], [0.0, 0.0, 5.0], [4.0, 4.0, -4.0], [-7.0, 6.0, 3.0]].into_iter().enumerate()
    {
        let case = format!("{change_ut:?}");
        let mut flight = Flight::new(i as u64);
        flight.fly_seconds(200);
        flight.errors.hard_iron_ut = change_ut;
        // Detection takes two samples beyond the wide gate, or six beyond the narrow one.
        let at_once = flight.fly_seconds(2);
        let is_error_small = at_once.heading_count <= 7 && at_once.worst_error_deg < 5.0;
        assert!(at_once.heading_count <= 1 || is_error_small, "{case}: {at_once:?}");
        flight.fly_seconds(18);
        flight.fly_seconds(60).assert_accurate(100, 8.0, &case);
        flight.fly_seconds(180).assert_accurate(0, 5.0, &case);
        let Some(InstallationChange::HardIron(reported_change)) = flight.monitor.monitor_output().installation_change
        else {
            panic!("{case}")
        };
        let off_ut = (reported_change.change_ut - Vector3::from(change_ut)).norm();
        assert!(off_ut < 0.3 * Vector3::from(change_ut).norm(), "{case}: {reported_change:?}");
        assert!(off_ut < 6.0 * reported_change.sigma_ut, "{case}: {reported_change:?}");
        flight.errors.hard_iron_ut = [0.0; 3];
        flight.fly_seconds(200);
        assert_eq!(flight.monitor.monitor_output().installation_change, None, "{case}");
    }
}

/// The airframe's hard iron of 15 uT stays while the module turns: 4.6 uT of change in its axes, which is not reported.
#[test]
fn a_turn_in_the_mount_is_estimated_and_reported() {
    for (turn_deg, seed) in [(5.0_f32, 1), (10.0, 2), (-10.0, 3), (-20.0, 4)] {
        let mut flight = Flight::new(seed);
        flight.calibration.b_ut = [12.0, -8.0, 5.0];
        flight.fly_seconds(200);
        flight.errors.mount_turn_rad = turn_deg.to_radians();
        flight.fly_seconds(180);
        flight.fly_seconds(400).assert_accurate(0, 4.5, &format!("{turn_deg} deg"));
        let Some(InstallationChange::Mount(reported_change)) = flight.monitor.monitor_output().installation_change
        else {
            panic!("{turn_deg}")
        };
        let off_deg = (reported_change.turn_rad.to_degrees() - turn_deg).abs();
        let is_accurate = off_deg < 1.5 && off_deg < 4.0 * reported_change.sigma_rad.to_degrees();
        assert!(is_accurate, "{turn_deg}: {reported_change:?}");
        flight.errors.mount_turn_rad = 0.0;
        flight.fly_seconds(400);
        assert_eq!(flight.monitor.monitor_output().installation_change, None, "{turn_deg}");
    }
}

/// The same field, with an attitude that turns with the module.
#[test]
fn a_module_with_its_own_attitude_never_turns_in_its_mount() {
    let mut flight = Flight { attitude: MonitoredAttitude::Own, ..Flight::new(2) };
    flight.calibration.b_ut = [12.0, -8.0, 5.0];
    flight.fly_seconds(200);
    flight.errors.mount_turn_rad = 10_f32.to_radians();
    flight.fly_seconds(580);
    let change = flight.monitor.monitor_output().installation_change;
    assert!(matches!(change, None | Some(InstallationChange::HardIron(_))), "{change:?}");
}

/// Pitch rates of 1 deg/s that the reported pitch does not follow are an offset of an autopilot's gyro. The own pitch is that of the own
/// gyro, whose offset the attitude filter knows better.
#[test]
fn pitch_rates_check_the_attitude_of_an_autopilot_alone() {
    let [by_autopilot, by_own] = [OF_AUTOPILOT, MonitoredAttitude::Own].map(|attitude| {
        let mut flight = Flight { attitude, ..Flight::new(2) };
        flight.errors.pitch_excursion_rate_rad_s = 1_f32.to_radians();
        flight.fly_seconds(20);
        flight.monitor.monitor_output().states[GYRO_RATE_OFFSET_INDICES[0]].to_degrees()
    });
    assert!(by_autopilot > 0.1 && by_own.abs() < 0.01, "{by_autopilot} {by_own}");
}

/// A field that changes in a turn, or that is not that of the attitude's time, may show errors of an autopilot's roll and delays of its
/// link, not of the own attitude.
#[test]
fn the_field_does_not_correct_the_own_attitude() {
    let iron = SimulatedErrors { hard_iron_ut: [3.0, -2.0, 4.0], ..SimulatedErrors::default() };
    let late = SimulatedErrors { latency_s: 0.1, ..SimulatedErrors::default() };
    // The turn begins after a minute.
    for (name, begin_s, errors, states) in [
        ("iron", 75, iron, &[ROLL_BIAS_INDEX, PITCH_BIAS_INDEX, BANK_SCALE_ERROR_INDEX][..]),
        ("late", 55, late, &[ATTITUDE_LATENCY_INDEX]),
    ] {
        let [by_autopilot, by_own] = [OF_AUTOPILOT, MonitoredAttitude::Own].map(|attitude| {
            let mut flight = Flight { attitude, ..Flight::new(2) };
            flight.fly_seconds(begin_s);
            flight.errors = errors;
            flight.fly_seconds(80 - begin_s);
            let estimates = &flight.monitor.monitor_output().states;
            states.iter().map(|&i| estimates[i].abs()).fold(0.0, f32::max)
        });
        assert!(by_autopilot > 0.01 && by_own < 0.1 * by_autopilot, "{name}: {by_autopilot} {by_own}");
    }
}

/// A change of place, as after an hour of flight, is not estimated as hard iron.
#[test]
fn a_change_of_place_is_estimated() {
    let mut flight = Flight::new(7);
    flight.fly_seconds(100);
    (flight.errors.strength_change, flight.errors.inclination_rad) = (-0.08, 0.12);
    flight.fly_seconds(80).assert_accurate(150, 8.0, "the first turn");
    flight.fly_seconds(1000).assert_accurate(0, 5.0, "later");
    let output = flight.monitor.monitor_output();
    assert_eq!(output.installation_change, None);
    let [strength, inclination_rad] = [STRENGTH_CHANGE_INDEX, INCLINATION_CHANGE_INDEX].map(|i| output.states[i]);
    assert!((strength + 0.08).abs() < 0.01 && (inclination_rad - 0.12).abs() < 0.015, "{strength} {inclination_rad}");
}

/// The heading stays within its sigma or is withheld.
#[test]
fn attitude_errors_are_not_estimated_as_hard_iron() {
    let cases = [
        ("roll", SimulatedErrors { roll_bias_rad: 0.035, ..SimulatedErrors::default() }, 0.2),
        ("pitch", SimulatedErrors { pitch_bias_rad: -0.035, ..SimulatedErrors::default() }, 0.2),
        ("bank", SimulatedErrors { bank_scale_error: -0.3, ..SimulatedErrors::default() }, 0.5),
        ("late", SimulatedErrors { latency_s: 0.3, ..SimulatedErrors::default() }, 0.2),
    ];
    for (name, errors, max_empty_share) in cases {
        let mut flight = Flight::new(8);
        flight.fly_seconds(200);
        flight.errors = errors;
        let FlightResult { heading_count, beyond_3_sigma_count, empty_reasons, .. } = flight.fly_seconds(600);
        assert!(beyond_3_sigma_count < heading_count / 8, "{name}: {beyond_3_sigma_count} of {heading_count}");
        assert!((empty_reasons.len() as f32) < max_empty_share * 6000.0, "{name}: {} empty", empty_reasons.len());
    }
}

/// A braking VTOL: an attitude error of 2.6 deg for 3 s is tolerated with a larger sigma if the nose rose by 8 deg, and
/// detected otherwise.
#[test]
fn attitude_noise_grows_while_the_aircraft_accelerates() {
    for (raised_rad, is_silenced) in [(0.14, false), (-0.14, false), (0.0, true)] {
        let mut flight = Flight::new(5);
        assert!(flight.fly_seconds(40).empty_reasons.is_empty());
        let mut silent = 0;
        for i in 1..=36_u8 {
            flight.errors = SimulatedErrors {
                pitch_excursion_rad: raised_rad * f32::from(i.min(6)) / 6.0,
                pitch_excursion_rate_rad_s: if i <= 6 { raised_rad / 0.6 } else { 0.0 },
                pitch_bias_rad: if i > 6 { 0.045 } else { 0.0 },
                ..SimulatedErrors::default()
            };
            silent += u32::from(flight.fly_sample().is_err());
        }
        assert_eq!(silent > 0, is_silenced, "{raised_rad}: {silent}");
        // Acceleration-induced tilt, 0.15 of the pitch excursion: 0.8 deg or more. Without it the sigma is 0.3 deg.
        let tilt_sigma_rad = libm::sqrtf(flight.monitor.monitor_output().sample_noise.unwrap().tilt_variance_rad2);
        assert_eq!(tilt_sigma_rad > 0.0125, !is_silenced, "{raised_rad}: {tilt_sigma_rad}");
    }
}

#[test]
fn attitude_latency_and_gyro_drift_are_distinguished() {
    for (wrong, index, expected, within) in [
        (SimulatedErrors { latency_s: 0.1, ..SimulatedErrors::default() }, ATTITUDE_LATENCY_INDEX, 0.1, 0.03),
        (SimulatedErrors { latency_s: -0.05, ..SimulatedErrors::default() }, ATTITUDE_LATENCY_INDEX, -0.05, 0.03),
        (
            SimulatedErrors { gyro_drift_rad_s: 2e-3, ..SimulatedErrors::default() },
            GYRO_RATE_OFFSET_INDICES[1],
            2e-3,
            3e-4,
        ),
    ] {
        let mut flight = Flight::new(9);
        flight.errors = wrong;
        flight.fly_seconds(600);
        let found = flight.monitor.monitor_output().states[index];
        assert!((found - expected).abs() < within, "{wrong:?}: {found}");
    }
}

/// A jump of the gyro's offset by 0.3 deg/s is followed within 20 s; by process noise alone it would take minutes.
#[test]
fn a_jump_of_the_gyro_offset_is_followed() {
    let mut flight = Flight::new(16);
    flight.fly_seconds(600);
    flight.errors.gyro_drift_rad_s = 5e-3;
    flight.fly_seconds(20);
    let found = flight.monitor.monitor_output().states[GYRO_RATE_OFFSET_INDICES[1]];
    assert!((found - 5e-3).abs() < 1e-3, "{found}");
}

/// In a level turn at 26 deg of bank, `psi'` is wrong by the scale of the z axis and, less, of the y axis: a full turn
/// determines it to the heading's noise, half a degree in 360.
#[test]
fn the_scale_error_of_the_gyro_is_estimated() {
    for gyro_scale_error in [0.03, -0.1] {
        let mut flight = Flight::new(13);
        flight.errors.gyro_scale_error = gyro_scale_error;
        flight.fly_seconds(600).assert_accurate(49, 5.0, &format!("{gyro_scale_error}"));
        let (row, heading_rate_rad_s) = heading_rate_row(STRAIGHT_S + CIRCLE_S / 2.0);
        let found = estimated_scale_error(&flight, STRAIGHT_S + CIRCLE_S / 2.0);
        // Gyro errors multiply the true rates, the row the measured ones.
        let expected = gyro_scale_error / (1.0 + gyro_scale_error);
        assert!((found - expected).abs() < 0.005, "{gyro_scale_error}: {found}");
        assert!(sqrt(flight.monitor.filter.projected_variance(&row)) / heading_rate_rad_s < 0.005);
    }
}

/// With a calibration that corrects for the motor current, samples before its first report are discarded for 3 s.
#[test]
fn the_first_report_of_a_corrected_current_is_awaited() {
    let applied = MotorCurrentInterference { ut_per_a: [0.8, 0.0, 0.0], ..MotorCurrentInterference::NO_INTERFERENCE };
    for (motor_current, reported_a, discarded) in
        [(MotorCurrentInterference::NO_INTERFERENCE, None, 0), (applied, Some(15.0), 0), (applied, None, 30)]
    {
        let mut flight = Flight::new(15);
        flight.calibration.motor_current = motor_current;
        flight.current = MotorCurrent::from_a(reported_a);
        let is_new = |flight: &Flight| flight.monitor.last_sample_at.is_none();
        let waited = (0..100).take_while(|_| {
            let _ = flight.fly_sample();
            is_new(&flight)
        });
        assert_eq!(waited.count(), discarded, "{motor_current:?} {reported_a:?}");
    }
}

/// The estimated scale error of the gyro's rate of heading at `t_s`, relative.
fn estimated_scale_error(flight: &Flight, t_s: f32) -> f32 {
    let (row, heading_rate_rad_s) = heading_rate_row(t_s);
    flight.monitor.filter.projected_mean(&row) / heading_rate_rad_s
}

/// Derivatives of the measured rate of heading at `t_s` by the states, and that rate.
fn heading_rate_row(t_s: f32) -> (StateVector, f32) {
    let (attitude, euler_rates, _) = motion_at(t_s);
    let mut row = [0.0; STATE_COUNT];
    row[FIRST_GYRO_ERROR_INDEX..].copy_from_slice(&GyroErrorRows::new(attitude, &euler_rates).heading_row);
    (row, euler_rates.heading_rad_s)
}

/// After a third of a circle with 10 % of gyro scale error the estimate follows if 10 % is expected, not if 0.2 %.
#[test]
fn the_expected_scale_error_limits_what_a_turn_estimates() {
    let [narrow, wide] = [0.002, 0.1].map(|gyro_scale| {
        let expected_sensor_errors = SensorErrorSigmas { gyro_scale, ..SensorErrorSigmas::DEFAULT };
        let mut flight = Flight { monitor: Monitor::new(expected_sensor_errors), ..Flight::new(8) };
        flight.errors.gyro_scale_error = 0.1;
        flight.fly_seconds((STRAIGHT_S + CIRCLE_S / 3.0) as u32);
        estimated_scale_error(&flight, STRAIGHT_S + CIRCLE_S / 3.0)
    });
    assert!((wide - 0.1 / 1.1).abs() < 0.02 && narrow < 0.75 * wide, "{narrow} {wide}");
}

#[test]
fn the_expected_drift_of_the_hard_iron_is_in_the_sigma() {
    let [usual, large] = [0.0025, 0.01].map(|hard_iron_drift_per_minute| {
        let expected_sensor_errors = SensorErrorSigmas { hard_iron_drift_per_minute, ..SensorErrorSigmas::DEFAULT };
        let mut flight = Flight { monitor: Monitor::new(expected_sensor_errors), ..Flight::new(8) };
        flight.fly_seconds(STRAIGHT_S as u32);
        flight.fly_sample().unwrap().1
    });
    assert!(large > 1.5 * usual, "{large} {usual}");
}

/// Hard iron that drifts by 5 uT within 100 s of straight flight, where only two of its components show: the variance
/// of the heading covers the third.
#[test]
fn a_drift_in_straight_flight_is_in_the_heading_variance() {
    let mut flight = Flight::new(14);
    flight.fly_seconds(170);
    let before_rad2 = flight.monitor.monitor_output().heading_variance_rad2;
    let mut worst_sigmas = 0.0_f32;
    for i in 0..500_u16 {
        let part = f32::from(i) / 500.0;
        flight.errors.hard_iron_ut = [0.0, 3.0 * part, 4.0 * part];
        if let Ok((error_deg, sigma_deg)) = flight.fly_sample() {
            worst_sigmas = worst_sigmas.max(error_deg.abs() / sigma_deg);
        }
    }
    assert!(flight.monitor.monitor_output().heading_variance_rad2 > 20.0 * before_rad2);
    assert!(worst_sigmas < 4.0, "{worst_sigmas}");
}
