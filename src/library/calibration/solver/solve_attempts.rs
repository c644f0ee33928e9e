//! Attempts of a maximum-likelihood solve: where each starts, and which one follows which.

use crate::calibration::assessment::Solution;
use crate::calibration::fit::levenberg_marquardt::MAX_REFINEMENT_STEPS;
use crate::calibration::hypotheses::{attitude_latency, motor_current};
use crate::calibration::types::coefficients::Calibration;
use crate::calibration::types::error::SolveError;
use crate::calibration::types::quality::Quality;
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
