//! 3x3 matrices.

use nalgebra::{Matrix3, Vector3};

/// Inverse of a 3x3 matrix, if it is regular.
pub(crate) fn inverse(m: &Matrix3<f32>) -> Option<Matrix3<f32>> {
    m.try_inverse()
}

/// Product of a matrix and a vector, in scalar expressions: optimised for size, nalgebra's is a loop of twice the time.
#[inline]
pub(crate) fn multiply(m: &Matrix3<f32>, v: &Vector3<f32>) -> Vector3<f32> {
    Vector3::new(
        m.m11 * v.x + m.m12 * v.y + m.m13 * v.z,
        m.m21 * v.x + m.m22 * v.y + m.m23 * v.z,
        m.m31 * v.x + m.m32 * v.y + m.m33 * v.z,
    )
}

pub(crate) fn matrix_rows(m: &Matrix3<f32>) -> [[f32; 3]; 3] {
    core::array::from_fn(|row| core::array::from_fn(|column| m[(row, column)]))
}
