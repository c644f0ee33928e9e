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

use nalgebra::{Matrix3, Vector3};

use super::equations::{CLIPPED_MEAN_SQUARE, MeasuredSample, SampleEquations};
use super::noise::{ModelConfig, NoiseModel};
use super::prediction::ModelParameters;
use super::unknowns::{UNKNOWN_COUNT, Vector13};
use crate::calibration::closed_form::starting_point::StartingPoint;
use crate::calibration::linear_algebra::{matrix_rows, multiply};
use crate::calibration::types::coefficients::{Calibration, MotorCurrentInterference, Prior};
use crate::calibration::types::quality::SolveError;
use crate::calibration::types::samples::{Sample, Samples};
use crate::trig;
use crate::trig::sqrt;

#[derive(Clone, Debug)]
pub(in crate::calibration) struct Likelihood {
    pub config: ModelConfig,
    pub known_inclination_rad: Option<f32>,
    pub readings_per_sample: u16,
    /// Configured mounting rotation, chip to mount axes. The model works in mount axes, nominally the body axes.
    pub mount_from_chip: Matrix3<f32>,
    /// Unit of field, microtesla.
    pub field_unit_ut: f32,
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
const COARSE_SAMPLE_COUNT: usize = 128;

impl Likelihood {
    pub fn new(prior: &Prior, config: ModelConfig, samples: Samples<'_>, field_unit_ut: f32) -> Self {
        let rotation = prior.mount.body_from_sensor();
        let sum_ut = samples.all_samples().map(|sample| sample.field.ut).sum::<Vector3<f32>>();
        let sample_count = samples.all_samples().count();
        Self {
            config,
            known_inclination_rad: prior.inclination_rad,
            readings_per_sample: prior.readings_per_sample,
            mount_from_chip: rotation,
            field_unit_ut,
            mean_field: rotation * sum_ut / (sample_count.max(1) as f32 * field_unit_ut),
            noise: NoiseModel::INITIAL,
            has_noise_estimate: false,
            latency_s: 0.0,
            motor_current: MotorCurrentInterference::from_samples(samples),
            sample_stride: (sample_count / COARSE_SAMPLE_COUNT).max(1),
            uses_normal_equations: sample_count > COARSE_SAMPLE_COUNT,
        }
    }

    pub fn for_each_sample_equations(
        &self,
        samples: Samples<'_>,
        parameters: &ModelParameters,
        visit: &mut dyn FnMut(&SampleEquations),
    ) {
        let mut visit_sample =
            |sample: &Sample, heading_rad: Option<f32>| visit(&self.sample_equations(sample, heading_rad, parameters));
        samples.iter().step_by(self.sample_stride).for_each(|sample| visit_sample(sample, None));
        samples.marks.iter().for_each(|mark| visit_sample(&mark.sample, Some(mark.heading_rad)));
    }

    #[inline]
    pub fn sample_equations(
        &self,
        sample: &Sample,
        heading_rad: Option<f32>,
        parameters: &ModelParameters,
    ) -> SampleEquations {
        let added_ut = Vector3::from(self.motor_current.ut_per_a) * self.motor_current.current_deviation_a(sample);
        let measured = MeasuredSample {
            centred_field: multiply(&self.mount_from_chip, &(sample.field.ut - added_ut)) / self.field_unit_ut
                - self.mean_field,
            tilt_rotation: sample.latency_compensated_attitude(self.latency_s).tilt_rotation(),
            heading_rad,
        };
        SampleEquations::new(parameters, &measured, &self.noise, &self.config, self.has_noise_estimate)
    }

    pub fn unknowns_from_start(&self, start: &StartingPoint) -> Option<Vector13> {
        ModelParameters {
            w: start.w,
            corrected_mean_field: start.w * (self.mean_field - start.hard_iron),
            inclination_rad: start.inclination_rad,
        }
        .unknowns()
    }

    /// Starting point with these unknowns; `None` when `W` is singular.
    pub fn starting_point(&self, unknowns: &Vector13) -> Option<StartingPoint> {
        let parameters = ModelParameters::from_unknowns(unknowns);
        let b = self.mean_field - parameters.mean_minus_hard_iron()?;
        Some(StartingPoint {
            field_unit_ut: self.field_unit_ut,
            w: parameters.w,
            hard_iron: b,
            inclination_rad: parameters.inclination_rad,
        })
    }

    pub fn interference_per_ampere(&self) -> Vector3<f32> {
        self.mount_from_chip * Vector3::from(self.motor_current.ut_per_a) / self.field_unit_ut
    }

    /// Estimates the noise from the sums of the clipped squared normalised residuals.
    pub fn estimate_noise(&mut self, clipped_squares: [f32; 2], sample_count: u16, unknowns: &Vector13) {
        // Degrees of freedom: half of the thirteen unknowns for each kind of residual.
        let degrees_of_freedom = (f32::from(sample_count) - UNKNOWN_COUNT as f32 / 2.0).max(1.0);
        let ModelConfig { typical_norm_sigma, typical_inclination_sigma_rad, typical_sigma_sample_weight, .. } =
            self.config;
        let estimate = |sum: f32, old_sigma: f32, typical_sigma: f32| {
            let squares = sum / CLIPPED_MEAN_SQUARE * old_sigma * old_sigma
                + typical_sigma_sample_weight * typical_sigma * typical_sigma;
            sqrt(squares / (degrees_of_freedom + typical_sigma_sample_weight))
        };
        let [norm, inclination] = clipped_squares;
        let norm = estimate(norm, self.noise.norm_sigma, typical_norm_sigma);
        let inclination = estimate(inclination, self.noise.inclination_sigma_rad, typical_inclination_sigma_rad);
        self.noise = NoiseModel::new(
            norm.max(self.config.min_norm_sigma),
            inclination.max(self.config.min_inclination_sigma_rad),
            ModelParameters::from_unknowns(unknowns).w,
        );
        // The first noise estimate uses half of the samples if there are many.
        self.sample_stride = if self.has_noise_estimate { 1 } else { (self.sample_stride / 2).clamp(1, 2) };
        self.has_noise_estimate = true;
    }

    pub fn is_acceptable_fit(&self) -> bool {
        self.noise.norm_sigma <= self.config.max_norm_sigma
            && self.noise.inclination_sigma_rad <= self.config.max_inclination_sigma_rad
    }

    pub fn calibration(&self, unknowns: &Vector13) -> Result<Calibration, SolveError> {
        let parameters = ModelParameters::from_unknowns(unknowns);
        let determinant = parameters.w.determinant();
        if !determinant.is_finite() || determinant <= 0.0 {
            return Err(SolveError::NotConverged);
        }
        let b = self.mean_field - parameters.mean_minus_hard_iron().ok_or(SolveError::NotConverged)?;
        let per_unit = trig::reciprocal_cbrt(determinant);
        Ok(Calibration {
            w: matrix_rows(&(parameters.w * per_unit * self.mount_from_chip)),
            b_ut: (self.mount_from_chip.tr_mul(&b) * self.field_unit_ut - self.motor_current.interference_ut(None))
                .into(),
            inclination_rad: parameters.inclination_rad,
            total_ut: self.field_unit_ut * per_unit,
            latency_s: self.latency_s,
            motor_current: self.motor_current,
        })
    }
}
