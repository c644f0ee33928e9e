//! Fit of the model: normal equations, and the Levenberg-Marquardt iteration.

pub(in crate::calibration) mod converged_fit;
pub(in crate::calibration) mod information_matrix;
pub(in crate::calibration) mod levenberg_marquardt;
pub(in crate::calibration) mod linearised_problem;
