//! Statistics of the residuals that the model does not contain.

pub(in crate::calibration) mod autocorrelation;
pub(in crate::calibration) mod discrepancy;
pub(in crate::calibration) mod heteroscedasticity;
pub(in crate::calibration) mod residuals;
pub(in crate::calibration) mod white_noise_fraction;
