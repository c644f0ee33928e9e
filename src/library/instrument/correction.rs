//! Correction of readings, as the state machine sets it.

use crate::attitude::AttitudeSource;
use crate::calibration::{Calibration, HeadingUncertainty, Orientation};

/// Corrections to apply, replaced as a whole so that a heading never mixes two calibrations.
#[derive(Clone, Debug, PartialEq)]
pub struct Correction {
    /// Active calibration and its uncertainty.
    pub calibration: Option<(Calibration, HeadingUncertainty)>,
    /// Whether the calibration's inclination is valid; without it inclination is not monitored.
    pub has_valid_inclination: bool,
    /// Heading offset of the mounting, degrees.
    pub align_deg: f32,
    /// Source of the samples' attitude.
    pub sample_attitude: SampleAttitude,
    /// Mounting rotation, once the chip is known. Before the first calibration the compass field is the rotated raw
    /// field.
    pub mount: Option<Orientation>,
    /// Strength of the Earth's field, microtesla, if known.
    pub total_ut: Option<f32>,
    /// Whether the autopilot is armed, if reported.
    pub is_armed: Option<bool>,
    /// Expected errors of gyro and magnetometer.
    pub sensor_errors: SensorErrorSigmas,
    /// Source of the attitude.
    pub attitude_source: AttitudeSource,
}

/// Errors of gyro and magnetometer that the monitor expects before a flight shows them, 1 sigma.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SensorErrorSigmas {
    /// Scale error and cross-axis sensitivity of the gyro, relative.
    pub gyro_scale: f32,
    /// Drift of each axis of the hard iron in a minute, relative to the field strength.
    pub hard_iron_drift_per_minute: f32,
}

impl SensorErrorSigmas {
    /// Default errors: gyro 2 %; hard iron that drifts by 0.25 % of the field in a minute, 0.12 of 50 uT.
    pub const DEFAULT: Self = Self { gyro_scale: 0.02, hard_iron_drift_per_minute: 0.0025 };
}

impl Correction {
    /// Correction without a calibration.
    pub const UNCALIBRATED: Self = Self {
        calibration: None,
        has_valid_inclination: true,
        align_deg: 0.0,
        sample_attitude: SampleAttitude::Interpolated,
        mount: None,
        total_ut: None,
        is_armed: None,
        sensor_errors: SensorErrorSigmas::DEFAULT,
        attitude_source: AttitudeSource::Autopilot,
    };
}

/// Source of the samples' attitude.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SampleAttitude {
    /// Attitude reports, interpolated to the time of each reading.
    Interpolated,
    /// No attitude is used: samples contain the field only, with level attitude.
    Unknown,
}
