//! Likelihood of samples given coefficients: the statistical model of all methods.
//!
//! With `w = W (m - b)` in units of the field strength and `C` the rotation from body to level axes by the sample's
//! attitude. An attitude error rotates the measured vector but does not change its length, so there are two residuals
//! with independent noise:
//!
//! - norm residual `e_norm = |w| - 1`, variance of the sensor,
//! - inclination residual `e_incl = inclination(C w) - I`, variance of sensor and attitude.
//!
//! A given heading (compass swing) adds `e_heading = heading(C w) - given`. The unknowns are `W`, `b` (in
//! the form of the corrected mean field `d`) and `I`.
//!
//! The variances are re-estimated from the residuals. Equal weights, common in attitude-aided fits, give poor results,
//! because attitude errors are often ten times the sensor's. Huber's loss bounds the effect of gusts and power lines.

mod equations;
mod information_matrix;
mod linearised_problem;
mod noise;
mod parameters;
mod prediction;
mod priors;
pub(super) mod unknowns;

pub(super) use equations::{MeasuredSample, ResidualEquation, SampleEquations};
pub(crate) use information_matrix::InformationMatrix;
pub(super) use linearised_problem::LinearisedProblem;
pub(super) use noise::NoiseModel;
pub(super) use parameters::ModelParameters;
pub(crate) use prediction::FieldPrediction;
pub(super) use prediction::{heading_by_field, horizontal_squared};
pub(super) use priors::{PriorQuantity, for_each_prior};
pub(crate) use unknowns::JacobianRow;
pub(super) use unknowns::Vector13;

pub(super) use equations::CLIPPED_MEAN_SQUARE;
use nalgebra::{Matrix3, Vector3};
use unknowns::UNKNOWNS;

use super::starting_point::StartingPoint;
use super::{Calibration, MotorCurrentInterference, Orientation, Sample, Samples, SolveError, matrix_rows};
use crate::trig;
use crate::trig::sqrt;

/// Constants of the model.
#[derive(Clone, Copy, Debug)]
pub struct ModelConfig {
    /// Whether the samples' attitude is used; without it only norm residuals are.
    pub uses_attitude: bool,
    /// Soft iron, 1 sigma of an element of the symmetric part of `W`, relative: 30 %, a poor airframe.
    pub soft_iron_sigma: f32,
    /// Mounting, 1 sigma of an element of the skew part of `W`, radians: 20 deg.
    pub mounting_sigma: f32,
    /// Hard iron, 1 sigma, microtesla: three times the Earth's field.
    pub hard_iron_sigma_ut: f32,
    /// Known inclination, 1 sigma, radians: 1 deg, half of it the chart's error, the rest local anomalies.
    pub known_inclination_sigma_rad: f32,
    /// Given heading, 1 sigma, radians: 1 deg, a compass rose or a bearing compass.
    pub given_heading_sigma_rad: f32,
    /// Typical norm residual scale, counted as a few samples: a handful that fits by chance does not give a zero scale.
    pub typical_norm_sigma: f32,
    /// Typical inclination residual scale, radians.
    pub typical_inclination_sigma_rad: f32,
    /// Number of samples that the typical scales count as.
    pub typical_sigma_samples: f32,
    /// Minimum norm residual scale: quantisation and linearity of the chip.
    pub min_norm_sigma: f32,
    /// Minimum inclination residual scale, radians: 0.05 deg.
    pub min_inclination_sigma_rad: f32,
    /// Maximum norm residual scale of an accepted fit: ten times a poor sensor's.
    pub max_norm_sigma: f32,
    /// Maximum inclination residual scale of an accepted fit, radians: 5 deg.
    pub max_inclination_sigma_rad: f32,
    /// Huber threshold, sigmas: larger residuals count linearly.
    pub huber_sigmas: f32,
}

impl ModelConfig {
    /// Values for airframes and sensors of UAVs, with attitude.
    pub const DEFAULT: Self = Self {
        uses_attitude: true,
        soft_iron_sigma: 0.3,
        mounting_sigma: 0.35,
        hard_iron_sigma_ut: 150.0,
        known_inclination_sigma_rad: 0.0175,
        given_heading_sigma_rad: 0.0175,
        typical_norm_sigma: 0.004,
        typical_inclination_sigma_rad: 0.006,
        typical_sigma_samples: 4.0,
        min_norm_sigma: 0.0005,
        min_inclination_sigma_rad: 0.0009,
        max_norm_sigma: 0.05,
        max_inclination_sigma_rad: 0.087,
        huber_sigmas: 2.0,
    };

    /// For samples that do not determine the mounting: fixed to the configured one within half a degree.
    pub const FIXED_MOUNTING: Self = Self { mounting_sigma: 0.009, ..Self::DEFAULT };

    /// For tumbling on a bench, without attitude.
    pub const NO_ATTITUDE: Self = Self { uses_attitude: false, ..Self::FIXED_MOUNTING };
}

/// Prior knowledge of a calibration.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Prior {
    /// Mounting of the sensor.
    pub mount: Orientation,
    /// Inclination of the local Earth field, radians, positive down, if known.
    pub inclination_rad: Option<f32>,
    /// Number of sensor readings averaged in each sample.
    pub readings_per_sample: u16,
}

/// Sensor aligned with the body, unknown field, single readings.
impl Default for Prior {
    fn default() -> Self {
        Self { mount: Orientation::NONE, inclination_rad: None, readings_per_sample: 1 }
    }
}

#[derive(Clone, Debug)]
pub(super) struct Likelihood {
    pub config: ModelConfig,
    pub known_inclination_rad: Option<f32>,
    pub readings_per_sample: u16,
    /// Configured mounting rotation, chip to mount axes. The model works in mount axes, nominally the body axes.
    pub mount_from_chip: Matrix3<f32>,
    /// Unit of field, microtesla.
    pub unit_ut: f32,
    /// Mean of all samples, mount axes, units of field.
    pub mean_field: Vector3<f32>,
    pub noise: NoiseModel,
    /// Whether the noise has been estimated.
    pub has_noise_estimate: bool,
    pub latency_s: f32,
    pub motor_current: MotorCurrentInterference,
    /// Only every n-th sample is used far from the solution.
    pub sample_stride: usize,
    /// Whether equations are summed instead of rotated into a triangle.
    pub uses_normal_equations: bool,
}

/// Number of samples that suffices far from the solution.
const COARSE_SAMPLES: usize = 128;

impl Likelihood {
    pub fn new(prior: &Prior, config: ModelConfig, samples: Samples<'_>, unit_ut: f32) -> Self {
        let rotation = prior.mount.body_from_sensor();
        let sum_ut = samples.all().map(|s| s.field.ut).sum::<Vector3<f32>>();
        let number = samples.all().count();
        Self {
            config,
            known_inclination_rad: prior.inclination_rad,
            readings_per_sample: prior.readings_per_sample,
            mount_from_chip: rotation,
            unit_ut,
            mean_field: rotation * sum_ut / (number.max(1) as f32 * unit_ut),
            noise: NoiseModel::INITIAL,
            has_noise_estimate: false,
            latency_s: 0.0,
            motor_current: MotorCurrentInterference::from_samples(samples),
            sample_stride: (number / COARSE_SAMPLES).max(1),
            uses_normal_equations: number > COARSE_SAMPLES,
        }
    }

    pub fn for_each_sample_equations(
        &self,
        samples: Samples<'_>,
        parameters: &ModelParameters,
        each: &mut dyn FnMut(&SampleEquations),
    ) {
        let mut one =
            |sample: &Sample, heading_rad: Option<f32>| each(&self.equations(sample, heading_rad, parameters));
        samples.iter().step_by(self.sample_stride).for_each(|sample| one(sample, None));
        samples.marks.iter().for_each(|mark| one(&mark.sample, Some(mark.heading_rad)));
    }

    pub fn equations(
        &self,
        sample: &Sample,
        heading_rad: Option<f32>,
        parameters: &ModelParameters,
    ) -> SampleEquations {
        let attitude = sample.latency_compensated_attitude(self.latency_s);
        let added_ut = Vector3::from(self.motor_current.ut_per_a) * self.motor_current.current_offset_a(sample);
        let measured = MeasuredSample {
            x: self.mount_from_chip * (sample.field.ut - added_ut) / self.unit_ut - self.mean_field,
            tilt: attitude.tilt(),
            roll_rad: attitude.roll_rad,
            rates: sample.rates,
            heading_rad,
        };
        SampleEquations::new(parameters, &measured, &self.noise, &self.config, self.has_noise_estimate)
    }

    pub fn unknowns_from_start(&self, start: &StartingPoint) -> Option<Vector13> {
        ModelParameters { w: start.w, d: start.w * (self.mean_field - start.b), inclination_rad: start.inclination_rad }
            .unknowns()
    }

    /// Starting point with these unknowns; `None` when `W` is singular.
    pub fn starting_point(&self, unknowns: &Vector13) -> Option<StartingPoint> {
        let parameters = ModelParameters::new(unknowns);
        let b = self.mean_field - parameters.mean_minus_hard_iron()?;
        Some(StartingPoint { unit_ut: self.unit_ut, w: parameters.w, b, inclination_rad: parameters.inclination_rad })
    }

    pub fn linearise(&self, samples: Samples<'_>, unknowns: &Vector13) -> LinearisedProblem {
        LinearisedProblem::linearise(self, samples, unknowns)
    }

    pub fn motor_current_per_ampere(&self) -> Vector3<f32> {
        self.mount_from_chip * Vector3::from(self.motor_current.ut_per_a) / self.unit_ut
    }

    pub fn estimate_noise(&mut self, system: &LinearisedProblem, unknowns: &Vector13) {
        // Degrees of freedom: half of the thirteen unknowns for each kind of residual.
        let freedom = (f32::from(system.samples) - UNKNOWNS as f32 / 2.0).max(1.0);
        let ModelConfig {
            typical_norm_sigma: usual_norm_sigma,
            typical_inclination_sigma_rad: usual_dip_sigma_rad,
            typical_sigma_samples: usual_weight,
            ..
        } = self.config;
        let estimate = |sum: f32, before: f32, usual: f32| {
            let squares = sum / CLIPPED_MEAN_SQUARE * before * before + usual_weight * usual * usual;
            sqrt(squares / (freedom + usual_weight))
        };
        let [norm, dip] = system.clipped_squares;
        let norm = estimate(norm, self.noise.norm, usual_norm_sigma);
        let dip = estimate(dip, self.noise.inclination_sigma_rad, usual_dip_sigma_rad);
        self.noise = NoiseModel::new(
            norm.max(self.config.min_norm_sigma),
            dip.max(self.config.min_inclination_sigma_rad),
            ModelParameters::new(unknowns).w,
        );
        // The first noise estimate uses half of the samples if there are many.
        self.sample_stride = if self.has_noise_estimate { 1 } else { (self.sample_stride / 2).clamp(1, 2) };
        self.has_noise_estimate = true;
    }

    pub fn is_acceptable_fit(&self) -> bool {
        self.noise.norm <= self.config.max_norm_sigma
            && self.noise.inclination_sigma_rad <= self.config.max_inclination_sigma_rad
    }

    pub fn calibration(&self, unknowns: &Vector13) -> Result<Calibration, SolveError> {
        let parameters = ModelParameters::new(unknowns);
        let determinant = parameters.w.determinant();
        if !determinant.is_finite() || determinant <= 0.0 {
            return Err(SolveError::NotConverged);
        }
        let b = self.mean_field - parameters.mean_minus_hard_iron().ok_or(SolveError::NotConverged)?;
        let per_unit = trig::reciprocal_cbrt(determinant);
        Ok(Calibration {
            w: matrix_rows(&(parameters.w * per_unit * self.mount_from_chip)),
            b_ut: (self.mount_from_chip.tr_mul(&b) * self.unit_ut - self.motor_current.interference_ut(None)).into(),
            inclination_rad: parameters.inclination_rad,
            total_ut: self.unit_ut * per_unit,
            latency_s: self.latency_s,
            motor_current: self.motor_current,
        })
    }
}
