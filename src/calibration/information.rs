//! What the samples leave unknown: from the information in them to the uncertainty of the coefficients.

use nalgebra::{Matrix3, Vector3};

use super::bank_scale::{BankEvidence, BankScale, Clusters};
use super::constancy::{Scan, Sums, by_beta, kinds};
use super::correlation::Correlation;
use super::current_iron::{Found, IS_LOOKED_FOR};
use super::latency::LatencyEvidence;
use super::likelihood::unknowns::{COEFFICIENTS, Coefficient, INCLINATION, Vector12, Vector13, beta, d, w};
use super::likelihood::{
    Equation, Equations, Likelihood, Measured, Parameters, Quantity, Squares, System, for_each_prior,
};
use super::roughness::Roughness;
use super::time_order::{InTime, PARTS};
use super::uncertainty::{Covariance, Uncertainty};
use super::unevenness::Unevenness;
use super::{Latency, Rates, Samples, inverse};
use crate::frames::Attitude;
use crate::trig;

/// Errors of the attitude source that are alike in all samples, 1 sigma. Turns do not reveal them: a bias looks like
/// mounting, a bank scale like soft iron. So they are not estimated but carried.
#[derive(Clone, Copy, Debug, PartialEq)]
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

    /// Of roll bias, pitch bias, the relative error of bank, and of a latency.
    const fn sigmas(self, latency_s: f32) -> [f32; 4] {
        [self.bias_rad, self.bias_rad, self.bank_scale, latency_s]
    }

    /// The same, and as much of a bank error as samples show beyond it.
    pub(super) fn with(self, bank: &BankScale) -> Self {
        let square = self.bank_scale * self.bank_scale + bank.beyond(self.bank_scale);
        Self { bank_scale: libm::sqrtf(square), ..self }
    }
}

/// Of what is known of the inclination, the samples must add this share to be asked alone: below it, the difference of
/// two large numbers in `f32` is none.
const MIN_OWN_SHARE: f32 = 0.05;

/// Noise of an attitude source that no sample has shown, radians: 0.5 deg.
const UNSEEN_ATTITUDE_SIGMA_RAD: f32 = 0.0087;

/// What a covariance of these unknowns means for headings, with the noise that the samples showed: of the norms'
/// variance this share is white.
///
/// The dip's own robust scale is that of the attitude and of the sensor's white noise together, which is the sensor's
/// share of a reading's; what is left is the attitude's, and what is slow in the field does as much to a heading. It is
/// Huber's proposal 2, the mean of `min(e^2, (2 s)^2) / 0.92` that is `s^2` itself: a buffer that a median would need is
/// not there, and where tails are long it is the larger of the two.
pub(super) fn uncertainty(
    likelihood: &Likelihood,
    unknowns: &Vector13,
    covariance: &Covariance,
    white_share: f32,
) -> Option<Uncertainty> {
    let noise = &likelihood.noise;
    let white = noise.norm * noise.norm * white_share;
    let attitude_sigma_rad = if likelihood.config.uses_attitude {
        libm::sqrtf((noise.dip_rad * noise.dip_rad - white).max(0.0))
    } else {
        UNSEEN_ATTITUDE_SIGMA_RAD
    };
    // The mean of so many readings scatters less than one of them.
    let of_a_reading = libm::sqrtf(white * f32::from(likelihood.readings_per_sample.max(1)));
    let sensor_sigma = of_a_reading / Units::new(likelihood, unknowns)?.per_unit;
    Some(Uncertainty::new(covariance, sensor_sigma, attitude_sigma_rad)).filter(Uncertainty::is_finite)
}

/// Which errors of the coefficients a covariance is of.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Errors {
    /// All of them.
    All,
    /// Those that more of the same samples would leave: what they do not show, which rests on the priors, and what the
    /// attitude source does alike in all of them. With `k` times the information the scatter is `1 / k` of what it is,
    /// and of the rest nothing changes.
    Lasting,
}

/// Everything the samples say of the coefficients near a set of them.
#[derive(Clone, Debug)]
pub(super) struct Information {
    pub system: System,
    /// The part of the information that comes from dips.
    dip: Squares,
    /// What one radian of roll bias, pitch bias, a relative bank error of one, and a second of latency do to the gradient.
    effects: [Vector13; 4],
    bank: BankEvidence,
    latency: LatencyEvidence,
    /// Sigma of the latency, seconds: what is not known of it is not known of the coefficients.
    latency_sigma_s: f32,
    /// Of what goes with the current.
    by_current: Sums,
    /// What is not known of it, mount axes and units of field per ampere: vectors to be summed up as squares.
    current_errors: [Vector3<f32>; 4],
    correlation: Correlation,
    unevenness: Unevenness,
    roughness: Roughness,
    /// What a change of the iron in mid-flight did to the gradient; nothing, unless the samples show one.
    pub changed: Vector13,
}

impl Information {
    /// Of the priors and, if there are any, samples, as far as the linearised problem has them.
    #[inline(never)]
    pub fn new(system: &System) -> Self {
        Self {
            system: system.clone(),
            dip: Squares::none(),
            effects: [Vector13::zeros(); 4],
            bank: BankEvidence::default(),
            latency: LatencyEvidence::default(),
            latency_sigma_s: 0.0,
            by_current: Sums::none(),
            current_errors: [Vector3::zeros(); 4],
            correlation: Correlation::default(),
            unevenness: Unevenness::default(),
            roughness: Roughness::default(),
            changed: Vector13::zeros(),
        }
    }

    /// Adds what the samples of the system say besides: one pass over them, in which a change of the iron is looked
    /// for, too, where they are of turns.
    #[inline(never)]
    pub fn look(
        &mut self,
        likelihood: &Likelihood,
        samples: Samples<'_>,
        unknowns: &Vector13,
        mut scan: Option<&mut Scan>,
    ) {
        let parameters = Parameters::new(unknowns);
        for (part, sample) in InTime::new(samples) {
            let equations = likelihood.equations(sample, None, &parameters);
            self.add_dip(&equations);
            if IS_LOOKED_FOR && likelihood.current.spread_a > 0.0 {
                let share_a = likelihood.current.share_a(sample);
                kinds(&equations)
                    .for_each(|equation| self.by_current.add(equation, &by_beta(&parameters.w, equation), share_a));
            }
            if let Some(dip) = &equations.dip {
                let [.., by_latency] = equations.attitude_effects;
                self.latency.add(part, dip, by_latency);
            }
            let dip = equations.dip.as_ref().map_or(0.0, Equation::clipped);
            // Whoever stands at a heading that he gives wrong makes norms there that are alike, and that is in the
            // sigma of what he gives.
            let norm = if scan.is_some() { equations.norm.clipped() } else { 0.0 };
            self.correlation.add(part, [norm, dip]);
            self.unevenness.add(sample.attitude, dip);
            self.roughness.add(part, sample.time, equations.norm.clipped());
            if let Some(scan) = &mut scan {
                scan.add(&self.system, sample.time, &equations);
            }
        }
        for mark in samples.marks {
            let equations = likelihood.equations(&mark.sample, Some(mark.heading_rad), &parameters);
            self.add_dip(&equations);
            self.correlation.add(PARTS - 1, [0.0, equations.dip.as_ref().map_or(0.0, Equation::clipped)]);
        }
    }

    fn add_dip(&mut self, equations: &Equations) {
        let Some(dip) = &equations.dip else { return };
        self.dip.add(&dip.row, dip.weight);
        for (sum, effect) in self.effects.iter_mut().zip(equations.attitude_effects) {
            dip.row.add_to(sum, dip.weight * effect);
        }
        self.bank.add(dip, equations.attitude_effects);
    }

    /// Adds a sample that would be measured at an attitude and heading if the coefficients were right. Its residual is
    /// nothing, which says nothing of the noise, and leaves nothing to correct.
    pub fn suppose(&mut self, likelihood: &Likelihood, parameters: &Parameters, attitude: Attitude, heading_rad: f32) {
        let tilt = attitude.tilt();
        let Some(x) = parameters.expected_field(&tilt, heading_rad) else { return };
        let measured = Measured { x, tilt, roll_rad: attitude.roll_rad, rates: Rates::NONE, heading_rad: None };
        let equations = Equations::new(parameters, &measured, &likelihood.noise, &likelihood.config, false);
        self.system.add(&equations);
        self.add_dip(&equations);
    }

    /// The covariance of the coefficients, in the units of the [`Calibration`](super::Calibration) that
    /// [`Likelihood::calibration`] makes of the same unknowns. `None` when the information is singular.
    ///
    /// Errors of an attitude source stay alike for about half a second, and what the model leaves out of the field for
    /// as long as it lasts. With lag-1 autocorrelations of the dip's and the norm's residuals, and `x = 2 rho / (1 -
    /// rho)` of each, the estimator's covariance is
    /// `H^-1 (H + x_dip H_dip + x_norm H_norm) H^-1`, where `H_norm = H - H_dip - H_priors`, and `1 + x_dip` is that times
    /// what dips scatter [more](super::unevenness) where they tell most.
    ///
    /// Added to it are the considered errors of the attitude source, what a change of the iron did, and the distance to
    /// the most likely coefficients, which is nothing where these were sought but is the error of a closed form.
    ///
    /// It is put where it is wanted: several copies of it would lie on the stack otherwise.
    #[inline(never)]
    pub fn covariance(
        &self,
        likelihood: &Likelihood,
        unknowns: &Vector13,
        (errors, consider): (Errors, Consider),
        covariance: &mut Covariance,
    ) -> Option<()> {
        let units = Units::new(likelihood, unknowns)?;
        // What each coefficient becomes under `H^-1`: all that is asked of it, and a fraction of the matrix's size.
        let mut columns = [Vector13::zeros(); COEFFICIENTS];
        for (i, column) in columns.iter_mut().enumerate() {
            *column = self.system.covariance_times(&units.row(i))?;
        }
        let [mut of_norm, of_dip] = self.correlation.excess();
        let of_dip = (1.0 + of_dip) * self.unevenness.ratio() - 1.0;
        let mut doubted = Vector13::zeros();
        covariance.fill(|i, j| {
            if errors == Errors::Lasting {
                return 0.0;
            }
            if j == 0 {
                // The lower triangle is filled row by row.
                doubted = units.row(i) * (1.0 + of_norm) + self.dip.times(&columns[i]) * (of_dip - of_norm);
            }
            doubted.dot(&columns[j])
        });
        if errors == Errors::Lasting {
            // `H^-1 H_priors H^-1` is added below, nothing else of the scatter.
            of_norm = -1.0;
        }
        let along = |vector: &Vector13| Vector12::from_fn(|i, _| columns[i].dot(vector));
        for_each_prior(likelihood, &Parameters::new(unknowns), &mut |prior| {
            covariance.add_square(&along(&prior.row), -of_norm / (prior.sigma * prior.sigma));
        });
        for (effect, sigma) in self.effects.iter().zip(consider.sigmas(self.latency_sigma_s)) {
            covariance.add_square(&along(effect), sigma * sigma);
        }
        covariance.add_square(&along(&self.changed), 1.0);
        let per_ampere = Parameters::new(unknowns).w;
        for error in self.current_errors.iter().filter(|_| IS_LOOKED_FOR) {
            covariance.add_square(&along(&self.effect_of(error)), 1.0);
            // At the mean current the others follow; at its spread about that the field is wrong by so much more.
            let beyond = per_ampere * error * likelihood.current.spread_a;
            let mut coefficients = Vector12::zeros();
            for axis in 0..3 {
                coefficients[beta(axis)] = beyond[axis];
            }
            covariance.add_square(&coefficients, 1.0);
        }
        let change = self.system.change()?;
        covariance.add_square(&Vector12::from_fn(|i, _| units.row(i).dot(&change)), 1.0);
        covariance.is_finite().then_some(())
    }

    /// `(x - x_0) H_dip vector`: by how much more than `x_0` the variance of the dips' errors is of what they were
    /// taken for, if it is.
    pub fn dips_times(&self, vector: &Vector13, than: f32) -> Vector13 {
        let [_, of_dip] = self.correlation.excess();
        self.dip.times(vector) * (1.0 + of_dip - than).max(0.0)
    }

    /// The latency that the samples show, and how the unknowns follow a second of it: see [`latency`](super::latency).
    /// From then on what is not known of it counts. `None` where they have no rates.
    #[inline(never)]
    pub fn latency(&mut self, used_s: f32) -> Option<(Latency, Vector13)> {
        let [.., effect] = &self.effects;
        let follows = -self.system.covariance_times(effect)?;
        let (known, pulled) = (-follows.dot(effect), effect.dot(&self.system.change()?));
        let latency = self.latency.latency(used_s, known, pulled)?;
        self.latency_sigma_s = latency.sigma_s;
        Some((latency, follows))
    }

    /// What the samples show of iron that goes with the current: see [`current_iron`](super::current_iron). From then on
    /// what is not known of it counts. `None` where they know no current that changes.
    #[inline(never)]
    pub fn current(&mut self, likelihood: &Likelihood) -> Option<Found> {
        if !IS_LOOKED_FOR || likelihood.current.spread_a == 0.0 {
            return None;
        }
        let (used, prior) = (likelihood.k(), Found::prior(likelihood.unit_ut));
        let (own, gradient) = self.by_current.left(&self.system, &self.system.change()?)?;
        let all = own + Matrix3::from_diagonal_element(prior);
        let independent = inverse(&all)?;
        let k = used + independent * (gradient - used * prior);
        let alone = k.dot(&(all * k));
        let inflation = self.inflation();
        let covariance = independent * own * independent * inflation + independent * independent * prior;
        let found = Found { k, covariance, significance: [alone, alone / inflation] };
        self.current_errors = found.roots(&used);
        (alone + found.sigma()).is_finite().then_some(found)
    }

    /// `H_ub` times a change of `k`.
    fn effect_of(&self, k: &Vector3<f32>) -> Vector13 {
        self.by_current.with_unknowns.iter().zip(k).map(|(with, k)| with * *k).sum()
    }

    /// How the unknowns follow a change of what goes with the current.
    pub fn following(&self, k: &Vector3<f32>) -> Option<Vector13> {
        Some(-self.system.covariance_times(&self.effect_of(k))?)
    }

    /// How much of the norms' variance is white.
    pub fn white_share(&self) -> f32 {
        self.roughness.white_share()
    }

    /// By what the covariance of the attitude's and the field's errors is larger than were they independent, at most.
    #[inline(never)]
    fn inflation(&self) -> f32 {
        let [of_norm, of_dip] = self.correlation.excess();
        1.0 + of_norm.max(of_dip)
    }

    /// What the samples show of the attitude source's bank, if it is more than an allowance and chance: see
    /// [`BankEvidence`]. A second pass over them, which only a suspicious flight needs.
    #[inline(never)]
    pub fn bank(
        &self,
        likelihood: &Likelihood,
        samples: Samples<'_>,
        unknowns: &Vector13,
        allowance: f32,
    ) -> Option<BankScale> {
        let [_, _, effect, _] = &self.effects;
        let column = self.system.covariance_times(effect)?;
        let (known, pulled) = (column.dot(effect), effect.dot(&self.system.change()?));
        let found = self.bank.scale(known, pulled, likelihood.noise.attitude_sigma_rad(), self.inflation())?;
        found.error(allowance)?;
        let parameters = Parameters::new(unknowns);
        let mut clusters = Clusters::default();
        for (part, sample) in InTime::new(samples) {
            clusters.add(part, &likelihood.equations(sample, None, &parameters), &column);
        }
        found.with(clusters)
    }

    /// The inclination that the samples alone show, radians, with its variance; `None` when they show nothing of it.
    /// Where a known one was among the priors, the result is a mean of the two.
    pub fn own_inclination(
        &self,
        likelihood: &Likelihood,
        unknowns: &Vector13,
        consider: Consider,
    ) -> Option<[f32; 2]> {
        let column = self.system.covariance_times(&Vector13::ith(INCLINATION, 1.0))?;
        let of_all = column[INCLINATION];
        let found_rad = unknowns[INCLINATION];
        let (share, own_rad) = match likelihood.known_inclination_rad {
            None => (1.0, found_rad),
            Some(known_rad) => {
                let known =
                    likelihood.config.known_inclination_sigma_rad * likelihood.config.known_inclination_sigma_rad;
                // Informations add: `1 / of_all = 1 / known + 1 / own`.
                let share = 1.0 - of_all / known;
                if share < MIN_OWN_SHARE {
                    return None;
                }
                (share, known_rad + (found_rad - known_rad) / share)
            }
        };
        let shifts = self
            .effects
            .iter()
            .zip(consider.sigmas(self.latency_sigma_s))
            .map(|(effect, sigma)| column.dot(effect) * sigma);
        let shifted = shifts.map(|shift| shift * shift).sum::<f32>() / (share * share);
        let variance = of_all / share * self.inflation() + shifted;
        (own_rad + variance).is_finite().then_some([own_rad, variance])
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
    use nalgebra::{SMatrix, SVector};

    use super::super::least_squares::LeastSquares;
    use super::super::likelihood::unknowns::{Matrix13, UNKNOWNS};
    use super::super::likelihood::{Config, Noise, Prior, Row};
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

    /// What is known without samples.
    fn of_priors(likelihood: &Likelihood, unknowns: &Vector13) -> Information {
        Information::new(&System::of_priors(likelihood, unknowns))
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
        let mut information = of_priors(likelihood, unknowns);
        for i in 0..UNKNOWNS {
            information.system.add_row(&Vector13::ith(i, 1.0), 0.0, weight);
        }
        information
    }

    /// A covariance as a matrix, by the variances of pairs: `cov(a, b) = (var(a + b) - var(a) - var(b)) / 2`.
    fn full(information: &Information, likelihood: &Likelihood, at: &Vector13, consider: Consider) -> Matrix12 {
        let mut covariance = Covariance::EXACT;
        information.covariance(likelihood, at, (Errors::All, consider), &mut covariance).unwrap();
        let one = |i: usize| Vector12::ith(i, 1.0);
        let of = |row: Vector12| covariance.variance(&row);
        Matrix12::from_fn(|i, j| (of(one(i) + one(j)) - of(one(i)) - of(one(j))) / 2.0)
    }

    /// The covariance in the module's units: `J H^-1 J^T`, plus what is considered, plus the square of the way that is
    /// left to the most likely unknowns. Against full matrices.
    #[test]
    fn the_covariance_is_that_of_its_parts() {
        let mut likelihood = likelihood(&Prior::default(), Config::DEFAULT);
        likelihood.current.spread_a = 10.0;
        let at = parameters().unknowns().unwrap();
        let mut information = informed(&likelihood, &at, 1e4);
        let row = Vector13::from_fn(|i, _| (i as f32 * 0.7).sin());
        information.system.add_row(&row, 0.05, 1e4);
        // A dip's information, whose noise is correlated with rho one half: doubted by 2 rho / (1 - rho) = 2. The
        // norm's rho is a third: what is neither dip nor prior is doubted by 1.
        let dip = Row { by_field: Vector3::new(1.0, -0.7, 0.5), x: Vector3::new(0.6, 0.9, -1.1), by_inclination: -1.0 };
        let dip_row = dip.dense();
        information.system.add_row(&dip_row, 0.0, 3e3);
        information.dip.add(&dip, 3e3);
        for residuals in [[1.0, 1.0], [1.0, 1.0], [0.0, 0.0], [0.0, 0.0], [1.0, 1.0], [0.0, 1.0]] {
            information.correlation.add(0, residuals);
        }
        information.changed = Vector13::from_fn(|i, _| 150.0 * (i as f32 * 0.3).cos());
        information.latency_sigma_s = 0.01;
        let with: [f32; 3] = [0.2, 1.1, 2.3];
        information.by_current.with_unknowns =
            with.map(|phase| Vector13::from_fn(|i, _| 1e5 * (i as f32 * 0.9 + phase).sin()));
        information.current_errors = [[1.0, 0.4, -0.3], [0.0, 0.8, 0.5], [0.0, 0.0, 0.6], [-0.7, 0.2, 0.9]]
            .map(|error: [f32; 3]| Vector3::from(error) * 1e-3);
        information.effects =
            [0.4, 1.9, 2.8, 3.7].map(|phase: f32| Vector13::from_fn(|i, _| 1e4 * (i as f32 + phase).sin()));
        let units = Units::new(&likelihood, &at).unwrap();
        let j = SMatrix::<f32, 12, 13>::from_fn(|i, k| units.row(i)[k]);
        let mut inverse = Matrix13::zeros();
        for k in 0..UNKNOWNS {
            inverse.set_column(k, &information.system.covariance_times(&Vector13::ith(k, 1.0)).unwrap());
        }
        let g = j * inverse;
        let change = j * information.system.change().unwrap();
        let consider = Consider { bias_rad: 0.003, bank_scale: 0.02 };
        let norm = (Matrix13::identity() + row * row.transpose()) * 1e4;
        let doubted = norm + dip_row * dip_row.transpose() * (3e3 * 2.0);
        let mut expected = g * j.transpose() + g * doubted * g.transpose();
        let shift = g * information.changed;
        expected += shift * shift.transpose();
        expected += change * change.transpose();
        for (effect, sigma) in information.effects.iter().zip([0.003, 0.003, 0.02, 0.01]) {
            let shift = g * effect * sigma;
            expected += shift * shift.transpose();
        }
        // Of the current's iron the others follow at the mean current, and at its spread hard iron is more by so much.
        let mut followed = Matrix12::zeros();
        let mut beyond = Matrix12::zeros();
        for error in information.current_errors {
            let [x, y, z] = information.by_current.with_unknowns;
            let shift = g * (x * error.x + y * error.y + z * error.z);
            followed += shift * shift.transpose();
            let mut spread = Vector12::zeros();
            for axis in 0..3 {
                spread[beta(axis)] = (parameters().w * error)[axis] * 10.0;
            }
            beyond += spread * spread.transpose();
        }
        expected += followed + beyond;
        let found = full(&information, &likelihood, &at, consider);
        let scale = expected.diagonal().amax();
        for (f, e) in found.iter().zip(&expected) {
            assert!((f - e).abs() < 1e-4 * scale, "{found} {expected}");
        }
        // Each of the parts is large enough to be missed.
        assert!(full(&information, &likelihood, &at, Consider::NOTHING).diagonal().amax() < 0.97 * scale);
        for part in [change * change.transpose(), shift * shift.transpose(), g * norm * g.transpose(), followed, beyond]
        {
            let size = part.diagonal().amax() / scale;
            assert!(size > 0.01, "{size}");
        }
    }

    /// Iron that goes with the current is what least squares of all sixteen unknowns make of it, with what is known of it
    /// beforehand as three rows more. Errors that are alike make what samples tell of it scatter by so much more; what is known
    /// beforehand has no neighbours.
    #[test]
    fn what_goes_with_the_current_is_sought_with_what_is_known_of_it() {
        let mut likelihood = likelihood(&Prior::default(), Config::DEFAULT);
        likelihood.current.spread_a = 10.0;
        likelihood.current.ut_per_a = [0.3, -0.2, 0.25];
        let at = parameters().unknowns().unwrap();
        let mut information = informed(&likelihood, &at, 1e4);
        let mut joint = LeastSquares::<16, 1>::new();
        let rows = |row: &Vector13, more: Vector3<f32>| row.push(more.x).push(more.y).push(more.z);
        for_each_prior(&likelihood, &parameters(), &mut |prior| {
            let row = rows(&prior.row, Vector3::zeros());
            joint.add(&row, [-prior.residual], 1.0 / (prior.sigma * prior.sigma));
        });
        for i in 0..UNKNOWNS {
            joint.add(&SVector::ith(i, 1.0), [0.0], 1e4);
        }
        let prior = Found::prior(likelihood.unit_ut);
        for axis in 0..3 {
            joint.add(&SVector::ith(UNKNOWNS + axis, 1.0), [-likelihood.k()[axis]], prior);
        }
        // Samples tell of each axis about as much as is known before.
        for (i, residual) in [(0, 0.02), (1, -0.01), (2, 0.015), (3, 0.005)] {
            let by_field = Vector3::from_fn(|axis, _| f32::sin(i as f32 * 2.1 + axis as f32 * 1.3));
            let row = Row { by_field, x: Vector3::new(0.6, 0.9, -1.1), by_inclination: 0.3 };
            let equation = Equation::new(row, residual, 1.0 / 1e4, 1e6);
            let (more, share_a) = (by_beta(&parameters().w, &equation), 1.0 + i as f32 / 2.0);
            information.by_current.add(&equation, &more, share_a);
            information.system.add_row(&equation.row.dense(), residual, 1e4);
            joint.add(&rows(&equation.row.dense(), more * share_a), [-residual], 1e4);
        }
        for residual in [1.0, 1.0, 0.0] {
            information.correlation.add(0, [residual, 0.0]);
        }
        let found = information.current(&likelihood).unwrap();
        let step = joint.solve().unwrap().fixed_rows::<3>(UNKNOWNS).into_owned();
        assert!((found.k - likelihood.k() - step).norm() < 1e-3 * step.norm(), "{found:?} {step}");
        let independent =
            Matrix3::from_fn(|i, j| joint.covariance_times(&SVector::ith(UNKNOWNS + i, 1.0)).unwrap()[UNKNOWNS + j]);
        // `P (3 (P^-1 - prior) + prior) P` of a rho of one half.
        let expected = independent * 3.0 - independent * independent * (2.0 * prior);
        assert!((found.covariance - expected).norm() < 2e-3 * expected.norm(), "{} {expected}", found.covariance);
        // Each part is large enough to be missed.
        assert!((independent * 3.0 - expected).norm() > 0.1 * expected.norm());
        assert!((expected - independent).norm() > 0.1 * expected.norm());
        let [alone, alike] = found.significance;
        let by_all = found.k.dot(&(independent.try_inverse().unwrap() * found.k));
        assert!((alone / by_all - 1.0).abs() < 1e-2 && (alone / alike - 3.0).abs() < 1e-3, "{found:?} {by_all}");
        // What is left unknown of it counts from now on.
        let sum: Matrix3<f32> = information.current_errors.iter().take(3).map(|error| error * error.transpose()).sum();
        assert!((sum - found.covariance).norm() < 1e-3 * expected.norm(), "{sum}");
    }

    /// The effect of an attitude error is its effect on each dip, weighed and summed as the dips are.
    #[test]
    fn effects_and_information_of_dips_are_summed() {
        let likelihood = likelihood(&Prior::default(), Config::DEFAULT);
        let parameters = parameters();
        let mut information = of_priors(&likelihood, &parameters.unknowns().unwrap());
        let mut dip = Matrix13::zeros();
        let mut effects = [Vector13::zeros(); 4];
        for (bank_deg, heading_rad) in [(25.0, 0.3), (-40.0, 2.0), (10.0, 5.0)] {
            let attitude = Attitude::from_deg(bank_deg, 3.0);
            let tilt = attitude.tilt();
            let x = parameters.expected_field(&tilt, heading_rad).unwrap();
            let rates = Rates::from_rad_s([0.3, -0.2, 0.0]);
            let measured = Measured { x, tilt, roll_rad: attitude.roll_rad, rates, heading_rad: None };
            let equations = Equations::new(&parameters, &measured, &likelihood.noise, &likelihood.config, false);
            let of_dip = equations.dip.as_ref().unwrap();
            let row = of_dip.row.dense();
            dip += row * row.transpose() * of_dip.weight;
            for (sum, effect) in effects.iter_mut().zip(equations.attitude_effects) {
                *sum += row * (of_dip.weight * effect);
            }
            information.add_dip(&equations);
        }
        for i in 0..UNKNOWNS {
            let found = information.dip.times(&Vector13::ith(i, 1.0));
            assert!((found - dip.column(i)).norm() < 1e-4 * dip.norm());
        }
        for (found, expected) in information.effects.iter().zip(effects) {
            assert!((found - expected).norm() < 1e-4 * expected.norm());
        }
    }

    /// What a latency leaves open is considered from when it was looked for; without rates nothing is.
    #[test]
    fn what_is_not_known_of_a_latency_is_considered() {
        let likelihood = likelihood(&Prior::default(), Config::DEFAULT);
        let mut information = informed(&likelihood, &parameters().unknowns().unwrap(), 1e4);
        assert!(information.latency(0.0).is_none() && information.latency_sigma_s == 0.0);
        let row = Row { by_field: Vector3::x(), x: Vector3::y(), by_inclination: -1.0 };
        information.latency.add(0, &Equation::new(row, 0.01, 1e-4, 1e6), 0.5);
        information.effects[3] = Vector13::ith(2, 40.0);
        let (latency, follows) = information.latency(0.0).unwrap();
        // 0.25 of 1e4, less what unknown 2, of which 1e4 is known, explains; and the prior's 100.
        assert!((latency.sigma_s * f32::sqrt(2500.0 - 0.16 + 100.0) - 1.0).abs() < 1e-4, "{latency:?}");
        assert!((follows[2] + 40.0 / 1e4).abs() < 1e-5, "{follows}");
        assert_eq!(information.latency_sigma_s.to_bits(), latency.sigma_s.to_bits());
    }

    /// A prior is what a quantity rests on when more than half of its sigma is left: three times the prior's own
    /// information is the border.
    #[test]
    fn more_than_half_of_a_prior_is_left_to_it() {
        let prior = Prior { inclination_rad: Some(0.7), ..Prior::default() };
        let likelihood = likelihood(&prior, Config::DEFAULT);
        let at = parameters().unknowns().unwrap();
        for (times, left) in [(2.9, true), (3.1, false)] {
            let mut information = of_priors(&likelihood, &at);
            let variance =
                likelihood.config.known_inclination_sigma_rad * likelihood.config.known_inclination_sigma_rad / times;
            for i in 0..INCLINATION {
                information.system.add_row(&Vector13::ith(i, 1.0), 0.0, 1e6);
            }
            information.system.add_row(&Vector13::ith(INCLINATION, 1.0), 0.0, 1.0 / variance);
            let found: Vec<Quantity> = information.left_to_priors(&likelihood, &at).unwrap().collect();
            assert_eq!(found, if left { vec![Quantity::Inclination] } else { vec![] }, "{times}");
        }
    }

    /// The samples' white noise in units of the total field, that of one reading: the mean of eight scatters by a third of
    /// it. What is not white is the same in all eight, and in the dips.
    #[test]
    fn the_sensor_s_noise_is_that_of_a_single_reading() {
        let at = parameters().unknowns().unwrap();
        let per_unit = TRUTH.determinant().cbrt();
        for (readings_per_sample, white, factor) in
            [(1, 1.0, 1.0), (8, 1.0, 8_f32.sqrt()), (0, 1.0, 1.0), (8, 0.25, 2_f32.sqrt()), (1, 0.0, 0.0)]
        {
            let mut likelihood = likelihood(&Prior { readings_per_sample, ..Prior::default() }, Config::DEFAULT);
            likelihood.noise = Noise::new(0.003, 0.005, TRUTH);
            let found = uncertainty(&likelihood, &at, &Covariance::EXACT, white).unwrap();
            let expected = 0.003 * factor * per_unit;
            assert!(
                (found.sensor_sigma - expected).abs() < 1e-5 * 0.003,
                "{readings_per_sample}: {}",
                found.sensor_sigma
            );
            // 0.005 are the attitude's and what is white of the sensor's together.
            let attitude_sigma_rad = f32::sqrt(0.005 * 0.005 - white * 0.003 * 0.003);
            assert!((found.attitude_sigma_rad - attitude_sigma_rad).abs() < 1e-6);
        }
        assert_eq!(Prior::default().readings_per_sample, 1);
    }

    /// A tumble shows nothing of the attitude source that will be used: half a degree is taken for it.
    #[test]
    fn attitude_noise_that_was_not_seen_is_half_a_degree() {
        let likelihood = likelihood(&Prior::default(), Config::NO_ATTITUDE);
        let found = uncertainty(&likelihood, &parameters().unknowns().unwrap(), &Covariance::EXACT, 1.0).unwrap();
        assert!((found.attitude_sigma_rad.to_degrees() - 0.5).abs() < 0.002);
    }

    /// Without an inverse of `W` nothing is known of hard iron, and a field that is flattened is no field.
    #[test]
    fn what_is_open_has_no_covariance() {
        let likelihood = likelihood(&Prior::default(), Config::DEFAULT);
        let at = parameters().unknowns().unwrap();
        let flat = Parameters { w: Matrix3::zeros(), ..parameters() }.unknowns().unwrap();
        let open = of_priors(&likelihood, &flat);
        let mut covariance = Covariance::EXACT;
        for unknowns in [&at, &flat] {
            assert!(
                open.covariance(&likelihood, unknowns, (Errors::All, Consider::NOTHING), &mut covariance).is_none()
            );
        }
        assert!(open.left_to_priors(&likelihood, &at).is_none());
        assert!(uncertainty(&likelihood, &flat, &Covariance::EXACT, 1.0).is_none());
    }

    /// What is known of airframes has no neighbours: where norms are alike, only what they say is doubted.
    #[test]
    fn what_rests_on_priors_is_not_doubted() {
        let likelihood = likelihood(&Prior::default(), Config::DEFAULT);
        let at = parameters().unknowns().unwrap();
        let mut information = of_priors(&likelihood, &at);
        // The one thing that priors leave open.
        let scale = Vector13::from_fn(|i, _| if [0, 4, 8].contains(&i) { 1.0 } else { 0.0 });
        information.system.add_row(&scale, 0.0, 1e4);
        let of = |information: &Information| full(information, &likelihood, &at, Consider::NOTHING);
        let before = of(&information);
        for residual in [1.0, 1.0, 0.0] {
            information.correlation.add(0, [residual, 0.0]);
        }
        let after = of(&information);
        assert!((information.inflation() - 3.0).abs() < 1e-3);
        for i in 0..COEFFICIENTS {
            assert!((after[(i, i)] / before[(i, i)] - 1.0).abs() < 0.05, "{i}: {} {}", after[(i, i)], before[(i, i)]);
        }
    }

    /// A told inclination of 0.7 and its sigma of a degree, and samples that show `own_rad` with a sigma: the result is
    /// their mean, of which the samples' own part is found again. Where they show less than a twentieth of it, nothing.
    #[test]
    fn the_samples_own_inclination_is_found_again() {
        let known_sigma = Config::DEFAULT.known_inclination_sigma_rad;
        for (own_rad, sigma, is_shown) in
            [(0.75, 0.004, true), (0.6, 0.03, true), (0.9, 0.07, true), (0.9, 0.078, false)]
        {
            for told in [true, false] {
                let prior = Prior { inclination_rad: told.then_some(0.7), ..Prior::default() };
                let likelihood = likelihood(&prior, Config::DEFAULT);
                let weights = if told { [known_sigma.powi(-2), f32::powi(sigma, -2)] } else { [0.0, 1.0] };
                let inclination_rad = (weights[0] * 0.7 + weights[1] * own_rad) / (weights[0] + weights[1]);
                let at = Parameters { inclination_rad, ..parameters() }.unknowns().unwrap();
                let mut information = of_priors(&likelihood, &at);
                for i in 0..INCLINATION {
                    information.system.add_row(&Vector13::ith(i, 1.0), 0.0, 1e6);
                }
                information.system.add_row(&Vector13::ith(INCLINATION, 1.0), 0.0, 1.0 / (sigma * sigma));
                // Correlated with rho of one half, and with a bank error of one worth 2e3 in the gradient.
                for residual in [1.0, 1.0, 0.0] {
                    // Of norms or of dips, whichever is more.
                    information.correlation.add(0, if told { [0.0, residual] } else { [residual, 0.0] });
                }
                information.effects[2] = Vector13::ith(INCLINATION, 2e3);
                let consider = Consider { bias_rad: 0.0, bank_scale: 0.01 };
                let Some([found_rad, variance]) = information.own_inclination(&likelihood, &at, consider) else {
                    assert!(told && !is_shown, "{own_rad} {sigma}");
                    continue;
                };
                assert!(!told || is_shown, "{own_rad} {sigma}");
                assert!((found_rad - own_rad).abs() < 1e-3, "{found_rad} {own_rad}");
                let shift = 2e3 * 0.01 * sigma * sigma;
                let expected = sigma * sigma * 3.0 + shift * shift;
                assert!((variance / expected - 1.0).abs() < 0.02, "{variance} {expected} {told}");
            }
        }
    }

    /// What is added of a bank error is added as squares; the bias stays.
    #[test]
    fn a_misread_bank_is_considered_beside_the_rest() {
        let mut evidence = BankEvidence::default();
        let row = Row { by_field: Vector3::zeros(), x: Vector3::zeros(), by_inclination: 0.0 };
        let steep = Equation::new(row, -0.1, 1e-4, 1e6);
        evidence.add(&steep, [0.0, 0.0, 1.0, 0.0]);
        // Of an information of 1e4 it is 0.1, with a variance of 1e-4.
        let found = evidence.scale(0.0, 0.0, 0.0, 1.0).unwrap();
        let considered = Consider::DEFAULT.with(&found);
        assert!((considered.bank_scale - (0.01_f32.powi(2) + 0.1_f32.powi(2)).sqrt()).abs() < 1e-5);
        assert_eq!(considered.bias_rad.to_bits(), Consider::DEFAULT.bias_rad.to_bits());
    }
}
