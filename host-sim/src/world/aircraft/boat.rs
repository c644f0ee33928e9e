//! On the water: waves roll and pitch it, it turns at its own rate and heels out of its turns.

use super::surface::{Surface, lying};
use super::{Command, Config, GRAVITY_M_S2, Motion, STEP_S, TrueState, Weather, forward_right};

/// Slope of the waves along the way they travel, standard deviation, degrees.
const SLOPE_DEG: f64 = 6.0;
/// Roll and pitch that a slope of the water makes: it rolls more than the water does, and is too long to follow it with
/// its nose.
const ROLL_PER_SLOPE: f64 = 1.3;
const PITCH_PER_SLOPE: f64 = 0.6;
/// Heel out of a turn, of the angle that its acceleration has with the vertical.
const HEEL: f64 = 0.5;
/// Lag of the turn rate behind the rudder, seconds.
const TURN_RATE_TIME_S: f64 = 1.0;

/// See the top of the file.
#[derive(Clone, Debug)]
pub(super) struct Boat {
    config: Config,
    water: Surface,
    heading_rad: f64,
    turn_rate_rad_s: f64,
}

impl Boat {
    pub fn new(config: Config, weather: Weather, seed: u64) -> Self {
        // Waves travel with the wind.
        let water = Surface::water(SLOPE_DEG, weather.wind_from_deg.to_radians() + std::f64::consts::PI, seed);
        Self { config, water, heading_rad: config.heading_deg.to_radians(), turn_rate_rad_s: 0.0 }
    }

    pub fn step(&mut self, command: Command, before: &TrueState) -> Motion {
        self.turn_rate_rad_s += (command.flat_turn_rate_rad_s() - self.turn_rate_rad_s) * STEP_S / TURN_RATE_TIME_S;
        self.heading_rad += self.turn_rate_rad_s * STEP_S;
        let time_s = before.time_us as f64 / 1e6;
        let [ahead, right] = forward_right(self.heading_rad, self.water.slope([before.north_m, before.east_m], time_s));
        let speed_m_s = self.config.speed_m_s;
        let turning_m_s2 = speed_m_s * self.turn_rate_rad_s;
        let [rolled_rad, pitch_rad] = lying([PITCH_PER_SLOPE * ahead, ROLL_PER_SLOPE * right]);
        let (sin, cos) = self.heading_rad.sin_cos();
        Motion {
            roll_rad: rolled_rad - HEEL * turning_m_s2 / GRAVITY_M_S2,
            pitch_rad,
            heading_rad: self.heading_rad,
            sideslip_rad: 0.0,
            north_m_s: speed_m_s * cos,
            east_m_s: speed_m_s * sin,
            // Water that is not level accelerates along its slope, and the boat with it.
            push_m_s2: turning_m_s2.abs() + GRAVITY_M_S2 * ahead.hypot(right),
            current: 1.0,
        }
    }
}
