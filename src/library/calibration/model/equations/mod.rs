//! Linearised residuals of one sample with their weights.

use nalgebra::Vector3;

use super::noise::{ModelConfig, NoiseModel, ResidualCovariance};
use super::prediction::{FieldPrediction, ModelParameters};
use super::unknowns::JacobianRow;
use crate::calibration::linear_algebra::multiply;
use crate::frames::{AttitudeRotation, wrap_pi};
use crate::trig::sqrt;

/// Linearised residual: `row . change = -residual`.
#[derive(Clone, Debug)]
pub(in crate::calibration) struct ResidualEquation {
    pub jacobian_row: JacobianRow,
    pub residual: f32,
    /// Inverse variance times the Huber weight.
    pub weight: f32,
    /// Huber loss: half the squared normalised residual, linear beyond `huber_sigmas` (P. J. Huber, "Robust estimation
    /// of a location parameter", Annals of Mathematical Statistics 35, 1964).
    pub loss: f32,
    pub clipped_square: f32,
}

/// Clipping limit for the estimate of sigma, sigmas.
const CLIP_SIGMAS: f32 = 2.0;
/// Mean of the clipped square of a standard normal variable (Huber's proposal 2). With it, 5 % of outliers do no harm.
pub(in crate::calibration) const CLIPPED_MEAN_SQUARE: f32 = 0.9205;

impl ResidualEquation {
    #[inline]
    pub fn new(row: JacobianRow, residual: f32, variance: f32, huber_sigmas: f32) -> Self {
        let information = 1.0 / variance;
        let square = residual * residual * information;
        let (weight, loss) = if square <= huber_sigmas * huber_sigmas {
            (information, 0.5 * square)
        } else {
            let magnitude = sqrt(square);
            (information * huber_sigmas / magnitude, huber_sigmas * (magnitude - 0.5 * huber_sigmas))
        };
        Self { jacobian_row: row, residual, weight, loss, clipped_square: square.min(CLIP_SIGMAS * CLIP_SIGMAS) }
    }

    pub fn clipped_residual(&self) -> f32 {
        sqrt(self.clipped_square).copysign(self.residual)
    }
}

/// The equations of one sample. With `w = W x + d` the corrected field in units of field, `C` the rotation of the
/// sample's attitude from body to level axes (Liu 2007 eq. 7), and `l = C w / |w|`:
///
/// - norm residual `|w| - 1`, variance of the sensor;
/// - inclination residual `atan2(l_z, sqrt(l_x^2 + l_y^2)) - I`, variance of sensor and attitude;
/// - heading residual `atan2(-l_y, l_x) - given`, variance of sensor, attitude and given heading.
///
/// `w` is Liu 2007 eq. 8 solved for the field, the heading its eq. 3. The first two use that field strength and
/// inclination are the same at every attitude; the paper's method does not.
#[derive(Clone, Debug)]
pub(in crate::calibration) struct SampleEquations {
    pub norm_equation: ResidualEquation,
    /// Inclination residual, decorrelated from the norm residual. `None` without attitude.
    pub inclination_equation: Option<ResidualEquation>,
    pub heading_equation: Option<ResidualEquation>,
    /// Derivatives of the inclination by roll and by pitch.
    pub inclination_derivatives_by_attitude: [f32; 2],
}

/// A sample in the model's units.
pub(in crate::calibration) struct MeasuredSample {
    /// `x`: field minus the mean of all samples, mount axes, units of field.
    pub centred_field: Vector3<f32>,
    pub tilt_rotation: AttitudeRotation,
    /// Given heading, radians.
    pub heading_rad: Option<f32>,
}

impl SampleEquations {
    /// `is_refined`: whether the coefficients are good enough to estimate measurement errors from the residuals.
    pub fn new(
        parameters: &ModelParameters,
        measured: &MeasuredSample,
        noise: &NoiseModel,
        config: &ModelConfig,
        is_refined: bool,
    ) -> Self {
        let prediction = parameters.predict_field(measured.centred_field, &measured.tilt_rotation);
        let by_attitude = prediction.inclination_derivatives_by_attitude(&measured.tilt_rotation);
        let covariance =
            noise.covariance(&prediction.field_direction, &prediction.inclination_derivative_by_field, by_attitude);
        let residuals = Residuals::new(parameters, &prediction);
        let (prediction, Residuals { norm, inclination_rad }) = if is_refined {
            linearise_at_corrected_field(parameters, measured, noise, &covariance, &prediction, &residuals, config)
        } else {
            (prediction, residuals)
        };
        let norm_row = prediction.norm_row();
        Self {
            inclination_equation: config.uses_attitude.then(|| {
                let mut row = prediction.inclination_row();
                row.derivative_by_field -= norm_row.derivative_by_field * covariance.decorrelation_slope;
                ResidualEquation::new(
                    row,
                    inclination_rad - norm * covariance.decorrelation_slope,
                    covariance.inclination_variance,
                    config.huber_sigmas,
                )
            }),
            heading_equation: measured
                .heading_rad
                .map(|given_rad| heading_equation(measured, noise, config, &prediction, given_rad)),
            norm_equation: ResidualEquation::new(norm_row, norm, covariance.norm_variance, config.huber_sigmas),
            inclination_derivatives_by_attitude: by_attitude,
        }
    }
}

impl SampleEquations {
    pub fn iter(&self) -> impl Iterator<Item = &ResidualEquation> {
        core::iter::once(&self.norm_equation).chain(&self.inclination_equation).chain(&self.heading_equation)
    }
}

struct Residuals {
    norm: f32,
    inclination_rad: f32,
}

impl Residuals {
    fn new(parameters: &ModelParameters, prediction: &FieldPrediction) -> Self {
        Self {
            norm: prediction.norm - 1.0,
            inclination_rad: wrap_pi(prediction.inclination_rad - parameters.inclination_rad),
        }
    }
}

/// Moves the measurement to its most likely true value and linearises there (orthogonal distance regression: P. T.
/// Boggs and J. E. Rogers, Contemporary Mathematics 112, 1990).
///
/// Otherwise the noise in the derivatives correlates with that in the residuals: at 1 % sensor noise, 15 deg of bank
/// and 70 deg of inclination the bias was as large as the random error. The effect of the move on the residuals is
/// removed to first order. Attitude errors do not change the direction of the derivatives and need no correction.
fn linearise_at_corrected_field(
    parameters: &ModelParameters,
    measured: &MeasuredSample,
    noise: &NoiseModel,
    covariance: &ResidualCovariance,
    prediction: &FieldPrediction,
    &Residuals { norm, inclination_rad }: &Residuals,
    config: &ModelConfig,
) -> (FieldPrediction, Residuals) {
    // Residual, limited to the Huber threshold, over variance.
    let limited_weighted = |residual: f32, variance: f32| {
        let limit_squared = config.huber_sigmas * config.huber_sigmas * variance;
        let is_small = residual * residual <= limit_squared;
        (if is_small { residual } else { sqrt(limit_squared).copysign(residual) }) / variance
    };
    let inclination_multiplier = if config.uses_attitude {
        limited_weighted(inclination_rad - norm * covariance.decorrelation_slope, covariance.inclination_variance)
    } else {
        0.0
    };
    let norm_multiplier =
        limited_weighted(norm, covariance.norm_variance) - covariance.decorrelation_slope * inclination_multiplier;
    let sensor_error = noise.likely_sensor_error(
        &(prediction.field_direction * norm_multiplier
            + prediction.inclination_derivative_by_field * inclination_multiplier),
    );
    let corrected_prediction =
        parameters.predict_field(prediction.centred_field - sensor_error, &measured.tilt_rotation);
    let body_correction = multiply(&parameters.w, &sensor_error);
    let corrected_residuals = Residuals::new(parameters, &corrected_prediction);
    let residuals = Residuals {
        norm: corrected_residuals.norm + corrected_prediction.field_direction.dot(&body_correction),
        inclination_rad: corrected_residuals.inclination_rad
            + corrected_prediction.inclination_derivative_by_field.dot(&body_correction),
    };
    (corrected_prediction, residuals)
}

fn heading_equation(
    measured: &MeasuredSample,
    noise: &NoiseModel,
    config: &ModelConfig,
    prediction: &FieldPrediction,
    given_rad: f32,
) -> ResidualEquation {
    let by_field = prediction.heading_derivative_by_field(&measured.tilt_rotation);
    let variance =
        config.given_heading_sigma_rad * config.given_heading_sigma_rad + noise.heading_variance(&by_field, prediction);
    let residual = wrap_pi(prediction.heading_rad() - given_rad);
    ResidualEquation::new(prediction.heading_row(&measured.tilt_rotation), residual, variance, config.huber_sigmas)
}

#[cfg(test)]
mod tests;
