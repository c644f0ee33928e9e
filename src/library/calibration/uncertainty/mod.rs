//! Covariance of the coefficients, and the expected heading error.

pub(in crate::calibration) mod coefficient_covariance;
pub(in crate::calibration) mod expected_error;
pub(in crate::calibration) mod heading_uncertainty;
pub(in crate::calibration) mod information;
pub(in crate::calibration) mod observability;
pub(in crate::calibration) mod sandwich_covariance;

#[cfg(test)]
mod tests;
