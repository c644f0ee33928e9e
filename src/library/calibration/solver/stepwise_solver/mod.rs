//! Solver for all methods, in steps: from samples to a calibration with its quality.

use super::inclination::GivenInclination;
use super::sample_checks::{check_samples, is_determined};
use super::solve_attempts::{
    ATTEMPT_QUEUE, Attempt, AttemptStart, MAX_SOLVE_STEPS, SampleCorrections, begin_refinement, choose_starting_point,
    has_small_error_and_hard_iron, is_accurate, is_avoidable_by_another_start, is_poor,
};
use crate::calibration::assessment::Solution;
use crate::calibration::closed_form::starting_point::{self, StartingPoint};
use crate::calibration::closed_form::turns::{turn_progress_by_rates_rad, turn_progress_rad};
use crate::calibration::fit::ConvergedFit;
use crate::calibration::fit::levenberg_marquardt::{Refinement, RefinementProgress as Refining};
use crate::calibration::fit::linearised_problem::LinearisedProblem;
use crate::calibration::hypotheses::attitude_error_table::assumed_sigmas;
use crate::calibration::hypotheses::hard_iron_change::ConfirmedChange;
use crate::calibration::hypotheses::motor_current::InterferenceEstimate;
use crate::calibration::model::{Likelihood, NoiseModel, Vector13};
use crate::calibration::types::coefficients::{Calibration, Orientation, Prior};
use crate::calibration::types::quality::{
    AttitudeLatency, ConsiderSigmas, Method, Quality, SolveError, UnobservableQuantities,
};
use crate::calibration::types::samples::{CollectionPart, Sample, Samples};
use crate::calibration::uncertainty::information::Information;
use crate::calibration::uncertainty::observability::{inclination_from_samples, unobservable_quantities};

/// Progress of a solver.
#[expect(clippy::large_enum_variant, reason = "there is one of it, and no heap to put it on")]
#[derive(Debug)]
pub enum SolveProgress {
    /// More steps are needed: call [`Solver::solve_step`] again.
    Continue,
    /// Result of the finished solve.
    Finished(Result<Solution, SolveError>),
}

/// A solve in progress. Each [`solve_step`](Self::solve_step) is one pass over the samples. About 1.5 KB.
#[derive(Debug)]
pub struct Solver {
    method: Method,
    prior: Prior,
    consider_sigmas: ConsiderSigmas,
    refinement: Refinement,
    attempt: Attempt,
    given_inclination: GivenInclination,
    /// Poor result from the closed form, retained during the attempt from the sphere fit.
    first_result: Option<RetainedResult>,
    latency_update_count: u8,
    interference_update_count: u8,
    /// Error of an implausible result from the closed form; reported instead of a later one.
    implausible_result_error: Option<SolveError>,
}

#[derive(Debug)]
struct RetainedResult {
    starting_point: StartingPoint,
    misfit: f32,
    corrections: SampleCorrections,
    noise: NoiseModel,
}

/// Largest accepted inclination, radians: 4 deg from the vertical. Nearer to the pole the floor of the horizontal field
/// makes all inclination residuals equal, a false minimum: after 10 minutes of straight flight, headings were 100 deg
/// off at an expected error of 4 deg.
const MAX_INCLINATION_RAD: f32 = 1.5;

/// Limit of heading change against the direction of the turns, radians: half a circle, more than noise produces.
const REVERSED_TURN_LIMIT_RAD: f32 = -3.0;

impl Solver {
    /// Starts a solve. The samples must stay the same until it finishes.
    ///
    /// # Errors
    ///
    /// Rejects too few samples or headings, non-finite values, an axis that does not change
    /// ([`SolveError::AxisStuck`]), and samples for which the closed form fails ([`SolveError::NotAnEllipse`],
    /// [`SolveError::NotDetermined`], [`SolveError::SamePlane`], [`SolveError::NotConverged`]).
    pub fn new(method: Method, samples: Samples<'_>, prior: &Prior) -> Result<Self, SolveError> {
        Self::with_consider_sigmas(method, samples, prior, ConsiderSigmas::DEFAULT)
    }

    /// As [`new`](Self::new), with other assumptions about the attitude source.
    ///
    /// # Errors
    ///
    /// As [`new`](Self::new).
    pub fn with_consider_sigmas(
        method: Method,
        samples: Samples<'_>,
        prior: &Prior,
        consider_sigmas: ConsiderSigmas,
    ) -> Result<Self, SolveError> {
        check_samples(method, samples)?;
        let (point, start) = choose_starting_point(method, samples, prior)?;
        let refinement = begin_refinement(method, prior, samples, &point, SampleCorrections::NO_CORRECTIONS)?;
        Ok(Self {
            method,
            prior: *prior,
            consider_sigmas,
            refinement,
            attempt: Attempt { start, uses_given_inclination: true },
            given_inclination: GivenInclination::new(prior),
            first_result: None,
            latency_update_count: 0,
            interference_update_count: 0,
            implausible_result_error: None,
        })
    }

    /// One pass over the samples. Its large parts are not inlined, so that their locals do not add up on a small stack.
    #[inline(never)]
    pub fn solve_step(&mut self, samples: Samples<'_>) -> SolveProgress {
        let result = match self.refinement.refine_step(samples) {
            Refining::Continue => return SolveProgress::Continue,
            Refining::Converged => match self.assess_refined(samples) {
                Some(result) => result,
                None => return SolveProgress::Continue,
            },
            Refining::Failed => Err(SolveError::NotConverged),
        };
        if self.method == Method::MaximumLikelihood && self.start_required_attempt(&result, samples) {
            return SolveProgress::Continue;
        }
        let result = self.given_inclination.error_replacing_result(&result).map_or(result, Err);
        SolveProgress::Finished(result.map_err(|error| self.implausible_result_error.unwrap_or(error)))
    }

    /// Runs the solve to its end.
    ///
    /// # Errors
    ///
    /// No coefficients explain the samples ([`SolveError::NotConverged`]), possibly because the hard iron changed;
    /// the samples do not determine the coefficients ([`SolveError::NotDetermined`]); or the solution is implausible
    /// ([`SolveError::TurnsReversed`], [`SolveError::InclinationContradicted`], [`SolveError::MountContradicted`]).
    pub fn run(mut self, samples: Samples<'_>) -> Result<Solution, SolveError> {
        for _ in 0..MAX_SOLVE_STEPS {
            if let SolveProgress::Finished(result) = self.solve_step(samples) {
                return result;
            }
        }
        Err(SolveError::NotConverged)
    }

    /// Starts the next attempt that the result of this one requires; returns whether there is one.
    fn start_required_attempt(&mut self, result: &Result<Solution, SolveError>, samples: Samples<'_>) -> bool {
        let current = self.attempt;
        let mut later_attempts = ATTEMPT_QUEUE.iter().skip_while(|attempt| **attempt != current).skip(1);
        later_attempts.any(|attempt| {
            attempt.may_follow(current)
                && match attempt.start {
                    AttemptStart::ClosedForm => self.start_without_inclination(result, samples),
                    AttemptStart::Sphere => self.start_from_sphere(result, samples),
                    AttemptStart::FirstResult => self.restore_first_result(result, samples),
                }
        })
    }

    /// Retains a poor or implausible result from the closed form, and starts from the sphere fit.
    #[inline(never)]
    fn start_from_sphere(&mut self, result: &Result<Solution, SolveError>, samples: Samples<'_>) -> bool {
        self.implausible_result_error = result
            .as_ref()
            .err()
            .copied()
            .filter(|error| is_avoidable_by_another_start(error) && samples.has_free_flight_samples());
        if self.implausible_result_error.is_none() && !is_poor(result) {
            return false;
        }
        let starting_point = starting_point::sphere_start(samples, &self.prior.mount.body_from_sensor());
        let retained = result.as_ref().ok().and_then(|solution| self.retain_result(solution));
        let is_started = starting_point.is_some_and(|starting_point| {
            self.restart_refinement(samples, &starting_point, SampleCorrections::NO_CORRECTIONS)
        });
        if is_started {
            self.attempt.start = AttemptStart::Sphere;
            self.first_result = retained;
        }
        is_started
    }

    /// Restarts at the retained result, unless the sphere fit led to a smaller misfit.
    #[inline(never)]
    fn restore_first_result(&mut self, result: &Result<Solution, SolveError>, samples: Samples<'_>) -> bool {
        let Some(RetainedResult { starting_point: start, misfit, corrections, noise }) = self.first_result.take()
        else {
            return false;
        };
        let is_better = result.as_ref().is_ok_and(|solution| self.misfit(&solution.calibration) < misfit);
        let is_started = !is_better && self.restart_refinement(samples, &start, corrections);
        if is_started {
            self.attempt.start = AttemptStart::FirstResult;
            self.refinement.restart_with_noise(samples, noise);
        }
        is_started
    }

    /// Restarts without the given inclination after an error or an inaccurate result.
    #[inline(never)]
    fn start_without_inclination(&mut self, result: &Result<Solution, SolveError>, samples: Samples<'_>) -> bool {
        let error = result.as_ref().err().copied();
        if result.as_ref().is_ok_and(|solution| is_accurate(&solution.quality))
            || !self.given_inclination.drop_prior(error)
        {
            return false;
        }
        self.prior.inclination_rad = None;
        let Ok((starting_point, start)) = choose_starting_point(self.method, samples, &self.prior) else {
            return false;
        };
        self.attempt = Attempt { start, uses_given_inclination: false };
        self.restart_refinement(samples, &starting_point, SampleCorrections::NO_CORRECTIONS)
    }

    /// Restarts the refinement, if possible; returns whether it did.
    fn restart_refinement(
        &mut self,
        samples: Samples<'_>,
        start: &StartingPoint,
        corrections: SampleCorrections,
    ) -> bool {
        let Ok(refinement) = begin_refinement(self.method, &self.prior, samples, start, corrections) else {
            return false;
        };
        self.refinement = refinement;
        self.latency_update_count = u8::from(corrections.latency_s != 0.0);
        self.interference_update_count = u8::from(self.refinement.likelihood.motor_current.is_applied());
        true
    }

    fn retain_result(&self, solution: &Solution) -> Option<RetainedResult> {
        let (likelihood, unknowns) = (&self.refinement.likelihood, &self.refinement.unknowns);
        let misfit = self.misfit(&solution.calibration);
        let corrections =
            SampleCorrections { latency_s: likelihood.latency_s, ut_per_a: likelihood.motor_current.ut_per_a };
        Some(RetainedResult {
            starting_point: likelihood.starting_point(unknowns)?,
            misfit,
            corrections,
            noise: likelihood.noise.clone(),
        })
    }

    /// Misfit: product of the two residual sigmas, the norm's in microtesla, so that a larger field is not a better
    /// fit. The log-likelihood of `N` samples is `-N ln` of it, up to a constant.
    fn misfit(&self, calibration: &Calibration) -> f32 {
        let noise = &self.refinement.likelihood.noise;
        noise.norm_sigma * calibration.total_ut * noise.inclination_sigma_rad
    }

    /// Assesses the refined result. `None` on a restart with another latency or motor-current interference.
    #[inline(never)]
    fn assess_refined(&mut self, samples: Samples<'_>) -> Option<Result<Solution, SolveError>> {
        // A compass swing on level ground fixes the inclination during refinement only.
        let likelihood = &Likelihood {
            known_inclination_rad: self.given_inclination.prior_rad(),
            ..self.refinement.likelihood.clone()
        };
        let unknowns = &self.refinement.unknowns.clone();
        let mut calibration = match likelihood.calibration(unknowns) {
            Ok(calibration) => calibration,
            Err(error) => return Some(Err(error)),
        };
        if self.method == Method::MaximumLikelihood && libm::fabsf(calibration.inclination_rad) > MAX_INCLINATION_RAD {
            return Some(Err(SolveError::NotDetermined(CollectionPart::FREE)));
        }
        if self.first_result.as_ref().is_some_and(|first| self.misfit(&calibration) >= first.misfit) {
            return Some(Err(SolveError::NotConverged));
        }
        let mut information = self.information(likelihood, samples);
        let fit = ConvergedFit { method: self.method, likelihood, unknowns, calibration: &calibration, samples };
        let change = fit.accumulate_information(&mut information);
        if self.method == Method::MaximumLikelihood
            && let Some(found) = information.estimate_interference(likelihood)
        {
            if self.restart_with_interference(samples, &information, &found) {
                return None;
            }
            calibration.motor_current.sigma_ut_per_a = found.largest_axis_sigma() * likelihood.field_unit_ut;
        }
        let refined_fit =
            ConvergedFit { method: self.method, likelihood, unknowns, calibration: &calibration, samples };
        let latency = if self.method == Method::MaximumLikelihood {
            let found = information.estimate_latency(likelihood.latency_s);
            if self.restart_with_latency(samples, found.as_ref()) {
                return None;
            }
            found.map(|(latency, _)| latency)
        } else {
            None
        };
        Some(self.build_solution(&refined_fit, &mut information, change, latency))
    }

    /// Restarts if the estimated attitude latency differs from the one in use. Returns whether it did.
    fn restart_with_latency(&mut self, samples: Samples<'_>, estimate: Option<&(AttitudeLatency, Vector13)>) -> bool {
        let used_s = self.refinement.likelihood.latency_s;
        let Some((latency, step)) = estimate else { return false };
        let Some(latency_s) = latency.next_latency_s(used_s, self.latency_update_count) else { return false };
        self.latency_update_count += 1;
        self.refinement.restart_with_latency(samples, latency_s, &(step * (latency_s - used_s)));
        true
    }

    #[inline(never)]
    fn restart_with_interference(
        &mut self,
        samples: Samples<'_>,
        information: &Information,
        estimate: &InterferenceEstimate,
    ) -> bool {
        let likelihood = &self.refinement.likelihood;
        let applied = likelihood.interference_per_ampere();
        let scaled_current_sigma_a_ut = likelihood.motor_current.current_sigma_a * likelihood.field_unit_ut;
        let Some(next_interference) =
            estimate.next_interference(&applied, self.interference_update_count, scaled_current_sigma_a_ut)
        else {
            return false;
        };
        let interference_change = next_interference - applied;
        let Some(step) = information.step_for_interference_change(&interference_change) else { return false };
        self.interference_update_count += 1;
        self.refinement.restart_with_interference(samples, &interference_change, &step);
        true
    }

    #[inline(never)]
    fn build_solution(
        &mut self,
        refined_fit: &ConvergedFit<'_>,
        information: &mut Information,
        hard_iron_change: Option<ConfirmedChange>,
        latency: Option<AttitudeLatency>,
    ) -> Result<Solution, SolveError> {
        let &ConvergedFit { likelihood, calibration, samples, .. } = refined_fit;
        let fit_error = if likelihood.is_acceptable_fit() {
            self.check_plausibility(samples, calibration)
        } else {
            Err(SolveError::NotConverged)
        };
        // A hard-iron change explains a misfit or an implausible result. At a false optimum of samples that leave
        // coefficients to the priors, any change and any mount may appear.
        fit_error.map_err(|error| {
            let is_determined = are_coefficients_observable(information, likelihood, refined_fit.unknowns);
            match &hard_iron_change {
                Some(change) if is_determined => SolveError::HardIronChanged(change.detected_change),
                None if is_determined => error,
                _ if error == SolveError::NotConverged => error,
                _ => SolveError::NotDetermined(CollectionPart::FREE),
            }
        })?;
        if self.method == Method::MaximumLikelihood {
            let sigmas = assumed_sigmas(self.consider_sigmas, latency);
            let sample_inclination = inclination_from_samples(information, likelihood, refined_fit.unknowns, &sigmas);
            self.given_inclination
                .check_inclination(sample_inclination, likelihood.config.known_inclination_sigma_rad)?;
        }
        if self.method == Method::Ellipsoid && !is_determined(refined_fit, information) {
            return Err(SolveError::NotDetermined(CollectionPart::FREE));
        }
        // Advice is not computed for a poor result that another starting point may improve.
        let needs_advice = |quality: &Quality| {
            self.attempt.start != AttemptStart::ClosedForm
                || self.method != Method::MaximumLikelihood
                || has_small_error_and_hard_iron(quality, calibration)
        };
        refined_fit.assess(information, hard_iron_change, latency, self.consider_sigmas, needs_advice)
    }

    /// Information at the result; linearised again if the refinement fixed the inclination.
    #[inline(never)]
    fn information(&self, likelihood: &Likelihood, samples: Samples<'_>) -> Information {
        if likelihood.known_inclination_rad == self.refinement.likelihood.known_inclination_rad {
            Information::new(&self.refinement.linear_system)
        } else {
            Information::new(&LinearisedProblem::linearise(likelihood, samples, &self.refinement.unknowns))
        }
    }

    #[inline(never)]
    fn check_plausibility(&self, samples: Samples<'_>, calibration: &Calibration) -> Result<(), SolveError> {
        let heading = |s: &Sample| calibration.corrected_level_field(s).heading_rad();
        // The gyro gives the direction of turn; without it the bank does, for aircraft that bank into their turns.
        let by_bank =
            || CollectionPart::TURNS.into_iter().map(|part| turn_progress_rad(samples, part, heading)).sum::<f32>();
        let progress = || turn_progress_by_rates_rad(samples, heading).unwrap_or_else(by_bank);
        if self.method != Method::Ellipsoid && progress() < REVERSED_TURN_LIMIT_RAD {
            return Err(SolveError::TurnsReversed);
        }
        let nearest_mount = Orientation::nearest_to_rotation(&calibration.w_matrix());
        if nearest_mount != self.prior.mount {
            return Err(SolveError::MountContradicted { found: nearest_mount });
        }
        Ok(())
    }
}

/// Whether the samples, not the priors, determine all coefficients but the inclination.
#[inline(never)]
fn are_coefficients_observable(information: &Information, likelihood: &Likelihood, unknowns: &Vector13) -> bool {
    unobservable_quantities(&information.linear_system, likelihood, unknowns)
        .is_some_and(|unobservable| unobservable == UnobservableQuantities::default())
}

/// Solves samples by one method, to the end. On a device with other work to do, use [`Solver`].
///
/// # Errors
///
/// The errors of [`Solver::new`] and [`Solver::run`].
pub fn solve_samples(method: Method, samples: Samples<'_>, prior: &Prior) -> Result<Solution, SolveError> {
    Solver::new(method, samples, prior)?.run(samples)
}

#[cfg(test)]
mod tests;
