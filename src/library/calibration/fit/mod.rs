//! Fit of the model: normal equations, and the Levenberg-Marquardt iteration.

pub(in crate::calibration) mod information_matrix;
pub(in crate::calibration) mod levenberg_marquardt;
pub(in crate::calibration) mod linearised_problem;

use crate::calibration::model::{Likelihood, Vector13};
use crate::calibration::types::coefficients::Calibration;
use crate::calibration::types::quality::{AttitudeEnvelope, Method};
use crate::calibration::types::samples::Samples;

/// A converged fit: the model at its result, with the samples.
pub(in crate::calibration) struct ConvergedFit<'a> {
    pub method: Method,
    pub likelihood: &'a Likelihood,
    pub unknowns: &'a Vector13,
    pub calibration: &'a Calibration,
    pub samples: Samples<'a>,
}

impl ConvergedFit<'_> {
    pub fn envelope(&self) -> AttitudeEnvelope {
        AttitudeEnvelope::for_samples(self.method, self.samples)
    }
}
