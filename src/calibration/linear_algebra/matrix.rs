//! 3x3 matrices.

use nalgebra::Matrix3;

/// Inverse of a 3x3 matrix, if it is regular.
pub(crate) fn inverse(m: &Matrix3<f32>) -> Option<Matrix3<f32>> {
    m.try_inverse()
}

pub(crate) fn matrix_rows(m: &Matrix3<f32>) -> [[f32; 3]; 3] {
    core::array::from_fn(|row| core::array::from_fn(|column| m[(row, column)]))
}
