//! What the tasks promise: each on its wires, in virtual time, with devices that are scripted or broken.

mod below;
mod devices;
mod heading;
mod panel;
#[cfg(all(feature = "mavlink", feature = "nmea"))]
mod port;
mod sensor;
mod watchdog;

use std::rc::Rc;

use testkit::simulation::{Level, Simulation};

use super::Links;

/// Tasks and the wires between them.
struct Bed {
    simulation: Simulation,
    links: Rc<Links>,
}

impl Bed {
    fn new() -> Self {
        Self { simulation: Simulation::new(), links: Rc::new(Links::new()) }
    }

    /// Runs a task on the wires.
    fn run<F: Future<Output = ()> + 'static>(&mut self, name: &'static str, task: impl FnOnce(Rc<Links>) -> F) {
        self.simulation.spawn(Level::Interrupt, name, task(Rc::clone(&self.links)));
    }

    fn ms(&mut self, ms: u64) {
        self.simulation.run_for(ms * 1000);
    }
}
