//! Simulated module for external programs: port bytes, pilot commands, attitudes of an external simulator.
//!
//! Time is simulated: the caller advances it, and results depend only on the seed and on the input with its times. The
//! command line couples it to real time and to sockets.

mod attitude_datagram;
mod flash_image;
pub mod multicast;
mod pilot;
mod pilot_command;

use autoswing::attitude::AttitudeSource;
use autoswing_firmware::wire::dronecan::CanFrame;
use autoswing_firmware::wire::mavlink::{InboundMessage, MavlinkReceiver};
use autoswing_firmware::wire::msp;
use serde::Deserialize;
use simulator::devices::can::{CanEnd, CanFaults, SimulatedCanBus};
use simulator::devices::uart::HostEnd;
use simulator::module::Module as _;
use simulator::rig::Rig;
use simulator::world::WorldConfig;
use simulator::world::earth::Earth;
use simulator::world::gyro::GyroConfig;

use self::pilot::SimulatedPilot;

pub use self::attitude_datagram::{AttitudeDatagram, DatagramError, parse_attitude};
pub use self::flash_image::{FlashImage, FlashImageError};
pub use pilot_command::{COMMANDS, PilotCommand, PilotCommandError, PilotPattern};

/// Port of the module.
#[derive(Debug)]
pub struct ServedPort {
    /// Name of the port.
    pub port_name: &'static str,
    /// Short description of its traffic.
    pub traffic_description: &'static str,
    cable: fn(&Rig) -> &HostEnd,
}

/// All ports in order.
pub const PORTS: &[ServedPort] = &[
    ServedPort { port_name: "console", traffic_description: "a terminal", cable: |rig| &rig.console },
    ServedPort {
        port_name: "port 1",
        traffic_description: "an autopilot: MAVLink or MSP, detected",
        cable: |rig| &rig.autopilot,
    },
    ServedPort {
        port_name: "port 2",
        traffic_description: "an instrument: NMEA heading",
        cable: |rig| &rig.instrument,
    },
];

/// Index of the console in [`PORTS`].
pub const CONSOLE_PORT: usize = 0;
/// Index of the autopilot port in [`PORTS`].
pub const AUTOPILOT_PORT: usize = 1;
/// Index of the instrument port in [`PORTS`].
pub const INSTRUMENT_PORT: usize = 2;

/// Source of the module's attitude.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum AttitudeProvider {
    /// The simulator, except while an external autopilot at the autopilot port sends attitude.
    #[default]
    Auto,
    /// Always the simulator.
    Simulator,
    /// Only an external autopilot.
    Peer,
    /// No autopilot: the module's gyro and accelerometer, with a satellite receiver at the instrument port.
    Own,
}

/// Options of the served module.
#[derive(Clone, Copy, Debug, Default)]
pub struct ServeOptions {
    /// Flight pattern without pilot commands.
    pub flight_pattern: PilotPattern,
    /// Provider of the attitude.
    pub attitude: AttitudeProvider,
    /// Whether an external simulator provides the attitude of the aircraft.
    pub has_external_simulator: bool,
    /// Whether the module is a node of a CAN bus.
    pub has_can: bool,
}

/// Period of pilot actions and attitude-source selection, microseconds.
const PILOT_PERIOD_US: u64 = 100_000;

/// Time from the first attitude of an external simulator until attitudes are sent: more than their latency.
const FIRST_ATTITUDE_SETTLING_US: u64 = 2 * PILOT_PERIOD_US;

/// Limit of bytes in transmission to a port: 0.1 s of traffic.
const MAX_BYTES_IN_TRANSMISSION: usize = 1152;

/// Simulated module in its vehicle, with its ports.
pub struct ServedModule {
    rig: Rig,
    pilot: SimulatedPilot,
    external_autopilot: ExternalAutopilot,
    attitude: AttitudeProvider,
    external_datagram_counts: Option<DatagramCounts>,
    /// Time of the first attitude of an external simulator.
    first_attitude_us: Option<u64>,
    /// The bus as other nodes see it.
    can_end: Option<CanEnd>,
}

/// Counters of attitude datagrams from an external simulator.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct DatagramCounts {
    /// Accepted datagrams.
    pub accepted_datagrams: u64,
    /// Rejected datagrams.
    pub rejected_datagrams: u64,
}

impl ServedModule {
    /// A module switched on now, with erased flash or flash contents from an image. The vehicle moves and is armed
    /// unless an external simulator controls it.
    #[must_use]
    pub fn new(world: WorldConfig, options: ServeOptions, image: Option<&FlashImage>) -> Self {
        // An external simulator sends no body rates: they are derived from its attitudes, without gyro errors.
        let gyro = if options.has_external_simulator { GyroConfig::ERROR_FREE } else { world.gyro };
        // The position is known only if the simulated field is that of Xi'an.
        let reports_position = world.earth == Earth::default();
        // The module has a gyro and an accelerometer, as the reference board.
        let attitude = match options.attitude {
            AttitudeProvider::Own => AttitudeSource::Own,
            _ => AttitudeSource::Automatic,
        };
        let mut rig = Rig::new(WorldConfig { gyro, reports_current: true, reports_position, attitude, ..world });
        if let Some(image) = image {
            // Image sizes are checked on reading.
            rig.load_flash(image.bytes());
        }
        let can_end = options.has_can.then(|| {
            let bus = SimulatedCanBus::new(CanFaults::default());
            rig.attach_can(bus.attach_node(), world.seed);
            bus.attach_node()
        });
        let pilot = SimulatedPilot::new(&world, options.flight_pattern, options.has_external_simulator);
        pilot.start_pattern(&rig.world);
        let external_datagram_counts = options.has_external_simulator.then(DatagramCounts::default);
        let module = Self {
            rig,
            pilot,
            external_autopilot: ExternalAutopilot::default(),
            attitude: options.attitude,
            external_datagram_counts,
            first_attitude_us: None,
            can_end,
        };
        module.select_attitude_sender();
        module
    }

    /// Time since power-on, microseconds.
    #[must_use]
    pub fn now_us(&self) -> u64 {
        self.rig.now_us()
    }

    /// Advances time; the result does not depend on the division into calls.
    pub fn advance_time(&mut self, by_us: u64) {
        let until_us = self.now_us() + by_us;
        while self.now_us() < until_us {
            let next_pilot_action_us = (self.now_us() / PILOT_PERIOD_US + 1) * PILOT_PERIOD_US;
            // No power cut is scheduled in this rig.
            let _ = self.rig.run_until(next_pilot_action_us.min(until_us));
            if self.now_us() == next_pilot_action_us {
                self.pilot.continue_flight(&self.rig.world);
                self.select_attitude_sender();
            }
        }
    }

    /// Sends bytes to the port at this index in [`PORTS`]; ignores an invalid index.
    pub fn send_bytes(&mut self, port: usize, bytes: &[u8]) {
        let Some(ServedPort { cable, .. }) = PORTS.get(port) else { return };
        cable(&self.rig).send_bytes(bytes);
        if port == AUTOPILOT_PORT {
            self.external_autopilot.process_bytes(self.rig.now_us(), bytes);
            self.select_attitude_sender();
        }
    }

    /// Bytes received from the port at this index in [`PORTS`]; none for an invalid index.
    #[must_use]
    pub fn receive_bytes(&self, port: usize) -> Vec<u8> {
        PORTS.get(port).map_or_else(Vec::new, |port| (port.cable)(&self.rig).receive_bytes())
    }

    /// Puts a frame of another node on the CAN bus; ignored without one.
    pub fn send_frame_to_module(&self, frame: &CanFrame) {
        if let Some(can_end) = &self.can_end {
            can_end.queue_frame(frame);
        }
    }

    /// Frames that the module has sent on the CAN bus.
    #[must_use]
    pub fn take_module_frames(&self) -> Vec<CanFrame> {
        self.can_end.as_ref().map_or_else(Vec::new, CanEnd::take_received)
    }

    /// Path of a firmware update that the module has handed over since the last call, and the node that has it. The
    /// simulated module has no boot loader: it restarts with the same firmware.
    #[must_use]
    pub fn take_firmware_update(&self) -> Option<(String, u8)> {
        let update = self.rig.firmware_update.take()?;
        Some((String::from_utf8_lossy(update.file_path()).into_owned(), update.server_node.number()))
    }

    /// Executes a pilot command line and returns the answer.
    ///
    /// # Errors
    ///
    /// The command is invalid or not possible now.
    pub fn execute_pilot_line(&mut self, line: &str) -> Result<String, PilotCommandError> {
        match line.parse()? {
            PilotCommand::Help => Ok(pilot_command::help_text()),
            PilotCommand::Status => Ok(self.status_text()),
            command => self.pilot.execute_command(&self.rig.world, command),
        }
    }

    /// Moves the aircraft to the attitude of a datagram `roll_deg pitch_deg yaw_deg [step_s]`; returns the step, which
    /// the caller advances, in microseconds.
    ///
    /// # Errors
    ///
    /// [`DatagramError`] if the datagram is invalid; it is counted and otherwise ignored.
    pub fn follow_datagram(&mut self, datagram: &[u8]) -> Result<Option<u64>, DatagramError> {
        let attitude_datagram = parse_attitude(datagram);
        let external_datagram_counts = self.external_datagram_counts.get_or_insert_default();
        match attitude_datagram {
            Ok(AttitudeDatagram { .. }) => external_datagram_counts.accepted_datagrams += 1,
            Err(_) => external_datagram_counts.rejected_datagrams += 1,
        }
        attitude_datagram.map(|AttitudeDatagram { attitude, step_us }| {
            self.first_attitude_us.get_or_insert(self.rig.now_us());
            self.rig.world.follow_attitude(attitude);
            step_us
        })
    }

    /// Number of bytes that the port accepts now; 0 for an invalid index.
    #[must_use]
    pub fn free_bytes(&self, port: usize) -> usize {
        PORTS
            .get(port)
            .map_or(0, |port| MAX_BYTES_IN_TRANSMISSION.saturating_sub((port.cable)(&self.rig).bytes_in_transit()))
    }

    /// Present flash contents.
    #[must_use]
    pub fn flash_image(&self) -> FlashImage {
        FlashImage(self.rig.flash.flash_contents())
    }

    /// Number of flash operations (programmed words and erased pages).
    #[must_use]
    pub fn flash_change_count(&self) -> u64 {
        self.rig.flash.change_count()
    }

    fn status_text(&self) -> String {
        let truth = self.rig.world.true_state(self.now_us());
        let [roll_deg, pitch_deg] = [truth.roll_rad, truth.pitch_rad].map(f64::to_degrees);
        let seconds = self.now_us() as f64 / 1e6;
        let flies = if self.external_datagram_counts.is_some() { "follows" } else { self.pilot.activity_text() };
        let source = match self.rig.world.sends_attitude() {
            true => "the simulator",
            false if self.attitude == AttitudeProvider::Own => "the module",
            false if self.awaits_datagram() => "nobody yet",
            false => "who is attached",
        };
        let sender_text = self.external_datagram_counts.map_or_else(
            String::new,
            |DatagramCounts { accepted_datagrams: accepted, rejected_datagrams: rejected }| {
                format!("; {accepted} attitudes received, {rejected} malformed")
            },
        );
        format!(
            "ok {seconds:.1} s, {flies}: roll {roll_deg:.1}, pitch {pitch_deg:.1}, magnetic heading {:.1} deg, {:.0} m \
             north and {:.0} m east of the start, motor current {:.1} A; attitude from {source}{sender_text}",
            truth.heading_deg(),
            truth.north_m,
            truth.east_m,
            truth.current_a()
        )
    }

    /// Whether attitude must still be withheld because an external simulator has sent no attitude, or its first one
    /// less than [`FIRST_ATTITUDE_SETTLING_US`] ago. The first attitude moves the aircraft at once, without body rates,
    /// so that older attitudes must not be sent.
    fn awaits_datagram(&self) -> bool {
        let is_early = |first_us| self.rig.now_us() < first_us + FIRST_ATTITUDE_SETTLING_US;
        self.external_datagram_counts.is_some() && self.first_attitude_us.is_none_or(is_early)
    }

    fn select_attitude_sender(&self) {
        let is_provider = match self.attitude {
            AttitudeProvider::Auto => !self.external_autopilot.is_active(self.rig.now_us()),
            AttitudeProvider::Simulator => true,
            AttitudeProvider::Peer | AttitudeProvider::Own => false,
        };
        self.rig.world.set_sends_attitude(is_provider && !self.awaits_datagram());
    }
}

/// Timeout, microseconds. An autopilot without message requests sends attitude once a second.
const ATTITUDE_TIMEOUT_US: u64 = 3_000_000;

/// Detector for messages at the autopilot port.
#[derive(Debug, Default)]
struct ExternalAutopilot {
    receiver: MavlinkReceiver,
    msp: msp::MspReceiver,
    last_message_us: Option<u64>,
}

impl ExternalAutopilot {
    /// Processes bytes received at `now_us`.
    fn process_bytes(&mut self, now_us: u64, bytes: &[u8]) {
        for &byte in bytes {
            let is_attitude = matches!(self.receiver.push_byte(byte), Some(InboundMessage::Attitude(_)));
            if self.msp.push_byte(byte).is_some() || is_attitude {
                self.last_message_us = Some(now_us);
            }
        }
    }

    /// Whether an autopilot has sent within the timeout.
    fn is_active(&self, now_us: u64) -> bool {
        self.last_message_us.is_some_and(|heard_us| now_us - heard_us < ATTITUDE_TIMEOUT_US)
    }
}
