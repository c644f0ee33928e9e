//! Attempts of a maximum-likelihood solve: where each starts, and which one follows which.

use nalgebra::Matrix3;

use crate::calibration::assessment::Solution;
use crate::calibration::closed_form::starting_point::{self, SensorResponse, StartingPoint};
use crate::calibration::closed_form::{compass_swing, four_ellipse, level_ellipse, two_plane};
use crate::calibration::fit::levenberg_marquardt::{MAX_REFINEMENT_STEPS, Refinement};
use crate::calibration::hypotheses::{attitude_latency, motor_current};
use crate::calibration::model::{Likelihood, ModelConfig};
use crate::calibration::types::coefficients::{Calibration, Orientation, Prior};
use crate::calibration::types::quality::{AttitudeEnvelope, Method, Quality, SolveError};
use crate::calibration::types::samples::{CollectionPart, Samples};
use crate::trig::VectorLength as _;

/// Starting point of an attempt.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum AttemptStart {
    /// Closed form, or fit to the vertical.
    ClosedForm,
    /// Sphere fit.
    Sphere,
    /// Result of the attempt from the closed form, with its noise and corrections.
    FirstResult,
}

/// A refinement from a starting point, with as many latencies and motor-current interferences as their rules allow.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Attempt {
    pub start: AttemptStart,
    /// Whether a given inclination is a prior.
    pub uses_given_inclination: bool,
}

/// All attempts in order. The next attempt is the first later entry that [may follow](Attempt::may_follow), is needed
/// and can start. The last attempt gives the result.
pub(super) static ATTEMPT_QUEUE: [Attempt; 6] = [
    Attempt { start: AttemptStart::ClosedForm, uses_given_inclination: true },
    Attempt { start: AttemptStart::Sphere, uses_given_inclination: true },
    Attempt { start: AttemptStart::FirstResult, uses_given_inclination: true },
    Attempt { start: AttemptStart::ClosedForm, uses_given_inclination: false },
    Attempt { start: AttemptStart::Sphere, uses_given_inclination: false },
    Attempt { start: AttemptStart::FirstResult, uses_given_inclination: false },
];

/// Bound on the steps of a solve: each attempt refines once, and again after each update of latency and of motor
/// current.
pub(super) const MAX_SOLVE_STEPS: u32 = {
    let refinements = 1 + attitude_latency::MAX_UPDATES as u32 + motor_current::MAX_UPDATES as u32;
    ATTEMPT_QUEUE.len() as u32 * refinements * MAX_REFINEMENT_STEPS
};

impl Attempt {
    /// Whether this attempt may follow another: a sphere a closed form, a first result a sphere, and a closed form only
    /// an attempt with the other use of the inclination.
    pub fn may_follow(self, previous: Self) -> bool {
        let is_same = self.uses_given_inclination == previous.uses_given_inclination;
        match self.start {
            AttemptStart::ClosedForm => !is_same,
            AttemptStart::Sphere => is_same && previous.start == AttemptStart::ClosedForm,
            AttemptStart::FirstResult => is_same && previous.start == AttemptStart::Sphere,
        }
    }
}

/// Expected heading error above which a second starting point is tried, degrees RMS.
const MAX_GOOD_EXPECTED_RMS_DEG: f32 = 3.0;

/// Hard iron above which a second starting point is tried, microtesla: six times the Earth's field.
const MAX_GOOD_HARD_IRON_UT: f32 = 300.0;

pub(super) fn is_poor(result: &Result<Solution, SolveError>) -> bool {
    match result {
        Ok(solution) => !has_small_error_and_hard_iron(&solution.quality, &solution.calibration),
        Err(SolveError::NotConverged | SolveError::HardIronChanged(_)) => true,
        Err(_) => false,
    }
}

/// Whether another starting point may avoid the error: wrong mounting, reversed turns, field next to the pole.
pub(super) const fn is_avoidable_by_another_start(error: &SolveError) -> bool {
    matches!(error, SolveError::MountContradicted { .. } | SolveError::TurnsReversed | SolveError::NotDetermined(_))
}

/// A NaN error does not count as good.
pub(super) fn has_small_error_and_hard_iron(quality: &Quality, calibration: &Calibration) -> bool {
    is_accurate(quality) && calibration.b_vector_ut().vector_length() <= MAX_GOOD_HARD_IRON_UT
}

pub(super) fn is_accurate(quality: &Quality) -> bool {
    quality.expected_rms_deg <= MAX_GOOD_EXPECTED_RMS_DEG
}

#[derive(Clone, Copy, Debug)]
pub(super) struct SampleCorrections {
    pub latency_s: f32,
    /// Motor-current interference, uT/A, chip axes.
    pub ut_per_a: [f32; 3],
}

impl SampleCorrections {
    pub const NO_CORRECTIONS: Self = Self { latency_s: 0.0, ut_per_a: [0.0; 3] };
}

fn solve_closed_form(
    method: Method,
    samples: Samples<'_>,
    rotation: &Matrix3<f32>,
    inclination_rad: Option<f32>,
) -> Result<SensorResponse, SolveError> {
    match method {
        Method::Level => level_ellipse::solve_level_ellipse(samples, rotation),
        Method::FourEllipse => four_ellipse::solve_four_ellipse(samples, rotation, inclination_rad),
        Method::TwoPlane | Method::MaximumLikelihood => two_plane::solve_two_plane(samples, rotation),
        Method::CompassSwing => compass_swing::solve_compass_swing(samples.marks, rotation, inclination_rad),
        Method::Ellipsoid => Err(SolveError::NotDetermined(CollectionPart::FREE)),
    }
}

#[inline(never)]
pub(super) fn choose_starting_point(
    method: Method,
    samples: Samples<'_>,
    prior: &Prior,
) -> Result<(StartingPoint, AttemptStart), SolveError> {
    let rotation = prior.mount.body_from_sensor();
    let matches_mounting =
        |start: &StartingPoint| Orientation::nearest_to_rotation(&start.w) == Orientation::IDENTITY_ROTATION;
    if samples.has_free_flight_samples()
        && method != Method::Ellipsoid
        && let Some(start) = starting_point::vertical_component_start(samples, &rotation)
    {
        return Ok((start, AttemptStart::ClosedForm));
    }
    let closed_form_start = match solve_closed_form(method, samples, &rotation, prior.inclination_rad) {
        Ok(response) => response.starting_point(),
        // Where the closed form has no solution, these methods start from the sphere fit.
        Err(_) if matches!(method, Method::MaximumLikelihood | Method::Ellipsoid) => None,
        Err(error) => return Err(error),
    };
    match closed_form_start {
        Some(start) if method == Method::MaximumLikelihood && !matches_mounting(&start) => {
            // Two planes need the direction of turn, which the bank gives only for aircraft that bank into turns.
            let vertical_start = starting_point::vertical_component_start(samples, &rotation).filter(matches_mounting);
            Ok((vertical_start.unwrap_or(start), AttemptStart::ClosedForm))
        }
        Some(start) => Ok((start, AttemptStart::ClosedForm)),
        None if method.is_refined() => Ok((
            starting_point::sphere_start(samples, &rotation).ok_or(SolveError::NotConverged)?,
            AttemptStart::Sphere,
        )),
        None => Err(SolveError::NotConverged),
    }
}

pub(super) fn begin_refinement(
    method: Method,
    prior: &Prior,
    samples: Samples<'_>,
    start: &StartingPoint,
    corrections: SampleCorrections,
) -> Result<Refinement, SolveError> {
    let config = match method {
        Method::Level => ModelConfig::WITH_FIXED_MOUNTING,
        Method::Ellipsoid => ModelConfig::WITHOUT_ATTITUDE,
        Method::FourEllipse | Method::TwoPlane | Method::MaximumLikelihood | Method::CompassSwing => {
            ModelConfig::DEFAULT
        }
    };
    let mut likelihood =
        Likelihood { latency_s: corrections.latency_s, ..Likelihood::new(prior, config, samples, start.field_unit_ut) };
    likelihood.motor_current.ut_per_a = corrections.ut_per_a;
    if method == Method::CompassSwing && AttitudeEnvelope::for_samples(method, samples) == AttitudeEnvelope::Level {
        // The inclination is unobservable on level ground, and fixed at its start value.
        likelihood.known_inclination_rad = Some(start.inclination_rad);
    }
    let unknowns = likelihood.unknowns_from_start(start).ok_or(SolveError::NotConverged)?;
    Ok(Refinement::new(likelihood, samples, unknowns, method.is_refined()))
}
