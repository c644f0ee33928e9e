//! The 24 right-angle mountings of a sensor.

use nalgebra::Matrix3;

/// Mounting of the chip: one of the 24 right-angle rotations from chip to body axes.
///
/// Names and meaning as in MAVLink's `MAV_SENSOR_ORIENTATION`: yaw, then pitch, then roll (Euler ZYX). Of two MAVLink
/// names for one rotation the lower number is used.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Orientation(u8);

/// Names of the orientations, with roll, pitch and yaw in quarter turns.
const ORIENTATION_TABLE: [(&str, [u8; 3]); 24] = [
    ("none", [0, 0, 0]),
    ("yaw90", [0, 0, 1]),
    ("yaw180", [0, 0, 2]),
    ("yaw270", [0, 0, 3]),
    ("roll180", [2, 0, 0]),
    ("roll180-yaw90", [2, 0, 1]),
    ("pitch180", [0, 2, 0]),
    ("roll180-yaw270", [2, 0, 3]),
    ("roll90", [1, 0, 0]),
    ("roll90-yaw90", [1, 0, 1]),
    ("roll270", [3, 0, 0]),
    ("roll270-yaw90", [3, 0, 1]),
    ("pitch90", [0, 1, 0]),
    ("pitch270", [0, 3, 0]),
    ("roll90-pitch90", [1, 1, 0]),
    ("roll180-pitch90", [2, 1, 0]),
    ("roll270-pitch90", [3, 1, 0]),
    ("roll90-pitch180", [1, 2, 0]),
    ("roll270-pitch180", [3, 2, 0]),
    ("roll90-pitch270", [1, 3, 0]),
    ("roll180-pitch270", [2, 3, 0]),
    ("roll270-pitch270", [3, 3, 0]),
    ("roll90-pitch180-yaw90", [1, 2, 1]),
    ("roll90-yaw270", [1, 0, 3]),
];

impl Orientation {
    /// Chip axes equal to body axes.
    pub const IDENTITY_ROTATION: Self = Self(0);

    /// Number of orientations.
    pub const ORIENTATION_COUNT: u8 = 24;

    /// Orientation with a number, as stored; [invalid](Self::is_valid) from [`ORIENTATION_COUNT`](Self::ORIENTATION_COUNT) on.
    #[must_use]
    pub const fn from_number(number: u8) -> Self {
        Self(number)
    }

    /// Number in MAVLink order.
    #[must_use]
    pub const fn number(self) -> u8 {
        self.0
    }

    /// All 24 orientations, in MAVLink order.
    pub fn all_orientations() -> impl Iterator<Item = Self> {
        (0..Self::ORIENTATION_COUNT).map(Self)
    }

    /// Parses the output of [`orientation_name`](Self::orientation_name).
    #[must_use]
    pub fn from_name(name: &str) -> Option<Self> {
        Self::all_orientations().find(|orientation| orientation.orientation_name() == name)
    }

    /// Lower-case name, for example `roll180-yaw90`.
    #[must_use]
    pub fn orientation_name(self) -> &'static str {
        self.table_entry().0
    }

    /// Rotation from chip to body axes.
    #[must_use]
    pub fn body_from_sensor(self) -> Matrix3<f32> {
        let [roll, pitch, yaw] = self.table_entry().1.map(quarter_turn_sin_cos);
        let about_x = Matrix3::new(1.0, 0.0, 0.0, 0.0, roll.1, -roll.0, 0.0, roll.0, roll.1);
        let about_y = Matrix3::new(pitch.1, 0.0, pitch.0, 0.0, 1.0, 0.0, -pitch.0, 0.0, pitch.1);
        let about_z = Matrix3::new(yaw.1, -yaw.0, 0.0, yaw.0, yaw.1, 0.0, 0.0, 0.0, 1.0);
        about_z * about_y * about_x
    }

    /// Orientation nearest to a matrix `W` from chip to body axes: the largest `trace(R^T W)`.
    #[must_use]
    pub fn nearest_to_rotation(w: &Matrix3<f32>) -> Self {
        let similarity = |orientation: &Self| orientation.body_from_sensor().component_mul(w).sum();
        Self::all_orientations()
            .max_by(|a, b| similarity(a).total_cmp(&similarity(b)))
            .unwrap_or(Self::IDENTITY_ROTATION)
    }

    fn table_entry(self) -> (&'static str, [u8; 3]) {
        // Data from flash may hold any number; `is_valid` rejects those past the end, which read as the last entry.
        ORIENTATION_TABLE[usize::from(self.0).min(ORIENTATION_TABLE.len() - 1)]
    }

    /// Whether the number is one of the 24: check for data from flash.
    #[must_use]
    pub fn is_valid(self) -> bool {
        usize::from(self.0) < ORIENTATION_TABLE.len()
    }
}

/// Sine and cosine of quarter turns, exact.
fn quarter_turn_sin_cos(turns: u8) -> (f32, f32) {
    match turns % 4 {
        0 => (0.0, 1.0),
        1 => (1.0, 0.0),
        2 => (0.0, -1.0),
        _ => (-1.0, 0.0),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A repeated entry would make another mounting impossible to configure.
    #[test]
    fn all_24_rotations_are_proper_and_distinct() {
        for a in Orientation::all_orientations() {
            let rotation = a.body_from_sensor();
            assert!((rotation.determinant() - 1.0).abs() < f32::EPSILON, "{}", a.orientation_name());
            assert_eq!(Orientation::nearest_to_rotation(&rotation), a);
            for b in Orientation::all_orientations().filter(|&b| b != a) {
                assert_ne!(rotation, b.body_from_sensor(), "{} = {}", a.orientation_name(), b.orientation_name());
            }
        }
    }

    #[test]
    fn orientation_names_round_trip() {
        for orientation in Orientation::all_orientations() {
            assert_eq!(Orientation::from_name(orientation.orientation_name()), Some(orientation));
        }
        assert_eq!(Orientation::from_name("upside-down"), None);
    }

    /// Rotations are compared with nalgebra's ZYX angles.
    #[test]
    fn names_describe_the_rotation() {
        for orientation in Orientation::all_orientations() {
            let turned_deg = |axis: &str| -> f32 {
                let part = orientation.orientation_name().split('-').find_map(|part| part.strip_prefix(axis));
                part.map_or(0.0, |degrees| degrees.parse().unwrap())
            };
            let [roll, pitch, yaw] = ["roll", "pitch", "yaw"].map(|axis| turned_deg(axis).to_radians());
            let expected = nalgebra::Rotation3::from_euler_angles(roll, pitch, yaw);
            let difference = (orientation.body_from_sensor() - expected.matrix()).norm();
            assert!(difference < 1e-6, "{}: {difference}", orientation.orientation_name());
        }
    }

    #[test]
    fn a_mounting_20_deg_off_is_the_nearest_still() {
        for orientation in Orientation::all_orientations() {
            for (x, y, z) in [(0.35, 0.0, 0.0), (0.0, -0.35, 0.0), (0.0, 0.0, 0.35), (-0.2, 0.2, 0.2)] {
                let misalignment = nalgebra::Rotation3::new(nalgebra::Vector3::new(x, y, z));
                assert_eq!(
                    Orientation::nearest_to_rotation(&(misalignment * orientation.body_from_sensor())),
                    orientation
                );
            }
        }
    }

    #[test]
    fn orientation_numbers_from_24_on_are_invalid() {
        assert_eq!(Orientation::all_orientations().filter(|o| o.is_valid()).count(), 24);
        assert!(!Orientation(24).is_valid() && !Orientation(255).is_valid());
        assert_eq!(Orientation(255).orientation_name(), "roll90-yaw270");
        assert_eq!(Orientation::IDENTITY_ROTATION.body_from_sensor(), Matrix3::identity());
        assert_eq!(Orientation::default(), Orientation::IDENTITY_ROTATION);
    }
}
