//! The linearised problem: information, gradient and cost of all samples and priors at one set of unknowns.

use super::equations::{Equation, Equations};
use super::{Likelihood, Matrix13, Point, UNKNOWNS, Vector13};

/// The linearised problem at one set of unknowns.
#[derive(Clone, Debug)]
pub(in crate::calibration) struct System {
    /// `J^T J` of everything, priors included: the lower triangle.
    information: Matrix13,
    pub gradient: Vector13,
    /// Half the weighted sum of squares.
    pub cost: f32,
    /// Sums of the clipped squares of the norm's and the dip's residuals over their sigma.
    pub clipped_squares: [f32; 2],
    pub samples: u16,
}

impl System {
    /// What is known without any sample: see [`priors`].
    pub fn of_priors(likelihood: &Likelihood, unknowns: &Vector13) -> Self {
        let mut system = Self {
            information: Matrix13::zeros(),
            gradient: Vector13::zeros(),
            cost: 0.0,
            clipped_squares: [0.0; 2],
            samples: 0,
        };
        priors(likelihood, &Point::new(unknowns), |prior| {
            let residual = prior.residual;
            let weight = 1.0 / (prior.sigma * prior.sigma);
            let loss = 0.5 * weight * residual * residual;
            system.add_equation(&Equation { row: prior.row, residual, weight, loss, clipped: 0.0 });
        });
        system
    }

    /// Adds what a sample says.
    pub fn add(&mut self, equations: &Equations) {
        self.add_equation(&equations.norm);
        self.clipped_squares[0] += equations.norm.clipped * equations.norm.clipped;
        if let Some(dip) = &equations.dip {
            self.add_equation(dip);
            self.clipped_squares[1] += dip.clipped * dip.clipped;
        }
        if let Some(heading) = &equations.heading {
            self.add_equation(heading);
        }
        self.samples = self.samples.saturating_add(1);
    }

    fn add_equation(&mut self, equation: &Equation) {
        self.information.syger(equation.weight, &equation.row, &equation.row, 1.0);
        self.gradient.axpy(equation.weight * equation.residual, &equation.row, 1.0);
        self.cost += equation.loss;
    }

    /// The change of the unknowns that solves `(H + damping diag H) change = -gradient`, in `f64`.
    pub fn step(&self, damping: f32) -> Option<Vector13> {
        let mut information = self.information.cast::<f64>();
        for i in 0..UNKNOWNS {
            information[(i, i)] *= 1.0 + f64::from(damping);
        }
        // Cholesky reads the lower triangle alone.
        let change = information.cholesky()?.solve(&(-self.gradient.cast::<f64>()));
        change.iter().all(|c| c.is_finite()).then(|| change.cast::<f32>())
    }

    /// Inverse of the information, by `f64`; `None` when it is singular.
    pub fn covariance(&self) -> Option<Matrix13> {
        let inverse = self.information.cast::<f64>().cholesky()?.inverse();
        inverse.iter().all(|c| c.is_finite()).then(|| inverse.cast::<f32>())
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
pub(in crate::calibration) fn priors(likelihood: &Likelihood, point: &Point, mut tell: impl FnMut(KnownBefore)) {
    let config = &likelihood.config;
    let mut prior = |of, row, residual, sigma| tell(KnownBefore { row, residual, sigma, of });
    let w = |index: usize| point.w[(index / 3, index % 3)];
    // Indices of W's elements in the unknowns.
    for (ij, ji) in [(1, 3), (2, 6), (5, 7)] {
        let (symmetric, skew) = ((w(ij) + w(ji)) / 2.0, (w(ij) - w(ji)) / 2.0);
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
