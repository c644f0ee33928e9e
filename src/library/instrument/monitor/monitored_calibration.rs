//! The calibration that the monitor checks, with the noise that it states for a sample, and the source of the attitude.

use super::adaptive_noise::SampleNoise;
use crate::attitude::AutopilotErrors;
use crate::calibration::{Calibration, HeadingUncertainty};

/// The calibration that samples are checked against.
#[derive(Clone, Copy, Debug)]
pub(in super::super) struct MonitoredCalibration<'a> {
    pub calibration: &'a Calibration,
    pub uncertainty: &'a HeadingUncertainty,
    pub readings_per_sample: u16,
}

/// Whose attitude a sample has.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(in super::super) enum MonitoredAttitude {
    /// The module's own sensors'.
    Own,
    /// An autopilot's, with its errors as own sensors show them.
    Autopilot(AutopilotErrors),
}

impl MonitoredCalibration<'_> {
    pub(super) fn sample_noise(&self) -> SampleNoise {
        let HeadingUncertainty { relative_sensor_sigma, attitude_sigma_rad, .. } = *self.uncertainty;
        SampleNoise {
            strength_variance: relative_sensor_sigma * relative_sensor_sigma
                / f32::from(self.readings_per_sample.max(1)),
            tilt_variance_rad2: attitude_sigma_rad * attitude_sigma_rad,
        }
    }
}
