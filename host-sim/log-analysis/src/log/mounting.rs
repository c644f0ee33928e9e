//! Orientation of a sensor in the parameters of its autopilot.
//!
//! | autopilot | custom rotation | selected by |
//! |---|---|---|
//! | ArduPilot 4.0.4 to 4.2 | `COMPASS_CUS_ROLL`, `_PIT`, `_YAW`, one for all compasses | `COMPASS_ORIENTn` 100 |
//! | ArduPilot since 4.3 | `CUST_ROT1_ROLL`, `_PITCH`, `_YAW`, and `CUST_ROT2_`, for sensors and board | `COMPASS_ORIENTn` 101, 102 |
//! | PX4 since 1.15 | `CAL_MAGn_ROLL`, `_PITCH`, `_YAW` | `CAL_MAGn_ROT` 100, or an angle other than zero |
//!
//! Angles are degrees: roll, then pitch, then yaw.

use nalgebra::{Matrix3, Rotation3};

use super::compass_slot::{ardupilot_index, external_parameter};
use super::parameters::ParameterHistory;

/// Parameters that hold a rotation by any angles.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CustomRotation {
    /// ArduPilot's `COMPASS_CUS_ROLL`.
    ArdupilotCompass,
    /// ArduPilot's `CUST_ROTn_ROLL`, 1 or 2.
    Ardupilot(u8),
    /// PX4's `CAL_MAGn_ROLL`.
    Px4(u8),
}

/// Orientation of a sensor, as its parameters express it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum SensorOrientation {
    /// A rotation with a number.
    Numbered(NumberedRotation),
    /// Roll, pitch and yaw, degrees.
    Custom(CustomRotation, [f64; 3]),
}

impl CustomRotation {
    /// ArduPilot's rotations of any sensor.
    pub const ARDUPILOT_ROTATIONS: [Self; 2] = [Self::Ardupilot(1), Self::Ardupilot(2)];

    /// Value of the orientation parameter that selects it.
    pub const fn orientation_number(self) -> u8 {
        match self {
            Self::ArdupilotCompass | Self::Px4(_) => 100,
            Self::Ardupilot(number) => 100 + number,
        }
    }

    /// Names of the parameters of roll, pitch and yaw.
    pub fn angle_parameters(self) -> [String; 3] {
        match self {
            Self::ArdupilotCompass => ["ROLL", "PIT", "YAW"].map(|angle| format!("COMPASS_CUS_{angle}")),
            Self::Ardupilot(number) => ["ROLL", "PITCH", "YAW"].map(|angle| format!("CUST_ROT{number}_{angle}")),
            Self::Px4(index) => ["ROLL", "PITCH", "YAW"].map(|angle| format!("CAL_MAG{index}_{angle}")),
        }
    }

    /// ArduPilot's custom rotation that an orientation parameter selects.
    fn of_ardupilot_number(orientation: f64) -> Option<Self> {
        let mut all = [Self::ArdupilotCompass].into_iter().chain(Self::ARDUPILOT_ROTATIONS);
        all.find(|rotation| i32::from(rotation.orientation_number()) == orientation.round() as i32)
    }

    /// Its angles in the parameters, degrees; zero if absent.
    fn angles_deg(self, parameters: &ParameterHistory, t_s: f64) -> [f64; 3] {
        self.angle_parameters().map(|name| parameters.value_at(t_s, &name).unwrap_or(0.0))
    }

    /// Whether an angle in the parameters is not zero.
    pub(crate) fn has_angles(self, parameters: &ParameterHistory, t_s: f64) -> bool {
        self.angles_deg(parameters, t_s).iter().any(|angle_deg| *angle_deg != 0.0)
    }
}

impl SensorOrientation {
    /// The custom rotation nearest to a matrix, with the digits of a parameter file: 0.01 deg.
    pub fn custom_nearest_to(rotation: CustomRotation, matrix: &Matrix3<f64>) -> Self {
        let (roll, pitch, yaw) = Rotation3::from_matrix_unchecked(*matrix).euler_angles();
        Self::Custom(rotation, [roll, pitch, yaw].map(|angle| (angle.to_degrees() * 100.0).round() / 100.0))
    }

    /// Rotation matrix from sensor to body axes.
    pub fn rotation_matrix(self) -> Matrix3<f64> {
        match self {
            Self::Numbered(rotation) => rotation.rotation_matrix(),
            Self::Custom(_, angles_deg) => matrix_of_angles_deg(angles_deg),
        }
    }

    /// Value of the orientation parameter.
    pub const fn number(self) -> u8 {
        match self {
            Self::Numbered(rotation) => rotation.rotation_number(),
            Self::Custom(rotation, _) => rotation.orientation_number(),
        }
    }
}

fn matrix_of_angles_deg(angles_deg: [f64; 3]) -> Matrix3<f64> {
    let [roll, pitch, yaw] = angles_deg.map(f64::to_radians);
    Rotation3::from_euler_angles(roll, pitch, yaw).into_inner()
}

/// Trim of the board by `SENS_BOARD_X_OFF`, `_Y_OFF` and `_Z_OFF`.
fn px4_board_trim(parameters: &ParameterHistory, t_s: f64) -> Matrix3<f64> {
    let names = ["X", "Y", "Z"].map(|axis| format!("SENS_BOARD_{axis}_OFF"));
    matrix_of_angles_deg(names.map(|name| parameters.value_at(t_s, &name).unwrap_or(0.0)))
}

/// Rotation after the orientation of an external PX4 compass: the trim of the board, in firmware with custom rotations
/// (`calibration::Magnetometer::set_rotation`).
pub(crate) fn px4_external_trim(parameters: &ParameterHistory, t_s: f64, index: u8) -> Matrix3<f64> {
    let has_angles = CustomRotation::Px4(index).angle_parameters().iter().any(|name| parameters.has_prefix(name));
    if has_angles { px4_board_trim(parameters, t_s) } else { Matrix3::identity() }
}

/// Rotation from sensor to body axes of a PX4 compass: `CAL_MAGn_ROT` or its custom angles, or, if negative, the
/// board's rotation with its trim.
pub(crate) fn px4_mounting(parameters: &ParameterHistory, t_s: f64, index: u8) -> Matrix3<f64> {
    let numbered = |number: f64| NumberedRotation::new(number).unwrap_or_default().rotation_matrix();
    let custom = CustomRotation::Px4(index);
    let rotation_number = parameters.value_at(t_s, &orientation_parameter(true, index));
    let Some(rotation_number) = rotation_number.filter(|number| *number >= 0.0) else {
        let board = parameters.value_at(t_s, "SENS_BOARD_ROT").map_or_else(Matrix3::identity, numbered);
        return px4_board_trim(parameters, t_s) * board;
    };
    let is_selected = rotation_number.round() as i32 == i32::from(custom.orientation_number());
    let orientation = if is_selected || custom.has_angles(parameters, t_s) {
        matrix_of_angles_deg(custom.angles_deg(parameters, t_s))
    } else {
        numbered(rotation_number)
    };
    px4_external_trim(parameters, t_s, index) * orientation
}

/// Name of the orientation parameter of a slot.
pub(crate) fn orientation_parameter(is_px4: bool, slot: u8) -> String {
    if is_px4 { format!("CAL_MAG{slot}_ROT") } else { format!("COMPASS_ORIENT{}", ardupilot_index(slot)) }
}

/// Rotation from sensor to body axes that PX4 or ArduPilot applied to the compass of a slot at a time; none for an
/// internal compass of ArduPilot, which turns with the board, or an unknown number.
pub(crate) fn logged_mounting(parameters: &ParameterHistory, is_px4: bool, t_s: f64, slot: u8) -> Option<Matrix3<f64>> {
    if is_px4 {
        return Some(px4_mounting(parameters, t_s, slot));
    }
    if parameters.value_at(t_s, &external_parameter(slot)) == Some(0.0) {
        return None;
    }
    let number = parameters.value_at(t_s, &orientation_parameter(is_px4, slot)).unwrap_or(0.0);
    match CustomRotation::of_ardupilot_number(number) {
        Some(custom) => Some(matrix_of_angles_deg(custom.angles_deg(parameters, t_s))),
        None => NumberedRotation::new(number).map(NumberedRotation::rotation_matrix),
    }
}

/// Parameters that orient the compass of a slot, and the board.
pub(super) fn mounting_parameters(parameters: &ParameterHistory, is_px4: bool, slot: Option<u8>) -> Vec<String> {
    let board = if is_px4 { "SENS_BOARD_ROT" } else { "AHRS_ORIENTATION" };
    let mut names = vec![board.to_owned()];
    let Some(slot) = slot else { return names };
    let orientation = orientation_parameter(is_px4, slot);
    let custom = if is_px4 {
        Some(CustomRotation::Px4(slot))
    } else {
        names.push(external_parameter(slot));
        parameters.last_value(&orientation).and_then(CustomRotation::of_ardupilot_number)
    };
    names.extend(custom.into_iter().flat_map(CustomRotation::angle_parameters));
    names.push(orientation);
    names
}

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
    pub fn new(rotation_number: f64) -> Option<Self> {
        let rounded = rotation_number.round();
        (0.0..ROTATION_ANGLES_DEG.len() as f64).contains(&rounded).then_some(Self(rounded as u8))
    }

    /// Number of the rotation.
    pub const fn rotation_number(self) -> u8 {
        self.0
    }

    /// Rotation matrix from sensor to body axes: roll, then pitch, then yaw.
    pub fn rotation_matrix(self) -> Matrix3<f64> {
        matrix_of_angles_deg(ROTATION_ANGLES_DEG[usize::from(self.0) % ROTATION_ANGLES_DEG.len()].map(f64::from))
    }

    /// The numbered rotation nearest to a matrix.
    pub fn nearest_to_matrix(matrix: &Matrix3<f64>) -> Self {
        // The trace falls with the angle between both, whose cosine is half of it less a half.
        let trace = |rotation: &Self| (rotation.rotation_matrix().transpose() * matrix).trace();
        let rotations = (0..ROTATION_ANGLES_DEG.len() as u8).map(Self);
        rotations.min_by(|a, b| trace(b).total_cmp(&trace(a))).unwrap_or_default()
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector3;

    use super::*;

    /// Whether it is PX4, parameters, and a field in sensor and in body axes.
    type Case = (bool, &'static [(&'static str, f64)], Vector3<f64>, Vector3<f64>);

    /// A field forward, right and down, by PX4's and ArduPilot's formula: `Rz(yaw) Ry(pitch) Rx(roll)`. In firmware with
    /// custom angles the trim of the board applies to external compasses, too.
    #[test]
    fn the_field_of_a_sensor_turns_as_in_the_autopilot() {
        let (sin, cos) = libm::sincos(30_f64.to_radians());
        let cases: [Case; 10] = [
            (true, &[("CAL_MAG0_ROT", 100.0), ("CAL_MAG0_YAW", 30.0)], Vector3::x(), Vector3::new(cos, sin, 0.0)),
            (true, &[("CAL_MAG0_ROT", 2.0), ("CAL_MAG0_YAW", 30.0)], Vector3::x(), Vector3::new(cos, sin, 0.0)),
            (true, &[("CAL_MAG0_ROT", 2.0), ("CAL_MAG0_YAW", 0.0)], Vector3::x(), Vector3::y()),
            // An inverted board: z up, y left.
            (
                true,
                &[("CAL_MAG0_ROT", -1.0), ("SENS_BOARD_ROT", 8.0), ("SENS_BOARD_Z_OFF", 30.0)],
                Vector3::y(),
                Vector3::new(sin, -cos, 0.0),
            ),
            (
                true,
                &[("CAL_MAG0_ROT", 0.0), ("SENS_BOARD_ROT", 8.0), ("SENS_BOARD_Z_OFF", 30.0)],
                Vector3::x(),
                Vector3::x(),
            ),
            (
                true,
                &[("CAL_MAG0_ROT", 0.0), ("CAL_MAG0_YAW", 0.0), ("SENS_BOARD_Z_OFF", 30.0)],
                Vector3::x(),
                Vector3::new(cos, sin, 0.0),
            ),
            (false, &[("COMPASS_ORIENT", 6.0)], Vector3::x(), -Vector3::y()),
            (
                false,
                &[("COMPASS_ORIENT", 100.0), ("COMPASS_CUS_ROLL", 30.0)],
                Vector3::y(),
                Vector3::new(0.0, cos, sin),
            ),
            (false, &[("COMPASS_ORIENT", 101.0), ("CUST_ROT1_YAW", 30.0)], Vector3::x(), Vector3::new(cos, sin, 0.0)),
            (
                false,
                &[
                    ("COMPASS_ORIENT", 102.0),
                    ("CUST_ROT1_YAW", 9.0),
                    ("CUST_ROT2_PITCH", 30.0),
                    ("CUST_ROT2_YAW", 90.0),
                ],
                Vector3::x(),
                Vector3::new(0.0, cos, -sin),
            ),
        ];
        for (is_px4, values, sensor, expected) in cases {
            let slot = u8::from(!is_px4);
            let body = logged_mounting(&ParameterHistory::of_values(values), is_px4, 0.0, slot).unwrap() * sensor;
            assert!((body - expected).norm() < 1e-12, "{values:?}: {body}");
        }
        for unknown in [[("COMPASS_EXTERNAL", 0.0)], [("COMPASS_ORIENT", 103.0)]] {
            assert_eq!(logged_mounting(&ParameterHistory::of_values(&unknown), false, 0.0, 1), None);
        }
    }

    /// The digits of a file are hundredths of a degree.
    #[test]
    fn a_custom_rotation_has_the_angles_of_its_matrix() {
        let angles_deg = [10.123, -20.456, 170.0];
        let orientation =
            SensorOrientation::custom_nearest_to(CustomRotation::Ardupilot(2), &matrix_of_angles_deg(angles_deg));
        assert_eq!(orientation, SensorOrientation::Custom(CustomRotation::Ardupilot(2), [10.12, -20.46, 170.0]));
        assert_eq!(orientation.number(), 102);
        assert!((orientation.rotation_matrix() - matrix_of_angles_deg(angles_deg)).norm() < 1e-3);
    }

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
            let nearest = NumberedRotation::nearest_to_matrix(&matrix);
            assert!(
                (nearest.rotation_matrix() - NumberedRotation(number).rotation_matrix()).norm() < 1e-9,
                "{number} {nearest:?}"
            );
        }
    }
}
