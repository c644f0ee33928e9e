//! The linearised problem: information, gradient and cost of all samples and priors at one set of unknowns.

use super::{Matrix13, Point, Refinement, Residuals, Vector13};
use crate::calibration::Turns;

/// The linearised problem at one set of unknowns.
#[derive(Clone, Debug)]
pub struct System {
    /// Information of the norm residuals.
    pub norm: Matrix13,
    /// Information of the dip residuals.
    pub dip: Matrix13,
    /// Information of the priors.
    pub prior: Matrix13,
    /// What one radian of roll bias, pitch bias, and a relative bank error of one do to the gradient.
    pub consider: [Vector13; 3],
    pub gradient: Vector13,
    /// Half the weighted sum of squares.
    pub cost: f32,
    /// Sums of squares of the residuals over their sigma, each clipped.
    pub clipped: [f32; 2],
    /// Lag-1 autocorrelation sums of the dip residuals: products and squares.
    correlation: [f32; 2],
    pub samples: u16,
}

impl System {
    pub fn empty() -> Self {
        Self {
            norm: Matrix13::zeros(),
            dip: Matrix13::zeros(),
            prior: Matrix13::zeros(),
            consider: [Vector13::zeros(); 3],
            gradient: Vector13::zeros(),
            cost: 0.0,
            clipped: [0.0; 2],
            correlation: [0.0; 2],
            samples: 0,
        }
    }

    /// All information there is.
    pub fn information(&self) -> Matrix13 {
        self.norm + self.dip + self.prior
    }

    /// Lag-1 autocorrelation of the dip residuals, 0..0.8.
    pub fn autocorrelation(&self) -> f32 {
        let [products, squares] = self.correlation;
        if squares > 0.0 { (products / squares).clamp(0.0, 0.8) } else { 0.0 }
    }
}

/// Residuals are clipped here when their sigma is estimated, and this is the mean of the clipped square of a normal
/// variable: Huber's proposal 2, which one sample in twenty may spoil without harm.
const CLIP: f32 = 2.0;
pub const CLIPPED_MEAN_SQUARE: f32 = 0.9205;

impl Refinement {
    /// One pass over the samples.
    pub(super) fn linearise(&self, turns: Turns<'_>, unknowns: &Vector13) -> System {
        let mut system = System::empty();
        let point = Point::new(unknowns);
        for side in [turns.left, turns.right] {
            let mut before = 0.0;
            for sample in side {
                let field = self.rotation * sample.field.ut / self.unit_ut;
                before = self.add(&mut system, &point.residuals(field, sample), before);
            }
        }
        self.add_priors(&mut system, unknowns);
        system
    }

    /// Adds a sample; gives its whitened dip residual, `before` being that of the sample before.
    fn add(&self, system: &mut System, residuals: &Residuals, before: f32) -> f32 {
        let norm = Whitened::new(residuals.norm, self.sigma.norm, self.config.huber);
        let dip = Whitened::new(residuals.dip, self.sigma.dip, self.config.huber);
        system.norm.ger(norm.weight, &residuals.norm_row, &residuals.norm_row, 1.0);
        system.dip.ger(dip.weight, &residuals.dip_row, &residuals.dip_row, 1.0);
        system.gradient += residuals.norm_row * (norm.weight * residuals.norm);
        system.gradient += residuals.dip_row * (dip.weight * residuals.dip);
        for (sum, effect) in system.consider.iter_mut().zip(residuals.attitude_effects) {
            *sum += residuals.dip_row * (dip.weight * effect);
        }
        system.cost += norm.loss + dip.loss;
        system.clipped[0] += norm.clipped;
        system.clipped[1] += dip.clipped;
        let bounded = dip.value.clamp(-CLIP, CLIP);
        system.correlation[0] += bounded * before;
        system.correlation[1] += bounded * bounded;
        system.samples += 1;
        bounded
    }

    /// Priors as residuals that are linear in the unknowns.
    fn add_priors(&self, system: &mut System, unknowns: &Vector13) {
        let mut add = |row: Vector13, sigma: f32| {
            let weight = 1.0 / (sigma * sigma);
            let residual = row.dot(unknowns);
            system.prior.ger(weight, &row, &row, 1.0);
            system.gradient += row * (weight * residual);
            system.cost += 0.5 * weight * residual * residual;
        };
        // Indices of W's elements in the unknowns.
        for (ij, ji) in [(1, 3), (2, 6), (5, 7)] {
            add(unit(ij, 0.5) + unit(ji, 0.5), self.config.soft_iron_sigma);
            add(unit(ij, 0.5) - unit(ji, 0.5), self.config.mounting_sigma);
        }
        let third_of_trace = unit(0, 1.0 / 3.0) + unit(4, 1.0 / 3.0) + unit(8, 1.0 / 3.0);
        for ii in [0, 4, 8] {
            add(unit(ii, 1.0) - third_of_trace, self.config.soft_iron_sigma);
        }
        for b in 9..12 {
            add(unit(b, 1.0), self.config.hard_iron_sigma_ut / self.unit_ut);
        }
    }
}

fn unit(index: usize, value: f32) -> Vector13 {
    let mut vector = Vector13::zeros();
    vector[index] = value;
    vector
}

/// A residual over its sigma, with Huber's weight and loss.
struct Whitened {
    value: f32,
    /// Weight of the squared residual, unwhitened.
    weight: f32,
    loss: f32,
    clipped: f32,
}

impl Whitened {
    fn new(residual: f32, sigma: f32, huber: f32) -> Self {
        let value = residual / sigma;
        let size = value.abs();
        let (weight, loss) =
            if size <= huber { (1.0, 0.5 * size * size) } else { (huber / size, huber * (size - 0.5 * huber)) };
        let bounded = size.min(CLIP);
        Self { value, weight: weight / (sigma * sigma), loss, clipped: bounded * bounded }
    }
}
