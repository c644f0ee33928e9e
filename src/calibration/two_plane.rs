//! Two planes: all twelve coefficients in closed form from a left and a right turn.
//!
//! At constant bank phi and zero pitch a turn is a plane ellipse in sensor space (Liu 2007 eq. 7 and 8, FRD axes, unit
//! of field H0):
//!
//! `m = c + A (1, 0, 0) cos psi + A (0, -cos phi, sin phi) sin psi`, `c = A (0, sin phi, cos phi) D + b`.
//!
//! The planes of the two turns have the direction `A e_x` in common, the response of the roll axis. It fixes the phase
//! of both ellipses, which Liu 2007 sets to zero by hypothesis: the semi-axis along it is `A e_x`, the conjugate one is
//! `A (0, -cos phi, sin phi)`, and two banks give `A`. The two centres give D and b. Nothing is left out, so noise-free
//! turns at constant attitude are recovered exactly, yaw mounting error included.
//!
//! Of each conjugate axis the sign follows from the way the samples run round in time, because heading increases in a
//! right turn. What remains is the sign of the whole of `A`; a chip's axes are right-handed, so `det A > 0`.

use nalgebra::{Matrix3, Vector3};

use super::conic::Ellipse;
use super::response::Response;
use super::{Part, Sample, Samples, Side, SolveError};
use crate::trig;

/// Samples a side must have: five determine a conic, and each sector of 30 deg should have one.
pub(super) const MIN_SAMPLES: usize = 12;

/// Samples further apart in time than this say nothing about the way a turn runs, milliseconds: in 3 s even a sharp
/// turn of 30 deg/s stays below half a circle.
const MAX_STEP_MS: u32 = 3000;

/// The bank must differ by so much between the sides, as a sine: 10 deg.
pub(super) const MIN_SINE_OF_BANKS: f32 = 0.17;

/// Solves left and right turns whose fields are rotated by `rotation` first.
pub(super) fn solve(turns: Samples<'_>, rotation: &Matrix3<f32>) -> Result<Response, SolveError> {
    let left = Turn::new(turns.left, rotation, Side::Left)?;
    let right = Turn::new(turns.right, rotation, Side::Right)?;
    let common = left.ellipse.normal.cross(&right.ellipse.normal);
    if common.norm() < 1e-3 {
        return Err(SolveError::SamePlane);
    }
    let common = common.normalize();
    let radius_ut = left.ellipse.radius_ut(&common).midpoint(right.ellipse.radius_ut(&common));
    let u_ut = common * radius_ut;
    let (v_left, v_right) = (left.conjugate_ut(&u_ut), right.conjugate_ut(&u_ut));

    // v = -cos(phi) A e_y + sin(phi) A e_z for both banks, solved for A e_y and A e_z.
    let ((sl, cl), (sr, cr)) = (trig::sin_cos(left.roll_rad), trig::sin_cos(right.roll_rad));
    let sine = sr * cl - cr * sl;
    if sine.abs() < MIN_SINE_OF_BANKS {
        return Err(SolveError::SamePlane);
    }
    let y_ut = (v_right * sl - v_left * sr) / sine;
    let z_ut = (v_right * cl - v_left * cr) / sine;

    let (centre_left, centre_right) = (left.ellipse.centre_ut, right.ellipse.centre_ut);
    let vertical = |sin: f32, cos: f32| y_ut * sin + z_ut * cos;
    let between = vertical(sr, cr) - vertical(sl, cl);
    let tan_inclination = between.dot(&(centre_right - centre_left)) / between.norm_squared();
    let b_ut = (centre_left + centre_right - (vertical(sl, cl) + vertical(sr, cr)) * tan_inclination) / 2.0;
    let a_ut = Matrix3::from_columns(&[u_ut, y_ut, z_ut]);
    let sign = if a_ut.determinant() < 0.0 { -1.0 } else { 1.0 };
    Ok(Response { a_ut: a_ut * sign, b_ut, tan_inclination: tan_inclination * sign })
}

/// One turn.
struct Turn<'a> {
    samples: &'a [Sample],
    rotation: &'a Matrix3<f32>,
    side: Side,
    ellipse: Ellipse,
    /// Mean bank.
    roll_rad: f32,
}

impl<'a> Turn<'a> {
    fn new(samples: &'a [Sample], rotation: &'a Matrix3<f32>, side: Side) -> Result<Self, SolveError> {
        if samples.len() < MIN_SAMPLES {
            let part = Part::Turns(side);
            return Err(SolveError::TooFewSamples { part, have: samples.len() as u16, need: MIN_SAMPLES as u16 });
        }
        let ellipse = Ellipse::fit(samples, rotation, side)?;
        Ok(Self { samples, rotation, side, ellipse, roll_rad: mean_roll_rad(samples) })
    }

    /// The semi-axis conjugate to `u`, with the sign that lets heading run the way of the turn.
    fn conjugate_ut(&self, u_ut: &Vector3<f32>) -> Vector3<f32> {
        let v_ut = self.ellipse.conjugate_ut(u_ut);
        let phase = |s: &Sample| self.ellipse.phase_rad(&(self.rotation * s.field.ut), u_ut, &v_ut);
        if progress_rad(self.samples, self.side, phase) >= 0.0 { v_ut } else { -v_ut }
    }
}

/// Mean bank; 0 without samples.
pub(super) fn mean_roll_rad(samples: &[Sample]) -> f32 {
    samples.iter().map(|s| s.attitude.roll_rad).sum::<f32>() / samples.len().max(1) as f32
}

/// By how much an angle of the samples runs the way heading does in a turn of this side, up to the right, down to the
/// left: radians, positive if it runs the right way, 0 if the samples are too far apart to say.
pub(super) fn progress_rad(samples: &[Sample], side: Side, angle_rad: impl Fn(&Sample) -> f32) -> f32 {
    let progress_rad: f32 = samples
        .iter()
        .zip(samples.iter().skip(1))
        .filter(|(a, b)| b.time.since(a.time) <= MAX_STEP_MS)
        .map(|(a, b)| crate::frames::wrap_pi(angle_rad(b) - angle_rad(a)))
        .sum();
    match side {
        Side::Left => -progress_rad,
        Side::Right => progress_rad,
    }
}
