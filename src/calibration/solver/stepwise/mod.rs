//! Solver for all methods, in steps: from samples to a calibration with its quality.

use nalgebra::Matrix3;

use super::ellipsoid;
use crate::calibration::assessment::Solution;
use crate::calibration::closed_form::starting_point;
use crate::calibration::closed_form::starting_point::{SensorResponse, StartingPoint};
use crate::calibration::closed_form::turns::{MIN_SAMPLES, turn_progress_by_rates_rad, turn_progress_rad};
use crate::calibration::closed_form::{compass_swing, four_ellipse, level_ellipse, two_plane};
use crate::calibration::fit::converged_fit::ConvergedFit;
use crate::calibration::fit::levenberg_marquardt::{Refinement, RefinementProgress as Refining};
use crate::calibration::fit::linearised_problem::LinearisedProblem;
use crate::calibration::hypotheses::hard_iron_change::ConfirmedChange;
use crate::calibration::hypotheses::motor_current::InterferenceEstimate;
use crate::calibration::hypotheses::table::assumed_sigmas;
use crate::calibration::model::{Likelihood, ModelConfig, NoiseModel, Vector13};
use crate::calibration::uncertainty::consider::ConsiderSigmas;
use crate::calibration::uncertainty::information::Information;
use crate::calibration::uncertainty::observability::inclination_from_samples;
use crate::calibration::{
    AttitudeLatency, Axis, Calibration, Envelope, Method, Orientation, Prior, Quality, Sample, SamplePart, Samples,
    Side, SolveError,
};
use crate::frames::Attitude;
use crate::trig::{Length as _, sqrt};

/// Progress of a solver.
#[expect(clippy::large_enum_variant, reason = "there is one of it, and no heap to put it on")]
#[derive(Debug)]
pub enum SolveProgress {
    /// More steps are needed: call [`Solver::step`] again.
    Continue,
    /// The result.
    Finished(Result<Solution, SolveError>),
}

/// A solve in progress. Each [`step`](Self::step) is one pass over the samples. About 1.5 KB.
#[derive(Debug)]
pub struct Solver {
    method: Method,
    prior: Prior,
    consider: ConsiderSigmas,
    refinement: Refinement,
    is_sphere_start: bool,
    /// Poor first result, retained while the second starting point is tried.
    first_result: Option<RetainedResult>,
    /// Configured inclination, radians, while a solve without it is tried, and the error of the solve with it.
    dropped_inclination: Option<(f32, Option<SolveError>)>,
    latency_updates: u8,
    motor_current_updates: u8,
    /// Error of an implausible first result, retained in the same way.
    implausible_error: Option<SolveError>,
}

#[derive(Debug)]
struct RetainedResult {
    start: StartingPoint,
    misfit: f32,
    assumed: SampleCorrections,
    noise: NoiseModel,
}

#[derive(Clone, Copy, Debug)]
struct SampleCorrections {
    latency_s: f32,
    /// Motor-current interference, uT/A, chip axes.
    ut_per_a: [f32; 3],
}

impl SampleCorrections {
    const NONE: Self = Self { latency_s: 0.0, ut_per_a: [0.0; 3] };
}

/// Upper limit of a plausible field, microtesla: 10,000 times the Earth's field.
const MAX_FIELD_UT: f32 = 1e6;

/// Width of each end of an axis' range, as a fraction of the range.
const RANGE_END_FRACTION: f32 = 0.01;

/// Stuck if more than 1/5 of the samples are at one end of the range.
const STUCK_ONE_IN: usize = 5;

/// Expected heading error above which a second starting point is tried, degrees RMS.
const MAX_GOOD_RMS_DEG: f32 = 3.0;

/// Hard iron above which a second starting point is tried, microtesla: six times the Earth's field.
const MAX_GOOD_HARD_IRON_UT: f32 = 300.0;

/// Gate of the test of the configured inclination against the samples', sigmas.
const INCLINATION_GATE_SIGMAS: f32 = 4.0;

/// Largest accepted inclination, radians: 4 deg from the vertical. Nearer to the pole the floor of the horizontal field
/// makes all inclination residuals equal, a false minimum: after 10 minutes of straight flight, headings were 100 deg
/// off at an expected error of 4 deg.
const MAX_INCLINATION_RAD: f32 = 1.5;

/// Limit of heading change against the direction of the turns, radians: half a circle, more than noise produces.
const MIN_TURN_PROGRESS_RAD: f32 = -3.0;

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
        consider: ConsiderSigmas,
    ) -> Result<Self, SolveError> {
        check_samples(method, samples)?;
        let (start, from_sphere) = choose_starting_point(method, samples, prior)?;
        let refinement = begin(method, prior, samples, &start, SampleCorrections::NONE)?;
        Ok(Self {
            method,
            prior: *prior,
            consider,
            refinement,
            is_sphere_start: from_sphere,
            first_result: None,
            dropped_inclination: None,
            latency_updates: 0,
            motor_current_updates: 0,
            implausible_error: None,
        })
    }

    /// One pass over the samples. Its large parts are not inlined, so that their locals do not add up on a small stack.
    #[inline(never)]
    pub fn step(&mut self, samples: Samples<'_>) -> SolveProgress {
        let end = match self.refinement.step(samples) {
            Refining::Continue => return SolveProgress::Continue,
            Refining::Converged => match self.assess_refined(samples) {
                Some(end) => end,
                None => return SolveProgress::Continue,
            },
            Refining::Failed => Err(SolveError::NotConverged),
        };
        if self.method == Method::MaximumLikelihood
            && (self.try_second_start(&end, samples) || self.try_without_inclination(&end, samples))
        {
            return SolveProgress::Continue;
        }
        // An error of the solve without the configured inclination counts only if it contradicts that inclination.
        let end = match (end, self.dropped_inclination) {
            (Err(contradicted @ SolveError::InclinationContradicted { .. }), _) => Err(contradicted),
            (_, Some((_, Some(error)))) => Err(error),
            (end, _) => end,
        };
        let end = end.map_err(|error| self.implausible_error.unwrap_or(error));
        SolveProgress::Finished(end)
    }

    /// Runs the solve to its end.
    ///
    /// # Errors
    ///
    /// No coefficients explain the samples ([`SolveError::NotConverged`]), possibly because the hard iron changed;
    /// the samples do not determine the coefficients ([`SolveError::NotDetermined`]); or the solution is implausible
    /// ([`SolveError::TurnsReversed`], [`SolveError::InclinationContradicted`], [`SolveError::MountContradicted`]).
    pub fn run(mut self, samples: Samples<'_>) -> Result<Solution, SolveError> {
        // Terminates after at most 54 refinements of bounded length: two starting points and back to the first, with
        // and without the configured inclination, each with up to 4 latencies and 5 motor-current interferences.
        loop {
            if let SolveProgress::Finished(end) = self.step(samples) {
                return end;
            }
        }
    }

    /// Tries the second starting point after a poor or implausible first result, then restores the first result unless
    /// the second fits better. Returns whether a solve was started.
    #[inline(never)]
    fn try_second_start(&mut self, end: &Result<Solution, SolveError>, samples: Samples<'_>) -> bool {
        if let Some(RetainedResult { start, misfit, assumed, noise }) = self.first_result.take() {
            let is_better = end.as_ref().is_ok_and(|solution| self.misfit(&solution.calibration) < misfit);
            let restores_first = !is_better && self.restart(samples, &start, assumed);
            if restores_first {
                self.refinement.restart_with_noise(samples, noise);
            }
            return restores_first;
        }
        if self.is_sphere_start {
            return false;
        }
        self.implausible_error =
            end.as_ref().err().copied().filter(|error| is_implausible(error) && samples.has_unassigned());
        if self.implausible_error.is_none() && !is_poor(end) {
            return false;
        }
        let start = starting_point::sphere_start(samples, &self.prior.mount.body_from_sensor());
        let kept = end.as_ref().ok().and_then(|solution| self.retain_result(solution));
        self.is_sphere_start = start.is_some_and(|start| self.restart(samples, &start, SampleCorrections::NONE));
        self.first_result = kept.filter(|_| self.is_sphere_start);
        self.is_sphere_start
    }

    /// Restarts without the configured inclination after an error or poor result; returns whether it did.
    #[inline(never)]
    fn try_without_inclination(&mut self, end: &Result<Solution, SolveError>, samples: Samples<'_>) -> bool {
        let error = match end {
            Ok(solution) if is_accurate(&solution.quality) => return false,
            Ok(_) => None,
            Err(error) => Some(*error),
        };
        let Some(told_rad) = self.prior.inclination_rad.take() else { return false };
        self.dropped_inclination = Some((told_rad, error));
        let Ok((start, from_sphere)) = choose_starting_point(self.method, samples, &self.prior) else { return false };
        self.is_sphere_start = from_sphere;
        self.restart(samples, &start, SampleCorrections::NONE)
    }

    /// Restarts the refinement, if possible; returns whether it did.
    fn restart(&mut self, samples: Samples<'_>, start: &StartingPoint, assumed: SampleCorrections) -> bool {
        let Ok(refinement) = begin(self.method, &self.prior, samples, start, assumed) else { return false };
        self.refinement = refinement;
        self.latency_updates = u8::from(assumed.latency_s != 0.0);
        self.motor_current_updates = u8::from(self.refinement.likelihood.motor_current.is_applied());
        true
    }

    fn retain_result(&self, solution: &Solution) -> Option<RetainedResult> {
        let (likelihood, unknowns) = (&self.refinement.likelihood, &self.refinement.unknowns);
        let misfit = self.misfit(&solution.calibration);
        let assumed =
            SampleCorrections { latency_s: likelihood.latency_s, ut_per_a: likelihood.motor_current.ut_per_a };
        Some(RetainedResult {
            start: likelihood.starting_point(unknowns)?,
            misfit,
            assumed,
            noise: likelihood.noise.clone(),
        })
    }

    /// Misfit: product of the two residual sigmas, the norm's in microtesla, so that a larger field is not a better
    /// fit. The log-likelihood of `N` samples is `-N ln` of it, up to a constant.
    fn misfit(&self, calibration: &Calibration) -> f32 {
        let noise = &self.refinement.likelihood.noise;
        noise.norm * calibration.total_ut * noise.inclination_sigma_rad
    }

    /// Assesses the refined result. `None` on a restart with another latency or motor-current interference.
    #[inline(never)]
    fn assess_refined(&mut self, samples: Samples<'_>) -> Option<Result<Solution, SolveError>> {
        // A compass swing on level ground fixes the inclination during refinement only.
        let likelihood =
            &Likelihood { known_inclination_rad: self.prior.inclination_rad, ..self.refinement.likelihood.clone() };
        let unknowns = &self.refinement.unknowns.clone();
        let mut calibration = match likelihood.calibration(unknowns) {
            Ok(calibration) => calibration,
            Err(error) => return Some(Err(error)),
        };
        if self.method == Method::MaximumLikelihood && libm::fabsf(calibration.inclination_rad) > MAX_INCLINATION_RAD {
            return Some(Err(SolveError::NotDetermined(SamplePart::All)));
        }
        if self.first_result.as_ref().is_some_and(|kept| self.misfit(&calibration) >= kept.misfit) {
            return Some(Err(SolveError::NotConverged));
        }
        let mut information = self.information(likelihood, samples);
        let fit = ConvergedFit { method: self.method, likelihood, unknowns, calibration: &calibration, samples };
        let change = fit.accumulate_information(&mut information);
        if self.method == Method::MaximumLikelihood
            && let Some(found) = information.estimate_motor_current(likelihood)
        {
            if self.restart_with_motor_current(samples, &information, &found) {
                return None;
            }
            calibration.motor_current.sigma_ut_per_a = found.max_sigma() * likelihood.unit_ut;
        }
        let judgement = ConvergedFit { method: self.method, likelihood, unknowns, calibration: &calibration, samples };
        let latency = if self.method == Method::MaximumLikelihood {
            let found = information.estimate_latency(likelihood.latency_s);
            if self.restart_with_latency(samples, found.as_ref()) {
                return None;
            }
            found.map(|(latency, _)| latency)
        } else {
            None
        };
        Some(self.build_solution(&judgement, &mut information, change, latency))
    }

    /// Restarts if the estimated attitude latency differs from the one in use. Returns whether it did.
    fn restart_with_latency(&mut self, samples: Samples<'_>, found: Option<&(AttitudeLatency, Vector13)>) -> bool {
        let used_s = self.refinement.likelihood.latency_s;
        let Some((latency, follows)) = found else { return false };
        let Some(latency_s) = latency.next_latency_s(used_s, self.latency_updates) else { return false };
        self.latency_updates += 1;
        self.refinement.restart_with_latency(samples, latency_s, &(follows * (latency_s - used_s)));
        true
    }

    #[inline(never)]
    fn restart_with_motor_current(
        &mut self,
        samples: Samples<'_>,
        information: &Information,
        found: &InterferenceEstimate,
    ) -> bool {
        let likelihood = &self.refinement.likelihood;
        let used = likelihood.motor_current_per_ampere();
        let spread = likelihood.motor_current.current_sigma_a * likelihood.unit_ut;
        let Some(k) = found.next_interference(&used, self.motor_current_updates, spread) else { return false };
        let more = k - used;
        let Some(follow) = information.step_for_motor_current(&more) else { return false };
        self.motor_current_updates += 1;
        self.refinement.restart_with_motor_current(samples, &more, &follow);
        true
    }

    #[inline(never)]
    fn build_solution(
        &self,
        judgement: &ConvergedFit<'_>,
        information: &mut Information,
        change: Option<ConfirmedChange>,
        latency: Option<AttitudeLatency>,
    ) -> Result<Solution, SolveError> {
        let &ConvergedFit { likelihood, calibration, samples, .. } = judgement;
        let sound = if likelihood.is_acceptable_fit() {
            self.check_plausibility(samples, calibration)
        } else {
            Err(SolveError::NotConverged)
        };
        // A hard-iron change explains a misfit or an implausible result.
        sound.map_err(|error| change.as_ref().map_or(error, |change| SolveError::HardIronChanged(change.change)))?;
        if self.method == Method::MaximumLikelihood {
            self.check_inclination(information, likelihood, latency)?;
        }
        if self.method == Method::Ellipsoid && !ellipsoid::is_determined(judgement, information) {
            return Err(SolveError::NotDetermined(SamplePart::All));
        }
        // Advice is not computed for a poor result that another starting point may improve.
        let needs_advice = |quality: &Quality| {
            self.is_sphere_start || self.method != Method::MaximumLikelihood || is_good(quality, calibration)
        };
        judgement.assess(information, change, latency, self.consider, needs_advice)
    }

    /// Information at the result; linearised again if the refinement fixed the inclination.
    #[inline(never)]
    fn information(&self, likelihood: &Likelihood, samples: Samples<'_>) -> Information {
        if likelihood.known_inclination_rad == self.refinement.likelihood.known_inclination_rad {
            Information::new(self.refinement.system())
        } else {
            Information::new(&LinearisedProblem::linearise(likelihood, samples, &self.refinement.unknowns))
        }
    }

    #[inline(never)]
    fn check_inclination(
        &self,
        information: &Information,
        likelihood: &Likelihood,
        latency: Option<AttitudeLatency>,
    ) -> Result<(), SolveError> {
        let Some(told_rad) = self.prior.inclination_rad.or(self.dropped_inclination.map(|(told_rad, _)| told_rad))
        else {
            return Ok(());
        };
        let sigmas = assumed_sigmas(self.consider, latency);
        let own = inclination_from_samples(information, likelihood, &self.refinement.unknowns, &sigmas);
        let sigma_rad = likelihood.config.known_inclination_sigma_rad;
        match own {
            Some([own_rad, variance])
                if libm::fabsf(own_rad - told_rad)
                    > INCLINATION_GATE_SIGMAS * sqrt(variance + sigma_rad * sigma_rad) =>
            {
                let found_deg = libm::roundf(own_rad.to_degrees()).clamp(-90.0, 90.0) as i8;
                Err(SolveError::InclinationContradicted { found_deg })
            }
            _ => Ok(()),
        }
    }

    #[inline(never)]
    fn check_plausibility(&self, samples: Samples<'_>, calibration: &Calibration) -> Result<(), SolveError> {
        let heading = |s: &Sample| calibration.corrected_level_field(s).heading_rad();
        // The gyro gives the direction of turn; without it the bank does, for aircraft that bank into their turns.
        let by_bank = || {
            let sides = [(Side::Left, samples.left), (Side::Right, samples.right)];
            sides.into_iter().map(|(side, samples)| turn_progress_rad(samples, side, heading)).sum::<f32>()
        };
        let progress = || turn_progress_by_rates_rad(samples, heading).unwrap_or_else(by_bank);
        if self.method != Method::Ellipsoid && progress() < MIN_TURN_PROGRESS_RAD {
            return Err(SolveError::TurnsReversed);
        }
        let found = Orientation::nearest(&calibration.w_matrix());
        if found != self.prior.mount {
            return Err(SolveError::MountContradicted { found });
        }
        Ok(())
    }
}

fn is_poor(end: &Result<Solution, SolveError>) -> bool {
    match end {
        Ok(solution) => !is_good(&solution.quality, &solution.calibration),
        Err(SolveError::NotConverged | SolveError::HardIronChanged(_)) => true,
        Err(_) => false,
    }
}

/// Whether another starting point may avoid the error: wrong mounting, reversed turns, field next to the pole.
const fn is_implausible(error: &SolveError) -> bool {
    matches!(error, SolveError::MountContradicted { .. } | SolveError::TurnsReversed | SolveError::NotDetermined(_))
}

/// NaN is not good.
fn is_good(quality: &Quality, calibration: &Calibration) -> bool {
    is_accurate(quality) && calibration.b_vector_ut().length() <= MAX_GOOD_HARD_IRON_UT
}

fn is_accurate(quality: &Quality) -> bool {
    quality.expected_rms_deg <= MAX_GOOD_RMS_DEG
}

/// Solves samples by one method, to the end. On a device with other work to do, use [`Solver`].
///
/// # Errors
///
/// The errors of [`Solver::new`] and [`Solver::run`].
pub fn solve(method: Method, samples: Samples<'_>, prior: &Prior) -> Result<Solution, SolveError> {
    Solver::new(method, samples, prior)?.run(samples)
}

fn solve_closed_form(
    method: Method,
    samples: Samples<'_>,
    rotation: &Matrix3<f32>,
    inclination_rad: Option<f32>,
) -> Result<SensorResponse, SolveError> {
    match method {
        Method::Level => level_ellipse::solve(samples, rotation),
        Method::FourEllipse => four_ellipse::solve(samples, rotation, inclination_rad),
        Method::TwoPlane | Method::MaximumLikelihood => two_plane::solve(samples, rotation),
        Method::CompassSwing => compass_swing::solve(samples.marks, rotation, inclination_rad),
        Method::Ellipsoid => Err(SolveError::NotDetermined(SamplePart::All)),
    }
}

#[inline(never)]
fn choose_starting_point(
    method: Method,
    samples: Samples<'_>,
    prior: &Prior,
) -> Result<(StartingPoint, bool), SolveError> {
    let rotation = prior.mount.body_from_sensor();
    let matches_mounting = |start: &StartingPoint| Orientation::nearest(&start.w) == Orientation::NONE;
    if samples.has_unassigned()
        && let Some(start) = starting_point::vertical_component_start(samples, &rotation)
    {
        return Ok((start, false));
    }
    let closed_form = match solve_closed_form(method, samples, &rotation, prior.inclination_rad) {
        Ok(response) => response.starting_point(),
        // The sphere fit serves instead.
        Err(_) if matches!(method, Method::MaximumLikelihood | Method::Ellipsoid) => None,
        Err(error) => return Err(error),
    };
    match closed_form {
        Some(start) if method == Method::MaximumLikelihood && !matches_mounting(&start) => {
            // Two planes need the direction of turn, which the bank gives only for aircraft that bank into turns.
            let tilted = starting_point::vertical_component_start(samples, &rotation).filter(matches_mounting);
            Ok((tilted.unwrap_or(start), false))
        }
        Some(start) => Ok((start, false)),
        None if method.is_refined() => {
            Ok((starting_point::sphere_start(samples, &rotation).ok_or(SolveError::NotConverged)?, true))
        }
        None => Err(SolveError::NotConverged),
    }
}

fn begin(
    method: Method,
    prior: &Prior,
    samples: Samples<'_>,
    start: &StartingPoint,
    assumed: SampleCorrections,
) -> Result<Refinement, SolveError> {
    let config = match method {
        Method::Level => ModelConfig::FIXED_MOUNTING,
        Method::Ellipsoid => ModelConfig::NO_ATTITUDE,
        Method::FourEllipse | Method::TwoPlane | Method::MaximumLikelihood | Method::CompassSwing => {
            ModelConfig::DEFAULT
        }
    };
    let mut likelihood =
        Likelihood { latency_s: assumed.latency_s, ..Likelihood::new(prior, config, samples, start.unit_ut) };
    likelihood.motor_current.ut_per_a = assumed.ut_per_a;
    if method == Method::CompassSwing && Envelope::for_samples(method, samples) == Envelope::Level {
        // The inclination is unobservable on level ground, and fixed at its start value.
        likelihood.known_inclination_rad = Some(start.inclination_rad);
    }
    let unknowns = likelihood.unknowns_from_start(start).ok_or(SolveError::NotConverged)?;
    Ok(Refinement::new(likelihood, samples, unknowns, method.is_refined()))
}

fn check_samples(method: Method, samples: Samples<'_>) -> Result<(), SolveError> {
    let part = if method == Method::Level { SamplePart::Level } else { SamplePart::All };
    let need = if samples.marks.is_empty() { MIN_SAMPLES } else { 1 };
    SolveError::require(part, samples.all().count(), need)?;
    let headings = samples.marks.iter().all(|mark| mark.heading_rad.is_finite());
    if !(headings && samples.all().all(is_finite)) {
        return Err(SolveError::NotFinite);
    }
    stuck_axis(samples).map_or(Ok(()), |axis| Err(SolveError::AxisStuck { axis }))
}

/// Whether all values are finite, and their fourth powers as well.
fn is_finite(sample: &Sample) -> bool {
    let Attitude { roll_rad, pitch_rad } = sample.attitude;
    sample.field.ut.iter().all(|ut| ut.abs() < MAX_FIELD_UT) && roll_rad.is_finite() && pitch_rad.is_finite()
}

/// Axis that stays at one end of its range in turns: saturated or frozen. In a full circle, 1 sample in 16 is within 1
/// % of either end.
fn stuck_axis(samples: Samples<'_>) -> Option<Axis> {
    let turns = || samples.left.iter().chain(samples.right).chain(samples.unassigned.into_iter().flatten());
    let number = turns().count();
    [Axis::X, Axis::Y, Axis::Z].into_iter().find(|&axis| {
        let values = || turns().map(|s| s.field.ut[axis as usize]);
        let (low, high) = values().fold((f32::MAX, f32::MIN), |(low, high), v| (low.min(v), high.max(v)));
        let near = RANGE_END_FRACTION * (high - low);
        let is_stuck_at = |end: f32| values().filter(|v| (v - end).abs() <= near).count() * STUCK_ONE_IN > number;
        number >= MIN_SAMPLES && (is_stuck_at(low) || is_stuck_at(high))
    })
}

#[cfg(test)]
mod tests;
