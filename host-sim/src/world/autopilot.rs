//! A tiny autopilot: flies a plan of legs, or holds what it is told.

use std::collections::VecDeque;

use super::state::TrueState;

/// Bank per heading error on a straight leg, dimensionless: settles in some 5 s without overshoot.
const BANK_PER_HEADING: f64 = 1.0;
/// Largest bank to get back on a heading, degrees.
const MAX_CORRECTION_BANK_DEG: f64 = 25.0;

/// A piece of a flight plan.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Leg {
    /// Turn to a magnetic heading the short way and hold it, wings level.
    Straight {
        /// Heading in degrees.
        heading_deg: f64,
        /// Duration in seconds, the turn to the heading included.
        seconds: f64,
    },
    /// Turn at a constant bank.
    Turn {
        /// Bank in degrees; the side comes from the heading change.
        bank_deg: f64,
        /// Heading to turn through in degrees: positive to the right; 360 is a full circle.
        heading_change_deg: f64,
    },
}

/// What the aircraft is to do now.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Command {
    /// Bank in radians, right wing down positive.
    pub bank_rad: f64,
    /// Pitch in radians, nose up positive.
    pub pitch_rad: f64,
}

/// A leg under way.
#[derive(Clone, Copy, Debug)]
struct Active {
    leg: Leg,
    began_us: u64,
    began_heading_rad: f64,
}

/// Flies legs one after the other; without any, it holds the last [`command`](Self::command), at first straight and
/// level.
#[derive(Clone, Debug, Default)]
pub struct Autopilot {
    plan: VecDeque<Leg>,
    active: Option<Active>,
    held: Command,
}

impl Autopilot {
    /// Appends a leg to the plan. When the plan ends, the aircraft goes on wings level.
    pub fn fly(&mut self, leg: Leg) {
        self.held = Command::default();
        self.plan.push_back(leg);
    }

    /// Drops the plan and holds a bank and a pitch.
    pub fn command(&mut self, bank_deg: f64, pitch_deg: f64) {
        self.plan.clear();
        self.active = None;
        self.held = Command { bank_rad: bank_deg.to_radians(), pitch_rad: pitch_deg.to_radians() };
    }

    /// Legs not finished, the one under way included.
    #[must_use]
    pub fn legs_left(&self) -> usize {
        self.plan.len() + usize::from(self.active.is_some())
    }

    pub(super) fn step(&mut self, state: &TrueState) -> Command {
        if self.active.is_some_and(|active| active.is_done(state)) {
            self.active = None;
        }
        if self.active.is_none() {
            self.active = self.plan.pop_front().map(|leg| Active {
                leg,
                began_us: state.time_us,
                began_heading_rad: state.heading_rad,
            });
        }
        self.active.map_or(self.held, |active| active.command(state))
    }
}

impl Active {
    fn is_done(&self, state: &TrueState) -> bool {
        match self.leg {
            Leg::Straight { seconds, .. } => (state.time_us - self.began_us) as f64 >= seconds * 1e6,
            Leg::Turn { heading_change_deg, .. } => {
                let turned_deg = (state.heading_rad - self.began_heading_rad).to_degrees();
                turned_deg * heading_change_deg.signum() >= heading_change_deg.abs()
            }
        }
    }

    fn command(&self, state: &TrueState) -> Command {
        let bank_deg = match self.leg {
            Leg::Straight { heading_deg, .. } => {
                let error_deg = (heading_deg - state.heading_deg() + 180.0).rem_euclid(360.0) - 180.0;
                (BANK_PER_HEADING * error_deg).clamp(-MAX_CORRECTION_BANK_DEG, MAX_CORRECTION_BANK_DEG)
            }
            Leg::Turn { bank_deg, heading_change_deg } => bank_deg.abs() * heading_change_deg.signum(),
        };
        Command { bank_rad: bank_deg.to_radians(), pitch_rad: 0.0 }
    }
}
