//! The linearised problem: information, gradient and cost of all samples and priors at one set of unknowns.

use super::super::least_squares::LeastSquares;
use super::equations::{Equation, Equations};
use super::priors::{for_each_prior, unit};
use super::unknowns::{UNKNOWNS, Vector13};
use super::{Likelihood, Parameters};

/// The linearised problem at one set of unknowns: the change of them that makes everything most likely.
#[derive(Clone, Debug)]
pub(in crate::calibration) struct System {
    equations: LeastSquares<UNKNOWNS, 1>,
    /// Half the weighted sum of squares.
    pub cost: f32,
    /// Sums of the clipped squares of the norm's and the dip's residuals over their sigma.
    pub clipped_squares: [f32; 2],
    pub samples: u16,
}

impl System {
    /// What is known without any sample: see [`for_each_prior`].
    pub fn of_priors(likelihood: &Likelihood, unknowns: &Vector13) -> Self {
        let mut system = Self { equations: LeastSquares::new(), cost: 0.0, clipped_squares: [0.0; 2], samples: 0 };
        for_each_prior(likelihood, &Parameters::new(unknowns), &mut |prior| {
            let weight = 1.0 / (prior.sigma * prior.sigma);
            system.equations.add(&prior.row, [-prior.residual], weight);
            system.cost += 0.5 * weight * prior.residual * prior.residual;
        });
        system
    }

    /// Adds what a sample says.
    pub fn add(&mut self, equations: &Equations) {
        let norm = &equations.norm;
        self.clipped_squares[0] += norm.clipped_square;
        if let Some(dip) = &equations.dip {
            self.clipped_squares[1] += dip.clipped_square;
            self.cost += norm.loss + dip.loss;
            let residuals = [-norm.residual, -dip.residual];
            self.equations.add_two([&norm.row, &dip.row], residuals, [norm.weight, dip.weight]);
        } else {
            self.add_equation(norm);
        }
        if let Some(heading) = &equations.heading {
            self.add_equation(heading);
        }
        self.samples = self.samples.saturating_add(1);
    }

    fn add_equation(&mut self, equation: &Equation) {
        self.equations.add(&equation.row, [-equation.residual], equation.weight);
        self.cost += equation.loss;
    }

    /// The change of the unknowns to the most likely ones, shortened by damping (Levenberg-Marquardt), and by how much
    /// it promises to lower the cost. `None` when they are not determined.
    pub fn step(&self, damping: f32) -> Option<(Vector13, f32)> {
        let mut damped = self.equations.clone();
        for (i, information) in self.equations.diagonal().iter().enumerate() {
            damped.add(&unit(i, 1.0), [0.0], damping * information);
        }
        let change = damped.solve()?;
        Some((change, self.equations.gain(&change)))
    }

    /// The change of the unknowns to the most likely ones. `None` when they are not determined.
    pub fn change(&self) -> Option<Vector13> {
        self.equations.solve()
    }

    /// Covariance of the unknowns, times a vector; `None` when they are not determined.
    pub fn covariance_times(&self, vector: &Vector13) -> Option<Vector13> {
        self.equations.covariance_times(vector)
    }
}
