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

#[cfg(test)]
mod tests {
    use nalgebra::SMatrix;

    use super::super::likelihood::unknowns::{INCLINATION, UNKNOWNS, Vector12};
    use super::super::likelihood::{Config, Noise, Prior};
    use super::super::tests::derivatives::assert_derivative;
    use super::super::{Calibration, Orientation};
    use super::*;

    type Matrix12 = SMatrix<f32, 12, 12>;

    const TRUTH: Matrix3<f32> = Matrix3::new(1.2, 0.1, -0.2, 0.3, 0.9, 0.1, -0.1, 0.2, 1.1);

    fn parameters() -> Parameters {
        Parameters { w: TRUTH, d: Vector3::new(0.2, -0.4, 0.6), inclination_rad: 0.7 }
    }

    fn likelihood(prior: &Prior, config: Config) -> Likelihood {
        let mut likelihood = Likelihood::new(prior, config, Samples::default(), 40.0);
        likelihood.mean = Vector3::new(0.3, -0.8, 0.5);
        likelihood
    }

    /// Each coefficient's row holds its derivatives by the unknowns, found by moving the unknowns and asking for the
    /// calibration they make: in units of the total field before the move, `W F / F'`, and `beta = W (b' - b) / F`.
    #[test]
    fn the_coefficients_rows() {
        for mount in ["none", "yaw90", "roll90-pitch180-yaw90"] {
            let prior = Prior { mount: Orientation::from_name(mount).unwrap(), ..Prior::default() };
            let likelihood = likelihood(&prior, Config::DEFAULT);
            let at = parameters().unknowns().unwrap();
            let units = Units::new(&likelihood, &at).unwrap();
            let before = likelihood.calibration(&at).unwrap();
            let coefficient = |calibration: &Calibration, i: usize| match Coefficient::at(i) {
                Coefficient::W { row, column } => calibration.w[row][column] * before.total_ut / calibration.total_ut,
                Coefficient::Beta(axis) => {
                    let moved = (calibration.b_vector_ut() - before.b_vector_ut()) / before.total_ut;
                    (before.w_matrix() * moved)[axis]
                }
            };
            for i in 0..COEFFICIENTS {
                let row = units.row(i);
                for j in 0..UNKNOWNS {
                    let moved = |step: f32| {
                        let mut unknowns = at;
                        unknowns[j] += step;
                        coefficient(&likelihood.calibration(&unknowns).unwrap(), i)
                    };
                    assert_derivative(row[j], moved, &format!("coefficient {i} by unknown {j}, {mount}"));
                }
            }
        }
    }

    /// Every coefficient known by itself: information of one for each unknown, from a norm each.
    fn informed(likelihood: &Likelihood, unknowns: &Vector13, weight: f32) -> Information {
        let mut information = Information::of_priors(likelihood, unknowns);
        for i in 0..UNKNOWNS {
            information.system.add(&only_norm(Vector13::ith(i, 1.0), 0.0, 1.0 / weight));
        }
        information
    }

    fn only_norm(row: Vector13, residual: f32, variance: f32) -> Equations {
        let parameters = parameters();
        let tilt = Attitude::default().tilt();
        let measured = Measured { x: Vector3::zeros(), tilt, roll_rad: 0.0, heading_rad: None };
        let noise = Noise::INITIAL;
        let equations = Equations::new(&parameters, &measured, &noise, &Config::NO_ATTITUDE, false);
        let mut norm = equations.norm.clone();
        (norm.row, norm.residual, norm.weight) = (row, residual, 1.0 / variance);
        Equations { norm, ..equations }
    }

    /// A covariance as a matrix, by the variances of pairs: `cov(a, b) = (var(a + b) - var(a) - var(b)) / 2`.
    fn full(information: &Information, likelihood: &Likelihood, at: &Vector13, consider: Consider) -> Matrix12 {
        let mut covariance = Covariance::EXACT;
        information.covariance(likelihood, at, consider, &mut covariance).unwrap();
        let one = |i: usize| Vector12::ith(i, 1.0);
        let of = |row: Vector12| covariance.variance(&row);
        Matrix12::from_fn(|i, j| (of(one(i) + one(j)) - of(one(i)) - of(one(j))) / 2.0)
    }

    /// The covariance in the module's units: `J H^-1 J^T`, plus what is considered, plus the square of the way that is
    /// left to the most likely unknowns. Against full matrices.
    #[test]
    fn the_covariance_is_that_of_its_parts() {
        let likelihood = likelihood(&Prior::default(), Config::DEFAULT);
        let at = parameters().unknowns().unwrap();
        let mut information = informed(&likelihood, &at, 1e4);
        let row = Vector13::from_fn(|i, _| (i as f32 * 0.7).sin());
        information.system.add(&only_norm(row, 0.02, 1e-4));
        // A dip's information, whose noise is correlated with rho one half: doubted by 2 rho / (1 - rho) = 2.
        let dip_row = Vector13::from_fn(|i, _| (i as f32 * 1.3).cos());
        information.dip.syger(3e3, &dip_row, &dip_row, 1.0);
        information.correlation = [5.0, 10.0, 0.0];
        information.effects =
            [0.4, 1.9, 2.8].map(|phase: f32| Vector13::from_fn(|i, _| 1e4 * (i as f32 + phase).sin()));
        let units = Units::new(&likelihood, &at).unwrap();
        let j = SMatrix::<f32, 12, 13>::from_fn(|i, k| units.row(i)[k]);
        let mut inverse = Matrix13::zeros();
        for k in 0..UNKNOWNS {
            inverse.set_column(k, &information.system.covariance_times(&Vector13::ith(k, 1.0)).unwrap());
        }
        let g = j * inverse;
        let change = j * information.system.change().unwrap();
        let consider = Consider { bias_rad: 0.003, bank_scale: 0.02 };
        let mut expected = g * j.transpose() + g * dip_row * dip_row.transpose() * g.transpose() * (3e3 * 2.0);
        expected += change * change.transpose();
        for (effect, sigma) in information.effects.iter().zip([0.003, 0.003, 0.02]) {
            let shift = g * effect * sigma;
            expected += shift * shift.transpose();
        }
        let found = full(&information, &likelihood, &at, consider);
        let scale = expected.diagonal().amax();
        for (f, e) in found.iter().zip(&expected) {
            assert!((f - e).abs() < 1e-4 * scale, "{found} {expected}");
        }
        // Each of the parts is large enough to be missed.
        assert!(full(&information, &likelihood, &at, Consider::NOTHING).diagonal().amax() < 0.97 * scale);
        assert!((change * change.transpose()).diagonal().amax() > 0.01 * scale);
    }

    /// Nothing is doubted of noise that is white or alternates; at most, nine tenths is lost.
    #[test]
    fn correlated_dips_are_worth_less() {
        let likelihood = likelihood(&Prior::default(), Config::DEFAULT);
        let mut information = Information::of_priors(&likelihood, &parameters().unknowns().unwrap());
        for (products, squares, doubt) in [
            (0.0, 0.0, 0.0),
            (-5.0, 10.0, 0.0),
            (2.0, 10.0, 0.5),
            (7.9, 10.0, 7.5238),
            (8.1, 10.0, 8.0),
            (10.0, 10.0, 8.0),
        ] {
            information.correlation = [products, squares, 0.0];
            let found = information.correlated();
            assert!((found - doubt).abs() < 1e-3, "{products} {squares}: {found}");
        }
    }

    /// The autocorrelation is that of each dip with the one before, clipped; a supposed sample has no part in it.
    #[test]
    fn correlation_is_of_neighbours() {
        let likelihood = likelihood(&Prior::default(), Config::DEFAULT);
        let parameters = parameters();
        let at = parameters.unknowns().unwrap();
        let mut information = Information::of_priors(&likelihood, &at);
        let tilt = Attitude::default().tilt();
        let mut clipped = Vec::new();
        for heading in [0.1, 1.0, 2.5, 4.0] {
            let x = parameters.expected_field(&tilt, heading).unwrap() + Vector3::new(0.0, 0.02, 0.1 * heading - 0.2);
            let measured = Measured { x, tilt, roll_rad: 0.0, heading_rad: None };
            let equations = Equations::new(&parameters, &measured, &likelihood.noise, &likelihood.config, false);
            clipped.push(equations.dip.as_ref().unwrap().clipped());
            information.add(&equations);
        }
        let [products, squares, last] = information.correlation;
        let pairs: f32 = clipped.windows(2).map(|pair| pair[0] * pair[1]).sum();
        let sum: f32 = clipped.iter().map(|c| c * c).sum();
        assert!(pairs.abs() > 0.01 && (products - pairs).abs() < 1e-5 && (squares - sum).abs() < 1e-5);
        assert!((last - clipped[3]).abs() < 1e-6);
        let (before, samples) = (information.correlation, information.system.samples);
        information.suppose(&likelihood, &parameters, Attitude::from_deg(25.0, 0.0), 1.0);
        assert_eq!((information.correlation, information.system.samples), (before, samples + 1));
    }

    /// The effect of an attitude error is its effect on each dip, weighed and summed as the dips are.
    #[test]
    fn effects_and_information_of_dips_are_summed() {
        let likelihood = likelihood(&Prior::default(), Config::DEFAULT);
        let parameters = parameters();
        let mut information = Information::of_priors(&likelihood, &parameters.unknowns().unwrap());
        let mut dip = Matrix13::zeros();
        let mut effects = [Vector13::zeros(); 3];
        for (bank_deg, heading_rad) in [(25.0, 0.3), (-40.0, 2.0), (10.0, 5.0)] {
            let attitude = Attitude::from_deg(bank_deg, 3.0);
            let tilt = attitude.tilt();
            let x = parameters.expected_field(&tilt, heading_rad).unwrap();
            let measured = Measured { x, tilt, roll_rad: attitude.roll_rad, heading_rad: None };
            let equations = Equations::new(&parameters, &measured, &likelihood.noise, &likelihood.config, false);
            let of_dip = equations.dip.as_ref().unwrap();
            dip += of_dip.row * of_dip.row.transpose() * of_dip.weight;
            for (sum, effect) in effects.iter_mut().zip(equations.attitude_effects) {
                *sum += of_dip.row * (of_dip.weight * effect);
            }
            information.add(&equations);
        }
        let found = information.dip.lower_triangle();
        assert!((found - dip.lower_triangle()).norm() < 1e-4 * dip.norm());
        for (found, expected) in information.effects.iter().zip(effects) {
            assert!((found - expected).norm() < 1e-4 * expected.norm());
        }
    }

    /// A prior is what a quantity rests on when more than half of its sigma is left: three times the prior's own
    /// information is the border.
    #[test]
    fn more_than_half_of_a_prior_is_left_to_it() {
        let prior = Prior { inclination_rad: Some(0.7), ..Prior::default() };
        let likelihood = likelihood(&prior, Config::DEFAULT);
        let at = parameters().unknowns().unwrap();
        for (times, left) in [(2.9, true), (3.1, false)] {
            let mut information = Information::of_priors(&likelihood, &at);
            let variance = likelihood.config.known_inclination_sigma_rad.powi(2) / times;
            for i in 0..INCLINATION {
                information.system.add(&only_norm(Vector13::ith(i, 1.0), 0.0, 1e-6));
            }
            information.system.add(&only_norm(Vector13::ith(INCLINATION, 1.0), 0.0, variance));
            let found: Vec<Quantity> = information.left_to_priors(&likelihood, &at).unwrap().collect();
            assert_eq!(found, if left { vec![Quantity::Inclination] } else { vec![] }, "{times}");
        }
    }

    /// The samples' noise in units of the total field, that of one reading: the mean of eight scatters by a third of
    /// it.
    #[test]
    fn the_sensor_s_noise_is_that_of_a_single_reading() {
        let at = parameters().unknowns().unwrap();
        let per_unit = TRUTH.determinant().cbrt();
        for (readings_per_sample, factor) in [(1, 1.0), (8, 8_f32.sqrt()), (0, 1.0)] {
            let mut likelihood = likelihood(&Prior { readings_per_sample, ..Prior::default() }, Config::DEFAULT);
            likelihood.noise = Noise::new(0.003, 0.005, TRUTH);
            let found = uncertainty(&likelihood, &at, &Covariance::EXACT).unwrap();
            let expected = 0.003 * factor * per_unit;
            assert!(
                (found.sensor_sigma / expected - 1.0).abs() < 1e-5,
                "{readings_per_sample}: {}",
                found.sensor_sigma
            );
            assert!((found.attitude_sigma_rad - 0.004).abs() < 1e-6);
        }
        assert_eq!(Prior::default().readings_per_sample, 1);
    }

    /// A tumble shows nothing of the attitude source that will be used: half a degree is taken for it.
    #[test]
    fn attitude_noise_that_was_not_seen_is_half_a_degree() {
        let likelihood = likelihood(&Prior::default(), Config::NO_ATTITUDE);
        let found = uncertainty(&likelihood, &parameters().unknowns().unwrap(), &Covariance::EXACT).unwrap();
        assert!((found.attitude_sigma_rad.to_degrees() - 0.5).abs() < 0.002);
    }

    /// Without an inverse of `W` nothing is known of hard iron, and a field that is flattened is no field.
    #[test]
    fn what_is_open_has_no_covariance() {
        let likelihood = likelihood(&Prior::default(), Config::DEFAULT);
        let at = parameters().unknowns().unwrap();
        let flat = Parameters { w: Matrix3::zeros(), ..parameters() }.unknowns().unwrap();
        let open = Information::of_priors(&likelihood, &flat);
        let mut covariance = Covariance::EXACT;
        for unknowns in [&at, &flat] {
            assert!(open.covariance(&likelihood, unknowns, Consider::NOTHING, &mut covariance).is_none());
        }
        assert!(open.left_to_priors(&likelihood, &at).is_none());
        assert!(uncertainty(&likelihood, &flat, &Covariance::EXACT).is_none());
    }
}
