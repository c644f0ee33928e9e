//! Score test for iron that does not stay the same during a flight: a moved payload (step), a temperature drift of the
//! sensor's zero, iron in a linkage that moves in turns, or magnetic hysteresis.
//!
//! A change `beta` of the hard iron `b` is tested as three additional unknowns of a [score test](super::score_test):
//! `b + beta` before one of about thirty times and `b` after it (step), a linear transition over the flight (drift), or
//! a share of `beta` that follows the load factor (linkage). Of [hysteresis](super::hysteresis) one unknown is the
//! angle by which the soft iron's field lags in turns, and two have no effect.
//!
//! Errors are correlated, and the misfit inflates sigma. So a second pass, if the first is suspicious, takes both from
//! the residuals that remain with the change.
//!
//! # Thresholds
//!
//! Simulated flights of four circles each way, 12 to 45 deg of bank. 1,500 without a change: the first pass exceeds 20
//! in 1 %, the second never exceeds 25. Payload moved by 2 uT: 50 or more in 95 %; the rest moved in the last seconds.
//! Drift of 2 uT: 200 or more.
//!
//! Attitude errors of real flights last longer. One recorded flight without a change has 43, but only 10 from norm
//! residuals; a moved payload has 30 or more from these.
//!
//! Iron of 3 uT in a linkage has 70 to 270, because bank varies within turns, but down to 1 from norm residuals if it
//! hardly changes the norm. Hysteresis of 15 deg has 20 to 300 where it costs half a degree or more. In 60 flights
//! without a change the first pass has at most 10 for linkage or hysteresis, both of which are tested once.

use nalgebra::{Matrix3, Vector3};

use super::hysteresis::{Hysteresis, LastTurn};
use super::score_test::{HardIronSums, SampleProducts, ScoreTest, hard_iron_residuals};
use crate::calibration::fit::ConvergedFit;
use crate::calibration::fit::linearised_problem::LinearisedProblem;
use crate::calibration::linear_algebra::inverse;
use crate::calibration::model::{JacobianRow, ModelParameters, ResidualEquation, SampleEquations, Vector13};
use crate::calibration::statistics::residuals::{Autocorrelation, ResidualStatistics};
use crate::calibration::types::quality::{DetectedHardIronChange, HardIronTimeCourse};
use crate::calibration::types::samples::{Sample, Samples, TimeSpan};
use crate::trig::{VectorLength as _, sqrt};

/// Number of times at which a step is tested.
const MAX_TESTED_STEPS: usize = 32;

/// Ratio by which the best of the tested steps must exceed iron in a linkage, because it is the largest of about
/// thirty. Of interference in a VTOL's turns the best step has up to 1.08 of the linkage's significance, of a payload
/// that moved in a plane six times and more.
const STEP_SEARCH_ADVANTAGE: f32 = 1.1;

/// Significance that triggers the second pass.
const SECOND_PASS_SIGNIFICANCE: f32 = 16.0;

/// Significance that confirms a change, in the second pass.
const MIN_SIGNIFICANCE: f32 = 30.0;

/// Significance from norm residuals alone that confirms a change. Attitude errors do not affect the norm; lasting ones
/// look like a change in the inclination residuals.
const MIN_NORM_SIGNIFICANCE: f32 = 16.0;

/// Significance that confirms hysteresis, which is tested once, and has one unknown.
const MIN_HYSTERESIS_SIGNIFICANCE: f32 = 12.0;

/// Significance from norm residuals alone that confirms a hypothesis that is tested once: 99 % quantile of chi-squared
/// with one degree of freedom.
const MIN_NORM_SIGNIFICANCE_OF_SINGLE_TEST: f32 = 6.6;

/// Significance that confirms iron in a linkage whatever the norm residuals are.
const CERTAIN_SIGNIFICANCE: f32 = 60.0;

/// Significance in the first and in the second pass that together confirm iron in a linkage. Interference of motors
/// follows turns in another way than the load factor, so that much remains in the second pass: of 17 VTOLs with 20 uT
/// in hover that the other limits accepted, twelve have 201 to 469 and 14 to 54. Of 260 clean copters and 260 VTOLs the
/// first pass has at most 171, and then 10 in the second; of recorded flights 100.
const LINKAGE_SIGNIFICANCES: [f32; 2] = [200.0, 12.0];

/// Largest iron in a linkage, microtesla. A larger estimate comes from flights in which the load factor hardly varies.
const MAX_LINKAGE_UT: f32 = 20.0;

/// Load factor less one in a turn at 25 deg of bank, for which the size of iron in a linkage is reported.
const REFERENCE_EXCESS_LOAD_FACTOR: f32 = 0.1034;

/// Relative `f32` rounding error of the information about `beta`.
const RELATIVE_ROUNDING: f32 = 1e-5;

impl TimeSpan {
    /// Fraction of the hard-iron change `beta` in effect at a sample: before a step, decreasing in a drift.
    fn change_fraction_at(self, time_course: HardIronTimeCourse, sample: &Sample) -> f32 {
        match time_course {
            HardIronTimeCourse::Step { after_ms } => f32::from(u8::from(sample.time.ms_since(self.start) <= after_ms)),
            HardIronTimeCourse::Drift => 1.0 - self.elapsed_fraction(sample.time),
            HardIronTimeCourse::LoadFactor => load_factor_fraction(&sample.attitude.tilt_rotation().down_in_body()),
            HardIronTimeCourse::Hysteresis => 1.0,
        }
    }
}

/// Load factor less one, relative to the reference, with down in body axes; at most 1.
fn load_factor_fraction(down: &Vector3<f32>) -> f32 {
    ((1.0 / down.z.max(0.1) - 1.0) / REFERENCE_EXCESS_LOAD_FACTOR).min(1.0)
}

/// Adds both residuals of a sample, for an unknown with this derivative of the corrected field: faster than one by one,
/// because their rows have the measurement in common.
fn add_residual_pair(sums: &mut ScoreTest<1>, equations: &SampleEquations, field_derivative: &Vector3<f32>) {
    let mut pair = JacobianRow {
        derivative_by_field: Vector3::zeros(),
        centred_field: equations.norm_equation.jacobian_row.centred_field,
        derivative_by_inclination: 0.0,
    };
    for equation in hard_iron_residuals(equations) {
        let by_unknown = field_derivative.dot(&equation.jacobian_row.derivative_by_field);
        let weighted = by_unknown * equation.weight;
        pair.derivative_by_field += equation.jacobian_row.derivative_by_field * weighted;
        pair.derivative_by_inclination += equation.jacobian_row.derivative_by_inclination * weighted;
        sums.information.x += weighted * by_unknown;
        sums.gradient.x -= weighted * equation.residual;
    }
    pair.add_scaled_to(&mut sums.cross_information[0], 1.0);
}

/// Sums for one unknown, as sums for three unknowns of which two have no effect.
fn as_three_unknowns(one_unknown: &ScoreTest<1>) -> ScoreTest<3> {
    let mut three_unknowns = ScoreTest::<3>::zero();
    three_unknowns.cross_information[0] = one_unknown.cross_information[0];
    three_unknowns.information[(0, 0)] = one_unknown.information.x;
    three_unknowns.gradient.x = one_unknown.gradient.x;
    three_unknowns
}

/// Estimate of `beta` and its significance.
fn estimate_hard_iron_change(
    sums: &ScoreTest<3>,
    system: &LinearisedProblem,
    step_to_maximum: &Vector13,
) -> Option<(Vector3<f32>, f32)> {
    let score = sums.eliminate_coefficients(system, step_to_maximum)?;
    let beta = inverse(&(score.information + rounding_floor(sums)))? * score.gradient;
    let significance = beta.dot(&score.gradient);
    significance.is_finite().then_some((beta, significance))
}

/// Significance from norm residuals alone, whose variance is inflated by `norm_inflation`. Inclination residuals only
/// contribute information about the other unknowns, conservatively with their inflation without a change.
fn norm_significance(
    sums: &ScoreTest<3>,
    system: &LinearisedProblem,
    residuals: &ResidualStatistics,
    step_to_maximum: &Vector13,
    norm_inflation: f32,
) -> Option<f32> {
    let mut variance = sums.information * norm_inflation;
    let score = sums.eliminate_coefficients(system, step_to_maximum)?;
    for (axis, column) in score.nuisance_columns.iter().enumerate() {
        let inclination_excess = residuals.excess_inclination_information_times(column, norm_inflation);
        for (other_axis, cross_row) in sums.cross_information.iter().enumerate() {
            variance[(axis, other_axis)] +=
                score.nuisance_columns[other_axis].dot(&inclination_excess) - column.dot(cross_row) * norm_inflation;
        }
    }
    Some(score.gradient.dot(&(inverse(&(variance + rounding_floor(sums)))? * score.gradient)))
}

fn rounding_floor(sums: &ScoreTest<3>) -> Matrix3<f32> {
    Matrix3::from_diagonal_element(RELATIVE_ROUNDING * sums.information.trace())
}

#[derive(Clone, Copy, Debug)]
struct ChangeEstimate {
    time_course: HardIronTimeCourse,
    beta: Vector3<f32>,
    significance: f32,
}

#[derive(Clone, Debug)]
pub(in crate::calibration) struct ConfirmedChange {
    pub detected_change: DetectedHardIronChange,
    pub effect: HardIronChangeEffect,
}

/// Effect of a change of hard iron on the coefficients.
#[derive(Clone, Debug)]
pub(in crate::calibration) struct HardIronChangeEffect {
    /// `H_ub beta`: effect of the change `beta` on the gradient of the likelihood by the coefficients.
    pub gradient: Vector13,
    /// `W beta` of iron in a linkage, by which the corrected hard iron in turns exceeds that in level flight; zero for
    /// other changes.
    pub added_in_turns: Vector3<f32>,
}

/// Search for a hard-iron change in one pass in time order. About 900 bytes.
#[derive(Debug)]
pub(in crate::calibration) struct HardIronScan {
    time_span: TimeSpan,
    /// `W`: maps a hard-iron change to the corrected field.
    w: Matrix3<f32>,
    step_to_maximum: Vector13,
    step_sums: HardIronSums,
    load_factor_sums: HardIronSums,
    hysteresis_sums: ScoreTest<1>,
    hysteresis: Hysteresis,
    last_turn: LastTurn,
    /// Sums of a drift, approximated by steps at the tested times.
    drift_sums: HardIronSums,
    drift_fraction: f32,
    processed_count: usize,
    sample_count: usize,
    best_estimate: Option<ChangeEstimate>,
    gradient_effect: Vector13,
}

impl HardIronScan {
    #[inline(never)]
    pub fn new(samples: Samples<'_>, system: &LinearisedProblem, unknowns: &Vector13) -> Option<Self> {
        let parameters = ModelParameters::from_unknowns(unknowns);
        Some(Self {
            time_span: TimeSpan::from_samples(samples)?,
            hysteresis: Hysteresis::new(&parameters)?,
            last_turn: LastTurn::default(),
            w: parameters.w,
            step_to_maximum: system.step_to_maximum()?,
            step_sums: HardIronSums::zero(),
            load_factor_sums: HardIronSums::zero(),
            hysteresis_sums: ScoreTest::zero(),
            drift_sums: HardIronSums::zero(),
            drift_fraction: 1.0,
            processed_count: 0,
            sample_count: samples.iter().count(),
            best_estimate: None,
            gradient_effect: Vector13::zeros(),
        })
    }

    pub fn add_sample(&mut self, system: &LinearisedProblem, sample: &Sample, equations: &SampleEquations) {
        let time = sample.time;
        let down = sample.attitude.tilt_rotation().down_in_body();
        let products = SampleProducts::new(equations);
        self.step_sums.add_sample_products(&products, 1.0);
        self.load_factor_sums.add_sample_products(&products, load_factor_fraction(&down));
        let lagging = self.hysteresis.field_response(&down, self.last_turn.direction_at_sample(sample), equations);
        add_residual_pair(&mut self.hysteresis_sums, equations, &lagging);
        self.processed_count += 1;
        if self.processed_count.is_multiple_of(self.sample_count.div_ceil(MAX_TESTED_STEPS))
            && self.processed_count < self.sample_count
        {
            self.test_time_course(system, HardIronTimeCourse::Step { after_ms: time.ms_since(self.time_span.start) });
            self.extend_drift(self.time_span.change_fraction_at(HardIronTimeCourse::Drift, sample));
        }
    }

    fn extend_drift(&mut self, new_fraction: f32) {
        let old_fraction = core::mem::replace(&mut self.drift_fraction, new_fraction);
        self.drift_sums.add_scaled(
            &self.step_sums,
            old_fraction - new_fraction,
            old_fraction * old_fraction - new_fraction * new_fraction,
        );
    }

    /// Tests a time course whose sums are complete.
    fn test_time_course(&mut self, system: &LinearisedProblem, time_course: HardIronTimeCourse) {
        let sums = match time_course {
            HardIronTimeCourse::Step { .. } => self.step_sums.score_test(&self.w),
            HardIronTimeCourse::Drift => self.drift_sums.score_test(&self.w),
            HardIronTimeCourse::LoadFactor => self.load_factor_sums.score_test(&self.w),
            HardIronTimeCourse::Hysteresis => as_three_unknowns(&self.hysteresis_sums),
        };
        let Some((beta, significance)) = estimate_hard_iron_change(&sums, system, &self.step_to_maximum) else {
            return;
        };
        let advantage = if time_course == HardIronTimeCourse::LoadFactor { STEP_SEARCH_ADVANTAGE } else { 1.0 };
        if self.best_estimate.is_none_or(|best| significance * advantage > best.significance) {
            self.gradient_effect = sums.gradient_effect(&beta);
            self.best_estimate = Some(ChangeEstimate { time_course, beta, significance });
        }
    }

    /// The change, if confirmed by a second pass.
    #[inline(never)]
    pub fn confirm_change(
        &mut self,
        fit: &ConvergedFit<'_>,
        system: &LinearisedProblem,
        residuals: &ResidualStatistics,
    ) -> Option<ConfirmedChange> {
        self.extend_drift(0.0);
        for time_course in [HardIronTimeCourse::Drift, HardIronTimeCourse::LoadFactor, HardIronTimeCourse::Hysteresis] {
            self.test_time_course(system, time_course);
        }
        let estimate = self.best_estimate.filter(|estimate| estimate.significance > SECOND_PASS_SIGNIFICANCE)?;
        let size_ut = match estimate.time_course {
            HardIronTimeCourse::Hysteresis => self.hysteresis.rms_field_change(estimate.beta.x),
            _ => estimate.beta.vector_length(),
        };
        let detected_change = DetectedHardIronChange {
            size_ut: size_ut * fit.likelihood.field_unit_ut,
            time_course: estimate.time_course,
            duration_ms: self.time_span.duration_ms,
        };
        let second_pass = self.significance(&estimate, fit, system, residuals)?;
        let added_in_turns = match estimate.time_course {
            HardIronTimeCourse::LoadFactor => self.w * estimate.beta,
            _ => Vector3::zeros(),
        };
        let effect = HardIronChangeEffect { gradient: self.gradient_effect, added_in_turns };
        is_significant(&estimate, detected_change.size_ut, second_pass)
            .then_some(ConfirmedChange { detected_change, effect })
    }

    fn significance(
        &self,
        estimate: &ChangeEstimate,
        fit: &ConvergedFit<'_>,
        system: &LinearisedProblem,
        residuals: &ResidualStatistics,
    ) -> Option<[f32; 2]> {
        let move_unknowns = self.step_to_maximum - system.covariance_times(&self.gradient_effect)?;
        let parameters = ModelParameters::from_unknowns(fit.unknowns);
        let mut remaining = Autocorrelation::default();
        let mut norm_sums = ScoreTest::zero();
        let mut last_turn = LastTurn::default();
        for sample in fit.samples.iter() {
            let equations = fit.likelihood.sample_equations(sample, None, &parameters);
            let fraction = self.time_span.change_fraction_at(estimate.time_course, sample);
            let response = if estimate.time_course == HardIronTimeCourse::Hysteresis {
                let down = sample.attitude.tilt_rotation().down_in_body();
                let lagging = self.hysteresis.field_response(&down, last_turn.direction_at_sample(sample), &equations);
                Matrix3::from_columns(&[lagging, Vector3::zeros(), Vector3::zeros()])
            } else {
                -self.w
            };
            let derivative = |equation: &ResidualEquation| response.tr_mul(&equation.jacobian_row.derivative_by_field);
            let residual = |equation: &ResidualEquation| {
                let by_change = derivative(equation).dot(&estimate.beta) * fraction;
                let residual = equation.residual + equation.jacobian_row.dot(&move_unknowns) + by_change;
                residual * sqrt(equation.weight)
            };
            remaining.add_residuals(
                sample.part.index(),
                [residual(&equations.norm_equation), equations.inclination_equation.as_ref().map_or(0.0, residual)],
            );
            norm_sums.add_weighted_equation(&equations.norm_equation, &derivative(&equations.norm_equation), fraction);
        }
        // Degrees of freedom: half of the sixteen unknowns for each kind of residual.
        let freedom = (self.sample_count as f32 - 8.0).max(1.0);
        let [norm_inflation, inclination_inflation] = remaining.excess_variance_inflation();
        let [norm_variance, inclination_variance] = remaining.sums_of_squares();
        let [norm_variance, inclination_variance] = [
            norm_variance * (1.0 + norm_inflation) / freedom,
            inclination_variance * (1.0 + inclination_inflation) / freedom,
        ];
        let norm_significance = norm_significance(&norm_sums, system, residuals, &self.step_to_maximum, norm_variance)?;
        Some([estimate.significance / norm_variance.max(inclination_variance), norm_significance])
    }
}

/// Whether both passes confirm a change of this size; `second_pass` is its total significance, and that from norm
/// residuals alone.
fn is_significant(estimate: &ChangeEstimate, size_ut: f32, second_pass: [f32; 2]) -> bool {
    let [total_significance, norm_significance] = second_pass;
    let is_linkage_in_both_passes = || {
        let [first_limit, total_limit] = LINKAGE_SIGNIFICANCES;
        size_ut <= MAX_LINKAGE_UT && estimate.significance > first_limit && total_significance > total_limit
    };
    let (total_limit, norm_limit) = match estimate.time_course {
        HardIronTimeCourse::Step { .. } | HardIronTimeCourse::Drift => (MIN_SIGNIFICANCE, MIN_NORM_SIGNIFICANCE),
        HardIronTimeCourse::LoadFactor if total_significance > CERTAIN_SIGNIFICANCE => return true,
        HardIronTimeCourse::LoadFactor if is_linkage_in_both_passes() => return true,
        HardIronTimeCourse::Hysteresis if total_significance > MIN_SIGNIFICANCE => return true,
        HardIronTimeCourse::LoadFactor => (MIN_SIGNIFICANCE, MIN_NORM_SIGNIFICANCE_OF_SINGLE_TEST),
        HardIronTimeCourse::Hysteresis => (MIN_HYSTERESIS_SIGNIFICANCE, MIN_NORM_SIGNIFICANCE_OF_SINGLE_TEST),
    };
    total_significance > total_limit && norm_significance > norm_limit
}

/// Derivative of a residual by a hard-iron change `beta`, which lowers the corrected field by `W beta`.
pub(in crate::calibration) fn derivative_by_hard_iron(w: &Matrix3<f32>, equation: &ResidualEquation) -> Vector3<f32> {
    -w.tr_mul(&equation.jacobian_row.derivative_by_field)
}

#[cfg(test)]
mod tests;
