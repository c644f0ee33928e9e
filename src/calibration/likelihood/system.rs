//! The linearised problem: information, gradient and cost of all samples and priors at one set of unknowns.

use super::super::least_squares::LeastSquares;
use super::equations::{Equation, Equations};
use super::{Likelihood, Point, UNKNOWNS, Vector13};

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
    /// What is known without any sample: see [`priors`].
    pub fn of_priors(likelihood: &Likelihood, unknowns: &Vector13) -> Self {
        let mut system = Self { equations: LeastSquares::new(), cost: 0.0, clipped_squares: [0.0; 2], samples: 0 };
        priors(likelihood, &Point::new(unknowns), &mut |prior| {
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

    /// The change of the unknowns to the most likely ones, shortened by damping (Levenberg-Marquardt), and by how much it
    /// promises to lower the cost.
    pub fn step(&self, damping: f32) -> Option<(Vector13, f32)> {
        let mut damped = self.equations.clone();
        for (i, information) in self.equations.diagonal().iter().enumerate() {
            damped.add(&unit(i, 1.0), [0.0], damping * information);
        }
        let change = damped.solve()?;
        Some((change, self.equations.gain(&change)))
    }

    /// The change of the unknowns to the most likely ones.
    pub fn change(&self) -> Option<Vector13> {
        self.equations.solve()
    }

    /// Covariance of the unknowns, times a vector; `None` when they are not determined.
    pub fn covariance_times(&self, vector: &Vector13) -> Option<Vector13> {
        self.equations.covariance_times(vector)
    }
}

/// What is known beforehand, as an equation: `row . change` is `-residual`, give or take `sigma`.
#[derive(Clone, Debug)]
pub(in crate::calibration) struct KnownBefore {
    pub row: Vector13,
    pub residual: f32,
    pub sigma: f32,
    pub of: Quantity,
}

/// What a prior is about, with the axes of the mount.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::calibration) enum Quantity {
    SoftIron,
    Mounting,
    HardIron,
    Inclination,
}

/// Weak priors that let thin data shrink towards no correction: on the symmetric part of `W` (soft iron; scale is left
/// free), on its skew part (mounting), on `b`, and on the inclination where it was told.
pub(in crate::calibration) fn priors(likelihood: &Likelihood, point: &Point, tell: &mut dyn FnMut(&KnownBefore)) {
    let config = &likelihood.config;
    let mut prior = |of, row, residual, sigma| tell(&KnownBefore { row, residual, sigma, of });
    let w = |index: usize| point.w[(index / 3, index % 3)];
    // Indices of W's elements in the unknowns.
    for (ij, ji) in [(1, 3), (2, 6), (5, 7)] {
        let (symmetric, skew) = (w(ij).midpoint(w(ji)), (w(ij) - w(ji)) / 2.0);
        prior(Quantity::SoftIron, unit(ij, 0.5) + unit(ji, 0.5), symmetric, config.soft_iron_sigma);
        prior(Quantity::Mounting, unit(ij, 0.5) - unit(ji, 0.5), skew, config.mounting_sigma);
    }
    let third_of_trace = unit(0, 1.0 / 3.0) + unit(4, 1.0 / 3.0) + unit(8, 1.0 / 3.0);
    for ii in [0, 4, 8] {
        let residual = w(ii) - point.w.trace() / 3.0;
        prior(Quantity::SoftIron, unit(ii, 1.0) - third_of_trace, residual, config.soft_iron_sigma);
    }
    // b = mean - W^-1 d, so that a change of it is W^-1 (change of W) W^-1 d - W^-1 (change of d). Without an inverse
    // there is no b, and nothing to be known of it.
    if let Some(field_from_body) = point.w.try_inverse() {
        let from_b = field_from_body * point.d;
        for i in 0..3 {
            let by_body = field_from_body.row(i).transpose();
            let mut row = Point::row(&by_body, &from_b);
            row.fixed_rows_mut::<3>(9).copy_from(&-by_body);
            let residual = likelihood.mean[i] - from_b[i];
            prior(Quantity::HardIron, row, residual, config.hard_iron_sigma_ut / likelihood.unit_ut);
        }
    }
    let told = likelihood.told_inclination_rad.map(|told_rad| (told_rad, config.told_inclination_sigma_rad));
    let (value_rad, sigma_rad) = told.unwrap_or((0.0, ANY_INCLINATION_RAD));
    prior(Quantity::Inclination, unit(12, 1.0), point.inclination_rad - value_rad, sigma_rad);
}

/// Wider than all inclinations there are: keeps the system regular where nothing is said about it.
const ANY_INCLINATION_RAD: f32 = 10.0;

fn unit(index: usize, value: f32) -> Vector13 {
    let mut vector = Vector13::zeros();
    vector[index] = value;
    vector
}
