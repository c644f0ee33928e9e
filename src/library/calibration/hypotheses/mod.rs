//! Hypotheses beyond the model, each tested by its efficient score.

mod attitude_drift;
pub(in crate::calibration) mod attitude_error;
pub(in crate::calibration) mod attitude_error_table;
pub(in crate::calibration) mod attitude_latency;
mod bank_scale;
pub(in crate::calibration) mod hard_iron_change;
mod hysteresis;
pub(in crate::calibration) mod lagging_bank_scale;
pub(in crate::calibration) mod motor_current;
mod pitch_sign;
pub(in crate::calibration) mod score_test;
