//! Solver for all methods, in steps: from samples to a calibration with its quality.

mod inclination;
mod sample_checks;
mod solve_attempts;
pub(in crate::calibration) mod stepwise_solver;
