//! Two planes: all twelve coefficients in closed form from a left and a right turn.
//!
//! At constant bank phi and zero pitch a turn is a plane ellipse in sensor space (Liu 2007 eq. 7 and 8, FRD axes, unit
//! of field H0):
//!
//! `m = c + A (1, 0, 0) cos psi + A (0, -cos phi, sin phi) sin psi`, `c = A (0, sin phi, cos phi) D + b`.
//!
//! The planes of the two turns intersect along `A e_x`, the response of the roll axis. This fixes the phase of both
//! ellipses, which Liu 2007 assumes to be zero: the semi-axis along it is `A e_x`, the conjugate one
//! `A (0, -cos phi, sin phi)`. Two banks give `A`, the two centres D and b. Noise-free turns at constant attitude are
//! recovered exactly, yaw mounting error included.
//!
//! The sign of each conjugate axis follows from the order of the samples in time, because heading increases in a right
//! turn; the sign of `A` from `det A > 0`, because chip axes are right-handed.

use nalgebra::{Matrix3, Vector3};

use super::conic::Ellipse;
use super::starting_point::SensorResponse;
use super::turns::{MIN_SAMPLES, MeanBank, TurnCentres, turn_progress_rad};
use crate::calibration::types::quality::SolveError;
use crate::calibration::types::samples::{CollectionPart, Sample, Samples};
use crate::trig::VectorLength as _;

/// Minimum sine of the angle between the planes; below it their intersection is noise.
const MIN_SINE_BETWEEN_PLANES: f32 = 1e-3;

/// Solves left and right turns; fields are rotated by `rotation` first.
///
/// # Errors
///
/// [`SolveError::TooFewSamples`] and [`SolveError::NotAnEllipse`] of a turn; [`SolveError::SamePlane`] when banks or
/// planes differ too little.
pub(in crate::calibration) fn solve_two_plane(
    turns: Samples<'_>,
    rotation: &Matrix3<f32>,
) -> Result<SensorResponse, SolveError> {
    let left_turn = TurnEllipse::new(turns, rotation, CollectionPart::LEFT)?;
    let right_turn = TurnEllipse::new(turns, rotation, CollectionPart::RIGHT)?;
    let roll_axis_response = left_turn.ellipse.normal.cross(&right_turn.ellipse.normal);
    if roll_axis_response.vector_length() < MIN_SINE_BETWEEN_PLANES {
        return Err(SolveError::SamePlane);
    }
    let roll_axis_response = roll_axis_response.unit_vector();
    let radius_ut =
        left_turn.ellipse.radius_ut(&roll_axis_response).midpoint(right_turn.ellipse.radius_ut(&roll_axis_response));
    let u_ut = roll_axis_response * radius_ut;
    let (v_left, v_right) = (left_turn.conjugate_semi_axis_ut(&u_ut), right_turn.conjugate_semi_axis_ut(&u_ut));

    // `v = -cos(phi) A e_y + sin(phi) A e_z` for both banks, solved for `A e_y` and `A e_z`.
    let sine = left_turn.bank.sine_of_difference(right_turn.bank)?;
    let y_ut = (v_right * left_turn.bank.sin - v_left * right_turn.bank.sin) / sine;
    let z_ut = (v_right * left_turn.bank.cos - v_left * right_turn.bank.cos) / sine;

    let vertical_response = |bank: MeanBank| y_ut * bank.sin + z_ut * bank.cos;
    let centres = TurnCentres {
        centres_ut: [left_turn.ellipse.centre_ut, right_turn.ellipse.centre_ut],
        vertical_response_ut: [vertical_response(left_turn.bank), vertical_response(right_turn.bank)],
    };
    let tan_inclination = centres.vertical_field();
    let b_ut = centres.hard_iron_ut(tan_inclination);
    let a_ut = Matrix3::from_columns(&[u_ut, y_ut, z_ut]);
    let sign = if a_ut.determinant() < 0.0 { -1.0 } else { 1.0 };
    Ok(SensorResponse { response_ut: a_ut * sign, hard_iron_ut: b_ut, tan_inclination: tan_inclination * sign })
}

struct TurnEllipse<'a> {
    samples: Samples<'a>,
    rotation: &'a Matrix3<f32>,
    part: CollectionPart,
    ellipse: Ellipse,
    bank: MeanBank,
}

impl<'a> TurnEllipse<'a> {
    fn new(turns: Samples<'a>, rotation: &'a Matrix3<f32>, part: CollectionPart) -> Result<Self, SolveError> {
        let samples = turns.samples_of_part(part);
        SolveError::require_samples(part, samples.iter().count(), MIN_SAMPLES)?;
        let ellipse = Ellipse::fit_ellipse(samples, rotation, part)?;
        Ok(Self { samples, rotation, part, ellipse, bank: MeanBank::from_samples(samples) })
    }

    fn conjugate_semi_axis_ut(&self, u_ut: &Vector3<f32>) -> Vector3<f32> {
        let v_ut = self.ellipse.conjugate_semi_axis_ut(u_ut);
        let phase = |sample: &Sample| self.ellipse.phase_rad(&(self.rotation * sample.field.ut), u_ut, &v_ut);
        if turn_progress_rad(self.samples, self.part, phase) >= 0.0 { v_ut } else { -v_ut }
    }
}

#[cfg(test)]
mod tests {
    use core::f32::consts::TAU;

    use super::*;
    use crate::calibration::tests::synthetic::turn_samples;
    use crate::frames::{Field, RollPitch};
    use crate::time::WrappingMillis;

    fn circle_samples(bank_deg: f32, radius_ut: f32) -> Vec<Sample> {
        let (sin, cos) = bank_deg.to_radians().sin_cos();
        let sense = bank_deg.signum();
        (0..24_u16)
            .map(|i| {
                let heading_rad = sense * f32::from(i) / 24.0 * TAU;
                let (x, y) = (radius_ut * heading_rad.cos(), -radius_ut * heading_rad.sin());
                Sample {
                    time: WrappingMillis::new(u32::from(i) * 500),
                    ..Sample::new(Field::from_ut(x, y * cos, -y * sin), RollPitch::from_deg(bank_deg, 0.0))
                }
            })
            .collect()
    }

    #[test]
    fn the_common_axis_is_the_mean_of_both_turns() {
        let turns = turn_samples(&circle_samples(-25.0, 20.0), &circle_samples(25.0, 24.0));
        let found = solve_two_plane(turns, &Matrix3::identity()).unwrap();
        assert!((found.response_ut.column(0) - Vector3::new(22.0, 0.0, 0.0)).norm() < 1e-3, "{}", found.response_ut);
    }
}
