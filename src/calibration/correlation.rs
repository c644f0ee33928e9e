//! How alike the errors of neighbouring samples are, and so how much less their number is worth.
//!
//! Of errors with a lag-1 autocorrelation rho, as a first-order process has, the mean of many scatters as that of
//! `(1 - rho) / (1 + rho)` times as many independent ones.

use super::time_order::PARTS;

/// A correlation that comes closer to one is taken for this: the samples are worth a fortieth of their number.
const MAX_RHO: f32 = 0.95;

/// Sums over neighbours in each part of a flight, for two kinds of residual at once: the norm's and the dip's.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Correlation {
    products: [f32; 2],
    squares: [f32; 2],
    /// The residuals of the last sample of each part.
    before: [[f32; 2]; PARTS],
}

impl Correlation {
    /// Adds the residuals over sigma of the next sample of a part.
    pub fn add(&mut self, part: usize, residuals: [f32; 2]) {
        let Some(before) = self.before.get_mut(part) else { return };
        for (kind, residual) in residuals.into_iter().enumerate() {
            self.products[kind] += residual * before[kind];
            self.squares[kind] += residual * residual;
        }
        *before = residuals;
    }

    /// How much more than of independent errors the covariance is, less one: `2 rho / (1 - rho)`, of norm and dip.
    /// Errors that alternate are not believed to.
    pub fn excess(&self) -> [f32; 2] {
        [0, 1].map(|kind| {
            let (products, squares) = (self.products[kind], self.squares[kind]);
            let rho = if squares > 0.0 { (products / squares).clamp(0.0, MAX_RHO) } else { 0.0 };
            2.0 * rho / (1.0 - rho)
        })
    }

    /// Sums of the squares, of norm and dip.
    pub fn squares(&self) -> [f32; 2] {
        self.squares
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn close(found: [f32; 2], expected: [f32; 2]) -> bool {
        found.iter().zip(expected).all(|(f, e)| (f - e).abs() < 1e-3)
    }

    /// Nothing is doubted of noise that is white or alternates; at most, 39 parts of 40 are lost.
    #[test]
    fn correlated_errors_are_worth_less() {
        for (products, squares, excess) in [
            (0.0, 0.0, 0.0),
            (-5.0, 10.0, 0.0),
            (2.0, 10.0, 0.5),
            (9.4, 10.0, 31.3333),
            (9.6, 10.0, 38.0),
            (10.0, 10.0, 38.0),
        ] {
            let of = |products, squares| Correlation { products, squares, before: [[0.0; 2]; PARTS] }.excess();
            assert!(close(of([products, 5.0], [squares, 10.0]), [excess, 2.0]), "{products} {squares}");
            assert!(close(of([5.0, products], [10.0, squares]), [2.0, excess]), "{products} {squares}");
        }
    }

    /// The neighbour of a sample is the one before it in its own part, however the parts are interleaved.
    #[test]
    fn neighbours_are_those_of_a_part() {
        let mut correlation = Correlation::default();
        for (part, residuals) in [(0, [1.0, -2.0]), (1, [3.0, 1.0]), (0, [2.0, 0.5]), (2, [9.0, 9.0]), (1, [-1.0, 2.0])]
        {
            correlation.add(part, residuals);
        }
        assert!(close(correlation.products, [2.0 - 3.0, -1.0 + 2.0]), "{correlation:?}");
        assert!(close(correlation.squares(), [1.0 + 9.0 + 4.0 + 81.0 + 1.0, 4.0 + 1.0 + 0.25 + 81.0 + 4.0]));
        // There is none beyond the last.
        let before = correlation;
        correlation.add(PARTS, [1.0, 1.0]);
        assert_eq!(correlation, before);
    }
}
