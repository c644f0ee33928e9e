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
use super::turns::{Bank, Centres, MIN_SAMPLES, progress_rad};
use super::{Part, Sample, Samples, Side, SolveError};

/// The sine of the angle between the planes must be more, or their common direction is noise.
const MIN_SINE_OF_PLANES: f32 = 1e-3;

/// Solves left and right turns whose fields are rotated by `rotation` first.
///
/// # Errors
///
/// [`SolveError::TooFewSamples`] and [`SolveError::NotAnEllipse`] name the turn they are about, and
/// [`SolveError::SamePlane`] says that the banks of the two, or their planes, are too much alike.
pub(super) fn solve(turns: Samples<'_>, rotation: &Matrix3<f32>) -> Result<Response, SolveError> {
    let left = Turn::new(turns.left, rotation, Side::Left)?;
    let right = Turn::new(turns.right, rotation, Side::Right)?;
    let common = left.ellipse.normal.cross(&right.ellipse.normal);
    if common.norm() < MIN_SINE_OF_PLANES {
        return Err(SolveError::SamePlane);
    }
    let common = common.normalize();
    let radius_ut = left.ellipse.radius_ut(&common).midpoint(right.ellipse.radius_ut(&common));
    let u_ut = common * radius_ut;
    let (v_left, v_right) = (left.conjugate_ut(&u_ut), right.conjugate_ut(&u_ut));

    // v = -cos(phi) A e_y + sin(phi) A e_z for both banks, solved for A e_y and A e_z.
    let sine = left.bank.sine_to(right.bank)?;
    let y_ut = (v_right * left.bank.sin - v_left * right.bank.sin) / sine;
    let z_ut = (v_right * left.bank.cos - v_left * right.bank.cos) / sine;

    let by_vertical = |bank: Bank| y_ut * bank.sin + z_ut * bank.cos;
    let centres = Centres {
        centres_ut: [left.ellipse.centre_ut, right.ellipse.centre_ut],
        by_vertical_ut: [by_vertical(left.bank), by_vertical(right.bank)],
    };
    let tan_inclination = centres.vertical();
    let b_ut = centres.hard_iron_ut(tan_inclination);
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
    bank: Bank,
}

impl<'a> Turn<'a> {
    fn new(samples: &'a [Sample], rotation: &'a Matrix3<f32>, side: Side) -> Result<Self, SolveError> {
        SolveError::require(Part::Turns(side), samples.len(), MIN_SAMPLES)?;
        let ellipse = Ellipse::fit(samples, rotation, side)?;
        Ok(Self { samples, rotation, side, ellipse, bank: Bank::mean_of(samples) })
    }

    /// The semi-axis conjugate to `u`, with the sign that lets heading run the way of the turn.
    fn conjugate_ut(&self, u_ut: &Vector3<f32>) -> Vector3<f32> {
        let v_ut = self.ellipse.conjugate_ut(u_ut);
        let phase = |s: &Sample| self.ellipse.phase_rad(&(self.rotation * s.field.ut), u_ut, &v_ut);
        if progress_rad(self.samples, self.side, phase) >= 0.0 { v_ut } else { -v_ut }
    }
}

#[cfg(test)]
mod tests {
    use core::f32::consts::TAU;

    use super::*;
    use crate::calibration::Rates;
    use crate::frames::{Attitude, Field};
    use crate::time::WrappingMillis;

    /// A circle of so much radius about the origin that is inclined to the horizontal by `plane_deg`, flown at a bank.
    fn circle(plane_deg: f32, bank_deg: f32, radius_ut: f32) -> Vec<Sample> {
        let (sin, cos) = plane_deg.to_radians().sin_cos();
        let sense = bank_deg.signum();
        (0..24_u16)
            .map(|i| {
                let heading_rad = sense * f32::from(i) / 24.0 * TAU;
                let (x, y) = (radius_ut * heading_rad.cos(), -radius_ut * heading_rad.sin());
                Sample {
                    field: Field::from_ut(x, y * cos, -y * sin),
                    attitude: Attitude::from_deg(bank_deg, 0.0),
                    time: WrappingMillis::new(u32::from(i) * 500),
                    rates: Rates::NONE,
                }
            })
            .collect()
    }

    fn solved(left: &[Sample], right: &[Sample]) -> Result<Response, SolveError> {
        solve(Samples { left, right, ..Samples::default() }, &Matrix3::identity())
    }

    /// The response of the roll axis is the mean of what the two turns say of it.
    #[test]
    fn both_turns_count_for_the_axis_that_they_share() {
        let found = solved(&circle(-25.0, -25.0, 20.0), &circle(25.0, 25.0, 24.0)).unwrap();
        assert!((found.a_ut.column(0) - Vector3::new(22.0, 0.0, 0.0)).norm() < 1e-3, "{}", found.a_ut);
    }

    /// Banks that differ, of an attitude source that dreams, but fields of one plane.
    #[test]
    fn turns_in_one_plane_have_no_direction_in_common() {
        let refused = solved(&circle(10.0, -25.0, 20.0), &circle(10.0, 25.0, 20.0)).map(|_| ());
        assert_eq!(refused, Err(SolveError::SamePlane));
        assert!(solved(&circle(9.0, -25.0, 20.0), &circle(11.0, 25.0, 20.0)).is_ok());
    }
}
