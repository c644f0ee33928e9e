//! Simulated pilot: flies a pattern repeatedly until a command arrives.

use std::cell::RefCell;

use simulator::random::{RandomStream, StreamPurpose};
use simulator::world::aircraft::{PrescribedMotion, VehicleKind};
use simulator::world::autopilot::Leg;
use simulator::world::{World, WorldConfig};

use super::pilot_command::{PilotCommand, PilotCommandError, PilotPattern};

const LANDING_DURATION_S: f64 = 5.0;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum PilotTask {
    /// Flies a pattern.
    Pattern(PilotPattern),
    /// Executes commands.
    Commands,
    /// The pilot levels out in order to land.
    Landing,
    /// The vehicle is on the ground.
    Landed,
    /// An external simulator controls the aircraft.
    ExternallyControlled,
}

#[derive(Debug)]
pub(super) struct SimulatedPilot {
    vehicle_kind: VehicleKind,
    task: PilotTask,
    random: RefCell<RandomStream>,
}

impl SimulatedPilot {
    /// A pilot that flies a pattern, or is inactive because of an external simulator.
    pub fn new(world: &WorldConfig, pattern: PilotPattern, is_externally_controlled: bool) -> Self {
        let task = if is_externally_controlled { PilotTask::ExternallyControlled } else { PilotTask::Pattern(pattern) };
        Self {
            vehicle_kind: world.aircraft.kind,
            task,
            random: RefCell::new(RandomStream::new(world.seed, StreamPurpose::Legs)),
        }
    }

    /// Starts the pattern in flight, armed.
    pub fn start_pattern(&self, world: &World) {
        world.set_armed(self.task != PilotTask::ExternallyControlled);
        self.fly_pattern(world);
    }

    /// Continues with the next legs, or completes the landing.
    pub fn continue_flight(&mut self, world: &World) {
        if world.unfinished_leg_count() > 0 {
            return;
        }
        self.fly_pattern(world);
        if self.task == PilotTask::Landing {
            let heading_deg = heading_deg(world);
            world.set_prescribed_motion(PrescribedMotion { heading_deg, ..PrescribedMotion::default() });
            world.set_armed(false);
            self.task = PilotTask::Landed;
        }
    }

    /// Executes a command and returns the answer.
    pub fn execute_command(&mut self, world: &World, command: PilotCommand) -> Result<String, PilotCommandError> {
        match (self.task, command) {
            (PilotTask::ExternallyControlled, _) => return Err(PilotCommandError::ExternallyControlled),
            (PilotTask::Landed, PilotCommand::TakeOff) => {
                world.end_prescribed_motion();
                world.set_armed(true);
                self.start_task(world, PilotTask::Commands);
            }
            (PilotTask::Landed, PilotCommand::Land) => {}
            (PilotTask::Landed, _) => return Err(PilotCommandError::Landed),
            (_, PilotCommand::Turn { bank_deg, change_deg }) => {
                let heading_change_deg = change_deg * bank_deg.signum();
                self.append_commanded_leg(world, Leg::Turn { bank_deg: bank_deg.abs(), heading_change_deg });
            }
            (_, PilotCommand::Level { seconds }) => self.append_commanded_leg(world, Leg::Hover { seconds }),
            (_, PilotCommand::Heading { heading_deg, seconds }) => {
                self.append_commanded_leg(world, Leg::Straight { heading_deg, seconds });
            }
            (_, PilotCommand::Pattern(pattern)) => {
                self.start_task(world, PilotTask::Pattern(pattern));
                self.fly_pattern(world);
            }
            (_, PilotCommand::Land) => {
                self.start_task(world, PilotTask::Landing);
                world.append_leg(Leg::Straight { heading_deg: heading_deg(world), seconds: LANDING_DURATION_S });
            }
            (_, PilotCommand::TakeOff | PilotCommand::Status | PilotCommand::Help) => {}
        }
        Ok(format!("ok {}", self.activity_text()))
    }

    /// Description of the present activity.
    pub fn activity_text(&self) -> &'static str {
        match self.task {
            PilotTask::Pattern(PilotPattern::Routine) => "flies the routine",
            PilotTask::Pattern(PilotPattern::Circles) => "flies circles",
            PilotTask::Pattern(PilotPattern::Wandering) => "wanders about",
            PilotTask::Pattern(PilotPattern::Level) => "flies straight on",
            PilotTask::Commands => "flies as ordered",
            PilotTask::Landing => "lands",
            PilotTask::Landed => "stands on the ground",
            PilotTask::ExternallyControlled => "follows the order",
        }
    }

    /// Appends a leg to previous commands; cancels any other activity.
    fn append_commanded_leg(&mut self, world: &World, leg: Leg) {
        if self.task != PilotTask::Commands {
            self.start_task(world, PilotTask::Commands);
        }
        world.append_leg(leg);
    }

    fn start_task(&mut self, world: &World, task: PilotTask) {
        self.task = task;
        world.clear_plan();
    }

    fn fly_pattern(&self, world: &World) {
        if let PilotTask::Pattern(pattern) = self.task {
            let legs = pattern.legs(self.vehicle_kind, heading_deg(world), &mut self.random.borrow_mut());
            for leg in legs {
                world.append_leg(leg);
            }
        }
    }
}

fn heading_deg(world: &World) -> f64 {
    world.true_state(testkit::clock::now_us()).heading_deg()
}
