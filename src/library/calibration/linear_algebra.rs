//! 3x3 matrices and linear least squares in `f32`, one equation at a time.
//!
//! Normal equations square the range of magnitudes: where the samples have a million times more information in one
//! direction than the priors in another, `f32` loses the weaker one, and a product in `f64` takes a hundred
//! instructions without hardware support. So equations are rotated into a triangle by square-root-free Givens rotations
//! (W. M. Gentleman, "Least squares computations by Givens transformations without square roots", J. Inst. Maths
//! Applics 12, 1973). nalgebra factorises complete matrices only. Where digits do not matter, the triangle can be made
//! from normal equations.

use nalgebra::{Matrix3, SMatrix, SVector, Vector3};

/// Triangular system `D (U x - t)` of `N` unknowns and `M` right-hand sides: `D` `diagonal`, `U` unit `upper`
/// triangular, `t` `right_sides`.
#[derive(Clone, Debug)]
pub(crate) struct LeastSquares<const N: usize, const M: usize> {
    diagonal: [f32; N],
    /// Only elements above the diagonal are used.
    upper: [[f32; N]; N],
    right_sides: [[f32; M]; N],
}

impl<const N: usize, const M: usize> LeastSquares<N, M> {
    pub const fn new() -> Self {
        Self { diagonal: [0.0; N], upper: [[0.0; N]; N], right_sides: [[0.0; M]; N] }
    }

    /// Factorises normal equations: the upper triangle of the information, and the right-hand sides. A direction below
    /// `f32` resolution stays undetermined until further equations are added.
    pub fn from_normal_equations(information: [[f32; N]; N], right_sides: [[f32; M]; N]) -> Self {
        /// Relative rounding error of a diagonal element: a few units in the last place.
        const RELATIVE_ROUNDING: f32 = 2e-6;
        let mut system = Self { diagonal: [0.0; N], upper: information, right_sides };
        for k in 0..N {
            let pivot = system.upper[k][k];
            // The rows before have been eliminated: the pivot is the remaining information.
            if pivot.is_nan() || pivot <= RELATIVE_ROUNDING * information[k][k] {
                system.upper[k] = [0.0; N];
                system.right_sides[k] = [0.0; M];
                continue;
            }
            system.diagonal[k] = pivot;
            for column in k + 1..N {
                system.upper[k][column] /= pivot;
            }
            system.right_sides[k] = system.right_sides[k].map(|t| t / pivot);
            let (eliminated_rows, lower_rows) = system.upper.split_at_mut(k + 1);
            let row = &eliminated_rows[k];
            for (j, lower_row) in lower_rows.iter_mut().enumerate() {
                let j = k + 1 + j;
                let factor = row[j] * pivot;
                for (element, u) in lower_row[j..].iter_mut().zip(&row[j..]) {
                    *element -= factor * u;
                }
                for m in 0..M {
                    system.right_sides[j][m] -= factor * system.right_sides[k][m];
                }
            }
        }
        system
    }

    pub fn from_rows(rows: impl Iterator<Item = SVector<f32, N>>, value: [f32; M]) -> Self {
        let mut information = [[0.0; N]; N];
        let mut right_sides = [[0.0; M]; N];
        for row in rows {
            for (i, (sums, right_sides)) in information.iter_mut().zip(&mut right_sides).enumerate() {
                for (sum, x) in sums[i..].iter_mut().zip(&row.as_slice()[i..]) {
                    *sum += row[i] * x;
                }
                for (sum, value) in right_sides.iter_mut().zip(value) {
                    *sum += row[i] * value;
                }
            }
        }
        Self::from_normal_equations(information, right_sides)
    }

    /// Adds the equation `row . x = value`; the weight is the inverse variance.
    pub fn add_weighted_row(&mut self, row: &SVector<f32, N>, mut values: [f32; M], mut weight: f32) {
        let mut row: [f32; N] = (*row).into();
        for k in 0..N {
            let x = row[k];
            let Some(shares) = self.rotation_coefficients(k, x, &mut weight) else { continue };
            // Slices of equal length, so that the loop has no bounds checks.
            for (r, u) in row[k + 1..].iter_mut().zip(&mut self.upper[k][k + 1..]) {
                rotate_row(r, u, x, shares);
            }
            for (value, t) in values.iter_mut().zip(&mut self.right_sides[k]) {
                rotate_row(value, t, x, shares);
            }
        }
    }

    /// Rotation coefficients of row `k` and the equation; `None` if the equation has no weight or a zero in this
    /// column.
    fn rotation_coefficients(&mut self, k: usize, x: f32, weight: &mut f32) -> Option<[f32; 2]> {
        let weighted_element = *weight * x;
        if weighted_element == 0.0 {
            return None;
        }
        let old_diagonal = self.diagonal[k];
        let new_diagonal = old_diagonal + weighted_element * x;
        self.diagonal[k] = new_diagonal;
        let retained_ratio = old_diagonal / new_diagonal;
        *weight *= retained_ratio;
        Some([retained_ratio, weighted_element / new_diagonal])
    }

    /// Solution; `None` if an unknown is undetermined or not finite.
    pub fn solve(&self) -> Option<SMatrix<f32, N, M>> {
        let mut solution = SMatrix::<f32, N, M>::zeros();
        for k in (0..N).rev() {
            if self.diagonal[k].is_nan() || self.diagonal[k] <= 0.0 {
                return None;
            }
            for m in 0..M {
                let solved_sum: f32 = (k + 1..N).map(|j| self.upper[k][j] * solution[(j, m)]).sum();
                solution[(k, m)] = self.right_sides[k][m] - solved_sum;
            }
        }
        solution.iter().all(|x| x.is_finite()).then_some(solution)
    }

    /// Covariance of the unknowns `(U^T D U)^-1` times a vector. The matrix would take ten times the memory.
    pub fn covariance_times(&self, vector: &SVector<f32, N>) -> Option<SVector<f32, N>> {
        let mut x = *vector;
        for k in 0..N {
            for j in k + 1..N {
                x[j] -= self.upper[k][j] * x[k];
            }
        }
        for k in (0..N).rev() {
            let solved_sum: f32 = (k + 1..N).map(|j| self.upper[k][j] * x[j]).sum();
            x[k] = x[k] / self.diagonal[k] - solved_sum;
        }
        x.iter().all(|x| x.is_finite()).then_some(x)
    }

    /// Variances of two linear functions of the unknowns `vector . x`, `v^T (U^T D U)^-1 v`, in one pass; infinite if
    /// undetermined.
    pub fn variance_pair(&self, vectors: [&SVector<f32, N>; 2]) -> [f32; 2] {
        // The two arrays are interleaved, so that the inner loop has one address for both.
        let mut pairs: [[f32; 2]; N] = core::array::from_fn(|i| [vectors[0][i], vectors[1][i]]);
        let mut variances = [0.0; 2];
        for k in 0..N {
            let pair = pairs[k];
            for (variance, element) in variances.iter_mut().zip(&pair) {
                if *element != 0.0 {
                    *variance += element * element / self.diagonal[k];
                }
            }
            for ([r, s], u) in pairs[k + 1..].iter_mut().zip(&self.upper[k][k + 1..]) {
                *r -= pair[0] * u;
                *s -= pair[1] * u;
            }
        }
        variances
    }

    pub fn information_diagonal(&self) -> SVector<f32, N> {
        SVector::from_fn(|i, _| {
            self.diagonal[i] + (0..i).map(|k| self.diagonal[k] * self.upper[k][i] * self.upper[k][i]).sum::<f32>()
        })
    }
}

#[inline]
fn rotate_row(
    equation_element: &mut f32,
    triangle_element: &mut f32,
    pivot_element: f32,
    [retained_ratio, gain]: [f32; 2],
) {
    let old_element = *equation_element;
    *equation_element -= pivot_element * *triangle_element;
    *triangle_element = retained_ratio * *triangle_element + gain * old_element;
}

/// Faster rotation, for rows with prior information. Loses digits of the equation when the row's diagonal element is
/// nearly zero.
#[inline]
fn rotate_fast(equation_element: &mut f32, triangle_element: &mut f32, pivot_element: f32, gain: f32) {
    *equation_element -= pivot_element * *triangle_element;
    *triangle_element += gain * *equation_element;
}

impl<const N: usize> LeastSquares<N, 1> {
    /// Adds two equations in one pass, in two thirds of the time. Every unknown must already have information, such as
    /// a prior.
    pub fn add_weighted_row_pair(&mut self, rows: [&SVector<f32, N>; 2], mut values: [f32; 2], mut weights: [f32; 2]) {
        // The two arrays are interleaved, so that the inner loop has one address for both.
        let mut pairs: [[f32; 2]; N] = core::array::from_fn(|i| [rows[0][i], rows[1][i]]);
        for k in 0..N {
            let [x, y] = pairs[k];
            let [_, gain_x] = self.rotation_coefficients(k, x, &mut weights[0]).unwrap_or_default();
            let [_, gain_y] = self.rotation_coefficients(k, y, &mut weights[1]).unwrap_or_default();
            for ([r, s], u) in pairs[k + 1..].iter_mut().zip(&mut self.upper[k][k + 1..]) {
                rotate_fast(r, u, x, gain_x);
                rotate_fast(s, u, y, gain_y);
            }
            let [r, s] = &mut values;
            rotate_fast(r, &mut self.right_sides[k][0], x, gain_x);
            rotate_fast(s, &mut self.right_sides[k][0], y, gain_y);
        }
    }

    /// Moves the origin to the solution: the remaining step is zero.
    pub const fn reset_origin(&mut self) {
        self.right_sides = [[0.0; 1]; N];
    }

    /// Reduction of half the weighted sum of squares by a step from the origin, to first order.
    pub fn predicted_reduction(&self, change: &SVector<f32, N>) -> f32 {
        let reduction_of_row = |k: usize| {
            let row_change = change[k] + (k + 1..N).map(|j| self.upper[k][j] * change[j]).sum::<f32>();
            self.diagonal[k] * self.right_sides[k][0] * row_change
        };
        0.5 * (0..N).map(reduction_of_row).sum::<f32>()
    }
}

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

#[cfg(test)]
mod tests {
    use nalgebra::{Matrix3, Vector3};

    use super::*;

    #[test]
    fn a_variance_is_the_covariance_between_a_vector_and_itself() {
        let mut system = LeastSquares::<3, 1>::new();
        for (row, weight) in [([1.0, 2.0, 0.5], 2.0), ([0.0, -1.0, 3.0], 0.5), ([4.0, 0.0, 1.0], 1.0)] {
            system.add_weighted_row(&SVector::from(row), [0.0], weight);
        }
        for vector in [[1.0, 0.0, 0.0], [0.0, 2.0, -1.0], [0.3, 0.2, 0.1]].map(SVector::from) {
            let whole = vector.dot(&system.covariance_times(&vector).unwrap());
            assert!((system.variance_pair([&vector; 2])[1] / whole - 1.0).abs() < 1e-5, "{whole}");
        }
        let mut open = LeastSquares::<3, 1>::new();
        open.add_weighted_row(&SVector::from([1.0, 0.0, 0.0]), [0.0], 4.0);
        let [known, unknown] = [[2.0, 0.0, 0.0], [0.0, 1.0, 0.0]].map(SVector::from);
        let [of_known, of_unknown] = open.variance_pair([&known, &unknown]);
        assert!((of_known - 1.0).abs() < 1e-6 && of_unknown.is_infinite());
    }

    /// The condition of the information is 10^7, too large for normal equations in `f32`.
    #[test]
    fn nearly_parallel_equations_keep_their_digits() {
        let true_unknowns = Vector3::new(2.0, -3.0, 0.5);
        let rows = [[1.0, 1.0, 0.2], [1.0, 1.001, -0.4], [1.001, 1.0, 0.9], [0.3, 0.3, 1.0], [1.0, 1.0, -1.0]];
        let mut system = LeastSquares::<3, 1>::new();
        for row in rows.map(Vector3::from) {
            // In `f64`, so that the equations are consistent to the last digit of `f32`.
            system.add_weighted_row(&row, [row.cast::<f64>().dot(&true_unknowns.cast()) as f32], 1e6);
        }
        let error = (system.solve().unwrap() - true_unknowns).norm();
        assert!(error < 5e-3, "{error}");
    }

    #[test]
    fn a_tiny_first_pivot_costs_no_precision() {
        let true_unknowns = Vector3::new(2.0, -3.0, 0.5);
        for tiny in [1e-15, 1e-8, 1e-4, 0.1] {
            let rows = [[tiny, 1.0, 0.2], [1.0, 0.5, -0.4], [0.7, 1.0, 0.9]].map(Vector3::from);
            let mut system = LeastSquares::<3, 1>::new();
            for row in rows {
                system.add_weighted_row(&row, [row.dot(&true_unknowns)], 1.0);
            }
            let error = (system.solve().unwrap() - true_unknowns).norm();
            assert!(error < 1e-5, "{tiny}: {error}");
        }
    }

    #[test]
    fn weights_covariance_and_gain_are_those_of_the_normal_equations() {
        let rows = [[1.0, 0.5, 0.2], [0.0, 2.0, -1.0], [0.3, 0.1, 1.5], [1.0, 0.0, 1.0]].map(Vector3::from);
        let (values, weights) = ([1.0, -2.0, 0.5, 0.7], [1.0, 4.0, 0.25, 2.0]);
        let mut system = LeastSquares::<3, 1>::new();
        let mut information = Matrix3::zeros();
        let mut right = Vector3::zeros();
        let mut in_pairs = LeastSquares::<3, 1>::new();
        for i in [0, 2] {
            in_pairs.add_weighted_row_pair(
                [&rows[i], &rows[i + 1]],
                [values[i], values[i + 1]],
                [weights[i], weights[i + 1]],
            );
        }
        for ((row, value), weight) in rows.into_iter().zip(values).zip(weights) {
            system.add_weighted_row(&row, [value], weight);
            information += row * row.transpose() * weight;
            right += row * (value * weight);
        }
        let inverse = information.try_inverse().unwrap();
        assert!((system.solve().unwrap() - inverse * right).norm() < 1e-5);
        assert!((in_pairs.solve().unwrap() - inverse * right).norm() < 1e-5);
        for column in 0..3 {
            let unit = Matrix3::identity().column(column).into_owned();
            assert!((system.covariance_times(&unit).unwrap() - inverse.column(column)).norm() < 1e-5);
        }
        assert!((system.information_diagonal() - information.diagonal()).norm() < 1e-5);
        let change = Vector3::new(0.1, -0.2, 0.3);
        assert!((system.predicted_reduction(&change) - 0.5 * change.dot(&right)).abs() < 1e-5);
    }

    /// A third column parallel to the first is undetermined until another equation is added.
    #[test]
    fn normal_equations_make_the_same_triangle() {
        let rows = [[1.0, 0.5, 0.2], [0.0, 2.0, -1.0], [0.3, 0.1, 1.5], [1.0, 0.0, 1.0]].map(Vector3::from);
        for (third, is_open) in [(1.0, false), (0.0, true)] {
            let mut rotated = LeastSquares::<3, 1>::new();
            let (mut information, mut right) = ([[0.0; 3]; 3], [[0.0; 1]; 3]);
            for (row, value) in rows.iter().zip([1.0, -2.0, 0.5, 0.7]) {
                let row = Vector3::new(row.x, row.y, third * row.z + 0.7 * row.x);
                rotated.add_weighted_row(&row, [value], 3.0);
                for i in 0..3 {
                    right[i][0] += 3.0 * row[i] * value;
                    for j in i..3 {
                        information[i][j] += 3.0 * row[i] * row[j];
                    }
                }
            }
            let mut summed = LeastSquares::from_normal_equations(information, right);
            assert_eq!(summed.solve().is_none(), is_open);
            let last = Vector3::new(0.0, 0.0, 1.0);
            rotated.add_weighted_row(&last, [2.0], 0.1);
            summed.add_weighted_row(&last, [2.0], 0.1);
            let (found, expected) = (summed.solve().unwrap(), rotated.solve().unwrap());
            assert!((found - expected).norm() < 1e-4, "{found} {expected}");
            summed.reset_origin();
            assert_eq!(summed.solve().unwrap(), Vector3::zeros());
        }
    }

    #[test]
    fn undetermined_system_has_no_solution() {
        let mut system = LeastSquares::<3, 1>::new();
        assert!(system.solve().is_none());
        system.add_weighted_row(&Vector3::new(1.0, 0.0, 0.0), [1.0], 1.0);
        system.add_weighted_row(&Vector3::new(1.0, 1.0, 0.0), [f32::NAN], 1.0);
        system.add_weighted_row(&Vector3::new(0.0, 0.0, 1.0), [1.0], 1.0);
        assert!(system.solve().is_none());
    }
}
