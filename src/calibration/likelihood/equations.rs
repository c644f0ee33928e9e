//! What one sample says, as equations linear in the unknowns, each with its weight.

use nalgebra::Vector3;

use super::noise::{Covariance, Noise};
use super::unknowns::Vector13;
use super::{Config, Parameters, Prediction};
use crate::frames::{Tilt, wrap_pi};

/// One equation: `row . change = -residual`.
#[derive(Clone, Debug)]
pub(in crate::calibration) struct Equation {
    /// Derivative of the residual by the unknowns.
    pub row: Vector13,
    pub residual: f32,
    /// Weight of the squared residual: the inverse variance, times Huber's weight.
    pub weight: f32,
    /// Huber's loss: half the square of the residual over sigma, and linear beyond `huber` sigmas (P. J. Huber, "Robust
    /// estimation of a location parameter", Annals of Mathematical Statistics 35, 1964).
    pub loss: f32,
    /// Square of the residual over sigma, clipped at [`CLIP`].
    pub clipped_square: f32,
}

/// Residuals are clipped here when their sigma is estimated.
const CLIP: f32 = 2.0;
/// The mean of the clipped square of a normal variable: Huber's proposal 2, which one sample in twenty may spoil
/// without harm.
pub(super) const CLIPPED_MEAN_SQUARE: f32 = 0.9205;

impl Equation {
    /// Of a residual with its derivative and variance; `huber` is where the loss becomes linear, in sigmas.
    pub fn new(row: Vector13, residual: f32, variance: f32, huber: f32) -> Self {
        let information = 1.0 / variance;
        let square = residual * residual * information;
        let (weight, loss) = if square <= huber * huber {
            (information, 0.5 * square)
        } else {
            let size = libm::sqrtf(square);
            (information * huber / size, huber * (size - 0.5 * huber))
        };
        Self { row, residual, weight, loss, clipped_square: square.min(CLIP * CLIP) }
    }

    /// Residual over sigma, clipped.
    pub fn clipped(&self) -> f32 {
        libm::sqrtf(self.clipped_square).copysign(self.residual)
    }
}

/// The equations of one sample. With `w = W x + d` the corrected field in the unit of field, `C` the rotation of the
/// sample's attitude from body to level axes (Liu 2007 eq. 7), and `l = C w / |w|`:
///
/// | residual | derivative by the unknowns | variance |
/// |---|---|---|
/// | `e_norm = |w| - 1` | [`Prediction::norm_row`] | the sensor's |
/// | `e_dip = atan2(l_z, sqrt(l_x^2 + l_y^2)) - I` | [`Prediction::dip_row`] | the sensor's and the attitude's |
/// | `e_heading = atan2(-l_y, l_x) - given` | [`Prediction::heading_row`] | these, and that of what was given |
///
/// `w` is Liu 2007 eq. 8 solved for the field, the heading its eq. 3. The first two say that the Earth field has one
/// size and one inclination wherever the aircraft points, which its eq. 7 implies and its method does not use.
#[derive(Clone, Debug)]
pub(in crate::calibration) struct Equations {
    /// The total field is one: `e_norm`.
    pub norm: Equation,
    /// The dip is the inclination, less what the norm's residual already says of it: `e_dip - slope e_norm`, with the
    /// `slope` of the noise's [`Covariance`], which makes the two independent. Absent where no attitude is known.
    pub dip: Option<Equation>,
    /// The heading is the given one: `e_heading`.
    pub heading: Option<Equation>,
    /// Change of the dip by a radian of roll bias, of pitch bias, and by a relative bank error of one.
    pub attitude_effects: [f32; 3],
}

/// A sample, ready to be looked at.
pub(in crate::calibration) struct Measured {
    /// The field less the mean of all samples, in mount axes and the unit of field.
    pub x: Vector3<f32>,
    /// The rotation of its attitude.
    pub tilt: Tilt,
    pub roll_rad: f32,
    /// The heading, where it was given.
    pub heading_rad: Option<f32>,
}

impl Equations {
    /// `refined` says whether the coefficients are good enough for their residuals to say how the measurement was
    /// wrong: see [`corrected`].
    pub fn new(parameters: &Parameters, measured: &Measured, noise: &Noise, config: &Config, refined: bool) -> Self {
        let prediction = parameters.predict(measured.x, &measured.tilt);
        let by_attitude = prediction.dip_by_attitude(&measured.tilt);
        let covariance = noise.covariance(&prediction.direction, &prediction.towards_down, by_attitude);
        let residuals = Residuals::new(parameters, &prediction);
        let (prediction, Residuals { norm, dip }) = if refined {
            corrected(parameters, measured, noise, &covariance, &prediction, &residuals, config)
        } else {
            (prediction, residuals)
        };
        let norm_row = prediction.norm_row();
        Self {
            dip: config.uses_attitude.then(|| {
                let row = prediction.dip_row() - norm_row * covariance.slope;
                Equation::new(row, dip - norm * covariance.slope, covariance.dip, config.huber)
            }),
            heading: measured.heading_rad.map(|given_rad| heading(measured, noise, config, &prediction, given_rad)),
            norm: Equation::new(norm_row, norm, covariance.norm, config.huber),
            attitude_effects: [by_attitude[0], by_attitude[1], by_attitude[0] * measured.roll_rad],
        }
    }
}

/// `e_norm`, and `e_dip` in radians.
struct Residuals {
    norm: f32,
    dip: f32,
}

impl Residuals {
    fn new(parameters: &Parameters, prediction: &Prediction) -> Self {
        Self { norm: prediction.total - 1.0, dip: wrap_pi(prediction.dip_rad - parameters.inclination_rad) }
    }
}

/// Noise stands in the derivatives as well as in the residual, and where both hold the same noise the sum of their
/// products does not vanish: at 1 % of sensor noise, 15 deg of bank and 70 deg of inclination that bias was as large as
/// the random error. So the derivatives are taken at the measurement as it most likely was, moved by what the residuals
/// say of the sensor's error; what the move does to the residuals is taken back to first order (orthogonal distance
/// regression: P. T. Boggs and J. E. Rogers, Contemporary Mathematics 112, 1990). An attitude error needs no such care:
/// it turns the down direction towards or away from the field, which leaves the derivative's direction as it is.
fn corrected(
    parameters: &Parameters,
    measured: &Measured,
    noise: &Noise,
    covariance: &Covariance,
    prediction: &Prediction,
    &Residuals { norm, dip }: &Residuals,
    config: &Config,
) -> (Prediction, Residuals) {
    // A residual over its variance, the residual no larger than Huber's limit.
    let bounded = |residual: f32, variance: f32| {
        let limit_squared = config.huber * config.huber * variance;
        let is_small = residual * residual <= limit_squared;
        (if is_small { residual } else { libm::sqrtf(limit_squared).copysign(residual) }) / variance
    };
    let by_dip = if config.uses_attitude { bounded(dip - norm * covariance.slope, covariance.dip) } else { 0.0 };
    let by_norm = bounded(norm, covariance.norm) - covariance.slope * by_dip;
    let move_x = noise.sensor_move(&(prediction.direction * by_norm + prediction.towards_down * by_dip));
    let moved = parameters.predict(prediction.x - move_x, &measured.tilt);
    let move_body = parameters.w * move_x;
    let there = Residuals::new(parameters, &moved);
    let residuals = Residuals {
        norm: there.norm + moved.direction.dot(&move_body),
        dip: there.dip + moved.towards_down.dot(&move_body),
    };
    (moved, residuals)
}

/// `e_heading` of a sample whose heading was given.
fn heading(measured: &Measured, noise: &Noise, config: &Config, prediction: &Prediction, given_rad: f32) -> Equation {
    let by_field = prediction.heading_by_field(&measured.tilt);
    let variance =
        config.given_heading_sigma_rad * config.given_heading_sigma_rad + noise.heading_variance(&by_field, prediction);
    let residual = wrap_pi(prediction.heading_rad() - given_rad);
    Equation::new(prediction.heading_row(&measured.tilt), residual, variance, config.huber)
}
