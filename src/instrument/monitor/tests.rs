//! Tests of the monitor on synthetic samples.

use core::f32::consts::PI;
use nalgebra::Rotation3;

use testkit::random::Random;

use super::*;
use crate::calibration::{Calibration, HeadingUncertainty, MotorCurrent, MotorCurrentInterference, Orientation};
use crate::frames::{Attitude, Field};
use crate::heading::Heading;

const INCLINATION_RAD: f32 = 1.0;
const TOTAL_UT: f32 = 50.0;
/// Noise of a sample: relative strength, and each attitude angle.
const STRENGTH_SIGMA: f32 = 0.003;
const TILT_SIGMA_RAD: f32 = 0.005;

#[derive(Clone, Copy, Debug)]
struct SimulatedErrors {
    hard_iron_ut: [f32; 3],
    strength_change: f32,
    inclination_rad: f32,
    /// Turn of the module in its mount, clockwise from above, radians.
    mount_turn_rad: f32,
    /// Roll bias: reported minus true roll, radians.
    roll_bias_rad: f32,
    pitch_bias_rad: f32,
    /// Factor on the reported bank.
    bank_factor: f32,
    /// Attitude latency, seconds.
    latency_s: f32,
    /// Drift of the gyro heading, rad/s.
    gyro_drift_rad_s: f32,
    gyro_scale: f32,
    /// Real pitch excursion, radians.
    pitch_excursion_rad: f32,
    pitch_excursion_rate_rad_s: f32,
}

impl SimulatedErrors {
    const NO_ERRORS: Self = Self {
        hard_iron_ut: [0.0; 3],
        strength_change: 0.0,
        inclination_rad: 0.0,
        mount_turn_rad: 0.0,
        roll_bias_rad: 0.0,
        pitch_bias_rad: 0.0,
        bank_factor: 1.0,
        latency_s: 0.0,
        gyro_drift_rad_s: 0.0,
        gyro_scale: 1.0,
        pitch_excursion_rad: 0.0,
        pitch_excursion_rate_rad_s: 0.0,
    };
}

/// Alternates a minute of straight flight with a full circle to either side, with small oscillations.
struct Flight {
    monitor: Monitor,
    calibration: Calibration,
    uncertainty: HeadingUncertainty,
    random: Random,
    errors: SimulatedErrors,
    sample_count: u32,
    gyro_heading_offset_rad: f32,
    current: MotorCurrent,
}

const STEP_S: f32 = 0.1;
const CIRCLE_S: f32 = 24.0;
const STRAIGHT_S: f32 = 60.0;

fn motion_at(t_s: f32) -> (Attitude, EulerRates, f32) {
    let leg_time_s = t_s.rem_euclid(STRAIGHT_S + CIRCLE_S) - STRAIGHT_S;
    let side = if (t_s / (STRAIGHT_S + CIRCLE_S)).rem_euclid(2.0) < 1.0 { 1.0 } else { -1.0 };
    let banked = (leg_time_s / 2.0).min((CIRCLE_S - leg_time_s) / 2.0).clamp(0.0, 1.0);
    let rolling = if leg_time_s > 0.0 && leg_time_s < 2.0 {
        0.5
    } else if leg_time_s > CIRCLE_S - 2.0 {
        -0.5
    } else {
        0.0
    };
    let (phase, pitch_phase) = (0.9 * t_s, 0.6 * t_s);
    let attitude =
        Attitude { roll_rad: side * 0.45 * banked + 0.02 * phase.sin(), pitch_rad: 0.03 + 0.015 * pitch_phase.sin() };
    let euler_rates = EulerRates {
        roll_rad_s: side * 0.45 * rolling + 0.018 * phase.cos(),
        pitch_rad_s: 0.009 * pitch_phase.cos(),
        heading_rad_s: side * banked * 2.0 * PI / (CIRCLE_S - 2.0),
    };
    let u = leg_time_s.clamp(0.0, CIRCLE_S);
    let ramp = (u.min(2.0).powi(2) / 4.0) + (u.clamp(2.0, CIRCLE_S - 2.0) - 2.0) + {
        let v = (u - (CIRCLE_S - 2.0)).max(0.0);
        v - v * v / 4.0
    };
    (attitude, euler_rates, wrap_pi(0.7 + side * ramp * 2.0 * PI / (CIRCLE_S - 2.0)))
}

impl Flight {
    fn new(seed: u64) -> Self {
        let calibration = Calibration {
            inclination_rad: INCLINATION_RAD,
            total_ut: TOTAL_UT,
            ..Calibration::uncalibrated(Orientation::IDENTITY_ROTATION)
        };
        let uncertainty = HeadingUncertainty {
            sensor_sigma: STRENGTH_SIGMA,
            attitude_sigma_rad: TILT_SIGMA_RAD,
            ..HeadingUncertainty::NO_UNCERTAINTY
        };
        Self {
            monitor: Monitor::new(SensorErrorSigmas::DEFAULT),
            calibration,
            uncertainty,
            random: Random(seed),
            errors: SimulatedErrors::NO_ERRORS,
            sample_count: 0,
            gyro_heading_offset_rad: 2.0,
            current: MotorCurrent::UNKNOWN,
        }
    }

    fn now_s(&self) -> f32 {
        // The time wraps with the flight pattern and stays exact in `f32`.
        (self.sample_count % 1680) as f32 * STEP_S
    }

    /// Flies one sample; returns heading error and sigma in degrees, or the reason for no heading.
    fn fly_sample(&mut self) -> Result<(f32, f32), NoHeading> {
        self.sample_count += 1;
        let SimulatedErrors {
            hard_iron_ut: iron_ut,
            strength_change: strength,
            inclination_rad,
            roll_bias_rad: roll_rad,
            pitch_bias_rad: pitch_rad,
            bank_factor: bank,
            latency_s: late_s,
            gyro_drift_rad_s: drift_rad_s,
            ..
        } = self.errors;
        let (mut attitude, _, heading_rad) = motion_at(self.now_s());
        attitude.pitch_rad += self.errors.pitch_excursion_rad;
        let earth = Field::earth_field(TOTAL_UT * (1.0 + strength), INCLINATION_RAD + inclination_rad, heading_rad);
        let (mut reported, mut euler_rates, reported_heading_rad) = motion_at(self.now_s() - late_s);
        euler_rates.heading_rad_s *= self.errors.gyro_scale;
        reported.pitch_rad += self.errors.pitch_excursion_rad;
        euler_rates.pitch_rad_s += self.errors.pitch_excursion_rate_rad_s;
        let mut noise = |sigma: f32| sigma * self.random.normal();
        let body_ut = attitude.to_body_frame(earth).ut + Vector3::from(iron_ut) + self.calibration.b_vector_ut();
        let module_from_body = Rotation3::from_axis_angle(&Vector3::z_axis(), -self.errors.mount_turn_rad);
        let field = module_from_body * body_ut + Vector3::from_fn(|_, _| noise(STRENGTH_SIGMA * TOTAL_UT));
        let reported = Attitude {
            roll_rad: bank * reported.roll_rad + roll_rad + noise(TILT_SIGMA_RAD),
            pitch_rad: reported.pitch_rad + pitch_rad + noise(TILT_SIGMA_RAD),
        };
        let turned_rad = wrap_pi(reported_heading_rad - motion_at(self.now_s() - late_s - STEP_S).2);
        self.gyro_heading_offset_rad =
            wrap_pi(self.gyro_heading_offset_rad + drift_rad_s * STEP_S + (self.errors.gyro_scale - 1.0) * turned_rad);
        let turning = GyroHeading {
            euler_rates,
            relative_heading_rad: wrap_pi(reported_heading_rad + self.gyro_heading_offset_rad),
            run_number: 0,
        };
        let at = Timestamp::from_us(u64::from(self.sample_count) * 100_000);
        let sample =
            Sample { time: at.wrapping_millis(), current: self.current, ..Sample::new(Field::new(field), reported) };
        let monitored = MonitoredCalibration {
            calibration: &self.calibration,
            uncertainty: &self.uncertainty,
            readings_per_sample: 1,
        };
        self.monitor.process_sample(&monitored, at, &sample, Some(turning));
        let adjustment = self.monitor.monitor_output();
        adjustment.validity?;
        let (calibration, uncertainty) = adjustment.correct_calibration(&monitored);
        let attitude = adjustment.correct_attitude(reported, &euler_rates);
        let found = crate::heading::compute_heading(
            crate::heading::HeadingLimits::ANY_FIELD,
            &calibration,
            &uncertainty,
            sample.field,
            attitude,
        )?
        .with_min_systematic_variance(adjustment.heading_variance_rad2);
        Ok((wrap_pi(found.magnetic_rad - heading_rad).to_degrees(), found.sigma_deg()))
    }

    fn fly_seconds(&mut self, seconds: u32) -> FlightResult {
        let mut flight_result = FlightResult::default();
        for _ in 0..10 * seconds {
            flight_result.add_heading(self.fly_sample());
        }
        flight_result
    }
}

#[derive(Clone, Debug, Default)]
struct FlightResult {
    heading_count: u32,
    worst_error_deg: f32,
    beyond_3_sigma_count: u32,
    empty_reasons: Vec<NoHeading>,
}

impl FlightResult {
    fn add_heading(&mut self, heading: Result<(f32, f32), NoHeading>) {
        match heading {
            Ok((error_deg, sigma_deg)) => {
                self.heading_count += 1;
                self.worst_error_deg = self.worst_error_deg.max(error_deg.abs());
                self.beyond_3_sigma_count += u32::from(error_deg.abs() > 3.0 * sigma_deg);
            }
            Err(reason) => self.empty_reasons.push(reason),
        }
    }
}

/// Half an hour. Normal errors exceed 3 sigma in 0.3 % of samples.
#[test]
fn headings_of_a_clean_flight_are_never_withheld() {
    for seed in 0..3 {
        let flight_result = Flight::new(seed).fly_seconds(1800);
        assert_eq!(flight_result.empty_reasons, []);
        assert!(
            flight_result.beyond_3_sigma_count < flight_result.heading_count / 300
                && flight_result.worst_error_deg < 4.5,
            "{flight_result:?}"
        );
    }
}

/// 24 hours with a gyro drift of 0.05 deg/s.
#[test]
fn headings_after_a_day_are_as_good_as_after_an_hour() {
    let mut flight = Flight::new(4);
    flight.errors.gyro_drift_rad_s = 0.05_f32.to_radians();
    flight.fly_seconds(600);
    let first = flight.fly_seconds(3600);
    for _ in 0..22 {
        flight.fly_seconds(3600);
    }
    let last = flight.fly_seconds(3600);
    for hour in [first, last] {
        assert_eq!(hour.empty_reasons, []);
        assert!(hour.worst_error_deg < 4.5, "{hour:?}");
    }
    assert_eq!(flight.monitor.monitor_output().installation_change, None);
}

/// 3 uT or more in level flight, in any direction: detected at once; heading usable within seconds; estimated within 30
/// % after a circle to either side.
#[test]
fn a_hard_iron_change_is_detected_and_reported() {
    for (i, iron_ut) in
        [[3.0, 0.0, 0.0], [0.0, -5.0, 0.0], [0.0, 0.0, 5.0], [4.0, 4.0, -4.0], [-7.0, 6.0, 3.0]].into_iter().enumerate()
    {
        let mut flight = Flight::new(i as u64);
        flight.fly_seconds(200);
        flight.errors.hard_iron_ut = iron_ut;
        // Detection takes two samples beyond the wide gate, or six beyond the narrow one.
        let at_once = flight.fly_seconds(2);
        let little = at_once.heading_count <= 7 && at_once.worst_error_deg < 5.0;
        assert!(at_once.heading_count <= 1 || little, "{iron_ut:?}: {at_once:?}");
        flight.fly_seconds(18);
        let turning = flight.fly_seconds(60);
        assert!(turning.empty_reasons.len() <= 100 && turning.worst_error_deg < 8.0, "{iron_ut:?}: {turning:?}");
        let flight_result = flight.fly_seconds(180);
        assert!(
            flight_result.empty_reasons.is_empty() && flight_result.worst_error_deg < 5.0,
            "{iron_ut:?}: {flight_result:?}"
        );
        let Some(InstallationChange::HardIron(reported_change)) = flight.monitor.monitor_output().installation_change
        else {
            panic!("{iron_ut:?}")
        };
        let off_ut = (reported_change.change_ut - Vector3::from(iron_ut)).norm();
        assert!(off_ut < 0.3 * Vector3::from(iron_ut).norm(), "{iron_ut:?}: {reported_change:?}");
        assert!(off_ut < 6.0 * reported_change.sigma_ut, "{iron_ut:?}: {reported_change:?}");
        flight.errors.hard_iron_ut = [0.0; 3];
        flight.fly_seconds(200);
        assert_eq!(flight.monitor.monitor_output().installation_change, None, "{iron_ut:?}");
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
        let flight_result = flight.fly_seconds(400);
        assert!(
            flight_result.empty_reasons.is_empty() && flight_result.worst_error_deg < 4.5,
            "{turn_deg}: {flight_result:?}"
        );
        let Some(InstallationChange::Mount(reported_change)) = flight.monitor.monitor_output().installation_change
        else {
            panic!("{turn_deg}")
        };
        let off_deg = reported_change.turn_rad.to_degrees() - turn_deg;
        assert!(
            off_deg.abs() < 1.5 && off_deg.abs() < 4.0 * reported_change.sigma_rad.to_degrees(),
            "{turn_deg}: {reported_change:?}"
        );
        flight.errors.mount_turn_rad = 0.0;
        flight.fly_seconds(400);
        assert_eq!(flight.monitor.monitor_output().installation_change, None, "{turn_deg}");
    }
}

/// A change of place, as after an hour of flight, is not estimated as hard iron.
#[test]
fn a_change_of_place_is_estimated() {
    let mut flight = Flight::new(7);
    flight.fly_seconds(100);
    (flight.errors.strength_change, flight.errors.inclination_rad) = (-0.08, 0.12);
    let turning = flight.fly_seconds(80);
    assert!(turning.empty_reasons.len() <= 150 && turning.worst_error_deg < 8.0, "{turning:?}");
    let flight_result = flight.fly_seconds(1000);
    assert!(flight_result.empty_reasons.is_empty() && flight_result.worst_error_deg < 5.0, "{flight_result:?}");
    let adjustment = flight.monitor.monitor_output();
    assert_eq!(adjustment.installation_change, None);
    let (strength, inclination_rad) =
        (adjustment.states[STRENGTH_CHANGE_INDEX], adjustment.states[INCLINATION_CHANGE_INDEX]);
    assert!((strength + 0.08).abs() < 0.01 && (inclination_rad - 0.12).abs() < 0.015, "{strength} {inclination_rad}");
}

/// The heading stays within its sigma or is withheld.
#[test]
fn attitude_errors_are_not_estimated_as_hard_iron() {
    let cases = [
        ("roll", SimulatedErrors { roll_bias_rad: 0.035, ..SimulatedErrors::NO_ERRORS }, 0.2),
        ("pitch", SimulatedErrors { pitch_bias_rad: -0.035, ..SimulatedErrors::NO_ERRORS }, 0.2),
        ("bank", SimulatedErrors { bank_factor: 0.7, ..SimulatedErrors::NO_ERRORS }, 0.5),
        ("late", SimulatedErrors { latency_s: 0.3, ..SimulatedErrors::NO_ERRORS }, 0.2),
    ];
    for (name, wrong, silent) in cases {
        let mut flight = Flight::new(8);
        flight.fly_seconds(200);
        flight.errors = wrong;
        let flight_result = flight.fly_seconds(600);
        assert!(
            flight_result.beyond_3_sigma_count < flight_result.heading_count / 8,
            "{name}: {} of {}",
            flight_result.beyond_3_sigma_count,
            flight_result.heading_count
        );
        assert!(
            (flight_result.empty_reasons.len() as f32) < silent * 6000.0,
            "{name}: {}",
            flight_result.empty_reasons.len()
        );
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
                ..SimulatedErrors::NO_ERRORS
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
        (SimulatedErrors { latency_s: 0.1, ..SimulatedErrors::NO_ERRORS }, ATTITUDE_LATENCY_INDEX, 0.1, 0.03),
        (SimulatedErrors { latency_s: -0.05, ..SimulatedErrors::NO_ERRORS }, ATTITUDE_LATENCY_INDEX, -0.05, 0.03),
        (
            SimulatedErrors { gyro_drift_rad_s: 2e-3, ..SimulatedErrors::NO_ERRORS },
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
    for gyro_scale in [1.03, 0.9] {
        let mut flight = Flight::new(13);
        flight.errors.gyro_scale = gyro_scale;
        let flight_result = flight.fly_seconds(600);
        assert!(flight_result.empty_reasons.len() < 50 && flight_result.worst_error_deg < 5.0, "{flight_result:?}");
        let (attitude, euler_rates, _) = motion_at(STRAIGHT_S + CIRCLE_S / 2.0);
        let row = GyroErrorRows::new(attitude, &euler_rates).heading_row;
        let errors = flight.monitor.monitor_output().heading_rate_error.gyro_errors;
        let found = estimated_scale_error(&flight, STRAIGHT_S + CIRCLE_S / 2.0);
        // Gyro errors multiply the true rates, the row the measured ones.
        let expected = (gyro_scale - 1.0) / gyro_scale;
        assert!((found - expected).abs() < 0.005, "{gyro_scale}: {found}");
        assert!(sqrt(errors.projected_variance(&row)) / euler_rates.heading_rad_s < 0.005);
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
    let (attitude, euler_rates, _) = motion_at(t_s);
    let row = GyroErrorRows::new(attitude, &euler_rates).heading_row;
    flight.monitor.monitor_output().heading_rate_error.gyro_errors.projected_mean(&row) / euler_rates.heading_rad_s
}

/// After a third of a circle with 10 % of gyro scale error the estimate follows if 10 % is expected, not if 0.2 %.
#[test]
fn the_expected_scale_error_limits_what_a_turn_estimates() {
    let [narrow, wide] = [0.002, 0.1].map(|gyro_scale| {
        let expected_sensor_errors = SensorErrorSigmas { gyro_scale, ..SensorErrorSigmas::DEFAULT };
        let mut flight = Flight { monitor: Monitor::new(expected_sensor_errors), ..Flight::new(8) };
        flight.errors.gyro_scale = 1.1;
        flight.fly_seconds((STRAIGHT_S + CIRCLE_S / 3.0) as u32);
        estimated_scale_error(&flight, STRAIGHT_S + CIRCLE_S / 3.0)
    });
    assert!((wide - 0.1 / 1.1).abs() < 0.02 && narrow < 0.7 * wide, "{narrow} {wide}");
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

/// Limits: 8.6 deg/s of offset, 20 % of scale error. A field that does not turn appears as such a gyro.
#[test]
fn implausible_gyro_errors_are_detected() {
    for i in FIRST_GYRO_ERROR_INDEX..STATE_COUNT {
        let limit = if GYRO_RATE_OFFSET_INDICES.contains(&i) { 0.15 } else { 0.2 };
        let mut states = [0.0; STATE_COUNT];
        states[i] = -1.03 * limit;
        assert!(is_gyro_implausible(&states));
        states[i] = 0.97 * limit;
        assert!(!is_gyro_implausible(&states));
    }
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
        monitor.largest_coefficient_variance = coefficient_sigma.powi(2);
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
        let monitored = MonitoredCalibration {
            calibration: &flight.calibration,
            uncertainty: &flight.uncertainty,
            readings_per_sample: 1,
        };
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
    let monitored = MonitoredCalibration {
        calibration: &calibration,
        uncertainty: &HeadingUncertainty::NO_UNCERTAINTY,
        readings_per_sample: 4,
    };
    let mut states = [0.0; STATE_COUNT];
    states[..3].copy_from_slice(&[0.02, -0.04, 0.06]);
    (states[STRENGTH_CHANGE_INDEX], states[INCLINATION_CHANGE_INDEX]) = (0.1, -0.05);
    let variances = Some(SampleNoise { strength_variance: 1e-4, tilt_variance_rad2: 4e-4 });
    let (found, adapted) =
        MonitorOutput { states, sample_noise: variances, ..MonitorOutput::INITIAL }.correct_calibration(&monitored);
    let field = Field::from_ut(20.0, -10.0, 30.0);
    let moved = calibration.calibrated_field(field).ut - found.calibrated_field(field).ut;
    assert!((moved - Vector3::new(1.0, -2.0, 3.0)).norm() < 1e-4, "{moved}");
    assert!((found.total_ut - 55.0).abs() < 1e-4 && (found.inclination_rad - 0.95).abs() < 1e-6);
    // The mean of four readings has half the sigma of one.
    assert!((adapted.sensor_sigma - 0.02).abs() < 1e-6 && (adapted.attitude_sigma_rad - 0.02).abs() < 1e-6);
    let unchanged = MonitorOutput::INITIAL.correct_calibration(&monitored);
    assert_eq!(unchanged, (calibration, HeadingUncertainty::NO_UNCERTAINTY));
}

/// 24 hours at rest without body rates: all is unobservable, and no state drifts.
#[test]
fn a_day_at_rest_changes_no_state() {
    let mut random = Random(15);
    let flight = Flight::new(15);
    let mut monitor = Monitor::new(SensorErrorSigmas::DEFAULT);
    let attitude = Attitude::from_deg(2.0, 5.0);
    let body = attitude.to_body_frame(Field::earth_field(TOTAL_UT, INCLINATION_RAD, 0.7)).ut;
    for i in 0..864_000_u32 {
        let field = body + Vector3::from_fn(|_, _| STRENGTH_SIGMA * TOTAL_UT * random.normal());
        let at = Timestamp::from_us(u64::from(i) * 100_000);
        let sample = Sample { time: at.wrapping_millis(), ..Sample::new(Field::new(field), attitude) };
        let monitored = MonitoredCalibration {
            calibration: &flight.calibration,
            uncertainty: &flight.uncertainty,
            readings_per_sample: 1,
        };
        monitor.process_sample(&monitored, at, &sample, None);
        assert_eq!(monitor.monitor_output().validity, Ok(()), "{i}");
    }
    assert!(monitor.filter.mean().iter().all(|unknown| unknown.abs() < 0.01), "{:?}", monitor.filter.mean());
}

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

/// A monitor whose gate withholds the heading and has withheld it for `withheld_s`.
fn withholding_monitor(withheld_s: f32) -> Monitor {
    let mut monitor = Monitor::new(SensorErrorSigmas::DEFAULT);
    let change = [None, None, Some(Innovation { residual: 1.0, variance: 1e-4 })];
    assert_eq!(
        monitor.innovation_gate.test_innovations(change, STEP_S),
        GateResult::Consistent { is_usable: [true, true, false] }
    );
    assert!(matches!(monitor.innovation_gate.test_innovations(change, STEP_S), GateResult::ChangeDetected { .. }));
    monitor.innovation_gate.update_turn(0.0, withheld_s);
    monitor
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
/// the heading's times `cos I`; a tilt error has half of the larger of inclination and heading over `tan I`.
#[test]
fn a_detected_change_inflates_the_states_that_explain_it() {
    // Inclination of the field; residuals; expected sigmas of hard iron, strength and inclination, attitude bias.
    for (inclination_rad, residuals, [hard_iron, field, tilt_rad]) in [
        (1.0_f32, [0.06, 0.1, 0.4], [0.216_12, 0.1, 0.128_42]),
        (-1.0, [0.06, 0.1, 0.4], [0.216_12, 0.1, 0.128_42]),
        (1.0, [0.06, 0.1, 0.0], [0.1, 0.1, 0.05]),
        (1.0, [0.2, 0.1, 0.0], [0.2, 0.2, 0.05]),
        // Limits: half the field, 17 deg of tilt.
        (1.0, [0.9, 0.0, 3.0], [0.5, 0.5, 0.15]),
        // At the magnetic equator the share of the attitude is that of 17 deg of inclination.
        (0.0, [0.0, 0.0, 0.06], [0.06, 0.0, 0.1]),
    ] {
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
        monitor.inflate_covariance(&model, residuals);
        let added: StateVector = array::from_fn(|i| sqrt((state_variances(&monitor)[i] - before[i]).max(0.0)));
        let mut expected = [0.0; STATE_COUNT];
        expected[..3].fill(hard_iron);
        expected[STRENGTH_CHANGE_INDEX..=INCLINATION_CHANGE_INDEX].fill(field);
        expected[ROLL_BIAS_INDEX..=PITCH_BIAS_INDEX].fill(tilt_rad);
        for (i, (added, expected)) in added.into_iter().zip(expected).enumerate() {
            assert!((added - expected).abs() < 2e-4, "{inclination_rad} {residuals:?}: {i}: {added}, not {expected}");
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
    let unchanged_deg = sigma_deg(HARD_IRON_CHANGE, 0.0);
    for (state, value) in [(HARD_IRON_CHANGE, 0.05), (HARD_IRON_CHANGE, -0.05), (MOUNT_TURN, 0.06)] {
        assert!(sigma_deg(state, value) > 1.5 * unchanged_deg, "{state} {value}: {unchanged_deg}");
    }
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
        flight.uncertainty.sensor_sigma = 2.0 * STRENGTH_SIGMA;
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
