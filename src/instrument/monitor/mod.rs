//! Monitor: an extended Kalman filter that checks field, attitude and gyro against each other at 10 Hz.
//!
//! A heading depends on the calibration and on the attitude, and either can become wrong in flight. The measurements
//! are redundant: field strength and inclination do not depend on the heading, the magnetic heading must turn with the
//! gyro, and pitch and roll must follow the body rates. Eleven states model the known causes of disagreement: changed
//! hard iron, another geographic place, gyro drift, attitude bias, bank-angle scale error and attitude latency.
//! Headings are corrected by the estimated states and their variance includes the filter's covariance. Innovations
//! beyond the gates suppress the heading.
//!
//! The covariance is stored as UD factors, so that rounding cannot make a variance negative. The innovations also adapt
//! the measurement noise.
//!
//! After a detected change the covariance of hard iron is inflated isotropically by the squared innovation, because a
//! change along the unobserved direction may be as large as along the observed ones. The variances of field and
//! attitude states are inflated, too. Headings are not dead-reckoned by the gyro through a disturbance: tried three
//! ways, with larger errors each time.

mod acceleration_tilt;
mod adaptive_noise;
mod coordinated_turn;
mod hard_iron;
mod innovation_gate;
mod measurement_model;
#[cfg(test)]
mod tests;
mod ud_filter;

use core::array;
use core::ops::Range;

use nalgebra::Vector3;

use crate::attitude::{EulerRates, GyroHeading};
use crate::calibration::{Calibration, HeadingUncertainty, Sample, inverse};
use crate::frames::{Attitude, Field, wrap_pi};
use crate::heading::{Heading, NoHeading};
use crate::time::Timestamp;
use crate::trig;
use crate::trig::{Length as _, sqrt};
use acceleration_tilt::AccelerationTilt;
use adaptive_noise::{AdaptiveNoise, SampleNoise};
use coordinated_turn::CoordinatedTurn;
use hard_iron::HardIronDetector;
pub use hard_iron::{HardIronChange, HardIronChangeReporter};
use innovation_gate::{GateResult, Innovation, InnovationGate, PerKind};
use measurement_model::{
    ATTITUDE_LATENCY, BANK_SCALE_ERROR, GYRO_DRIFT, GYRO_OFFSET, HARD_IRON_CHANGE, INCLINATION_CHANGE,
    MeasurementModel, MonitorSample, PITCH_BIAS, PredictedField, ROLL_BIAS, STATE_COUNT, STRENGTH_CHANGE, StateVector,
};
use ud_filter::{Measurement, UdFilter};

/// Monitor parameters. Angles in radians, fields relative to the calibrated strength.
#[derive(Clone, Copy, Debug)]
pub struct MonitorConfig {
    /// Initial standard deviation of each state.
    pub initial_sigmas: StateVector,
    /// Process noise: variance per second, added while the variance is below the initial one; always for the gyro
    /// heading offset.
    pub process_noise_per_s: StateVector,
    /// Duration of increased hard-iron uncertainty after a detected change, seconds.
    pub post_change_s: f32,
    /// Hard-iron sigma limiting its process noise meanwhile.
    pub post_change_sigma: f32,
    /// Hard-iron process noise meanwhile, per second.
    pub post_change_noise_per_s: f32,
    /// Heading-variance inflation after a detected change (dimensionless): the states may not model the change.
    pub post_change_inflation: f32,
    /// Hard-iron norm below which the estimate decays towards zero; attitude estimates always do.
    pub max_decaying_hard_iron: f32,
    /// Time constant of that decay, seconds.
    pub decay_time_s: f32,
    /// Factor on the sample variance of each measurement.
    pub sample_variance_factors: PerKind<f32>,
    /// Variance of unmodelled errors, added to each measurement.
    pub variance_floors: PerKind<f32>,
    /// Factor on the variance due to coefficient errors, which are constant at one attitude.
    pub coefficient_variance_factor: f32,
    /// Attitude timing jitter, seconds: tilt error per rotation rate.
    pub attitude_jitter_s: f32,
    /// Limit of an innovation for covariance inflation.
    pub max_innovation: f32,
    /// Limit of a tilt error for covariance inflation, radians.
    pub max_tilt_innovation_rad: f32,
    /// Share of a detected change attributed to the attitude.
    pub attitude_share: f32,
    /// Largest heading sigma by the filter, radians; beyond it headings are withheld.
    pub max_heading_sigma_rad: f32,
    /// Largest change of hard iron.
    pub max_hard_iron_change: f32,
    /// Largest change of field strength.
    pub max_strength_change: f32,
    /// Largest change of inclination, radians.
    pub max_inclination_change_rad: f32,
    /// Largest roll or pitch bias, radians.
    pub max_attitude_bias_rad: f32,
    /// Largest bank-angle scale error.
    pub max_bank_scale_error: f32,
    /// Gate of a single reading's heading against the gyro heading, sigmas.
    pub reading_gate_sigmas: f32,
    pub innovation_gate: innovation_gate::InnovationGateConfig,
    pub adaptive_noise: adaptive_noise::AdaptiveNoiseConfig,
}

impl MonitorConfig {
    /// Tuned in the simulator and checked on recorded flights.
    pub const DEFAULT: Self = Self {
        initial_sigmas: [0.006, 0.006, 0.006, 0.06, 0.1, 10.0, 0.0026, 0.004, 0.004, 0.02, 0.1],
        process_noise_per_s: [1e-7, 1e-7, 1e-7, 1e-7, 1e-7, 1e-6, 1e-9, 3e-7, 3e-7, 1e-7, 3e-5],
        post_change_s: 60.0,
        post_change_sigma: 0.01,
        post_change_noise_per_s: 1e-6,
        post_change_inflation: 5.0,
        max_decaying_hard_iron: 0.03,
        decay_time_s: 1000.0,
        sample_variance_factors: [4.0, 1.0, 0.75],
        variance_floors: [9e-6, 9e-6, 1.44e-4],
        coefficient_variance_factor: 8.0,
        attitude_jitter_s: 0.01,
        max_innovation: 0.5,
        max_tilt_innovation_rad: 0.3,
        attitude_share: 0.5,
        max_heading_sigma_rad: 0.14,
        max_hard_iron_change: 0.6,
        max_strength_change: 0.2,
        max_inclination_change_rad: 0.2,
        max_attitude_bias_rad: 0.15,
        max_bank_scale_error: 0.5,
        reading_gate_sigmas: 4.5,
        innovation_gate: innovation_gate::InnovationGateConfig::DEFAULT,
        adaptive_noise: adaptive_noise::AdaptiveNoiseConfig::DEFAULT,
    };
}

/// Longest interval over which the gyro heading offset is kept, seconds.
const MAX_GAP_S: f32 = 3.0;

/// Assumed interval before the first sample, seconds.
const INITIAL_STEP_S: f32 = 0.1;

/// Variance of an unknown angle: pi^2, square radians.
const UNKNOWN_ANGLE_VARIANCE_RAD2: f32 = 10.0;

#[derive(Clone, Copy, Debug)]
pub(super) struct MonitoredCalibration<'a> {
    pub calibration: &'a Calibration,
    pub uncertainty: &'a HeadingUncertainty,
    pub readings_per_sample: u16,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct MonitorOutput {
    states: StateVector,
    /// Heading variance due to the states' covariance, square radians.
    pub heading_variance_rad2: f32,
    sample_noise: Option<SampleNoise>,
    /// Gyro integration run, and variance of its heading offset, square radians.
    gyro_offset: Option<(u8, f32)>,
    /// Reason why headings are withheld.
    pub validity: Result<(), NoHeading>,
    /// Change of hard iron, once it is significant.
    pub hard_iron_change: Option<HardIronChange>,
}

impl MonitorOutput {
    pub const INITIAL: Self = Self {
        states: [0.0; STATE_COUNT],
        heading_variance_rad2: 0.0,
        sample_noise: None,
        gyro_offset: None,
        validity: Ok(()),
        hard_iron_change: None,
    };

    pub fn correct_attitude(&self, reported: Attitude, motion: &EulerRates) -> Attitude {
        measurement_model::correct_attitude(reported, motion, &self.states)
    }

    /// Gate of a single reading against the gyro heading; it detects a field step 0.1 s earlier than an averaged
    /// sample.
    pub fn passes_reading_gate(&self, config: &MonitorConfig, heading: Heading, turning: Option<&GyroHeading>) -> bool {
        let Some((turning, (run, offset_rad2))) = turning.zip(self.gyro_offset) else { return true };
        let GyroHeading { euler_rates: motion, relative_heading_rad: turned_rad, .. } = turning;
        let by_gyro = turned_rad + self.states[GYRO_OFFSET] + self.states[ATTITUDE_LATENCY] * motion.heading_rad_s;
        let off_rad = wrap_pi(heading.magnetic_rad - by_gyro);
        let variance = heading.sigma_rad * heading.sigma_rad + offset_rad2;
        turning.run != run || off_rad * off_rad <= config.reading_gate_sigmas * config.reading_gate_sigmas * variance
    }

    /// Calibration and noise corrected by the estimated states. The change of hard iron converts to sensor axes:
    /// `W (m - b) - beta F = W (m - (b + W^-1 beta F))`.
    #[inline(never)]
    pub fn correct_calibration(&self, monitored: &MonitoredCalibration<'_>) -> (Calibration, HeadingUncertainty) {
        let MonitoredCalibration { calibration, uncertainty, readings_per_sample } = *monitored;
        let beta_ut = measurement_model::hard_iron_change(&self.states) * calibration.total_ut;
        let moved_ut = inverse(&calibration.w_matrix()).map_or_else(Vector3::zeros, |inverse| inverse * beta_ut);
        let adjusted = Calibration {
            b_ut: (calibration.b_vector_ut() + moved_ut).into(),
            inclination_rad: calibration.inclination_rad + self.states[INCLINATION_CHANGE],
            total_ut: calibration.total_ut * (1.0 + self.states[STRENGTH_CHANGE]),
            ..*calibration
        };
        let adapted = self.sample_noise.map_or(*uncertainty, |variances| HeadingUncertainty {
            sensor_sigma: sqrt(variances.strength_variance * f32::from(readings_per_sample)),
            attitude_sigma_rad: sqrt(variances.tilt_rad2),
            ..*uncertainty
        });
        (adjusted, adapted)
    }
}

/// The monitor. 0.9 KB.
#[derive(Debug)]
pub(super) struct Monitor {
    config: MonitorConfig,
    filter: UdFilter<STATE_COUNT>,
    adaptive_noise: Option<AdaptiveNoise>,
    innovation_gate: InnovationGate,
    has_strength_failed: bool,
    /// Largest measurement variance due to coefficient errors in the last sample.
    max_coefficient_variance: f32,
    /// Remaining time of increased hard-iron process noise, seconds.
    post_change_left_s: f32,
    coordinated_turn: CoordinatedTurn,
    acceleration_tilt: AccelerationTilt,
    hard_iron_detector: HardIronDetector,
    last_sample_at: Option<Timestamp>,
    gyro_run: Option<u8>,
    output: MonitorOutput,
}

impl Monitor {
    pub fn new(config: MonitorConfig) -> Self {
        Self {
            filter: UdFilter::new(&config.initial_sigmas),
            config,
            adaptive_noise: None,
            innovation_gate: InnovationGate::NONE,
            has_strength_failed: false,
            max_coefficient_variance: 0.0,
            post_change_left_s: 0.0,
            coordinated_turn: CoordinatedTurn::EMPTY,
            acceleration_tilt: AccelerationTilt::NEW,
            hard_iron_detector: HardIronDetector::NEW,
            last_sample_at: None,
            gyro_run: None,
            output: MonitorOutput::INITIAL,
        }
    }

    pub const fn config(&self) -> &MonitorConfig {
        &self.config
    }

    pub const fn output(&self) -> &MonitorOutput {
        &self.output
    }

    #[cfg(test)]
    pub fn set_validity(&mut self, verdict: Result<(), NoHeading>) {
        self.output.validity = verdict;
    }

    /// Processes a sample whose last reading was at `at`, with the gyro turn at the sample's own time.
    #[inline(never)]
    pub fn update(
        &mut self,
        monitored: &MonitoredCalibration<'_>,
        at: Timestamp,
        sample: &Sample,
        turning: Option<GyroHeading>,
    ) {
        let MonitoredCalibration { calibration, .. } = monitored;
        let field = calibration.corrected_body_field(sample).ut / calibration.total_ut;
        let motion = turning.map_or_else(EulerRates::default, |turning| turning.euler_rates);
        let seen =
            MonitorSample { field, attitude: sample.latency_compensated_attitude(calibration.latency_s), motion };
        if !seen.is_finite() || turning.is_some_and(|turning| !turning.relative_heading_rad.is_finite()) {
            return;
        }
        let step_s = self.last_sample_at.map_or(INITIAL_STEP_S, |last| at.us_since(last) as f32 * 1e-6);
        self.last_sample_at = Some(at);
        self.acceleration_tilt.update(seen.attitude, &seen.motion, step_s);
        self.predict(step_s);
        self.track_gyro_offset(&seen, turning, step_s);
        self.update_measurements(monitored, &seen, sample, turning, step_s);
        if !self.filter.is_finite() {
            // Unexpected; prevents NaN in all later results.
            self.reset();
            return;
        }
        self.update_output(monitored, &seen, turning.as_ref(), step_s);
    }

    /// Not inlined: a whole monitor is on the stack.
    #[inline(never)]
    fn reset(&mut self) {
        *self = Self::new(self.config);
    }

    fn predict(&mut self, step_s: f32) {
        let MonitorConfig {
            process_noise_per_s: mut process_noise,
            initial_sigmas: mut sigmas,
            post_change_sigma: unsettled_sigma,
            post_change_noise_per_s: unsettled_wander,
            ..
        } = self.config;
        self.post_change_left_s = (self.post_change_left_s - step_s).max(0.0);
        if self.post_change_left_s > 0.0 {
            process_noise[HARD_IRON_CHANGE..STRENGTH_CHANGE].fill(unsettled_wander);
            sigmas[HARD_IRON_CHANGE..STRENGTH_CHANGE].fill(unsettled_sigma);
        }
        for (i, (variance_per_s, sigma)) in process_noise.into_iter().zip(sigmas).enumerate() {
            if i == GYRO_OFFSET || self.filter.state_variance(i) < sigma * sigma {
                self.filter.inflate_variance(i, variance_per_s * step_s);
            }
        }
        self.filter.propagate(GYRO_OFFSET, GYRO_DRIFT, step_s);
        // Unobservable states must not accumulate a day of noise; a confirmed change of hard iron must persist.
        let decay = (1.0 - step_s / self.config.decay_time_s).max(0.0);
        if measurement_model::hard_iron_change(self.filter.mean()).length() < self.config.max_decaying_hard_iron {
            self.decay_estimates(HARD_IRON_CHANGE..STRENGTH_CHANGE, decay);
        }
        self.decay_estimates(ROLL_BIAS..STATE_COUNT, decay);
    }

    fn decay_estimates(&mut self, unknowns: Range<usize>, decay: f32) {
        for i in unknowns {
            let faded = decay * self.filter.mean()[i];
            self.filter.set_mean(i, faded);
        }
    }

    /// Re-initialises the gyro heading offset after a gap or a restart of the integration.
    fn track_gyro_offset(&mut self, seen: &MonitorSample, turning: Option<GyroHeading>, step_s: f32) {
        if let Some(turning) = turning.filter(|turning| self.gyro_run != Some(turning.run) || step_s > MAX_GAP_S) {
            let measured = seen.field - measurement_model::hard_iron_change(self.filter.mean());
            let attitude = measurement_model::correct_attitude(seen.attitude, &seen.motion, self.filter.mean());
            let heading_rad = attitude.level(Field::new(measured)).heading_rad();
            self.filter.set_mean(GYRO_OFFSET, wrap_pi(heading_rad - turning.relative_heading_rad));
            self.filter.inflate_variance(GYRO_OFFSET, UNKNOWN_ANGLE_VARIANCE_RAD2);
            self.coordinated_turn = CoordinatedTurn::EMPTY;
        }
        self.gyro_run = turning.map(|turning| turning.run);
    }

    #[inline(never)]
    fn update_measurements(
        &mut self,
        monitored: &MonitoredCalibration<'_>,
        seen: &MonitorSample,
        sample: &Sample,
        turning: Option<GyroHeading>,
        step_s: f32,
    ) {
        let MonitoredCalibration { calibration, uncertainty, .. } = monitored;
        let unknowns = *self.filter.mean();
        let expected = PredictedField::new(&unknowns, calibration.inclination_rad, turning.as_ref());
        let predicted = MeasurementModel::new(seen, &unknowns, &expected);
        let variances = self.adapt_strength_noise(monitored, &predicted, step_s);
        let x = (sample.field.ut - calibration.b_vector_ut()) / calibration.total_ut;
        self.max_coefficient_variance = predicted
            .field_jacobians()
            .map(|coefficient_row| uncertainty.variance_from_coefficients(&coefficient_row, &x))
            .into_iter()
            .fold(0.0, f32::max);
        let variance = |kind: usize, sample_variance: f32, by_field: Vector3<f32>| {
            let MonitorConfig {
                sample_variance_factors: times,
                variance_floors: floor,
                coefficient_variance_factor: coefficients_alike,
                ..
            } = self.config;
            let coefficients = uncertainty.variance_from_coefficients(&by_field, &x);
            times[kind] * sample_variance + floor[kind] + coefficients_alike * coefficients
        };
        let noise_correlation_factor = self
            .adaptive_noise
            .as_ref()
            .map_or(1.0, |noise| noise.correlated_noise_factor(&self.config.adaptive_noise));
        let strength = self.adaptive_noise.as_ref().map_or(0.0, AdaptiveNoise::strength_mean_square);
        let EulerRates { roll_rad_s, pitch_rad_s, .. } = seen.motion;
        let late_rad = self.config.attitude_jitter_s * trig::hypot(roll_rad_s, pitch_rad_s);
        let tilt_rad2 = noise_correlation_factor
            * (variances.tilt_rad2 + late_rad * late_rad + self.acceleration_tilt.variance_rad2());
        let tan_squared = predicted.tan_inclination * predicted.tan_inclination;
        let [by_strength, by_dip, by_heading] = predicted.field_jacobians();
        let measurements = [
            Some(predicted.strength_measurement(&expected, variance(0, strength, by_strength))),
            Some(predicted.inclination_measurement(&expected, variance(1, tilt_rad2, by_dip))),
            predicted.heading_measurement(&expected, seen, variance(2, tilt_rad2 * tan_squared, by_heading)),
        ];
        self.adapt_tilt_noise(monitored, measurements[1].as_ref(), step_s);
        if let (Some(noise), Some(strength)) = (&mut self.adaptive_noise, &measurements[0]) {
            noise.update_strength_residual(&self.config.adaptive_noise, strength.residual, step_s);
        }
        let deviations = array::from_fn(|kind| measurements[kind].as_ref().map(|m| self.innovation(m)));
        let verdict = self.innovation_gate.test_innovations(&self.config.innovation_gate, deviations, step_s);
        let is_usable_by_kind = match verdict {
            GateResult::Consistent { is_usable: is_usable_by_kind } => is_usable_by_kind,
            GateResult::ChangeDetected { exceeding_residuals: sizes } => {
                self.inflate_covariance(&predicted, sizes);
                [true; 3]
            }
        };
        for (measurement, _) in
            measurements.into_iter().zip(is_usable_by_kind).filter(|(_, is_usable_by_kind)| *is_usable_by_kind)
        {
            self.apply_measurement(measurement, &unknowns);
        }
        if turning.is_some() {
            let measured =
                self.coordinated_turn.integrate(seen.attitude, &seen.motion, step_s.min(MAX_GAP_S), self.filter.mean());
            self.apply_measurement(measured, &{ *self.filter.mean() });
        }
        let offset_rad = self.filter.mean()[GYRO_OFFSET];
        self.filter.set_mean(GYRO_OFFSET, wrap_pi(offset_rad));
    }

    fn adapt_strength_noise(
        &mut self,
        monitored: &MonitoredCalibration<'_>,
        predicted: &MeasurementModel,
        step_s: f32,
    ) -> SampleNoise {
        let own_noise = monitored.calibration_noise();
        let config = &self.config.adaptive_noise;
        let noise =
            self.adaptive_noise.get_or_insert_with(|| AdaptiveNoise::new(config, own_noise, predicted.strength));
        noise.update_strength_noise(config, own_noise, predicted.strength, step_s);
        noise.sample_noise(config, own_noise)
    }

    fn adapt_tilt_noise(
        &mut self,
        monitored: &MonitoredCalibration<'_>,
        inclination: Option<&Measurement<STATE_COUNT>>,
        step_s: f32,
    ) {
        if let (Some(noise), Some(inclination)) = (&mut self.adaptive_noise, inclination) {
            noise.update_tilt_noise(
                &self.config.adaptive_noise,
                monitored.calibration_noise(),
                inclination.residual,
                step_s,
            );
        }
    }

    fn innovation(&self, measurement: &Measurement<STATE_COUNT>) -> Innovation {
        let Measurement { jacobian: row, residual, variance } = measurement;
        Innovation { residual: *residual, variance: self.filter.projected_variance(row) + variance }
    }

    /// Updates with a measurement predicted at `predicted_with`; corrects its residual for updates since.
    #[inline(never)]
    fn apply_measurement(&mut self, measurement: Option<Measurement<STATE_COUNT>>, predicted_with: &StateVector) {
        let Some(mut measurement) = measurement else { return };
        let changes = self.filter.mean().iter().zip(predicted_with).map(|(now, then)| now - then);
        measurement.residual -= measurement.jacobian.iter().zip(changes).map(|(d, change)| d * change).sum::<f32>();
        self.filter.update(&measurement);
    }

    /// Inflates the covariance of states that can explain a detected change.
    fn inflate_covariance(&mut self, predicted: &MeasurementModel, [strength, inclination, heading]: PerKind<f32>) {
        let MonitorConfig {
            max_innovation: max_jump,
            max_tilt_innovation_rad: max_lean_rad,
            attitude_share: attitude_fraction,
            ..
        } = self.config;
        let cos_dip = 1.0 / sqrt(1.0 + predicted.tan_inclination * predicted.tan_inclination);
        // Field change across the horizontal component, relative to the field strength.
        let [strength, inclination, across] = [strength, inclination, heading * cos_dip].map(|size| size.min(max_jump));
        let field = strength.max(inclination);
        let hard_iron_sigma = field.max(across);
        for axis in 0..3 {
            self.filter.inflate_variance(HARD_IRON_CHANGE + axis, hard_iron_sigma * hard_iron_sigma);
        }
        self.filter.inflate_variance(STRENGTH_CHANGE, field * field);
        self.filter.inflate_variance(INCLINATION_CHANGE, field * field);
        // A heading error is `tan(inclination)` times the tilt. Lower bound for the magnetic equator.
        let sin_dip = (predicted.tan_inclination * cos_dip).abs().max(0.3);
        let tilt_rad = attitude_fraction * inclination.max(across / sin_dip).min(max_lean_rad);
        self.filter.inflate_variance(ROLL_BIAS, tilt_rad * tilt_rad);
        self.filter.inflate_variance(PITCH_BIAS, tilt_rad * tilt_rad);
        self.has_strength_failed |= strength > 0.0;
        self.post_change_left_s = self.config.post_change_s;
    }

    #[inline(never)]
    fn update_output(
        &mut self,
        monitored: &MonitoredCalibration<'_>,
        seen: &MonitorSample,
        turning: Option<&GyroHeading>,
        step_s: f32,
    ) {
        let unknowns = *self.filter.mean();
        let expected = PredictedField::new(&unknowns, monitored.calibration.inclination_rad, turning);
        let row = MeasurementModel::new(seen, &unknowns, &expected).heading_jacobian;
        let variance_rad2 = self.filter.projected_variance(&row);
        let is_silent = self.innovation_gate.is_withholding();
        self.has_strength_failed &= is_silent;
        let sigma = (0..3).map(|axis| sqrt(self.filter.state_variance(HARD_IRON_CHANGE + axis))).fold(0.0, f32::max);
        let change = measurement_model::hard_iron_change(&unknowns);
        // Without a detected change only coefficient errors remain, which the calibration's uncertainty contains.
        let is_settled = self.post_change_left_s <= 0.0 && change.length() < self.config.max_decaying_hard_iron;
        // Coefficient errors resemble hard iron.
        let is_sure = self.hard_iron_detector.update(
            &change,
            sqrt(sigma * sigma + self.max_coefficient_variance),
            is_silent,
            step_s,
        );
        let total_ut = monitored.calibration.total_ut;
        let own_noise = monitored.calibration_noise();
        self.output = MonitorOutput {
            states: unknowns,
            heading_variance_rad2: if is_settled { 0.0 } else { self.config.post_change_inflation * variance_rad2 },
            sample_noise: self.adaptive_noise.as_ref().map(|noise| {
                let SampleNoise { strength_variance: strength, tilt_rad2 } =
                    noise.sample_noise(&self.config.adaptive_noise, own_noise);
                SampleNoise {
                    strength_variance: strength,
                    tilt_rad2: tilt_rad2 + self.acceleration_tilt.variance_rad2(),
                }
            }),
            gyro_offset: self.gyro_run.map(|run| (run, self.filter.state_variance(GYRO_OFFSET))),
            validity: self.assess_validity(&unknowns, seen, &row, variance_rad2),
            hard_iron_change: is_sure
                .then(|| HardIronChange { change_ut: change * total_ut, sigma_ut: sigma * total_ut }),
        };
    }

    #[inline(never)]
    fn assess_validity(
        &self,
        unknowns: &StateVector,
        seen: &MonitorSample,
        row: &StateVector,
        variance_rad2: f32,
    ) -> Result<(), NoHeading> {
        let MonitorConfig {
            max_heading_sigma_rad: max_sigma_rad,
            max_strength_change: max_strength,
            max_inclination_change_rad: max_inclination_rad,
            ..
        } = self.config;
        let hard_iron_change = measurement_model::hard_iron_change(unknowns).length();
        let lean_rad = unknowns[ROLL_BIAS].abs().max(unknowns[PITCH_BIAS].abs());
        if hard_iron_change > self.config.max_hard_iron_change {
            return Err(NoHeading::FieldChanged);
        }
        if self.innovation_gate.is_withholding() {
            // A wrong attitude leaves the field strength unchanged.
            let tilt_rad = lean_rad.max((unknowns[BANK_SCALE_ERROR] * seen.attitude.roll_rad).abs());
            let is_attitude = !self.has_strength_failed && tilt_rad > hard_iron_change;
            return Err(if is_attitude { NoHeading::AttitudeContradicted } else { NoHeading::FieldDisturbed });
        }
        if unknowns[STRENGTH_CHANGE].abs() > max_strength || unknowns[INCLINATION_CHANGE].abs() > max_inclination_rad {
            return Err(NoHeading::FieldDisturbed);
        }
        if lean_rad > self.config.max_attitude_bias_rad
            || unknowns[BANK_SCALE_ERROR].abs() > self.config.max_bank_scale_error
        {
            return Err(NoHeading::AttitudeContradicted);
        }
        if variance_rad2 > max_sigma_rad * max_sigma_rad {
            let mut by_iron = *row;
            by_iron[ROLL_BIAS..=ATTITUDE_LATENCY].fill(0.0);
            let is_iron = self.filter.projected_variance(&by_iron) > variance_rad2 / 2.0;
            return Err(if is_iron { NoHeading::FieldChanged } else { NoHeading::AttitudeContradicted });
        }
        Ok(())
    }
}

impl MonitoredCalibration<'_> {
    fn calibration_noise(&self) -> SampleNoise {
        let HeadingUncertainty { sensor_sigma, attitude_sigma_rad, .. } = *self.uncertainty;
        SampleNoise {
            strength_variance: sensor_sigma * sensor_sigma / f32::from(self.readings_per_sample.max(1)),
            tilt_rad2: attitude_sigma_rad * attitude_sigma_rad,
        }
    }
}
