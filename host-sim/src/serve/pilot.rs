//! Who flies the aircraft: a pattern, over and over, until somebody orders something else.

use std::cell::RefCell;

use crate::accuracy::flight::wandering;
use crate::random::{Purpose, Random};
use crate::routine::{Plan, Routine};
use crate::world::aircraft::{Carried, Kind};
use crate::world::autopilot::Leg;
use crate::world::{World, WorldConfig};

use super::{Order, OrderError};

/// What is flown while nobody orders anything.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Pattern {
    /// What calibrates such a vehicle, half a minute straight, and again.
    #[default]
    Routine,
    /// Two circles to the right, two to the left.
    Circles,
    /// No plan at all.
    Wandering,
    /// Straight on, or on the spot.
    Level,
}

impl Pattern {
    /// All of them.
    pub const ALL: [Self; 4] = [Self::Routine, Self::Circles, Self::Wandering, Self::Level];

    /// The word for it.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Routine => "routine",
            Self::Circles => "circles",
            Self::Wandering => "wandering",
            Self::Level => "level",
        }
    }

    /// The pattern of this name.
    #[must_use]
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|pattern| pattern.name() == name)
    }

    /// What is flown of it next; nothing of one that has no legs.
    fn legs(self, kind: Kind, heading_deg: f64, random: &mut Random) -> Vec<Leg> {
        let straight = Leg::Straight { heading_deg, seconds: 30.0 };
        let circles = |change_deg| match kind {
            Kind::Plane | Kind::Vtol => Leg::Turn { bank_deg: CIRCLE_BANK_DEG, heading_change_deg: change_deg },
            Kind::Copter | Kind::Rover | Kind::Boat => {
                Leg::Yaw { rate_deg_s: CIRCLE_RATE_DEG_S, heading_change_deg: change_deg }
            }
        };
        match self {
            Self::Routine => {
                let mut legs = Routine::of(kind, Plan::default(), heading_deg).legs();
                legs.push(straight);
                legs
            }
            Self::Circles => vec![circles(720.0), circles(-720.0)],
            Self::Wandering => vec![wandering(kind, random)],
            Self::Level => Vec::new(),
        }
    }
}

/// As a pilot is asked to fly them: half a minute each.
const CIRCLE_BANK_DEG: f64 = 25.0;
/// Of what turns flat.
const CIRCLE_RATE_DEG_S: f64 = 18.0;

/// Levelling out takes so long.
const LANDING_S: f64 = 5.0;

/// What the pilot is about.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Task {
    /// Flies a pattern.
    Pattern(Pattern),
    /// Flies what was ordered.
    Orders,
    /// Levels out to land.
    Landing,
    /// Stands on the ground.
    Landed,
    /// Somebody else flies.
    Visited,
}

/// The pilot.
#[derive(Debug)]
pub(super) struct Pilot {
    kind: Kind,
    task: Task,
    random: RefCell<Random>,
}

impl Pilot {
    /// A pilot who flies a pattern, or has nothing to do because somebody else's simulator flies.
    pub fn new(world: &WorldConfig, pattern: Pattern, is_visited: bool) -> Self {
        let task = if is_visited { Task::Visited } else { Task::Pattern(pattern) };
        Self { kind: world.aircraft.kind, task, random: RefCell::new(Random::new(world.seed, Purpose::Legs)) }
    }

    /// Takes the aircraft over, in the air.
    pub fn begin(&self, world: &World) {
        world.set_armed(self.task != Task::Visited);
        self.fly_pattern(world);
    }

    /// Goes on with what it is about.
    pub fn look_up(&mut self, world: &World) {
        if world.legs_left() > 0 {
            return;
        }
        self.fly_pattern(world);
        if self.task == Task::Landing {
            let heading_deg = heading_deg(world);
            world.carry(Carried { heading_deg, ..Carried::default() });
            world.set_armed(false);
            self.task = Task::Landed;
        }
    }

    /// Carries an order out.
    pub fn obey(&mut self, world: &World, order: Order) -> Result<String, OrderError> {
        match (self.task, order) {
            (Task::Visited, _) => return Err(OrderError::Visited),
            (Task::Landed, Order::TakeOff) => {
                world.let_go();
                world.set_armed(true);
                self.take(world, Task::Orders);
            }
            (Task::Landed, Order::Land) => {}
            (Task::Landed, _) => return Err(OrderError::Landed),
            (_, Order::Turn { bank_deg, change_deg }) => {
                let heading_change_deg = change_deg * bank_deg.signum();
                self.fly(world, Leg::Turn { bank_deg: bank_deg.abs(), heading_change_deg });
            }
            (_, Order::Level { seconds }) => self.fly(world, Leg::Hover { seconds }),
            (_, Order::Heading { deg, seconds }) => self.fly(world, Leg::Straight { heading_deg: deg, seconds }),
            (_, Order::Pattern(pattern)) => {
                self.take(world, Task::Pattern(pattern));
                self.fly_pattern(world);
            }
            (_, Order::Land) => {
                self.take(world, Task::Landing);
                world.fly(Leg::Straight { heading_deg: heading_deg(world), seconds: LANDING_S });
            }
            (_, Order::TakeOff | Order::Status | Order::Help) => {}
        }
        Ok(format!("ok {}", self.doing()))
    }

    /// What it is about, in words.
    pub fn doing(&self) -> &'static str {
        match self.task {
            Task::Pattern(Pattern::Routine) => "flies the routine",
            Task::Pattern(Pattern::Circles) => "flies circles",
            Task::Pattern(Pattern::Wandering) => "wanders about",
            Task::Pattern(Pattern::Level) => "flies straight on",
            Task::Orders => "flies as ordered",
            Task::Landing => "lands",
            Task::Landed => "stands on the ground",
            Task::Visited => "flies as told",
        }
    }

    /// Flies a leg after those ordered before, instead of anything else.
    fn fly(&mut self, world: &World, leg: Leg) {
        if self.task != Task::Orders {
            self.take(world, Task::Orders);
        }
        world.fly(leg);
    }

    /// Drops what it was about.
    fn take(&mut self, world: &World, task: Task) {
        self.task = task;
        world.rest();
    }

    fn fly_pattern(&self, world: &World) {
        if let Task::Pattern(pattern) = self.task {
            let legs = pattern.legs(self.kind, heading_deg(world), &mut self.random.borrow_mut());
            for leg in legs {
                world.fly(leg);
            }
        }
    }
}

fn heading_deg(world: &World) -> f64 {
    world.true_state(crate::clock::now_us()).heading_deg()
}
