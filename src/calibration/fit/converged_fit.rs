//! A converged fit: the model at its result, with the samples.

use crate::calibration::model::{Likelihood, Vector13};
use crate::calibration::{Calibration, Envelope, Method, Samples};

pub(in crate::calibration) struct ConvergedFit<'a> {
    pub method: Method,
    pub likelihood: &'a Likelihood,
    pub unknowns: &'a Vector13,
    pub calibration: &'a Calibration,
    pub samples: Samples<'a>,
}

impl ConvergedFit<'_> {
    pub fn envelope(&self) -> Envelope {
        Envelope::for_samples(self.method, self.samples)
    }
}
