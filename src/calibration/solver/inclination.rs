//! Inclination of a solve: a given one (by a person or the field model) against that of the samples.

use crate::calibration::{Prior, Solution, SolveError};
use crate::trig::sqrt;

/// Gate of the test of the configured inclination against the samples', sigmas.
const INCLINATION_GATE_SIGMAS: f32 = 4.0;

/// The given inclination, and its use in the solve.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum GivenInclination {
    /// No inclination is given: the samples determine it.
    Unknown,
    /// The given inclination is a prior of the fit, radians.
    Prior { given_rad: f32, is_modelled: bool },
    /// The given inclination, radians, is no longer a prior, because the solve with it failed with this error or was
    /// inaccurate. It is still compared with the result.
    Dropped { given_rad: f32, is_modelled: bool, error: Option<SolveError> },
}

impl GivenInclination {
    pub fn new(prior: &Prior) -> Self {
        let is_modelled = prior.is_inclination_modelled;
        prior.inclination_rad.map_or(Self::Unknown, |given_rad| Self::Prior { given_rad, is_modelled })
    }

    /// Inclination prior of the fit, radians.
    pub const fn prior_rad(self) -> Option<f32> {
        match self {
            Self::Prior { given_rad, .. } => Some(given_rad),
            Self::Unknown | Self::Dropped { .. } => None,
        }
    }

    /// Returns the error that replaces the result of a solve without the given inclination.
    ///
    /// A contradiction of a person's inclination remains the result, because only a person can find its cause; a
    /// contradicted model is ignored. Without a contradiction, the error of the solve with the given inclination is
    /// reported.
    pub const fn decide_against_samples(self, result: &Result<Solution, SolveError>) -> Option<SolveError> {
        const fn is_contradiction(error: &SolveError) -> bool {
            matches!(error, SolveError::InclinationContradicted { .. })
        }
        match (result, self) {
            (Err(error), _) if is_contradiction(error) => None,
            (_, Self::Dropped { error: Some(error), is_modelled, .. })
                if !(is_modelled && is_contradiction(&error)) =>
            {
                Some(error)
            }
            _ => None,
        }
    }

    /// Compares the given inclination, of `sigma_rad`, with that of the samples alone and its variance. A model's
    /// inclination that is no longer a prior is unknown from then on if the samples contradict it.
    ///
    /// # Errors
    ///
    /// [`SolveError::InclinationContradicted`] beyond the gate.
    pub fn check_inclination(&mut self, from_samples: Option<[f32; 2]>, sigma_rad: f32) -> Result<(), SolveError> {
        let (Self::Prior { given_rad, .. } | Self::Dropped { given_rad, .. }) = *self else { return Ok(()) };
        match from_samples {
            Some([own_rad, variance])
                if libm::fabsf(own_rad - given_rad)
                    > INCLINATION_GATE_SIGMAS * sqrt(variance + sigma_rad * sigma_rad) =>
            {
                if let Self::Dropped { is_modelled: true, .. } = self {
                    *self = Self::Unknown;
                    return Ok(());
                }
                let found_deg = libm::roundf(own_rad.to_degrees()).clamp(-90.0, 90.0) as i8;
                Err(SolveError::InclinationContradicted { found_deg })
            }
            _ => Ok(()),
        }
    }
}
