//! The plane that a turn's fields lie in.

use nalgebra::{Matrix3, SymmetricEigen, Vector2, Vector3};

use super::Samples;

/// The principal plane of some fields, microtesla.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Plane {
    /// The fields' mean.
    pub origin_ut: Vector3<f32>,
    /// Unit normal: the direction of the least scatter.
    pub normal: Vector3<f32>,
    /// Two unit vectors that span it.
    pub axes: [Vector3<f32>; 2],
    /// Root mean square of the distance from the mean.
    pub spread_ut: f32,
}

impl Plane {
    /// Of the fields of samples, rotated by `rotation` first. `None` without samples, or if a field is not a finite
    /// number.
    #[inline(never)]
    pub fn through(samples: &Samples<'_>, rotation: &Matrix3<f32>) -> Option<Self> {
        let fields_ut = || samples.iter().map(|sample| rotation * sample.field.ut);
        let number = fields_ut().count() as f32;
        let origin_ut = fields_ut().sum::<Vector3<f32>>() / number;
        let scatter = fields_ut().map(|ut| ut - origin_ut).map(|p| p * p.transpose()).sum::<Matrix3<f32>>();
        let spread_ut = libm::sqrtf(scatter.trace() / number);
        if !spread_ut.is_finite() {
            return None;
        }
        // A bound on iterations, because the unbounded variant never ends on what is not finite.
        let eigen = SymmetricEigen::try_new(scatter, f32::EPSILON, 100)?;
        let smallest = eigen.eigenvalues.imin();
        let [normal, first, second] =
            [0, 1, 2].map(|step| eigen.eigenvectors.column((smallest + step) % 3).into_owned());
        Some(Self { origin_ut, normal, axes: [first, second], spread_ut })
    }

    /// Coordinates in the plane of a point in space.
    pub fn flat(&self, field_ut: &Vector3<f32>) -> Vector2<f32> {
        Vector2::from(self.axes.map(|axis| axis.dot(&(field_ut - self.origin_ut))))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::calibration::{Rates, Sample};
    use crate::frames::{Attitude, Field};
    use crate::time::WrappingMillis;

    fn samples(fields_ut: &[Vector3<f32>]) -> Vec<Sample> {
        let sample = |&ut| Sample {
            field: Field::new(ut),
            attitude: Attitude::default(),
            time: WrappingMillis::default(),
            rates: Rates::NONE,
        };
        fields_ut.iter().map(sample).collect()
    }

    fn through(fields_ut: &[Vector3<f32>], rotation: &Matrix3<f32>) -> Option<Plane> {
        let samples = samples(fields_ut);
        // A part of them in each place: a plane goes through all.
        let (left, rest) = samples.split_at(1);
        let (right, level) = rest.split_at(1);
        Plane::through(&Samples { left, right, level, ..Samples::default() }, rotation)
    }

    /// Four corners of a rectangle of 20 by 12 uT about (1, 2, 40), in the plane of x and y + z.
    #[test]
    fn the_plane_of_a_rectangle_is_found() {
        let origin = Vector3::new(1.0, 2.0, 40.0);
        let (first, second) = (Vector3::new(10.0, 0.0, 0.0), Vector3::new(0.0, 3.6, 4.8));
        let corners = [first + second, first - second, -first - second, second - first].map(|c| origin + c);
        let plane = through(&corners, &Matrix3::identity()).unwrap();
        assert!((plane.origin_ut - origin).norm() < 1e-5, "{}", plane.origin_ut);
        assert!((plane.normal.dot(&Vector3::new(0.0, -0.8, 0.6)).abs() - 1.0).abs() < 1e-5, "{}", plane.normal);
        // The root of 10^2 + 6^2.
        assert!((plane.spread_ut - 11.661_9).abs() < 1e-3, "{}", plane.spread_ut);
        let [x, y] = plane.axes;
        assert!((x.norm() - 1.0).abs() < 1e-5 && (y.norm() - 1.0).abs() < 1e-5 && x.dot(&y).abs() < 1e-5);
        for corner in corners {
            let flat = plane.flat(&corner);
            assert!((origin + x * flat.x + y * flat.y - corner).norm() < 1e-4, "{corner}");
        }
        assert!(plane.flat(&(origin + plane.normal * 7.0)).norm() < 1e-5);

        let about_z = Matrix3::new(0.0, -1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0);
        let turned = through(&corners, &about_z).unwrap();
        assert!((turned.origin_ut - Vector3::new(-2.0, 1.0, 40.0)).norm() < 1e-5, "{}", turned.origin_ut);
        assert!((turned.normal.dot(&Vector3::new(0.8, 0.0, 0.6)).abs() - 1.0).abs() < 1e-5, "{}", turned.normal);
    }

    #[test]
    fn fields_that_are_no_numbers_have_no_plane() {
        let fields = [Vector3::x(), Vector3::y(), Vector3::new(f32::NAN, 0.0, 1.0)];
        assert!(through(&fields, &Matrix3::identity()).is_none());
        assert!(Plane::through(&Samples::default(), &Matrix3::identity()).is_none());
    }
}
