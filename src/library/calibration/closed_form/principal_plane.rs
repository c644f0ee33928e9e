//! Principal plane of the fields of a turn.

use nalgebra::{Matrix3, Vector2, Vector3};

use crate::calibration::types::samples::Samples;
use crate::trig::{VectorLength as _, sqrt};

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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::calibration::Sample;
    use crate::calibration::tests::synthetic::{Parts, YAW_90};
    use crate::frames::{Field, RollPitch};

    fn plane_through(fields_ut: &[Vector3<f32>], rotation: &Matrix3<f32>) -> Option<PrincipalPlane> {
        let samples: Vec<_> = fields_ut.iter().map(|&ut| Sample::new(Field::new(ut), RollPitch::default())).collect();
        let (left, rest) = samples.split_at(1);
        let (right, level) = rest.split_at(1);
        PrincipalPlane::fit_plane(Parts { left, right, level, ..Parts::default() }.samples(), rotation)
    }

    #[test]
    fn the_plane_of_a_rectangle_is_found() {
        let origin = Vector3::new(1.0, 2.0, 40.0);
        let (first, second) = (Vector3::new(10.0, 0.0, 0.0), Vector3::new(0.0, 3.6, 4.8));
        let corners = [first + second, first - second, -first - second, second - first].map(|c| origin + c);
        let plane = plane_through(&corners, &Matrix3::identity()).unwrap();
        assert!((plane.origin_ut - origin).norm() < 1e-5, "{}", plane.origin_ut);
        assert!((plane.normal.dot(&Vector3::new(0.0, -0.8, 0.6)).abs() - 1.0).abs() < 1e-5, "{}", plane.normal);
        assert!((plane.rms_distance_from_mean_ut - 11.661_9).abs() < 1e-3, "{}", plane.rms_distance_from_mean_ut);
        let [x, y] = plane.plane_axes;
        assert!((x.norm() - 1.0).abs() < 1e-5 && (y.norm() - 1.0).abs() < 1e-5 && x.dot(&y).abs() < 1e-5);
        for corner in corners {
            let flat = plane.plane_coordinates(&corner);
            assert!((origin + x * flat.x + y * flat.y - corner).norm() < 1e-4, "{corner}");
        }
        assert!(plane.plane_coordinates(&(origin + plane.normal * 7.0)).norm() < 1e-5);

        let turned = plane_through(&corners, &YAW_90).unwrap();
        assert!((turned.origin_ut - Vector3::new(-2.0, 1.0, 40.0)).norm() < 1e-5, "{}", turned.origin_ut);
        assert!((turned.normal.dot(&Vector3::new(0.8, 0.0, 0.6)).abs() - 1.0).abs() < 1e-5, "{}", turned.normal);
    }

    #[test]
    fn the_plane_normal_is_the_axis_of_least_scatter() {
        let axes = [Vector3::new(0.6, 0.8, 0.0), Vector3::new(-0.64, 0.48, 0.6), Vector3::new(0.48, -0.36, 0.8)];
        for lengths in [[30.0, 15.0, 10.0], [10.0, 30.0, 15.0], [20.0, 0.0, 20.0], [5.0, 400.0, 5e-3]] {
            let fields: Vec<_> =
                axes.iter().zip(lengths).flat_map(|(axis, length)| [axis * length, -axis * length]).collect();
            let plane = plane_through(&fields, &Matrix3::identity()).unwrap();
            let shortest_axis = (0..3).min_by(|&a, &b| f32::total_cmp(&lengths[a], &lengths[b])).unwrap();
            assert!((plane.normal.dot(&axes[shortest_axis]).abs() - 1.0).abs() < 1e-5, "{lengths:?} {}", plane.normal);
            let [x, y] = plane.plane_axes;
            assert!((x.cross(&y) - plane.normal).norm() < 1e-5);
        }
    }

    #[test]
    fn a_line_has_one_of_its_planes() {
        let line = [-2.0, -1.0, 1.0, 2.0].map(|n| Vector3::new(0.6, 0.8, 0.0) * n);
        let normal = plane_through(&line, &Matrix3::identity()).unwrap().normal;
        assert!(normal.dot(&Vector3::new(0.6, 0.8, 0.0)).abs() < 1e-3 && (normal.norm() - 1.0).abs() < 1e-5);
    }

    #[test]
    fn a_point_and_non_finite_fields_have_no_plane() {
        let nan = [Vector3::x(), Vector3::y(), Vector3::new(f32::NAN, 0.0, 1.0)];
        assert!(plane_through(&nan, &Matrix3::identity()).is_none());
        assert!(plane_through(&[Vector3::new(1.0, 2.0, 3.0); 5], &Matrix3::identity()).is_none());
        assert!(PrincipalPlane::fit_plane(Samples::default(), &Matrix3::identity()).is_none());
    }
}
