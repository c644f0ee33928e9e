//! Vehicle models that carry the compass: aeroplane, multirotor, VTOL, rover, boat, hand.

mod config;
mod copter;
mod external_attitude;
mod hand;
mod motion;
mod plane;
mod surface_vehicles;
mod vtol;

use std::f64::consts::{PI, TAU};

pub use self::config::{VehicleConfig, VehicleKind};
pub use self::motion::STEP_US;

use self::copter::{Copter, CopterLimits};
use self::external_attitude::AttitudeInterpolation;
use self::hand::Hand;
use self::motion::STEP_S;
use self::plane::Plane;
use self::vtol::Vtol;
use super::autopilot::{Autopilot, VehicleCommand};
use super::rotation::Euler;
use super::state::TrueState;
use super::weather::Weather;
use surface_vehicles::{Boat, Rover};

#[derive(Clone, Debug)]
enum Vehicle {
    Plane(Plane),
    Copter(Copter),
    Vtol(Box<Vtol>),
    Rover(Rover),
    Boat(Boat),
    Hand(Hand),
}

impl Vehicle {
    fn new(config: VehicleConfig, weather: Weather, seed: u64) -> Self {
        match config.kind {
            VehicleKind::Plane => Self::Plane(Plane::new(config, weather, seed)),
            VehicleKind::Copter => Self::Copter(Copter::new(config, CopterLimits::MULTIROTOR, weather, seed)),
            VehicleKind::Vtol => Self::Vtol(Box::new(Vtol::new(config, weather, seed))),
            VehicleKind::Rover => Self::Rover(Rover::new(config, seed)),
            VehicleKind::Boat => Self::Boat(Boat::new(config, weather, seed)),
            VehicleKind::Hand => Self::Hand(Hand::new(config)),
        }
    }

    /// State after the next step, without its time, rates and place.
    fn next_motion(&mut self, command: VehicleCommand, previous_state: &TrueState) -> TrueState {
        match self {
            Self::Plane(plane) => plane.next_motion(command),
            Self::Copter(copter) => copter.next_motion(command, previous_state),
            Self::Vtol(vtol) => vtol.next_motion(command, previous_state),
            Self::Rover(rover) => rover.next_motion(command, previous_state),
            Self::Boat(boat) => boat.next_motion(command, previous_state),
            Self::Hand(hand) => hand.next_motion(command, previous_state),
        }
    }
}

/// Prescribed motion of a carried vehicle: turned on level ground, held at a heading, tumbled on a bench.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PrescribedMotion {
    /// Initial roll, degrees.
    pub roll_deg: f64,
    /// Constant pitch, degrees.
    pub pitch_deg: f64,
    /// Initial magnetic heading, degrees.
    pub heading_deg: f64,
    /// Roll rate, degrees per second.
    pub roll_rate_deg_s: f64,
    /// Heading rate, degrees per second.
    pub heading_rate_deg_s: f64,
}

#[derive(Clone, Debug)]
enum MotionSource {
    /// The vehicle model and its autopilot.
    VehicleModel,
    /// A prescribed motion, with its start time in microseconds.
    Prescribed(PrescribedMotion, u64),
    /// Attitudes from an external simulator.
    External(AttitudeInterpolation),
}

/// Vehicle and its autopilot.
#[derive(Clone, Debug)]
pub struct Aircraft {
    vehicle: Vehicle,
    autopilot: Autopilot,
    motion_source: MotionSource,
    state: TrueState,
}

impl Aircraft {
    /// A vehicle at the origin, hovering if it can, otherwise moving straight ahead.
    #[must_use]
    pub fn new(config: VehicleConfig, weather: Weather, seed: u64, start_us: u64) -> Self {
        let heading_rad = config.heading_deg.to_radians();
        let mut aircraft = Self {
            vehicle: Vehicle::new(config, weather, seed),
            autopilot: Autopilot::new(config.kind.can_hover()),
            motion_source: MotionSource::VehicleModel,
            state: TrueState { time_us: start_us, heading_rad, ..TrueState::default() },
        };
        // The first step computes an attitude from which rates can be differentiated. A rover or boat starts at the
        // tilt of its surface, so it needs a second step for correct rates.
        aircraft.advance_step();
        if !config.kind.can_fly() {
            aircraft.advance_step();
        }
        aircraft.state = TrueState { time_us: start_us, north_m: 0.0, east_m: 0.0, ..aircraft.state };
        aircraft
    }

    /// True state after the last step.
    #[must_use]
    pub fn true_state(&self) -> &TrueState {
        &self.state
    }

    /// Autopilot that flies the legs.
    #[must_use]
    pub fn autopilot(&self) -> &Autopilot {
        &self.autopilot
    }

    /// The autopilot, to give commands.
    pub fn autopilot_mut(&mut self) -> &mut Autopilot {
        &mut self.autopilot
    }

    /// Replaces the vehicle model by a prescribed motion.
    pub fn set_prescribed_motion(&mut self, prescribed_motion: PrescribedMotion) {
        self.motion_source = MotionSource::Prescribed(prescribed_motion, self.state.time_us);
    }

    /// Returns control to the vehicle model, which continues from its own last state.
    pub fn end_prescribed_motion(&mut self) {
        self.motion_source = MotionSource::VehicleModel;
    }

    /// Moves toward an attitude received now from an external simulator.
    pub fn follow_attitude(&mut self, received: Euler) {
        let before = if let MotionSource::External(followed) = &self.motion_source { Some(followed) } else { None };
        self.motion_source = MotionSource::External(AttitudeInterpolation::new(before, &self.state, received));
    }

    /// Advances by one integration step.
    pub fn advance_step(&mut self) {
        match &self.motion_source {
            MotionSource::VehicleModel => self.advance_vehicle_model(),
            MotionSource::Prescribed(prescribed_motion, since_us) => {
                self.state = self.state_in_prescribed_motion(*prescribed_motion, *since_us);
            }
            MotionSource::External(followed) => self.state = followed.next_state(&self.state),
        }
    }

    fn advance_vehicle_model(&mut self) {
        let command = self.autopilot.next_command(&self.state);
        let before = &self.state;
        let motion = self.vehicle.next_motion(command, before);
        self.state = TrueState {
            time_us: before.time_us + STEP_US,
            roll_rate_rad_s: (motion.roll_rad - before.roll_rad) / STEP_S,
            pitch_rate_rad_s: (motion.pitch_rad - before.pitch_rad) / STEP_S,
            heading_rate_rad_s: (motion.heading_rad - before.heading_rad) / STEP_S,
            north_m: before.north_m + motion.north_m_s * STEP_S,
            east_m: before.east_m + motion.east_m_s * STEP_S,
            ..motion
        };
    }

    fn state_in_prescribed_motion(&self, prescribed_motion: PrescribedMotion, since_us: u64) -> TrueState {
        let time_us = self.state.time_us + STEP_US;
        let seconds = (time_us - since_us) as f64 / 1e6;
        let [roll_rate_rad_s, heading_rate_rad_s] =
            [prescribed_motion.roll_rate_deg_s, prescribed_motion.heading_rate_deg_s].map(f64::to_radians);
        let roll_rad = prescribed_motion.roll_deg.to_radians() + roll_rate_rad_s * seconds;
        TrueState {
            time_us,
            roll_rad: (roll_rad + PI).rem_euclid(TAU) - PI,
            pitch_rad: prescribed_motion.pitch_deg.to_radians(),
            heading_rad: prescribed_motion.heading_deg.to_radians() + heading_rate_rad_s * seconds,
            roll_rate_rad_s,
            heading_rate_rad_s,
            north_m: self.state.north_m,
            east_m: self.state.east_m,
            ..TrueState::default()
        }
    }
}

#[cfg(test)]
mod tests;
