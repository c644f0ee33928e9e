//! Orientation of a compass in parameters: unchanged, numbered, or custom.
//!
//! An autopilot corrects `h = M (T m - b)`, with a rotation `T` of its orientation parameters and a symmetric matrix
//! `M`. A solution `W = R S` is expressed without loss by `T = R`.

use std::fmt;

use nalgebra::{Matrix3, Rotation3};

use super::parameter_format::ParameterFormat;
use crate::log::{
    AutopilotKind, CustomRotation, DeviceId, LogFormat, LoggedFlight, NumberedRotation, SensorOrientation,
    external_parameter, logged_mounting, orientation_parameter, px4_external_trim,
};

/// Orientation that a file gives a compass.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ExportedOrientation {
    /// Rotation of the field from the logged body axes to those of the body.
    pub rotation_from_logged: Matrix3<f64>,
    /// The new orientation; none if unchanged.
    pub parameters: Option<SensorOrientation>,
}

/// Kind of an orientation, the simplest first.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum OrientationKind {
    /// That of the log.
    Unchanged,
    /// A rotation with a number.
    Numbered,
    /// A rotation by any angles.
    Custom,
}

/// Orientation parameters of a compass that a file may change.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OrientationParameters {
    /// Rotation from sensor to body axes in the log.
    mounting: Matrix3<f64>,
    /// Rotation after that of the orientation parameters.
    trim: Matrix3<f64>,
    /// A free custom rotation.
    pub custom_rotation: Result<CustomRotation, FixedOrientation>,
}

/// Reason why a file gives no orientation, or none by any angles; displayed as a clause.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FixedOrientation {
    /// The log has no orientation parameters of the compass.
    NotLogged,
    /// The file is for another autopilot than the log's.
    OtherAutopilot,
    /// An internal compass turns with the board.
    Internal,
    /// The version of the firmware is unknown.
    UnknownFirmware,
    /// The firmware has no custom rotation.
    NoCustomRotation,
    /// The firmware does not rotate nodes of a bus by any angles.
    NodeOfBus,
    /// All custom rotations are in use.
    NoneFree,
    /// Neither a reference heading nor body rates confirm the angle about z.
    UnconfirmedAngle,
    /// Neither an inclination nor a heading distinguishes the rotation from a mirror image.
    UnconfirmedSense,
}

/// Rotation of a sensor against its orientation, which a file does not correct; displayed as a clause.
#[derive(Clone, Debug, PartialEq)]
pub struct TurnedSensor {
    /// Rotation of the field from the logged body axes to those of the body.
    pub rotation_from_logged: Matrix3<f64>,
    /// Reason for not correcting it.
    pub reason: FixedOrientation,
}

impl ExportedOrientation {
    /// The orientation of the log.
    pub fn unchanged() -> Self {
        Self { rotation_from_logged: Matrix3::identity(), parameters: None }
    }

    /// The custom rotation that it uses.
    pub const fn custom_rotation(&self) -> Option<CustomRotation> {
        match self.parameters {
            Some(SensorOrientation::Custom(rotation, _)) => Some(rotation),
            _ => None,
        }
    }

    /// The orientation of a kind that is nearest to a rotation from logged to body axes; none if it cannot be expressed.
    /// INAV's alignment is not in the log: it counts as right, if it is numbered.
    pub(super) fn nearest(
        kind: OrientationKind,
        rotation: &Matrix3<f64>,
        parameters: Result<OrientationParameters, FixedOrientation>,
        format: ParameterFormat,
    ) -> Option<Self> {
        match (kind, parameters) {
            (OrientationKind::Unchanged, _) => Some(Self::unchanged()),
            (OrientationKind::Numbered, _) if format == ParameterFormat::Inav => {
                let numbered = NumberedRotation::nearest_to_matrix(rotation);
                Some(Self { rotation_from_logged: numbered.rotation_matrix(), parameters: None })
            }
            (_, Err(_)) => None,
            (OrientationKind::Numbered, Ok(parameters)) => {
                let numbered = NumberedRotation::nearest_to_matrix(&parameters.orientation_matrix(rotation));
                Some(parameters.exported(SensorOrientation::Numbered(numbered)))
            }
            (OrientationKind::Custom, Ok(parameters)) => {
                let matrix = parameters.orientation_matrix(rotation);
                let custom = SensorOrientation::custom_nearest_to(parameters.custom_rotation.ok()?, &matrix);
                Some(parameters.exported(custom))
            }
        }
    }
}

impl OrientationParameters {
    /// Orientation parameters of a compass in a log. `used` are custom rotations that other compasses are given.
    pub fn from_log(
        flight: &LoggedFlight,
        compass_number: u8,
        format: ParameterFormat,
        used: &[CustomRotation],
    ) -> Result<Self, FixedOrientation> {
        let is_px4 = match (flight.autopilot, format) {
            (AutopilotKind::ArduPilot, ParameterFormat::ArduPilot) => false,
            (AutopilotKind::Px4, ParameterFormat::Px4) => true,
            (AutopilotKind::Inav | AutopilotKind::Unknown, _) => return Err(FixedOrientation::NotLogged),
            _ => return Err(FixedOrientation::OtherAutopilot),
        };
        let parameters = &flight.parameters;
        let slot = flight.slot(compass_number).map_err(|_| FixedOrientation::NotLogged)?;
        let number = parameters.last_value(&orientation_parameter(is_px4, slot)).ok_or(FixedOrientation::NotLogged)?;
        // PX4 marks internal compasses by a negative number.
        let external = if is_px4 { Some(number + 1.0) } else { parameters.last_value(&external_parameter(slot)) };
        if external.ok_or(FixedOrientation::NotLogged)? <= 0.0 {
            return Err(FixedOrientation::Internal);
        }
        let mounting = logged_mounting(parameters, is_px4, f64::INFINITY, slot).ok_or(FixedOrientation::NotLogged)?;
        let trim = if is_px4 { px4_external_trim(parameters, f64::INFINITY, slot) } else { Matrix3::identity() };
        let custom_rotation = if is_px4 {
            px4_custom_rotation(flight, slot)
        } else {
            ardupilot_custom_rotation(flight, compass_number, slot, used)
        };
        Ok(Self { mounting, trim, custom_rotation })
    }

    /// The matrix of the orientation parameters that turns the field by `rotation` from that of the log.
    fn orientation_matrix(&self, rotation: &Matrix3<f64>) -> Matrix3<f64> {
        self.trim.transpose() * rotation * self.mounting
    }

    fn exported(&self, orientation: SensorOrientation) -> ExportedOrientation {
        ExportedOrientation {
            rotation_from_logged: self.trim * orientation.rotation_matrix() * self.mounting.transpose(),
            parameters: Some(orientation),
        }
    }
}

/// ArduPilot's free custom rotation for a compass. The parameters of the log show what its firmware has; without them, its
/// version does.
fn ardupilot_custom_rotation(
    flight: &LoggedFlight,
    compass_number: u8,
    slot: u8,
    used: &[CustomRotation],
) -> Result<CustomRotation, FixedOrientation> {
    /// First versions with `CUST_ROT_ENABLE`, and with `COMPASS_CUS_ROLL`.
    const FIRST_VERSIONS: [(u32, u32); 2] = [(4, 3), (4, 1)];
    let parameters = &flight.parameters;
    let has_prefixes = ["CUST_ROT", "COMPASS_CUS_"].map(|prefix| parameters.has_prefix(prefix));
    // A telemetry link may lose parameters; DataFlash has all of them, of which every firmware has this one.
    let has_all = flight.log_format != LogFormat::TLog && parameters.has_prefix("AHRS_ORIENTATION");
    let [is_of_any_sensor, is_of_compass] = match flight.firmware_version() {
        _ if has_all || has_prefixes.contains(&true) => has_prefixes,
        Some(version) => FIRST_VERSIONS.map(|first| version >= first),
        None => return Err(FixedOrientation::UnknownFirmware),
    };
    let rotations: &[CustomRotation] = match (is_of_any_sensor, is_of_compass) {
        (true, _) => &CustomRotation::ARDUPILOT_ROTATIONS,
        // Until 4.2 drivers of nodes fail with a custom rotation (ArduPilot issue 20671).
        (false, true) if is_node(flight, compass_number) => return Err(FixedOrientation::NodeOfBus),
        (false, true) => &[CustomRotation::ArdupilotCompass],
        (false, false) => return Err(FixedOrientation::NoCustomRotation),
    };
    let orientation = orientation_parameter(false, slot);
    let is_used_elsewhere = |rotation: &CustomRotation| {
        let number = f64::from(rotation.orientation_number());
        parameters.names_with_value(number).any(|name| name.contains("ORIENT") && name != orientation)
    };
    let is_free = |rotation: &&CustomRotation| {
        let is_selected = parameters.last_value(&orientation) == Some(f64::from(rotation.orientation_number()));
        let has_angles = rotation.has_angles(parameters, f64::INFINITY);
        !used.contains(rotation) && !is_used_elsewhere(rotation) && (is_selected || !has_angles)
    };
    rotations.iter().find(is_free).copied().ok_or(FixedOrientation::NoneFree)
}

fn is_node(flight: &LoggedFlight, compass_number: u8) -> bool {
    let logged = flight.compass(compass_number);
    logged.and_then(|compass| compass.device_id).is_some_and(DeviceId::is_node)
}

/// PX4's custom rotation of an index, by the parameters of the log, or the version of its firmware.
fn px4_custom_rotation(flight: &LoggedFlight, index: u8) -> Result<CustomRotation, FixedOrientation> {
    /// First version with custom angles.
    const FIRST_VERSION: (u32, u32) = (1, 15);
    let rotation = CustomRotation::Px4(index);
    let has_angles = rotation.angle_parameters().iter().any(|name| flight.parameters.last_value(name).is_some());
    match flight.firmware_version() {
        _ if has_angles => Ok(rotation),
        Some(version) if version >= FIRST_VERSION => Ok(rotation),
        Some(_) => Err(FixedOrientation::NoCustomRotation),
        None => Err(FixedOrientation::UnknownFirmware),
    }
}

/// Roll, pitch and yaw of a rotation in words: `yaw 30 deg`.
pub fn rotation_words(rotation: &Matrix3<f64>) -> String {
    let (roll, pitch, yaw) = Rotation3::from_matrix_unchecked(*rotation).euler_angles();
    let angles =
        [("roll", roll), ("pitch", pitch), ("yaw", yaw)].map(|(name, angle)| (name, angle.to_degrees().round()));
    let words: Vec<String> =
        angles.iter().filter(|(_, deg)| *deg != 0.0).map(|(name, deg)| format!("{name} {deg:.0}")).collect();
    if words.is_empty() { "0 deg".to_owned() } else { format!("{} deg", words.join(", ")) }
}

impl fmt::Display for TurnedSensor {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { rotation_from_logged, reason } = self;
        let rotation = rotation_words(rotation_from_logged);
        write!(
            f,
            "the sensor seems to be turned by {rotation} against its orientation, which is not corrected, because {reason}"
        )
    }
}

impl fmt::Display for FixedOrientation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::NotLogged => "the log does not have its orientation parameters",
            Self::OtherAutopilot => "the file is for another autopilot than the log's",
            Self::Internal => "an internal compass turns with its board, and has no orientation of its own",
            Self::UnknownFirmware => "the log does not name the version of the firmware, by which custom rotations differ",
            Self::NoCustomRotation => "its firmware has no custom rotation",
            Self::NodeOfBus => "firmware before 4.3 does not turn compasses of a CAN bus by any angle",
            Self::NoneFree => "the custom rotations of the firmware are in use",
            Self::UnconfirmedAngle => {
                "the angle about the vertical is confirmed by neither a reference heading of true north nor body rates of \
                 rolls and pitches"
            }
            Self::UnconfirmedSense => {
                "neither an inclination by the field model nor a heading from true north tells it from a mirrored axis"
            }
        })
    }
}
