//! What the samples leave unknown: from the information in them to the uncertainty of the coefficients.

use nalgebra::{Matrix3, Vector3};

use super::Samples;
use super::likelihood::unknowns::{COEFFICIENTS, Coefficient, Matrix13, Vector13, d, w};
use super::likelihood::{Equations, Likelihood, Measured, Parameters, Quantity, System, for_each_prior};
use super::uncertainty::{Covariance, Uncertainty};
use crate::frames::Attitude;
use crate::trig;

/// Errors of the attitude source that are alike in all samples, 1 sigma. Turns do not reveal them: a bias looks like
/// mounting, a bank scale like soft iron. So they are not estimated but carried.
#[derive(Clone, Copy, Debug)]
pub struct Consider {
    /// Constant roll and pitch bias, radians: 0.2 deg, an autopilot levelled with care.
    pub bias_rad: f32,
    /// Relative error of bank in turns: 1 %, an estimator that knows its airspeed.
    pub bank_scale: f32,
}

impl Consider {
    /// A good autopilot.
    pub const DEFAULT: Self = Self { bias_rad: 0.0035, bank_scale: 0.01 };

    /// A source without faults of its own.
    pub const NOTHING: Self = Self { bias_rad: 0.0, bank_scale: 0.0 };
}

/// Noise of an attitude source that no sample has shown, radians: 0.5 deg.
const UNSEEN_ATTITUDE_SIGMA_RAD: f32 = 0.0087;

/// What a covariance of these unknowns means for headings, with the noise that the samples showed.
pub(super) fn uncertainty(
    likelihood: &Likelihood,
    unknowns: &Vector13,
    covariance: &Covariance,
) -> Option<Uncertainty> {
    let noise = &likelihood.noise;
    let attitude_sigma_rad =
        if likelihood.config.uses_attitude { noise.attitude_sigma_rad() } else { UNSEEN_ATTITUDE_SIGMA_RAD };
    // The mean of so many readings scatters less than one of them.
    let of_a_reading = libm::sqrtf(f32::from(likelihood.readings_per_sample.max(1)));
    let sensor_sigma = noise.norm * of_a_reading / Units::new(likelihood, unknowns)?.per_unit;
    Some(Uncertainty::new(covariance, sensor_sigma, attitude_sigma_rad)).filter(Uncertainty::is_finite)
}

/// Everything the samples say of the coefficients near a set of them.
#[derive(Clone, Debug)]
pub(super) struct Information {
    pub system: System,
    /// The part of the information that comes from dips: the lower triangle.
    dip: Matrix13,
    /// What one radian of roll bias, pitch bias, and a relative bank error of one do to the gradient.
    effects: [Vector13; 3],
    /// Lag-1 autocorrelation sums of the dip residuals: products, squares, and the last one.
    correlation: [f32; 3],
}

impl Information {
    /// What is known without samples.
    #[inline(never)]
    pub fn of_priors(likelihood: &Likelihood, unknowns: &Vector13) -> Self {
        Self {
            system: System::of_priors(likelihood, unknowns),
            dip: Matrix13::zeros(),
            effects: [Vector13::zeros(); 3],
            correlation: [0.0; 3],
        }
    }

    /// Adds what samples say: one pass over them.
    #[inline(never)]
    pub fn add_samples(&mut self, likelihood: &Likelihood, samples: Samples<'_>, unknowns: &Vector13) {
        likelihood.for_each_sample(samples, &Parameters::new(unknowns), &mut |equations| self.add(equations));
    }

    fn add(&mut self, equations: &Equations) {
        self.system.add(equations);
        let Some(dip) = &equations.dip else { return };
        self.dip.syger(dip.weight, &dip.row, &dip.row, 1.0);
        for (sum, effect) in self.effects.iter_mut().zip(equations.attitude_effects) {
            sum.axpy(dip.weight * effect, &dip.row, 1.0);
        }
        let [products, squares, before] = &mut self.correlation;
        let clipped = dip.clipped();
        *products += clipped * *before;
        *squares += dip.clipped_square;
        *before = clipped;
    }

    /// Adds a sample that would be measured at an attitude and heading if the coefficients were right.
    pub fn suppose(&mut self, likelihood: &Likelihood, parameters: &Parameters, attitude: Attitude, heading_rad: f32) {
        let tilt = attitude.tilt();
        let Some(x) = parameters.expected_field(&tilt, heading_rad) else { return };
        let measured = Measured { x, tilt, roll_rad: attitude.roll_rad, heading_rad: None };
        let equations = Equations::new(parameters, &measured, &likelihood.noise, &likelihood.config, true);
        let before = self.correlation;
        self.add(&equations);
        // Its residual is nothing, which says nothing of the noise.
        self.correlation = before;
    }

    /// The covariance of the coefficients, in the units of the [`Calibration`](super::Calibration) that
    /// [`Likelihood::calibration`] makes of the same unknowns. `None` when the information is singular.
    ///
    /// Errors of an attitude source stay alike for about half a second; with lag-1 autocorrelation rho of the dip
    /// residuals their information is worth `(1 - rho) / (1 + rho)` of what it seems, so that the estimator's
    /// covariance is
    /// `H^-1 (H + H_dip 2 rho / (1 - rho)) H^-1`.
    ///
    /// Added to it are the considered errors of the attitude source, and the distance to the most likely coefficients,
    /// which is nothing where these were sought but is the error of a closed form.
    ///
    /// It is put where it is wanted: several copies of it would lie on the stack otherwise.
    #[inline(never)]
    pub fn covariance(
        &self,
        likelihood: &Likelihood,
        unknowns: &Vector13,
        consider: Consider,
        covariance: &mut Covariance,
    ) -> Option<()> {
        let units = Units::new(likelihood, unknowns)?;
        // What each coefficient becomes under `H^-1`: all that is asked of it, and a fraction of the matrix's size.
        let mut columns = [Vector13::zeros(); COEFFICIENTS];
        for (i, column) in columns.iter_mut().enumerate() {
            *column = self.system.covariance_times(&units.row(i))?;
        }
        let change = self.system.change()?;
        let correlated = self.correlated();
        let sigmas = [consider.bias_rad, consider.bias_rad, consider.bank_scale];
        let mut of_dip = Vector13::zeros();
        covariance.fill(|i, j| {
            if j == 0 {
                // The lower triangle is filled row by row.
                of_dip.sygemv(correlated, &self.dip, &columns[i], 0.0);
            }
            let row = units.row(j);
            let shifts = self
                .effects
                .iter()
                .zip(sigmas)
                .map(|(effect, sigma)| columns[i].dot(effect) * sigma * columns[j].dot(effect) * sigma);
            row.dot(&columns[i])
                + of_dip.dot(&columns[j])
                + shifts.sum::<f32>()
                + units.row(i).dot(&change) * row.dot(&change)
        })
    }

    /// How much more the dips' information is doubted: `2 rho / (1 - rho)`.
    fn correlated(&self) -> f32 {
        let [products, squares, _] = self.correlation;
        let rho = if squares > 0.0 { (products / squares).clamp(0.0, 0.8) } else { 0.0 };
        2.0 * rho / (1.0 - rho)
    }

    /// What the samples say nothing of: the quantities of whose prior more than half is left in some direction.
    pub fn left_to_priors(
        &self,
        likelihood: &Likelihood,
        unknowns: &Vector13,
    ) -> Option<impl Iterator<Item = Quantity>> {
        let mut left = [None; Quantity::COUNT];
        let mut determined = true;
        for_each_prior(likelihood, &Parameters::new(unknowns), &mut |prior| {
            let Some(column) = self.system.covariance_times(&prior.row) else {
                determined = false;
                return;
            };
            if prior.row.dot(&column) > 0.25 * prior.sigma * prior.sigma
                && let Some(slot) = left.get_mut(prior.of as usize)
            {
                *slot = Some(prior.of);
            }
        });
        if !determined {
            return None;
        }
        Some(left.into_iter().flatten())
    }
}

/// Takes changes of the unknowns `W` and `d` to changes of `W` in chip axes with a determinant of one, and of `beta`.
/// The corrected field changes by `dW x + dd`, with `x` the field less the mean. Less the hard iron it is `x + W^-1 d`,
/// so that
/// `d beta = dW W^-1 d - dd`.
struct Units {
    /// Makes the determinant one.
    per_unit: f32,
    /// Rows of `W` in mount axes, as columns, to rows in chip axes.
    mount: Matrix3<f32>,
    /// `W^-1 d`.
    from_b: Vector3<f32>,
}

impl Units {
    fn new(likelihood: &Likelihood, unknowns: &Vector13) -> Option<Self> {
        let parameters = Parameters::new(unknowns);
        let per_unit = trig::reciprocal_cbrt(parameters.w.determinant());
        Some(Self { per_unit, mount: likelihood.rotation.transpose() * per_unit, from_b: parameters.mean_from_b()? })
    }

    /// Derivative of the `i`-th coefficient by the unknowns.
    fn row(&self, i: usize) -> Vector13 {
        let mut derivative = Vector13::zeros();
        match Coefficient::at(i) {
            Coefficient::W { row, column } => {
                derivative.fixed_rows_mut::<3>(w(row, 0)).copy_from(&self.mount.row(column).transpose());
            }
            Coefficient::Beta(axis) => {
                derivative.fixed_rows_mut::<3>(w(axis, 0)).copy_from(&self.from_b);
                derivative[d(axis)] = -1.0;
            }
        }
        derivative
    }
}
