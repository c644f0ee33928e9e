//! Attitude from gyro and accelerometer: roll, pitch and body rates with their covariance. A pure value.
//!
//! The gyro's rates are integrated to a quaternion, and the rotated specific force to a velocity. Both drift with the
//! errors of the attitude, and an error-state Kalman filter (`error_filter.rs`) estimates these errors from a
//! pseudo-measurement: the velocity is that of the reference, zero or the known speed along the nose. How accurately,
//! follows from the size of its deviations (`velocity_noise.rs`): gravity counts as far as the movements allow, over the
//! time for which the gyro holds the attitude. A second-order low-pass of the specific force in a frame that does not
//! rotate, as in VQF (D. Laidig, T. Seel, "VQF: Highly accurate IMU orientation estimation with bias estimation and
//! magnetic disturbance rejection", Information Fusion 91, 2023), is this filter with constant gains; here the gains
//! follow from the noise, and so does the covariance. At rest the mean rates measure the gyro's offset.
//!
//! The navigation frame is horizontal, and its direction is arbitrary: the filter has no yaw.

mod attitude_estimate;
mod error_filter;
mod quaternion;
mod rest_detector;
mod sample;
mod sensor_errors;
mod velocity_noise;

use nalgebra::{Matrix3, UnitQuaternion, Vector3};

use crate::time::Timestamp;
use crate::trig::{DEG, hypot, sqrt, square};
pub use attitude_estimate::InertialAttitude;
use error_filter::{ErrorFilter, ErrorVariances, StepIntegrals};
use quaternion::{levelling_rotation, rotated_in_navigation};
pub(crate) use quaternion::{normalised, roll_and_pitch_of_down, rotated_in_body};
use rest_detector::RestDetector;
pub use sample::{GRAVITY_M_S2, InertialSample};
pub use sensor_errors::{GYRO_CROSS_AXIS, InertialSensorErrors, SensorOffsets};
use velocity_noise::VelocityNoise;

/// Duration of a step of the error filter, seconds: half of the time in which a fast turn of 1000 deg/s ends.
const ERROR_STEP_S: f32 = 0.03;

/// Longest interval between two samples, microseconds; after a longer one the filter starts again.
const MAX_GAP_US: u64 = 100_000;

/// Smallest specific force that shows a direction at the start, m/s^2.
const MIN_START_FORCE_M_S2: f32 = 0.3 * GRAVITY_M_S2;

/// Error of the tilt by the first specific force, rad: a hand's acceleration of 0.3 g.
const START_TILT_SIGMA_RAD: f32 = 0.3;

/// Error of the velocity at the start, m/s: a hand's.
const START_VELOCITY_SIGMA_M_S: f32 = 0.5;

/// Deviation of the velocity from its reference that only a wrong tilt explains, m/s: a fast aeroplane of 50 m/s that reverses its
/// direction. With 40 m/s aeroplanes of 22 m/s started again in their turns, with a level attitude in the bank.
const MAX_VELOCITY_DEVIATION_M_S: f32 = 100.0;

/// Angle random walk, rad/sqrt(s): four times the noise density of a MEMS gyro, for vibration.
const ANGLE_RANDOM_WALK: f32 = 0.02 * DEG;

/// Time for which an error relative to rate or force keeps its sign, seconds: that of a movement.
const MOVEMENT_S: f32 = 0.5;

/// Random walk of the gyro's offset, rad/s/sqrt(s): 0.1 deg/s in 40 minutes, a warm-up by 2 K.
const GYRO_OFFSET_RANDOM_WALK: f32 = 0.002 * DEG;

/// Velocity random walk, m/s/sqrt(s): three times the noise density of a MEMS accelerometer.
const VELOCITY_RANDOM_WALK: f32 = 0.003;

/// Error of the acceleration by scale and cross-axis sensitivity, relative.
const ACCELEROMETER_SCALE: f32 = 0.01;

/// Random walk of the accelerometer's offset, m/s^2/sqrt(s): 0.5 mg in 40 minutes.
const ACCELEROMETER_OFFSET_RANDOM_WALK: f32 = 1e-4;

/// Noise of the mean rates at rest, as a density, rad/s*sqrt(s): the angle random walk.
const REST_RATE_DENSITY: f32 = ANGLE_RANDOM_WALK;

/// Variance of the offset at a rest, of the mean rates of a second, (rad/s)^2.
const REST_OFFSET_VARIANCE: f32 = REST_RATE_DENSITY * REST_RATE_DENSITY;

/// Steadiest turn that could be rest, rad/s. Beyond it and the offset's uncertainty the mean rates are no offset.
const MAX_OFFSET_CHANGE_RAD_S: f32 = 0.5 * DEG;

/// Horizontal direction of a vector as a unit vector; that of the x axis of a vertical one.
fn horizontal_direction(vector: &Vector3<f32>) -> Vector3<f32> {
    let length = hypot(vector.x, vector.y);
    if length > 0.0 { Vector3::new(vector.x / length, vector.y / length, 0.0) } else { Vector3::x() }
}

/// Change of the gyro's offset between two rests, rad/s: 13 K (LSM6DSL's data sheet).
const MAX_REST_OFFSET_CHANGE_RAD_S: f32 = 0.2 * DEG;

/// Largest sigma of the tilt of a sample, rad: after a rest, and before one. A start in motion leaves an error for long, movements after
/// a rest for moments: with 1.5 deg after a rest, a seventh of the calibrations by hand had too few samples.
const MAX_SAMPLE_TILT_SIGMA_RAD: f32 = 2.0 * DEG;
const MAX_SAMPLE_TILT_SIGMA_BEFORE_REST_RAD: f32 = 1.5 * DEG;

/// Largest sigma of a sample's tilt by the accelerometer's offset, rad: turns make the offset known, which tilts by 3 deg before. After a
/// restart with an earlier estimate it is 0.81 deg. Of the aeroplanes without a known speed 2 % have too few samples, with 1.1 deg 8 %,
/// with 0.85 deg most.
const MAX_SAMPLE_OFFSET_SIGMA_RAD: f32 = 1.25 * DEG;

/// Sums over the samples of a step of the error filter.
#[derive(Clone, Debug)]
struct StepSums {
    duration_s: f32,
    integrals: StepIntegrals,
    /// Integrals of the squared rate, rad^2/s, and of the squared acceleration, m^2/s^3.
    squared_rate: f32,
    squared_acceleration: f32,
}

impl StepSums {
    fn new() -> Self {
        let integrals = StepIntegrals {
            rotation_s: Matrix3::zeros(),
            rotated_rates_rad: Matrix3::zeros(),
            force_m_s: Vector3::zeros(),
            known_velocity_m_s: None,
        };
        Self { duration_s: 0.0, integrals, squared_rate: 0.0, squared_acceleration: 0.0 }
    }

    /// Process noise of the step. No state describes the gyro's cross-axis sensitivity.
    fn process_noise(&self, gyro_cross_axis: f32) -> ErrorVariances {
        let step_s = self.duration_s;
        ErrorVariances {
            tilt: square(ANGLE_RANDOM_WALK) * step_s + square(gyro_cross_axis) * MOVEMENT_S * self.squared_rate,
            gyro_offset: square(GYRO_OFFSET_RANDOM_WALK) * step_s,
            velocity: square(VELOCITY_RANDOM_WALK) * step_s
                + square(ACCELEROMETER_SCALE) * MOVEMENT_S * self.squared_acceleration,
            accelerometer_offset: square(ACCELEROMETER_OFFSET_RANDOM_WALK) * step_s,
            gyro_scale: 0.0,
        }
    }
}

/// Error filter at the start, for a sensor with these errors and the offsets of an earlier estimate.
fn new_error_filter(sensor_errors: &InertialSensorErrors, offsets: &SensorOffsets) -> ErrorFilter {
    let (gyro_offset_variances, accelerometer_offset) = offsets.variances(sensor_errors);
    let mut error_filter = ErrorFilter::new(&ErrorVariances {
        tilt: square(START_TILT_SIGMA_RAD),
        gyro_offset: 0.0,
        velocity: square(START_VELOCITY_SIGMA_M_S),
        accelerometer_offset,
        gyro_scale: square(sensor_errors.gyro_scale),
    });
    error_filter.reset_gyro_offset(gyro_offset_variances);
    error_filter
}

/// Measurements of a step, one after the other.
#[derive(Clone, Copy, Debug)]
enum Measurement {
    Velocity,
    GyroOffset,
}

/// Attitude filter of an inertial sensor. About 1.2 KB.
#[derive(Clone, Debug)]
pub struct AttitudeFilter {
    sensor_errors: InertialSensorErrors,
    start_count: u8,
    /// Time of the last sample and rotation from body to navigation frame; `None` before the first sample.
    attitude: Option<(Timestamp, UnitQuaternion<f32>)>,
    rates_rad_s: Vector3<f32>,
    velocity_m_s: Vector3<f32>,
    is_speed_known: bool,
    gyro_offset_rad_s: Vector3<f32>,
    /// Rates at the last rest; `None` before the first one.
    rest_offset_rad_s: Option<Vector3<f32>>,
    rest_offset_variance: f32,
    /// Rates less those of the last rest.
    measured_rates_rad_s: Option<Vector3<f32>>,
    gyro_scale: Vector3<f32>,
    accelerometer_offset_m_s2: Vector3<f32>,
    error_filter: ErrorFilter,
    velocity_noise: VelocityNoise,
    rest_detector: RestDetector,
    step: StepSums,
    /// Next measurement of the last step, and the step's duration, seconds.
    due_measurement: Option<(Measurement, f32)>,
}

impl AttitudeFilter {
    /// A filter for a sensor with these errors, and the offsets of an earlier estimate.
    #[must_use]
    pub fn new(sensor_errors: InertialSensorErrors, offsets: SensorOffsets) -> Self {
        Self {
            sensor_errors,
            start_count: 0,
            attitude: None,
            rates_rad_s: Vector3::zeros(),
            velocity_m_s: Vector3::zeros(),
            is_speed_known: false,
            gyro_offset_rad_s: offsets.gyro_rad_s.into(),
            rest_offset_rad_s: None,
            rest_offset_variance: 0.0,
            measured_rates_rad_s: None,
            gyro_scale: Vector3::zeros(),
            accelerometer_offset_m_s2: offsets.accelerometer_m_s2.into(),
            error_filter: new_error_filter(&sensor_errors, &offsets),
            velocity_noise: VelocityNoise::new(offsets.movement_m_s),
            rest_detector: RestDetector::INITIAL,
            step: StepSums::new(),
            due_measurement: None,
        }
    }

    /// Processes the sample taken at `at`. `speed_m_s` is the speed along the nose, if it is known. A sample that is
    /// not finite is ignored.
    #[inline(never)]
    pub fn update(&mut self, at: Timestamp, sample: &InertialSample, speed_m_s: Option<f32>) {
        if !sample.is_finite() {
            return;
        }
        match self.attitude {
            Some((updated_at, attitude)) if (1..=MAX_GAP_US).contains(&at.us_since(updated_at)) => {
                let step_s = at.us_since(updated_at) as f32 * 1e-6;
                self.attitude = Some((at, self.integrate_sample(&attitude, sample, step_s)));
                self.rest_detector.update(sample, speed_m_s, step_s);
                self.advance_step(speed_m_s);
            }
            _ => self.start_at(at, sample),
        }
    }

    /// Starts with the tilt of a specific force. The estimated errors of the sensor remain.
    fn start_at(&mut self, at: Timestamp, sample: &InertialSample) {
        self.start_count = self.start_count.wrapping_add(1);
        self.attitude = None;
        self.velocity_m_s = Vector3::zeros();
        self.is_speed_known = false;
        self.error_filter.reset_tilt(square(START_TILT_SIGMA_RAD));
        self.error_filter.reset_velocity(square(START_VELOCITY_SIGMA_M_S));
        self.velocity_noise = VelocityNoise::new(self.velocity_noise.movement_m_s());
        self.rest_detector = RestDetector::INITIAL;
        self.step = StepSums::new();
        self.due_measurement = None;
        if sample.specific_force_m_s2.norm_squared() >= square(MIN_START_FORCE_M_S2) {
            self.attitude = Some((at, levelling_rotation(&sample.specific_force_m_s2)));
        }
    }

    /// Integrates rates and specific force; returns the new attitude.
    fn integrate_sample(
        &mut self,
        attitude: &UnitQuaternion<f32>,
        sample: &InertialSample,
        step_s: f32,
    ) -> UnitQuaternion<f32> {
        self.rest_offset_variance += square(GYRO_OFFSET_RANDOM_WALK) * step_s;
        self.measured_rates_rad_s = self.rest_offset_rad_s.map(|offset_rad_s| sample.rates_rad_s - offset_rad_s);
        let offset_free = sample.rates_rad_s - self.gyro_offset_rad_s;
        self.rates_rad_s = offset_free - offset_free.component_mul(&self.gyro_scale);
        let attitude = rotated_in_body(attitude, &(self.rates_rad_s * step_s));
        let rotation_s = attitude.to_rotation_matrix().into_inner() * step_s;
        let force_m_s = rotation_s * (sample.specific_force_m_s2 - self.accelerometer_offset_m_s2);
        let gained_m_s = force_m_s + Vector3::new(0.0, 0.0, GRAVITY_M_S2 * step_s);
        self.velocity_m_s += gained_m_s;
        let step = &mut self.step;
        step.duration_s += step_s;
        step.integrals.rotation_s += rotation_s;
        step.integrals.rotated_rates_rad += rotation_s * Matrix3::from_diagonal(&self.rates_rad_s);
        step.integrals.force_m_s += force_m_s;
        step.squared_rate += self.rates_rad_s.norm_squared() * step_s;
        step.squared_acceleration += gained_m_s.norm_squared() / step_s;
        attitude
    }

    /// Performs one part of a step of the error filter, so that no update takes long.
    fn advance_step(&mut self, speed_m_s: Option<f32>) {
        match self.due_measurement.take() {
            Some((Measurement::Velocity, step_s)) => {
                self.measure_velocity(speed_m_s, step_s);
                self.due_measurement = Some((Measurement::GyroOffset, step_s));
            }
            Some((Measurement::GyroOffset, step_s)) => {
                if let Some(change) = self.offset_change_at_rest() {
                    self.update_rest_offset(self.gyro_offset_rad_s + change);
                    self.error_filter.measure_gyro_offset(&change, square(REST_RATE_DENSITY) / step_s);
                    self.apply_corrections();
                }
            }
            None if self.step.duration_s >= ERROR_STEP_S => {
                let mut step = core::mem::replace(&mut self.step, StepSums::new());
                step.integrals.known_velocity_m_s =
                    self.is_speed_known.then_some([self.velocity_m_s.x, self.velocity_m_s.y]);
                self.error_filter.propagate(&step.integrals, &step.process_noise(self.sensor_errors.gyro_cross_axis));
                self.due_measurement = Some((Measurement::Velocity, step.duration_s));
            }
            None => {}
        }
    }

    /// Takes the rates at rest as the gyro's offset, unless they differ so much from those of an earlier rest that this one may be a
    /// steady turn.
    fn update_rest_offset(&mut self, rates_rad_s: Vector3<f32>) {
        let is_steady_turn = |earlier: Vector3<f32>| (rates_rad_s - earlier).amax() > MAX_REST_OFFSET_CHANGE_RAD_S;
        if !self.rest_offset_rad_s.is_some_and(is_steady_turn) {
            self.rest_offset_rad_s = Some(rates_rad_s);
            self.rest_offset_variance = REST_OFFSET_VARIANCE;
        }
    }

    /// Measures the velocity as that of its reference.
    #[inline(never)]
    fn measure_velocity(&mut self, speed_m_s: Option<f32>, step_s: f32) {
        let Some((_, attitude)) = self.attitude else { return };
        let reference_m_s = speed_m_s
            .map_or_else(Vector3::zeros, |speed_m_s| horizontal_direction(&(attitude * Vector3::x())) * speed_m_s);
        if speed_m_s.is_some() != self.is_speed_known {
            self.is_speed_known = speed_m_s.is_some();
            self.velocity_m_s = reference_m_s;
            self.error_filter.reset_velocity(square(START_VELOCITY_SIGMA_M_S));
        }
        let deviation_m_s = self.velocity_m_s - reference_m_s;
        if deviation_m_s.norm_squared() > square(MAX_VELOCITY_DEVIATION_M_S) {
            // The next sample starts the filter again; a wrong vertical gave wrong errors of the sensor.
            self.error_filter = new_error_filter(&self.sensor_errors, &SensorOffsets::UNKNOWN);
            self.attitude = None;
            return;
        }
        let is_at_rest = self.offset_change_at_rest().is_some();
        let explained_variance = self.error_filter.velocity_variance();
        let variance = self.velocity_noise.measurement_variance(
            &deviation_m_s,
            explained_variance,
            is_at_rest,
            self.is_speed_known,
            step_s,
        );
        self.error_filter.measure_velocity(&-deviation_m_s, variance);
        if self.error_filter.tilt_covariance().trace() <= square(MAX_SAMPLE_TILT_SIGMA_RAD) {
            self.velocity_noise.record_movement();
        }
        self.apply_corrections();
    }

    /// Corrects the estimates by the estimated errors.
    fn apply_corrections(&mut self) {
        let corrections = self.error_filter.take_corrections();
        self.attitude =
            self.attitude.map(|(at, attitude)| (at, rotated_in_navigation(&attitude, &corrections.tilt_rad)));
        self.velocity_m_s += corrections.velocity_m_s;
        self.gyro_offset_rad_s += corrections.gyro_offset_rad_s;
        self.accelerometer_offset_m_s2 += corrections.accelerometer_offset_m_s2;
        self.gyro_scale += corrections.gyro_scale;
    }

    /// Mean rates at rest less the estimated offset, rad/s; `None` in motion and in a steady turn.
    fn offset_change_at_rest(&self) -> Option<Vector3<f32>> {
        let change = self.rest_detector.rates_at_rest()? - self.gyro_offset_rad_s;
        let variances = self.error_filter.gyro_offset_variance();
        let is_offset = |(change, variance): (&f32, &f32)| {
            square(*change) <= square(MAX_OFFSET_CHANGE_RAD_S) + square(3.0) * variance
        };
        change.iter().zip(&variances).all(is_offset).then_some(change)
    }

    /// Attitude at the last sample; `None` before the first one.
    #[must_use]
    pub fn attitude(&self) -> Option<InertialAttitude> {
        let (_, rotation) = self.attitude?;
        let covariance = self.error_filter.tilt_covariance();
        let has_rested = self.rest_offset_rad_s.is_some();
        let max_tilt_sigma_rad =
            if has_rested { MAX_SAMPLE_TILT_SIGMA_RAD } else { MAX_SAMPLE_TILT_SIGMA_BEFORE_REST_RAD };
        let offset_tilt_variance = self.error_filter.horizontal_offset_variance() / square(GRAVITY_M_S2);
        Some(InertialAttitude::new(
            &rotation,
            (self.rates_rad_s, self.measured_rates_rad_s),
            self.rest_offset_variance,
            self.start_count,
            &covariance,
            covariance.trace() <= square(max_tilt_sigma_rad)
                && offset_tilt_variance <= square(MAX_SAMPLE_OFFSET_SIGMA_RAD),
        ))
    }

    /// Estimated offsets of the sensor, at its present temperature.
    #[must_use]
    pub fn sensor_offsets(&self, temperature_c: f32) -> SensorOffsets {
        SensorOffsets {
            gyro_rad_s: self.gyro_offset_rad_s.into(),
            gyro_sigma_rad_s: self.error_filter.gyro_offset_variance().map(|variance| sqrt(variance.max(0.0))).into(),
            accelerometer_m_s2: self.accelerometer_offset_m_s2.into(),
            temperature_c,
            movement_m_s: self.velocity_noise.movement_m_s(),
        }
    }

    /// Whether the sensor is at rest.
    #[must_use]
    pub fn is_at_rest(&self) -> bool {
        self.rest_detector.rates_at_rest().is_some()
    }
}

#[cfg(test)]
mod tests;
