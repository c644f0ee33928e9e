//! The order of the unknowns and of the coefficients. It is known here and nowhere else.
//!
//! The corrected field, in the unit of field, is `W x + d`, with `x` the measured field less the mean of all samples:
//! the thirteen *unknowns* are `W`, `d` and the inclination. In the units of a
//! [`Calibration`](crate::calibration::Calibration) it is `W x - beta`, with `x = (m - b) / F` and `beta = 0`: the
//! twelve *coefficients* are `W` and `beta`, whose errors move the corrected field.
//!
//! | index | unknown | coefficient |
//! |---|---|---|
//! | 0 to 8 | `W`, row by row | `W`, row by row |
//! | 9 to 11 | `d` | `beta` |
//! | 12 | `I`, the inclination | |

use nalgebra::{SMatrix, SVector, Vector3};

/// Number of unknowns.
pub(in crate::calibration) const UNKNOWNS: usize = 13;
/// A value or a derivative for each unknown.
pub(in crate::calibration) type Vector13 = SVector<f32, UNKNOWNS>;
/// A value for each two unknowns.
pub(in crate::calibration) type Matrix13 = SMatrix<f32, UNKNOWNS, UNKNOWNS>;

/// Number of coefficients.
pub(in crate::calibration) const COEFFICIENTS: usize = 12;
/// A value or a derivative for each coefficient.
pub(in crate::calibration) type Vector12 = SVector<f32, COEFFICIENTS>;

/// Index of an element of `W` in the unknowns and in the coefficients. A row of `W` is contiguous.
pub(in crate::calibration) const fn w(row: usize, column: usize) -> usize {
    3 * row + column
}

/// Index of a component of `d` in the unknowns. `d` is contiguous.
pub(in crate::calibration) const fn d(axis: usize) -> usize {
    w(3, axis)
}

/// Index of the inclination in the unknowns.
pub(in crate::calibration) const INCLINATION: usize = d(3);

/// Index of a component of `beta` in the coefficients: that of the `d` it comes from.
pub(in crate::calibration) const fn beta(axis: usize) -> usize {
    d(axis)
}

/// What a coefficient is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::calibration) enum Coefficient {
    /// An element of `W`.
    W {
        /// The body axis that it adds to.
        row: usize,
        /// The chip's axis that it takes from.
        column: usize,
    },
    /// A component of `beta`, by body axis.
    Beta(usize),
}

impl Coefficient {
    /// What is at an index of the coefficients: the inverse of [`w`] and [`beta`].
    pub const fn at(index: usize) -> Self {
        if index < beta(0) { Self::W { row: index / 3, column: index % 3 } } else { Self::Beta(index - beta(0)) }
    }
}

/// The derivative by the unknowns of `k . (W x + d)`: `k x^T` by `W`, `k` by `d`, none by `I`.
pub(in crate::calibration) fn unknowns_row(k: &Vector3<f32>, x: &Vector3<f32>) -> Vector13 {
    // Written out, for this is done twice for each sample and pass.
    let [a, b, c] = [k.x, k.y, k.z];
    let [x, y, z] = [x.x, x.y, x.z];
    Vector13::from([a * x, a * y, a * z, b * x, b * y, b * z, c * x, c * y, c * z, a, b, c, 0.0])
}

/// The derivative by the coefficients of `k . (W x - beta)`: `k x^T` by `W`, `-k` by `beta`.
pub(in crate::calibration) fn coefficients_row(k: &Vector3<f32>, x: &Vector3<f32>) -> Vector12 {
    let mut row = Vector12::zeros();
    for i in 0..3 {
        for j in 0..3 {
            row[w(i, j)] = k[i] * x[j];
        }
        row[beta(i)] = -k[i];
    }
    row
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_index_is_of_one_unknown() {
        let mut indices: Vec<usize> = (0..3).flat_map(|i| (0..3).map(move |j| w(i, j))).collect();
        indices.extend((0..3).map(d));
        indices.push(INCLINATION);
        assert_eq!(indices, (0..UNKNOWNS).collect::<Vec<_>>());
    }

    #[test]
    fn a_coefficient_is_found_where_it_is() {
        for i in 0..3 {
            for j in 0..3 {
                assert_eq!(Coefficient::at(w(i, j)), Coefficient::W { row: i, column: j });
            }
            assert_eq!(Coefficient::at(beta(i)), Coefficient::Beta(i));
        }
    }

    /// Both rows are of linear functions, so that a row times the unknowns is the function itself. Numbers that f32
    /// holds exactly.
    #[test]
    fn the_rows_are_those_of_their_functions() {
        let (k, x) = (Vector3::new(2.0, -3.0, 5.0), Vector3::new(0.5, 7.0, -11.0));
        let matrix = nalgebra::Matrix3::new(1.0, 2.0, 3.0, -4.0, 5.0, -6.0, 7.0, 8.0, 10.0);
        let vector = Vector3::new(13.0, -17.0, 19.0);
        let mut unknowns = Vector13::zeros();
        for i in 0..3 {
            for j in 0..3 {
                unknowns[w(i, j)] = matrix[(i, j)];
            }
            unknowns[d(i)] = vector[i];
        }
        unknowns[INCLINATION] = 23.0;
        let coefficients = Vector12::from_fn(|i, _| unknowns[i]);
        let of_unknowns = unknowns_row(&k, &x).dot(&unknowns) - k.dot(&(matrix * x + vector));
        let of_coefficients = coefficients_row(&k, &x).dot(&coefficients) - k.dot(&(matrix * x - vector));
        assert!(of_unknowns.abs() < 1e-6 && of_coefficients.abs() < 1e-6, "{of_unknowns} {of_coefficients}");
    }
}
