//! Lag-1 autocorrelation of the residuals of a flight.
//!
//! For first-order autoregressive errors with autocorrelation rho, the effective sample size is `(1 - rho) / (1 + rho)`
//! of the number of samples.

use crate::calibration::types::samples::PART_COUNT;

/// Upper limit of rho: an effective sample size of 1/39.
const MAX_AUTOCORRELATION: f32 = 0.95;

/// Autocorrelation sums over neighbouring samples of each part.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(in crate::calibration) struct Autocorrelation {
    lag_products: [f32; 2],
    square_sums: [f32; 2],
    previous_residuals: [[f32; 2]; PART_COUNT],
}

impl Autocorrelation {
    pub fn add_residuals(&mut self, part: usize, residuals: [f32; 2]) {
        let Some(previous) = self.previous_residuals.get_mut(part) else { return };
        for (kind, residual) in residuals.into_iter().enumerate() {
            self.lag_products[kind] += residual * previous[kind];
            self.square_sums[kind] += residual * residual;
        }
        *previous = residuals;
    }

    /// Variance inflation minus one, `2 rho / (1 - rho)`, of norm and inclination residuals; 0 for negative rho.
    pub fn excess_variance_inflation(&self) -> [f32; 2] {
        [0, 1].map(|kind| {
            let (products, squares) = (self.lag_products[kind], self.square_sums[kind]);
            let rho = if squares > 0.0 { (products / squares).clamp(0.0, MAX_AUTOCORRELATION) } else { 0.0 };
            2.0 * rho / (1.0 - rho)
        })
    }

    pub fn sums_of_squares(&self) -> [f32; 2] {
        self.square_sums
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn is_close(found: [f32; 2], expected: [f32; 2]) -> bool {
        found.iter().zip(expected).all(|(f, e)| (f - e).abs() < 1e-3)
    }

    #[test]
    fn correlated_residuals_inflate_the_variance() {
        for (products, squares, excess) in [
            (0.0, 0.0, 0.0),
            (-5.0, 10.0, 0.0),
            (2.0, 10.0, 0.5),
            (9.4, 10.0, 31.3333),
            (9.6, 10.0, 38.0),
            (10.0, 10.0, 38.0),
        ] {
            for own in [0, 1] {
                let mut sums = Autocorrelation {
                    lag_products: [5.0; 2],
                    square_sums: [10.0; 2],
                    previous_residuals: [[0.0; 2]; PART_COUNT],
                };
                (sums.lag_products[own], sums.square_sums[own]) = (products, squares);
                let mut expected = [2.0; 2];
                expected[own] = excess;
                assert!(is_close(sums.excess_variance_inflation(), expected), "{products} {squares}");
            }
        }
    }

    #[test]
    fn lag_products_pair_samples_of_the_same_part() {
        let mut correlation = Autocorrelation::default();
        for (part, residuals) in [(0, [1.0, -2.0]), (1, [3.0, 1.0]), (0, [2.0, 0.5]), (2, [9.0, 9.0]), (1, [-1.0, 2.0])]
        {
            correlation.add_residuals(part, residuals);
        }
        assert!(is_close(correlation.lag_products, [2.0 - 3.0, -1.0 + 2.0]), "{correlation:?}");
        assert!(is_close(correlation.sums_of_squares(), [1.0 + 9.0 + 4.0 + 81.0 + 1.0, 4.0 + 1.0 + 0.25 + 81.0 + 4.0]));
        let before = correlation;
        correlation.add_residuals(PART_COUNT, [1.0, 1.0]);
        assert_eq!(correlation, before);
    }
}
