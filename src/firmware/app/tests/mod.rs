//! Tests of the tasks in virtual time, with scripted and broken devices.

mod can;
mod devices;
mod heading;
mod panel;
mod port;
mod safe_mode;
mod sensor;
mod thread_tasks;
mod watchdog;

use std::rc::Rc;

use testkit::simulation::{Level, Simulation};

use super::TaskLinks;

/// Tasks and their connections.
struct TaskBench {
    simulation: Simulation,
    links: Rc<TaskLinks>,
}

impl TaskBench {
    fn new() -> Self {
        Self { simulation: Simulation::new(), links: Rc::new(TaskLinks::new()) }
    }

    fn spawn_task<F: Future<Output = ()> + 'static>(
        &mut self,
        name: &'static str,
        task: impl FnOnce(Rc<TaskLinks>) -> F,
    ) {
        self.simulation.spawn(Level::Interrupt, name, task(Rc::clone(&self.links)));
    }

    fn run_for_ms(&mut self, ms: u64) {
        self.simulation.run_for(ms * 1000);
    }
}
