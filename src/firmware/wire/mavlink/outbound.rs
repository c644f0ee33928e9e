//! Messages that the module sends, as frames of MAVLink 2.
//!
//! The dialect's serialisers check each field for room. Here payloads are assembled in wire order:
//! largest fields first, extension fields last (mavlink.io, "Serialization"). Message numbers and CRC extra bytes are the
//! dialect's, if it has them.

use mavlink_dialect::{
    ATTITUDE_DATA, COMMAND_ACK_DATA, COMMAND_LONG_DATA, HEARTBEAT_DATA, MAG_CAL_REPORT_DATA, MagCalStatus,
    MavAutopilot, MavCmd, MavDataStream, MavParamType, MavResult, MavSeverity, MavState, MavType, MessageData,
    NAMED_VALUE_FLOAT_DATA, PARAM_REQUEST_READ_DATA, PARAM_SET_DATA, PARAM_VALUE_DATA, REQUEST_DATA_STREAM_DATA,
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

/// Result of a calibration for MAG_CAL_REPORT: `corrected = M (raw + offset)`, in body axes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MagCalReport {
    /// Whether a new calibration was stored.
    pub is_success: bool,
    /// RMS residual of an axis, milligauss.
    pub fitness_mg: f32,
    /// Offset added to the raw field, milligauss.
    pub offset_mg: [f32; 3],
    /// Diagonal of `M`: xx, yy, zz.
    pub diagonal: [f32; 3],
    /// Off-diagonal elements of `M`, which is symmetric: xy, xz, yz.
    pub off_diagonal: [f32; 3],
}

impl OutboundMessage {
    /// HEARTBEAT of an onboard controller that is no autopilot.
    #[must_use]
    pub fn heartbeat(state: MavState) -> Self {
        const MAVLINK_VERSION: u8 = 3;
        let (kind, autopilot) = (MavType::MAV_TYPE_ONBOARD_CONTROLLER, MavAutopilot::MAV_AUTOPILOT_INVALID);
        let mut message = Self::from_dialect::<HEARTBEAT_DATA>();
        message.put_bytes(&[0, 0, 0, 0, kind.0, autopilot.0, 0, state.0, MAVLINK_VERSION]);
        message
    }

    /// ATTITUDE: roll, pitch and heading, radians, -pi..pi, and body rates, rad/s; NaN where unknown.
    #[must_use]
    pub fn attitude(at: Timestamp, roll_pitch_yaw_rad: [f32; 3], body_rates_rad_s: [f32; 3]) -> Self {
        let mut message = Self::from_dialect::<ATTITUDE_DATA>();
        message.put_bytes(&at.wrapping_millis().as_ms().to_le_bytes());
        message.put_floats(&roll_pitch_yaw_rad);
        message.put_floats(&body_rates_rad_s);
        message
    }

    /// COMMAND_LONG with MAV_CMD_SET_MESSAGE_INTERVAL: requests a message at a rate, on this link.
    #[must_use]
    pub fn set_message_interval(target: Address, message_id: u32, rate_hz: u8) -> Self {
        let interval_us = 1e6 / f32::from(rate_hz.max(1));
        Self::command_long(target, MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL, [message_id as f32, interval_us])
    }

    /// COMMAND_LONG with MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN: restarts the autopilot.
    #[must_use]
    pub fn autopilot_restart(target: Address) -> Self {
        Self::command_long(target, MavCmd::MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN, [1.0, 0.0])
    }

    /// MAV_CMD_EXTERNAL_ATTITUDE_ESTIMATE, of the development dialect.
    pub const EXTERNAL_ATTITUDE_ESTIMATE: MavCmd = MavCmd(620);

    /// COMMAND_LONG with MAV_CMD_EXTERNAL_ATTITUDE_ESTIMATE: resets the yaw to that of a pose; roll and pitch stay.
    #[must_use]
    pub fn external_yaw_estimate(target: Address, pose: &Pose) -> Self {
        let [_, _, yaw_rad] = pose.roll_pitch_yaw_rad;
        let yaw_deg = yaw_rad.to_degrees();
        let yaw_deg = if yaw_deg < 0.0 { yaw_deg + 360.0 } else { yaw_deg };
        let sigma_deg = sqrt(pose.yaw_variance_rad2).to_degrees();
        let parameters = [f32::NAN, f32::NAN, yaw_deg, f32::NAN, f32::NAN, f32::NAN, sigma_deg];
        Self::command_with_parameters(target, Self::EXTERNAL_ATTITUDE_ESTIMATE, &parameters)
    }

    /// COMMAND_LONG; only the first two parameters are not zero.
    fn command_long(target: Address, command: MavCmd, [first, second]: [f32; 2]) -> Self {
        Self::command_with_parameters(target, command, &[first, second, 0.0, 0.0, 0.0, 0.0, 0.0])
    }

    fn command_with_parameters(target: Address, command: MavCmd, parameters: &[f32; 7]) -> Self {
        let mut message = Self::from_dialect::<COMMAND_LONG_DATA>();
        message.put_floats(parameters);
        message.put_bytes(&command.0.to_le_bytes());
        message.put_bytes(&[target.system_id, target.component_id, 0]);
        message
    }

    /// REQUEST_DATA_STREAM: requests the stream that contains ATTITUDE (`STREAM_EXTRA1`) at a rate.
    #[must_use]
    pub fn request_attitude_stream(target: Address, rate_hz: u8) -> Self {
        const START_SENDING: u8 = 1;
        // Superseded; it is for autopilots without the successor.
        let mut message = Self::from_dialect::<REQUEST_DATA_STREAM_DATA>();
        let stream = MavDataStream::MAV_DATA_STREAM_EXTRA1.0;
        message.put_bytes(&[rate_hz, 0, target.system_id, target.component_id, stream, START_SENDING]);
        message
    }

    /// PARAM_REQUEST_READ: requests a parameter by its name.
    #[must_use]
    pub fn parameter_request(target: Address, name: ParameterName) -> Self {
        const BY_NAME: i16 = -1;
        let mut message = Self::from_dialect::<PARAM_REQUEST_READ_DATA>();
        message.put_bytes(&BY_NAME.to_le_bytes());
        message.put_bytes(&[target.system_id, target.component_id]);
        message.put_bytes(&name.0);
        message
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
        let mut message = Self::from_dialect::<PARAM_SET_DATA>();
        message.put_bytes(&parameter_bits(number, kind, encoding).to_le_bytes());
        message.put_bytes(&[target.system_id, target.component_id]);
        message.put_bytes(&name.0);
        message.put_bytes(&[kind.0]);
        message
    }

    /// PARAM_VALUE: a setting of the module, as a float, and its index.
    #[must_use]
    pub fn parameter_value(setting: &Setting, settings: &Settings) -> Self {
        let index = PARAMETERS.iter().take_while(|parameter| *parameter != setting).count() as u8;
        let mut message = Self::from_dialect::<PARAM_VALUE_DATA>();
        message.put_floats(&[setting.value(settings).to_number()]);
        message.put_bytes(&[PARAMETERS.len() as u8, 0, index, 0]);
        message.put_bytes(&ParameterName::new(setting.parameter_name).0);
        message.put_bytes(&[MavParamType::MAV_PARAM_TYPE_REAL32.0]);
        message
    }

    /// COMMAND_ACK for a received command.
    #[must_use]
    pub fn acknowledgement(target: Address, command: u16, result: MavResult) -> Self {
        let mut message = Self::from_dialect::<COMMAND_ACK_DATA>();
        message.put_bytes(&command.to_le_bytes());
        // The fields for progress and second result are unused.
        message.put_bytes(&[result.0, 0, 0, 0, 0, 0, target.system_id, target.component_id]);
        message
    }

    /// Capacity of a STATUSTEXT, characters.
    pub const STATUSTEXT_CAPACITY: usize = 50;

    /// STATUSTEXT: a chunk of a text, cut at 50 characters. The chunks of a longer text share a number other than 0,
    /// and the first chunk that is not full is the last.
    #[must_use]
    pub fn status_text(severity: MavSeverity, chunk: &[u8], text_id: u16, chunk_index: u8) -> Self {
        let mut text = [0; Self::STATUSTEXT_CAPACITY];
        text.iter_mut().zip(chunk).for_each(|(target, source)| *target = *source);
        let mut message = Self::from_dialect::<STATUSTEXT_DATA>();
        message.put_bytes(&[severity.0]);
        message.put_bytes(&text);
        message.put_bytes(&text_id.to_le_bytes());
        message.put_bytes(&[chunk_index]);
        message
    }

    /// NAMED_VALUE_FLOAT; the name is cut at ten characters.
    #[must_use]
    pub fn named_value(at: Timestamp, name: &str, value: f32) -> Self {
        let mut field = [0; 10];
        field.iter_mut().zip(name.bytes()).for_each(|(target, source)| *target = source);
        let mut message = Self::from_dialect::<NAMED_VALUE_FLOAT_DATA>();
        message.put_bytes(&at.wrapping_millis().as_ms().to_le_bytes());
        message.put_floats(&[value]);
        message.put_bytes(&field);
        message
    }

    /// MAG_CAL_PROGRESS of compass 0: progress, percent, and direction of the field in body axes. The mask of sampled
    /// directions is unused.
    #[must_use]
    pub fn mag_cal_progress(percent: u8, direction: [f32; 3]) -> Self {
        // Number and CRC extra byte from ArduPilot's dialect.
        let mut message = Self::new(191, 92);
        let status =
            if percent < 100 { MagCalStatus::MAG_CAL_RUNNING_STEP_ONE } else { MagCalStatus::MAG_CAL_RUNNING_STEP_TWO };
        message.put_floats(&direction);
        message.put_bytes(&[0, COMPASS_MASK, status.0, 1, percent]);
        message
    }

    /// MAG_CAL_REPORT of compass 0.
    #[must_use]
    pub fn mag_cal_report(report: &MagCalReport) -> Self {
        let mut message = Self::from_dialect::<MAG_CAL_REPORT_DATA>();
        let status = if report.is_success { MagCalStatus::MAG_CAL_SUCCESS } else { MagCalStatus::MAG_CAL_FAILED };
        message.put_floats(&[report.fitness_mg]);
        for three in [&report.offset_mg, &report.diagonal, &report.off_diagonal] {
            message.put_floats(three);
        }
        message.put_bytes(&[0, COMPASS_MASK, status.0, u8::from(report.is_success)]);
        message
    }

    /// VISION_POSITION_ESTIMATE at the origin, of which only the heading is known. ArduPilot reads a covariance whose first
    /// element is a number: the angle's error is then the root of the sum of the angles' variances.
    #[must_use]
    pub fn pose_estimate(pose: &Pose) -> Self {
        /// Variance of an unknown position, square metres.
        const POSITION_VARIANCE_M2: f32 = 1e6;
        /// Upper right triangle over x, y, z, roll, pitch, yaw without its last element, the variance of yaw.
        const COVARIANCE_BEFORE_YAW: [f32; 20] = {
            let mut covariance = [0.0; 20];
            (covariance[0], covariance[6], covariance[11]) =
                (POSITION_VARIANCE_M2, POSITION_VARIANCE_M2, POSITION_VARIANCE_M2);
            covariance
        };
        let mut message = Self::from_dialect::<VISION_POSITION_ESTIMATE_DATA>();
        message.put_bytes(&pose.timestamp.as_us().to_le_bytes());
        message.put_floats(&[0.0; 3]);
        message.put_floats(&pose.roll_pitch_yaw_rad);
        message.put_floats(&COVARIANCE_BEFORE_YAW);
        message.put_floats(&[pose.yaw_variance_rad2]);
        message.put_bytes(&[pose.reset_counter]);
        message
    }

    /// Sets sender and sequence number, truncates trailing zeros, appends the CRC and, with a key, the signature.
    #[must_use]
    pub fn into_frame(mut self, sender: Address, sequence: u8, signatures: &mut Signatures) -> EncodedFrame {
        // At least one byte of payload remains.
        while self.frame.len() > V2_HEADER_LENGTH + 1 && self.frame.last() == Some(&0) {
            self.frame.pop();
        }
        let payload = self.frame.len() - V2_HEADER_LENGTH;
        if let [_, length, flags, _, number, system, component, ..] = self.frame.as_mut_slice() {
            *flags = if signatures.has_key() { signature::SIGNED_FLAG } else { 0 };
            (*length, *number) = (payload as u8, sequence);
            (*system, *component) = (sender.system_id, sender.component_id);
        }
        let crc = checksum(self.frame.get(1..).unwrap_or_default(), self.extra_crc);
        self.put_bytes(&crc.to_le_bytes());
        signatures.sign_frame(&mut self.frame);
        self.frame
    }

    fn from_dialect<M: MessageData>() -> Self {
        Self::new(M::ID, M::EXTRA_CRC)
    }

    fn new(id: u32, extra_crc: u8) -> Self {
        let [id_0, id_1, id_2, _] = id.to_le_bytes();
        let mut message = Self { frame: heapless::Vec::new(), extra_crc };
        message.put_bytes(&[V2_START_BYTE, 0, 0, 0, 0, 0, 0, id_0, id_1, id_2]);
        message
    }

    fn put_bytes(&mut self, bytes: &[u8]) {
        // The capacity is that of the longest message.
        let _ = self.frame.extend_from_slice(bytes);
    }

    fn put_floats(&mut self, numbers: &[f32]) {
        for number in numbers {
            self.put_bytes(&number.to_le_bytes());
        }
    }
}

const COMPASS_MASK: u8 = 1;
