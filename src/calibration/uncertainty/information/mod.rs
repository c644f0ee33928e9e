//! Fisher information of the samples and the covariance of the coefficients.

use nalgebra::{Matrix3, Vector3};

use super::coefficient_covariance::CoefficientCovariance;
use super::consider::ConsiderSigmas;
use super::heading_uncertainty::HeadingUncertainty;
use crate::calibration::fit::information_matrix::InformationMatrix;
use crate::calibration::fit::linearised_problem::LinearisedProblem;
use crate::calibration::hypotheses::attitude_latency::LatencyScore;
use crate::calibration::hypotheses::bank_scale::{BankScaleEstimate, BankScaleScore, ClusterVariance};
use crate::calibration::hypotheses::hard_iron_change::{
    HardIronScan, ScoreSums, derivative_by_hard_iron, hard_iron_residuals,
};
use crate::calibration::hypotheses::motor_current::InterferenceEstimate;
use crate::calibration::model::{
    COEFFICIENTS, Coefficient, INCLINATION_INDEX, Likelihood, MeasuredSample, ModelParameters, PriorQuantity,
    ResidualEquation, SampleEquations, Vector12, Vector13, beta_index, d_index, for_each_prior, w_index,
};
use crate::calibration::statistics::autocorrelation::Autocorrelation;
use crate::calibration::statistics::heteroscedasticity::Heteroscedasticity;
use crate::calibration::statistics::white_noise_fraction::WhiteNoiseFraction;
use crate::calibration::types::time_order::{PARTS, TimeOrdered};
use crate::calibration::{AttitudeLatency, Rates, Samples, inverse};
use crate::frames::Attitude;
use crate::trig;
use crate::trig::sqrt;

/// Minimum share of the inclination's information from the samples; below it, their separate estimate has no valid
/// `f32` digits.
const MIN_SAMPLE_INFORMATION_SHARE: f32 = 0.05;

/// Attitude noise assumed when no sample shows it, radians: 0.5 deg.
const DEFAULT_ATTITUDE_SIGMA_RAD: f32 = 0.0087;

/// Heading uncertainty from the covariance, the noise, and the white fraction of the norm residuals' variance.
///
/// Attitude noise is the variance of the inclination residual minus the sensor's white noise. It thus contains slow
/// field errors, which affect a heading equally. Its scale is Huber's proposal 2,
/// `mean(min(e^2, (2 s)^2)) / 0.92 = s^2`, which unlike a median needs no buffer.
pub(in crate::calibration) fn heading_uncertainty(
    likelihood: &Likelihood,
    unknowns: &Vector13,
    covariance: &CoefficientCovariance,
    white_fraction: f32,
) -> Option<HeadingUncertainty> {
    let noise = &likelihood.noise;
    let white = noise.norm * noise.norm * white_fraction;
    let attitude_sigma_rad = if likelihood.config.uses_attitude {
        sqrt((noise.inclination_sigma_rad * noise.inclination_sigma_rad - white).max(0.0))
    } else {
        DEFAULT_ATTITUDE_SIGMA_RAD
    };
    // White noise of one reading from that of a mean of `readings_per_sample`.
    let reading_sigma = sqrt(white * f32::from(likelihood.readings_per_sample.max(1)));
    let sensor_sigma = reading_sigma / CoefficientConversion::new(likelihood, unknowns)?.determinant_scale;
    Some(HeadingUncertainty::from_covariance(covariance, sensor_sigma, attitude_sigma_rad))
        .filter(HeadingUncertainty::is_finite)
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::calibration) enum CovarianceContent {
    All,
    /// Errors that remain with unlimited samples of the same kind: unobservable directions, which rest on the priors,
    /// and constant errors of the attitude source.
    WithoutNoise,
}

/// Fisher information of samples and priors, with the statistics for the sandwich covariance.
#[derive(Clone, Debug)]
pub(in crate::calibration) struct Information {
    pub system: LinearisedProblem,
    inclination_part: InformationMatrix,
    /// Derivatives of the gradient by roll bias, pitch bias (1/rad), bank-angle scale error and latency (1/s).
    attitude_error_gradients: [Vector13; 4],
    bank: BankScaleScore,
    latency_score: LatencyScore,
    latency_sigma_s: f32,
    by_current: ScoreSums,
    /// Remaining errors of the interference, mount axes, units of field per ampere; their outer products sum to its
    /// covariance.
    motor_current_errors: [Vector3<f32>; 4],
    correlation: Autocorrelation,
    heteroscedasticity: Heteroscedasticity,
    white_noise: WhiteNoiseFraction,
    pub hard_iron_gradient: Vector13,
}

impl Information {
    #[inline(never)]
    pub fn new(system: &LinearisedProblem) -> Self {
        Self {
            system: system.clone(),
            inclination_part: InformationMatrix::zero(),
            attitude_error_gradients: [Vector13::zeros(); 4],
            bank: BankScaleScore::default(),
            latency_score: LatencyScore::default(),
            latency_sigma_s: 0.0,
            by_current: ScoreSums::zero(),
            motor_current_errors: [Vector3::zeros(); 4],
            correlation: Autocorrelation::default(),
            heteroscedasticity: Heteroscedasticity::default(),
            white_noise: WhiteNoiseFraction::default(),
            hard_iron_gradient: Vector13::zeros(),
        }
    }

    /// Adds one pass over the samples. `scan`, given for turns, tests for a hard-iron change.
    #[inline(never)]
    pub fn accumulate_samples(
        &mut self,
        likelihood: &Likelihood,
        samples: Samples<'_>,
        unknowns: &Vector13,
        mut scan: Option<&mut HardIronScan>,
    ) {
        let parameters = ModelParameters::new(unknowns);
        for (part, sample) in TimeOrdered::new(samples) {
            let equations = likelihood.equations(sample, None, &parameters);
            self.add_inclination(&equations);
            if likelihood.motor_current.current_sigma_a > 0.0 {
                let share_a = likelihood.motor_current.current_offset_a(sample);
                hard_iron_residuals(&equations).for_each(|equation| {
                    self.by_current.add(equation, &derivative_by_hard_iron(&parameters.w, equation), share_a);
                });
            }
            if let Some(dip) = &equations.inclination {
                let [.., by_latency] = equations.inclination_by_attitude_errors;
                self.latency_score.add(part, dip, by_latency);
            }
            let dip = equations.inclination.as_ref().map_or(0.0, ResidualEquation::clipped_residual);
            // Without a scan (ground methods), norm residuals of one heading are correlated through the error of the
            // given heading, whose sigma already covers it.
            let norm = if scan.is_some() { equations.norm.clipped_residual() } else { 0.0 };
            self.correlation.add(part, [norm, dip]);
            self.heteroscedasticity.add(sample.attitude, dip);
            self.white_noise.add(part, sample.time, equations.norm.clipped_residual());
            if let Some(scan) = &mut scan {
                scan.add(&self.system, sample.time, &equations);
            }
        }
        for mark in samples.marks {
            let equations = likelihood.equations(&mark.sample, Some(mark.heading_rad), &parameters);
            self.add_inclination(&equations);
            self.correlation
                .add(PARTS - 1, [0.0, equations.inclination.as_ref().map_or(0.0, ResidualEquation::clipped_residual)]);
        }
    }

    fn add_inclination(&mut self, equations: &SampleEquations) {
        let Some(dip) = &equations.inclination else { return };
        self.inclination_part.add_row(&dip.row, dip.weight);
        for (sum, effect) in self.attitude_error_gradients.iter_mut().zip(equations.inclination_by_attitude_errors) {
            dip.row.add_scaled_to(sum, dip.weight * effect);
        }
        self.bank.add(dip, equations.inclination_by_attitude_errors);
    }

    /// Adds a hypothetical noise-free sample at an attitude and a heading. Its residual is zero.
    pub fn add_hypothetical_sample(
        &mut self,
        likelihood: &Likelihood,
        parameters: &ModelParameters,
        attitude: Attitude,
        heading_rad: f32,
    ) {
        let tilt = attitude.tilt();
        let Some(x) = parameters.expected_field(&tilt, heading_rad) else { return };
        let measured = MeasuredSample { x, tilt, roll_rad: attitude.roll_rad, rates: Rates::NONE, heading_rad: None };
        let equations = SampleEquations::new(parameters, &measured, &likelihood.noise, &likelihood.config, false);
        self.system.add(&equations);
        self.add_inclination(&equations);
    }

    /// Writes the covariance of the coefficients, in the units of [`Calibration`](super::Calibration). `None` when the
    /// information is singular.
    ///
    /// Sandwich covariance: with `H` the information, rho the lag-1 autocorrelation of each kind of residual, and
    /// `x = 2 rho / (1 - rho)`, `H^-1 (H + x_incl H_incl + x_norm H_norm) H^-1`, where
    /// `H_norm = H - H_incl - H_priors`. `1 + x_incl` is also multiplied by the heteroscedasticity ratio. Added are the
    /// consider states, a detected hard-iron change, the error of the motor-current interference, and the square of the
    /// remaining step to the maximum likelihood (zero after a refinement; the error of a closed form).
    ///
    /// An output parameter, because a returned value would exist several times on the stack.
    #[inline(never)]
    pub fn covariance(
        &self,
        likelihood: &Likelihood,
        unknowns: &Vector13,
        (errors, consider): (CovarianceContent, ConsiderSigmas),
        covariance: &mut CoefficientCovariance,
    ) -> Option<()> {
        let units = CoefficientConversion::new(likelihood, unknowns)?;
        // `H^-1` times the Jacobian row of each coefficient: 12 of 13 columns instead of a 13x13 inverse.
        let mut columns = [Vector13::zeros(); COEFFICIENTS];
        for (i, column) in columns.iter_mut().enumerate() {
            *column = self.system.covariance_times(&units.jacobian_row(i))?;
        }
        let [mut of_norm, of_dip] = self.correlation.excess_inflation();
        let of_dip = (1.0 + of_dip) * self.heteroscedasticity.variance_ratio() - 1.0;
        let mut inflated = Vector13::zeros();
        covariance.set_lower_triangle(|i, j| {
            if errors == CovarianceContent::WithoutNoise {
                return 0.0;
            }
            if j == 0 {
                // `fill` visits the lower triangle row by row, so each row starts with column 0.
                inflated = units.jacobian_row(i) * (1.0 + of_norm)
                    + self.inclination_part.multiply_vector(&columns[i]) * (of_dip - of_norm);
            }
            inflated.dot(&columns[j])
        });
        if errors == CovarianceContent::WithoutNoise {
            // Cancels the noise term; `H^-1 H_priors H^-1` is added below.
            of_norm = -1.0;
        }
        let along = |vector: &Vector13| Vector12::from_fn(|i, _| columns[i].dot(vector));
        for_each_prior(likelihood, &ModelParameters::new(unknowns), &mut |prior| {
            covariance.add_outer_product(&along(&prior.row), -of_norm / (prior.sigma * prior.sigma));
        });
        for (effect, sigma) in self.attitude_error_gradients.iter().zip(consider.sigmas(self.latency_sigma_s)) {
            covariance.add_outer_product(&along(effect), sigma * sigma);
        }
        covariance.add_outer_product(&along(&self.hard_iron_gradient), 1.0);
        let per_ampere = ModelParameters::new(unknowns).w;
        for error in &self.motor_current_errors {
            covariance.add_outer_product(&along(&self.motor_current_gradient(error)), 1.0);
            // The unknowns follow an interference error at the mean current. One standard deviation from the mean, it
            // adds a hard-iron error.
            let beyond = per_ampere * error * likelihood.motor_current.current_sigma_a;
            let mut coefficients = Vector12::zeros();
            for axis in 0..3 {
                coefficients[beta_index(axis)] = beyond[axis];
            }
            covariance.add_outer_product(&coefficients, 1.0);
        }
        let change = self.system.step_to_maximum()?;
        covariance.add_outer_product(&Vector12::from_fn(|i, _| units.jacobian_row(i).dot(&change)), 1.0);
        covariance.is_finite().then_some(())
    }

    /// `(x - than) H_incl vector`, with `x` the variance inflation of the inclination residuals; zero if `x < than`.
    pub fn excess_inclination_times(&self, vector: &Vector13, than: f32) -> Vector13 {
        let [_, of_dip] = self.correlation.excess_inflation();
        self.inclination_part.multiply_vector(vector) * (1.0 + of_dip - than).max(0.0)
    }

    /// Attitude latency by the efficient score, and the derivative of the unknowns by it (1/s). Its sigma becomes a
    /// consider state. `None` without attitude rates.
    #[inline(never)]
    pub fn estimate_latency(&mut self, used_s: f32) -> Option<(AttitudeLatency, Vector13)> {
        let [.., effect] = &self.attitude_error_gradients;
        let follows = -self.system.covariance_times(effect)?;
        let (known, pulled) = (-follows.dot(effect), effect.dot(&self.system.step_to_maximum()?));
        let latency = self.latency_score.estimate(used_s, known, pulled)?;
        self.latency_sigma_s = latency.sigma_s;
        Some((latency, follows))
    }

    /// Motor-current interference; its error enters the covariance. `None` without a varying current.
    #[inline(never)]
    pub fn estimate_motor_current(&mut self, likelihood: &Likelihood) -> Option<InterferenceEstimate> {
        if likelihood.motor_current.current_sigma_a == 0.0 {
            return None;
        }
        let (used, prior) =
            (likelihood.motor_current_per_ampere(), InterferenceEstimate::prior_precision(likelihood.unit_ut));
        let (own, gradient) = self.by_current.eliminate_unknowns(&self.system, &self.system.step_to_maximum()?)?;
        let all = own + Matrix3::from_diagonal_element(prior);
        let independent = inverse(&all)?;
        let k = used + independent * (gradient - used * prior);
        let alone = k.dot(&(all * k));
        let inflation = self.autocorrelation_inflation();
        let covariance = independent * own * independent * inflation + independent * independent * prior;
        let found = InterferenceEstimate { k, covariance, significance: [alone, alone / inflation] };
        self.motor_current_errors = found.covariance_factors(&used);
        (alone + found.max_sigma()).is_finite().then_some(found)
    }

    fn motor_current_gradient(&self, k: &Vector3<f32>) -> Vector13 {
        self.by_current.cross_information.iter().zip(k).map(|(with, k)| with * *k).sum()
    }

    pub fn step_for_motor_current(&self, k: &Vector3<f32>) -> Option<Vector13> {
        Some(-self.system.covariance_times(&self.motor_current_gradient(k))?)
    }

    pub fn white_fraction(&self) -> f32 {
        self.white_noise.fraction()
    }

    /// Variance inflation by autocorrelation, the larger of both residuals'.
    #[inline(never)]
    fn autocorrelation_inflation(&self) -> f32 {
        let [of_norm, of_dip] = self.correlation.excess_inflation();
        1.0 + of_norm.max(of_dip)
    }

    /// Significant bank-angle scale error above `allowance`. Only then makes a second pass over the samples, for the
    /// cluster-robust variance.
    #[inline(never)]
    pub fn bank_scale_score(
        &self,
        likelihood: &Likelihood,
        samples: Samples<'_>,
        unknowns: &Vector13,
        allowance: f32,
    ) -> Option<BankScaleEstimate> {
        let [_, _, effect, _] = &self.attitude_error_gradients;
        let column = self.system.covariance_times(effect)?;
        let (known, pulled) = (column.dot(effect), effect.dot(&self.system.step_to_maximum()?));
        let found = self.bank.estimate(
            known,
            pulled,
            likelihood.noise.attitude_sigma_rad(),
            self.autocorrelation_inflation(),
        )?;
        found.significant_error(allowance)?;
        let parameters = ModelParameters::new(unknowns);
        let mut clusters = ClusterVariance::default();
        for (part, sample) in TimeOrdered::new(samples) {
            clusters.add(part, &likelihood.equations(sample, None, &parameters), &column);
        }
        found.with_cluster_variance(clusters)
    }

    /// Inclination from the samples alone, radians, with its variance: a configured inclination is removed from the
    /// estimate. `None` if undetermined.
    pub fn inclination_from_samples(
        &self,
        likelihood: &Likelihood,
        unknowns: &Vector13,
        consider: ConsiderSigmas,
    ) -> Option<[f32; 2]> {
        let column = self.system.covariance_times(&Vector13::ith(INCLINATION_INDEX, 1.0))?;
        let of_all = column[INCLINATION_INDEX];
        let found_rad = unknowns[INCLINATION_INDEX];
        let (share, own_rad) = match likelihood.known_inclination_rad {
            None => (1.0, found_rad),
            Some(known_rad) => {
                let known =
                    likelihood.config.known_inclination_sigma_rad * likelihood.config.known_inclination_sigma_rad;
                // Information adds: `1 / of_all = 1 / known + 1 / own`.
                let share = 1.0 - of_all / known;
                if share < MIN_SAMPLE_INFORMATION_SHARE {
                    return None;
                }
                (share, known_rad + (found_rad - known_rad) / share)
            }
        };
        let shifts = self
            .attitude_error_gradients
            .iter()
            .zip(consider.sigmas(self.latency_sigma_s))
            .map(|(effect, sigma)| column.dot(effect) * sigma);
        let shifted = shifts.map(|shift| shift * shift).sum::<f32>() / (share * share);
        let variance = of_all / share * self.autocorrelation_inflation() + shifted;
        (own_rad + variance).is_finite().then_some([own_rad, variance])
    }

    /// Unobservable quantities: more than half of the prior sigma remains in some direction. `None` if the information
    /// is singular.
    pub fn unobservable_quantities(
        &self,
        likelihood: &Likelihood,
        unknowns: &Vector13,
    ) -> Option<impl Iterator<Item = PriorQuantity>> {
        let mut left = [None; PriorQuantity::COUNT];
        let mut determined = true;
        for_each_prior(likelihood, &ModelParameters::new(unknowns), &mut |prior| {
            let Some(column) = self.system.covariance_times(&prior.row) else {
                determined = false;
                return;
            };
            if prior.row.dot(&column) > 0.25 * prior.sigma * prior.sigma
                && let Some(slot) = left.get_mut(prior.quantity as usize)
            {
                *slot = Some(prior.quantity);
            }
        });
        if !determined {
            return None;
        }
        Some(left.into_iter().flatten())
    }
}

/// Conversion from the unknowns `W` and `d` to the coefficients: `W` in chip axes with determinant 1, and `beta`. The
/// corrected field changes by `dW x + dd`; `x` minus the hard iron is `x + W^-1 d`, so `d beta = dW W^-1 d - dd`.
struct CoefficientConversion {
    determinant_scale: f32,
    chip_from_mount: Matrix3<f32>,
    mean_minus_hard_iron: Vector3<f32>,
}

impl CoefficientConversion {
    fn new(likelihood: &Likelihood, unknowns: &Vector13) -> Option<Self> {
        let parameters = ModelParameters::new(unknowns);
        let per_unit = trig::reciprocal_cbrt(parameters.w.determinant());
        Some(Self {
            determinant_scale: per_unit,
            chip_from_mount: likelihood.mount_from_chip.transpose() * per_unit,
            mean_minus_hard_iron: parameters.mean_minus_hard_iron()?,
        })
    }

    fn jacobian_row(&self, i: usize) -> Vector13 {
        let mut derivative = Vector13::zeros();
        match Coefficient::from_index(i) {
            Coefficient::W { row, column } => {
                derivative
                    .fixed_rows_mut::<3>(w_index(row, 0))
                    .copy_from(&self.chip_from_mount.row(column).transpose());
            }
            Coefficient::Beta(axis) => {
                derivative.fixed_rows_mut::<3>(w_index(axis, 0)).copy_from(&self.mean_minus_hard_iron);
                derivative[d_index(axis)] = -1.0;
            }
        }
        derivative
    }
}

#[cfg(test)]
mod tests;
