//! The firmware as ARM code: QEMU's `mps2-an386`, a Cortex-M4F with QEMU's own magnetometer, flown by the same world.
//!
//! Machine and world move in lockstep: the machine stops every other millisecond, and before every access to its
//! sensor, sends its time, and goes on when the world has caught up. The computer's own time has no part in it.

pub mod budget;
mod error;
mod image;
mod machine;
mod qmp;

use std::cell::RefCell;
use std::collections::VecDeque;
use std::path::{Path, PathBuf};
use std::rc::Rc;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use autoswing::settings::PORTS;
use embassy_sync::blocking_mutex::raw::NoopRawMutex;
use embassy_sync::signal::Signal;
use embedded_io_async::{Read, Write};

pub use self::error::EmulatorError;
pub use self::machine::BenchTest;
use self::machine::{Go, MOST_BYTES, Machine, Message, TICKS_PER_US};
use crate::devices::uart::{Cable, Config as CableConfig, Delivery, HostEnd, Receiver, Transmitter};
use crate::module::{Module, Ran};
use crate::random::{Purpose, Random};
use crate::simulation::{Level, Simulation};
use crate::world::far_end::{FarEnd, Somebody};
use crate::world::{World, WorldConfig};

/// The program.
const QEMU: &str = "qemu-system-arm";

/// Where `scripts/build-firmware` leaves the image.
#[must_use]
pub fn default_image() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../target/firmware/mps2-an386.elf")
}

/// Where `scripts/build-firmware` leaves the bench image, which takes [`Emulator::ask_bench`].
#[must_use]
pub fn default_bench_image() -> PathBuf {
    default_image().with_file_name("mps2-an386-bench.elf")
}

/// Noise of the simulated chip, microtesla RMS on each axis: 2 mG (data sheet of the LSM303DLHC).
const NOISE_UT: f64 = 0.2;

/// The field is set anew when the last time was so long ago: the two accesses of one reading see the same.
const FIELD_AGE_US: u64 = 2_000;

/// An emulated module in an aircraft.
pub struct Emulator {
    simulation: Simulation,
    world: World,
    console: HostEnd,
    autopilot: HostEnd,
    instrument: HostEnd,
    /// Who is at the ports.
    pub far_ends: [Somebody; PORTS],
    console_wire: Wire,
    autopilot_wire: Wire,
    instrument_wire: Wire,
    machine: Machine,
    noise: Random,
    field_set_us: Option<u64>,
    sensor_broken: bool,
    sensor_stuck: bool,
    asked: Option<BenchTest>,
    reset_pressed: bool,
    /// World time at the machine's last reset, and the machine's own since then.
    since_us: u64,
    machine_us: u64,
    way: Way,
    failure: Option<EmulatorError>,
}

impl Emulator {
    /// Starts a firmware image with erased flash in a world of these settings.
    ///
    /// # Errors
    ///
    /// There is no such image, no QEMU, or no connection to it. QEMU ends with an image for another machine: at once,
    /// or when it is to run.
    pub fn start(image: &Path, config: WorldConfig) -> Result<Self, EmulatorError> {
        Self::start_wired(image, config, [FarEnd::Talker, FarEnd::Nobody])
    }

    /// The same until `stop` is set: every run of it then fails with [`EmulatorError::Interrupted`].
    ///
    /// # Errors
    ///
    /// As [`start`](Self::start).
    pub fn start_until(stop: &Arc<AtomicBool>, image: &Path, config: WorldConfig) -> Result<Self, EmulatorError> {
        Self::start_machine(|| Machine::start(image, Arc::clone(stop)), &config, [FarEnd::Talker, FarEnd::Nobody])
    }

    /// The same with somebody else at its ports.
    ///
    /// # Errors
    ///
    /// As [`start`](Self::start).
    pub fn start_wired(image: &Path, config: WorldConfig, far_ends: [FarEnd; PORTS]) -> Result<Self, EmulatorError> {
        Self::start_machine(|| Machine::start(image, Arc::default()), &config, far_ends)
    }

    fn start_machine(
        machine: impl FnOnce() -> Result<Machine, EmulatorError>,
        config: &WorldConfig,
        [one, two]: [FarEnd; PORTS],
    ) -> Result<Self, EmulatorError> {
        let mut simulation = Simulation::new();
        let world = World::new(*config);
        let cable = || Cable::new(CableConfig { delivery: Delivery::EachByte, ..CableConfig::default() });
        let [console_cable, autopilot_cable, instrument_cable] = [(); 3].map(|()| cable());
        let [console, autopilot, instrument] = [&console_cable, &autopilot_cable, &instrument_cable].map(Cable::host);
        let far_ends = [
            one.attach(&mut simulation, &world, autopilot.clone(), vec![]),
            two.attach(&mut simulation, &world, instrument.clone(), vec![]),
        ];
        Ok(Self {
            console_wire: Wire::new(&console_cable, &mut simulation),
            autopilot_wire: Wire::new(&autopilot_cable, &mut simulation),
            instrument_wire: Wire::new(&instrument_cable, &mut simulation),
            simulation,
            world,
            console,
            autopilot,
            instrument,
            far_ends,
            machine: machine()?,
            noise: Random::new(config.seed, Purpose::Magnetometer),
            field_set_us: None,
            sensor_broken: false,
            sensor_stuck: false,
            asked: None,
            reset_pressed: false,
            since_us: 0,
            machine_us: 0,
            way: Way::default(),
            failure: None,
        })
    }

    /// Why a run has failed.
    pub fn take_failure(&mut self) -> Option<EmulatorError> {
        self.failure.take()
    }

    /// Breaks or mends the sensor's data wire.
    pub fn break_sensor_wire(&mut self, broken: bool) {
        self.sensor_broken = broken;
    }

    /// Has the sensor repeat what it measured last, or measure again.
    pub fn stick_sensor(&mut self, stuck: bool) {
        self.sensor_stuck = stuck;
    }

    /// Has the bench image run a test, as soon as time goes on. Other images pass it over.
    pub fn ask_bench(&mut self, test: BenchTest) {
        self.asked = Some(test);
    }

    /// Presses the reset button, as soon as time goes on.
    pub fn press_reset(&mut self) {
        self.reset_pressed = true;
    }

    /// Instructions from the first access to the sensor to the last byte written, for each reading that was sent since
    /// the last time this was asked.
    pub fn take_ways(&mut self) -> Vec<u64> {
        let instructions = |ticks: u64| ticks * machine::TICK_NS / machine::INSTRUCTION_NS;
        std::mem::take(&mut self.way.ticks).into_iter().map(instructions).collect()
    }

    /// Lets the machine run to its next message, and the world catch up.
    fn step(&mut self) -> Result<(), EmulatorError> {
        let (message, ticks) = self.machine.listen()?;
        if message == Message::Started {
            self.restarted();
            return Ok(());
        }
        self.catch_up(ticks / TICKS_PER_US);
        let [console, autopilot, instrument] = self.machine.written()?;
        self.console_wire.write(&console);
        self.autopilot_wire.write(&autopilot);
        self.instrument_wire.write(&instrument);
        match message {
            Message::Written => {
                self.way.written(ticks);
                return Ok(());
            }
            Message::Sensor => {
                self.way.looked(ticks);
                self.set_field()?;
            }
            // While the machine waits no message is under way in either direction, which a reset would cut.
            Message::Step if std::mem::take(&mut self.reset_pressed) => return self.machine.reset(),
            Message::Started | Message::Step => {}
        }
        let go = Go {
            console: self.console_wire.take(),
            autopilot: self.autopilot_wire.take(),
            instrument: self.instrument_wire.take(),
            sensor_broken: self.sensor_broken,
            test: self.asked.take(),
        };
        self.machine.go(&go)
    }

    /// The machine has started, again perhaps: that took no time, and made its sensor forget the field.
    fn restarted(&mut self) {
        self.since_us += self.machine_us;
        self.machine_us = 0;
        self.field_set_us = None;
        self.way.began = None;
    }

    /// Moves the world on to the machine's time.
    fn catch_up(&mut self, machine_us: u64) {
        // The message of a step may come a little late.
        self.machine_us = self.machine_us.max(machine_us);
        self.simulation.run_until(self.now_us());
    }

    fn set_field(&mut self) -> Result<(), EmulatorError> {
        let now_us = self.now_us();
        let is_fresh = self.field_set_us.is_some_and(|set_us| now_us - set_us < FIELD_AGE_US);
        if is_fresh || self.sensor_stuck {
            return Ok(());
        }
        self.field_set_us = Some(now_us);
        let noise_ut = self.noise.normal_vector() * NOISE_UT;
        self.machine.set_field(self.world.sensor_field(now_us).ut + noise_ut.cast())
    }
}

impl Module for Emulator {
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
        self.since_us + self.machine_us
    }

    fn run_until(&mut self, until_us: u64) -> Ran {
        while self.now_us() < until_us {
            if let Err(error) = self.step() {
                self.failure = Some(error);
                return Ran::Failed;
            }
        }
        Ran::Time
    }
}

/// How long readings take through the machine.
#[derive(Default)]
struct Way {
    /// When it began to look at the sensor for the reading of now.
    began: Option<u64>,
    /// Whether that has been written; the last of several writes counts.
    written: bool,
    ticks: Vec<u64>,
}

impl Way {
    fn looked(&mut self, ticks: u64) {
        let again = self.began.is_some_and(|began| ticks - began < FIELD_AGE_US * TICKS_PER_US);
        if self.written || !again {
            self.began = Some(ticks);
            self.written = false;
        }
    }

    fn written(&mut self, ticks: u64) {
        let Some(began) = self.began else { return };
        if self.written {
            self.ticks.pop();
        }
        self.ticks.push(ticks - began);
        self.written = true;
    }
}

/// A cable's end at the machine: bytes take their time on the cable, and wait here for the machine to stop.
struct Wire {
    to_machine: Rc<RefCell<VecDeque<u8>>>,
    to_cable: Rc<Outgoing>,
}

#[derive(Default)]
struct Outgoing {
    bytes: RefCell<Vec<u8>>,
    more: Signal<NoopRawMutex, ()>,
}

impl Wire {
    fn new(cable: &Cable, simulation: &mut Simulation) -> Self {
        let (receiver, transmitter) = cable.module();
        let wire = Self { to_machine: Rc::default(), to_cable: Rc::default() };
        simulation.spawn(Level::World, "to machine", receive(receiver, Rc::clone(&wire.to_machine)));
        simulation.spawn(Level::World, "from machine", transmit(transmitter, Rc::clone(&wire.to_cable)));
        wire
    }

    /// What the machine has written.
    fn write(&self, bytes: &[u8]) {
        if !bytes.is_empty() {
            self.to_cable.bytes.borrow_mut().extend_from_slice(bytes);
            self.to_cable.more.signal(());
        }
    }

    /// What has arrived, as much as the machine takes at once.
    fn take(&self) -> Vec<u8> {
        let mut waiting = self.to_machine.borrow_mut();
        let number = waiting.len().min(MOST_BYTES);
        waiting.drain(..number).collect()
    }
}

async fn receive(mut receiver: Receiver, to_machine: Rc<RefCell<VecDeque<u8>>>) {
    let mut buffer = [0; 64];
    loop {
        // Errors of the line, which nobody injects here, would be noise to the machine.
        if let Ok(read) = receiver.read(&mut buffer).await {
            to_machine.borrow_mut().extend(&buffer[..read]);
        }
    }
}

async fn transmit(mut transmitter: Transmitter, outgoing: Rc<Outgoing>) {
    loop {
        outgoing.more.wait().await;
        let bytes = outgoing.bytes.take();
        // A simulated cable takes everything in the end.
        let _ = transmitter.write_all(&bytes).await;
    }
}
