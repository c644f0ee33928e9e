//! The linearised problem: information, gradient and cost of all samples and priors at one set of unknowns.

use super::super::least_squares::LeastSquares;
use super::equations::{Equation, Equations};
use super::priors::{for_each_prior, unit};
use super::squares::Squares;
use super::unknowns::{Row, UNKNOWNS, Vector13};
use super::{Likelihood, Parameters, Samples};

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

/// Equations of samples, summed up as normal equations: a fifth of the work of rotating each into the triangle, with
/// half the digits.
pub(super) struct Sums {
    squares: Squares,
    gradient: Vector13,
}

impl Sums {
    pub fn none() -> Self {
        Self { squares: Squares::none(), gradient: Vector13::zeros() }
    }

    pub fn add(&mut self, equations: &Equations) {
        let Equations { norm, dip, heading, .. } = equations;
        if let Some(dip) = dip {
            self.squares.add_two([&norm.row, &dip.row], [norm.weight, dip.weight]);
            // Of one measurement: what they ask of the field is asked of it at once.
            let (of_norm, of_dip) = (-norm.weight * norm.residual, -dip.weight * dip.residual);
            let by_field = norm.row.by_field * of_norm + dip.row.by_field * of_dip;
            let by_inclination = dip.row.by_inclination * of_dip;
            Row { by_field, by_inclination, ..dip.row }.add_to(&mut self.gradient, 1.0);
        } else {
            self.add_one(norm);
        }
        if let Some(heading) = heading {
            self.add_one(heading);
        }
    }

    fn add_one(&mut self, equation: &Equation) {
        self.squares.add(&equation.row, equation.weight);
        equation.row.add_to(&mut self.gradient, -equation.weight * equation.residual);
    }
}

impl System {
    /// Without any sample or prior.
    fn none() -> Self {
        Self { equations: LeastSquares::new(), cost: 0.0, clipped_squares: [0.0; 2], samples: 0 }
    }

    /// What is known without any sample, for tests.
    #[cfg(test)]
    pub fn of_priors(likelihood: &Likelihood, unknowns: &Vector13) -> Self {
        let mut system = Self::none();
        system.add_priors(likelihood, unknowns);
        system
    }

    /// Adds what is known without any sample: see [`for_each_prior`].
    fn add_priors(&mut self, likelihood: &Likelihood, unknowns: &Vector13) {
        for_each_prior(likelihood, &Parameters::new(unknowns), &mut |prior| {
            let weight = 1.0 / (prior.sigma * prior.sigma);
            self.equations.add(&prior.row, [-prior.residual], weight);
            self.cost += 0.5 * weight * prior.residual * prior.residual;
        });
    }

    /// Of all samples and priors: each equation for itself, or summed up.
    #[inline(never)]
    pub fn of(likelihood: &Likelihood, samples: Samples<'_>, unknowns: &Vector13) -> Self {
        let parameters = Parameters::new(unknowns);
        let mut system = Self::none();
        if likelihood.sums_up {
            let mut sums = Sums::none();
            likelihood.for_each_sample(samples, &parameters, &mut |equations| {
                system.note(equations);
                sums.add(equations);
            });
            system.equations =
                LeastSquares::of_normal_equations(sums.squares.triangle(), sums.gradient.data.0[0].map(|g| [g]));
            system.add_priors(likelihood, unknowns);
        } else {
            // First of all: what an equation finds in an empty row is divided by its own element, however small.
            system.add_priors(likelihood, unknowns);
            likelihood.for_each_sample(samples, &parameters, &mut |equations| system.add(equations));
        }
        system
    }

    /// Adds what a sample says.
    pub fn add(&mut self, equations: &Equations) {
        self.note(equations);
        let norm = &equations.norm;
        if let Some(dip) = &equations.dip {
            let residuals = [-norm.residual, -dip.residual];
            self.equations.add_two([&norm.row.dense(), &dip.row.dense()], residuals, [norm.weight, dip.weight]);
        } else {
            self.add_equation(norm);
        }
        if let Some(heading) = &equations.heading {
            self.add_equation(heading);
        }
    }

    fn add_equation(&mut self, equation: &Equation) {
        self.equations.add(&equation.row.dense(), [-equation.residual], equation.weight);
    }

    /// Adds what a sample costs and scatters by.
    fn note(&mut self, equations: &Equations) {
        self.clipped_squares[0] += equations.norm.clipped_square;
        self.clipped_squares[1] += equations.dip.as_ref().map_or(0.0, |dip| dip.clipped_square);
        self.cost += equations.all().map(|equation| equation.loss).sum::<f32>();
        self.samples = self.samples.saturating_add(1);
    }

    /// Adds any equation, for tests.
    #[cfg(test)]
    pub fn add_row(&mut self, row: &Vector13, residual: f32, weight: f32) {
        self.equations.add(row, [-residual], weight);
    }

    /// The unknowns have been changed by so little that all else stays as it is: nothing is left to change.
    pub const fn settle(&mut self) {
        self.equations.settle();
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
