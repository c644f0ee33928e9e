//! Ellipse fit of one turn: plane and conic.

use nalgebra::{Matrix2, Matrix3, SVector, Vector2, Vector3};

use crate::calibration::linear_algebra::LeastSquares;
use crate::calibration::types::quality::SolveError;
use crate::calibration::types::samples::{CollectionPart, Samples};
use crate::trig::{VectorLength as _, sqrt};

/// An ellipse in space: points `centre + p`, with `p` in the plane and `p^T Q p = 1`.
#[derive(Clone, Debug)]
pub(in crate::calibration) struct Ellipse {
    pub centre_ut: Vector3<f32>,
    pub normal: Vector3<f32>,
    plane_axes: [Vector3<f32>; 2],
    /// `Q` in the coordinates of `plane_axes`, 1/uT^2.
    quadratic_form: Matrix2<f32>,
}

impl Ellipse {
    /// Fits the principal plane of the samples of a turn and a conic in it; fields are rotated by `rotation` first.
    ///
    /// # Errors
    ///
    /// [`SolveError::NotFinite`] for non-finite fields, [`SolveError::NotAnEllipse`] for another conic.
    pub fn fit_ellipse(
        samples: Samples<'_>,
        rotation: &Matrix3<f32>,
        part: CollectionPart,
    ) -> Result<Self, SolveError> {
        let Some(plane) = PrincipalPlane::fit_plane(samples, rotation) else { return Err(SolveError::NotFinite) };
        // Scaled to about 1; otherwise the equations would mix magnitudes of 1 and uT^4.
        let scale = plane.rms_distance_from_mean_ut;
        let points = samples.iter().map(|sample| plane.plane_coordinates(&(rotation * sample.field.ut)) / scale);
        let (centre, quadratic_form) = fit_conic(points).ok_or(SolveError::NotAnEllipse(part))?;
        Ok(Self {
            centre_ut: plane.origin_ut + (plane.plane_axes[0] * centre.x + plane.plane_axes[1] * centre.y) * scale,
            normal: plane.normal,
            plane_axes: plane.plane_axes,
            quadratic_form: quadratic_form / (scale * scale),
        })
    }

    fn plane_coordinates(&self, direction: &Vector3<f32>) -> Vector2<f32> {
        Vector2::from(self.plane_axes.map(|axis| axis.dot(direction)))
    }

    /// Distance from the centre to the ellipse along a direction of the plane, microtesla.
    pub fn radius_ut(&self, direction: &Vector3<f32>) -> f32 {
        let direction_in_plane = self.plane_coordinates(direction);
        1.0 / sqrt(direction_in_plane.dot(&(self.quadratic_form * direction_in_plane)))
    }

    /// Semi-axis conjugate to a direction of the plane: parallel to the tangent where that meets the ellipse; arbitrary
    /// sign.
    pub fn conjugate_semi_axis_ut(&self, direction: &Vector3<f32>) -> Vector3<f32> {
        let form_times_direction = self.quadratic_form * self.plane_coordinates(direction);
        let conjugate_direction = Vector2::new(-form_times_direction.y, form_times_direction.x);
        let semi_axis =
            conjugate_direction / sqrt(conjugate_direction.dot(&(self.quadratic_form * conjugate_direction)));
        self.plane_axes[0] * semi_axis.x + self.plane_axes[1] * semi_axis.y
    }

    /// Phase of a field on the ellipse `centre + u cos(phase) + v sin(phase)` with conjugate `u` and `v`, radians.
    pub fn phase_rad(&self, field_ut: &Vector3<f32>, u_ut: &Vector3<f32>, v_ut: &Vector3<f32>) -> f32 {
        let weighted = self.quadratic_form * self.plane_coordinates(&(field_ut - self.centre_ut));
        libm::atan2f(self.plane_coordinates(v_ut).dot(&weighted), self.plane_coordinates(u_ut).dot(&weighted))
    }
}

/// Centre and matrix of the quadratic form of the conic `C1 x^2 + C2 y^2 + C3 xy + C4 x + C5 y = 1` by linear least
/// squares (Liu 2007 eq. 6), through points of magnitude about 1; `None` if it is not an ellipse.
pub(in crate::calibration) fn fit_conic(
    points: impl Iterator<Item = Vector2<f32>>,
) -> Option<(Vector2<f32>, Matrix2<f32>)> {
    let mut least_squares = LeastSquares::<5, 1>::new();
    for p in points {
        least_squares.add_weighted_row(&SVector::from([p.x * p.x, p.y * p.y, p.x * p.y, p.x, p.y]), [1.0], 1.0);
    }
    let c = least_squares.solve()?;
    let quadratic_form = Matrix2::new(c[0], c[2] / 2.0, c[2] / 2.0, c[1]);
    let centre = quadratic_form.try_inverse()? * Vector2::new(c[3], c[4]) * -0.5;
    let quadratic_form = quadratic_form / (1.0 + centre.dot(&(quadratic_form * centre)));
    let is_ellipse = quadratic_form.determinant() > 0.0 && quadratic_form.trace() > 0.0;
    is_ellipse.then_some((centre, quadratic_form))
}

#[derive(Clone, Copy, Debug)]
pub(crate) struct PrincipalPlane {
    pub origin_ut: Vector3<f32>,
    /// Unit normal: direction of least scatter.
    pub normal: Vector3<f32>,
    /// Two orthonormal vectors in the plane.
    pub plane_axes: [Vector3<f32>; 2],
    /// RMS distance of the fields from their mean.
    pub rms_distance_from_mean_ut: f32,
}

impl PrincipalPlane {
    /// Plane of the samples' fields, rotated by `rotation` first. `None` without samples or if not finite.
    pub fn fit_plane(samples: Samples<'_>, rotation: &Matrix3<f32>) -> Option<Self> {
        let fields_ut = || samples.iter().map(|sample| rotation * sample.field.ut);
        let field_count = fields_ut().count() as f32;
        let origin_ut = fields_ut().sum::<Vector3<f32>>() / field_count;
        let scatter = fields_ut().map(|ut| ut - origin_ut).map(|p| p * p.transpose()).sum::<Matrix3<f32>>();
        let spread_ut = sqrt(scatter.trace() / field_count);
        if !spread_ut.is_finite() {
            return None;
        }
        let normal = least_scatter_direction(&scatter)?;
        let first_axis = normal.cross(&Vector3::ith(normal.iamin(), 1.0)).unit_vector();
        Some(Self {
            origin_ut,
            normal,
            plane_axes: [first_axis, normal.cross(&first_axis)],
            rms_distance_from_mean_ut: spread_ut,
        })
    }

    pub fn plane_coordinates(&self, field_ut: &Vector3<f32>) -> Vector2<f32> {
        Vector2::from(self.plane_axes.map(|axis| axis.dot(&(field_ut - self.origin_ut))))
    }
}

/// Inverse iterations: converged in `f32` if the scatter off the plane is at most half of that in it.
const INVERSE_ITERATIONS: u8 = 16;

/// Unit vector of least scatter, by inverse iteration. nalgebra's eigendecomposition takes 2 KB of flash. `None`
/// without scatter.
fn least_scatter_direction(scatter: &Matrix3<f32>) -> Option<Vector3<f32>> {
    // Regularises a line, whose scatter is zero in two directions.
    let scaled = scatter / scatter.trace() + Matrix3::from_diagonal_element(f32::EPSILON);
    let [x, y, z] = [0, 1, 2].map(|i| scaled.column(i).into_owned());
    // Adjugate: inverse without division by the determinant, which is zero for a flat scatter.
    let scaled_inverse = Matrix3::from_columns(&[y.cross(&z), z.cross(&x), x.cross(&y)]);
    // The longest column is not orthogonal to the solution.
    let longest_column = scaled_inverse.column_iter().max_by(|a, b| a.norm_squared().total_cmp(&b.norm_squared()))?;
    let least_scatter = (0..INVERSE_ITERATIONS)
        .fold(longest_column.unit_vector(), |direction, _| (scaled_inverse * direction).unit_vector());
    least_scatter.iter().all(|component| component.is_finite()).then_some(least_scatter)
}
