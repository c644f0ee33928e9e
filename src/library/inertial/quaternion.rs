//! Rotations as quaternions, from body to navigation frame.

use nalgebra::{Quaternion, UnitQuaternion, Vector3};

use crate::frames::RollPitch;
use crate::trig::{self, VectorLength as _, sqrt};

/// Rotation of the least yaw that levels a specific force. The force must not be zero.
pub(super) fn levelling_rotation(specific_force: &Vector3<f32>) -> UnitQuaternion<f32> {
    let down = -specific_force.unit_vector();
    let (sin_roll, cos_roll) = trig::sin_cos(0.5 * libm::atan2f(down.y, down.z));
    let (sin_pitch, cos_pitch) = trig::sin_cos(-0.5 * trig::asin(down.x));
    UnitQuaternion::new_unchecked(Quaternion::new(
        cos_roll * cos_pitch,
        sin_roll * cos_pitch,
        cos_roll * sin_pitch,
        -sin_roll * sin_pitch,
    ))
}

/// Applies a small rotation vector in body axes, radians.
pub(crate) fn rotated_in_body(attitude: &UnitQuaternion<f32>, angle_rad: &Vector3<f32>) -> UnitQuaternion<f32> {
    normalised(attitude.quaternion() * small_rotation(angle_rad))
}

/// Applies a small rotation vector in the navigation frame, radians.
pub(super) fn rotated_in_navigation(attitude: &UnitQuaternion<f32>, angle_rad: &Vector3<f32>) -> UnitQuaternion<f32> {
    normalised(small_rotation(angle_rad) * attitude.quaternion())
}

/// Quaternion of a rotation vector by its series to the third order: the error is 1e-4 of an angle of 0.5 rad.
fn small_rotation(angle_rad: &Vector3<f32>) -> Quaternion<f32> {
    let half = angle_rad * 0.5;
    let square = half.norm_squared();
    let vector = half * (1.0 - square / 6.0);
    Quaternion::new(1.0 - 0.5 * square, vector.x, vector.y, vector.z)
}

/// The rotation of a quaternion that is not zero.
pub(crate) fn normalised(quaternion: Quaternion<f32>) -> UnitQuaternion<f32> {
    UnitQuaternion::new_unchecked(quaternion / sqrt(quaternion.norm_squared()))
}

/// Roll and pitch of a rotation.
pub(super) fn roll_and_pitch(attitude: &UnitQuaternion<f32>) -> RollPitch {
    let rotation = attitude.to_rotation_matrix();
    roll_and_pitch_of_down(&rotation.matrix().row(2).transpose())
}

/// Roll and pitch of the unit vector down in body axes.
pub(crate) fn roll_and_pitch_of_down(down: &Vector3<f32>) -> RollPitch {
    RollPitch { roll_rad: libm::atan2f(down.y, down.z), pitch_rad: -trig::asin(down.x) }
}
