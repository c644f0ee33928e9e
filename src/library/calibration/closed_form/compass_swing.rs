//! Compass swing: coefficients from known headings, the classical ground procedure (Liu 2007 ref. 2).
//!
//! With heading and attitude the Earth field in body axes is known, `h = C^T H0 (cos psi, -sin psi, D)`, and
//! `m = A h + b` is linear in the twelve coefficients: one regression per sensor axis on `h` and a constant, all with
//! the same 4 x 4 matrix. Without a configured inclination, `D` is the candidate with the smallest residual. On level
//! ground vertical response and hard iron are not separable; the response is then assumed to be without soft iron.

use nalgebra::{Matrix3, Vector3, Vector4};

use super::starting_point::{SensorResponse, inclination_tangent};
use crate::calibration::linear_algebra::LeastSquares;
use crate::calibration::types::quality::SolveError;
use crate::calibration::types::samples::{CollectionPart, HeadingMark};
use crate::frames::Field;
use crate::trig;
use crate::trig::sqrt;

/// Minimum number of samples: two horizontal responses and a constant per axis, plus one to detect a wrong entry.
const MIN_MARKS: usize = 4;

/// Weight of the assumption of no soft iron relative to a sample; decides only what the samples do not determine.
const NO_SOFT_IRON_WEIGHT: f32 = 1e-3;

/// Candidate inclinations, degrees; refined later where samples are tilted, irrelevant where they are level.
const INCLINATIONS_DEG: [f32; 11] = [-75.0, -60.0, -45.0, -30.0, -15.0, 0.0, 15.0, 30.0, 45.0, 60.0, 75.0];

/// Solves samples with known headings; fields are rotated by `rotation` first. Inclination in radians, if configured.
///
/// # Errors
///
/// [`SolveError::TooFewSamples`], and [`SolveError::NotDetermined`] when the field does not follow the headings.
pub(in crate::calibration) fn solve_compass_swing(
    marks: &[HeadingMark],
    rotation: &Matrix3<f32>,
    inclination_rad: Option<f32>,
) -> Result<SensorResponse, SolveError> {
    SolveError::require_samples(CollectionPart::MARKS, marks.len(), MIN_MARKS)?;
    let h0_ut = estimate_horizontal_ut(marks, rotation).ok_or(SolveError::NotDetermined(CollectionPart::MARKS))?;
    let candidates_rad = INCLINATIONS_DEG.map(f32::to_radians);
    let inclinations_rad = inclination_rad.as_ref().map_or(&candidates_rad[..], core::slice::from_ref);
    inclinations_rad
        .iter()
        .filter_map(|&inclination_rad| fit_response(marks, rotation, inclination_tangent(inclination_rad), h0_ut))
        .min_by(|a, b| a.0.total_cmp(&b.0))
        .map(|(_, response)| response)
        .ok_or(SolveError::NotDetermined(CollectionPart::MARKS))
}

/// Horizontal field strength, from a regression of the horizontal axes without vertical field.
fn estimate_horizontal_ut(marks: &[HeadingMark], rotation: &Matrix3<f32>) -> Option<f32> {
    let (_, response) = fit_response(marks, rotation, 0.0, 0.0)?;
    let horizontal = response.response_ut.fixed_view::<2, 2>(0, 0).determinant();
    Some(sqrt(horizontal.abs())).filter(|h0_ut| *h0_ut > 1.0)
}

/// Squared residual (square microtesla) and response at an inclination.
fn fit_response(
    marks: &[HeadingMark],
    rotation: &Matrix3<f32>,
    tan_inclination: f32,
    h0_ut: f32,
) -> Option<(f32, SensorResponse)> {
    let regressors = |mark: &HeadingMark| {
        let (sin, cos) = trig::sin_cos(mark.heading_rad);
        let level = Field::from_ut(cos, -sin, tan_inclination);
        mark.sample.attitude.to_body_frame(level).ut.push(1.0)
    };
    let field = |mark: &HeadingMark| rotation * mark.sample.field.ut;
    let mean = marks.iter().map(field).sum::<Vector3<f32>>() / marks.len() as f32;
    let mut least_squares = LeastSquares::<4, 3>::new();
    // Ridge towards no soft iron: A times H0 is H0 times the identity; b stays free.
    for i in 0..3 {
        least_squares.add_weighted_row(&Vector4::ith(i, 1.0), Vector3::ith(i, h0_ut).into(), NO_SOFT_IRON_WEIGHT);
    }
    for mark in marks {
        least_squares.add_weighted_row(&regressors(mark), (field(mark) - mean).into(), 1.0);
    }
    let solution = least_squares.solve()?;
    let residual: f32 =
        marks.iter().map(|mark| (field(mark) - mean - solution.tr_mul(&regressors(mark))).norm_squared()).sum();
    let a_ut = solution.fixed_rows::<3>(0).transpose();
    let b_ut = solution.row(3).transpose() + mean;
    // On level ground all inclinations fit equally; the least hard iron is then the most likely.
    Some((
        residual + NO_SOFT_IRON_WEIGHT * b_ut.norm_squared(),
        SensorResponse { response_ut: a_ut, hard_iron_ut: b_ut, tan_inclination },
    ))
}

#[cfg(test)]
mod tests {
    use core::f32::consts::TAU;

    use super::*;
    use crate::calibration::Sample;
    use crate::frames::{Level, RollPitch};

    const B_UT: Vector3<f32> = Vector3::new(12.0, -30.0, 8.0);

    fn soft_iron() -> Matrix3<f32> {
        Matrix3::new(1.1, 0.05, -0.02, -0.03, 0.9, 0.04, 0.02, 0.06, 1.05)
    }

    fn test_marks(inclination_deg: f32, tilt_deg: f32) -> Vec<HeadingMark> {
        let mark = |i: u8| {
            let heading_rad = f32::from(i) / 12.0 * TAU;
            let (roll, pitch) = [(1.0, 0.3), (-1.0, -0.2), (0.2, 1.0), (-0.3, -1.0)][usize::from(i % 4)];
            let attitude = RollPitch::from_deg(tilt_deg * roll, tilt_deg * pitch);
            let level = Field::<Level>::earth_field(50.0, inclination_deg.to_radians(), heading_rad);
            let field = Field::new(soft_iron() * attitude.to_body_frame(level).ut + B_UT);
            HeadingMark { sample: Sample::new(field, attitude), heading_rad }
        };
        (0..12).map(mark).collect()
    }

    #[test]
    fn fields_unrelated_to_the_headings_are_rejected() {
        let scaled = |h0_ut: f32| -> Vec<HeadingMark> {
            let mark = |i: u8| {
                let heading_rad = f32::from(i) / 12.0 * TAU;
                let field = Field::from_ut(h0_ut * heading_rad.cos() + 9.0, -h0_ut * heading_rad.sin(), 40.0);
                let sample = Sample::new(field, RollPitch::default());
                HeadingMark { sample, heading_rad }
            };
            (0..12).map(mark).collect()
        };
        assert!(solve_compass_swing(&scaled(3.0), &Matrix3::identity(), None).is_ok());
        let open = Err(SolveError::NotDetermined(CollectionPart::MARKS));
        assert_eq!(solve_compass_swing(&scaled(0.3), &Matrix3::identity(), None).map(|_| ()), open);
        assert_eq!(solve_compass_swing(&[test_marks(60.0, 0.0)[2]; 6], &Matrix3::identity(), None).map(|_| ()), open);
    }
}
