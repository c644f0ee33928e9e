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

use nalgebra::{SVector, Vector3};

/// Number of unknowns.
pub(crate) const UNKNOWNS: usize = 13;
/// A value or a derivative for each unknown.
pub(crate) type Vector13 = SVector<f32, UNKNOWNS>;
/// A value for each two unknowns.
#[cfg(test)]
pub(in crate::calibration) type Matrix13 = nalgebra::SMatrix<f32, UNKNOWNS, UNKNOWNS>;

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

/// Pairs `(i, j)` with `i <= j` of three axes, and of the four components of `(x, 1)`: the rows of a triangle.
pub(in crate::calibration) const PAIRS_OF_3: [(usize, usize); 6] = [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)];
pub(in crate::calibration) const PAIRS_OF_4: [(usize, usize); 10] =
    [(0, 0), (0, 1), (0, 2), (0, 3), (1, 1), (1, 2), (1, 3), (2, 2), (2, 3), (3, 3)];

/// Index in the unknowns of what multiplies the `k`-th axis and the `a`-th component of `(x, 1)`.
pub(in crate::calibration) const fn of_product(k: usize, a: usize) -> usize {
    if a < 3 { w(k, a) } else { d(k) }
}

/// The derivative by the unknowns of what depends on one measurement: of `k . (W x + d)` and a multiple of `I`. It is
/// `k x^T` by `W`, `k` by `d`: seven numbers that make thirteen, of whose squares sixty are different.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Row {
    /// `k`, the derivative by the corrected field.
    pub by_field: Vector3<f32>,
    /// The measurement less the mean.
    pub x: Vector3<f32>,
    /// By `I`.
    pub by_inclination: f32,
}

impl Row {
    /// All thirteen.
    pub fn dense(&self) -> Vector13 {
        // Written out, for this is done twice for each sample and pass.
        let [a, b, c] = [self.by_field.x, self.by_field.y, self.by_field.z];
        let [x, y, z] = [self.x.x, self.x.y, self.x.z];
        let i = self.by_inclination;
        Vector13::from([a * x, a * y, a * z, b * x, b * y, b * z, c * x, c * y, c * z, a, b, c, i])
    }

    /// Adds `weight` times it to a sum.
    pub fn add_to(&self, sum: &mut Vector13, weight: f32) {
        let k = self.by_field * weight;
        for (axis, k) in [k.x, k.y, k.z].into_iter().enumerate() {
            sum[w(axis, 0)] += k * self.x.x;
            sum[w(axis, 1)] += k * self.x.y;
            sum[w(axis, 2)] += k * self.x.z;
            sum[d(axis)] += k;
        }
        sum[INCLINATION] += weight * self.by_inclination;
    }

    /// Its product with a change of the unknowns.
    pub fn dot(&self, change: &Vector13) -> f32 {
        let of = |axis: usize| {
            change[w(axis, 0)] * self.x.x
                + change[w(axis, 1)] * self.x.y
                + change[w(axis, 2)] * self.x.z
                + change[d(axis)]
        };
        let [a, b, c] = [self.by_field.x, self.by_field.y, self.by_field.z];
        a * of(0) + b * of(1) + c * of(2) + self.by_inclination * change[INCLINATION]
    }
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
        let row = Row { by_field: k, x, by_inclination: -2.0 };
        let expected = k.dot(&(matrix * x + vector)) - 2.0 * 23.0;
        assert!((row.dense().dot(&unknowns) - expected).abs() < 1e-6 && (row.dot(&unknowns) - expected).abs() < 1e-6);
        let mut sum = Vector13::repeat(1.0);
        row.add_to(&mut sum, 3.0);
        assert_eq!(sum, Vector13::repeat(1.0) + row.dense() * 3.0);
        let of_coefficients = coefficients_row(&k, &x).dot(&coefficients) - k.dot(&(matrix * x - vector));
        assert!(of_coefficients.abs() < 1e-6, "{of_coefficients}");
    }
}
