//! The autopilot's firmware and state, which determine its answers.

/// Firmware that the simulated autopilot imitates.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MspFirmware {
    /// ArduPilot, whose pitch is positive nose up.
    ArduPilot,
    /// INAV, whose pitch is positive nose down.
    Inav,
}

/// State of the autopilot at an instant.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct AutopilotState {
    /// Roll, radians, right wing down positive.
    pub roll_rad: f64,
    /// Pitch, radians, nose up positive.
    pub pitch_rad: f64,
    /// Reported heading, radians.
    pub yaw_rad: f64,
    /// Body rates p, q, r, radians per second.
    pub body_rates_rad_s: [f64; 3],
    /// Whether the autopilot is armed.
    pub is_armed: bool,
    /// Latitude and longitude in degrees, north and east positive, and height in metres; `None` without a fix.
    pub position: Option<(f64, f64, f64)>,
    /// Unix time in seconds, UTC; `None` if the clock is not set.
    pub unix_s: Option<u64>,
    /// Battery current, amperes; `None` if not measured.
    pub current_a: Option<f64>,
}
