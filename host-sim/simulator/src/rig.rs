//! Simulated module: the firmware's own tasks on simulated hardware in a simulated world.

use std::cell::{Cell, RefCell};
use std::rc::Rc;

use autoswing::attitude::AttitudeSource;
use autoswing::collection::RetainedSamples;
use autoswing_firmware::app::can::UpdateHandOver;
use autoswing_firmware::app::{self, Panel, Platform, TaskLinks, Watchdog};
use autoswing_firmware::health::ResetCause;
use autoswing_firmware::port::UpdateForBootLoader;
use autoswing_firmware::wire::dronecan::UNIQUE_ID_LENGTH;
use autoswing_firmware::wire::dronecan::outbound::{NodeInfo, SoftwareVersion};
use autoswing_module::settings::{PORT_COUNT, PortNumber};
use autoswing_module::store::Store;
use embassy_time::{Duration, Timer};
use testkit::clock;
use testkit::flash::CutProgress;
use testkit::simulation::{ExecutorLevel, RunEnd, Simulation, Stop};

use crate::devices::can::CanEnd;
use crate::devices::nor_flash::{PAGE_BYTES, SimulatedFlash};
use crate::devices::uart::{HostEnd, SerialCable, UartConfig as CableConfig};
use crate::faults::Faults;
use crate::module::{Module, ModuleRunEnd};
use crate::sensors::{SimulatedInertialSensor, SimulatedMagnetometer};
use crate::world::cable_far_end::{AttachedDevice, FarEnd};
use crate::world::{World, WorldConfig};

const STORE_PAGES: usize = 8;
/// Size of the store, bytes.
pub const STORE_BYTES: usize = STORE_PAGES * PAGE_BYTES;

/// Watchdog period as on the board, microseconds.
const WATCHDOG_US: u64 = 2_000_000;
const _: () = assert!(WATCHDOG_US > app::watchdog::MAX_FEED_INTERVAL_US);

/// Module in a vehicle, with cables to its ports.
pub struct Rig {
    simulation: Simulation,
    /// The surrounding world.
    pub world: World,
    /// Host end of the console's cable.
    pub console: HostEnd,
    /// Host end of the autopilot's cable (port 1).
    pub autopilot: HostEnd,
    /// Host end of the instrument's cable (port 2).
    pub instrument: HostEnd,
    /// Devices at the two ports.
    pub port_devices: [AttachedDevice; PORT_COUNT],
    /// Flash chip.
    pub flash: SimulatedFlash,
    /// Magnetometer.
    pub magnetometer: SimulatedMagnetometer,
    /// Gyro and accelerometer, if the module has them.
    pub inertial_sensor: Option<SimulatedInertialSensor>,
    /// Lamp and button.
    pub panel: SimulatedPanel,
    /// Firmware update handed over to the boot loader, which is not simulated.
    pub firmware_update: Rc<RefCell<Option<UpdateForBootLoader>>>,
    /// Sample memory, borrowed by the module while it runs.
    pub retained_samples: Rc<RefCell<RetainedSamples>>,
    /// Cables of console, autopilot and instrument.
    cables: [SerialCable; 3],
    reset_line: ResetLine,
    can: Option<(CanEnd, NodeInfo)>,
}

struct SimulatedBootLoader(Rc<RefCell<Option<UpdateForBootLoader>>>);

impl UpdateHandOver for SimulatedBootLoader {
    fn hand_over_update(&mut self, update: &UpdateForBootLoader) {
        self.0.replace(Some(update.clone()));
    }
}

/// Handle to what resets the module: a command, or the watchdog.
#[derive(Clone)]
struct ResetLine {
    stop: Stop,
    cause: Rc<Cell<Option<ResetCause>>>,
    watchdog_due_us: Rc<Cell<u64>>,
}

impl ResetLine {
    fn request_reset(&self, cause: ResetCause) {
        self.cause.set(Some(cause));
        self.stop.request();
    }

    /// Resets the module if the watchdog was not fed in time.
    async fn run_watchdog_timer(self) {
        loop {
            Timer::after(Duration::from_millis(50)).await;
            if clock::now_us() > self.watchdog_due_us.get() {
                self.request_reset(ResetCause::Watchdog);
            }
        }
    }
}

impl Platform for ResetLine {
    fn reboot(&mut self) {
        self.request_reset(ResetCause::Software);
    }
}

impl Watchdog for ResetLine {
    fn feed(&mut self) {
        self.watchdog_due_us.set(clock::now_us() + WATCHDOG_US);
    }
}

/// Handle to lamp and button, for the module and for tests.
#[derive(Clone, Debug, Default)]
pub struct SimulatedPanel {
    is_lit: Rc<Cell<bool>>,
    is_button_pressed: Rc<Cell<bool>>,
}

impl SimulatedPanel {
    /// Whether the lamp is lit.
    #[must_use]
    pub fn is_lit(&self) -> bool {
        self.is_lit.get()
    }

    /// Presses or releases the button.
    pub fn set_button(&self, is_button_pressed: bool) {
        self.is_button_pressed.set(is_button_pressed);
    }
}

impl Panel for SimulatedPanel {
    fn set_lamp(&mut self, is_lit: bool) {
        self.is_lit.set(is_lit);
    }

    fn is_pressed(&self) -> bool {
        self.is_button_pressed.get()
    }
}

impl Rig {
    /// A module with erased flash, switched on now, in a world with these settings.
    #[must_use]
    pub fn new(config: WorldConfig) -> Self {
        Self::with_faults(config, Faults::default())
    }

    /// As [`new`](Self::new), with faults. Without an autopilot a satellite receiver is at port 2.
    #[must_use]
    pub fn with_faults(config: WorldConfig, faults: Faults) -> Self {
        let port_devices = if config.attitude == AttitudeSource::Own {
            [FarEnd::Unconnected, FarEnd::SatelliteReceiver]
        } else {
            [FarEnd::SendOnly, FarEnd::Unconnected]
        };
        Self::with_port_devices(config, faults, port_devices)
    }

    /// As [`with_faults`](Self::with_faults), with other devices at the ports.
    #[must_use]
    pub fn with_port_devices(config: WorldConfig, faults: Faults, port_devices: [FarEnd; PORT_COUNT]) -> Self {
        let mut simulation = Simulation::new();
        let world = World::new(config);
        let cables = [(); 3].map(|()| SerialCable::new(CableConfig::default()));
        let [console, autopilot, instrument] = cables.each_ref().map(SerialCable::host_end);
        let field = world.magnetometer_source(faults.field_faults);
        let magnetometer = SimulatedMagnetometer::new(config.sensor, config.seed, field, faults.sensor_faults);
        let inertial_sensor = (config.attitude != AttitudeSource::Autopilot).then(|| {
            let (source, bus) = (world.inertial_source(), magnetometer.i2c_bus());
            SimulatedInertialSensor::new(config.seed, source, bus, faults.inertial_faults)
        });
        let watchdog_due_us = Rc::new(Cell::new(u64::MAX));
        let reset_line = ResetLine { stop: simulation.stop_handle(), cause: Rc::default(), watchdog_due_us };
        let [port_1_device, port_2_device] = port_devices;
        let port_devices = [
            port_1_device.attach_device(&mut simulation, &world, autopilot.clone(), faults.attitude_faults),
            port_2_device.attach_device(&mut simulation, &world, instrument.clone(), Vec::new()),
        ];
        for fault in faults.link_faults {
            simulation.spawn(ExecutorLevel::World, "link fault", fault.run_fault(world.clone(), autopilot.clone()));
        }
        simulation.spawn(ExecutorLevel::World, "watchdog timer", reset_line.clone().run_watchdog_timer());
        let mut rig = Self {
            simulation,
            world,
            console,
            autopilot,
            instrument,
            port_devices,
            flash: SimulatedFlash::new(STORE_PAGES),
            magnetometer,
            inertial_sensor,
            panel: SimulatedPanel::default(),
            firmware_update: Rc::default(),
            retained_samples: Rc::new(RefCell::new(RetainedSamples::EMPTY)),
            cables,
            reset_line,
            can: None,
        };
        rig.power_on(ResetCause::PowerOn);
        rig
    }

    /// Attaches the module to a CAN bus with a unique id from a number, and restarts it.
    pub fn attach_can(&mut self, can_end: CanEnd, unique_id_number: u64) {
        let mut unique_id = [0; UNIQUE_ID_LENGTH];
        unique_id[..8].copy_from_slice(&unique_id_number.to_be_bytes());
        let software = SoftwareVersion::from_firmware(None);
        self.can = Some((
            can_end,
            NodeInfo {
                node_name: "org.autoswing.simulator",
                software_version: software,
                hardware_version: [1, 0],
                unique_id,
            },
        ));
        self.power_on(ResetCause::PowerOn);
    }

    /// Replaces the flash contents and restarts the module. False without effect if the size is not [`STORE_BYTES`].
    pub fn load_flash(&mut self, contents: &[u8]) -> bool {
        let has_store_size = self.flash.restore_contents(contents);
        if has_store_size {
            self.power_on(ResetCause::PowerOn);
        }
        has_store_size
    }

    /// Cuts the power; drops the module's tasks.
    pub fn power_off(&mut self) {
        self.simulation.power_off();
        self.reset_line.watchdog_due_us.set(u64::MAX);
    }

    /// Restarts the module. Flash contents persist, and sample memory too unless power was lost.
    #[expect(clippy::await_holding_refcell_ref, reason = "while the module runs the memory is its own")]
    pub fn power_on(&mut self, cause: ResetCause) {
        self.power_off();
        if cause == ResetCause::PowerOn {
            let mut random = testkit::random::Random(clock::now_us());
            self.retained_samples.borrow_mut().transform_words(|_| random.bits() as u32);
        }
        self.flash.power_on();
        let mut watchdog = self.reset_line.clone();
        watchdog.feed();
        let links = Rc::new(TaskLinks::new());
        let [console_cable, port_cables @ ..] = &self.cables;
        let (console_rx, console_tx) = console_cable.module_ends();
        let store = Store::new(self.flash.clone(), 0..STORE_BYTES as u32);
        let (platform, panel) = (self.reset_line.clone(), self.panel.clone());
        let simulation = &mut self.simulation;
        self.magnetometer.spawn_task(simulation, links.clone());
        if let Some(inertial_sensor) = &self.inertial_sensor {
            inertial_sensor.spawn_task(simulation, links.clone());
        }
        let task_links = links.clone();
        simulation.spawn(ExecutorLevel::Interrupt, "instrument", async move {
            app::instrument::run_instrument(&task_links).await;
        });
        for (port_number, cable) in PortNumber::ALL_PORTS.into_iter().zip(port_cables) {
            let (task_links, (rx, tx)) = (links.clone(), cable.module_ends());
            simulation.spawn(ExecutorLevel::Interrupt, "port", async move {
                app::port::run_port(&task_links, port_number, rx, tx).await;
            });
        }
        if let Some((can_end, info)) = self.can.clone() {
            can_end.clear_receiver();
            let (task_links, tx, boot_loader) =
                (links.clone(), can_end.clone(), SimulatedBootLoader(Rc::clone(&self.firmware_update)));
            simulation.spawn(ExecutorLevel::Interrupt, "can", async move {
                app::can::run_can(&task_links, info, can_end, tx, boot_loader, false).await;
            });
        }
        let task_links = links.clone();
        simulation.spawn(ExecutorLevel::Interrupt, "watchdog", async move {
            app::watchdog::run_watchdog(&task_links, watchdog).await;
        });
        let task_links = links.clone();
        simulation.spawn(
            ExecutorLevel::Interrupt,
            "panel",
            async move { app::panel::run_panel(&task_links, panel).await },
        );
        let (task_links, retained) = (links.clone(), Rc::clone(&self.retained_samples));
        simulation.spawn(ExecutorLevel::Thread, "compass", async move {
            // Boxed, because the future with the sample memory is large.
            Box::pin(app::compass::run_compass(&task_links, store, &mut retained.borrow_mut())).await;
        });
        simulation.spawn(ExecutorLevel::Thread, "console", async move {
            app::console::run_console(&links, console_rx, console_tx, platform, cause).await;
        });
    }

    /// Schedules a power cut during the flash operation after `operations` more.
    pub fn cut_power_after(&mut self, operations: usize, cut: (CutProgress, u64)) {
        self.flash.cut_power_after(operations, cut, self.simulation.stop_handle());
    }
}

impl Module for Rig {
    fn world(&self) -> &World {
        &self.world
    }

    fn console_cable(&self) -> &HostEnd {
        &self.console
    }

    fn autopilot_cable(&self) -> &HostEnd {
        &self.autopilot
    }

    fn instrument_cable(&self) -> &HostEnd {
        &self.instrument
    }

    fn now_us(&self) -> u64 {
        self.simulation.now_us()
    }

    fn reset_module(&mut self) {
        self.power_on(ResetCause::Pin);
    }

    /// Restarts the module after a reboot request or a watchdog reset.
    fn run_until(&mut self, until_us: u64) -> ModuleRunEnd {
        loop {
            match self.simulation.run_until(until_us) {
                RunEnd::Time => return ModuleRunEnd::Time,
                RunEnd::Stopped => {
                    let Some(cause) = self.reset_line.cause.take() else {
                        self.power_off();
                        return ModuleRunEnd::PowerCut;
                    };
                    self.power_on(cause);
                }
            }
        }
    }
}
