//! Numbered mounting rotations of ArduPilot and PX4.

use nalgebra::{Matrix3, Rotation3};

/// Roll, pitch, yaw in degrees, by number, where ArduPilot and PX4 agree.
const ROTATION_ANGLES_DEG: [[u16; 3]; 41] = [
    [0, 0, 0],
    [0, 0, 45],
    [0, 0, 90],
    [0, 0, 135],
    [0, 0, 180],
    [0, 0, 225],
    [0, 0, 270],
    [0, 0, 315],
    [180, 0, 0],
    [180, 0, 45],
    [180, 0, 90],
    [180, 0, 135],
    [0, 180, 0],
    [180, 0, 225],
    [180, 0, 270],
    [180, 0, 315],
    [90, 0, 0],
    [90, 0, 45],
    [90, 0, 90],
    [90, 0, 135],
    [270, 0, 0],
    [270, 0, 45],
    [270, 0, 90],
    [270, 0, 135],
    [0, 90, 0],
    [0, 270, 0],
    [0, 180, 90],
    [0, 180, 270],
    [90, 90, 0],
    [180, 90, 0],
    [270, 90, 0],
    [90, 180, 0],
    [270, 180, 0],
    [90, 270, 0],
    [180, 270, 0],
    [270, 270, 0],
    [90, 180, 90],
    [90, 0, 270],
    [90, 68, 293],
    [0, 315, 0],
    [90, 315, 0],
];

/// A numbered mounting rotation.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct NumberedRotation(u8);

impl NumberedRotation {
    /// The rotation of a number; none if unknown.
    #[must_use]
    pub fn new(rotation_number: f64) -> Option<Self> {
        let rounded = rotation_number.round();
        (0.0..ROTATION_ANGLES_DEG.len() as f64).contains(&rounded).then_some(Self(rounded as u8))
    }

    /// Number of the rotation.
    #[must_use]
    pub const fn rotation_number(self) -> u8 {
        self.0
    }

    /// Rotation matrix from sensor to body axes: roll, then pitch, then yaw.
    #[must_use]
    pub fn rotation_matrix(self) -> Matrix3<f64> {
        let [roll, pitch, yaw] =
            ROTATION_ANGLES_DEG[usize::from(self.0) % ROTATION_ANGLES_DEG.len()].map(|deg| f64::from(deg).to_radians());
        Rotation3::from_euler_angles(roll, pitch, yaw).into_inner()
    }

    /// The numbered rotation nearest to a matrix, and the angle between both, degrees.
    #[must_use]
    pub fn nearest_to_matrix(matrix: &Matrix3<f64>) -> (Self, f64) {
        let angle_deg = |rotation: Self| {
            let trace = (rotation.rotation_matrix().transpose() * matrix).trace();
            libm::acos(((trace - 1.0) / 2.0).clamp(-1.0, 1.0)).to_degrees()
        };
        (0..ROTATION_ANGLES_DEG.len() as u8)
            .map(|number| (Self(number), angle_deg(Self(number))))
            .min_by(|(_, a), (_, b)| a.total_cmp(b))
            .unwrap_or_default()
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector3;

    use super::*;

    /// ArduPilot's vector3.cpp: `ROTATION_YAW_90` makes (-y, x, z), `ROTATION_ROLL_180` (x, -y, -z),
    /// `ROTATION_PITCH_90` (z, y, -x), `ROTATION_YAW_270` (y, -x, z).
    #[test]
    fn rotation_numbers_match_the_autopilots() {
        let rotated =
            |number: f64| NumberedRotation::new(number).unwrap().rotation_matrix() * Vector3::new(1.0, 2.0, 3.0);
        for (number, expected) in [
            (0.0, [1.0, 2.0, 3.0]),
            (2.0, [-2.0, 1.0, 3.0]),
            (8.0, [1.0, -2.0, -3.0]),
            (24.0, [3.0, 2.0, -1.0]),
            (39.0, [-2_f64.sqrt(), 2.0, 8_f64.sqrt()]),
            (6.0, [2.0, -1.0, 3.0]),
        ] {
            assert!((rotated(number) - Vector3::from(expected)).norm() < 1e-12, "{number}: {}", rotated(number));
        }
        assert!(
            NumberedRotation::new(41.0).is_none()
                && NumberedRotation::new(-1.0).is_none()
                && NumberedRotation::new(f64::NAN).is_none()
        );
    }

    #[test]
    fn the_nearest_rotation_is_found() {
        for number in 0..41 {
            let matrix =
                NumberedRotation(number).rotation_matrix() * Rotation3::from_euler_angles(0.1, -0.1, 0.05).into_inner();
            let (nearest, off_deg) = NumberedRotation::nearest_to_matrix(&matrix);
            assert!(
                (nearest.rotation_matrix() - NumberedRotation(number).rotation_matrix()).norm() < 1e-9,
                "{number} {nearest:?}"
            );
            assert!(off_deg > 5.0 && off_deg < 12.0, "{off_deg}");
        }
    }
}
