//! Inclination of a solve: a given one (by a person or the field model) against that of the samples.

use crate::calibration::assessment::Solution;
use crate::calibration::types::coefficients::Prior;
use crate::calibration::types::quality::SolveError;
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
    /// A contradiction of a person's inclination remains the result, because only a person can find its cause. Without
    /// a contradiction, the error of the solve with the given inclination is reported.
    pub const fn error_replacing_result(self, result: &Result<Solution, SolveError>) -> Option<SolveError> {
        match (result, self) {
            (Err(SolveError::InclinationContradicted { .. }), _) | (_, Self::Unknown | Self::Prior { .. }) => None,
            (_, Self::Dropped { error, .. }) => error,
        }
    }

    /// Removes the prior after a solve with this error, or an inaccurate one; returns whether there was a prior. A
    /// model's inclination that the samples contradict is unknown from then on.
    pub const fn drop_prior(&mut self, error: Option<SolveError>) -> bool {
        let Self::Prior { given_rad, is_modelled } = *self else { return false };
        *self = match error {
            Some(SolveError::InclinationContradicted { .. }) if is_modelled => Self::Unknown,
            _ => Self::Dropped { given_rad, is_modelled, error },
        };
        true
    }

    /// Compares the given inclination, of `sigma_rad`, with that of the samples alone and its variance. The contradicted
    /// inclination of a model that is no prior any more is unknown from then on.
    ///
    /// # Errors
    ///
    /// [`SolveError::InclinationContradicted`] beyond the gate.
    pub fn check_inclination(
        &mut self,
        inclination_from_samples: Option<[f32; 2]>,
        sigma_rad: f32,
    ) -> Result<(), SolveError> {
        let (Self::Prior { given_rad, .. } | Self::Dropped { given_rad, .. }) = *self else { return Ok(()) };
        match inclination_from_samples {
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

#[cfg(test)]
mod tests {
    use super::*;

    const CONTRADICTED: SolveError = SolveError::InclinationContradicted { found_deg: 57 };

    /// Inclination of 1 rad by samples, and 0.5 rad given, to 0.1 rad each: 3.5 sigmas are consistent.
    fn check_half_radian_off(given: &mut GivenInclination, sigma_rad: f32) -> Result<(), SolveError> {
        given.check_inclination(Some([1.0, sigma_rad * sigma_rad]), sigma_rad)
    }

    #[test]
    fn a_contradicted_person_is_reported_and_a_contradicted_model_is_ignored() {
        for is_modelled in [false, true] {
            let prior = GivenInclination::Prior { given_rad: 0.5, is_modelled };
            let mut given = prior;
            assert_eq!((check_half_radian_off(&mut given, 0.1), given), (Ok(()), prior));
            assert_eq!(
                (check_half_radian_off(&mut given, 0.08), given),
                (Err(CONTRADICTED), prior),
                "the samples alone decide"
            );
            for error in [None, Some(SolveError::NotConverged), Some(CONTRADICTED)] {
                let mut given = prior;
                assert!(given.drop_prior(error) && !given.drop_prior(error));
                let is_unknown = is_modelled && error == Some(CONTRADICTED);
                assert_eq!(given == GivenInclination::Unknown, is_unknown, "{error:?}");
                assert_eq!(check_half_radian_off(&mut given, 0.1), Ok(()));
                let reported = if is_unknown { None } else { error };
                assert_eq!(given.error_replacing_result(&Err(SolveError::NotFinite)), reported);
                assert_eq!(
                    check_half_radian_off(&mut given, 0.08),
                    if is_modelled { Ok(()) } else { Err(CONTRADICTED) }
                );
                assert_eq!(given == GivenInclination::Unknown, is_modelled);
                assert_eq!(given.error_replacing_result(&Err(CONTRADICTED)), None);
            }
        }
    }
}
