//! Unknowns with a covariance that stays one: factors of it are kept, not itself.
//!
//! `P = U D U^T`, with `U` unit upper triangular and `D` diagonal. No rounding makes a `D` of positive numbers negative
//! here, so no variance ever is; a covariance kept as a matrix loses that within hours in `f32`. The updates are those
//! of G. J. Bierman, "Factorization Methods for Discrete Sequential Estimation" (1977): a measurement by his, noise by
//! Agee and Turner's (appendix III.C).

/// `N` unknowns: the most likely values, and how well they are known.
#[derive(Clone, Debug)]
pub(super) struct Factored<const N: usize> {
    mean: [f32; N],
    /// Rows; what is on the diagonal and below it is not used.
    upper: [[f32; N]; N],
    diagonal: [f32; N],
}

/// A scalar measurement: `residual = measured - predicted`, linear in the unknowns.
#[derive(Clone, Copy, Debug)]
pub(super) struct Measurement<const N: usize> {
    /// Derivative of the prediction by the unknowns.
    pub row: [f32; N],
    /// Measured less predicted.
    pub residual: f32,
    /// Variance of its noise; more than nothing.
    pub variance: f32,
}

impl<const N: usize> Factored<N> {
    /// Independent unknowns about zero, of these standard deviations.
    pub fn new(sigmas: &[f32; N]) -> Self {
        Self { mean: [0.0; N], upper: [[0.0; N]; N], diagonal: sigmas.map(|sigma| sigma * sigma) }
    }

    /// The most likely values.
    pub const fn mean(&self) -> &[f32; N] {
        &self.mean
    }

    /// Says anew what an unknown most likely is; how well it is known stays.
    pub fn set_mean(&mut self, index: usize, value: f32) {
        if let Some(mean) = self.mean.get_mut(index) {
            *mean = value;
        }
    }

    /// Whether all numbers are finite.
    pub fn is_finite(&self) -> bool {
        self.mean.iter().chain(&self.diagonal).chain(self.upper.as_flattened()).all(|x| x.is_finite())
    }

    /// Variance of `row . unknowns`: `sum d_j (U^T row)_j^2`, never negative.
    #[inline(never)]
    pub fn variance(&self, row: &[f32; N]) -> f32 {
        let squares = self.diagonal.iter().enumerate().map(|(j, d)| {
            let f = self.transposed_times(row, j);
            d * f * f
        });
        squares.sum()
    }

    /// Variance of one unknown.
    #[inline(never)]
    pub fn variance_of(&self, index: usize) -> f32 {
        let Some((row, own)) = self.upper.get(index).zip(self.diagonal.get(index)) else { return 0.0 };
        let others = row.iter().zip(&self.diagonal).skip(index + 1).map(|(u, d)| u * u * d);
        own + others.sum::<f32>()
    }

    /// Element `j` of `U^T row`.
    fn transposed_times(&self, row: &[f32; N], j: usize) -> f32 {
        row[j] + (0..j).map(|i| self.upper[i][j] * row[i]).sum::<f32>()
    }

    /// Learns from a measurement.
    #[inline(never)]
    pub fn learn(&mut self, measurement: &Measurement<N>) {
        let Measurement { row, residual, variance } = measurement;
        let f: [f32; N] = core::array::from_fn(|j| self.transposed_times(row, j));
        let mut gain = [0.0; N];
        // The variance of the residual, as far as the unknowns up to `j` and the noise make it.
        let mut before = *variance;
        for j in 0..N {
            let v = self.diagonal[j] * f[j];
            let after = before + f[j] * v;
            self.diagonal[j] *= before / after;
            let lambda = -f[j] / before;
            gain[j] = v;
            for (gain, row) in gain.iter_mut().zip(&mut self.upper).take(j) {
                let u = row[j];
                row[j] = u + lambda * *gain;
                *gain += v * u;
            }
            before = after;
        }
        let step = residual / before;
        for (mean, gain) in self.mean.iter_mut().zip(gain) {
            *mean += gain * step;
        }
    }

    /// An unknown has become less certain: adds to its variance. Its correlations stay.
    #[inline(never)]
    pub fn loosen(&mut self, index: usize, variance: f32) {
        let mut a: [f32; N] = core::array::from_fn(|i| if i == index { 1.0 } else { 0.0 });
        let mut weight = variance;
        for j in (0..=index.min(N - 1)).rev() {
            let (a_j, before) = (a[j], self.diagonal[j]);
            let after = before + weight * a_j * a_j;
            self.diagonal[j] = after;
            if after > 0.0 {
                let share = weight * a_j / after;
                for (a_i, row) in a.iter_mut().zip(&mut self.upper).take(j) {
                    *a_i -= a_j * row[j];
                    row[j] += share * *a_i;
                }
                weight *= before / after;
            }
        }
    }

    /// The unknown `to` grows by `factor` times the unknown `by`, which must come after it.
    pub fn carry(&mut self, to: usize, by: usize, factor: f32) {
        self.mean[to] += factor * self.mean[by];
        self.upper[to][by] += factor;
        for j in by + 1..N {
            self.upper[to][j] += factor * self.upper[by][j];
        }
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{SMatrix, SVector};
    use testkit::random::Random;

    use super::*;

    const N: usize = 5;
    type Matrix = SMatrix<f64, N, N>;
    type Vector = SVector<f64, N>;

    fn covariance(state: &Factored<N>) -> Matrix {
        let upper = Matrix::from_fn(|i, j| match i.cmp(&j) {
            core::cmp::Ordering::Less => f64::from(state.upper[i][j]),
            core::cmp::Ordering::Equal => 1.0,
            core::cmp::Ordering::Greater => 0.0,
        });
        upper * Matrix::from_diagonal(&Vector::from_fn(|i, _| f64::from(state.diagonal[i]))) * upper.transpose()
    }

    fn row(random: &mut Random) -> [f32; N] {
        core::array::from_fn(|_| random.uniform(-1.0, 1.0))
    }

    /// One after the other in `f64`, as a textbook has it: `K = P h / (h^T P h + r)`.
    struct Textbook {
        mean: Vector,
        covariance: Matrix,
    }

    impl Textbook {
        fn learn(&mut self, measurement: &Measurement<N>) {
            let h = Vector::from_fn(|i, _| f64::from(measurement.row[i]));
            let gain = self.covariance * h / (h.dot(&(self.covariance * h)) + f64::from(measurement.variance));
            self.mean += gain * f64::from(measurement.residual);
            self.covariance -= gain * (h.transpose() * self.covariance);
        }
    }

    /// Through measurements, noise and growth, against the textbook's formulas in `f64`.
    #[test]
    fn it_is_the_textbook_s_filter() {
        let mut random = Random(1);
        let sigmas = [1.0, 0.5, 2.0, 0.1, 1.5];
        let mut state = Factored::new(&sigmas);
        let mut textbook = Textbook {
            mean: Vector::zeros(),
            covariance: Matrix::from_diagonal(&Vector::from_fn(|i, _| f64::from(sigmas[i] * sigmas[i]))),
        };
        for step in 0..200_usize {
            let variance = random.uniform(0.05, 2.0);
            let measurement = Measurement { row: row(&mut random), residual: random.normal(), variance };
            state.learn(&measurement);
            textbook.learn(&measurement);
            let (index, noise) = (step % N, random.uniform(0.0, 0.1));
            state.loosen(index, noise);
            textbook.covariance[(index, index)] += f64::from(noise);
            state.carry(1, 3, 0.1);
            let mut growth = Matrix::identity();
            growth[(1, 3)] = f64::from(0.1_f32);
            textbook.mean = growth * textbook.mean;
            textbook.covariance = growth * textbook.covariance * growth.transpose();
            let difference = (covariance(&state) - textbook.covariance).norm() / textbook.covariance.norm();
            assert!(difference < 1e-4, "step {step}: {difference}");
            for i in 0..N {
                assert!((f64::from(state.mean()[i]) - textbook.mean[i]).abs() < 1e-4, "step {step}, unknown {i}");
            }
        }
        let h = row(&mut random);
        let exact = Vector::from_fn(|i, _| f64::from(h[i]));
        let exact = exact.dot(&(textbook.covariance * exact));
        assert!((f64::from(state.variance(&h)) / exact - 1.0).abs() < 1e-4);
        for i in 0..N {
            assert!((f64::from(state.variance_of(i)) / textbook.covariance[(i, i)] - 1.0).abs() < 1e-4);
        }
    }

    /// A day of precise measurements of almost the same, ten a second: a covariance kept as a matrix in `f32` turns
    /// negative within minutes of these.
    #[test]
    fn no_variance_is_ever_negative() {
        let mut random = Random(2);
        let mut state = Factored::<N>::new(&[10.0; N]);
        let mut h = [1.0, 1.0, 1.0, 1.0, 1.0];
        for step in 0..864_000_usize {
            h[step % N] = 1.0 + 1e-3 * random.uniform(-1.0, 1.0);
            state.learn(&Measurement { row: h, residual: 1e-3 * random.normal(), variance: 1e-8 });
            state.loosen(step % N, 1e-12);
            if step % 1000 == 0 {
                assert!(state.diagonal.iter().all(|d| *d >= 0.0) && state.is_finite(), "step {step}: {state:?}");
            }
        }
        assert!((0..N).all(|i| state.variance_of(i) > 0.0));
    }

    #[test]
    fn a_mean_is_set_and_what_is_no_number_is_seen() {
        let mut state = Factored::<N>::new(&[1.0; N]);
        state.set_mean(2, 3.0);
        assert_eq!(state.mean().map(f32::to_bits), [0.0, 0.0, 3.0, 0.0, 0.0].map(f32::to_bits));
        state.set_mean(N, 9.0);
        assert!(state.is_finite() && state.variance_of(N) == 0.0);
        state.set_mean(0, f32::NAN);
        assert!(!state.is_finite());
        let mut state = Factored::<N>::new(&[1.0; N]);
        state.loosen(1, f32::INFINITY);
        assert!(!state.is_finite());
    }
}
