//! A tiny autopilot: flies a plan of legs, or holds what it is told.

use std::collections::VecDeque;

use super::state::TrueState;

/// Bank per heading error on a straight leg, dimensionless: settles in some 5 s without overshoot.
const BANK_PER_HEADING: f64 = 1.0;
/// Largest bank to get back on a heading, degrees.
const MAX_CORRECTION_BANK_DEG: f64 = 25.0;
/// Bank of an aeroplane that is told a turn rate, degrees.
const RATE_BANK_DEG: f64 = 20.0;

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
    /// Turn at a constant rate: on the spot what hovers, under way what drives or floats. An aeroplane banks for it.
    Yaw {
        /// Turn rate in degrees per second; the side comes from the heading change.
        rate_deg_s: f64,
        /// Heading to turn through in degrees: positive to the right; 360 is a full circle.
        heading_change_deg: f64,
    },
    /// Stay on the spot at the heading it has; what cannot hover goes straight on.
    Hover {
        /// Duration in seconds.
        seconds: f64,
    },
    /// Tilt to a side at the heading it has, as long as the stick is pushed; what cannot hover goes straight on. The
    /// way is lost again in the next leg.
    Push {
        /// Which way, degrees from the nose, clockwise: 0 is ahead, 90 to the right.
        toward_deg: f64,
        /// Tilt in degrees.
        tilt_deg: f64,
        /// Duration in seconds.
        seconds: f64,
    },
}

/// In what manner it moves meanwhile. Only what hovers has the choice.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Manner {
    /// Under way.
    #[default]
    Onward,
    /// Over the spot where it is.
    OnTheSpot,
    /// Tilted to a side.
    Pushed {
        /// Which way from the nose, clockwise, radians.
        toward_rad: f64,
        /// Tilt in radians.
        tilt_rad: f64,
    },
}

/// What the aircraft is to do now.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Command {
    /// Bank in radians, right wing down positive.
    pub bank_rad: f64,
    /// Pitch in radians, nose up positive.
    pub pitch_rad: f64,
    /// Turn rate of what does not bank to turn, radians per second.
    pub turn_rate_rad_s: f64,
    /// Whether it goes on.
    pub manner: Manner,
}

impl Command {
    /// Turn rate of what cannot bank: as many degrees a second as an aeroplane would bank degrees, but for a rate that is
    /// told.
    pub(super) fn flat_turn_rate_rad_s(&self) -> f64 {
        if self.manner == Manner::Onward { self.bank_rad } else { self.turn_rate_rad_s }
    }
}

/// A leg under way.
#[derive(Clone, Copy, Debug)]
struct Active {
    leg: Leg,
    began_us: u64,
    began_heading_rad: f64,
}

/// Flies legs one after the other; without any, it holds the last [`command`](Self::command), at first straight and
/// level, or the spot, if it hovers.
#[derive(Clone, Debug, Default)]
pub struct Autopilot {
    plan: VecDeque<Leg>,
    active: Option<Active>,
    held: Command,
    rest: Manner,
}

impl Autopilot {
    /// Of an aircraft that hovers, or does not.
    #[must_use]
    pub fn new(hovers: bool) -> Self {
        let rest = if hovers { Manner::OnTheSpot } else { Manner::Onward };
        Self { held: Command { manner: rest, ..Command::default() }, rest, ..Self::default() }
    }

    /// Appends a leg to the plan. When the plan ends, the aircraft goes on wings level, or hovers.
    pub fn fly(&mut self, leg: Leg) {
        self.held = Command { manner: self.rest, ..Command::default() };
        self.plan.push_back(leg);
    }

    /// Drops the plan and holds a bank and a pitch.
    pub fn command(&mut self, bank_deg: f64, pitch_deg: f64) {
        self.plan.clear();
        self.active = None;
        let (bank_rad, pitch_rad) = (bank_deg.to_radians(), pitch_deg.to_radians());
        self.held = Command { bank_rad, pitch_rad, ..Command::default() };
    }

    /// Drops the plan and does what it does at the end of one: goes on wings level, or hovers.
    pub fn rest(&mut self) {
        self.plan.clear();
        self.active = None;
        self.held = Command { manner: self.rest, ..Command::default() };
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
            Leg::Straight { seconds, .. } | Leg::Hover { seconds } | Leg::Push { seconds, .. } => {
                (state.time_us - self.began_us) as f64 >= seconds * 1e6
            }
            Leg::Turn { heading_change_deg, .. } | Leg::Yaw { heading_change_deg, .. } => {
                let turned_deg = (state.heading_rad - self.began_heading_rad).to_degrees();
                turned_deg * heading_change_deg.signum() >= heading_change_deg.abs()
            }
        }
    }

    fn command(&self, state: &TrueState) -> Command {
        let banked = |bank_deg: f64| Command { bank_rad: bank_deg.to_radians(), ..Command::default() };
        match self.leg {
            Leg::Straight { heading_deg, .. } => {
                let error_deg = (heading_deg - state.heading_deg() + 180.0).rem_euclid(360.0) - 180.0;
                banked((BANK_PER_HEADING * error_deg).clamp(-MAX_CORRECTION_BANK_DEG, MAX_CORRECTION_BANK_DEG))
            }
            Leg::Turn { bank_deg, heading_change_deg } => banked(bank_deg.abs() * heading_change_deg.signum()),
            Leg::Yaw { rate_deg_s, heading_change_deg } => {
                let side = heading_change_deg.signum();
                let turn_rate_rad_s = rate_deg_s.abs().to_radians() * side;
                Command { turn_rate_rad_s, manner: Manner::OnTheSpot, ..banked(RATE_BANK_DEG * side) }
            }
            Leg::Hover { .. } => Command { manner: Manner::OnTheSpot, ..Command::default() },
            Leg::Push { toward_deg, tilt_deg, .. } => {
                let [toward_rad, tilt_rad] = [toward_deg, tilt_deg].map(f64::to_radians);
                Command { manner: Manner::Pushed { toward_rad, tilt_rad }, ..Command::default() }
            }
        }
    }
}
