//! From the information in the samples to the heading error to expect, in degrees.
//!
//! Not the residual of the fit but this is the quality figure: a norm residual of 0.3 % can hide a heading error of
//! 5 deg in a direction that the turns do not show.

use core::f32::consts::FRAC_PI_6;

use nalgebra::{Matrix3, Vector3};

use super::maximum_likelihood::{Matrix13, Point, System, Vector13};
use crate::frames::{Attitude, Field};

/// Errors of the attitude source that are alike in all samples, 1 sigma. Turns do not reveal them: a bias looks like
/// mounting, a bank scale like soft iron.
#[derive(Clone, Copy, Debug)]
pub struct Consider {
    /// Constant roll and pitch bias, radians: 0.2 deg, an autopilot levelled with care.
    pub bias_rad: f32,
    /// Relative error of bank in turns: 1 %, an estimator that knows its airspeed.
    pub bank_scale: f32,
}

impl Consider {
    /// A good autopilot.
    pub const DEFAULT: Self = Self { bias_rad: 0.0035, bank_scale: 0.01 };
}

/// Expected heading error, 1 sigma.
#[derive(Clone, Copy, Debug)]
pub(super) struct Expected {
    /// RMS over the envelope, degrees.
    pub rms_deg: f32,
    /// At the worst heading and bank of the envelope, degrees.
    pub worst_deg: f32,
}

/// The envelope: so many degrees of bank, each at twelve headings.
const BANKS_DEG: [f32; 3] = [-30.0, 0.0, 30.0];

/// Propagates the covariance of the unknowns, widened for noise that is correlated in time, and the considered errors
/// of the attitude source to heading at true attitude. `None` when the information is singular.
pub(super) fn expected(system: &System, point: &Point, inclination_rad: f32, consider: Consider) -> Option<Expected> {
    let inverse = system.information().cast::<f64>().cholesky()?.inverse().cast::<f32>();
    let covariance = covariance(system, &inverse);
    let sigmas = [consider.bias_rad, consider.bias_rad, consider.bank_scale];
    let mut shifts = system.consider;
    for (shift, sigma) in shifts.iter_mut().zip(sigmas) {
        *shift = inverse * *shift * sigma;
    }
    let field_from_body = point.w.try_inverse()?;
    let mut sum = 0.0;
    let mut worst: f32 = 0.0;
    for bank_deg in BANKS_DEG {
        for step in 0..12_u8 {
            let row = heading_row(point, &field_from_body, inclination_rad, bank_deg, f32::from(step) * FRAC_PI_6);
            let systematic: f32 = shifts.iter().map(|shift| shift.dot(&row)).map(|d| d * d).sum();
            let variance = row.dot(&(covariance * row)) + systematic;
            sum += variance;
            worst = worst.max(variance);
        }
    }
    let mean = sum / (12 * BANKS_DEG.len()) as f32;
    mean.is_finite()
        .then(|| Expected { rms_deg: libm::sqrtf(mean).to_degrees(), worst_deg: libm::sqrtf(worst).to_degrees() })
}

/// Covariance of the unknowns. Errors of an attitude source stay alike for about half a second; with lag-1
/// autocorrelation rho of the dip residuals their information is worth `(1 - rho) / (1 + rho)` of what it seems, so the
/// estimator's covariance is `H^-1 (H_norm + H_prior + H_dip (1 + rho) / (1 - rho)) H^-1`.
fn covariance(system: &System, inverse: &Matrix13) -> Matrix13 {
    let rho = system.autocorrelation();
    let scatter = system.norm + system.prior + system.dip * ((1.0 + rho) / (1.0 - rho));
    inverse * scatter * inverse
}

/// Derivative of heading by the unknowns: with `l = C W (m - b)` and `psi = atan2(-l_y, l_x)`,
/// `d psi = (l_y d l_x - l_x d l_y) / (l_x^2 + l_y^2)`.
fn heading_row(
    point: &Point,
    field_from_body: &Matrix3<f32>,
    inclination_rad: f32,
    bank_deg: f32,
    heading_rad: f32,
) -> Vector13 {
    let attitude = Attitude::from_deg(bank_deg, 0.0);
    let level = Field::earth(1.0, inclination_rad, heading_rad);
    let x: Vector3<f32> = field_from_body * attitude.body(level).ut;
    let to_level = attitude.level_from_body();
    let (row_x, row_y) = (to_level.row(0).transpose(), to_level.row(1).transpose());
    // Next to a magnetic pole there is no heading; the floor keeps the figure finite and huge.
    let horizontal = (level.ut.x * level.ut.x + level.ut.y * level.ut.y).max(1e-6);
    point.row(&((row_x * level.ut.y - row_y * level.ut.x) / horizontal), &x)
}
