//! Solver for all methods, in steps: from samples to a calibration with its quality.

mod attempts;
mod ellipsoid;
mod inclination;
mod sample_checks;
mod starts;
pub(in crate::calibration) mod stepwise_solver;
