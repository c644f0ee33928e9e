//! Output of the monitor: correction of calibration and attitude, heading variance, validity.

use nalgebra::Vector3;

use super::adaptive_noise::SampleNoise;
use super::installation_change::InstallationChange;
use super::measurement_model::{
    self, ATTITUDE_LATENCY_INDEX, GYRO_HEADING_OFFSET_INDEX, INCLINATION_CHANGE_INDEX, MOUNT_TURN_INDEX, STATE_COUNT,
    STRENGTH_CHANGE_INDEX, StateVector, mount_axis,
};
use super::monitored_calibration::MonitoredCalibration;
use super::parameters::READING_GATE_SIGMAS;
use crate::attitude::{EulerRates, GyroHeading};
use crate::calibration::{Calibration, HeadingUncertainty, inverse};
use crate::frames::{RollPitch, wrap_pi, wrap_two_pi};
use crate::heading::{Heading, NoHeading};
use crate::trig::{sin_cos, sqrt, square};

/// Estimated states, with the parts of their covariance that headings need.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct MonitorOutput {
    pub(super) states: StateVector,
    /// Heading variance due to the states' covariance, square radians.
    pub heading_variance_rad2: f32,
    pub(super) sample_noise: Option<SampleNoise>,
    /// Gyro integration run, and variance of its heading offset, square radians.
    pub(super) run_and_heading_offset_variance: Option<(u8, f32)>,
    /// Reason why headings are withheld.
    pub validity: Result<(), NoHeading>,
    /// Change of the installation, once it is significant.
    pub installation_change: Option<InstallationChange>,
}

impl MonitorOutput {
    pub const INITIAL: Self = Self {
        states: [0.0; STATE_COUNT],
        heading_variance_rad2: 0.0,
        sample_noise: None,
        run_and_heading_offset_variance: None,
        validity: Ok(()),
        installation_change: None,
    };

    pub fn correct_attitude(&self, reported: RollPitch, euler_rates: &EulerRates) -> RollPitch {
        measurement_model::correct_attitude(reported, euler_rates, &self.states)
    }

    /// Heading by the gyro's and its estimated offset; `None` before the first sample of an integration run.
    pub fn heading_by_gyro(&self, gyro_heading: &GyroHeading) -> Option<Heading> {
        let GyroHeading { euler_rates, relative_heading_rad, run_number } = gyro_heading;
        let (run, offset_variance_rad2) = self.run_and_heading_offset_variance?;
        (run == *run_number).then(|| Heading {
            magnetic_rad: wrap_two_pi(
                relative_heading_rad
                    + self.states[GYRO_HEADING_OFFSET_INDEX]
                    + self.states[ATTITUDE_LATENCY_INDEX] * euler_rates.heading_rad_s,
            ),
            sigma_rad: sqrt(offset_variance_rad2),
            systematic_variance_rad2: 0.0,
        })
    }

    /// Gate of a single reading against the gyro heading; it detects a field step 0.1 s earlier than an averaged
    /// sample.
    pub fn passes_reading_gate(&self, heading: Heading, gyro_heading: Option<&GyroHeading>) -> bool {
        gyro_heading.and_then(|gyro_heading| self.heading_by_gyro(gyro_heading)).is_none_or(|by_gyro| {
            let innovation_rad = wrap_pi(heading.magnetic_rad - by_gyro.magnetic_rad);
            let variance_rad2 = square(heading.sigma_rad) + square(by_gyro.sigma_rad);
            square(innovation_rad) <= square(READING_GATE_SIGMAS) * variance_rad2
        })
    }

    /// Calibration and its uncertainty, corrected by the estimated states and variances. The turn in the mount and the
    /// change of hard iron become part of both, `W R (m - b) - beta F = W R (m - (b + R^T W^-1 beta F))`.
    #[inline(never)]
    pub fn correct_calibration(&self, monitored: &MonitoredCalibration<'_>) -> (Calibration, HeadingUncertainty) {
        let MonitoredCalibration { calibration, uncertainty, readings_per_sample } = *monitored;
        let beta_ut = measurement_model::hard_iron_change(&self.states) * calibration.total_ut;
        let change_ut = inverse(&calibration.w_matrix()).map_or_else(Vector3::zeros, |inverse| inverse * beta_ut);
        let (axis, (sin, cos)) = (mount_axis(calibration), sin_cos(self.states[MOUNT_TURN_INDEX]));
        let turned_back = |v: Vector3<f32>| {
            let across = axis.cross(&v);
            v - across * sin + axis.cross(&across) * (1.0 - cos)
        };
        let corrected = Calibration {
            w: calibration.w.map(|row| turned_back(row.into()).into()),
            b_ut: (calibration.b_vector_ut() + turned_back(change_ut)).into(),
            inclination_rad: calibration.inclination_rad + self.states[INCLINATION_CHANGE_INDEX],
            total_ut: calibration.total_ut * (1.0 + self.states[STRENGTH_CHANGE_INDEX]),
            ..*calibration
        };
        let mut adapted = *uncertainty;
        if let Some(noise) = self.sample_noise {
            adapted.relative_sensor_sigma = sqrt(noise.strength_variance * f32::from(readings_per_sample));
            adapted.attitude_sigma_rad = sqrt(noise.tilt_variance_rad2);
        }
        (corrected, adapted)
    }
}
