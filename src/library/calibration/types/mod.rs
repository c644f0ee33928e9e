//! Samples, methods, coefficients, quality and errors: the types of a calibration.

pub(in crate::calibration) mod coefficients;
pub(in crate::calibration) mod quality;
pub(in crate::calibration) mod samples;
