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

use embedded_storage_async::nor_flash::NorFlash;
use testkit::flash::RamFlash;
use testkit::simulation::{ExecutorLevel, Simulation};

use self::devices::DETECTED_SENSOR;
use super::task_links::{CommandSource, publish_value};
use super::{TaskLinks, compass};
use autoswing::collection::RetainedSamples;
use autoswing::heading::{Heading, NoHeading};
use autoswing::instrument::Estimate;
use autoswing::time::Timestamp;
use autoswing_module::compass::{Command, Reply};
use autoswing_module::messages::Refusal;
use autoswing_module::store::Store;

type Flash = RamFlash<2048>;
const PAGE_COUNT: usize = 8;

fn test_store<F: NorFlash>(flash: F) -> Store<F> {
    Store::new(flash, 0..(2048 * PAGE_COUNT) as u32)
}

/// Tasks and their connections.
struct TaskBench {
    simulation: Simulation,
    links: Rc<TaskLinks>,
}

impl TaskBench {
    fn new() -> Self {
        Self { simulation: Simulation::new(), links: Rc::new(TaskLinks::new()) }
    }

    /// Bench with the state machine, after its start from an empty flash.
    fn with_compass() -> Self {
        Self::with_compass_and_flash(Flash::new(PAGE_COUNT))
    }

    fn with_compass_and_flash(flash: Flash) -> Self {
        let mut bench = Self::new();
        bench.spawn_task("compass", |links| async move {
            Box::pin(compass::run_compass(&links, test_store(flash), &mut RetainedSamples::EMPTY.clone())).await;
        });
        bench.run_for_ms(1);
        bench
    }

    fn spawn_task<F: Future<Output = ()> + 'static>(
        &mut self,
        name: &'static str,
        task: impl FnOnce(Rc<TaskLinks>) -> F,
    ) {
        self.simulation.spawn(ExecutorLevel::Interrupt, name, task(Rc::clone(&self.links)));
    }

    fn run_for_ms(&mut self, ms: u64) {
        self.simulation.run_for(ms * 1000);
    }

    fn detect_sensor(&mut self) {
        publish_value(&self.links.sensor, DETECTED_SENSOR);
        self.run_for_ms(1);
    }

    /// Publishes estimates every 12.5 ms for this time.
    fn publish_estimates(&mut self, heading: Result<Heading, NoHeading>, ms: u64) {
        let end_us = self.simulation.now_us() + ms * 1000;
        while self.simulation.now_us() < end_us {
            let timestamp = Timestamp::from_us(self.simulation.now_us());
            publish_value(&self.links.estimates, Estimate { timestamp, heading, ..Estimate::EMPTY });
            self.simulation.run_for(12_500);
        }
    }

    fn send_command(&mut self, source: CommandSource, command: Command) {
        self.links.commands.try_send((source, command)).unwrap();
        self.run_for_ms(1);
    }

    /// Sends a command of the console; returns the reply.
    fn execute_command(&mut self, command: Command) -> Result<Reply, Refusal> {
        self.send_command(CommandSource::Console, command);
        self.links.replies.try_receive().expect("a reply")
    }
}
