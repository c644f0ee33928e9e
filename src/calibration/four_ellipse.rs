//! Four ellipses: the method of Liu 2007 section 3, twelve coefficients from a left and a right turn.
//!
//! Each turn is split into two plane figures, (x, up) and (x, right); the [ellipse hypothesis](super::level) gives six
//! coefficients of each, 24 in all (eq. 9 to 12), from which eq. 13 assembles `A` and eq. 14 `b`. The hypothesis sets
//! the phases of the four ellipses to zero one by one, while in truth they are bound together by one airframe: that is
//! the method's error, 1.6 deg besides a constant on the paper's own aircraft. [Two planes](super::two_plane) leave
//! nothing out. Kept as the reference that everything here began with.
//!
//! The figures use the paper's axes, x forward, y up, z right: `(x, y, z)_paper = (x, -z, y)_FRD`, in which the body
//! field at pitch zero is `h = (Hx, s Hz + c Hy, c Hz - s Hy)` with `s, c` of the bank, right wing down positive, `(Hx,
//! Hz) = H0 (cos psi, -sin psi)` and `Hy` the vertical field, up. The coefficient of `Hz` in the up figure has the sign
//! of the bank, so up is turned round in the left turn: then all four maps keep the sense of rotation, as the
//! hypothesis wants.

use nalgebra::{Matrix3, Vector2, Vector3};

use super::level::Hypothesis;
use super::response::{Response, tangent};
use super::turns::{Bank, Centres, MIN_SAMPLES};
use super::{Part, Sample, Samples, Side, SolveError};

/// Solves left and right turns whose fields are rotated by `rotation` first. The vertical field is estimated from the
/// two turns, or follows from the inclination, radians, where it was told.
///
/// # Errors
///
/// [`SolveError::TooFewSamples`] and [`SolveError::NotAnEllipse`] name the turn they are about, and
/// [`SolveError::SamePlane`] says that the banks of the two are too much alike.
pub(super) fn solve(
    samples: Samples<'_>,
    rotation: &Matrix3<f32>,
    inclination_rad: Option<f32>,
) -> Result<Response, SolveError> {
    let left = Figures::new(samples.left, rotation, Side::Left, -1.0)?;
    let right = Figures::new(samples.right, rotation, Side::Right, 1.0)?;
    left.bank.sine_to(right.bank)?;
    // Eq. 13: A [2 0 0; 0 sl sr; 0 cl cr] = the coefficients, the common first column added up.
    let banks = Matrix3::new(2.0, 0.0, 0.0, 0.0, left.bank.sin, right.bank.sin, 0.0, left.bank.cos, right.bank.cos);
    let coefficients = Matrix3::from_columns(&[left.by_x + right.by_x, left.by_z, right.by_z]);
    let a_ut = coefficients * banks.try_inverse().ok_or(SolveError::SamePlane)?;
    // Eq. 14: c = b + A (0, c, -s) Hy.
    let by_vertical = |bank: Bank| a_ut * Vector3::new(0.0, bank.cos, -bank.sin);
    let centres = Centres {
        centres_ut: [left.centre_ut, right.centre_ut],
        by_vertical_ut: [by_vertical(left.bank), by_vertical(right.bank)],
    };
    let up = inclination_rad.map_or_else(|| centres.vertical(), |told_rad| -tangent(told_rad));
    let b_ut = centres.hard_iron_ut(up);
    // From the paper's axes to FRD.
    let paper = Matrix3::new(1.0, 0.0, 0.0, 0.0, 0.0, -1.0, 0.0, 1.0, 0.0);
    Ok(Response { a_ut: paper.tr_mul(&(a_ut * paper)), b_ut: paper.tr_mul(&b_ut), tan_inclination: -up })
}

/// The two figures of a turn, in the paper's axes.
struct Figures {
    bank: Bank,
    /// What (x, up, right) measure of `Hx`: the sum of the x of both figures is twice that, so x is their mean.
    by_x: Vector3<f32>,
    /// What they measure of `Hz`.
    by_z: Vector3<f32>,
    /// What they measure of neither.
    centre_ut: Vector3<f32>,
}

impl Figures {
    /// `up` is the sign of the up axis in its figure.
    fn new(samples: &[Sample], rotation: &Matrix3<f32>, side: Side, up: f32) -> Result<Self, SolveError> {
        let part = Part::Turns(side);
        SolveError::require(part, samples.len(), MIN_SAMPLES)?;
        let fields = samples.iter().map(|s| rotation * s.field.ut);
        let not_an_ellipse = SolveError::NotAnEllipse(part);
        let xy = Hypothesis::fit(fields.clone().map(|f| Vector2::new(f.x, -f.z * up))).ok_or(not_an_ellipse)?;
        let xz = Hypothesis::fit(fields.map(|f| f.xy())).ok_or(not_an_ellipse)?;
        // The first rows of both figures are two measurements of the same; eq. 13 and 14 take that of (x, up).
        let assemble = |of_xy: Vector2<f32>, of_xz: Vector2<f32>| Vector3::new(of_xy.x, of_xy.y * up, of_xz.y);
        Ok(Self {
            bank: Bank::mean_of(samples),
            by_x: assemble(xy.map_ut.column(0).into(), xz.map_ut.column(0).into()),
            by_z: assemble(xy.map_ut.column(1).into(), xz.map_ut.column(1).into()),
            centre_ut: assemble(xy.centre_ut, xz.centre_ut),
        })
    }
}
