//! What one sample says, as equations linear in the unknowns, each with its weight.

use nalgebra::Vector3;

use super::noise::{Covariance, Noise};
use super::view::{Point, View};
use super::{Config, Vector13};
use crate::frames::{Tilt, wrap_pi};

/// One equation: `row . change = -residual`.
#[derive(Clone, Debug)]
pub(in crate::calibration) struct Equation {
    pub row: Vector13,
    pub residual: f32,
    /// Weight of the squared residual: the inverse variance, times Huber's weight.
    pub weight: f32,
    pub loss: f32,
    /// Square of the residual over sigma, clipped at [`CLIP`].
    pub clipped_square: f32,
}

/// Residuals are clipped here when their sigma is estimated.
const CLIP: f32 = 2.0;
/// The mean of the clipped square of a normal variable: Huber's proposal 2, which one sample in twenty may spoil without
/// harm.
pub(super) const CLIPPED_MEAN_SQUARE: f32 = 0.9205;

impl Equation {
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

/// The equations of one sample.
#[derive(Clone, Debug)]
pub(in crate::calibration) struct Equations {
    /// The total field is one.
    pub norm: Equation,
    /// The dip is the inclination, less what the norm's residual already says of it. Absent where no attitude is known.
    pub dip: Option<Equation>,
    /// The heading is the given one.
    pub heading: Option<Equation>,
    /// Change of the dip by a radian of roll bias, of pitch bias, and by a relative bank error of one.
    pub attitude_effects: [f32; 3],
}

/// A sample, ready to be looked at.
pub(in crate::calibration) struct Measured {
    /// The field less the mean of all samples, in mount axes and the unit of field.
    pub x: Vector3<f32>,
    pub tilt: Tilt,
    pub roll_rad: f32,
    /// The heading, where it was given.
    pub heading_rad: Option<f32>,
}

impl Equations {
    /// `refined` says whether the coefficients are good enough for their residuals to say how the measurement was wrong:
    /// see [`corrected`].
    pub fn new(point: &Point, measured: &Measured, noise: &Noise, config: &Config, refined: bool) -> Self {
        let view = point.view(measured.x, &measured.tilt);
        let by_attitude = view.dip_by_attitude(&measured.tilt);
        let covariance = noise.covariance(&view.direction, &view.towards_down, by_attitude);
        let [norm, dip] = [view.total - 1.0, wrap_pi(view.dip_rad - point.inclination_rad)];
        let (view, [norm, dip]) = if refined {
            corrected(point, measured, noise, &covariance, &view, [norm, dip], config)
        } else {
            (view, [norm, dip])
        };
        let norm_row = view.norm_row();
        Self {
            dip: config.uses_attitude.then(|| {
                let row = view.dip_row() - norm_row * covariance.slope;
                Equation::new(row, dip - norm * covariance.slope, covariance.dip, config.huber)
            }),
            heading: measured.heading_rad.map(|heading_rad| heading(measured, noise, config, &view, heading_rad)),
            norm: Equation::new(norm_row, norm, covariance.norm, config.huber),
            attitude_effects: [by_attitude[0], by_attitude[1], by_attitude[0] * measured.roll_rad],
        }
    }
}

/// Noise stands in the derivatives as well as in the residual, and where both hold the same noise the sum of their
/// products does not vanish: at 1 % of sensor noise, 15 deg of bank and 70 deg of inclination that bias was as large as
/// the random error. So the derivatives are taken at the measurement as it most likely was, moved by what the residuals
/// say of the sensor's error; what the move does to the residuals is taken back to first order (orthogonal distance
/// regression). An attitude error needs no such care: it turns the down direction towards or away from the field, which
/// leaves the derivative's direction as it is.
fn corrected(
    point: &Point,
    measured: &Measured,
    noise: &Noise,
    covariance: &Covariance,
    view: &View,
    [norm, dip]: [f32; 2],
    config: &Config,
) -> (View, [f32; 2]) {
    let bounded = |residual: f32, variance: f32| {
        let limit_squared = config.huber * config.huber * variance;
        let is_small = residual * residual <= limit_squared;
        (if is_small { residual } else { libm::sqrtf(limit_squared).copysign(residual) }) / variance
    };
    let by_dip = if config.uses_attitude { bounded(dip - norm * covariance.slope, covariance.dip) } else { 0.0 };
    let by_norm = bounded(norm, covariance.norm) - covariance.slope * by_dip;
    let move_x = noise.sensor_move(&(view.direction * by_norm + view.towards_down * by_dip));
    let moved = point.view(view.x - move_x, &measured.tilt);
    let move_body = point.w * move_x;
    let norm = moved.total - 1.0 + moved.direction.dot(&move_body);
    let dip = wrap_pi(moved.dip_rad - point.inclination_rad) + moved.towards_down.dot(&move_body);
    (moved, [norm, dip])
}

fn heading(measured: &Measured, noise: &Noise, config: &Config, view: &View, heading_rad: f32) -> Equation {
    let by_field = view.heading_by_field(&measured.tilt);
    let found_rad = libm::atan2f(-view.level.y, view.level.x);
    let variance =
        config.given_heading_sigma_rad * config.given_heading_sigma_rad + noise.heading_variance(&by_field, view);
    Equation::new(Point::row(&by_field, &view.x), wrap_pi(found_rad - heading_rad), variance, config.huber)
}
