//! Roles of outputs by the autopilot's parameters.

use crate::log::{AutopilotKind, LoggedFlight};

/// Role of an output.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum OutputRole {
    /// Motor.
    Motor,
    /// Servo with this name.
    Servo(&'static str),
    /// Unknown.
    Unknown,
}

/// Role of an output numbered from 1.
pub(super) fn output_role(flight: &LoggedFlight, output: u8) -> OutputRole {
    let function = |name: String| flight.parameters.last_value(&name).map(|function| function.round() as i32);
    let function = match flight.autopilot {
        AutopilotKind::Px4 => function(format!("PWM_MAIN_FUNC{output}")).map(px4_role),
        _ => function(format!("SERVO{output}_FUNCTION")).map(ardupilot_role),
    };
    match function {
        Some(role) => role,
        // Without parameters: the first four outputs of a copter are motors; further ones may be a gimbal's.
        None if flight.is_copter && output <= 4 => OutputRole::Motor,
        None => OutputRole::Unknown,
    }
}

/// `SERVOn_FUNCTION` (`SRV_Channel::Function`).
const fn ardupilot_role(function: i32) -> OutputRole {
    match function {
        33..=40 | 82..=85 | 70 | 73 | 74 => OutputRole::Motor,
        2 | 3 => OutputRole::Servo("flap"),
        4 => OutputRole::Servo("aileron"),
        19 => OutputRole::Servo("elevator"),
        21 => OutputRole::Servo("rudder"),
        26 => OutputRole::Servo("steering"),
        77 => OutputRole::Servo("left elevon"),
        78 => OutputRole::Servo("right elevon"),
        79 => OutputRole::Servo("left V-tail"),
        80 => OutputRole::Servo("right V-tail"),
        _ => OutputRole::Unknown,
    }
}

/// `PWM_MAIN_FUNCn` (`mixer_module/output_functions.yaml`).
const fn px4_role(function: i32) -> OutputRole {
    match function {
        101..=112 => OutputRole::Motor,
        201..=208 => OutputRole::Servo("servo"),
        _ => OutputRole::Unknown,
    }
}
