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
    /// Of the fields of samples, rotated by `rotation` first. `None` if a field is not a finite number.
    #[inline(never)]
    pub fn through(samples: &Samples<'_>, rotation: &Matrix3<f32>) -> Option<Self> {
        let mut number = 0.0;
        let mut sum = Vector3::zeros();
        for sample in samples.iter() {
            number += 1.0;
            sum += rotation * sample.field.ut;
        }
        let origin_ut = sum / number;
        let mut scatter = Matrix3::zeros();
        for sample in samples.iter() {
            let from_origin = rotation * sample.field.ut - origin_ut;
            scatter += from_origin * from_origin.transpose();
        }
        // A bound on iterations, because the unbounded variant never ends on what is not finite.
        let eigen = SymmetricEigen::try_new(scatter, f32::EPSILON, 100)?;
        let smallest = eigen.eigenvalues.imin();
        let [normal, first, second] =
            [0, 1, 2].map(|step| eigen.eigenvectors.column((smallest + step) % 3).into_owned());
        Some(Self { origin_ut, normal, axes: [first, second], spread_ut: libm::sqrtf(scatter.trace() / number) })
    }

    /// Coordinates in the plane of a point in space.
    pub fn flat(&self, field_ut: &Vector3<f32>) -> Vector2<f32> {
        Vector2::from(self.axes.map(|axis| axis.dot(&(field_ut - self.origin_ut))))
    }
}
