//! Efficient-score (Lagrange-multiplier) test of further unknowns (D. R. Cox and D. V. Hinkley, Theoretical Statistics,
//! 1974, 9.3).
//!
//! `K` further unknowns `beta` are linear about the fit without them. With the information and the gradient of `beta`
//! summed over the samples, and `H` the information of the thirteen unknowns, the efficient score is
//! `U = g_b - H_bu H^-1 g_u` with information `S = H_bb - H_bu H^-1 H_ub`: the thirteen are nuisance parameters, and
//! eliminated. The estimate is `beta = S^-1 U`, its significance `U S^-1 U`, chi-squared with `K` degrees of freedom
//! for independent errors of known sigma. The thirteen follow by `-H^-1 H_ub beta`.

use nalgebra::{SMatrix, SVector};

use crate::calibration::fit::linearised_problem::LinearisedProblem;
use crate::calibration::model::{ResidualEquation, Vector13};

/// Sums over the residuals of the samples.
#[derive(Clone, Copy, Debug)]
pub(in crate::calibration) struct ScoreTest<const K: usize> {
    /// Cross information `H_ub`, by unknown of the hypothesis.
    pub cross_information: [Vector13; K],
    /// Information `H_bb` of the further unknowns.
    pub information: SMatrix<f32, K, K>,
    /// Gradient `g_b` by the further unknowns.
    pub gradient: SVector<f32, K>,
}

/// Information `S` and gradient `U` with the nuisance parameters eliminated.
#[derive(Clone, Debug)]
pub(in crate::calibration) struct EfficientScore<const K: usize> {
    /// Columns of `H^-1 H_ub`: change of the thirteen unknowns with each further unknown.
    pub nuisance_columns: [Vector13; K],
    pub information: SMatrix<f32, K, K>,
    pub gradient: SVector<f32, K>,
}

impl<const K: usize> ScoreTest<K> {
    pub fn zero() -> Self {
        Self { cross_information: [Vector13::zeros(); K], information: SMatrix::zeros(), gradient: SVector::zeros() }
    }

    /// Adds a residual. `derivative`: of the residual by `beta`; `fraction`: of `beta` that the sample has.
    pub fn add_weighted_equation(&mut self, equation: &ResidualEquation, derivative: &SVector<f32, K>, fraction: f32) {
        let weighted = derivative * (equation.weight * fraction);
        for (sum, axis_derivative) in self.cross_information.iter_mut().zip(&weighted) {
            equation.jacobian_row.add_scaled_to(sum, *axis_derivative);
        }
        self.information.ger(fraction, &weighted, derivative, 1.0);
        self.gradient.axpy(-equation.residual, &weighted, 1.0);
    }

    /// `H_ub beta`: effect of `beta` on the gradient of the thirteen unknowns.
    pub fn gradient_effect(&self, beta: &SVector<f32, K>) -> Vector13 {
        self.cross_information.iter().zip(beta).map(|(cross_row, beta)| cross_row * *beta).sum()
    }

    /// Eliminates the thirteen unknowns; `step_to_maximum`: their remaining step to the maximum likelihood, `H^-1 g_u`.
    pub fn eliminate_coefficients(
        &self,
        system: &LinearisedProblem,
        step_to_maximum: &Vector13,
    ) -> Option<EfficientScore<K>> {
        let mut score = EfficientScore {
            nuisance_columns: [Vector13::zeros(); K],
            information: self.information,
            gradient: self.gradient,
        };
        for (axis, cross_row) in self.cross_information.iter().enumerate() {
            let column = system.covariance_times(cross_row)?;
            for (other_axis, cross_row) in self.cross_information.iter().enumerate() {
                score.information[(axis, other_axis)] -= column.dot(cross_row);
            }
            score.gradient[axis] -= cross_row.dot(step_to_maximum);
            score.nuisance_columns[axis] = column;
        }
        Some(score)
    }
}
