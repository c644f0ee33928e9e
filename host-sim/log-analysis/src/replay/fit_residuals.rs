//! Residuals of a corrected field that need no heading, and their derivatives.
//!
//! With constant iron the corrected fields `h = W (m - b)` have one strength `F` and one vertical component `F sin I`.

use nalgebra::{DVector, Matrix3, Vector3};

/// Number of unknowns of a fit: `W`, `b`, strength, vertical component.
pub(super) const FIT_UNKNOWNS: usize = 14;

/// Directions in which a change of the corrected field changes the two residuals: along the field, and down.
pub(super) fn residual_directions(field: Vector3<f64>, down: Vector3<f64>) -> [Vector3<f64>; 2] {
    [field.normalize(), down]
}

/// Derivatives of both residuals by the unknowns, at a raw field without hard iron.
pub(super) fn residual_derivatives(matrix: &Matrix3<f64>, raw: Vector3<f64>, down: Vector3<f64>) -> [DVector<f64>; 2] {
    let directions = residual_directions(matrix * raw, down);
    [0, 1].map(|residual_index| {
        let direction = directions[residual_index];
        let mut derivatives = DVector::zeros(FIT_UNKNOWNS);
        for i in 0..3 {
            for column_index in 0..3 {
                derivatives[3 * i + column_index] = direction[i] * raw[column_index];
            }
        }
        derivatives.rows_mut(9, 3).copy_from(&-(matrix.transpose() * direction));
        derivatives[12 + residual_index] = -1.0;
        derivatives
    })
}
