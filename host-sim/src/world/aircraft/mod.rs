//! An aircraft that turns like one: banks at a limited rate, turns by its bank, drifts with the wind, and is pushed
//! about by the air.

use std::f64::consts::{PI, TAU};

use serde::{Deserialize, Serialize};

use super::autopilot::{Autopilot, Command};
use super::gauss_markov::SecondOrder;
use super::state::TrueState;
use super::weather::Weather;
use crate::random::{Purpose, Random};

/// Integration step. Twenty times shorter than the fastest time constant.
pub const STEP_US: u64 = 5_000;
pub(super) const STEP_S: f64 = STEP_US as f64 / 1e6;

const GRAVITY_M_S2: f64 = 9.806_65;
/// Time in which a bank error is worked off, seconds.
const BANK_TIME_S: f64 = 0.5;
/// Lag of the roll rate behind the ailerons, seconds.
const ROLL_RATE_TIME_S: f64 = 0.1;
/// Lag of the pitch, seconds.
const PITCH_TIME_S: f64 = 0.8;
/// Nose-up for the lift that a turn needs: degrees per unit of load factor above one. 1.2 degrees at a bank of 25.
const PITCH_PER_LOAD_DEG: f64 = 12.0;
/// Roll away from the side that the air comes from (dihedral), and pitch with it, degrees per degree.
const BANK_PER_SIDESLIP: f64 = -0.5;
const PITCH_PER_UPWASH: f64 = 0.3;
/// Correlation time of gusts, seconds: the length of turbulence near the ground over an airspeed of 20 m/s.
const GUST_TIME_S: f64 = 2.5;

/// How the aircraft flies.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Config {
    /// True airspeed, metres per second.
    pub airspeed_m_s: f64,
    /// Largest roll rate, degrees per second.
    pub max_roll_rate_deg_s: f64,
    /// Heading at the start, degrees.
    pub heading_deg: f64,
}

impl Default for Config {
    fn default() -> Self {
        Self { airspeed_m_s: 22.0, max_roll_rate_deg_s: 30.0, heading_deg: 0.0 }
    }
}

/// Attitude as flown, before the air moves it. Radians.
#[derive(Clone, Copy, Debug, Default)]
struct Flown {
    bank: f64,
    bank_rate: f64,
    pitch: f64,
}

/// The air's doing: four independent processes. Radians, metres per second.
#[derive(Clone, Debug)]
struct Disturbance {
    bank: SecondOrder,
    pitch: SecondOrder,
    gust_across_m_s: SecondOrder,
    gust_vertical_m_s: SecondOrder,
}

/// The aircraft carried instead of flown: turned on level ground, held at a heading, tumbled on a bench.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Carried {
    /// Roll at the beginning, degrees.
    pub roll_deg: f64,
    /// Pitch, degrees.
    pub pitch_deg: f64,
    /// Magnetic heading at the beginning, degrees.
    pub heading_deg: f64,
    /// Degrees a second.
    pub roll_rate_deg_s: f64,
    /// Degrees a second.
    pub heading_rate_deg_s: f64,
}

/// The aircraft and its autopilot.
#[derive(Clone, Debug)]
pub struct Aircraft {
    config: Config,
    weather: Weather,
    autopilot: Autopilot,
    /// How it is carried, and since when, microseconds; none if it flies.
    carried: Option<(Carried, u64)>,
    disturbance: Disturbance,
    flown: Flown,
    /// Direction of the motion through the air, radians, counting whole turns.
    air_course: f64,
    state: TrueState,
}

impl Aircraft {
    /// An aircraft in straight and level flight over the origin.
    #[must_use]
    pub fn new(config: Config, weather: Weather, seed: u64, start_us: u64) -> Self {
        let process = |sigma, time_s, purpose| SecondOrder::new(sigma, time_s, STEP_S, Random::new(seed, purpose));
        let wander = |sigma_deg: f64, purpose| process(sigma_deg.to_radians(), weather.wander_time_s, purpose);
        let heading_rad = config.heading_deg.to_radians();
        let mut aircraft = Self {
            config,
            weather,
            autopilot: Autopilot::default(),
            carried: None,
            disturbance: Disturbance {
                bank: wander(weather.bank_wander_deg, Purpose::Bank),
                pitch: wander(weather.pitch_wander_deg, Purpose::Pitch),
                gust_across_m_s: process(weather.gust_m_s, GUST_TIME_S, Purpose::GustAcross),
                gust_vertical_m_s: process(weather.gust_m_s, GUST_TIME_S, Purpose::GustVertical),
            },
            flown: Flown::default(),
            air_course: heading_rad,
            state: TrueState { time_us: start_us, heading_rad, ..TrueState::default() },
        };
        // The first step finds attitude and rates that belong together.
        aircraft.step();
        aircraft.state = TrueState { time_us: start_us, north_m: 0.0, east_m: 0.0, ..aircraft.state };
        aircraft
    }

    /// Where the aircraft is and how it lies.
    #[must_use]
    pub fn state(&self) -> &TrueState {
        &self.state
    }

    /// Who holds the stick.
    #[must_use]
    pub fn autopilot(&self) -> &Autopilot {
        &self.autopilot
    }

    /// The same, to give it orders.
    pub fn autopilot_mut(&mut self) -> &mut Autopilot {
        &mut self.autopilot
    }

    /// Carries it from now on.
    pub fn carry(&mut self, how: Carried) {
        self.carried = Some((how, self.state.time_us));
    }

    /// Flies on, or is carried on, by one step.
    pub fn step(&mut self) {
        if let Some((how, since_us)) = self.carried {
            self.state = self.carried_state(how, since_us);
            return;
        }
        let command = self.autopilot.step(&self.state);
        self.fly(command);
        let airspeed_m_s = self.config.airspeed_m_s;
        let gust_m_s = self.disturbance.gust_across_m_s.step();
        let sideslip_rad = gust_m_s / airspeed_m_s;
        let upwash_rad = self.disturbance.gust_vertical_m_s.step() / airspeed_m_s;
        let roll_rad = self.flown.bank + self.disturbance.bank.step() + BANK_PER_SIDESLIP * sideslip_rad;
        let pitch_rad = self.flown.pitch + self.disturbance.pitch.step() + PITCH_PER_UPWASH * upwash_rad;
        // Coordinated turn: the lift's horizontal part is what turns the motion through the air. The nose points
        // where the air comes from less the sideslip.
        self.air_course += GRAVITY_M_S2 * roll_rad.tan() / airspeed_m_s * STEP_S;
        let heading_rad = self.air_course - sideslip_rad;

        let (wind_north_m_s, wind_east_m_s) = self.weather.wind_velocity_m_s();
        let (sin_course, cos_course) = self.air_course.sin_cos();
        let north_m_s = airspeed_m_s * cos_course + wind_north_m_s;
        let east_m_s = airspeed_m_s * sin_course + wind_east_m_s;
        let before = &self.state;
        self.state = TrueState {
            time_us: before.time_us + STEP_US,
            roll_rad,
            pitch_rad,
            heading_rad,
            roll_rate_rad_s: (roll_rad - before.roll_rad) / STEP_S,
            pitch_rate_rad_s: (pitch_rad - before.pitch_rad) / STEP_S,
            heading_rate_rad_s: (heading_rad - before.heading_rad) / STEP_S,
            sideslip_rad,
            north_m: before.north_m + north_m_s * STEP_S,
            east_m: before.east_m + east_m_s * STEP_S,
            north_m_s,
            east_m_s,
        };
    }

    fn carried_state(&self, how: Carried, since_us: u64) -> TrueState {
        let time_us = self.state.time_us + STEP_US;
        let seconds = (time_us - since_us) as f64 / 1e6;
        let [roll_rate_rad_s, heading_rate_rad_s] = [how.roll_rate_deg_s, how.heading_rate_deg_s].map(f64::to_radians);
        let roll_rad = how.roll_deg.to_radians() + roll_rate_rad_s * seconds;
        TrueState {
            time_us,
            roll_rad: (roll_rad + PI).rem_euclid(TAU) - PI,
            pitch_rad: how.pitch_deg.to_radians(),
            heading_rad: how.heading_deg.to_radians() + heading_rate_rad_s * seconds,
            roll_rate_rad_s,
            heading_rate_rad_s,
            north_m: self.state.north_m,
            east_m: self.state.east_m,
            ..TrueState::default()
        }
    }

    /// Moves the flown attitude toward the command.
    fn fly(&mut self, command: Command) {
        let limit = self.config.max_roll_rate_deg_s.to_radians();
        let wanted_rate = ((command.bank_rad - self.flown.bank) / BANK_TIME_S).clamp(-limit, limit);
        self.flown.bank_rate += (wanted_rate - self.flown.bank_rate) * STEP_S / ROLL_RATE_TIME_S;
        self.flown.bank += self.flown.bank_rate * STEP_S;
        let load_factor = self.flown.bank.cos().recip();
        let wanted_pitch = command.pitch_rad + PITCH_PER_LOAD_DEG.to_radians() * (load_factor - 1.0);
        self.flown.pitch += (wanted_pitch - self.flown.pitch) * STEP_S / PITCH_TIME_S;
    }
}

#[cfg(test)]
mod tests;
