//! The module on the rig: the firmware's own tasks, wired to simulated hardware in a simulated world.

use std::cell::{Cell, RefCell};
use std::rc::Rc;

use autoswing::app::{self, Links, Panel, Platform, Watchdog};
use autoswing::collection::Kept;
use autoswing::health::ResetCause;
use autoswing::magnetometer::lis3mdl;
use autoswing::settings::{PORTS, PortNumber};
use autoswing::store::Store;
use embassy_time::{Duration, Timer};

use crate::clock;
use crate::devices::i2c::Bus;
use crate::devices::lis3mdl::{Config as ChipConfig, Lis3mdl};
use crate::devices::nor_flash::{Flash, PAGE_BYTES};
use crate::devices::uart::{Cable, Config as CableConfig, HostEnd};
use crate::faults::Faults;
use crate::faults::sensor::Faulty;
use crate::module::{Module, Ran};
use crate::simulation::{Ended, Level, Simulation, Stop};
use crate::world::far_end::{FarEnd, Somebody};
use crate::world::{World, WorldConfig};

/// Pages of the store, as on the board.
const STORE_PAGES: usize = 8;
/// Bytes of it.
pub const STORE_BYTES: usize = STORE_PAGES * PAGE_BYTES;

/// The watchdog's period, as on the board.
const WATCHDOG_US: u64 = 2_000_000;
const _: () = assert!(WATCHDOG_US > app::watchdog::LONGEST_WITHOUT_FEED_US);

/// A module in an aircraft, with cables to its ports.
pub struct Rig {
    simulation: Simulation,
    /// The world it flies in.
    pub world: World,
    /// The far end of the console's cable.
    pub console: HostEnd,
    /// The far end of the autopilot's cable, at the first port.
    pub autopilot: HostEnd,
    /// The far end of the instrument's cable, at the second.
    pub instrument: HostEnd,
    /// Who is there.
    pub far_ends: [Somebody; PORTS],
    /// The flash chip.
    pub flash: Flash,
    /// The magnetometer chip.
    pub chip: Rc<RefCell<Lis3mdl>>,
    /// Its lamp and its button.
    pub panel: SimulatedPanel,
    /// What it collects in: its own while it runs, so to be borrowed while the power is off.
    pub kept: Rc<RefCell<Kept>>,
    bus: Bus,
    console_cable: Cable,
    autopilot_cable: Cable,
    instrument_cable: Cable,
    reset: Rc<ResetLine>,
}

/// What can restart the module.
struct ResetLine {
    stop: Stop,
    cause: RefCell<Option<ResetCause>>,
    watchdog_due_us: Cell<u64>,
}

impl ResetLine {
    fn pull(&self, cause: ResetCause) {
        *self.cause.borrow_mut() = Some(cause);
        self.stop.request();
    }
}

struct SimulatedPlatform(Rc<ResetLine>);

impl Platform for SimulatedPlatform {
    fn reboot(&mut self) {
        self.0.pull(ResetCause::Software);
    }
}

struct SimulatedWatchdog(Rc<ResetLine>);

impl Watchdog for SimulatedWatchdog {
    fn feed(&mut self) {
        self.0.watchdog_due_us.set(clock::now_us() + WATCHDOG_US);
    }
}

/// Lamp and button of the module, from both sides.
#[derive(Clone, Debug, Default)]
pub struct SimulatedPanel {
    is_lit: Rc<Cell<bool>>,
    is_down: Rc<Cell<bool>>,
}

impl SimulatedPanel {
    /// Whether the lamp is lit now.
    #[must_use]
    pub fn is_lit(&self) -> bool {
        self.is_lit.get()
    }

    /// Presses the button, or lets it go.
    pub fn press(&self, is_down: bool) {
        self.is_down.set(is_down);
    }
}

impl Panel for SimulatedPanel {
    fn light(&mut self, on: bool) {
        self.is_lit.set(on);
    }

    fn is_pressed(&self) -> bool {
        self.is_down.get()
    }
}

impl Rig {
    /// A module with empty flash, switched on now, in a world of these settings.
    #[must_use]
    pub fn new(config: WorldConfig) -> Self {
        Self::with_faults(config, Faults::default())
    }

    /// The same with something wrong.
    #[must_use]
    pub fn with_faults(config: WorldConfig, faults: Faults) -> Self {
        Self::wired(config, faults, [FarEnd::Talker, FarEnd::Nobody])
    }

    /// The same with somebody else at its ports.
    #[must_use]
    pub fn wired(config: WorldConfig, faults: Faults, far_ends: [FarEnd; PORTS]) -> Self {
        let mut simulation = Simulation::new();
        let world = World::new(config);
        let console_cable = Cable::new(CableConfig::default());
        let autopilot_cable = Cable::new(CableConfig::default());
        let instrument_cable = Cable::new(CableConfig::default());
        let field = world.magnetometer_source(faults.field);
        let chip = Lis3mdl::new(ChipConfig { seed: config.seed, ..ChipConfig::default() }, field);
        let bus = Bus::new();
        bus.attach(Faulty::new(chip.clone(), faults.sensor));
        let reset = Rc::new(ResetLine {
            stop: simulation.stop(),
            cause: RefCell::new(None),
            watchdog_due_us: Cell::new(u64::MAX),
        });
        let (autopilot, instrument) = (autopilot_cable.host(), instrument_cable.host());
        let [one, two] = far_ends;
        let far_ends = [
            one.attach(&mut simulation, &world, autopilot.clone(), faults.attitude),
            two.attach(&mut simulation, &world, instrument.clone(), Vec::new()),
        ];
        for foreign in faults.senders {
            simulation.spawn(Level::World, "foreign sender", foreign.run(&world, autopilot.clone()));
        }
        simulation.spawn(Level::World, "watchdog timer", watchdog_timer(reset.clone()));
        let mut rig = Self {
            simulation,
            world,
            console: console_cable.host(),
            autopilot,
            instrument,
            far_ends,
            flash: Flash::new(STORE_PAGES, config.seed),
            chip,
            panel: SimulatedPanel::default(),
            kept: Rc::new(RefCell::new(Kept::EMPTY)),
            bus,
            console_cable,
            autopilot_cable,
            instrument_cable,
            reset,
        };
        rig.power_on(ResetCause::PowerOn);
        rig
    }

    /// Puts these contents into the flash and starts the module anew, as it would from a board's. False, and nothing done,
    /// when they are not [`STORE_BYTES`].
    pub fn load_flash(&mut self, contents: &[u8]) -> bool {
        let fits = self.flash.restore(contents);
        if fits {
            self.power_on(ResetCause::PowerOn);
        }
        fits
    }

    /// Cuts the power: the module's tasks are gone at this instant, wherever they were.
    pub fn power_off(&mut self) {
        self.simulation.power_off();
        self.reset.watchdog_due_us.set(u64::MAX);
    }

    /// Starts the module anew. The flash remembers; after all but the loss of power, the memory of a collection as well.
    #[expect(clippy::await_holding_refcell_ref, reason = "while the module runs the memory is its own")]
    pub fn power_on(&mut self, cause: ResetCause) {
        self.power_off();
        if cause == ResetCause::PowerOn {
            let mut random = testkit::random::Random(clock::now_us());
            self.kept.borrow_mut().change(|_| random.bits() as u32);
        }
        self.flash.power_on();
        self.reset.watchdog_due_us.set(clock::now_us() + WATCHDOG_US);
        let links = Rc::new(Links::new());
        let (console_rx, console_tx) = self.console_cable.module();
        let driver = lis3mdl::Lis3mdl::new(self.bus.clone(), lis3mdl::Config::default());
        let store = Store::new(self.flash.clone(), 0..STORE_BYTES as u32);
        let platform = SimulatedPlatform(self.reset.clone());
        let dog = SimulatedWatchdog(self.reset.clone());
        let panel = self.panel.clone();
        let simulation = &mut self.simulation;
        let l = links.clone();
        simulation.spawn(Level::Interrupt, "sensor", async move { app::sensor::run(&l, driver).await });
        let l = links.clone();
        simulation.spawn(Level::Interrupt, "instrument", async move { app::instrument::run(&l).await });
        for (number, cable) in PortNumber::ALL.into_iter().zip([&self.autopilot_cable, &self.instrument_cable]) {
            let (l, (rx, tx)) = (links.clone(), cable.module());
            simulation.spawn(Level::Interrupt, "port", async move { app::port::run(&l, number, rx, tx).await });
        }
        let l = links.clone();
        simulation.spawn(Level::Interrupt, "watchdog", async move { app::watchdog::run(&l, dog).await });
        let l = links.clone();
        simulation.spawn(Level::Interrupt, "panel", async move { app::panel::run(&l, panel).await });
        let (l, kept) = (links.clone(), Rc::clone(&self.kept));
        simulation.spawn(Level::Thread, "compass", async move {
            // The state machine with its samples: too large for a future inside a future.
            Box::pin(app::compass::run(&l, store, &mut kept.borrow_mut())).await;
        });
        let l = links.clone();
        simulation.spawn(Level::Thread, "pulse", async move { app::watchdog::pulse(&l).await });
        simulation.spawn(Level::Thread, "console", async move {
            app::console::run(&links, console_rx, console_tx, platform, cause).await;
        });
    }

    /// Arms a power cut: the flash operation after so many more is cut short, and the module is off.
    pub fn cut_power_after(&mut self, operations: u32, outcome: crate::devices::nor_flash::CutOutcome) {
        self.flash.cut_power_after(operations, outcome, self.simulation.stop());
    }
}

impl Module for Rig {
    fn world(&self) -> &World {
        &self.world
    }

    fn console(&self) -> &HostEnd {
        &self.console
    }

    fn autopilot(&self) -> &HostEnd {
        &self.autopilot
    }

    fn instrument(&self) -> &HostEnd {
        &self.instrument
    }

    fn now_us(&self) -> u64 {
        self.simulation.now_us()
    }

    /// Restarts the module when it asks for it or its watchdog strikes.
    fn run_until(&mut self, until_us: u64) -> Ran {
        loop {
            match self.simulation.run_until(until_us) {
                Ended::Time => return Ran::Time,
                Ended::Stopped => {
                    let cause = self.reset.cause.borrow_mut().take();
                    let Some(cause) = cause else {
                        self.power_off();
                        return Ran::PowerCut;
                    };
                    self.power_on(cause);
                }
            }
        }
    }
}

/// Strikes when it was not fed in time.
async fn watchdog_timer(reset: Rc<ResetLine>) {
    loop {
        Timer::after(Duration::from_millis(50)).await;
        if clock::now_us() > reset.watchdog_due_us.get() {
            reset.pull(ResetCause::Watchdog);
        }
    }
}
