//! Four ellipses: the method of Liu 2007 section 3, twelve coefficients from a left and a right turn. Kept as the
//! reference.
//!
//! Each turn is split into two plane figures, (x, up) and (x, right). The ellipse hypothesis of level flight gives six
//! coefficients of each, 24 in all (eq. 9 to 12), from which eq. 13 assembles `A` and eq. 14 `b`. The hypothesis sets
//! the phases of the four ellipses to zero independently, although one airframe couples them: an error of 1.6 deg plus
//! a constant on the paper's aircraft. [Two planes](super::two_plane) avoid it.
//!
//! The figures use the paper's axes, x forward, y up, z right: `(x, y, z)_paper = (x, -z, y)_FRD`. At pitch zero the
//! body field is `h = (Hx, s Hz + c Hy, c Hz - s Hy)` with `s`, `c` of the bank (right wing down positive),
//! `(Hx, Hz) = H0 (cos psi, -sin psi)` and `Hy` the vertical field, up. The coefficient of `Hz` in the up figure has
//! the sign of the bank, so up is negated in the left turn: all four maps then preserve orientation, which the
//! hypothesis requires.

use nalgebra::{Matrix3, Vector2, Vector3};

use super::level_ellipse::EllipseMap;
use super::starting_point::{SensorResponse, inclination_tangent};
use super::turns::{MIN_SAMPLES, MeanBank, TurnCentres};
use crate::calibration::types::quality::SolveError;
use crate::calibration::types::samples::{CollectionPart, Samples};

/// Solves left and right turns; fields are rotated by `rotation` first. The vertical field is estimated from the two
/// turns unless an inclination (radians) is given.
///
/// # Errors
///
/// [`SolveError::TooFewSamples`] and [`SolveError::NotAnEllipse`] of a turn; [`SolveError::SamePlane`] when the banks
/// differ too little.
pub(in crate::calibration) fn solve_four_ellipse(
    samples: Samples<'_>,
    rotation: &Matrix3<f32>,
    inclination_rad: Option<f32>,
) -> Result<SensorResponse, SolveError> {
    let left_figures = TurnEllipsePair::new(samples, rotation, CollectionPart::LEFT, -1.0)?;
    let right_figures = TurnEllipsePair::new(samples, rotation, CollectionPart::RIGHT, 1.0)?;
    left_figures.bank.sine_of_difference(right_figures.bank)?;
    // Eq. 13: A [2 0 0; 0 sl sr; 0 cl cr] = coefficients, with the first columns of both turns added.
    let (left, right) = (left_figures.bank, right_figures.bank);
    let banks = Matrix3::new(2.0, 0.0, 0.0, 0.0, left.sin, right.sin, 0.0, left.cos, right.cos);
    let coefficients = Matrix3::from_columns(&[
        left_figures.response_to_x + right_figures.response_to_x,
        left_figures.response_to_z,
        right_figures.response_to_z,
    ]);
    let a_ut = coefficients * banks.try_inverse().ok_or(SolveError::SamePlane)?;
    // Eq. 14: c = b + A (0, c, -s) Hy.
    let by_vertical = |bank: MeanBank| a_ut * Vector3::new(0.0, bank.cos, -bank.sin);
    let centres = TurnCentres {
        centres_ut: [left_figures.centre_ut, right_figures.centre_ut],
        vertical_response_ut: [by_vertical(left), by_vertical(right)],
    };
    let vertical_field =
        inclination_rad.map_or_else(|| centres.vertical_field(), |given_rad| -inclination_tangent(given_rad));
    let b_ut = centres.hard_iron_ut(vertical_field);
    let paper = Matrix3::new(1.0, 0.0, 0.0, 0.0, 0.0, -1.0, 0.0, 1.0, 0.0);
    Ok(SensorResponse {
        response_ut: paper.tr_mul(&(a_ut * paper)),
        hard_iron_ut: paper.tr_mul(&b_ut),
        tan_inclination: -vertical_field,
    })
}

struct TurnEllipsePair {
    bank: MeanBank,
    /// Response of (x, up, right) to `Hx`.
    response_to_x: Vector3<f32>,
    /// Response to `Hz`.
    response_to_z: Vector3<f32>,
    centre_ut: Vector3<f32>,
}

impl TurnEllipsePair {
    /// `up_sign`: 1, or -1 to negate the up axis in its figure.
    fn new(
        turns: Samples<'_>,
        rotation: &Matrix3<f32>,
        part: CollectionPart,
        up_sign: f32,
    ) -> Result<Self, SolveError> {
        let samples = turns.samples_of_part(part);
        SolveError::require_samples(part, samples.iter().count(), MIN_SAMPLES)?;
        let fields = samples.iter().map(|sample| rotation * sample.field.ut);
        let not_an_ellipse = SolveError::NotAnEllipse(part);
        let xy = EllipseMap::fit_ellipse_map(fields.clone().map(|f| Vector2::new(f.x, -f.z * up_sign)))
            .ok_or(not_an_ellipse)?;
        let xz = EllipseMap::fit_ellipse_map(fields.map(|f| f.xy())).ok_or(not_an_ellipse)?;
        // Both figures contain x; eq. 13 and 14 use the x of (x, up).
        let assemble = |of_xy: Vector2<f32>, of_xz: Vector2<f32>| Vector3::new(of_xy.x, of_xy.y * up_sign, of_xz.y);
        Ok(Self {
            bank: MeanBank::from_samples(samples),
            response_to_x: assemble(xy.map_ut.column(0).into(), xz.map_ut.column(0).into()),
            response_to_z: assemble(xy.map_ut.column(1).into(), xz.map_ut.column(1).into()),
            centre_ut: assemble(xy.centre_ut, xz.centre_ut),
        })
    }
}
