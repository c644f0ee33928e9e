//! Gyro and accelerometer of a simulated module, on the bus of its magnetometer.

use std::cell::RefCell;
use std::rc::Rc;

use autoswing_firmware::app::{self, TaskLinks};
use autoswing_firmware::inertial_sensor::lsm6dsl::Lsm6dsl;
use testkit::simulation::{ExecutorLevel, Simulation};

use crate::devices::i2c::SimulatedI2cBus;
use crate::devices::lsm6dsl::{ADDRESS, InertialFault, InertialSource, SimulatedLsm6dsl};

/// LSM6DSL on its bus; survives a restart of the module.
pub struct SimulatedInertialSensor {
    /// The chip.
    pub chip: Rc<RefCell<SimulatedLsm6dsl>>,
    bus: SimulatedI2cBus,
}

impl SimulatedInertialSensor {
    /// A chip with the errors of its data sheet, drawn by the seed.
    #[must_use]
    pub fn new(seed: u64, source: InertialSource, bus: SimulatedI2cBus, faults: Vec<Box<dyn InertialFault>>) -> Self {
        let chip = SimulatedLsm6dsl::new(seed, 1.0, source);
        chip.borrow_mut().set_faults(faults);
        bus.attach_device(chip.clone());
        Self { chip, bus }
    }

    /// Starts the firmware's task with the chip's driver.
    pub(crate) fn spawn_task(&self, simulation: &mut Simulation, links: Rc<TaskLinks>) {
        let driver = Lsm6dsl::new(self.bus.clone(), ADDRESS);
        simulation.spawn(ExecutorLevel::Interrupt, "inertial sensor", async move {
            app::inertial::run_inertial_sensor(&links, driver).await;
        });
    }
}
