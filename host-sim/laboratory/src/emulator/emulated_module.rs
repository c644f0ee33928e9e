//! Machine and world in lockstep: the module in its simulated vehicle.

use std::cell::RefCell;
use std::collections::VecDeque;
use std::path::Path;
use std::rc::Rc;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use autoswing_module::settings::PORT_COUNT;
use embassy_sync::blocking_mutex::raw::NoopRawMutex;
use embassy_sync::signal::Signal;
use embedded_io_async::{Read, Write};
use simulator::devices::uart::{
    HostEnd, SerialCable, UartConfig as CableConfig, UartReceiver, UartTransmitter, WakeCondition,
};
use simulator::module::{Module, ModuleRunEnd};
use simulator::random::{RandomStream, StreamPurpose};
use simulator::world::cable_far_end::{AttachedDevice, FarEnd};
use simulator::world::{World, WorldConfig};
use testkit::simulation::{ExecutorLevel, Simulation};

use super::emulated_machine::{
    BenchTest, EmulatedMachine, INSTRUCTION_NS, MAX_STEP_BYTES, MachineMessage, StepInput, TICK_NS, TICKS_PER_US,
};
use super::error::EmulatorError;

/// Sensor noise, microtesla RMS per axis: 2 mG (LSM303DLHC data sheet).
const NOISE_UT: f64 = 0.2;

/// Emulated module in a simulated vehicle.
pub struct Emulator {
    simulation: Simulation,
    world: World,
    /// Cables of console, autopilot port and instrument port, and their ends at the machine.
    cables: [HostEnd; 3],
    wires: [MachinePort; 3],
    /// Devices at the ports.
    pub port_devices: [AttachedDevice; PORT_COUNT],
    machine: EmulatedMachine,
    noise: RandomStream,
    last_field_update_us: Option<u64>,
    is_sensor_wire_broken: bool,
    is_sensor_stuck: bool,
    requested_bench_test: Option<BenchTest>,
    is_reset_requested: bool,
    /// World time at the machine's last reset, microseconds; `machine_us` counts from this reset.
    reset_at_us: u64,
    machine_us: u64,
    sample_path: SamplePath,
    failure: Option<EmulatorError>,
}

impl Emulator {
    /// Devices at the ports: an autopilot that only sends.
    pub const SENDING_AUTOPILOT: [FarEnd; PORT_COUNT] = [FarEnd::SendOnly, FarEnd::Unconnected];

    /// Starts a firmware image with erased flash in a world with these settings.
    ///
    /// # Errors
    ///
    /// Missing image or QEMU, or a failed connection. With an image for another machine QEMU ends at once or at the
    /// first step.
    pub fn start_emulator(image: &Path, config: WorldConfig) -> Result<Self, EmulatorError> {
        Self::start_with(image, config, Self::SENDING_AUTOPILOT, Arc::default())
    }

    /// As [`start_emulator`](Self::start_emulator), with these devices at the ports. After `stop` is set every run fails
    /// with [`EmulatorError::Interrupted`].
    ///
    /// # Errors
    ///
    /// As [`start_emulator`](Self::start_emulator).
    pub fn start_with(
        image: &Path,
        config: WorldConfig,
        [port_1_device, port_2_device]: [FarEnd; PORT_COUNT],
        stop: Arc<AtomicBool>,
    ) -> Result<Self, EmulatorError> {
        let mut simulation = Simulation::new();
        let world = World::new(config);
        let serial_cables = [(); 3].map(|()| {
            SerialCable::new(CableConfig { wake_condition: WakeCondition::EachByte, ..CableConfig::default() })
        });
        let cables = serial_cables.each_ref().map(SerialCable::host_end);
        let [_, autopilot, instrument] = &cables;
        let port_devices = [
            port_1_device.attach_device(&mut simulation, &world, autopilot.clone(), vec![]),
            port_2_device.attach_device(&mut simulation, &world, instrument.clone(), vec![]),
        ];
        Ok(Self {
            wires: serial_cables.each_ref().map(|cable| MachinePort::new(cable, &mut simulation)),
            simulation,
            world,
            cables,
            port_devices,
            machine: EmulatedMachine::start_qemu(image, stop)?,
            noise: RandomStream::new(config.seed, StreamPurpose::Magnetometer),
            last_field_update_us: None,
            is_sensor_wire_broken: false,
            is_sensor_stuck: false,
            requested_bench_test: None,
            is_reset_requested: false,
            reset_at_us: 0,
            machine_us: 0,
            sample_path: SamplePath::default(),
            failure: None,
        })
    }

    /// Error of the last failed run.
    pub fn take_failure(&mut self) -> Option<EmulatorError> {
        self.failure.take()
    }

    /// Breaks or repairs the sensor's data wire.
    pub fn break_sensor_wire(&mut self, is_broken: bool) {
        self.is_sensor_wire_broken = is_broken;
    }

    /// Freezes or releases the sensor's measured value.
    pub fn freeze_sensor(&mut self, is_stuck: bool) {
        self.is_sensor_stuck = is_stuck;
    }

    /// Requests a test of the bench image at the next step. Other images ignore it.
    pub fn request_bench_test(&mut self, test: BenchTest) {
        self.requested_bench_test = Some(test);
    }

    /// Instructions from the first sensor access to the last written byte, per sample since the last call.
    pub fn take_path_instruction_counts(&mut self) -> Vec<u64> {
        self.sample_path.take_instruction_counts()
    }

    /// Runs the machine to its next message and the world to the machine's time.
    fn run_step(&mut self) -> Result<(), EmulatorError> {
        let (message, ticks) = self.machine.wait_for_message()?;
        if message == MachineMessage::Started {
            self.process_restart();
            return Ok(());
        }
        self.advance_world(ticks / TICKS_PER_US);
        for (port, wire) in self.wires.iter().enumerate() {
            wire.send_to_cable(&self.machine.take_output(port)?);
        }
        match message {
            MachineMessage::Written => self.sample_path.on_output(ticks),
            MachineMessage::Sensor => {
                self.sample_path.on_sensor_access(ticks);
                self.update_field()?;
            }
            // While the machine waits, no message is in transmission that a reset could truncate.
            MachineMessage::Step if std::mem::take(&mut self.is_reset_requested) => {
                return self.machine.reset_machine();
            }
            MachineMessage::Started | MachineMessage::Step => {}
        }
        let step_input = StepInput {
            port_bytes: self.wires.each_ref().map(MachinePort::take_bytes_for_machine),
            is_sensor_wire_broken: self.is_sensor_wire_broken,
            bench_test: self.requested_bench_test.take(),
        };
        self.machine.resume(&step_input)
    }

    /// The machine restarted, which takes no time and clears the sensor's field.
    fn process_restart(&mut self) {
        self.reset_at_us += self.machine_us;
        self.machine_us = 0;
        self.last_field_update_us = None;
        self.sample_path.end_sample();
    }

    fn advance_world(&mut self, machine_us: u64) {
        // Machine time never goes back: a step's message may have an earlier time than the message before.
        self.machine_us = self.machine_us.max(machine_us);
        self.simulation.run_until(self.now_us());
    }

    fn update_field(&mut self) -> Result<(), EmulatorError> {
        let now_us = self.now_us();
        let is_current = self.last_field_update_us.is_some_and(|set_us| now_us - set_us < FIELD_UPDATE_PERIOD_US);
        if is_current || self.is_sensor_stuck {
            return Ok(());
        }
        self.last_field_update_us = Some(now_us);
        let noise_ut = self.noise.normal_vector() * NOISE_UT;
        self.machine.set_field(self.world.sensor_field(now_us).ut + noise_ut.cast())
    }
}

impl Module for Emulator {
    fn world(&self) -> &World {
        &self.world
    }

    fn console_cable(&self) -> &HostEnd {
        &self.cables[0]
    }

    fn autopilot_cable(&self) -> &HostEnd {
        &self.cables[1]
    }

    fn instrument_cable(&self) -> &HostEnd {
        &self.cables[2]
    }

    fn now_us(&self) -> u64 {
        self.reset_at_us + self.machine_us
    }

    fn reset_module(&mut self) {
        self.is_reset_requested = true;
    }

    fn run_until(&mut self, until_us: u64) -> ModuleRunEnd {
        while self.now_us() < until_us {
            if let Err(error) = self.run_step() {
                self.failure = Some(error);
                return ModuleRunEnd::Failed;
            }
        }
        ModuleRunEnd::Time
    }
}

/// Update period of the field, microseconds; both accesses of one measurement read the same field.
pub const FIELD_UPDATE_PERIOD_US: u64 = 2_000;

/// Path of each sample through the module, from the first sensor access to the last written byte.
#[derive(Default)]
pub struct SamplePath {
    /// Start of the present sample's sensor access, machine ticks.
    access_start_ticks: Option<u64>,
    /// Whether the firmware has written to the instrument port since the sensor access; its last write ends the path.
    has_written: bool,
    durations_ticks: Vec<u64>,
}

impl SamplePath {
    /// Takes the instructions of the samples since the last call.
    pub fn take_instruction_counts(&mut self) -> Vec<u64> {
        let instructions = |ticks: u64| ticks * TICK_NS / INSTRUCTION_NS;
        std::mem::take(&mut self.durations_ticks).into_iter().map(instructions).collect()
    }

    /// The machine restarted: the present sample ends.
    pub fn end_sample(&mut self) {
        self.access_start_ticks = None;
    }

    pub fn on_sensor_access(&mut self, ticks: u64) {
        let is_same_measurement = self
            .access_start_ticks
            .is_some_and(|start_ticks| ticks - start_ticks < FIELD_UPDATE_PERIOD_US * TICKS_PER_US);
        if self.has_written || !is_same_measurement {
            self.access_start_ticks = Some(ticks);
            self.has_written = false;
        }
    }

    pub fn on_output(&mut self, ticks: u64) {
        let Some(start_ticks) = self.access_start_ticks else { return };
        if self.has_written {
            self.durations_ticks.pop();
        }
        self.durations_ticks.push(ticks - start_ticks);
        self.has_written = true;
    }
}

/// Machine end of a cable; buffers received bytes until the machine stops.
pub struct MachinePort {
    to_machine: Rc<RefCell<VecDeque<u8>>>,
    to_cable: Rc<OutgoingBytes>,
}

#[derive(Default)]
struct OutgoingBytes {
    bytes: RefCell<Vec<u8>>,
    data_ready: Signal<NoopRawMutex, ()>,
}

impl MachinePort {
    pub fn new(cable: &SerialCable, simulation: &mut Simulation) -> Self {
        let (receiver, transmitter) = cable.module_ends();
        let wire = Self { to_machine: Rc::default(), to_cable: Rc::default() };
        simulation.spawn(ExecutorLevel::World, "to machine", forward_received(receiver, Rc::clone(&wire.to_machine)));
        simulation.spawn(ExecutorLevel::World, "from machine", forward_sent(transmitter, Rc::clone(&wire.to_cable)));
        wire
    }

    pub fn send_to_cable(&self, bytes: &[u8]) {
        if !bytes.is_empty() {
            self.to_cable.bytes.borrow_mut().extend_from_slice(bytes);
            self.to_cable.data_ready.signal(());
        }
    }

    /// Received bytes, up to the machine's limit per step.
    pub fn take_bytes_for_machine(&self) -> Vec<u8> {
        let mut waiting = self.to_machine.borrow_mut();
        let byte_count = waiting.len().min(MAX_STEP_BYTES);
        waiting.drain(..byte_count).collect()
    }
}

async fn forward_received(mut receiver: UartReceiver, to_machine: Rc<RefCell<VecDeque<u8>>>) {
    let mut buffer = [0; 64];
    loop {
        // Line errors are never injected here.
        if let Ok(read_count) = receiver.read(&mut buffer).await {
            to_machine.borrow_mut().extend(&buffer[..read_count]);
        }
    }
}

async fn forward_sent(mut transmitter: UartTransmitter, outgoing: Rc<OutgoingBytes>) {
    loop {
        outgoing.data_ready.wait().await;
        let bytes = outgoing.bytes.take();
        // A simulated cable never reports write errors.
        let _ = transmitter.write_all(&bytes).await;
    }
}
