//! Hypotheses beyond the model, each tested by its efficient score.

pub(in crate::calibration) mod attitude_latency;
pub(in crate::calibration) mod bank_scale;
pub(in crate::calibration) mod hard_iron_change;
pub(in crate::calibration) mod motor_current;
