//! Order of the unknowns and of the coefficients, defined only here.
//!
//! The corrected field in units of field is `W x + d`, with `x` the measured field minus the mean of all samples: the
//! thirteen *unknowns* are `W`, `d` and the inclination. In the units of a
//! [`Calibration`](crate::calibration::Calibration) it is `W x - beta`, with `x = (m - b) / F` and `beta = 0`: the
//! twelve *coefficients* are `W` and `beta`, whose errors change the corrected field.
//!
//! | index | unknown | coefficient |
//! |---|---|---|
//! | 0 to 8 | `W`, row by row | `W`, row by row |
//! | 9 to 11 | `d` | `beta` |
//! | 12 | `I`, the inclination | |

use nalgebra::{SVector, Vector3};

pub(crate) const UNKNOWN_COUNT: usize = 13;
pub(crate) type Vector13 = SVector<f32, UNKNOWN_COUNT>;
pub(in crate::calibration) const COEFFICIENT_COUNT: usize = 12;
pub(in crate::calibration) type Vector12 = SVector<f32, COEFFICIENT_COUNT>;

/// Index of an element of `W` in unknowns and coefficients. Rows are contiguous.
pub(in crate::calibration) const fn w_index(row: usize, column: usize) -> usize {
    3 * row + column
}

/// Index of a component of `d` in the unknowns. Contiguous.
pub(in crate::calibration) const fn corrected_mean_index(axis: usize) -> usize {
    w_index(3, axis)
}

pub(in crate::calibration) const INCLINATION_INDEX: usize = corrected_mean_index(3);

/// Index of a component of `beta` in the coefficients, equal to that of `d`.
pub(in crate::calibration) const fn beta_index(axis: usize) -> usize {
    corrected_mean_index(axis)
}

/// Row and column of an element of `W` by its index; `beta` is row 3, with its body axis as the column.
pub(in crate::calibration) const fn row_and_column(coefficient_index: usize) -> (usize, usize) {
    (coefficient_index / 3, coefficient_index % 3)
}

/// Index pairs `i <= j` of three axes: upper triangle, row by row.
pub(in crate::calibration) const UPPER_TRIANGLE_3: [(usize, usize); 6] =
    [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)];
/// Index pairs `i <= j` of the four components of `(x, 1)`: upper triangle, row by row.
pub(in crate::calibration) const UPPER_TRIANGLE_4: [(usize, usize); 10] =
    [(0, 0), (0, 1), (0, 2), (0, 3), (1, 1), (1, 2), (1, 3), (2, 2), (2, 3), (3, 3)];

/// Index of the unknown that multiplies axis `k` of the derivative and component `a` of `(x, 1)`.
pub(in crate::calibration) const fn unknown_index_of_product(k: usize, a: usize) -> usize {
    if a < 3 { w_index(k, a) } else { corrected_mean_index(k) }
}

/// Jacobian row of a function of one measurement, `k . (W x + d)` plus a multiple of `I`: `k x^T` by `W`, `k` by `d`.
/// Seven numbers instead of thirteen.
#[derive(Clone, Copy, Debug)]
pub(crate) struct JacobianRow {
    /// Derivative `k` of the function by the corrected field.
    pub derivative_by_field: Vector3<f32>,
    /// `x`: measured field minus the mean of all samples.
    pub centred_field: Vector3<f32>,
    pub derivative_by_inclination: f32,
}

impl JacobianRow {
    #[inline]
    pub fn as_vector(&self) -> Vector13 {
        // Unrolled: runs twice for each sample and pass.
        let [a, b, c] = [self.derivative_by_field.x, self.derivative_by_field.y, self.derivative_by_field.z];
        let [x, y, z] = [self.centred_field.x, self.centred_field.y, self.centred_field.z];
        let i = self.derivative_by_inclination;
        Vector13::from([a * x, a * y, a * z, b * x, b * y, b * z, c * x, c * y, c * z, a, b, c, i])
    }

    #[inline]
    pub fn add_scaled_to(&self, sum: &mut Vector13, weight: f32) {
        let k = self.derivative_by_field * weight;
        for (axis, k) in [k.x, k.y, k.z].into_iter().enumerate() {
            sum[w_index(axis, 0)] += k * self.centred_field.x;
            sum[w_index(axis, 1)] += k * self.centred_field.y;
            sum[w_index(axis, 2)] += k * self.centred_field.z;
            sum[corrected_mean_index(axis)] += k;
        }
        sum[INCLINATION_INDEX] += weight * self.derivative_by_inclination;
    }

    #[inline]
    pub fn dot(&self, change: &Vector13) -> f32 {
        let axis_term = |axis: usize| {
            change[w_index(axis, 0)] * self.centred_field.x
                + change[w_index(axis, 1)] * self.centred_field.y
                + change[w_index(axis, 2)] * self.centred_field.z
                + change[corrected_mean_index(axis)]
        };
        let [a, b, c] = [self.derivative_by_field.x, self.derivative_by_field.y, self.derivative_by_field.z];
        a * axis_term(0)
            + b * axis_term(1)
            + c * axis_term(2)
            + self.derivative_by_inclination * change[INCLINATION_INDEX]
    }
}

/// Jacobian row of `k . (W x - beta)` by the coefficients: `k x^T` by `W`, `-k` by `beta`.
pub(in crate::calibration) fn coefficient_jacobian_row(
    derivative_by_field: &Vector3<f32>,
    relative_field: &Vector3<f32>,
) -> Vector12 {
    let mut row = Vector12::zeros();
    for i in 0..3 {
        for j in 0..3 {
            row[w_index(i, j)] = derivative_by_field[i] * relative_field[j];
        }
        row[beta_index(i)] = -derivative_by_field[i];
    }
    row
}

#[cfg(test)]
pub(in crate::calibration) type Matrix13 = nalgebra::SMatrix<f32, UNKNOWN_COUNT, UNKNOWN_COUNT>;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_unknown_has_its_own_index() {
        let mut indices: Vec<usize> = (0..3).flat_map(|i| (0..3).map(move |j| w_index(i, j))).collect();
        indices.extend((0..3).map(corrected_mean_index));
        indices.push(INCLINATION_INDEX);
        assert_eq!(indices, (0..UNKNOWN_COUNT).collect::<Vec<_>>());
    }

    #[test]
    fn rows_are_derivatives_of_linear_functions() {
        let (k, x) = (Vector3::new(2.0, -3.0, 5.0), Vector3::new(0.5, 7.0, -11.0));
        let matrix = nalgebra::Matrix3::new(1.0, 2.0, 3.0, -4.0, 5.0, -6.0, 7.0, 8.0, 10.0);
        let vector = Vector3::new(13.0, -17.0, 19.0);
        let mut unknowns = Vector13::zeros();
        for i in 0..3 {
            for j in 0..3 {
                unknowns[w_index(i, j)] = matrix[(i, j)];
            }
            unknowns[corrected_mean_index(i)] = vector[i];
        }
        unknowns[INCLINATION_INDEX] = 23.0;
        let coefficients = Vector12::from_fn(|i, _| unknowns[i]);
        let row = JacobianRow { derivative_by_field: k, centred_field: x, derivative_by_inclination: -2.0 };
        let expected = k.dot(&(matrix * x + vector)) - 2.0 * 23.0;
        assert!(
            (row.as_vector().dot(&unknowns) - expected).abs() < 1e-6 && (row.dot(&unknowns) - expected).abs() < 1e-6
        );
        let mut sum = Vector13::repeat(1.0);
        row.add_scaled_to(&mut sum, 3.0);
        assert_eq!(sum, Vector13::repeat(1.0) + row.as_vector() * 3.0);
        let of_coefficients = coefficient_jacobian_row(&k, &x).dot(&coefficients) - k.dot(&(matrix * x - vector));
        assert!(of_coefficients.abs() < 1e-6, "{of_coefficients}");
    }
}
