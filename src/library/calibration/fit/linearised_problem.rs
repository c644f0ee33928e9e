//! Linearised problem: information, gradient and cost of all samples and priors at one set of unknowns.

use super::information_matrix::InformationMatrix;
use crate::calibration::linear_algebra::LeastSquares;
use crate::calibration::model::{
    JacobianRow, Likelihood, ModelParameters, ResidualEquation, SampleEquations, UNKNOWN_COUNT, Vector13,
    for_each_prior, scaled_unit_vector,
};
use crate::calibration::types::samples::Samples;

#[derive(Clone, Debug)]
pub(in crate::calibration) struct LinearisedProblem {
    least_squares: LeastSquares<UNKNOWN_COUNT, 1>,
    /// Cost: half the weighted sum of squares, with Huber's loss.
    pub cost: f32,
    /// Sums of the clipped squared normalised residuals, of norm and inclination.
    pub clipped_squares: [f32; 2],
    pub sample_count: u16,
}

/// Normal equations of samples: a fifth of the work of rotating each equation into the triangle, with half the digits.
pub(in crate::calibration) struct NormalEquations {
    information: InformationMatrix,
    gradient: Vector13,
}

impl NormalEquations {
    pub fn zero() -> Self {
        Self { information: InformationMatrix::zero(), gradient: Vector13::zeros() }
    }

    #[inline]
    pub fn add_sample_equations(&mut self, equations: &SampleEquations) {
        let SampleEquations {
            norm_equation: norm, inclination_equation: inclination, heading_equation: heading, ..
        } = equations;
        if let Some(inclination) = inclination {
            self.information
                .add_row_pair([&norm.jacobian_row, &inclination.jacobian_row], [norm.weight, inclination.weight]);
            // The two residuals share a measurement, so their gradients are added before the outer product.
            let (norm_gradient, inclination_gradient) =
                (-norm.weight * norm.residual, -inclination.weight * inclination.residual);
            let by_field = norm.jacobian_row.derivative_by_field * norm_gradient
                + inclination.jacobian_row.derivative_by_field * inclination_gradient;
            let derivative_by_inclination = inclination.jacobian_row.derivative_by_inclination * inclination_gradient;
            JacobianRow { derivative_by_field: by_field, derivative_by_inclination, ..inclination.jacobian_row }
                .add_scaled_to(&mut self.gradient, 1.0);
        } else {
            self.add_equation(norm);
        }
        if let Some(heading) = heading {
            self.add_equation(heading);
        }
    }

    fn add_equation(&mut self, equation: &ResidualEquation) {
        self.information.add_row(&equation.jacobian_row, equation.weight);
        equation.jacobian_row.add_scaled_to(&mut self.gradient, -equation.weight * equation.residual);
    }
}

impl LinearisedProblem {
    fn empty() -> Self {
        Self { least_squares: LeastSquares::new(), cost: 0.0, clipped_squares: [0.0; 2], sample_count: 0 }
    }

    fn add_priors(&mut self, likelihood: &Likelihood, unknowns: &Vector13) {
        for_each_prior(likelihood, &ModelParameters::from_unknowns(unknowns), &mut |prior| {
            let weight = 1.0 / (prior.sigma * prior.sigma);
            self.least_squares.add_weighted_row(&prior.jacobian_row, [-prior.residual], weight);
            self.cost += 0.5 * weight * prior.residual * prior.residual;
        });
    }

    #[inline(never)]
    pub fn linearise(likelihood: &Likelihood, samples: Samples<'_>, unknowns: &Vector13) -> Self {
        let parameters = ModelParameters::from_unknowns(unknowns);
        let mut system = Self::empty();
        if likelihood.uses_normal_equations {
            let mut sums = NormalEquations::zero();
            likelihood.for_each_sample_equations(samples, &parameters, &mut |equations| {
                system.accumulate_cost(equations);
                sums.add_sample_equations(equations);
            });
            system.least_squares = LeastSquares::from_normal_equations(
                sums.information.upper_triangle(),
                sums.gradient.data.0[0].map(|g| [g]),
            );
            system.add_priors(likelihood, unknowns);
        } else {
            // The priors are added first: an equation rotated into an empty row would be divided by its own element,
            // however small.
            system.add_priors(likelihood, unknowns);
            likelihood.for_each_sample_equations(samples, &parameters, &mut |equations| {
                system.add_sample_equations(equations);
            });
        }
        system
    }

    pub fn add_sample_equations(&mut self, equations: &SampleEquations) {
        self.accumulate_cost(equations);
        let norm = &equations.norm_equation;
        if let Some(inclination) = &equations.inclination_equation {
            let residuals = [-norm.residual, -inclination.residual];
            self.least_squares.add_weighted_row_pair(
                [&norm.jacobian_row.as_vector(), &inclination.jacobian_row.as_vector()],
                residuals,
                [norm.weight, inclination.weight],
            );
        } else {
            self.add_equation(norm);
        }
        if let Some(heading) = &equations.heading_equation {
            self.add_equation(heading);
        }
    }

    fn add_equation(&mut self, equation: &ResidualEquation) {
        self.least_squares.add_weighted_row(&equation.jacobian_row.as_vector(), [-equation.residual], equation.weight);
    }

    #[inline]
    fn accumulate_cost(&mut self, equations: &SampleEquations) {
        self.clipped_squares[0] += equations.norm_equation.clipped_square;
        self.clipped_squares[1] +=
            equations.inclination_equation.as_ref().map_or(0.0, |inclination| inclination.clipped_square);
        self.cost += equations.iter().map(|equation| equation.loss).sum::<f32>();
        self.sample_count = self.sample_count.saturating_add(1);
    }

    /// Moves the origin to the solution: the remaining step is zero.
    pub const fn reset_origin(&mut self) {
        self.least_squares.reset_origin();
    }

    /// Damped step (Levenberg-Marquardt) to the maximum likelihood, and the predicted reduction of the cost. `None` when
    /// the information is singular.
    pub fn damped_step(&self, damping: f32) -> Option<(Vector13, f32)> {
        let mut damped = self.least_squares.clone();
        for (i, information) in self.least_squares.information_diagonal().iter().enumerate() {
            damped.add_weighted_row(&scaled_unit_vector(i, 1.0), [0.0], damping * information);
        }
        let change = damped.solve()?;
        Some((change, self.least_squares.predicted_reduction(&change)))
    }

    pub fn step_to_maximum(&self) -> Option<Vector13> {
        self.least_squares.solve()
    }

    /// Covariance of the unknowns times a vector; `None` when the information is singular.
    pub fn covariance_times(&self, vector: &Vector13) -> Option<Vector13> {
        self.least_squares.covariance_times(vector)
    }
}

#[cfg(test)]
impl LinearisedProblem {
    pub fn from_priors(likelihood: &Likelihood, unknowns: &Vector13) -> Self {
        let mut system = Self::empty();
        system.add_priors(likelihood, unknowns);
        system
    }

    pub fn add_row(&mut self, row: &Vector13, residual: f32, weight: f32) {
        self.least_squares.add_weighted_row(row, [-residual], weight);
    }
}
