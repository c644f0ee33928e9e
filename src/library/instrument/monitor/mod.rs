//! Monitor: an extended Kalman filter that checks field, attitude and gyro against each other at 10 Hz.
//!
//! A heading depends on the calibration and on the attitude, and either can become wrong in flight. The measurements
//! are redundant: field strength and inclination do not depend on the heading, the magnetic heading must turn with the
//! gyro, and pitch and roll must follow the body rates. Nineteen states model the known causes of disagreement: changed
//! hard iron, another geographic place, a module that turned in its mount, errors of the gyro, attitude bias,
//! bank-angle scale error and attitude latency. Headings are corrected by the estimated states and their variance
//! includes the filter's covariance. Innovations beyond the gates suppress the heading.
//!
//! The covariance is stored as UD factors, so that rounding cannot make a variance negative. The innovations also adapt
//! the measurement noise.
//!
//! After a detected change the covariance of hard iron is inflated isotropically by the squared innovation, because a
//! change along the unobserved direction may be as large as along the observed ones. The variances of attitude states
//! and, by less, of the Earth's field are inflated, too. Headings are not dead-reckoned by the gyro through a
//! disturbance: tried three ways, with larger errors each time.

mod acceleration_tilt;
mod adaptive_noise;
mod coordinated_turn;
mod heading_drift;
mod innovation_gate;
mod installation_change;
mod mean_innovation;
mod measurement_model;
mod monitor_output;
mod monitored_calibration;
mod mount_turn;
mod parameters;
mod stuck_field;

use core::array;
use core::f32::consts::TAU;
use core::ops::Range;

use nalgebra::Vector3;

use super::averager::AveragedSample;
use super::correction::SensorErrorSigmas;
use super::gyro_error::{GYRO_ERROR_COUNT, GyroErrorRows, GyroErrors};
use super::ud_filter::{Measurement, UdFilter};
use crate::attitude::{AutopilotErrors, EulerRates, GyroHeading, HAS_OWN_ATTITUDE, TILT_ERROR_TIME_S, TiltError};
use crate::calibration::{Calibration, Sample};
use crate::frames::{RollPitch, wrap_pi};
use crate::heading::NoHeading;
use crate::time::Timestamp;
use crate::trig;
use crate::trig::{VectorLength as _, sqrt, square};
use acceleration_tilt::AccelerationTilt;
use adaptive_noise::{AdaptiveNoise, SampleNoise};
use coordinated_turn::CoordinatedTurn;
use heading_drift::{GyroOffsetEstimate, HeadingDrift};
use innovation_gate::{GateResult, Innovation, InnovationGate, PerKind};
use installation_change::{
    ChangeDetector, HARD_IRON_SIGNIFICANCE_SIGMAS, MIN_HARD_IRON_CHANGE, MIN_MOUNT_TURN_RAD,
    MOUNT_TURN_SIGNIFICANCE_SIGMAS,
};
pub use installation_change::{ChangeReporter, HardIronChange, InstallationChange, MountTurn};
use mean_innovation::{MeanInnovations, SlowChange};
use measurement_model::{
    ATTITUDE_LATENCY_INDEX, BANK_SCALE_ERROR_INDEX, DRIFTING_STATES, FIRST_GYRO_ERROR_INDEX, GYRO_HEADING_OFFSET_INDEX,
    GYRO_RATE_OFFSET_INDICES, HARD_IRON_CHANGE_INDEX, HARD_IRON_INDICES, INCLINATION_CHANGE_INDEX, MOUNT_TURN_INDEX,
    MeasurementModel, MonitorSample, MountTurnEffect, PITCH_BIAS_INDEX, PredictedField, ROLL_BIAS_INDEX, STATE_COUNT,
    STRENGTH_CHANGE_INDEX, StateVector,
};
pub(super) use monitor_output::MonitorOutput;
pub(super) use monitored_calibration::{MonitoredAttitude, MonitoredCalibration};
use mount_turn::{ExplainedTurn, explained_turn};
use parameters::{
    ATTITUDE_ERROR_TIME_S, ATTITUDE_JITTER_S, ATTITUDE_SHARE_OF_CHANGE, COEFFICIENT_CORRELATION_FACTOR,
    EARTH_FIELD_SHARE_OF_CHANGE, FIELD_DRIFT_INFLATION_FACTOR, FIELD_DRIFT_TIME_S, GYRO_OFFSET_GROWTH_RAD_S2,
    GYRO_OFFSET_TIME_S, HARD_IRON_PROBABILITY, INITIAL_STEP_S, MAX_ATTITUDE_BIAS_RAD, MAX_BANK_SCALE_ERROR,
    MAX_DECAYING_HARD_IRON, MAX_DECAYING_MOUNT_TURN_RAD, MAX_DRIFTING_IRON_RAD, MAX_GYRO_HEADING_GAP_S,
    MAX_GYRO_OFFSET_VARIANCE, MAX_HARD_IRON_CHANGE, MAX_HEADING_SIGMA_RAD, MAX_INCLINATION_CHANGE_RAD,
    MAX_INFLATING_INNOVATION, MAX_INFLATING_TILT_RAD, MAX_INTEGRATED_STEP_S, MAX_LEVEL_BANK_RAD, MAX_MOUNT_TURN_RAD,
    MAX_SAMPLES_AWAITING_CURRENT, MAX_STRENGTH_CHANGE, MAX_WITHHELD_FOR_MOUNT_TURN_S, MIN_DRIFTING_MOUNT_VARIANCE,
    MIN_FIELD_DRIFT, MIN_SIN_INCLINATION, MOUNT_TURN_VARIANCE_FACTOR, POST_CHANGE_DRIFT_TIME_S,
    POST_CHANGE_HARD_IRON_NOISE, POST_CHANGE_S, POST_CHANGE_VARIANCE_INFLATION, SAMPLE_VARIANCE_FACTORS,
    UNEXPLAINED_CHANGE_TIME_S, UNKNOWN_ANGLE_VARIANCE_RAD2, UNOBSERVED_DECAY_TIME_S, VARIANCE_FLOORS, state_noise,
};
pub(super) use parameters::{MAX_SAMPLE_GAP_S, MAX_SENT_SIGMA_RAD};
use stuck_field::StuckField;

/// The monitor. 2 KB.
#[derive(Debug)]
pub(super) struct Monitor {
    expected_sensor_errors: SensorErrorSigmas,
    /// Whether the attitude is that of the module's own sensors: it has hardly any latency and no error in proportion to the bank, no
    /// mount turns against it, and what changes the field leaves it as it is. Its gyro does not check it.
    is_own_attitude: bool,
    filter: UdFilter<STATE_COUNT>,
    adaptive_noise: Option<AdaptiveNoise>,
    innovation_gate: InnovationGate,
    is_strength_test_failed: bool,
    /// Measurement variances due to coefficient errors in the last sample.
    coefficient_variances: PerKind<f32>,
    /// Remaining time of increased hard-iron process noise, seconds.
    post_change_remaining_s: f32,
    coordinated_turn: CoordinatedTurn,
    /// Derivatives of the heading rate by the gyro's errors at the last sample.
    last_gyro_error_row: Option<GyroErrors>,
    mean_innovations: MeanInnovations,
    /// Values of the [`DRIFTING_STATES`] about a minute ago, after a detected change some seconds.
    past_drifting_states: [f32; DRIFTING_STATES.len()],
    heading_drift: HeadingDrift,
    /// Present step of the [`noise_schedule`].
    noise_schedule_step: usize,
    acceleration_tilt: AccelerationTilt,
    hard_iron_detector: ChangeDetector,
    mount_detector: ChangeDetector,
    last_sample_at: Option<Timestamp>,
    /// Samples discarded while the first report of the motor current is awaited.
    samples_awaiting_current: u8,
    gyro_run_number: Option<u8>,
    stuck_field: StuckField,
    output: MonitorOutput,
}

/// Length of the noise schedule, samples: each receives the noise of one state, and by its end all states have received
/// theirs.
const NOISE_SCHEDULE_STEPS: usize = 2 * (STATE_COUNT - 1);

/// State that receives process noise with this sample, and the number of samples since its last addition. To save time,
/// one state is chosen per sample, the gyro heading's offset with every second sample.
const fn noise_schedule(step: usize) -> (usize, usize) {
    let i = step / 2;
    match step % 2 {
        0 => (GYRO_HEADING_OFFSET_INDEX, 2),
        _ if i < GYRO_HEADING_OFFSET_INDEX => (i, NOISE_SCHEDULE_STEPS),
        _ => (i + 1, NOISE_SCHEDULE_STEPS),
    }
}

impl Monitor {
    /// A monitor of headings with an autopilot's attitude.
    pub fn new(expected_sensor_errors: SensorErrorSigmas) -> Self {
        Self::with_attitude(expected_sensor_errors, false)
    }

    fn with_attitude(expected_sensor_errors: SensorErrorSigmas, is_own_attitude: bool) -> Self {
        let initial_sigma = |i| state_noise(i, expected_sensor_errors, is_own_attitude).initial_sigma;
        Self {
            expected_sensor_errors,
            is_own_attitude,
            filter: UdFilter::new(&array::from_fn(initial_sigma)),
            adaptive_noise: None,
            innovation_gate: InnovationGate::NO_INNOVATIONS,
            is_strength_test_failed: false,
            coefficient_variances: [0.0; 3],
            post_change_remaining_s: 0.0,
            coordinated_turn: CoordinatedTurn::EMPTY,
            last_gyro_error_row: None,
            mean_innovations: MeanInnovations::ZERO_MEANS,
            past_drifting_states: [0.0; DRIFTING_STATES.len()],
            heading_drift: HeadingDrift::NO_DRIFT,
            noise_schedule_step: 0,
            acceleration_tilt: AccelerationTilt::INITIAL,
            hard_iron_detector: ChangeDetector::new(MIN_HARD_IRON_CHANGE, HARD_IRON_SIGNIFICANCE_SIGMAS),
            mount_detector: ChangeDetector::new(MIN_MOUNT_TURN_RAD, MOUNT_TURN_SIGNIFICANCE_SIGMAS),
            last_sample_at: None,
            samples_awaiting_current: 0,
            gyro_run_number: None,
            stuck_field: StuckField::NOT_STUCK,
            output: MonitorOutput::INITIAL,
        }
    }

    pub const fn monitor_output(&self) -> &MonitorOutput {
        &self.output
    }

    /// Processes a sample whose last reading was at `at`. With the first one of the other source of attitude the monitor starts again.
    #[inline(never)]
    pub fn process_sample(
        &mut self,
        monitored: &MonitoredCalibration<'_>,
        at: Timestamp,
        AveragedSample { sample, corrected, latest_rates }: &AveragedSample,
        attitude: MonitoredAttitude,
    ) {
        let (is_own_attitude, errors) = match attitude {
            MonitoredAttitude::Own => (true, AutopilotErrors::default()),
            MonitoredAttitude::Autopilot(errors) => (false, errors),
        };
        if is_own_attitude != self.is_own_attitude {
            self.reset_states(is_own_attitude);
        }
        let calibration = monitored.calibration;
        let mean_field = || calibration.corrected_body_field(sample);
        let field = corrected.map_or_else(mean_field, |corrected| corrected.field).ut / calibration.total_ut;
        let gyro_heading = corrected.map(|corrected| corrected.gyro_heading.extrapolated(calibration.latency_s));
        let mean_rates = gyro_heading.map_or_else(EulerRates::default, |gyro_heading| gyro_heading.euler_rates);
        // Field relative to the hard iron, in units of the field strength: errors of the soft iron multiply it.
        let position = (sample.field.ut - calibration.b_vector_ut()) / calibration.total_ut;
        let monitor_sample = MonitorSample {
            field,
            mount_turn_effect: (!is_own_attitude).then(|| MountTurnEffect::new(calibration, &position)),
            attitude: sample.latency_compensated_attitude(calibration.latency_s),
            euler_rates: *latest_rates,
        };
        if self.is_awaiting_current(calibration, sample)
            || !monitor_sample.is_finite()
            || gyro_heading.is_some_and(|gyro_heading| !gyro_heading.relative_heading_rad.is_finite())
        {
            return;
        }
        let step_s = self.last_sample_at.map_or(INITIAL_STEP_S, |last| at.us_since(last) as f32 * 1e-6);
        self.last_sample_at = Some(at);
        if let Some(gyro_heading) = &gyro_heading {
            let (_, cos_inclination) = trig::sin_cos(calibration.inclination_rad);
            self.stuck_field.add_field(&field, monitor_sample.attitude, gyro_heading, cos_inclination, step_s);
        }
        if self.stuck_field.is_stuck() {
            self.reset_states(is_own_attitude);
            // A stuck sensor and the attitude of another vehicle look the same here.
            self.output.validity = Err(NoHeading::FieldChanged);
            return;
        }
        self.acceleration_tilt.update_tilt(
            monitor_sample.attitude,
            &monitor_sample.euler_rates,
            errors.tilt.map_or(0.0, |tilt| tilt.noise_variance_rad2),
            step_s,
        );
        let gyro_rows = gyro_heading.map(|_| GyroErrorRows::new(monitor_sample.attitude, &mean_rates));
        let by_tilt = gyro_rows.as_ref().map_or(0.0, |rows| self.heading_noise_by_tilt(monitored, rows));
        self.predict_state(by_tilt, step_s);
        self.propagate_gyro_heading_offset(gyro_rows.map(|rows| rows.heading_row), step_s);
        self.initialise_gyro_heading_offset(&monitor_sample, gyro_heading, step_s);
        self.update_autopilot_errors(&errors, monitor_sample.attitude.roll_rad, step_s);
        let heading_jacobian =
            self.update_measurements(monitored, &monitor_sample, &position, gyro_heading.as_ref(), step_s);
        self.inflate_by_drift(monitor_sample.attitude.roll_rad, &heading_jacobian, step_s);
        let [_, z] = GYRO_RATE_OFFSET_INDICES;
        let gyro_offset =
            GyroOffsetEstimate { offset_rad_s: self.filter.mean()[z], variance: self.filter.state_variance(z) };
        self.heading_drift.update_drift(gyro_offset, monitor_sample.euler_rates.heading_rad_s, step_s);
        if let Some(rows) = gyro_rows.filter(|_| !is_own_attitude) {
            self.update_coordinated_turn(monitor_sample.attitude, &mean_rates, &rows.pitch_row, step_s);
        }
        let offset_rad = self.filter.mean()[GYRO_HEADING_OFFSET_INDEX];
        self.filter.set_mean(GYRO_HEADING_OFFSET_INDEX, wrap_pi(offset_rad));
        if !self.filter.is_finite() {
            // A state that is not finite is unexpected; the reset keeps NaN out of all later results.
            self.reset_states(is_own_attitude);
            return;
        }
        self.update_output(monitored, &monitor_sample, &heading_jacobian, step_s);
    }

    /// Whether to discard a sample because the motor current is not reported yet, for which the calibration corrects:
    /// the first samples would be estimated as another field.
    fn is_awaiting_current(&mut self, calibration: &Calibration, sample: &Sample) -> bool {
        let is_awaiting = self.last_sample_at.is_none()
            && self.samples_awaiting_current < MAX_SAMPLES_AWAITING_CURRENT
            && calibration.motor_current.is_applied()
            && sample.current.amperes().is_none();
        self.samples_awaiting_current += u8::from(is_awaiting);
        is_awaiting
    }

    /// Resets the monitor but for what it knows of a stuck field. Not inlined, because a whole monitor is on the stack.
    #[inline(never)]
    fn reset_states(&mut self, is_own_attitude: bool) {
        *self = Self {
            stuck_field: self.stuck_field,
            last_sample_at: self.last_sample_at,
            ..Self::with_attitude(self.expected_sensor_errors, is_own_attitude)
        };
    }

    /// Angle by which the module has turned in its mount, radians.
    pub const fn mount_turn_rad(&self) -> f32 {
        self.filter.mean()[MOUNT_TURN_INDEX]
    }

    /// Forgets the errors of the gyro, since another one is in use, and the turn of the mount, for which wrong rates were taken.
    pub fn forget_gyro(&mut self) {
        for state in (FIRST_GYRO_ERROR_INDEX..STATE_COUNT).chain([MOUNT_TURN_INDEX]) {
            let noise = state_noise(state, self.expected_sensor_errors, self.is_own_attitude);
            self.filter.replace_state(state, 0.0, square(noise.initial_sigma));
        }
        self.gyro_run_number = None;
    }

    /// Time update of all states, with the process noise of the gyro heading by the attitude's errors.
    fn predict_state(&mut self, heading_noise_by_tilt: f32, step_s: f32) {
        self.post_change_remaining_s = (self.post_change_remaining_s - step_s).max(0.0);
        let (i, samples) = noise_schedule(self.noise_schedule_step);
        self.noise_schedule_step = (self.noise_schedule_step + 1) % NOISE_SCHEDULE_STEPS;
        let is_unsettled = self.post_change_remaining_s > 0.0 && HARD_IRON_INDICES.contains(&i);
        let noise = if is_unsettled {
            POST_CHANGE_HARD_IRON_NOISE
        } else {
            state_noise(i, self.expected_sensor_errors, self.is_own_attitude)
        };
        let is_gyro_heading = i == GYRO_HEADING_OFFSET_INDEX;
        if is_gyro_heading || self.filter.state_variance(i) < square(noise.initial_sigma) {
            let by_tilt = if is_gyro_heading { heading_noise_by_tilt } else { 0.0 };
            self.filter.inflate_variance(i, (noise.process_noise_per_s + by_tilt) * step_s * samples as f32);
        }
        // Unobservable states must not accumulate a day of noise; a confirmed change of hard iron must persist.
        let decay = (1.0 - step_s / UNOBSERVED_DECAY_TIME_S).max(0.0);
        if measurement_model::hard_iron_change(self.filter.mean()).vector_length() < MAX_DECAYING_HARD_IRON {
            self.decay_states(HARD_IRON_CHANGE_INDEX..MOUNT_TURN_INDEX, decay);
        }
        self.decay_states(ROLL_BIAS_INDEX..GYRO_HEADING_OFFSET_INDEX, decay);
        if self.filter.mean()[MOUNT_TURN_INDEX].abs() < MAX_DECAYING_MOUNT_TURN_RAD {
            self.decay_states(MOUNT_TURN_INDEX..STRENGTH_CHANGE_INDEX, decay);
        }
    }

    /// Process noise of the gyro heading by the attitude's errors, square radians per second.
    fn heading_noise_by_tilt(&self, monitored: &MonitoredCalibration<'_>, rows: &GyroErrorRows) -> f32 {
        let calibration_noise = monitored.sample_noise();
        let noise =
            self.adaptive_noise.as_ref().map_or(calibration_noise, |noise| noise.sample_noise(calibration_noise));
        ATTITUDE_ERROR_TIME_S * noise.tilt_variance_rad2 * rows.heading_by_tilt_squared
    }

    /// Time update of the gyro heading's offset, with the mean of the gyro's rows at both ends of the step. In a gap between samples it
    /// may have turned by a circle, with its scale error.
    fn propagate_gyro_heading_offset(&mut self, gyro_error_row: Option<GyroErrors>, step_s: f32) {
        let last = core::mem::replace(&mut self.last_gyro_error_row, gyro_error_row);
        let Some((now, last)) = gyro_error_row.zip(last).filter(|_| step_s <= MAX_GYRO_HEADING_GAP_S) else { return };
        let is_gap = step_s > MAX_SAMPLE_GAP_S;
        let mut row = [0.0; STATE_COUNT];
        for i in 0..GYRO_ERROR_COUNT {
            let state = FIRST_GYRO_ERROR_INDEX + i;
            if !is_gap || GYRO_RATE_OFFSET_INDICES.contains(&state) {
                row[state] = -0.5 * step_s * (now[i] + last[i]);
            }
        }
        self.filter.propagate(GYRO_HEADING_OFFSET_INDEX, &row);
        if is_gap {
            let turn_error_rad = TAU * self.expected_sensor_errors.gyro_scale;
            self.filter.inflate_variance(GYRO_HEADING_OFFSET_INDEX, square(turn_error_rad));
        }
    }

    /// Updates the errors of attitude and gyro that the own sensors show: those of the field are not taken for them then.
    fn update_autopilot_errors(&mut self, errors: &AutopilotErrors, roll_rad: f32, step_s: f32) {
        if !HAS_OWN_ATTITUDE || step_s <= 0.0 {
            return;
        }
        if let Some(TiltError { roll_rad: roll_error_rad, pitch_rad, variance_rad2, .. }) = errors.tilt {
            let variance = variance_rad2 * TILT_ERROR_TIME_S / step_s;
            self.measure_states(
                &[(ROLL_BIAS_INDEX, 1.0), (BANK_SCALE_ERROR_INDEX, roll_rad)],
                roll_error_rad,
                variance,
            );
            self.measure_states(&[(PITCH_BIAS_INDEX, 1.0)], pitch_rad, variance);
        }
        let excess = square(errors.unexplained_turn_rad) - self.filter.state_variance(MOUNT_TURN_INDEX);
        if excess > 0.0 {
            self.filter.inflate_variance(MOUNT_TURN_INDEX, excess);
        }
        if let Some(offset) = errors.gyro_offset {
            let variance = offset.variance * GYRO_OFFSET_TIME_S / step_s;
            for (state, rad_s) in GYRO_RATE_OFFSET_INDICES.into_iter().zip([offset.rad_s.y, offset.rad_s.z]) {
                self.measure_states(&[(state, 1.0)], rad_s, variance);
            }
        }
    }

    /// Updates with a measured sum of states, each times its factor.
    fn measure_states(&mut self, terms: &[(usize, f32)], measured: f32, variance: f32) {
        let (mut jacobian, mut residual) = ([0.0; STATE_COUNT], measured);
        for &(state, factor) in terms {
            jacobian[state] = factor;
            residual -= factor * self.filter.mean()[state];
        }
        self.filter.apply_measurement(&Measurement { jacobian, residual, variance });
    }

    fn decay_states(&mut self, states: Range<usize>, decay: f32) {
        for i in states {
            let decayed = decay * self.filter.mean()[i];
            self.filter.set_mean(i, decayed);
        }
    }

    /// Re-initialises the gyro heading offset after a gap or a restart of the integration.
    fn initialise_gyro_heading_offset(
        &mut self,
        sample: &MonitorSample,
        gyro_heading: Option<GyroHeading>,
        step_s: f32,
    ) {
        if let Some(gyro_heading) = gyro_heading.filter(|gyro_heading| {
            self.gyro_run_number != Some(gyro_heading.run_number) || step_s > MAX_GYRO_HEADING_GAP_S
        }) {
            let (measured, _) = measurement_model::body_field(sample, self.filter.mean());
            let attitude =
                measurement_model::correct_attitude(sample.attitude, &sample.euler_rates, self.filter.mean());
            let heading_rad = attitude.to_level_frame(measured).heading_rad();
            self.filter.set_mean(GYRO_HEADING_OFFSET_INDEX, wrap_pi(heading_rad - gyro_heading.relative_heading_rad));
            self.filter.inflate_variance(GYRO_HEADING_OFFSET_INDEX, UNKNOWN_ANGLE_VARIANCE_RAD2);
            self.coordinated_turn = CoordinatedTurn::EMPTY;
        }
        self.gyro_run_number = gyro_heading.map(|gyro_heading| gyro_heading.run_number);
    }

    /// Updates with the measurements of strength, inclination and heading that pass the innovation gates. Returns the
    /// derivatives of the heading by the states.
    #[inline(never)]
    fn update_measurements(
        &mut self,
        monitored: &MonitoredCalibration<'_>,
        sample: &MonitorSample,
        normalised_field: &Vector3<f32>,
        gyro_heading: Option<&GyroHeading>,
        step_s: f32,
    ) -> StateVector {
        let states = *self.filter.mean();
        let predicted = PredictedField::new(&states, monitored.calibration.inclination_rad, gyro_heading);
        let model = MeasurementModel::new(sample, &states, &predicted);
        let variances = self.measurement_variances(monitored, sample, &model, normalised_field, step_s);
        let measurements = model.measurements(&predicted, sample, variances);
        self.adapt_noise_to_residuals(monitored, &measurements, step_s);
        let is_usable =
            self.test_innovations(monitored.calibration, sample, &model, &measurements, normalised_field, step_s);
        if let Some(gyro_heading) = gyro_heading {
            let is_beyond_limits = self.output.validity.is_err() && !self.innovation_gate.is_withholding();
            self.innovation_gate.update_turn(gyro_heading.euler_rates.heading_rad_s * step_s, is_beyond_limits, step_s);
        }
        for (measurement, is_usable) in measurements.iter().zip(is_usable) {
            if let (Some(measurement), true) = (measurement, is_usable) {
                self.apply_measurement(measurement, &states);
            }
        }
        model.heading_jacobian
    }

    /// Measurement noise: the sample's, a floor, and the coefficient covariance. Adapts the strength noise first.
    fn measurement_variances(
        &mut self,
        monitored: &MonitoredCalibration<'_>,
        sample: &MonitorSample,
        model: &MeasurementModel,
        normalised_field: &Vector3<f32>,
        step_s: f32,
    ) -> PerKind<f32> {
        let calibration_noise = monitored.sample_noise();
        let noise = self.adaptive_noise.get_or_insert_with(|| AdaptiveNoise::new(calibration_noise, model.strength));
        noise.update_strength_noise(calibration_noise, model.strength, step_s);
        let EulerRates { roll_rad_s, pitch_rad_s, .. } = sample.euler_rates;
        let jitter_rad = ATTITUDE_JITTER_S * trig::hypot(roll_rad_s, pitch_rad_s);
        let tilt_variance_rad2 = noise.correlated_noise_factor()
            * (noise.sample_noise(calibration_noise).tilt_variance_rad2
                + jitter_rad * jitter_rad
                + self.acceleration_tilt.variance_rad2());
        let tan_squared = model.tan_inclination * model.tan_inclination;
        let by_sample = [noise.strength_residual_mean_square(), tilt_variance_rad2, tilt_variance_rad2 * tan_squared];
        let by_coefficients = model
            .field_jacobians()
            .map(|jacobian| monitored.uncertainty.variance_from_coefficients(&jacobian, normalised_field));
        self.coefficient_variances = by_coefficients;
        array::from_fn(|kind| {
            SAMPLE_VARIANCE_FACTORS[kind] * by_sample[kind]
                + VARIANCE_FLOORS[kind]
                + COEFFICIENT_CORRELATION_FACTOR * by_coefficients[kind]
        })
    }

    fn adapt_noise_to_residuals(
        &mut self,
        monitored: &MonitoredCalibration<'_>,
        [strength, inclination, _]: &PerKind<Option<Measurement<STATE_COUNT>>>,
        step_s: f32,
    ) {
        let Some(noise) = &mut self.adaptive_noise else { return };
        if let Some(inclination) = inclination {
            noise.update_tilt_noise(monitored.sample_noise(), inclination.residual, step_s);
        }
        if let Some(strength) = strength {
            noise.update_strength_residual(strength.residual, step_s);
        }
    }

    /// Tests the innovations and inflates the covariance after a change; whether each measurement is usable.
    fn test_innovations(
        &mut self,
        calibration: &Calibration,
        sample: &MonitorSample,
        model: &MeasurementModel,
        measurements: &PerKind<Option<Measurement<STATE_COUNT>>>,
        normalised_field: &Vector3<f32>,
        step_s: f32,
    ) -> PerKind<bool> {
        let innovations = array::from_fn(|kind| measurements[kind].as_ref().map(|m| self.innovation(m)));
        let slow_change = self.mean_innovations.update_means(&innovations, step_s);
        if slow_change == Some(SlowChange::Heading) && self.post_change_remaining_s <= 0.0 {
            self.inflate_gyro_rate_offsets(step_s);
        }
        match self.innovation_gate.test_innovations(innovations, step_s) {
            GateResult::Consistent { is_usable } => {
                let is_slow = slow_change == Some(SlowChange::Field) && is_usable == [true; 3];
                if is_slow || self.innovation_gate.is_change_recent() {
                    self.inflate_by_unexplained_change(model, innovations, step_s);
                }
                is_usable
            }
            GateResult::ChangeDetected { exceeding_residuals } => {
                let turn = sample
                    .mount_turn_effect
                    .and_then(|_| explained_turn(calibration, &model.calibrated_field_residual, normalised_field));
                let roll_rad = sample.attitude.roll_rad;
                self.inflate_covariance(model, exceeding_residuals, roll_rad);
                self.attribute_to_mount_turn(turn, is_level(roll_rad), exceeding_residuals);
                [true; 3]
            }
        }
    }

    /// Inflates hard iron by the part of the innovations that its variance does not explain, during a slow change and soon
    /// after a detected one, which may go on: gyro offset, heading and attitude must not follow it. In turns, where the
    /// gates detect changed iron again, the turn of the mount instead.
    fn inflate_by_unexplained_change(
        &mut self,
        model: &MeasurementModel,
        innovations: PerKind<Option<Innovation>>,
        step_s: f32,
    ) {
        let unexplained = |Innovation { residual, variance }| (residual * residual - variance).max(0.0);
        let [strength, inclination, heading] = innovations.map(|innovation| innovation.map_or(0.0, unexplained));
        let is_turning = self.heading_drift.is_turning();
        // In a turn the heading shows errors of the gyro as well.
        let heading = if is_turning { 0.0 } else { heading * square(model.cos_inclination()) };
        let square_size = strength.max(inclination).max(heading);
        let variance = square_size.min(square(MAX_INFLATING_INNOVATION)) * step_s / UNEXPLAINED_CHANGE_TIME_S;
        if is_turning {
            self.filter.inflate_variance(MOUNT_TURN_INDEX, variance);
        } else {
            self.inflate_states(&HARD_IRON_INDICES, variance);
        }
    }

    /// Inflates the variance of the gyro's offsets, which may change faster than their process noise. Other states are
    /// not inflated: on recorded flights they would follow the attitude's errors, and a turn of the mount would follow a
    /// gyro whose offset grows.
    fn inflate_gyro_rate_offsets(&mut self, step_s: f32) {
        for state in GYRO_RATE_OFFSET_INDICES {
            let variance = self.filter.state_variance(state);
            if variance < MAX_GYRO_OFFSET_VARIANCE {
                let grown = square(sqrt(variance) + GYRO_OFFSET_GROWTH_RAD_S2 * step_s);
                self.filter.inflate_variance(state, grown - variance);
            }
        }
    }

    fn inflate_states(&mut self, states: &[usize], variance: f32) {
        for &state in states {
            self.filter.inflate_variance(state, variance);
        }
    }

    /// Inflates all axes of hard iron by a drift of the field: unobserved axes may have drifted as much as observed
    /// ones. Hard iron across the horizontal field does not count: an error of the gyro's offset moves it as well, and
    /// the inflation would free it to go on. In a bank, which makes it observable, the mount's turn is inflated as well.
    /// After a detected change the drift is one of seconds: what has changed is known, and may go on. Iron that turns the
    /// heading far is not inflated then: with free iron a heading of the other side explains the field as well.
    fn inflate_by_drift(&mut self, roll_rad: f32, heading_jacobian: &StateVector, step_s: f32) {
        let states = self.filter.mean();
        let now: [f32; DRIFTING_STATES.len()] = DRIFTING_STATES.map(|i| states[i]);
        let is_after_change = self.post_change_remaining_s > 0.0;
        let drift_time_s = if is_after_change { POST_CHANGE_DRIFT_TIME_S } else { FIELD_DRIFT_TIME_S };
        let mut drift = [0.0; DRIFTING_STATES.len()];
        for ((drift, past), now) in drift.iter_mut().zip(&mut self.past_drifting_states).zip(now) {
            *past += (now - *past) * step_s / (drift_time_s + step_s);
            *drift = now - *past;
        }
        let [x, y, z, ..] = drift;
        let by_iron = measurement_model::hard_iron_change(heading_jacobian);
        let across = by_iron.unit_vector().dot(&Vector3::new(x, y, z));
        let drift_squared = drift.iter().map(|drift| drift * drift).sum::<f32>() - square(across);
        let turned_rad = by_iron.vector_length() * measurement_model::hard_iron_change(states).vector_length();
        let is_far = is_after_change && turned_rad > MAX_DRIFTING_IRON_RAD;
        if drift_squared > MIN_FIELD_DRIFT * MIN_FIELD_DRIFT && !is_far {
            let variance = FIELD_DRIFT_INFLATION_FACTOR * drift_squared * step_s / FIELD_DRIFT_TIME_S;
            self.inflate_states(&HARD_IRON_INDICES, variance);
            if !is_level(roll_rad) {
                self.filter.inflate_variance(MOUNT_TURN_INDEX, MOUNT_TURN_VARIANCE_FACTOR * variance);
            }
        }
    }

    fn innovation(&self, measurement: &Measurement<STATE_COUNT>) -> Innovation {
        let Measurement { jacobian, residual, variance } = measurement;
        Innovation { residual: *residual, variance: self.filter.projected_variance(jacobian) + variance }
    }

    /// Updates with a measurement predicted at `predicted_with`; corrects its residual for updates since.
    #[inline(never)]
    fn apply_measurement(&mut self, measurement: &Measurement<STATE_COUNT>, predicted_with: &StateVector) {
        let mut measurement = *measurement;
        let changes = self.filter.mean().iter().zip(predicted_with).map(|(now, then)| now - then);
        measurement.residual -= measurement.jacobian.iter().zip(changes).map(|(d, change)| d * change).sum::<f32>();
        self.filter.apply_measurement(&measurement);
    }

    /// Updates with the coordinated-turn pseudo-measurement at the end of its window.
    fn update_coordinated_turn(
        &mut self,
        attitude: RollPitch,
        euler_rates: &EulerRates,
        gyro_error_row: &GyroErrors,
        step_s: f32,
    ) {
        if step_s > MAX_INTEGRATED_STEP_S {
            self.coordinated_turn = CoordinatedTurn::EMPTY;
            return;
        }
        let states = self.filter.mean();
        let measured = self.coordinated_turn.integrate(attitude, euler_rates, gyro_error_row, step_s, states);
        if let Some(measurement) = measured {
            self.filter.apply_measurement(&measurement);
        }
    }

    /// Inflates the covariance of states that can explain a detected change.
    fn inflate_covariance(
        &mut self,
        model: &MeasurementModel,
        [strength, inclination, heading]: PerKind<f32>,
        roll_rad: f32,
    ) {
        let cos_inclination = model.cos_inclination();
        // Field change across the horizontal component, relative to the field strength.
        let [strength, inclination, across] =
            [strength, inclination, heading * cos_inclination].map(|size| size.min(MAX_INFLATING_INNOVATION));
        let field = strength.max(inclination);
        let hard_iron_sigma = field.max(across);
        self.inflate_states(&HARD_IRON_INDICES, hard_iron_sigma * hard_iron_sigma);
        let earth_field_sigma = EARTH_FIELD_SHARE_OF_CHANGE * field;
        self.inflate_states(&[STRENGTH_CHANGE_INDEX, INCLINATION_CHANGE_INDEX], earth_field_sigma * earth_field_sigma);
        if !self.is_own_attitude {
            // A heading error is `tan(inclination)` times the tilt.
            let sin_inclination = (model.tan_inclination * cos_inclination).abs().max(MIN_SIN_INCLINATION);
            let by_tilt = inclination.max(across / sin_inclination).min(MAX_INFLATING_TILT_RAD);
            let tilt_rad = ATTITUDE_SHARE_OF_CHANGE * by_tilt;
            self.inflate_states(&[ROLL_BIAS_INDEX, PITCH_BIAS_INDEX], tilt_rad * tilt_rad);
            if !is_level(roll_rad) {
                self.filter.inflate_variance(BANK_SCALE_ERROR_INDEX, square(tilt_rad / roll_rad));
                self.inflate_mount_turn(inclination.max(heading));
            }
        }
        self.is_strength_test_failed |= strength > 0.0;
        self.post_change_remaining_s = POST_CHANGE_S;
    }

    /// Attributes a detected change in level flight to a turn of the module if this explains the field. A module turns
    /// once: when the field changes again and again, an estimated turn must go on to explain it.
    fn attribute_to_mount_turn(&mut self, turn: Option<ExplainedTurn>, is_level: bool, residuals: PerKind<f32>) {
        let estimated_rad = self.filter.mean()[MOUNT_TURN_INDEX];
        let is_first = self.innovation_gate.withheld_s() < MAX_WITHHELD_FOR_MOUNT_TURN_S;
        let is_confirmed = turn.is_some_and(|turn| (turn.turn_rad - estimated_rad).abs() < MAX_DECAYING_MOUNT_TURN_RAD);
        match turn {
            Some(turn) if is_first && is_level => self.restart_from_mount_turn(&turn, residuals),
            _ if is_first || is_confirmed || estimated_rad.abs() < MAX_DECAYING_MOUNT_TURN_RAD => {}
            _ => self.restart_from_mount_turn(&ExplainedTurn::NO_TURN, residuals),
        }
    }

    fn inflate_mount_turn(&mut self, sigma_rad: f32) {
        let sigma_rad = sigma_rad.min(MAX_MOUNT_TURN_RAD);
        self.filter.inflate_variance(MOUNT_TURN_INDEX, sigma_rad * sigma_rad);
    }

    /// Starts again from a turn of the module that explains the field, with the hard iron as calibrated but for what
    /// stays. The sigma is the heading's residual, or the change of the estimate.
    fn restart_from_mount_turn(&mut self, turn: &ExplainedTurn, [_, _, heading_rad]: PerKind<f32>) {
        let ExplainedTurn { turn_rad, hard_iron_change } = turn;
        let change_rad = (turn_rad - self.filter.mean()[MOUNT_TURN_INDEX]).abs();
        self.inflate_mount_turn(heading_rad.max(change_rad));
        self.filter.set_mean(MOUNT_TURN_INDEX, *turn_rad);
        for (axis, change) in HARD_IRON_INDICES.into_iter().zip(hard_iron_change) {
            self.filter.set_mean(axis, *change);
        }
    }

    #[inline(never)]
    fn update_output(
        &mut self,
        monitored: &MonitoredCalibration<'_>,
        sample: &MonitorSample,
        heading_jacobian: &StateVector,
        step_s: f32,
    ) {
        let states = *self.filter.mean();
        let variance_rad2 = self.filter.projected_variance(heading_jacobian);
        let mut by_field = *heading_jacobian;
        // As long as nothing drifts, the variance of the mount's turn is its initial one.
        let is_drifting = self.filter.state_variance(MOUNT_TURN_INDEX) > MIN_DRIFTING_MOUNT_VARIANCE;
        by_field[STRENGTH_CHANGE_INDEX..].fill(0.0);
        by_field[MOUNT_TURN_INDEX] = if is_drifting { heading_jacobian[MOUNT_TURN_INDEX] } else { 0.0 };
        self.is_strength_test_failed &= self.innovation_gate.is_withholding();
        let change = measurement_model::hard_iron_change(&states);
        let is_as_calibrated = change.vector_length() < MAX_DECAYING_HARD_IRON
            && states[MOUNT_TURN_INDEX].abs() < MAX_DECAYING_MOUNT_TURN_RAD;
        let unsettled_share = if is_as_calibrated { self.post_change_remaining_s / POST_CHANGE_S } else { 1.0 };
        let sent_rad2 = if unsettled_share > 0.0 {
            (1.0 + unsettled_share * (POST_CHANGE_VARIANCE_INFLATION - 1.0)) * variance_rad2
        } else {
            // Without a detected change, attitude errors are part of the noise; hard iron may still drift.
            self.filter.projected_variance(&by_field)
        } + self.heading_drift.variance_rad2()
            + alternative_cause_variance_rad2(&change, heading_jacobian, &states);
        self.output = MonitorOutput {
            states,
            heading_variance_rad2: sent_rad2,
            sample_noise: self.output_noise(monitored.sample_noise()),
            run_and_heading_offset_variance: self
                .gyro_run_number
                .map(|run| (run, self.filter.state_variance(GYRO_HEADING_OFFSET_INDEX))),
            validity: self.assess_validity(&states, sample, heading_jacobian, [variance_rad2, sent_rad2]),
            installation_change: self.detect_change(&change, monitored.calibration.total_ut, step_s),
        };
    }

    fn output_noise(&self, calibration_noise: SampleNoise) -> Option<SampleNoise> {
        let mut noise = self.adaptive_noise.as_ref()?.sample_noise(calibration_noise);
        noise.tilt_variance_rad2 += self.acceleration_tilt.variance_rad2();
        Some(noise)
    }

    /// The change of the installation if it is significant. `hard_iron_change` is relative to the field strength.
    fn detect_change(
        &mut self,
        hard_iron_change: &Vector3<f32>,
        total_ut: f32,
        step_s: f32,
    ) -> Option<InstallationChange> {
        let size = hard_iron_change.vector_length();
        // A larger change is not hard iron, and its size is not reported.
        let is_withholding = self.innovation_gate.is_withholding() || size > MAX_HARD_IRON_CHANGE;
        let turn_rad = self.filter.mean()[MOUNT_TURN_INDEX];
        let sigma_rad = sqrt(self.filter.state_variance(MOUNT_TURN_INDEX));
        if self.mount_detector.update_detection(turn_rad.abs(), sigma_rad, is_withholding, step_s) {
            // Until its estimate is accurate, a turn also appears as changed hard iron.
            return Some(InstallationChange::Mount(MountTurn { turn_rad, sigma_rad }));
        }
        let sigma =
            HARD_IRON_INDICES.map(|axis| sqrt(self.filter.state_variance(axis))).into_iter().fold(0.0, f32::max);
        // Errors of the coefficients resemble changed hard iron.
        let sigma_with_coefficients = sqrt(sigma * sigma + self.coefficient_variances.into_iter().fold(0.0, f32::max));
        let is_significant =
            self.hard_iron_detector.update_detection(size, sigma_with_coefficients, is_withholding, step_s);
        (is_significant && size <= MAX_HARD_IRON_CHANGE).then(|| {
            let (change_ut, sigma_ut) = (hard_iron_change * total_ut, sigma * total_ut);
            InstallationChange::HardIron(HardIronChange { change_ut, sigma_ut })
        })
    }

    /// Whether headings are withheld, and why.
    #[inline(never)]
    fn assess_validity(
        &self,
        states: &StateVector,
        sample: &MonitorSample,
        heading_jacobian: &StateVector,
        [variance_rad2, sent_rad2]: [f32; 2],
    ) -> Result<(), NoHeading> {
        let hard_iron_change = measurement_model::hard_iron_change(states).vector_length();
        let bias_rad = states[ROLL_BIAS_INDEX].abs().max(states[PITCH_BIAS_INDEX].abs());
        if hard_iron_change > MAX_HARD_IRON_CHANGE || states[MOUNT_TURN_INDEX].abs() > MAX_MOUNT_TURN_RAD {
            return Err(NoHeading::FieldChanged);
        }
        if self.innovation_gate.is_withholding() {
            // A wrong attitude leaves the field strength unchanged.
            let tilt_rad = bias_rad.max((states[BANK_SCALE_ERROR_INDEX] * sample.attitude.roll_rad).abs());
            let is_attitude = !self.is_strength_test_failed && tilt_rad > hard_iron_change;
            return Err(if is_attitude { NoHeading::AttitudeContradicted } else { NoHeading::FieldDisturbed });
        }
        if states[STRENGTH_CHANGE_INDEX].abs() > MAX_STRENGTH_CHANGE
            || states[INCLINATION_CHANGE_INDEX].abs() > MAX_INCLINATION_CHANGE_RAD
        {
            return Err(NoHeading::FieldDisturbed);
        }
        if bias_rad > MAX_ATTITUDE_BIAS_RAD || states[BANK_SCALE_ERROR_INDEX].abs() > MAX_BANK_SCALE_ERROR {
            return Err(NoHeading::AttitudeContradicted);
        }
        if variance_rad2 > MAX_HEADING_SIGMA_RAD * MAX_HEADING_SIGMA_RAD
            || sent_rad2 > MAX_SENT_SIGMA_RAD * MAX_SENT_SIGMA_RAD
        {
            let mut by_field = *heading_jacobian;
            by_field[ROLL_BIAS_INDEX..=ATTITUDE_LATENCY_INDEX].fill(0.0);
            let is_field = self.filter.projected_variance(&by_field) > variance_rad2 / 2.0;
            return Err(if is_field { NoHeading::FieldChanged } else { NoHeading::AttitudeContradicted });
        }
        Ok(())
    }
}

/// Heading variance by causes that are estimated beside changed hard iron: biases of the attitude, an error of its bank.
/// Two causes at once are improbable, so that hard iron may be the only one. A turn of the mount changes hard iron, too.
fn alternative_cause_variance_rad2(
    hard_iron_change: &Vector3<f32>,
    heading_jacobian: &StateVector,
    states: &StateVector,
) -> f32 {
    if hard_iron_change.vector_length() < MAX_DECAYING_HARD_IRON {
        return 0.0;
    }
    let causes = [ROLL_BIAS_INDEX, PITCH_BIAS_INDEX, BANK_SCALE_ERROR_INDEX];
    HARD_IRON_PROBABILITY * causes.into_iter().map(|i| square(heading_jacobian[i] * states[i])).sum::<f32>()
}

fn is_level(roll_rad: f32) -> bool {
    roll_rad.abs() <= MAX_LEVEL_BANK_RAD
}

#[cfg(test)]
mod tests;
