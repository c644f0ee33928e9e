//! Maximum-likelihood refinement, the main method: Levenberg-Marquardt on the thirteen unknowns of
//! the [model](crate::calibration::model), with the noise re-estimated after each convergence.
//!
//! Starts from a closed form, which assumes constant attitude. Attains the Cramér-Rao bound: the ratio of the RMS
//! heading error to the bound is 1.00 in the median of 500 poor airframes and 1.08 in the worst decile
//! (`lab bench accuracy --airframes 500`).
//!
//! # Numerics
//!
//! All in `f32`. With many samples the search sums normal equations, which takes a third of the instructions; the last
//! pass, and all passes over few samples, rotate each equation into a triangle
//! ([`least_squares`](crate::calibration::linear_algebra)). Normal equations alone are not positive
//! definite in some compass swings; the scheme in use, rotations throughout, and sums solved in `f64` are equally
//! accurate.
//!
//! A product in `f64` takes 100 instructions on a Cortex-M4, whose FPU has `f32` only.
//!
//! A step that promises little is applied without evaluating the cost, so a solve makes eight passes: two over a
//! quarter of the samples, two over half, two over all with sums, two with rotations. The samples are centred on their
//! mean before they are summed, which preserves digits.

use nalgebra::Vector3;

use super::linearised_problem::LinearisedProblem;
use crate::calibration::model::{Likelihood, NoiseModel, Vector13};
use crate::calibration::types::samples::Samples;

/// Maximum number of steps between noise estimates; turns to both sides take 3. Thin data can have a long curved valley
/// of unknowns with little effect on the heading; the remaining distance is carried as uncertainty.
const MAX_STEPS_PER_NOISE_ESTIMATE: u8 = 40;

/// Convergence threshold: predicted reduction of the cost, half a squared sigma. 0.005 is a tenth of a sigma in the
/// worst direction. The last step is applied without evaluation and leaves 1 % of itself.
const CONVERGED_COST_REDUCTION: f32 = 0.005;

/// Convergence threshold before the last noise estimate: one sigma. New weights move the solution anyway.
const NEARLY_CONVERGED_COST_REDUCTION: f32 = 0.5;

/// Accepted increase of the cost, same units: with corrected measurements the gradient is not exactly that of the cost.
const MAX_ACCEPTED_COST_INCREASE: f32 = 1.0;

/// Noise estimates per solve; after three, sigma changes by less than 1 %.
const MAX_NOISE_ESTIMATES: u8 = 3;

/// Bound on the steps of a refinement: those before the first noise estimate, and after each.
pub(in crate::calibration) const MAX_REFINEMENT_STEPS: u32 =
    MAX_STEPS_PER_NOISE_ESTIMATE as u32 * (1 + MAX_NOISE_ESTIMATES as u32);

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::calibration) enum RefinementProgress {
    /// Another refinement step is required.
    Continue,
    Converged,
    Failed,
}

/// Levenberg-Marquardt damping: fraction of the information's diagonal that is added to it.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Damping {
    value: f32,
    growth: f32,
}

impl Damping {
    const INITIAL_GROWTH: f32 = 4.0;
    /// Damping at which steps are negligible, which ends the search.
    const MAX_DAMPING: f32 = 1e6;
    /// Damping below `f32` resolution.
    const MIN_DAMPING: f32 = 1e-9;

    /// Damping at a starting point that may be far from the solution.
    const START_DAMPING: Self = Self { value: 1e-3, growth: Self::INITIAL_GROWTH };
    /// Damping for new weights near a converged solution.
    const REWEIGHTED_DAMPING: f32 = 1e-6;

    /// Damping after an accepted step; `gain_ratio`: achieved over predicted gain. A tenth for a ratio of 1, more for
    /// less than 0.5 (H. B. Nielsen, "Damping parameter in Marquardt's method", IMM-REP-1999-05).
    fn after_success(self, gain_ratio: f32) -> Self {
        let centred_ratio = 2.0 * gain_ratio.clamp(0.0, 1.0) - 1.0;
        let value =
            (self.value * (1.0 - centred_ratio * centred_ratio * centred_ratio).max(0.1)).max(Self::MIN_DAMPING);
        Self { value, growth: Self::INITIAL_GROWTH }
    }

    fn after_failure(self) -> Self {
        Self { value: self.value * self.growth, growth: 2.0 * self.growth }
    }
}

/// Refinement in progress; each [`refine_step`](Self::refine_step) is one pass over the samples. About 1 KB.
#[derive(Debug)]
pub(in crate::calibration) struct Refinement {
    pub likelihood: Likelihood,
    pub unknowns: Vector13,
    /// Whether the unknowns are refined, not only the noise.
    refines_unknowns: bool,
    pub linear_system: LinearisedProblem,
    damping: Damping,
    noise_estimate_count: u8,
    steps_since_noise_estimate: u8,
}

impl Refinement {
    pub fn new(likelihood: Likelihood, samples: Samples<'_>, unknowns: Vector13, refines_unknowns: bool) -> Self {
        let system = LinearisedProblem::linearise(&likelihood, samples, &unknowns);
        Self {
            likelihood,
            unknowns,
            refines_unknowns,
            linear_system: system,
            damping: Damping::START_DAMPING,
            noise_estimate_count: 0,
            steps_since_noise_estimate: 0,
        }
    }

    /// Restarts with a latency in seconds, with the unknowns moved by `step`.
    #[inline(never)]
    pub fn restart_with_latency(&mut self, samples: Samples<'_>, latency_s: f32, step: &Vector13) {
        self.likelihood.latency_s = latency_s;
        self.unknowns += step;
        self.restart_near_solution(samples);
    }

    /// Restarts with a change of the motor-current interference (mount axes, units of field per ampere), with the
    /// unknowns moved by `step`.
    #[inline(never)]
    pub fn restart_with_interference(
        &mut self,
        samples: Samples<'_>,
        interference_change: &Vector3<f32>,
        step: &Vector13,
    ) {
        let likelihood = &mut self.likelihood;
        let k = likelihood.interference_per_ampere() + interference_change;
        likelihood.motor_current.ut_per_a = (likelihood.mount_from_chip.tr_mul(&k) * likelihood.field_unit_ut).into();
        self.unknowns += step;
        self.restart_near_solution(samples);
        // The noise estimate contained the interference, so one more is needed.
        self.noise_estimate_count = MAX_NOISE_ESTIMATES - 2;
    }

    #[inline(never)]
    pub fn restart_with_noise(&mut self, samples: Samples<'_>, noise: NoiseModel) {
        self.likelihood = Likelihood { noise, has_noise_estimate: true, sample_stride: 1, ..self.likelihood.clone() };
        self.restart_near_solution(samples);
    }

    #[inline(never)]
    fn restart_near_solution(&mut self, samples: Samples<'_>) {
        self.noise_estimate_count = MAX_NOISE_ESTIMATES - 1;
        self.steps_since_noise_estimate = 0;
        self.damping.value = Damping::REWEIGHTED_DAMPING;
        self.linear_system = LinearisedProblem::linearise(&self.likelihood, samples, &self.unknowns);
    }

    /// One pass over the samples. Not inlined, which bounds the solver's stack.
    #[inline(never)]
    pub fn refine_step(&mut self, samples: Samples<'_>) -> RefinementProgress {
        if self.refines_unknowns {
            match self.levenberg_marquardt_step(samples) {
                RefinementProgress::Converged => {}
                other => return other,
            }
        }
        if self.noise_estimate_count == MAX_NOISE_ESTIMATES {
            return RefinementProgress::Converged;
        }
        self.noise_estimate_count += 1;
        self.steps_since_noise_estimate = 0;
        self.likelihood.estimate_noise(
            self.linear_system.clipped_squares,
            self.linear_system.sample_count,
            &self.unknowns,
        );
        // The last pass and the covariance need all digits, which sums of thin data lose.
        self.likelihood.uses_normal_equations &= self.noise_estimate_count < MAX_NOISE_ESTIMATES;
        self.linear_system = LinearisedProblem::linearise(&self.likelihood, samples, &self.unknowns);
        self.damping.value = Damping::REWEIGHTED_DAMPING;
        RefinementProgress::Continue
    }

    fn levenberg_marquardt_step(&mut self, samples: Samples<'_>) -> RefinementProgress {
        self.steps_since_noise_estimate += 1;
        let Some((damped_step, predicted_gain)) = self.linear_system.damped_step(self.damping.value) else {
            return RefinementProgress::Failed;
        };
        let trial_unknowns = self.unknowns + damped_step;
        if predicted_gain.abs()
            <= if self.noise_estimate_count == MAX_NOISE_ESTIMATES {
                CONVERGED_COST_REDUCTION
            } else {
                NEARLY_CONVERGED_COST_REDUCTION
            }
        {
            self.unknowns = trial_unknowns;
            self.linear_system.reset_origin();
            return RefinementProgress::Converged;
        }
        let system = LinearisedProblem::linearise(&self.likelihood, samples, &trial_unknowns);
        let tolerance = if self.likelihood.has_noise_estimate { MAX_ACCEPTED_COST_INCREASE } else { f32::MIN_POSITIVE };
        let actual_gain = self.linear_system.cost - system.cost;
        if actual_gain >= -tolerance {
            self.unknowns = trial_unknowns;
            self.linear_system = system;
            // A predicted gain below the tolerance does not show whether the damping fits.
            self.damping =
                self.damping.after_success(if predicted_gain > tolerance { actual_gain / predicted_gain } else { 1.0 });
        } else {
            self.damping = self.damping.after_failure();
        }
        let can_continue = predicted_gain.is_finite()
            && self.damping.value < Damping::MAX_DAMPING
            && self.steps_since_noise_estimate < MAX_STEPS_PER_NOISE_ESTIMATE;
        if can_continue { RefinementProgress::Continue } else { RefinementProgress::Converged }
    }
}

#[cfg(test)]
mod tests;
