//! Solver for all methods, in steps: from samples to a calibration with its quality.

mod ellipsoid;
pub(in crate::calibration) mod stepwise;
