//! Where a refinement begins.

use nalgebra::{Matrix3, SMatrix, SVector, Vector3};

use super::Vector13;
use crate::calibration::{Turns, two_plane};
use crate::frames::Field;

/// Unit of field and unknowns from the closed form.
pub fn two_plane_start(turns: Turns<'_>, rotation: &Matrix3<f32>) -> Option<(f32, Vector13)> {
    let planes = two_plane::solve(turns, rotation).ok()?;
    // Total field in units of H0.
    let total = libm::sqrt(1.0 + planes.tan_inclination * planes.tan_inclination);
    let w = planes.response_ut.try_inverse()? / total;
    let unit_ut = 1.0 / libm::cbrt(w.determinant());
    let inclination_rad = libm::atan(planes.tan_inclination);
    start(&(w * unit_ut).cast(), &(planes.b_ut / unit_ut).cast(), inclination_rad as f32)
        .filter(|_| unit_ut.is_finite() && unit_ut > 0.0)
        .map(|unknowns| (unit_ut as f32, unknowns))
}

/// Unit of field and unknowns from a sphere through all samples: hard iron only.
pub fn sphere_start(turns: Turns<'_>, rotation: &Matrix3<f32>) -> Option<(f32, Vector13)> {
    let fields = || turns.left.iter().chain(turns.right).map(|s| (rotation * s.field.ut, s));
    let number = fields().count() as f32;
    let mean = fields().map(|(f, _)| f).sum::<Vector3<f32>>() / number;
    // |m|^2 = 2 m . b + (r^2 - |b|^2), linear in b and the bracket; fields from their mean, for the digits.
    let mut normal = SMatrix::<f32, 4, 4>::zeros();
    let mut right = SVector::<f32, 4>::zeros();
    for (field, _) in fields() {
        let p = field - mean;
        let row = SVector::from([2.0 * p.x, 2.0 * p.y, 2.0 * p.z, 1.0]);
        normal += row * row.transpose();
        right += row * p.norm_squared();
    }
    let solution = normal.cast::<f64>().cholesky()?.solve(&right.cast::<f64>()).cast::<f32>();
    let centre = solution.fixed_rows::<3>(0).into_owned();
    let unit_ut = libm::sqrtf((solution[3] + centre.norm_squared()).max(1.0));
    let b_ut = mean + centre;
    let sin_dip = fields()
        .map(|(field, s)| {
            let level = s.attitude.level(Field::new(field - b_ut));
            level.ut.z / level.total_ut().max(1e-6)
        })
        .sum::<f32>()
        / number;
    start(&Matrix3::identity(), &(b_ut / unit_ut), libm::asinf(sin_dip.clamp(-1.0, 1.0)))
        .map(|unknowns| (unit_ut, unknowns))
}

fn start(w: &Matrix3<f32>, b: &Vector3<f32>, inclination_rad: f32) -> Option<Vector13> {
    let mut unknowns = Vector13::zeros();
    for i in 0..3 {
        for j in 0..3 {
            unknowns[3 * i + j] = w[(i, j)];
        }
        unknowns[9 + i] = b[i];
    }
    unknowns[12] = inclination_rad;
    unknowns.iter().all(|u| u.is_finite()).then_some(unknowns)
}
