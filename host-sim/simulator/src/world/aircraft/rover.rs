//! Rover on rough ground: turns at a commanded rate; the ground slope sets roll and pitch.

use super::rough_surface::{Surface, roll_pitch_on_slope};
use crate::world::aircraft::config::VehicleConfig;
use crate::world::aircraft::motion::{STEP_S, forward_right};
use crate::world::autopilot::VehicleCommand;
use crate::world::state::TrueState;

/// Ground slope along any direction, standard deviation, degrees.
const GROUND_SLOPE_SIGMA_DEG: f64 = 6.0;
/// Time constant of the turn rate, seconds.
const TURN_RATE_TIME_CONSTANT_S: f64 = 0.3;
/// Relative increase of motor current per unit of uphill slope.
const CURRENT_PER_SLOPE: f64 = 5.0;

#[derive(Clone, Debug)]
pub(super) struct Rover {
    config: VehicleConfig,
    ground: Surface,
    heading_rad: f64,
    turn_rate_rad_s: f64,
}

impl Rover {
    pub fn new(config: VehicleConfig, seed: u64) -> Self {
        let ground = Surface::rough_ground(GROUND_SLOPE_SIGMA_DEG, seed);
        Self { config, ground, heading_rad: config.heading_deg.to_radians(), turn_rate_rad_s: 0.0 }
    }

    pub fn next_motion(&mut self, command: VehicleCommand, previous_state: &TrueState) -> TrueState {
        self.turn_rate_rad_s +=
            (command.flat_turn_rate_rad_s() - self.turn_rate_rad_s) * STEP_S / TURN_RATE_TIME_CONSTANT_S;
        self.heading_rad += self.turn_rate_rad_s * STEP_S;
        let slope = forward_right(
            self.heading_rad,
            self.ground.surface_slope([previous_state.north_m, previous_state.east_m], 0.0),
        );
        let [roll_rad, pitch_rad] = roll_pitch_on_slope(slope);
        let (sin, cos) = libm::sincos(self.heading_rad);
        let speed_m_s = self.config.speed_m_s;
        TrueState {
            roll_rad,
            pitch_rad,
            heading_rad: self.heading_rad,
            north_m_s: speed_m_s * cos,
            east_m_s: speed_m_s * sin,
            disturbing_acceleration_m_s2: (speed_m_s * self.turn_rate_rad_s).abs(),
            relative_current: (1.0 + CURRENT_PER_SLOPE * slope[0]).max(0.0),
            ..TrueState::default()
        }
    }
}
