//! Messages that the module sends, as frames of MAVLink 2.

use mavlink_dialect::{
    ATTITUDE_DATA, COMMAND_ACK_DATA, COMMAND_LONG_DATA, HEARTBEAT_DATA, MavAutopilot, MavCmd, MavDataStream,
    MavParamType, MavResult, MavSeverity, MavState, MavType, MavlinkVersion, NAMED_VALUE_FLOAT_DATA,
    PARAM_REQUEST_READ_DATA, PARAM_SET_DATA, PARAM_VALUE_DATA, PayloadLayout, REQUEST_DATA_STREAM_DATA,
    STATUSTEXT_DATA, VISION_POSITION_ESTIMATE_DATA,
};

use super::frame::{Address, V2_HEADER_LENGTH, V2_START_BYTE, checksum};
use super::parameter::{ParameterEncoding, parameter_bits};
use super::signature::{self, Signatures};
use autoswing::time::Timestamp;
use autoswing::trig::sqrt;
use autoswing_module::messages::ParameterName;
use autoswing_module::settings::{PARAMETERS, Setting, Settings};

/// Longest payload, bytes: VISION_POSITION_ESTIMATE with its covariance.
const MAX_PAYLOAD_LENGTH: usize = 117;

/// Encoded MAVLink frame.
pub type EncodedFrame = heapless::Vec<u8, { V2_HEADER_LENGTH + MAX_PAYLOAD_LENGTH + 2 + signature::SIGNATURE_SIZE }>;

/// Message to send.
#[derive(Clone, Debug)]
pub struct OutboundMessage {
    /// Header and payload; of the header only the message number is set.
    frame: EncodedFrame,
    extra_crc: u8,
}

/// Pose for VISION_POSITION_ESTIMATE.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pose {
    /// Time of the pose.
    pub timestamp: Timestamp,
    /// Roll, pitch and true heading, radians, -pi..pi.
    pub roll_pitch_yaw_rad: [f32; 3],
    /// Variance of the heading, square radians.
    pub yaw_variance_rad2: f32,
    /// Number of heading jumps that the aircraft has not made; wraps.
    pub reset_counter: u8,
}

impl OutboundMessage {
    /// HEARTBEAT of an onboard controller that is no autopilot.
    #[must_use]
    pub fn heartbeat(state: MavState) -> Self {
        Self::new(&HEARTBEAT_DATA {
            mavtype: MavType::MAV_TYPE_ONBOARD_CONTROLLER,
            autopilot: MavAutopilot::MAV_AUTOPILOT_INVALID,
            system_status: state,
            mavlink_version: 3,
            ..HEARTBEAT_DATA::DEFAULT
        })
    }

    /// ATTITUDE: roll, pitch and heading, radians, -pi..pi, and body rates, rad/s; NaN where unknown.
    #[must_use]
    pub fn attitude(at: Timestamp, [roll, pitch, yaw]: [f32; 3], body_rates_rad_s: [f32; 3]) -> Self {
        let [rollspeed, pitchspeed, yawspeed] = body_rates_rad_s;
        let time_boot_ms = at.wrapping_millis().as_ms();
        Self::new(&ATTITUDE_DATA { time_boot_ms, roll, pitch, yaw, rollspeed, pitchspeed, yawspeed })
    }

    /// COMMAND_LONG with MAV_CMD_SET_MESSAGE_INTERVAL: requests a message at a rate, on this link.
    #[must_use]
    pub fn set_message_interval(target: Address, message_id: u32, rate_hz: u8) -> Self {
        let interval_us = 1e6 / f32::from(rate_hz.max(1));
        Self::new(&COMMAND_LONG_DATA {
            param1: message_id as f32,
            param2: interval_us,
            ..command_to(target, MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL)
        })
    }

    /// COMMAND_LONG with MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN: restarts the autopilot.
    #[must_use]
    pub fn autopilot_restart(target: Address) -> Self {
        let command = command_to(target, MavCmd::MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN);
        Self::new(&COMMAND_LONG_DATA { param1: 1.0, ..command })
    }

    /// MAV_CMD_EXTERNAL_ATTITUDE_ESTIMATE, of the development dialect.
    pub const EXTERNAL_ATTITUDE_ESTIMATE: MavCmd = MavCmd(620);

    /// COMMAND_LONG with MAV_CMD_EXTERNAL_ATTITUDE_ESTIMATE: resets the yaw to that of a pose; roll and pitch stay.
    #[must_use]
    pub fn external_yaw_estimate(target: Address, pose: &Pose) -> Self {
        let [_, _, yaw_rad] = pose.roll_pitch_yaw_rad;
        let yaw_deg = yaw_rad.to_degrees();
        Self::new(&COMMAND_LONG_DATA {
            param1: f32::NAN,
            param2: f32::NAN,
            param3: if yaw_deg < 0.0 { yaw_deg + 360.0 } else { yaw_deg },
            param4: f32::NAN,
            param5: f32::NAN,
            param6: f32::NAN,
            param7: sqrt(pose.yaw_variance_rad2).to_degrees(),
            ..command_to(target, Self::EXTERNAL_ATTITUDE_ESTIMATE)
        })
    }

    /// REQUEST_DATA_STREAM: requests the stream that contains ATTITUDE (`STREAM_EXTRA1`) at a rate. Superseded; it is for
    /// autopilots without the successor.
    #[must_use]
    pub fn request_attitude_stream(target: Address, rate_hz: u8) -> Self {
        Self::new(&REQUEST_DATA_STREAM_DATA {
            req_message_rate: rate_hz.into(),
            target_system: target.system_id,
            target_component: target.component_id,
            req_stream_id: MavDataStream::MAV_DATA_STREAM_EXTRA1,
            start_stop: 1,
        })
    }

    /// PARAM_REQUEST_READ: requests a parameter by its name.
    #[must_use]
    pub fn parameter_request(target: Address, name: ParameterName) -> Self {
        const BY_NAME: i16 = -1;
        Self::new(&PARAM_REQUEST_READ_DATA {
            param_index: BY_NAME,
            target_system: target.system_id,
            target_component: target.component_id,
            param_id: name.0.into(),
        })
    }

    /// PARAM_SET: changes a parameter of this kind.
    #[must_use]
    pub fn parameter_change(
        target: Address,
        name: ParameterName,
        number: f32,
        kind: MavParamType,
        encoding: ParameterEncoding,
    ) -> Self {
        Self::new(&PARAM_SET_DATA {
            param_value: f32::from_bits(parameter_bits(number, kind, encoding)),
            target_system: target.system_id,
            target_component: target.component_id,
            param_id: name.0.into(),
            param_type: kind,
        })
    }

    /// PARAM_VALUE: a setting of the module, as a float, and its index.
    #[must_use]
    pub fn parameter_value(setting: &Setting, settings: &Settings) -> Self {
        Self::new(&PARAM_VALUE_DATA {
            param_value: setting.value(settings).to_number(),
            param_count: PARAMETERS.len() as u16,
            param_index: PARAMETERS.iter().take_while(|parameter| *parameter != setting).count() as u16,
            param_id: setting.parameter_name.into(),
            param_type: MavParamType::MAV_PARAM_TYPE_REAL32,
        })
    }

    /// COMMAND_ACK for a received command.
    #[must_use]
    pub fn acknowledgement(target: Address, command: u16, result: MavResult) -> Self {
        Self::new(&COMMAND_ACK_DATA {
            command: MavCmd(command),
            result,
            target_system: target.system_id,
            target_component: target.component_id,
            ..COMMAND_ACK_DATA::DEFAULT
        })
    }

    /// Capacity of a STATUSTEXT, characters.
    pub const STATUSTEXT_CAPACITY: usize = 50;

    /// STATUSTEXT: a chunk of a text, cut at 50 characters. The chunks of a longer text share a number other than 0,
    /// and the first chunk that is not full is the last.
    #[must_use]
    pub fn status_text(severity: MavSeverity, chunk: &[u8], text_id: u16, chunk_index: u8) -> Self {
        let mut text = [0; Self::STATUSTEXT_CAPACITY];
        text.iter_mut().zip(chunk).for_each(|(target, source)| *target = *source);
        Self::new(&STATUSTEXT_DATA { severity, text: text.into(), id: text_id, chunk_seq: chunk_index })
    }

    /// NAMED_VALUE_FLOAT; the name is cut at ten characters.
    #[must_use]
    pub fn named_value(at: Timestamp, name: &str, value: f32) -> Self {
        let time_boot_ms = at.wrapping_millis().as_ms();
        Self::new(&NAMED_VALUE_FLOAT_DATA { time_boot_ms, value, name: name.into() })
    }

    /// VISION_POSITION_ESTIMATE at the origin, of which only the heading is known. ArduPilot reads a covariance whose first
    /// element is a number: the angle's error is then the root of the sum of the angles' variances.
    #[must_use]
    pub fn pose_estimate(pose: &Pose) -> Self {
        /// Variance of an unknown position, square metres.
        const POSITION_VARIANCE_M2: f32 = 1e6;
        let [roll, pitch, yaw] = pose.roll_pitch_yaw_rad;
        // Upper right triangle over x, y, z, roll, pitch, yaw.
        let mut covariance = [0.0; 21];
        (covariance[0], covariance[6], covariance[11]) =
            (POSITION_VARIANCE_M2, POSITION_VARIANCE_M2, POSITION_VARIANCE_M2);
        covariance[20] = pose.yaw_variance_rad2;
        Self::new(&VISION_POSITION_ESTIMATE_DATA {
            usec: pose.timestamp.as_us(),
            roll,
            pitch,
            yaw,
            covariance,
            reset_counter: pose.reset_counter,
            ..VISION_POSITION_ESTIMATE_DATA::DEFAULT
        })
    }

    /// A message of the dialect, without the zeros at its end.
    pub fn new<M: PayloadLayout>(data: &M) -> Self {
        const { assert!(M::V2_LENGTH <= MAX_PAYLOAD_LENGTH, "the capacity is that of the longest message") };
        let mut payload = [0; MAX_PAYLOAD_LENGTH];
        let payload_length = data.ser(MavlinkVersion::V2, &mut payload);
        Self::from_payload(M::ID, M::EXTRA_CRC, payload.get(..payload_length).unwrap_or_default())
    }

    fn from_payload(id: u32, extra_crc: u8, payload: &[u8]) -> Self {
        let [id_0, id_1, id_2, _] = id.to_le_bytes();
        let mut frame = EncodedFrame::new();
        let _ = frame.extend_from_slice(&[V2_START_BYTE, 0, 0, 0, 0, 0, 0, id_0, id_1, id_2]);
        // The capacity is that of the longest message.
        let _ = frame.extend_from_slice(payload);
        Self { frame, extra_crc }
    }

    /// Sets sender and sequence number, appends the CRC and, with a key, the signature.
    #[must_use]
    pub fn into_frame(mut self, sender: Address, sequence: u8, signatures: &mut Signatures) -> EncodedFrame {
        let payload_length = self.frame.len() - V2_HEADER_LENGTH;
        if let [_, length, flags, _, number, system, component, ..] = self.frame.as_mut_slice() {
            *flags = if signatures.has_key() { signature::SIGNED_FLAG } else { 0 };
            (*length, *number) = (payload_length as u8, sequence);
            (*system, *component) = (sender.system_id, sender.component_id);
        }
        let crc = checksum(self.frame.get(1..).unwrap_or_default(), self.extra_crc);
        // The capacity includes CRC and signature.
        let _ = self.frame.extend_from_slice(&crc.to_le_bytes());
        signatures.sign_frame(&mut self.frame);
        self.frame
    }
}

fn command_to(target: Address, command: MavCmd) -> COMMAND_LONG_DATA {
    let Address { system_id: target_system, component_id: target_component } = target;
    COMMAND_LONG_DATA { command, target_system, target_component, ..COMMAND_LONG_DATA::DEFAULT }
}
