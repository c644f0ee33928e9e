//! Sensors of a simulated module: chip, bus, and the firmware's task with the chip's driver.

use std::cell::RefCell;
use std::rc::Rc;

use autoswing_firmware::app::{self, TaskLinks};
use autoswing_firmware::inertial_sensor::lsm6dsl::Lsm6dsl;
use autoswing_firmware::magnetometer::Magnetometer;
use autoswing_firmware::magnetometer::lis3mdl::Lis3mdl;
use autoswing_firmware::magnetometer::rm3100::Rm3100;
use testkit::simulation::{ExecutorLevel, Simulation};

use crate::devices::i2c::SimulatedI2cBus;
use crate::devices::lis3mdl::SimulatedLis3mdl;
use crate::devices::lsm6dsl::{ADDRESS, InertialFault, InertialSource, SimulatedLsm6dsl};
use crate::devices::rm3100::{Rm3100Fault, SimulatedRm3100};
use crate::devices::sensor::{FieldSource, SensorModel};
use crate::devices::spi::SelectedDevice;
use crate::faults::sensor::{FaultyChip, SensorFault};

/// Chip on its bus; survives a restart of the module.
pub enum SimulatedMagnetometer {
    /// LIS3MDL.
    Lis3mdl(Rc<RefCell<SimulatedLis3mdl>>, SimulatedI2cBus),
    /// RM3100.
    Rm3100(Rc<RefCell<SimulatedRm3100>>),
}

impl SimulatedMagnetometer {
    /// A chip after power-on. `faults` act on a LIS3MDL only; an RM3100 has its own ([`Rm3100Fault`]).
    #[must_use]
    pub fn new(model: SensorModel, seed: u64, field: FieldSource, faults: Vec<Box<dyn SensorFault>>) -> Self {
        match model {
            SensorModel::Lis3mdl => {
                let chip = SimulatedLis3mdl::new(seed, 1.0, field);
                let bus = SimulatedI2cBus::new();
                bus.attach_device(FaultyChip::new(chip.clone(), faults));
                Self::Lis3mdl(chip, bus)
            }
            SensorModel::Rm3100 => Self::Rm3100(SimulatedRm3100::new(seed, 1.0, 1.0, field)),
        }
    }

    /// Bus for the module's other chips; one of its own beside an RM3100, which is on SPI.
    #[must_use]
    pub fn i2c_bus(&self) -> SimulatedI2cBus {
        match self {
            Self::Lis3mdl(_, bus) => bus.clone(),
            Self::Rm3100(_) => SimulatedI2cBus::new(),
        }
    }

    /// Fault: the chip does not answer while `silent`.
    pub fn set_silent(&self, silent: bool) {
        match self {
            Self::Lis3mdl(chip, _) => chip.borrow_mut().set_silent(silent),
            Self::Rm3100(chip) => chip.borrow_mut().set_fault(silent.then_some(Rm3100Fault::MissingChip(0xFF))),
        }
    }

    /// Fault: a supply drop resets all registers.
    pub fn power_cycle(&self) {
        match self {
            Self::Lis3mdl(chip, _) => chip.borrow_mut().power_cycle(),
            Self::Rm3100(chip) => chip.borrow_mut().power_cycle(),
        }
    }

    /// Starts the firmware's sensor task with the chip's driver.
    pub(crate) fn spawn_task(&self, simulation: &mut Simulation, links: Rc<TaskLinks>) {
        match self {
            Self::Lis3mdl(_, bus) => spawn_sensor_task(simulation, links, Lis3mdl::new(bus.clone())),
            Self::Rm3100(chip) => spawn_sensor_task(simulation, links, Rm3100::new(SelectedDevice::new(chip.clone()))),
        }
    }
}

fn spawn_sensor_task(simulation: &mut Simulation, links: Rc<TaskLinks>, driver: impl Magnetometer + 'static) {
    simulation.spawn(ExecutorLevel::Interrupt, "sensor", async move { app::sensor::run_sensor(&links, driver).await });
}

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
