//! The circle that a turn's samples run round, seen in their own plane: which heading sector a sample lies in.
//!
//! The heading is not known while a compass is being calibrated, and hard iron several times the horizontal field turns
//! the raw direction into a few degrees to and fro. What is known is that a turn at constant bank is a plane ellipse in
//! sensor space. So a side's samples are projected on their own principal plane, a circle is fitted there, and the angle
//! about its centre divides the turn into sectors. No axis convention enters: a wrongly configured mounting collects as
//! well as a right one.

use nalgebra::{Matrix3, SymmetricEigen, Vector2, Vector3};

use super::dataset::SECTORS;
use crate::calibration::{Sample, Samples};

/// A circle in the principal plane of a turn's samples.
#[derive(Clone, Copy, Debug)]
pub(super) struct Circle {
    /// A point of the plane: the samples' mean.
    origin_ut: Vector3<f32>,
    /// Two directions that span it.
    axes: [Vector3<f32>; 2],
    /// The centre, in the plane's coordinates.
    centre_ut: Vector2<f32>,
    pub radius_ut: f32,
}

impl Circle {
    /// Least squares of `x^2 + y^2 + a x + b y + c` (Kasa's fit) in the plane of the largest two principal axes. An arc
    /// is enough; `None` while there is no arc to speak of.
    pub fn through(samples: &Samples<'_>) -> Option<Self> {
        let fields = || samples.iter().map(|s| s.field.ut);
        let number = samples.iter().count() as f32;
        if number < 3.0 {
            return None;
        }
        let origin_ut = fields().sum::<Vector3<f32>>() / number;
        let scatter: Matrix3<f32> = fields().map(|f| (f - origin_ut) * (f - origin_ut).transpose()).sum();
        let axes = principal_axes(scatter)?;
        let mut normal = Matrix3::zeros();
        let mut right = Vector3::zeros();
        for field in fields() {
            let p = axes.map(|axis| axis.dot(&(field - origin_ut)));
            let row = Vector3::new(p[0], p[1], 1.0);
            normal += row * row.transpose();
            right -= row * (p[0] * p[0] + p[1] * p[1]);
        }
        let solution = normal.cholesky()?.solve(&right);
        let centre_ut = Vector2::new(-solution.x / 2.0, -solution.y / 2.0);
        let radius_ut = libm::sqrtf((centre_ut.norm_squared() - solution.z).max(0.0));
        radius_ut.is_finite().then_some(Self { origin_ut, axes, centre_ut, radius_ut })
    }

    /// Which sector a sample lies in, 0..[`SECTORS`].
    pub fn sector(&self, sample: &Sample) -> usize {
        let p = self.axes.map(|axis| axis.dot(&(sample.field.ut - self.origin_ut)));
        let angle_rad = libm::atan2f(p[1] - self.centre_ut.y, p[0] - self.centre_ut.x);
        let turns = angle_rad / core::f32::consts::TAU + 0.5;
        // The cast saturates and takes NaN to 0, so the index is in range for every input.
        ((turns * SECTORS as f32) as usize).min(SECTORS - 1)
    }
}

/// The eigenvectors of the two largest eigenvalues.
fn principal_axes(scatter: Matrix3<f32>) -> Option<[Vector3<f32>; 2]> {
    // A bound on iterations, because the unbounded variant never ends on what is not finite.
    let eigen = SymmetricEigen::try_new(scatter, f32::EPSILON, 100)?;
    let smallest = eigen.eigenvalues.imin();
    Some([1, 2].map(|step| eigen.eigenvectors.column((smallest + step) % 3).into_owned()))
}
