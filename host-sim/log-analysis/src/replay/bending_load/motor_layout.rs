//! Roles of outputs, and places of motors in the airframe, by the autopilot's parameters.

use crate::log::{AutopilotKind, LoggedFlight};

/// Role of an output.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum OutputRole {
    /// Motor of this number.
    Motor(u8),
    /// Motor of an aeroplane, on this side.
    Throttle(&'static str),
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
        None if flight.is_copter && output <= 4 => OutputRole::Motor(output),
        None => OutputRole::Unknown,
    }
}

/// `SERVOn_FUNCTION` (`SRV_Channel::Function`).
const fn ardupilot_role(function: i32) -> OutputRole {
    match function {
        33..=40 => OutputRole::Motor((function - 32) as u8),
        82..=85 => OutputRole::Motor((function - 73) as u8),
        70 => OutputRole::Throttle(""),
        73 => OutputRole::Throttle("left "),
        74 => OutputRole::Throttle("right "),
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
        101..=112 => OutputRole::Motor((function - 100) as u8),
        201..=208 => OutputRole::Servo("servo"),
        _ => OutputRole::Unknown,
    }
}

/// Place of a motor numbered from 1, forward and right, of any scale.
pub(super) fn motor_place(flight: &LoggedFlight, motor: u8) -> Option<[f64; 2]> {
    let value = |name: &str| flight.parameters.last_value(name);
    let index = motor.checked_sub(1)?;
    if flight.autopilot == AutopilotKind::Px4 {
        let [forward, right] = ["PX", "PY"].map(|axis| value(&format!("CA_ROTOR{index}_{axis}")));
        return Some([forward?, right?]);
    }
    let prefixed = |name: &str| value(name).or_else(|| value(&format!("Q_{name}"))).map(|number| number.round() as i32);
    let angles_deg = motor_angles_deg(prefixed("FRAME_CLASS")?, prefixed("FRAME_TYPE")?);
    let (right, forward) = libm::sincos(angles_deg.get(usize::from(index))?.to_radians());
    Some([forward, right])
}

/// Directions of the motors from the nose, clockwise, by frame class and type (`AP_MotorsMatrix`); empty if unknown.
const fn motor_angles_deg(class: i32, frame_type: i32) -> &'static [f64] {
    match (class, frame_type) {
        (1, 0) => &[90.0, -90.0, 0.0, 180.0],
        (1, 1..=3) => &[45.0, -135.0, -45.0, 135.0],
        (1, 12 | 18) => &[135.0, 45.0, -135.0, -45.0],
        (1, 13) => &[45.0, -45.0, -135.0, 135.0],
        (1, 14) => &[45.0, 135.0, -135.0, -45.0],
        (2, 0) => &[0.0, 180.0, -120.0, 60.0, -60.0, 120.0],
        (2, 1) => &[90.0, -90.0, -30.0, 150.0, 30.0, -150.0],
        (3, 0) => &[0.0, 180.0, 45.0, 135.0, -45.0, -135.0, -90.0, 90.0],
        (3, 1) => &[22.5, -157.5, 67.5, 157.5, -22.5, -112.5, -67.5, 112.5],
        _ => &[],
    }
}

/// Side that all places are on, with a space after it; empty if none.
pub(super) fn common_side(places: &[Option<[f64; 2]>]) -> &'static str {
    /// A motor on an axis is on neither side, despite rounding.
    const MARGIN: f64 = 0.05;
    let all = |is_there: fn([f64; 2]) -> bool| places.iter().all(|place| place.is_some_and(is_there));
    if all(|[_, right]| right > MARGIN) {
        "right "
    } else if all(|[_, right]| right < -MARGIN) {
        "left "
    } else if all(|[forward, _]| forward > MARGIN) {
        "front "
    } else if all(|[forward, _]| forward < -MARGIN) {
        "rear "
    } else {
        ""
    }
}
