//! Received messages, and the decoding of their payloads.
//!
//! Numbers, lengths and CRC extra bytes of messages are the dialect's. Its deserialisers are not used: they decode all
//! fields of a message.

use core::array::from_fn;

use mavlink_dialect::{
    ATTITUDE_DATA, BATTERY_STATUS_DATA, COMMAND_ACK_DATA, COMMAND_INT_DATA, COMMAND_LONG_DATA,
    GLOBAL_POSITION_INT_DATA, HEARTBEAT_DATA, MavAutopilot, MavModeFlag, MavParamType, NAMED_VALUE_FLOAT_DATA,
    PARAM_REQUEST_LIST_DATA, PARAM_REQUEST_READ_DATA, PARAM_SET_DATA, PARAM_VALUE_DATA, PayloadLengths,
    SYS_STATUS_DATA, SYSTEM_TIME_DATA,
};

use super::frame::Address;
use super::parameter::ReceivedParameter;
use autoswing::attitude::{AttitudeReport, BodyRates, Heartbeat, SenderId};
use autoswing::earth::{Date, Position};
use autoswing::frames::RollPitch;
use autoswing::time::WrappingMillis;
use autoswing_module::messages::ParameterName;

/// Decoded message.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum InboundMessage {
    /// ATTITUDE: roll, pitch and body rates.
    Attitude(AttitudeReport),
    /// HEARTBEAT: kind of sender, armed state, and the firmware of an autopilot.
    Heartbeat(Heartbeat, MavAutopilot),
    /// GLOBAL_POSITION_INT: position of the sender, if known.
    Position(SenderId, Option<Position>),
    /// SYSTEM_TIME: date of the sender, if known.
    Date(SenderId, Option<Date>),
    /// SYS_STATUS, or BATTERY_STATUS of the first battery: current, amperes, if measured.
    Current(SenderId, Option<f32>),
    /// COMMAND_LONG or COMMAND_INT.
    Command(ReceivedCommand),
    /// COMMAND_ACK.
    Acknowledgement(Acknowledgement),
    /// PARAM_VALUE: parameter of the sender.
    Parameter(SenderId, ReceivedParameter),
    /// NAMED_VALUE_FLOAT, with its sender's clock.
    NamedValue(SenderId, WrappingMillis),
    /// PARAM_REQUEST_LIST, PARAM_REQUEST_READ or PARAM_SET, and its addressee.
    ParameterRequest(Address, ReceivedParameterRequest),
}

/// Received command.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ReceivedCommand {
    /// Sender of the command.
    pub sender_id: SenderId,
    /// Addressee of the command.
    pub target: Address,
    /// Number of the command (`MAV_CMD`).
    pub command_number: u16,
    /// Number of repetitions of an unacknowledged command; 0 in a COMMAND_INT, which has none.
    pub confirmation: u8,
    /// First four parameters, which have the same meaning in both messages.
    pub parameters: [f32; 4],
}

/// Request for the parameters of an addressee.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ReceivedParameterRequest {
    /// Send all.
    List,
    /// Send one.
    Read {
        /// Name, if the index is negative.
        name: ParameterName,
        /// Position in the list.
        index: i16,
    },
    /// Change one.
    Write(ReceivedParameter),
}

/// Result of a command.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Acknowledgement {
    /// Sender of the acknowledgement.
    pub sender_id: SenderId,
    /// Addressee; all in version 1, which does not contain it.
    pub target: Address,
    /// Number of the acknowledged command (`MAV_CMD`).
    pub command_number: u16,
    /// `MAV_RESULT` number, unknown ones included.
    pub result: u8,
}

pub(super) struct MessageSpec {
    pub message_id: u32,
    /// Payload length in version 1, bytes.
    pub payload_length: usize,
    /// Payload length with the extension fields of version 2, before zeros are truncated, bytes.
    pub extended_length: usize,
    pub extra_crc: u8,
    /// Decodes a sender's payload; none if its values are impossible.
    pub decoder: fn(SenderId, &[u8]) -> Option<InboundMessage>,
}

impl MessageSpec {
    const fn from_dialect<M: PayloadLengths>(decode: fn(SenderId, &[u8]) -> Option<InboundMessage>) -> Self {
        Self {
            message_id: M::ID,
            payload_length: M::V1_LENGTH,
            extended_length: M::V2_LENGTH,
            extra_crc: M::EXTRA_CRC,
            decoder: decode,
        }
    }
}

/// Supported messages, the most frequent first.
pub(super) const SUPPORTED_MESSAGES: [MessageSpec; 14] = [
    MessageSpec::from_dialect::<ATTITUDE_DATA>(parse_attitude),
    MessageSpec::from_dialect::<SYS_STATUS_DATA>(parse_system_status),
    MessageSpec::from_dialect::<HEARTBEAT_DATA>(parse_heartbeat),
    MessageSpec::from_dialect::<GLOBAL_POSITION_INT_DATA>(parse_global_position),
    MessageSpec::from_dialect::<BATTERY_STATUS_DATA>(parse_battery_status),
    MessageSpec::from_dialect::<SYSTEM_TIME_DATA>(parse_date),
    MessageSpec::from_dialect::<NAMED_VALUE_FLOAT_DATA>(parse_named_value),
    MessageSpec::from_dialect::<COMMAND_LONG_DATA>(parse_command_long),
    MessageSpec::from_dialect::<COMMAND_INT_DATA>(parse_command_int),
    MessageSpec::from_dialect::<COMMAND_ACK_DATA>(parse_acknowledgement),
    MessageSpec::from_dialect::<PARAM_VALUE_DATA>(parse_parameter),
    MessageSpec::from_dialect::<PARAM_REQUEST_READ_DATA>(parse_parameter_read),
    MessageSpec::from_dialect::<PARAM_REQUEST_LIST_DATA>(parse_parameter_list),
    MessageSpec::from_dialect::<PARAM_SET_DATA>(parse_parameter_write),
];

/// Longest payload of a supported message, bytes.
pub(super) const MAX_PAYLOAD_LENGTH: usize = {
    let mut longest = 0;
    let mut at = 0;
    while at < SUPPORTED_MESSAGES.len() {
        if SUPPORTED_MESSAGES[at].extended_length > longest {
            longest = SUPPORTED_MESSAGES[at].extended_length;
        }
        at += 1;
    }
    longest
};

/// Payload, read by field, little endian; truncated bytes are zero.
struct PayloadReader<'a>(&'a [u8]);

impl PayloadReader<'_> {
    fn read_u8(&self, offset: usize) -> u8 {
        self.0.get(offset).copied().unwrap_or(0)
    }

    fn read_u16(&self, offset: usize) -> u16 {
        u16::from_le_bytes([self.read_u8(offset), self.read_u8(offset + 1)])
    }

    fn read_u32(&self, offset: usize) -> u32 {
        // Only the last fields of a truncated payload are incomplete.
        match self.0.get(offset..).and_then(|rest| rest.first_chunk()) {
            Some(whole) => u32::from_le_bytes(*whole),
            None => u32::from_le_bytes(from_fn(|byte| self.read_u8(offset + byte))),
        }
    }

    fn read_f32(&self, offset: usize) -> f32 {
        f32::from_bits(self.read_u32(offset))
    }

    /// Signed integer, multiplied by its unit.
    fn read_scaled_integer(&self, offset: usize, unit: f32) -> f32 {
        self.read_u32(offset).cast_signed() as f32 * unit
    }

    fn read_name(&self, offset: usize) -> ParameterName {
        ParameterName(from_fn(|byte| self.read_u8(offset + byte)))
    }

    /// Value at the start, name, and kind behind the name.
    fn read_parameter(&self, name_offset: usize) -> ReceivedParameter {
        ReceivedParameter {
            name: self.read_name(name_offset),
            value_bits: self.read_u32(0),
            kind: MavParamType(self.read_u8(name_offset + size_of::<ParameterName>())),
        }
    }

    fn read_address(&self, offset: usize) -> Address {
        Address { system_id: self.read_u8(offset), component_id: self.read_u8(offset + 1) }
    }
}

fn parse_attitude(source: SenderId, payload: &[u8]) -> Option<InboundMessage> {
    const ROLL_OFFSET: usize = 4;
    const PITCH_OFFSET: usize = 8;
    const RATES_OFFSET: usize = 16;
    let fields = PayloadReader(payload);
    let (roll_rad, pitch_rad) = (fields.read_f32(ROLL_OFFSET), fields.read_f32(PITCH_OFFSET));
    let rate_rad_s = |axis| fields.read_f32(RATES_OFFSET + 4 * axis);
    let is_possible = roll_rad.abs() <= MAX_ROLL_RAD && pitch_rad.abs() <= MAX_PITCH_RAD;
    is_possible.then(|| {
        InboundMessage::Attitude(AttitudeReport {
            sender: source,
            sender_clock_at_sending: WrappingMillis::new(fields.read_u32(0)),
            attitude: RollPitch { roll_rad, pitch_rad },
            body_rates: BodyRates::from_rad_s(from_fn(rate_rad_s)),
        })
    })
}

/// Largest roll, radians, with a margin for rounding; the comparison also rejects NaN.
const MAX_ROLL_RAD: f32 = core::f32::consts::PI + 0.001;
/// Largest pitch, radians, with a margin for rounding.
const MAX_PITCH_RAD: f32 = core::f32::consts::FRAC_PI_2 + 0.001;

/// Whether a MAV_TYPE is of a component and not of a vehicle: ground station, companion, gimbal, ADS-B, cameras and
/// peripherals (common.xml). A component has no armed state.
const fn is_component(mav_type: u8) -> bool {
    matches!(mav_type, 6 | 18 | 26 | 27 | 30..=34 | 36..=42)
}

#[expect(clippy::unnecessary_wraps, reason = "one of the table's decoders")]
fn parse_heartbeat(source: SenderId, payload: &[u8]) -> Option<InboundMessage> {
    const TYPE_OFFSET: usize = 4;
    const AUTOPILOT_OFFSET: usize = 5;
    const BASE_MODE_OFFSET: usize = 6;
    let fields = PayloadReader(payload);
    let autopilot = MavAutopilot(fields.read_u8(AUTOPILOT_OFFSET));
    let heartbeat = Heartbeat {
        sender: source,
        is_autopilot: autopilot != MavAutopilot::MAV_AUTOPILOT_INVALID && !is_component(fields.read_u8(TYPE_OFFSET)),
        is_armed: fields.read_u8(BASE_MODE_OFFSET) & MavModeFlag::MAV_MODE_FLAG_SAFETY_ARMED.bits() != 0,
    };
    Some(InboundMessage::Heartbeat(heartbeat, autopilot))
}

/// Latitude and longitude in 1e-7 deg, height above mean sea level in millimetres.
#[expect(clippy::unnecessary_wraps, reason = "one of the table's decoders")]
fn parse_global_position(source: SenderId, payload: &[u8]) -> Option<InboundMessage> {
    const LATITUDE_OFFSET: usize = 4;
    const LONGITUDE_OFFSET: usize = 8;
    const HEIGHT_OFFSET: usize = 12;
    let fields = PayloadReader(payload);
    let (latitude_deg, longitude_deg) =
        (fields.read_scaled_integer(LATITUDE_OFFSET, 1e-7), fields.read_scaled_integer(LONGITUDE_OFFSET, 1e-7));
    Some(InboundMessage::Position(
        source,
        Position::new(latitude_deg, longitude_deg, fields.read_scaled_integer(HEIGHT_OFFSET, 1e-3)),
    ))
}

#[expect(clippy::unnecessary_wraps, reason = "one of the table's decoders")]
fn parse_system_status(source: SenderId, payload: &[u8]) -> Option<InboundMessage> {
    const BATTERY_CURRENT_OFFSET: usize = 16;
    Some(InboundMessage::Current(
        source,
        amperes_from_centiamperes(PayloadReader(payload).read_u16(BATTERY_CURRENT_OFFSET)),
    ))
}

/// Ignores batteries other than the first, whose current SYS_STATUS has.
#[expect(clippy::unnecessary_wraps, reason = "one of the table's decoders")]
fn parse_battery_status(source: SenderId, payload: &[u8]) -> Option<InboundMessage> {
    const BATTERY_CURRENT_OFFSET: usize = 30;
    const BATTERY_ID_OFFSET: usize = 32;
    let fields = PayloadReader(payload);
    let is_first = fields.read_u8(BATTERY_ID_OFFSET) == 0;
    Some(InboundMessage::Current(
        source,
        amperes_from_centiamperes(fields.read_u16(BATTERY_CURRENT_OFFSET)).filter(|_| is_first),
    ))
}

/// Converts hundredths of an ampere; -1 means unknown.
fn amperes_from_centiamperes(centiamperes: u16) -> Option<f32> {
    let centiamperes = centiamperes.cast_signed();
    (centiamperes != -1).then_some(f32::from(centiamperes) * 0.01)
}

/// Unix time in microseconds.
#[expect(clippy::unnecessary_wraps, reason = "one of the table's decoders")]
fn parse_date(source: SenderId, payload: &[u8]) -> Option<InboundMessage> {
    let fields = PayloadReader(payload);
    let unix_us = u64::from(fields.read_u32(4)) << 32 | u64::from(fields.read_u32(0));
    Some(InboundMessage::Date(source, Date::from_unix_s(unix_us / 1_000_000)))
}

#[expect(clippy::unnecessary_wraps, reason = "one of the table's decoders")]
fn parse_named_value(source: SenderId, payload: &[u8]) -> Option<InboundMessage> {
    Some(InboundMessage::NamedValue(source, WrappingMillis::new(PayloadReader(payload).read_u32(0))))
}

#[expect(clippy::unnecessary_wraps, reason = "one of the table's decoders")]
fn parse_command_long(source: SenderId, payload: &[u8]) -> Option<InboundMessage> {
    const CONFIRMATION_OFFSET: usize = 32;
    Some(InboundMessage::Command(parse_command(source, payload, PayloadReader(payload).read_u8(CONFIRMATION_OFFSET))))
}

/// Decodes COMMAND_INT, which has a coordinate frame in the place of COMMAND_LONG's confirmation; the fields before it
/// are equal.
#[expect(clippy::unnecessary_wraps, reason = "one of the table's decoders")]
fn parse_command_int(source: SenderId, payload: &[u8]) -> Option<InboundMessage> {
    Some(InboundMessage::Command(parse_command(source, payload, 0)))
}

fn parse_command(source: SenderId, payload: &[u8], confirmation: u8) -> ReceivedCommand {
    const COMMAND_OFFSET: usize = 28;
    const TARGET_OFFSET: usize = 30;
    let fields = PayloadReader(payload);
    ReceivedCommand {
        sender_id: source,
        target: fields.read_address(TARGET_OFFSET),
        command_number: fields.read_u16(COMMAND_OFFSET),
        confirmation,
        parameters: from_fn(|parameter| fields.read_f32(4 * parameter)),
    }
}

#[expect(clippy::unnecessary_wraps, reason = "one of the table's decoders")]
fn parse_acknowledgement(source: SenderId, payload: &[u8]) -> Option<InboundMessage> {
    const COMMAND_OFFSET: usize = 0;
    const RESULT_OFFSET: usize = 2;
    const TARGET_OFFSET: usize = 8;
    let fields = PayloadReader(payload);
    Some(InboundMessage::Acknowledgement(Acknowledgement {
        sender_id: source,
        target: fields.read_address(TARGET_OFFSET),
        command_number: fields.read_u16(COMMAND_OFFSET),
        result: fields.read_u8(RESULT_OFFSET),
    }))
}

#[expect(clippy::unnecessary_wraps, reason = "one of the table's decoders")]
fn parse_parameter(source: SenderId, payload: &[u8]) -> Option<InboundMessage> {
    const NAME_OFFSET: usize = 8;
    Some(InboundMessage::Parameter(source, PayloadReader(payload).read_parameter(NAME_OFFSET)))
}

#[expect(clippy::unnecessary_wraps, reason = "one of the table's decoders")]
fn parse_parameter_read(_: SenderId, payload: &[u8]) -> Option<InboundMessage> {
    const TARGET_OFFSET: usize = 2;
    const NAME_OFFSET: usize = 4;
    let fields = PayloadReader(payload);
    let request =
        ReceivedParameterRequest::Read { name: fields.read_name(NAME_OFFSET), index: fields.read_u16(0).cast_signed() };
    Some(InboundMessage::ParameterRequest(fields.read_address(TARGET_OFFSET), request))
}

#[expect(clippy::unnecessary_wraps, reason = "one of the table's decoders")]
fn parse_parameter_list(_: SenderId, payload: &[u8]) -> Option<InboundMessage> {
    Some(InboundMessage::ParameterRequest(PayloadReader(payload).read_address(0), ReceivedParameterRequest::List))
}

#[expect(clippy::unnecessary_wraps, reason = "one of the table's decoders")]
fn parse_parameter_write(_: SenderId, payload: &[u8]) -> Option<InboundMessage> {
    const TARGET_OFFSET: usize = 4;
    const NAME_OFFSET: usize = 6;
    let fields = PayloadReader(payload);
    let request = ReceivedParameterRequest::Write(fields.read_parameter(NAME_OFFSET));
    Some(InboundMessage::ParameterRequest(fields.read_address(TARGET_OFFSET), request))
}
