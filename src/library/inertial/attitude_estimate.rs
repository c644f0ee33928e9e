//! Output of the attitude filter.

use nalgebra::{Matrix2, Rotation3, UnitQuaternion, Vector3};

use super::quaternion::{roll_and_pitch, roll_and_pitch_of_down};
use crate::frames::RollPitch;
use crate::trig::{hypot, sqrt};

/// Roll, pitch and body rates with the covariance of the tilt.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct InertialAttitude {
    /// Roll and pitch.
    pub attitude: RollPitch,
    /// Body rates without the estimated errors of the gyro, rad/s.
    pub rates_rad_s: Vector3<f32>,
    /// Measured body rates less the offset of the gyro at its last rest, rad/s: without what the filter makes of accelerations.
    /// `None` before the first rest: the offset is several degrees per second, and its estimate in turns, without a speed, as wrong.
    pub measured_rates_rad_s: Option<Vector3<f32>>,
    /// Variance of that offset, of each axis, (rad/s)^2: it has drifted since the rest.
    pub rest_offset_variance: f32,
    /// Heading in the navigation frame, rad, -pi..pi. Only differences are meaningful; they drift with the gyro's offset.
    pub frame_heading_rad: f32,
    /// Number of the filter's start, wraps. Headings of different starts cannot be compared.
    pub start_count: u8,
    /// Covariance of the tilt's error about the level frame's x and y axes, rad^2. Pitch has the error about y, roll
    /// that about x divided by the cosine of the pitch.
    pub tilt_covariance: Matrix2<f32>,
    /// Whether the tilt and the accelerometer's offset are known well enough for a sample of a calibration.
    pub is_accurate: bool,
}

impl InertialAttitude {
    /// The estimate in body axes, after a turn of the sensors by this angle about the body's z axis, clockwise as seen from above.
    #[must_use]
    pub fn of_turned_sensors(self, turn_rad: f32) -> Self {
        let rotation = Rotation3::from_axis_angle(&Vector3::z_axis(), turn_rad);
        Self {
            attitude: roll_and_pitch_of_down(&(rotation * self.attitude.tilt_rotation().down_in_body())),
            rates_rad_s: rotation * self.rates_rad_s,
            measured_rates_rad_s: self.measured_rates_rad_s.map(|rates_rad_s| rotation * rates_rad_s),
            ..self
        }
    }

    /// The estimate from the rotation to the navigation frame, the rates, and the tilt's covariance in that frame.
    pub(super) fn new(
        rotation: &UnitQuaternion<f32>,
        (rates_rad_s, measured_rates_rad_s): (Vector3<f32>, Option<Vector3<f32>>),
        rest_offset_variance: f32,
        start_count: u8,
        navigation_covariance: &Matrix2<f32>,
        is_accurate: bool,
    ) -> Self {
        let nose = rotation * Vector3::x();
        let length = hypot(nose.x, nose.y);
        // A vertical nose has no direction.
        let (cos, sin) = if length > 0.0 { (nose.x / length, nose.y / length) } else { (1.0, 0.0) };
        let to_level = Matrix2::new(cos, sin, -sin, cos);
        Self {
            attitude: roll_and_pitch(rotation),
            rates_rad_s,
            measured_rates_rad_s,
            rest_offset_variance,
            frame_heading_rad: libm::atan2f(nose.y, nose.x),
            start_count,
            tilt_covariance: to_level * navigation_covariance * to_level.transpose(),
            is_accurate,
        }
    }

    /// Standard deviation of the angle between true and estimated vertical, radians.
    #[must_use]
    pub fn tilt_sigma_rad(&self) -> f32 {
        sqrt(self.tilt_covariance.trace())
    }
}

#[cfg(test)]
mod tests {
    use core::f32::consts::FRAC_PI_2;

    use super::*;

    /// Heading along the navigation frame's y axis, the error about that axis is one of roll.
    #[test]
    fn the_covariance_is_that_of_the_level_frame() {
        let navigation_covariance = Matrix2::new(1.0, 0.5, 0.5, 4.0);
        for (yaw_rad, level_covariance) in
            [(0.0, navigation_covariance), (FRAC_PI_2, Matrix2::new(4.0, -0.5, -0.5, 1.0))]
        {
            let rotation = UnitQuaternion::from_euler_angles(0.4, -0.3, yaw_rad);
            let estimate =
                InertialAttitude::new(&rotation, (Vector3::zeros(), None), 0.0, 0, &navigation_covariance, true);
            assert!((estimate.tilt_covariance - level_covariance).norm() < 1e-5, "{yaw_rad}");
            let RollPitch { roll_rad, pitch_rad } = estimate.attitude;
            assert!((roll_rad - 0.4).abs() < 1e-6 && (pitch_rad + 0.3).abs() < 1e-6);
            assert!((estimate.tilt_sigma_rad() - 5_f32.sqrt()).abs() < 1e-6);
        }
    }

    /// Sensors that have turned to the right: their x axis is the body's y axis, their right is its tail.
    #[test]
    fn turned_sensors_give_the_motion_of_the_body() {
        let rotation = UnitQuaternion::from_euler_angles(0.4, 0.0, 0.0);
        let rates = Vector3::new(1.0, 2.0, 3.0);
        let estimate = InertialAttitude::new(&rotation, (rates, Some(rates)), 0.0, 0, &Matrix2::identity(), true)
            .of_turned_sensors(FRAC_PI_2);
        let RollPitch { roll_rad, pitch_rad } = estimate.attitude;
        assert!(roll_rad.abs() < 1e-6 && (pitch_rad - 0.4).abs() < 1e-6, "{roll_rad} {pitch_rad}");
        for rates in [Some(estimate.rates_rad_s), estimate.measured_rates_rad_s] {
            assert!((rates.unwrap() - Vector3::new(-2.0, 1.0, 3.0)).norm() < 1e-6, "{rates:?}");
        }
    }
}
