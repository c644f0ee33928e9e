//! The ellipse of one turn: its plane in sensor space and the conic in that plane.

use nalgebra::{Matrix2, Matrix3, SVector, Vector2, Vector3};

use super::least_squares::LeastSquares;
use super::plane::Plane;
use super::{Part, Sample, Samples, Side, SolveError};

/// An ellipse in space: `centre + p` for all `p` of the plane with `p^T Q p = 1`.
#[derive(Clone, Debug)]
pub(super) struct Ellipse {
    /// Microtesla.
    pub centre_ut: Vector3<f32>,
    /// Unit normal of the plane.
    pub normal: Vector3<f32>,
    /// Two unit vectors that span the plane.
    axes: [Vector3<f32>; 2],
    /// `Q` in the coordinates of `axes`, 1/uT^2.
    form: Matrix2<f32>,
}

impl Ellipse {
    /// Fits a turn's samples, fields rotated by `rotation` first: the principal plane, and in it the conic.
    ///
    /// # Errors
    ///
    /// [`SolveError::NotFinite`] for fields that are not numbers, and [`SolveError::NotAnEllipse`] names the turn whose
    /// samples lie on another conic.
    pub fn fit(samples: &[Sample], rotation: &Matrix3<f32>, side: Side) -> Result<Self, SolveError> {
        let samples = Samples { left: samples, ..Samples::default() };
        let Some(plane) = Plane::through(&samples, rotation) else { return Err(SolveError::NotFinite) };
        // Points scaled to about 1, or the equations would mix units of 1 and uT^4.
        let scale = plane.spread_ut;
        let points = samples.iter().map(|s| plane.flat(&(rotation * s.field.ut)) / scale);
        let (centre, form) = conic(points).ok_or(SolveError::NotAnEllipse(Part::Turns(side)))?;
        Ok(Self {
            centre_ut: plane.origin_ut + (plane.axes[0] * centre.x + plane.axes[1] * centre.y) * scale,
            normal: plane.normal,
            axes: plane.axes,
            form: form / (scale * scale),
        })
    }

    /// Coordinates in the plane of a direction in space.
    fn flat(&self, direction: &Vector3<f32>) -> Vector2<f32> {
        Vector2::from(self.axes.map(|axis| axis.dot(direction)))
    }

    /// From the centre to the ellipse along a direction of the plane, microtesla.
    pub fn radius_ut(&self, direction: &Vector3<f32>) -> f32 {
        let flat = self.flat(direction);
        1.0 / libm::sqrtf(flat.dot(&(self.form * flat)))
    }

    /// The semi-axis conjugate to a direction of the plane: parallel to the tangents where the direction meets the
    /// ellipse. Either of its two signs.
    pub fn conjugate_ut(&self, direction: &Vector3<f32>) -> Vector3<f32> {
        let along = self.form * self.flat(direction);
        let across = Vector2::new(-along.y, along.x);
        let flat = across / libm::sqrtf(across.dot(&(self.form * across)));
        self.axes[0] * flat.x + self.axes[1] * flat.y
    }

    /// The phase of a field when the ellipse is `centre + u cos(phase) + v sin(phase)` with conjugate `u` and `v`.
    pub fn phase_rad(&self, field_ut: &Vector3<f32>, u_ut: &Vector3<f32>, v_ut: &Vector3<f32>) -> f32 {
        let weighted = self.form * self.flat(&(field_ut - self.centre_ut));
        libm::atan2f(self.flat(v_ut).dot(&weighted), self.flat(u_ut).dot(&weighted))
    }
}

/// Centre and form of the conic through points of a size of about one, `C1 x^2 + C2 y^2 + C3 xy + C4 x + C5 y = 1` by linear
/// least squares (Liu 2007 eq. 6); `None` if it is not an ellipse.
pub(super) fn conic(points: impl Iterator<Item = Vector2<f32>>) -> Option<(Vector2<f32>, Matrix2<f32>)> {
    let mut system = LeastSquares::<5, 1>::new();
    for p in points {
        system.add(&SVector::from([p.x * p.x, p.y * p.y, p.x * p.y, p.x, p.y]), [1.0], 1.0);
    }
    let c = system.solve()?;
    let form = Matrix2::new(c[0], c[2] / 2.0, c[2] / 2.0, c[1]);
    let centre = form.try_inverse()? * Vector2::new(c[3], c[4]) * -0.5;
    let form = form / (1.0 + centre.dot(&(form * centre)));
    let is_ellipse = form.determinant() > 0.0 && form.trace() > 0.0;
    is_ellipse.then_some((centre, form))
}
