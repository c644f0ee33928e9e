//! Simulated autopilot with bidirectional MAVLink and the attitude of a [`SimulatedAttitudeSource`].
//!
//! A pure state machine: the caller passes time and bytes. It answers message requests as real firmwares do, as far as
//! the module can observe. [`FarEnd`](super::cable_far_end::FarEnd) attaches it to a cable.

use mavlink_dialect::{
    ATTITUDE_DATA, COMMAND_ACK_DATA, COMMAND_LONG_DATA, GLOBAL_POSITION_INT_DATA, HEARTBEAT_DATA, MavAutopilot, MavCmd,
    MavDataStream, MavMessage, MavResult, MavlinkVersion, Message, MessageData, SYS_STATUS_DATA, SYSTEM_TIME_DATA,
};

use super::attitude_source::SimulatedAttitudeSource;
pub use super::earth::{ReportedPosition, START_UNIX_US, XIAN_POSITION};
pub use super::mavlink_frame::{FrameReader, MavlinkFrame};
use super::parameter_table::ParameterTable;
use super::state::TrueState;

/// Autopilot firmware, which determines the handling of message requests.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MavlinkFirmware {
    /// ArduPilot, aeroplane: attitude at 1 Hz until requested; requests above 80 % of the loop's rate are denied
    /// (`GCS_MAVLINK::cap_message_interval`), which is 50 Hz by default.
    ArduPilot,
    /// PX4 in mode "Onboard": attitude at 100 Hz without request; accepts all requests.
    Px4,
    /// Ignores SET_MESSAGE_INTERVAL without an answer, but supports REQUEST_DATA_STREAM.
    StreamsOnly,
    /// Ignores all requests; attitude at 1 Hz.
    IgnoresRequests,
}

impl MavlinkFirmware {
    const fn default_rate_hz(self) -> f64 {
        match self {
            Self::Px4 => 100.0,
            Self::ArduPilot | Self::StreamsOnly | Self::IgnoresRequests => 1.0,
        }
    }

    const fn announced_firmware(self) -> MavAutopilot {
        match self {
            Self::Px4 => MavAutopilot::MAV_AUTOPILOT_PX4,
            Self::ArduPilot | Self::StreamsOnly | Self::IgnoresRequests => MavAutopilot::MAV_AUTOPILOT_ARDUPILOTMEGA,
        }
    }

    fn parameters(self) -> ParameterTable {
        match self {
            Self::ArduPilot => ParameterTable::ardupilot(),
            Self::Px4 => ParameterTable::px4(),
            Self::StreamsOnly | Self::IgnoresRequests => ParameterTable::empty(false),
        }
    }
}

#[derive(Clone, Copy, Debug)]
struct PeriodicMessage {
    id: u32,
    period_us: u64,
    due_us: u64,
}

const REQUESTABLE_MESSAGES: [u32; 5] =
    [HEARTBEAT_DATA::ID, SYS_STATUS_DATA::ID, ATTITUDE_DATA::ID, GLOBAL_POSITION_INT_DATA::ID, SYSTEM_TIME_DATA::ID];

/// Sensor inputs of the autopilot.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct AutopilotInputs {
    /// True state on which the attitude estimate is based.
    pub true_state: TrueState,
    /// Whether the autopilot is armed.
    pub is_armed: bool,
    /// Battery current, amperes; `None` without a current sensor.
    pub current_a: Option<f64>,
}

const HEARTBEAT_PERIOD_US: u64 = 1_000_000;

/// MAVLink autopilot.
pub struct MavlinkAutopilot {
    source: SimulatedAttitudeSource,
    firmware: MavlinkFirmware,
    reported_position: Option<ReportedPosition>,
    started_us: u64,
    /// Shortest interval of a message, microseconds.
    least_interval_us: f32,
    streams: Vec<PeriodicMessage>,
    reader: FrameReader,
    pending_answer_bytes: Vec<u8>,
    received_frames: Vec<MavlinkFrame>,
    denied_request_count: u32,
    /// Number of restarts by command.
    pub restart_count: u32,
    /// Parameters of the autopilot.
    pub parameters: ParameterTable,
    /// Whether PX4 knows `MAV_CMD_EXTERNAL_ATTITUDE_ESTIMATE`, as from version 1.17 on.
    pub knows_yaw_estimates: bool,
    /// Yaw and its sigma of each such command, degrees.
    pub yaw_estimates_deg: Vec<[f32; 2]>,
}

impl MavlinkAutopilot {
    /// An autopilot switched on at `now_us`, located in Xi'an.
    #[must_use]
    pub fn new(source: SimulatedAttitudeSource, firmware: MavlinkFirmware, now_us: u64) -> Self {
        let mut autopilot = Self {
            source: source.with_firmware(firmware.announced_firmware()),
            firmware,
            reported_position: Some(XIAN_POSITION),
            started_us: now_us,
            least_interval_us: 1_000.0,
            streams: Vec::new(),
            reader: FrameReader::default(),
            pending_answer_bytes: Vec::new(),
            received_frames: Vec::new(),
            denied_request_count: 0,
            restart_count: 0,
            parameters: firmware.parameters(),
            knows_yaw_estimates: firmware == MavlinkFirmware::Px4,
            yaw_estimates_deg: Vec::new(),
        };
        autopilot.restart_autopilot(now_us);
        autopilot
    }

    /// Restarts: resets the boot clock and all requested streams.
    pub fn restart_autopilot(&mut self, now_us: u64) {
        self.started_us = now_us;
        if let Some(loop_rate_hz) = self.parameters.number("SCHED_LOOP_RATE") {
            self.least_interval_us = (1e6 / 0.8 / loop_rate_hz) as f32;
        }
        self.streams = vec![PeriodicMessage { id: HEARTBEAT_DATA::ID, period_us: HEARTBEAT_PERIOD_US, due_us: now_us }];
        self.start_stream(ATTITUDE_DATA::ID, self.firmware.default_rate_hz(), now_us);
        self.pending_answer_bytes.clear();
    }

    /// Sets the reported position; `None` means no position fix.
    pub fn set_position(&mut self, reported_position: Option<ReportedPosition>) {
        self.reported_position = reported_position;
    }

    /// Rate of a periodic message, Hz; `None` if it is not sent.
    #[must_use]
    pub fn message_rate_hz(&self, id: u32) -> Option<f64> {
        self.streams.iter().find(|stream| stream.id == id).map(|stream| 1e6 / stream.period_us as f64)
    }

    /// Requests that were denied as too fast. ArduPilot warns its pilot of each: "Requested rate ... too fast".
    #[must_use]
    pub const fn denied_request_count(&self) -> u32 {
        self.denied_request_count
    }

    /// Returns and clears the received frames.
    pub fn take_received(&mut self) -> Vec<MavlinkFrame> {
        std::mem::take(&mut self.received_frames)
    }

    /// Number of received bytes outside valid frames.
    #[must_use]
    pub fn invalid_byte_count(&self) -> u64 {
        self.reader.invalid_byte_count()
    }

    /// Changes a parameter as a ground station does: the autopilot reports the change to all.
    pub fn change_parameter(&mut self, name: &str, number: f64) {
        let report = self.parameters.set_number(name, number);
        self.pending_answer_bytes.extend(self.source.encode_message(&report));
    }

    /// Handles bytes received at `now_us`.
    pub fn receive_bytes(&mut self, now_us: u64, bytes: &[u8]) {
        for frame in self.reader.read_frames(bytes) {
            self.handle_frame(now_us, &frame);
            self.received_frames.push(frame);
        }
    }

    /// Time of the next message; 0 if an answer is pending.
    #[must_use]
    pub fn due_us(&self) -> u64 {
        let streams = self.streams.iter().map(|stream| stream.due_us);
        streams.min().filter(|_| self.pending_answer_bytes.is_empty()).unwrap_or(0)
    }

    /// Messages due at `now_us`; `modify_message` modifies each attitude message.
    pub fn due_messages(
        &mut self,
        now_us: u64,
        inputs: &AutopilotInputs,
        mut modify_message: impl FnMut(&mut ATTITUDE_DATA),
    ) -> Vec<u8> {
        let mut bytes = std::mem::take(&mut self.pending_answer_bytes);
        let clock_us = now_us - self.started_us;
        for stream_index in 0..self.streams.len() {
            let PeriodicMessage { id, period_us, due_us } = self.streams[stream_index];
            if due_us > now_us {
                continue;
            }
            self.streams[stream_index].due_us = (due_us + period_us).max(now_us + 1);
            bytes.extend(match id {
                HEARTBEAT_DATA::ID => self.source.heartbeat_message(inputs.is_armed),
                ATTITUDE_DATA::ID => {
                    let mut attitude = self.source.attitude_message(&inputs.true_state, clock_us);
                    self.subtract_trims(&mut attitude);
                    modify_message(&mut attitude);
                    self.source.encode_message(&attitude)
                }
                SYS_STATUS_DATA::ID => self.source.status_message(inputs.current_a),
                GLOBAL_POSITION_INT_DATA::ID => self.source.position_message(self.reported_position, clock_us),
                _ => self.source.time_message(now_us, clock_us),
            });
        }
        bytes
    }

    fn handle_frame(&mut self, now_us: u64, frame: &MavlinkFrame) {
        if self.firmware == MavlinkFirmware::IgnoresRequests {
            return;
        }
        let message = MavMessage::parse(MavlinkVersion::V2, frame.message_id, &frame.payload);
        if let Ok(message) = message
            && let (Some(system), Some(component)) = (message.target_system_id(), message.target_component_id())
            && [system, component] == [self.source.identity.system_id, self.source.identity.component_id]
        {
            match &message {
                MavMessage::COMMAND_LONG(command) => self.execute_command(now_us, frame, command),
                MavMessage::REQUEST_DATA_STREAM(request)
                    if request.req_stream_id == MavDataStream::MAV_DATA_STREAM_EXTRA1 =>
                {
                    let max_hz = 1e6 / f64::from(self.least_interval_us);
                    self.start_stream(ATTITUDE_DATA::ID, f64::from(request.req_message_rate).min(max_hz), now_us);
                }
                _ => {}
            }
            for reply in self.parameters.replies(&message) {
                self.pending_answer_bytes.extend(self.source.encode_message(&reply));
            }
        }
    }

    /// Subtracts the trims as ArduPilot does (`NavEKF3_core::getEulerAngles`, `GCS_MAVLINK_Plane::send_attitude`).
    fn subtract_trims(&self, attitude: &mut ATTITUDE_DATA) {
        const UNTRIMMED_PITCH_OPTION: u32 = 256;
        let number = |name| self.parameters.number(name).unwrap_or(0.0);
        attitude.roll -= number("AHRS_TRIM_X") as f32;
        attitude.pitch -= number("AHRS_TRIM_Y") as f32;
        if number("FLIGHT_OPTIONS") as u32 & UNTRIMMED_PITCH_OPTION == 0 {
            attitude.pitch -= number("PTCH_TRIM_DEG").to_radians() as f32;
        }
    }

    fn execute_command(&mut self, now_us: u64, frame: &MavlinkFrame, command: &COMMAND_LONG_DATA) {
        if self.firmware == MavlinkFirmware::StreamsOnly {
            return;
        }
        if command.command == MavCmd::MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN {
            self.restart_count += 1;
            self.restart_autopilot(now_us);
            return;
        }
        let result = if command.command == EXTERNAL_ATTITUDE_ESTIMATE {
            self.yaw_estimates_deg.push([command.param3, command.param7]);
            if self.knows_yaw_estimates { MavResult::MAV_RESULT_ACCEPTED } else { MavResult::MAV_RESULT_UNSUPPORTED }
        } else if command.command != MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL {
            MavResult::MAV_RESULT_UNSUPPORTED
        } else if command.param2 < self.least_interval_us {
            self.denied_request_count += 1;
            MavResult::MAV_RESULT_DENIED
        } else if !REQUESTABLE_MESSAGES.contains(&(command.param1 as u32)) {
            MavResult::MAV_RESULT_FAILED
        } else {
            self.start_stream(command.param1 as u32, 1e6 / f64::from(command.param2), now_us);
            MavResult::MAV_RESULT_ACCEPTED
        };
        let (target_system, target_component) = (frame.system_id, frame.component_id);
        self.pending_answer_bytes.extend(self.source.encode_message(&COMMAND_ACK_DATA {
            command: command.command,
            result,
            target_system,
            target_component,
            ..COMMAND_ACK_DATA::default()
        }));
    }

    fn start_stream(&mut self, id: u32, rate_hz: f64, now_us: u64) {
        if id == ATTITUDE_DATA::ID {
            self.source.set_rate_hz(rate_hz);
        }
        let period_us = (1e6 / rate_hz).round() as u64;
        self.streams.retain(|stream| stream.id != id);
        self.streams.push(PeriodicMessage { id, period_us, due_us: now_us + period_us });
    }
}

/// `MAV_CMD_EXTERNAL_ATTITUDE_ESTIMATE` of the development dialect.
const EXTERNAL_ATTITUDE_ESTIMATE: MavCmd = MavCmd(620);

#[cfg(test)]
mod tests;
