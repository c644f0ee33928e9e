//! Samples, methods, coefficients, quality and errors: the types of a calibration.

pub(in crate::calibration) mod bank_scale;
pub(in crate::calibration) mod coefficients;
pub(in crate::calibration) mod consider_states;
pub(in crate::calibration) mod error;
pub(in crate::calibration) mod hard_iron_change;
pub(in crate::calibration) mod method;
pub(in crate::calibration) mod motor_current;
pub(in crate::calibration) mod orientation;
pub(in crate::calibration) mod prior;
pub(in crate::calibration) mod quality;
pub(in crate::calibration) mod rates;
pub(in crate::calibration) mod samples;
