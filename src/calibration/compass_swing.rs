//! Compass swing: coefficients from headings that somebody gives, the classical ground procedure (Liu 2007 ref. 2).
//!
//! With heading and attitude known, so is the Earth field in body axes, `h = C^T H0 (cos psi, -sin psi, D)`, and
//! `m = A h + b` is linear in the twelve coefficients: each axis of the sensor is a regression on the three components
//! of `h` and a constant, and all three share one 4 x 4 matrix. `D` is not known unless the inclination was told; it is
//! the one of a few values that leaves the smallest residual. On level ground the vertical response of the sensor cannot
//! be told from hard iron: it is then taken to be that of a sensor without soft iron.

use nalgebra::{Matrix3, Vector3, Vector4};

use super::least_squares::LeastSquares;
use super::response::{Response, tangent};
use super::{Mark, Part, SolveError};
use crate::frames::Field;
use crate::trig;

/// Marks needed: two horizontal responses and a constant for each axis, and one to show a slip of the pen.
const MIN_MARKS: usize = 4;

/// Weight of the assumption that there is no soft iron, beside one of every mark: decides only what the marks do not
/// show.
const RIDGE: f32 = 1e-3;

/// Inclinations tried, degrees. Where marks are tilted the refinement finds the right one; where they are not, it does
/// not matter.
const INCLINATIONS_DEG: [f32; 11] = [-75.0, -60.0, -45.0, -30.0, -15.0, 0.0, 15.0, 30.0, 45.0, 60.0, 75.0];

/// Solves marks whose fields are rotated by `rotation` first; the inclination in radians, where it was told.
///
/// # Errors
///
/// [`SolveError::TooFewSamples`], and [`SolveError::NotDetermined`] where the fields do not follow the headings. Both are
/// of [`Part::Marks`].
pub(super) fn solve(
    marks: &[Mark],
    rotation: &Matrix3<f32>,
    inclination_rad: Option<f32>,
) -> Result<Response, SolveError> {
    SolveError::require(Part::Marks, marks.len(), MIN_MARKS)?;
    let h0_ut = horizontal_ut(marks, rotation).ok_or(SolveError::NotDetermined(Part::Marks))?;
    let tried = INCLINATIONS_DEG.map(f32::to_radians);
    let inclinations_rad = inclination_rad.as_ref().map_or(&tried[..], core::slice::from_ref);
    inclinations_rad
        .iter()
        .filter_map(|&inclination_rad| regression(marks, rotation, tangent(inclination_rad), h0_ut))
        .min_by(|a, b| a.0.total_cmp(&b.0))
        .map(|(_, response)| response)
        .ok_or(SolveError::NotDetermined(Part::Marks))
}

/// The horizontal field, from how far the sensor's horizontal axes follow it: a regression without vertical field.
fn horizontal_ut(marks: &[Mark], rotation: &Matrix3<f32>) -> Option<f32> {
    let (_, response) = regression(marks, rotation, 0.0, 0.0)?;
    let horizontal = response.a_ut.fixed_view::<2, 2>(0, 0).determinant();
    Some(libm::sqrtf(horizontal.abs())).filter(|h0_ut| *h0_ut > 1.0)
}

/// Response at an inclination, and how little it explains the marks, in square microtesla.
fn regression(marks: &[Mark], rotation: &Matrix3<f32>, tan_inclination: f32, h0_ut: f32) -> Option<(f32, Response)> {
    let regressors = |mark: &Mark| {
        let (sin, cos) = trig::sin_cos(mark.heading_rad);
        let level = Field::from_ut(cos, -sin, tan_inclination);
        mark.sample.attitude.body(level).ut.push(1.0)
    };
    let field = |mark: &Mark| rotation * mark.sample.field.ut;
    let mean = marks.iter().map(field).sum::<Vector3<f32>>() / marks.len() as f32;
    let mut system = LeastSquares::<4, 3>::new();
    // The assumption: A times H0 is H0 times the unit matrix, nothing about b.
    for i in 0..3 {
        system.add(&Vector4::ith(i, 1.0), Vector3::ith(i, h0_ut).into(), RIDGE);
    }
    for mark in marks {
        system.add(&regressors(mark), (field(mark) - mean).into(), 1.0);
    }
    let solution = system.solve()?;
    let residual: f32 =
        marks.iter().map(|mark| (field(mark) - mean - solution.tr_mul(&regressors(mark))).norm_squared()).sum();
    let a_ut = solution.fixed_rows::<3>(0).transpose();
    let b_ut = solution.row(3).transpose() + mean;
    // On level ground all inclinations fit alike; then the least hard iron is the most likely.
    Some((residual + RIDGE * b_ut.norm_squared(), Response { a_ut, b_ut, tan_inclination }))
}
