//! Solver for all methods, in steps: from samples to a calibration with its quality.

pub(in crate::calibration) mod ellipsoid;
pub(in crate::calibration) mod stepwise;
