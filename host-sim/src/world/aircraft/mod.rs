//! Aircraft, and what else carries a compass: each moves as its kind does, pushed about by the air, the ground or the
//! water.
//!
//! | file | holds |
//! |---|---|
//! | `config.rs` | the kinds, and how they move |
//! | `air.rs` | what the air does to what flies |
//! | `plane.rs` | banks, and turns by its bank |
//! | `copter.rs` | hovers, turns flat, tilts to move |
//! | `vtol.rs` | the two in one |
//! | `surface.rs` | rough ground and waves |
//! | `rover.rs`, `boat.rs` | what lies as the surface below it does |
//! | `followed.rs` | as somebody else's simulator says |

mod air;
mod boat;
mod config;
mod copter;
mod followed;
mod plane;
mod rover;
mod surface;
mod vtol;

use std::f64::consts::{PI, TAU};

pub use self::config::{Config, Kind};

use self::air::Air;
use self::boat::Boat;
use self::copter::{Copter, Limits};
use self::followed::Followed;
use self::plane::Plane;
use self::rover::Rover;
use self::vtol::Vtol;
use super::autopilot::{Autopilot, Command};
use super::rotation::Euler;
use super::state::TrueState;
use super::weather::Weather;

/// Integration step. Twenty times shorter than the fastest time constant.
pub const STEP_US: u64 = 5_000;
pub(super) const STEP_S: f64 = STEP_US as f64 / 1e6;

const GRAVITY_M_S2: f64 = 9.806_65;

/// How a vehicle lies and moves after a step. Angles in radians, FRD body axes, Euler ZYX; heading counts whole turns.
#[derive(Clone, Copy, Debug, Default)]
struct Motion {
    roll_rad: f64,
    pitch_rad: f64,
    heading_rad: f64,
    sideslip_rad: f64,
    north_m_s: f64,
    east_m_s: f64,
    /// See [`TrueState::push_m_s2`].
    push_m_s2: f64,
    /// See [`TrueState::current`].
    current: f64,
}

/// What moves.
#[derive(Clone, Debug)]
enum Vehicle {
    Plane(Plane),
    Copter(Copter),
    Vtol(Box<Vtol>),
    Rover(Rover),
    Boat(Boat),
}

impl Vehicle {
    fn new(config: Config, weather: Weather, seed: u64) -> Self {
        match config.kind {
            Kind::Plane => Self::Plane(Plane::new(config, weather, seed)),
            Kind::Copter => Self::Copter(Copter::new(config, Limits::MULTIROTOR, weather, seed)),
            Kind::Vtol => Self::Vtol(Box::new(Vtol::new(config, weather, seed))),
            Kind::Rover => Self::Rover(Rover::new(config, seed)),
            Kind::Boat => Self::Boat(Boat::new(config, weather, seed)),
        }
    }

    fn step(&mut self, command: Command, before: &TrueState) -> Motion {
        match self {
            Self::Plane(plane) => plane.step(command),
            Self::Copter(copter) => copter.step(command, before),
            Self::Vtol(vtol) => vtol.step(command, before),
            Self::Rover(rover) => rover.step(command, before),
            Self::Boat(boat) => boat.step(command, before),
        }
    }
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

/// What moves it.
#[derive(Clone, Debug)]
enum Moved {
    /// It moves by itself.
    ByItself,
    /// It is carried, since so many microseconds.
    Carried(Carried, u64),
    /// It moves as somebody else says.
    Followed(Followed),
}

/// The aircraft and its autopilot.
#[derive(Clone, Debug)]
pub struct Aircraft {
    vehicle: Vehicle,
    autopilot: Autopilot,
    moved: Moved,
    state: TrueState,
}

impl Aircraft {
    /// An aircraft over the origin: in straight and level flight, hovering, under way.
    #[must_use]
    pub fn new(config: Config, weather: Weather, seed: u64, start_us: u64) -> Self {
        let heading_rad = config.heading_deg.to_radians();
        let mut aircraft = Self {
            vehicle: Vehicle::new(config, weather, seed),
            autopilot: Autopilot::new(config.kind.hovers()),
            moved: Moved::ByItself,
            state: TrueState { time_us: start_us, heading_rad, ..TrueState::default() },
        };
        // The first step finds attitude and rates that belong together. What lies on ground or water has its attitude from
        // there, not from level, and needs another for its rates.
        aircraft.step();
        if !config.kind.flies() {
            aircraft.step();
        }
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
        self.moved = Moved::Carried(how, self.state.time_us);
    }

    /// Lets it move by itself again, from where it was when that ended.
    pub fn let_go(&mut self) {
        self.moved = Moved::ByItself;
    }

    /// Brings it to an attitude that somebody else says it has now; see `followed.rs`.
    pub fn follow(&mut self, told: Euler) {
        let before = if let Moved::Followed(followed) = &self.moved { Some(followed) } else { None };
        self.moved = Moved::Followed(Followed::told(before, &self.state, told));
    }

    /// Moves on, or is moved on, by one step.
    pub fn step(&mut self) {
        match &self.moved {
            Moved::ByItself => self.fly_on(),
            Moved::Carried(how, since_us) => self.state = self.carried_state(*how, *since_us),
            Moved::Followed(followed) => self.state = followed.after_a_step(&self.state),
        }
    }

    fn fly_on(&mut self) {
        let command = self.autopilot.step(&self.state);
        let before = &self.state;
        let motion = self.vehicle.step(command, before);
        let Motion { roll_rad, pitch_rad, heading_rad, sideslip_rad, north_m_s, east_m_s, push_m_s2, current } = motion;
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
            push_m_s2,
            current,
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
}

/// Components north and east of a vector along the nose and to the right of it.
fn north_east(heading_rad: f64, [forward, right]: [f64; 2]) -> [f64; 2] {
    let (sin, cos) = heading_rad.sin_cos();
    [cos * forward - sin * right, sin * forward + cos * right]
}

/// Components along the nose and to the right of it of a vector north and east.
fn forward_right(heading_rad: f64, [north, east]: [f64; 2]) -> [f64; 2] {
    let (sin, cos) = heading_rad.sin_cos();
    [cos * north + sin * east, cos * east - sin * north]
}

#[cfg(test)]
mod tests;
