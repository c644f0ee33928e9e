//! Tests of the monitor on synthetic samples.

mod estimates;
mod filter_states;
mod heading_validity;

use core::f32::consts::PI;
use nalgebra::Rotation3;

use testkit::random::Random;

use super::*;
use crate::calibration::{Calibration, HeadingUncertainty, MotorCurrent, MotorCurrentInterference, Orientation};
use crate::frames::{Field, RollPitch};
use crate::heading::{Heading, HeadingLimits, compute_heading};
use crate::instrument::averager::CorrectedReading;

/// The attitude of an autopilot, without an own one beside.
const OF_AUTOPILOT: MonitoredAttitude =
    MonitoredAttitude::Autopilot(AutopilotErrors { tilt: None, gyro_offset: None, unexplained_turn_rad: 0.0 });

const INCLINATION_RAD: f32 = 1.0;
const TOTAL_UT: f32 = 50.0;
/// Noise of a sample: relative strength, and each attitude angle.
const STRENGTH_SIGMA: f32 = 0.003;
const TILT_SIGMA_RAD: f32 = 0.005;

/// Errors of the simulated sensors and of their installation.
#[derive(Clone, Copy, Debug, Default)]
struct SimulatedErrors {
    hard_iron_ut: [f32; 3],
    strength_change: f32,
    inclination_rad: f32,
    /// Turn of the module in its mount, clockwise from above, radians.
    mount_turn_rad: f32,
    /// Roll bias: reported minus true roll, radians.
    roll_bias_rad: f32,
    pitch_bias_rad: f32,
    bank_scale_error: f32,
    /// Attitude latency, seconds.
    latency_s: f32,
    /// Drift of the gyro heading, rad/s.
    gyro_drift_rad_s: f32,
    gyro_scale_error: f32,
    /// Real pitch excursion, radians.
    pitch_excursion_rad: f32,
    pitch_excursion_rate_rad_s: f32,
}

/// Alternates a minute of straight flight with a full circle to either side, with small oscillations.
struct Flight {
    monitor: Monitor,
    calibration: Calibration,
    uncertainty: HeadingUncertainty,
    random: Random,
    errors: SimulatedErrors,
    sample_count: u32,
    /// Whether the source sends body rates.
    has_gyro: bool,
    attitude: MonitoredAttitude,
    gyro_heading_offset_rad: f32,
    gyro_run_number: u8,
    current: MotorCurrent,
}

const STEP_S: f32 = 0.1;
const CIRCLE_S: f32 = 24.0;
const STRAIGHT_S: f32 = 60.0;

fn motion_at(t_s: f32) -> (RollPitch, EulerRates, f32) {
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
        RollPitch { roll_rad: side * 0.45 * banked + 0.02 * phase.sin(), pitch_rad: 0.03 + 0.015 * pitch_phase.sin() };
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
            relative_sensor_sigma: STRENGTH_SIGMA,
            attitude_sigma_rad: TILT_SIGMA_RAD,
            ..HeadingUncertainty::NO_UNCERTAINTY
        };
        Self {
            monitor: Monitor::new(SensorErrorSigmas::DEFAULT),
            calibration,
            uncertainty,
            random: Random(seed),
            errors: SimulatedErrors::default(),
            sample_count: 0,
            has_gyro: true,
            attitude: OF_AUTOPILOT,
            gyro_heading_offset_rad: 2.0,
            gyro_run_number: 0,
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
        let (errors, reported_s) = (self.errors, self.now_s() - self.errors.latency_s);
        let (mut attitude, _, heading_rad) = motion_at(self.now_s());
        let (mut reported, mut euler_rates, reported_heading_rad) = motion_at(reported_s);
        attitude.pitch_rad += errors.pitch_excursion_rad;
        reported.pitch_rad += errors.pitch_excursion_rad;
        euler_rates.pitch_rad_s += errors.pitch_excursion_rate_rad_s;
        euler_rates.heading_rad_s *= 1.0 + errors.gyro_scale_error;
        let total_ut = TOTAL_UT * (1.0 + errors.strength_change);
        let earth = Field::earth_field(total_ut, INCLINATION_RAD + errors.inclination_rad, heading_rad);
        let mut noise = |sigma: f32| sigma * self.random.normal();
        let body_ut =
            attitude.to_body_frame(earth).ut + Vector3::from(errors.hard_iron_ut) + self.calibration.b_vector_ut();
        let module_from_body = Rotation3::from_axis_angle(&Vector3::z_axis(), -errors.mount_turn_rad);
        let field = module_from_body * body_ut + Vector3::from_fn(|_, _| noise(STRENGTH_SIGMA * TOTAL_UT));
        let reported = RollPitch {
            roll_rad: (1.0 + errors.bank_scale_error) * reported.roll_rad
                + errors.roll_bias_rad
                + noise(TILT_SIGMA_RAD),
            pitch_rad: reported.pitch_rad + errors.pitch_bias_rad + noise(TILT_SIGMA_RAD),
        };
        let turned_rad = wrap_pi(reported_heading_rad - motion_at(reported_s - STEP_S).2);
        let gyro_error_rad = errors.gyro_drift_rad_s * STEP_S + errors.gyro_scale_error * turned_rad;
        self.gyro_heading_offset_rad = wrap_pi(self.gyro_heading_offset_rad + gyro_error_rad);
        let gyro_heading = GyroHeading {
            euler_rates,
            relative_heading_rad: wrap_pi(reported_heading_rad + self.gyro_heading_offset_rad),
            run_number: self.gyro_run_number,
        };
        let sample = Sample { current: self.current, ..Sample::new(Field::new(field), reported) };
        self.process_sample(sample, self.has_gyro.then_some(gyro_heading));
        let output = self.monitor.monitor_output();
        output.validity?;
        let (calibration, uncertainty) =
            output.correct_calibration(&monitored_calibration(&self.calibration, &self.uncertainty));
        let attitude = output.correct_attitude(reported, &euler_rates);
        let limits = HeadingLimits::ANY_FIELD;
        let found = compute_heading(limits, &calibration, &uncertainty, sample.field, attitude)?
            .with_min_systematic_variance(output.heading_variance_rad2);
        Ok((wrap_pi(found.magnetic_rad - heading_rad).to_degrees(), found.sigma_deg()))
    }

    /// Passes a sample to the monitor, at the present time of the flight.
    fn process_sample(&mut self, sample: Sample, gyro_heading: Option<GyroHeading>) {
        let at = Timestamp::from_us(u64::from(self.sample_count) * 100_000);
        let sample = Sample { time: at.wrapping_millis(), ..sample };
        let monitored = monitored_calibration(&self.calibration, &self.uncertainty);
        let field = monitored.calibration.corrected_body_field(&sample);
        let averaged = AveragedSample {
            sample,
            corrected: gyro_heading.map(|gyro_heading| CorrectedReading { field, gyro_heading }),
            latest_rates: gyro_heading.map_or_else(EulerRates::default, |gyro_heading| gyro_heading.euler_rates),
        };
        self.monitor.process_sample(&monitored, at, &averaged, self.attitude);
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

    /// Asserts how many headings are withheld at most, and how wrong the others are.
    #[track_caller]
    fn assert_accurate(&self, max_empty_count: usize, max_error_deg: f32, case: &str) {
        let is_accurate = self.empty_reasons.len() <= max_empty_count && self.worst_error_deg < max_error_deg;
        assert!(is_accurate, "{case}: {} empty, {self:?}", self.empty_reasons.len());
    }
}

fn monitored_calibration<'a>(
    calibration: &'a Calibration,
    uncertainty: &'a HeadingUncertainty,
) -> MonitoredCalibration<'a> {
    MonitoredCalibration { calibration, uncertainty, readings_per_sample: 1 }
}

/// Sample without errors at rest, heading north.
fn sample_at_rest(inclination_rad: f32, attitude: RollPitch) -> MonitorSample {
    let field = attitude.to_body_frame(Field::earth_field(1.0, inclination_rad, 0.0)).ut;
    MonitorSample {
        field,
        mount_turn_effect: Some(MountTurnEffect::new(&Flight::new(0).calibration, &field)),
        attitude,
        euler_rates: EulerRates::default(),
    }
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
    monitor.innovation_gate.update_turn(0.0, false, withheld_s);
    monitor
}

/// Half an hour. Normal errors exceed 3 sigma in 0.3 % of samples.
#[test]
fn headings_of_a_clean_flight_are_never_withheld() {
    for seed in 0..3 {
        let flight_result = Flight::new(seed).fly_seconds(1800);
        flight_result.assert_accurate(0, 4.5, "clean");
        assert!(flight_result.beyond_3_sigma_count < flight_result.heading_count / 300, "{flight_result:?}");
    }
}

/// Seven hours with a gyro drift of 0.05 deg/s; `tests/promises` park a vehicle for a day.
#[test]
fn headings_after_six_hours_are_as_good_as_after_one() {
    let mut flight = Flight::new(4);
    flight.errors.gyro_drift_rad_s = 0.05_f32.to_radians();
    flight.fly_seconds(600);
    let first = flight.fly_seconds(3600);
    flight.fly_seconds(4 * 3600);
    first.assert_accurate(0, 4.5, "first hour");
    flight.fly_seconds(3600).assert_accurate(0, 4.5, "last hour");
    assert_eq!(flight.monitor.monitor_output().installation_change, None);
}

/// Six hours at rest without body rates: all is unobservable, and no state drifts.
#[test]
fn six_hours_at_rest_change_no_state() {
    let mut flight = Flight::new(15);
    let attitude = RollPitch::from_deg(2.0, 5.0);
    let body = attitude.to_body_frame(Field::earth_field(TOTAL_UT, INCLINATION_RAD, 0.7)).ut;
    for _ in 0..216_000_u32 {
        flight.sample_count += 1;
        let field = body + Vector3::from_fn(|_, _| STRENGTH_SIGMA * TOTAL_UT * flight.random.normal());
        flight.process_sample(Sample::new(Field::new(field), attitude), None);
        assert_eq!(flight.monitor.monitor_output().validity, Ok(()), "{}", flight.sample_count);
    }
    let states = flight.monitor.filter.mean();
    assert!(states.iter().all(|state| state.abs() < 0.01), "{states:?}");
}
