//! Statistics of the residuals that the model does not contain.

pub(in crate::calibration) mod discrepancy;
pub(in crate::calibration) mod residuals;
