//! Linear least squares with priors, by normal equations.

use nalgebra::{SMatrix, SVector};

use crate::numbers::square;

/// Normal equations of a linear least-squares fit.
#[derive(Clone, Copy, Debug)]
pub(crate) struct LeastSquares<const UNKNOWNS: usize> {
    /// Normal matrix: information of the rows and of the priors.
    pub normal: SMatrix<f64, UNKNOWNS, UNKNOWNS>,
    /// Right side of the normal equations.
    pub right_side: SVector<f64, UNKNOWNS>,
    /// Sum of the squared values of the rows, weighted.
    squares: f64,
    row_count: usize,
}

impl<const UNKNOWNS: usize> LeastSquares<UNKNOWNS> {
    /// A fit without priors and rows.
    pub fn new() -> Self {
        Self::with_prior_sigmas([f64::INFINITY; UNKNOWNS])
    }

    /// A fit without rows, with normally distributed priors about zero. An infinite standard deviation leaves an unknown
    /// without a prior.
    pub fn with_prior_sigmas(sigmas: [f64; UNKNOWNS]) -> Self {
        let normal = SMatrix::from_diagonal(&SVector::from(sigmas.map(|sigma| square(sigma).recip())));
        Self { normal, right_side: SVector::zeros(), squares: 0.0, row_count: 0 }
    }

    /// Adds a value, its derivatives by the unknowns, and its weight, the reciprocal of its variance.
    pub fn add_row(&mut self, derivatives: &SVector<f64, UNKNOWNS>, value: f64, weight: f64) {
        self.normal.ger(weight, derivatives, derivatives, 1.0);
        self.right_side.axpy(weight * value, derivatives, 1.0);
        self.squares += weight * square(value);
        self.row_count += 1;
    }

    /// The unknowns; none if the rows and priors do not determine them.
    pub fn solve(&self) -> Option<SVector<f64, UNKNOWNS>> {
        Some(self.normal.cholesky()?.solve(&self.right_side))
    }

    /// The unknowns with their standard deviations by the scatter of the residuals, of which `correlated_rows` count as
    /// one; none from fewer rows than `min_rows`.
    pub fn solve_with_sigmas(&self, min_rows: usize, correlated_rows: f64) -> Option<[[f64; 2]; UNKNOWNS]> {
        // The inverse exists for unknowns that the rows hardly determine, too, which then have large deviations.
        let inverse = self.normal.try_inverse().filter(|_| self.row_count >= min_rows)?;
        let solved = inverse * self.right_side;
        let residual_squares = (self.squares - solved.dot(&self.right_side)).max(0.0);
        let variance = residual_squares / self.row_count as f64 * correlated_rows;
        Some(std::array::from_fn(|i| [solved[i], (inverse[(i, i)] * variance).sqrt()]))
    }
}
