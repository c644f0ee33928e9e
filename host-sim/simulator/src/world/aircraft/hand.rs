//! A board in the hand: turned about all axes, with the tremor and the sway of an arm.

use std::f64::consts::TAU;

use super::motion::STEP_S;
use crate::world::aircraft::config::VehicleConfig;
use crate::world::autopilot::{TranslationMode, VehicleCommand};
use crate::world::state::TrueState;

/// Time constant of a movement, seconds: 60 deg are turned with 150 deg/s.
const MOVEMENT_TIME_S: f64 = 0.4;

/// Sway of the arm: speed, m/s, of some 5 cm, and periods toward north and east, seconds.
const SWAY_M_S: f64 = 0.15;
const SWAY_PERIODS_S: [f64; 2] = [2.1, 1.7];

/// Amplitude of the unsteadiness of roll and pitch, degrees, and its periods, seconds.
const UNSTEADINESS_DEG: f64 = 1.5;
const UNSTEADINESS_PERIODS_S: [f64; 2] = [1.3, 0.9];

/// Steepest nose, degrees; beyond it the angles are ambiguous.
const MAX_PITCH_DEG: f64 = 65.0;

#[derive(Clone, Debug)]
pub(super) struct Hand {
    heading_rad: f64,
    turn_rate_rad_s: f64,
    /// Roll and pitch without unsteadiness, and their rates.
    tilt_rad: [f64; 2],
    tilt_rate_rad_s: [f64; 2],
}

impl Hand {
    pub fn new(config: VehicleConfig) -> Self {
        let heading_rad = config.heading_deg.to_radians();
        Self { heading_rad, turn_rate_rad_s: 0.0, tilt_rad: [0.0; 2], tilt_rate_rad_s: [0.0; 2] }
    }

    /// Follows turns and tilts; a tilt toward a side rolls the board, also upside down.
    pub fn next_motion(&mut self, command: VehicleCommand, previous_state: &TrueState) -> TrueState {
        self.turn_rate_rad_s += (command.flat_turn_rate_rad_s() - self.turn_rate_rad_s) * STEP_S / MOVEMENT_TIME_S;
        self.heading_rad += self.turn_rate_rad_s * STEP_S;
        let wanted_rad = match command.translation_mode {
            TranslationMode::HoldTilt { toward_rad, tilt_rad } => {
                let (sin, cos) = libm::sincos(toward_rad);
                let max_pitch_rad = MAX_PITCH_DEG.to_radians();
                [tilt_rad * sin, (-tilt_rad * cos).clamp(-max_pitch_rad, max_pitch_rad)]
            }
            TranslationMode::Forward | TranslationMode::HoldPosition => [0.0; 2],
        };
        // Critically damped, so that the rates are continuous.
        let frequency = 2.0 / MOVEMENT_TIME_S;
        for (axis, wanted_rad) in wanted_rad.into_iter().enumerate() {
            let acceleration = frequency * frequency * (wanted_rad - self.tilt_rad[axis])
                - 2.0 * frequency * self.tilt_rate_rad_s[axis];
            self.tilt_rate_rad_s[axis] += acceleration * STEP_S;
            self.tilt_rad[axis] += self.tilt_rate_rad_s[axis] * STEP_S;
        }
        let sine = |period_s: f64| libm::sin(TAU * previous_state.time_s() / period_s);
        let [roll_rad, pitch_rad] =
            [0, 1].map(|axis| self.tilt_rad[axis] + UNSTEADINESS_DEG.to_radians() * sine(UNSTEADINESS_PERIODS_S[axis]));
        let [north_m_s, east_m_s] = SWAY_PERIODS_S.map(|period_s| SWAY_M_S * sine(period_s));
        TrueState {
            roll_rad,
            pitch_rad,
            heading_rad: self.heading_rad,
            north_m_s,
            east_m_s,
            relative_current: 1.0,
            ..TrueState::default()
        }
    }
}
