//! Hypotheses beyond the model, each tested by its efficient score.

pub(in crate::calibration) mod attitude_error;
pub(in crate::calibration) mod attitude_error_table;
pub(in crate::calibration) mod attitude_latency;
mod bank_scale;
pub(in crate::calibration) mod hard_iron_change;
mod hysteresis;
pub(in crate::calibration) mod motor_current;
pub(in crate::calibration) mod score_test;
