//! Kalman filter state with UD-factorised covariance.
//!
//! `P = U D U^T`, with `U` unit upper triangular and `D` diagonal. Rounding cannot make an element of `D` negative,
//! hence no variance; a covariance matrix in `f32` loses that property within hours. Source: G. J. Bierman,
//! "Factorization Methods for Discrete Sequential Estimation" (1977): his measurement update, and the Agee-Turner
//! rank-one update (appendix III.C) for process noise.

#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct UdFilter<const N: usize> {
    mean: [f32; N],
    /// `U` by rows; elements on and below the diagonal are unused.
    upper: [[f32; N]; N],
    diagonal: [f32; N],
}

#[derive(Clone, Copy, Debug)]
pub(super) struct Measurement<const N: usize> {
    pub jacobian: [f32; N],
    pub residual: f32,
    /// Noise variance; must be positive.
    pub variance: f32,
}

impl<const N: usize> UdFilter<N> {
    pub fn new(sigmas: &[f32; N]) -> Self {
        Self { mean: [0.0; N], upper: [[0.0; N]; N], diagonal: sigmas.map(|sigma| sigma * sigma) }
    }

    pub const fn mean(&self) -> &[f32; N] {
        &self.mean
    }

    pub fn set_mean(&mut self, index: usize, value: f32) {
        if let Some(mean) = self.mean.get_mut(index) {
            *mean = value;
        }
    }

    pub fn is_finite(&self) -> bool {
        // Zero times infinity or NaN is NaN, and so is the sum: half the time of a test of each element.
        let mut sum: f32 = self.mean.iter().chain(&self.diagonal).map(|x| x * 0.0).sum();
        for (used_from, row) in (1..).zip(&self.upper) {
            sum += row.iter().skip(used_from).map(|x| x * 0.0).sum::<f32>();
        }
        sum.is_finite()
    }

    /// Mean of `row . states`.
    pub fn projected_mean(&self, row: &[f32; N]) -> f32 {
        row.iter().zip(&self.mean).map(|(d, mean)| d * mean).sum()
    }

    /// Variance of `row . states`: `sum d_j (U^T row)_j^2`, never negative.
    pub fn projected_variance(&self, row: &[f32; N]) -> f32 {
        let length = nonzero_length(row);
        let squares = self.diagonal.iter().enumerate().map(|(j, d)| {
            let f = self.u_transposed_times(row, length, j);
            d * f * f
        });
        squares.sum()
    }

    pub fn state_variance(&self, index: usize) -> f32 {
        let Some((row, variance)) = self.upper.get(index).zip(self.diagonal.get(index)) else { return 0.0 };
        let later_terms = row.iter().zip(&self.diagonal).skip(index + 1).map(|(u, d)| u * u * d);
        variance + later_terms.sum::<f32>()
    }

    /// Element `j` of `U^T row`, for a row that is zero from `length` on.
    fn u_transposed_times(&self, row: &[f32; N], length: usize, j: usize) -> f32 {
        row[j] + (0..j.min(length)).map(|i| self.upper[i][j] * row[i]).sum::<f32>()
    }

    /// Measurement update (Bierman).
    pub fn apply_measurement(&mut self, measurement: &Measurement<N>) {
        let Measurement { jacobian: row, residual, variance } = measurement;
        let length = nonzero_length(row);
        let f: [f32; N] = core::array::from_fn(|j| self.u_transposed_times(row, length, j));
        let mut gain = [0.0; N];
        // Innovation variance from noise and states up to `j`.
        let mut innovation_variance = *variance;
        for j in 0..N {
            let v = self.diagonal[j] * f[j];
            let next_variance = innovation_variance + f[j] * v;
            self.diagonal[j] *= innovation_variance / next_variance;
            let lambda = -f[j] / innovation_variance;
            gain[j] = v;
            for (gain, row) in gain.iter_mut().zip(&mut self.upper).take(j) {
                let u = row[j];
                row[j] = u + lambda * *gain;
                *gain += v * u;
            }
            innovation_variance = next_variance;
        }
        let step = residual / innovation_variance;
        for (mean, gain) in self.mean.iter_mut().zip(gain) {
            *mean += gain * step;
        }
    }

    /// Adds to the variance of one state and keeps its covariances.
    pub fn inflate_variance(&mut self, index: usize, variance: f32) {
        self.add_error(core::array::from_fn(|i| if i == index { 1.0 } else { 0.0 }), index, variance);
    }

    /// Replaces a state by an independent one. The others keep their covariance.
    pub fn replace_state(&mut self, index: usize, mean: f32, variance: f32) {
        let mut shares = [0.0; N];
        for (share, row) in shares.iter_mut().zip(&mut self.upper).take(index) {
            *share = core::mem::take(&mut row[index]);
        }
        self.upper[index] = [0.0; N];
        let last_variance = core::mem::replace(&mut self.diagonal[index], variance);
        self.mean[index] = mean;
        if let Some(last) = index.checked_sub(1) {
            self.add_error(shares, last, last_variance);
        }
    }

    /// Adds an independent error of this variance, of which the states up to `last` have shares (Agee-Turner).
    fn add_error(&mut self, mut a: [f32; N], last: usize, variance: f32) {
        let mut weight = variance;
        for j in (0..=last.min(N - 1)).rev() {
            let (a_j, old_diagonal) = (a[j], self.diagonal[j]);
            let new_diagonal = old_diagonal + weight * a_j * a_j;
            self.diagonal[j] = new_diagonal;
            if new_diagonal > 0.0 {
                let gain = weight * a_j / new_diagonal;
                for (a_i, row) in a.iter_mut().zip(&mut self.upper).take(j) {
                    *a_i -= a_j * row[j];
                    row[j] += gain * *a_i;
                }
                weight *= old_diagonal / new_diagonal;
            }
        }
    }

    /// Time update `x_i += row . x` with `i` the target index; the elements of `row` up to `i` must be zero.
    pub fn propagate(&mut self, target_index: usize, row: &[f32; N]) {
        self.mean[target_index] += self.projected_mean(row);
        for j in target_index + 1..N {
            self.upper[target_index][j] +=
                row[j] + (target_index + 1..j).map(|i| self.upper[i][j] * row[i]).sum::<f32>();
        }
    }
}

/// Number of elements up to the last nonzero one. Measurements have zeros for the last states.
fn nonzero_length<const N: usize>(row: &[f32; N]) -> usize {
    row.iter().rposition(|element| *element != 0.0).map_or(0, |last_index| last_index + 1)
}

#[cfg(test)]
mod tests {
    use nalgebra::{SMatrix, SVector};
    use testkit::random::Random;

    use super::*;

    const N: usize = 5;
    type Matrix = SMatrix<f64, N, N>;
    type Vector = SVector<f64, N>;

    fn covariance(state: &UdFilter<N>) -> Matrix {
        let upper = Matrix::from_fn(|i, j| match i.cmp(&j) {
            core::cmp::Ordering::Less => f64::from(state.upper[i][j]),
            core::cmp::Ordering::Equal => 1.0,
            core::cmp::Ordering::Greater => 0.0,
        });
        upper * Matrix::from_diagonal(&Vector::from_fn(|i, _| f64::from(state.diagonal[i]))) * upper.transpose()
    }

    fn random_row(random: &mut Random) -> [f32; N] {
        core::array::from_fn(|_| random.uniform(-1.0, 1.0))
    }

    /// Conventional filter in `f64`: `K = P h / (h^T P h + r)`.
    struct ConventionalFilter {
        mean: Vector,
        covariance: Matrix,
    }

    impl ConventionalFilter {
        fn update(&mut self, measurement: &Measurement<N>) {
            let h = Vector::from_fn(|i, _| f64::from(measurement.jacobian[i]));
            let gain = self.covariance * h / (h.dot(&(self.covariance * h)) + f64::from(measurement.variance));
            self.mean += gain * f64::from(measurement.residual);
            self.covariance -= gain * (h.transpose() * self.covariance);
        }
    }

    #[test]
    fn the_ud_filter_equals_a_conventional_kalman_filter() {
        let mut random = Random(1);
        let sigmas = [1.0, 0.5, 2.0, 0.1, 1.5];
        let mut state = UdFilter::new(&sigmas);
        let mut textbook = ConventionalFilter {
            mean: Vector::zeros(),
            covariance: Matrix::from_diagonal(&Vector::from_fn(|i, _| f64::from(sigmas[i] * sigmas[i]))),
        };
        for step in 0..200_usize {
            let variance = random.uniform(0.05, 2.0);
            let measurement = Measurement { jacobian: random_row(&mut random), residual: random.normal(), variance };
            state.apply_measurement(&measurement);
            textbook.update(&measurement);
            let (index, noise) = (step % N, random.uniform(0.0, 0.1));
            state.inflate_variance(index, noise);
            textbook.covariance[(index, index)] += f64::from(noise);
            state.propagate(1, &[0.0, 0.0, 0.0, 0.1, 0.0]);
            let mut growth = Matrix::identity();
            growth[(1, 3)] = f64::from(0.1_f32);
            textbook.mean = growth * textbook.mean;
            textbook.covariance = growth * textbook.covariance * growth.transpose();
            if step % 7 == 6 {
                state.replace_state(index, 0.5, 1.5);
                textbook.mean[index] = 0.5;
                textbook.covariance.row_mut(index).fill(0.0);
                textbook.covariance.column_mut(index).fill(0.0);
                textbook.covariance[(index, index)] = 1.5;
            }
            let difference = (covariance(&state) - textbook.covariance).norm() / textbook.covariance.norm();
            assert!(difference < 1e-4, "step {step}: {difference}");
            for i in 0..N {
                assert!((f64::from(state.mean()[i]) - textbook.mean[i]).abs() < 1e-4, "step {step}, unknown {i}");
            }
        }
        let h = random_row(&mut random);
        let exact = Vector::from_fn(|i, _| f64::from(h[i]));
        let exact = exact.dot(&(textbook.covariance * exact));
        assert!((f64::from(state.projected_variance(&h)) / exact - 1.0).abs() < 1e-4);
        for i in 0..N {
            assert!((f64::from(state.state_variance(i)) / textbook.covariance[(i, i)] - 1.0).abs() < 1e-4);
        }
    }

    /// A day of precise, almost collinear measurements at 10 Hz. A covariance matrix in `f32` becomes negative within
    /// minutes.
    #[test]
    fn no_variance_is_ever_negative() {
        let mut random = Random(2);
        let mut state = UdFilter::<N>::new(&[10.0; N]);
        let mut h = [1.0, 1.0, 1.0, 1.0, 1.0];
        for step in 0..864_000_usize {
            h[step % N] = 1.0 + 1e-3 * random.uniform(-1.0, 1.0);
            state.apply_measurement(&Measurement { jacobian: h, residual: 1e-3 * random.normal(), variance: 1e-8 });
            state.inflate_variance(step % N, 1e-12);
            if step % 1000 == 0 {
                assert!(state.diagonal.iter().all(|d| *d >= 0.0) && state.is_finite(), "step {step}: {state:?}");
            }
        }
        assert!((0..N).all(|i| state.state_variance(i) > 0.0));
    }

    #[test]
    fn a_known_state_without_process_noise_stays_known() {
        let mut known = UdFilter::<3>::new(&[0.0; 3]);
        known.inflate_variance(2, 0.0);
        assert_eq!(known, UdFilter::new(&[0.0; 3]));
    }
}
