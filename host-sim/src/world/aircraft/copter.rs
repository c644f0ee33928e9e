//! A multirotor: hovers over a spot, turns flat either way, tilts to move and to stop, leans into the wind.
//!
//! Its thrust carries its weight, so that its tilt is its acceleration: with pitch `theta` and roll `phi`,
//! `-g tan(theta)` along the nose and `g tan(phi) / cos(theta)` to the right, less the drag.

use super::{Air, Command, Config, GRAVITY_M_S2, Motion, STEP_S, TrueState, Weather, forward_right, north_east};
use crate::world::autopilot::Manner;

/// Time in which an error of tilt is worked off, seconds.
const TILT_TIME_S: f64 = 0.25;
/// Lag of the tilt's rate behind the rotors, seconds.
const TILT_RATE_TIME_S: f64 = 0.1;
/// Fastest change of tilt, radians per second: 90 degrees.
const MAX_TILT_RATE_RAD_S: f64 = std::f64::consts::FRAC_PI_2;
/// Lag of the turn rate, seconds.
const TURN_RATE_TIME_S: f64 = 0.3;
/// Time in which drag takes an airspeed away, seconds: at 15 degrees of tilt it flies 13 m/s.
const DRAG_TIME_S: f64 = 5.0;
/// Acceleration that takes away a velocity and an offset from the spot, per second and per second squared.
const PER_VELOCITY_S: f64 = 1.0;
const PER_OFFSET_S2: f64 = 0.3;
/// It holds the spot where it comes to rest, metres per second.
const AT_REST_M_S: f64 = 1.0;
/// Limits of what it does and what is done to it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Limits {
    /// Most tilt that it uses by itself, degrees: to brake, to hold the spot, to keep its speed.
    pub own_tilt_deg: f64,
    /// Most drag, m/s^2.
    pub drag_m_s2: f64,
}

impl Limits {
    /// A multirotor's: its drag is its rotors', which grows on.
    pub const MULTIROTOR: Self = Self { own_tilt_deg: 15.0, drag_m_s2: f64::INFINITY };
}
/// More thrust against air from above, per metre per second.
const THRUST_PER_GUST_S_M: f64 = 0.1;

/// An angle that follows what is wanted.
#[derive(Clone, Copy, Debug, Default)]
struct Tilt {
    rad: f64,
    rate_rad_s: f64,
}

impl Tilt {
    fn step(&mut self, wanted_rad: f64) {
        let wanted_rate = ((wanted_rad - self.rad) / TILT_TIME_S).clamp(-MAX_TILT_RATE_RAD_S, MAX_TILT_RATE_RAD_S);
        self.rate_rad_s += (wanted_rate - self.rate_rad_s) * STEP_S / TILT_RATE_TIME_S;
        self.rad += self.rate_rad_s * STEP_S;
    }
}

/// See the top of the file.
#[derive(Clone, Debug)]
pub(super) struct Copter {
    config: Config,
    limits: Limits,
    weather: Weather,
    air: Air,
    roll: Tilt,
    pitch: Tilt,
    heading_rad: f64,
    turn_rate_rad_s: f64,
    /// Over ground, north and east, metres per second.
    velocity_m_s: [f64; 2],
    /// The spot that is held, north and east, metres.
    spot_m: [f64; 2],
}

impl Copter {
    pub fn new(config: Config, limits: Limits, weather: Weather, seed: u64) -> Self {
        Self {
            config,
            limits,
            weather,
            air: Air::new(weather, seed),
            roll: Tilt::default(),
            pitch: Tilt::default(),
            heading_rad: config.heading_deg.to_radians(),
            turn_rate_rad_s: 0.0,
            velocity_m_s: [0.0; 2],
            spot_m: [0.0; 2],
        }
    }

    /// Flies on from there.
    pub fn take_over(&mut self, state: &TrueState) {
        (self.roll, self.pitch) = (Tilt::default(), Tilt::default());
        (self.heading_rad, self.turn_rate_rad_s) = (state.heading_rad, 0.0);
        self.velocity_m_s = [state.north_m_s, state.east_m_s];
    }

    pub fn step(&mut self, command: Command, before: &TrueState) -> Motion {
        let (wanted_m_s2, turn_rate_rad_s) = self.wanted(command, before);
        self.turn_rate_rad_s += (turn_rate_rad_s - self.turn_rate_rad_s) * STEP_S / TURN_RATE_TIME_S;
        self.heading_rad += self.turn_rate_rad_s * STEP_S;
        self.pitch.step((-wanted_m_s2[0] / GRAVITY_M_S2).atan());
        self.roll.step((wanted_m_s2[1] * self.pitch.rad.cos() / GRAVITY_M_S2).atan());

        let stirred = self.air.step();
        let (roll_rad, pitch_rad) = (self.roll.rad + stirred.bank_rad, self.pitch.rad + stirred.pitch_rad);
        let thrust_m_s2 = [-pitch_rad.tan(), roll_rad.tan() / pitch_rad.cos()].map(|part| GRAVITY_M_S2 * part);
        let pulled = north_east(self.heading_rad, thrust_m_s2);
        let gust = north_east(self.heading_rad, [stirred.along_m_s, stirred.across_m_s]);
        let (wind_north, wind_east) = self.weather.wind_velocity_m_s();
        let air_m_s = [wind_north + gust[0], wind_east + gust[1]];
        let drag_m_s2 = std::array::from_fn(|i| (self.velocity_m_s[i] - air_m_s[i]) / DRAG_TIME_S);
        let drag_m_s2 = limited(drag_m_s2, self.limits.drag_m_s2);
        let acceleration: [f64; 2] = std::array::from_fn(|i| pulled[i] - drag_m_s2[i]);
        for (velocity, acceleration) in self.velocity_m_s.iter_mut().zip(acceleration) {
            *velocity += acceleration * STEP_S;
        }
        let weight = (roll_rad.cos() * pitch_rad.cos()).recip();
        let thrust = (weight - THRUST_PER_GUST_S_M * stirred.vertical_m_s).max(0.0);
        Motion {
            roll_rad,
            pitch_rad,
            heading_rad: self.heading_rad,
            sideslip_rad: 0.0,
            north_m_s: self.velocity_m_s[0],
            east_m_s: self.velocity_m_s[1],
            push_m_s2: acceleration[0].hypot(acceleration[1]),
            // Power of a rotor goes with its thrust to the power of 3/2 (momentum theory).
            current: thrust.powf(1.5),
        }
    }

    /// The acceleration that is wanted along the nose and to the right, and the turn rate.
    fn wanted(&mut self, command: Command, before: &TrueState) -> ([f64; 2], f64) {
        let position_m = [before.north_m, before.east_m];
        let is_at_rest = self.velocity_m_s[0].hypot(self.velocity_m_s[1]) < AT_REST_M_S;
        if !(matches!(command.manner, Manner::OnTheSpot) && is_at_rest) {
            self.spot_m = position_m;
        }
        let own_limit_m_s2 = GRAVITY_M_S2 * self.limits.own_tilt_deg.to_radians().tan();
        match command.manner {
            Manner::OnTheSpot => {
                let back = std::array::from_fn(|i| {
                    PER_OFFSET_S2 * (self.spot_m[i] - position_m[i]) - PER_VELOCITY_S * self.velocity_m_s[i]
                });
                (limited(forward_right(self.heading_rad, back), own_limit_m_s2), command.turn_rate_rad_s)
            }
            Manner::Pushed { toward_rad, tilt_rad } => {
                let (sin, cos) = toward_rad.sin_cos();
                let size_m_s2 = GRAVITY_M_S2 * tilt_rad.tan();
                ([size_m_s2 * cos, size_m_s2 * sin], command.turn_rate_rad_s)
            }
            Manner::Onward => {
                let [forward, right] = forward_right(self.heading_rad, self.velocity_m_s);
                let errors = [self.config.speed_m_s - forward, -right].map(|error| PER_VELOCITY_S * error);
                let [ahead, across] = limited(errors, own_limit_m_s2);
                let turning_m_s2 = GRAVITY_M_S2 * command.bank_rad.tan();
                ([ahead, across + turning_m_s2], turning_m_s2 / self.config.speed_m_s)
            }
        }
    }
}

/// The vector, no longer than that.
fn limited(vector: [f64; 2], most: f64) -> [f64; 2] {
    let share = (most / vector[0].hypot(vector[1])).min(1.0);
    vector.map(|part| part * share)
}
