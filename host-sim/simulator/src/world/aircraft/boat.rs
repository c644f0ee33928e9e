//! Boat: waves roll and pitch it; it turns at a commanded rate and heels outward in turns.

use std::array;

use super::rough_surface::{Surface, roll_pitch_on_slope};
use crate::world::aircraft::config::VehicleConfig;
use crate::world::aircraft::motion::{GRAVITY_M_S2, STEP_S, forward_right};
use crate::world::autopilot::VehicleCommand;
use crate::world::state::TrueState;
use crate::world::weather::Weather;

/// Wave slope along the direction of travel, standard deviation, degrees.
const WAVE_SLOPE_SIGMA_DEG: f64 = 6.0;
/// Roll per slope of the water, which the hull amplifies.
const ROLL_PER_SLOPE: f64 = 1.3;
/// Pitch per slope of the water, which the length of the hull averages.
const PITCH_PER_SLOPE: f64 = 0.6;
/// Outward heel as a share of the angle `turn acceleration / g`.
const HEEL_PER_TURN_ANGLE: f64 = 0.5;
/// Time constant of the turn rate, seconds.
const TURN_RATE_TIME_CONSTANT_S: f64 = 1.0;
/// Time in which the hull takes on the motion of the water, seconds: near hull speed the resistance of 5 % of the weight grows
/// with the fourth power of the speed.
const DRAG_TIME_CONSTANT_S: f64 = 1.5;

#[derive(Clone, Debug)]
pub(super) struct Boat {
    config: VehicleConfig,
    water: Surface,
    heading_rad: f64,
    turn_rate_rad_s: f64,
    /// Velocity north and east by the waves.
    wave_velocity_m_s: [f64; 2],
}

impl Boat {
    pub fn new(config: VehicleConfig, weather: Weather, seed: u64) -> Self {
        let water =
            Surface::water_waves(WAVE_SLOPE_SIGMA_DEG, weather.wind_from_deg.to_radians() + std::f64::consts::PI, seed);
        Self {
            config,
            water,
            heading_rad: config.heading_deg.to_radians(),
            turn_rate_rad_s: 0.0,
            wave_velocity_m_s: [0.0; 2],
        }
    }

    pub fn next_motion(&mut self, command: VehicleCommand, previous_state: &TrueState) -> TrueState {
        self.turn_rate_rad_s +=
            (command.flat_turn_rate_rad_s() - self.turn_rate_rad_s) * STEP_S / TURN_RATE_TIME_CONSTANT_S;
        self.heading_rad += self.turn_rate_rad_s * STEP_S;
        let time_s = previous_state.time_us as f64 / 1e6;
        let place_m = [previous_state.north_m, previous_state.east_m];
        let slope = self.water.surface_slope(place_m, time_s);
        let water_m_s = self.water.orbital_velocity(place_m, time_s);
        let [ahead, right] = forward_right(self.heading_rad, slope);
        // Sloping water accelerates the boat by `g * slope`, its motion carries it along.
        self.wave_velocity_m_s = array::from_fn(|axis| {
            let velocity_m_s = self.wave_velocity_m_s[axis];
            let drag_m_s2 = (velocity_m_s - water_m_s[axis]) / DRAG_TIME_CONSTANT_S;
            velocity_m_s - (GRAVITY_M_S2 * slope[axis] + drag_m_s2) * STEP_S
        });
        let speed_m_s = self.config.speed_m_s;
        let centripetal_m_s2 = speed_m_s * self.turn_rate_rad_s;
        let [rolled_rad, pitch_rad] = roll_pitch_on_slope([PITCH_PER_SLOPE * ahead, ROLL_PER_SLOPE * right]);
        let (sin, cos) = libm::sincos(self.heading_rad);
        TrueState {
            roll_rad: rolled_rad - HEEL_PER_TURN_ANGLE * centripetal_m_s2 / GRAVITY_M_S2,
            pitch_rad,
            heading_rad: self.heading_rad,
            north_m_s: speed_m_s * cos + self.wave_velocity_m_s[0],
            east_m_s: speed_m_s * sin + self.wave_velocity_m_s[1],
            disturbing_acceleration_m_s2: centripetal_m_s2.abs() + GRAVITY_M_S2 * libm::hypot(ahead, right),
            relative_current: 1.0,
            ..TrueState::default()
        }
    }
}
