//! Received messages, and the meaning of their fields.

use mavlink_dialect::{
    ATTITUDE_DATA, BATTERY_STATUS_DATA, COMMAND_ACK_DATA, COMMAND_INT_DATA, COMMAND_LONG_DATA, CharArray,
    GLOBAL_POSITION_INT_DATA, HEARTBEAT_DATA, MavAutopilot, MavModeFlag, MavParamType, NAMED_VALUE_FLOAT_DATA,
    PARAM_REQUEST_LIST_DATA, PARAM_REQUEST_READ_DATA, PARAM_SET_DATA, PARAM_VALUE_DATA, PayloadLayout, SYS_STATUS_DATA,
    SYSTEM_TIME_DATA,
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

/// Longest payload of a supported message, bytes: BATTERY_STATUS.
pub(super) const MAX_PAYLOAD_LENGTH: usize = BATTERY_STATUS_DATA::V2_LENGTH;

/// Payload with zeros in place of the fields that were not sent.
pub(super) type PaddedPayload = [u8; MAX_PAYLOAD_LENGTH];

pub(super) struct MessageSpec {
    pub message_id: u32,
    /// Payload length in version 1, bytes.
    pub payload_length: usize,
    /// Payload length with the extension fields of version 2, before zeros are truncated, bytes.
    pub extended_length: usize,
    pub extra_crc: u8,
    /// Decodes a sender's payload, filled up with zeros; none if its values are impossible.
    pub decoder: fn(SenderId, &PaddedPayload) -> Option<InboundMessage>,
}

impl MessageSpec {
    const fn new<M: ReceivedData>() -> Self {
        assert!(M::V2_LENGTH <= MAX_PAYLOAD_LENGTH, "there is a longer message");
        Self {
            message_id: M::ID,
            payload_length: M::V1_LENGTH,
            extended_length: M::V2_LENGTH,
            extra_crc: M::EXTRA_CRC,
            decoder: decode_payload::<M>,
        }
    }
}

fn decode_payload<M: ReceivedData>(source: SenderId, payload: &PaddedPayload) -> Option<InboundMessage> {
    M::from_padded(payload).into_message(source)
}

/// Supported messages, the most frequent first.
pub(super) const SUPPORTED_MESSAGES: [MessageSpec; 14] = [
    MessageSpec::new::<ATTITUDE_DATA>(),
    MessageSpec::new::<SYS_STATUS_DATA>(),
    MessageSpec::new::<HEARTBEAT_DATA>(),
    MessageSpec::new::<GLOBAL_POSITION_INT_DATA>(),
    MessageSpec::new::<BATTERY_STATUS_DATA>(),
    MessageSpec::new::<SYSTEM_TIME_DATA>(),
    MessageSpec::new::<NAMED_VALUE_FLOAT_DATA>(),
    MessageSpec::new::<COMMAND_LONG_DATA>(),
    MessageSpec::new::<COMMAND_INT_DATA>(),
    MessageSpec::new::<COMMAND_ACK_DATA>(),
    MessageSpec::new::<PARAM_VALUE_DATA>(),
    MessageSpec::new::<PARAM_REQUEST_READ_DATA>(),
    MessageSpec::new::<PARAM_REQUEST_LIST_DATA>(),
    MessageSpec::new::<PARAM_SET_DATA>(),
];

/// Message of the dialect that is received.
trait ReceivedData: PayloadLayout {
    /// Meaning of the message of a sender; none if its values are impossible.
    fn into_message(self, source: SenderId) -> Option<InboundMessage>;
}

/// Largest roll, radians, with a margin for rounding; the comparison also rejects NaN.
const MAX_ROLL_RAD: f32 = core::f32::consts::PI + 0.001;
/// Largest pitch, radians, with a margin for rounding.
const MAX_PITCH_RAD: f32 = core::f32::consts::FRAC_PI_2 + 0.001;

impl ReceivedData for ATTITUDE_DATA {
    fn into_message(self, source: SenderId) -> Option<InboundMessage> {
        let is_possible = self.roll.abs() <= MAX_ROLL_RAD && self.pitch.abs() <= MAX_PITCH_RAD;
        is_possible.then(|| {
            InboundMessage::Attitude(AttitudeReport {
                sender: source,
                sender_clock_at_sending: WrappingMillis::new(self.time_boot_ms),
                attitude: RollPitch { roll_rad: self.roll, pitch_rad: self.pitch },
                body_rates: BodyRates::from_rad_s([self.rollspeed, self.pitchspeed, self.yawspeed]),
            })
        })
    }
}

/// Whether a MAV_TYPE is of a component and not of a vehicle: ground station, companion, gimbal, ADS-B, cameras and
/// peripherals (common.xml). A component has no armed state.
const fn is_component(mav_type: u8) -> bool {
    matches!(mav_type, 6 | 18 | 26 | 27 | 30..=34 | 36..=42)
}

impl ReceivedData for HEARTBEAT_DATA {
    fn into_message(self, source: SenderId) -> Option<InboundMessage> {
        let heartbeat = Heartbeat {
            sender: source,
            is_autopilot: self.autopilot != MavAutopilot::MAV_AUTOPILOT_INVALID && !is_component(self.mavtype.0),
            is_armed: self.base_mode.bits() & MavModeFlag::MAV_MODE_FLAG_SAFETY_ARMED.bits() != 0,
        };
        Some(InboundMessage::Heartbeat(heartbeat, self.autopilot))
    }
}

/// Latitude and longitude in 1e-7 deg, height above mean sea level in millimetres.
impl ReceivedData for GLOBAL_POSITION_INT_DATA {
    fn into_message(self, source: SenderId) -> Option<InboundMessage> {
        let [latitude_deg, longitude_deg] = [self.lat, self.lon].map(|number| number as f32 * 1e-7);
        Some(InboundMessage::Position(source, Position::new(latitude_deg, longitude_deg, self.alt as f32 * 1e-3)))
    }
}

impl ReceivedData for SYS_STATUS_DATA {
    fn into_message(self, source: SenderId) -> Option<InboundMessage> {
        Some(InboundMessage::Current(source, amperes_from_centiamperes(self.current_battery)))
    }
}

/// Batteries other than the first, whose current SYS_STATUS has, are ignored.
impl ReceivedData for BATTERY_STATUS_DATA {
    fn into_message(self, source: SenderId) -> Option<InboundMessage> {
        let current_a = amperes_from_centiamperes(self.current_battery).filter(|_| self.id == 0);
        Some(InboundMessage::Current(source, current_a))
    }
}

/// Converts hundredths of an ampere; -1 means unknown.
fn amperes_from_centiamperes(centiamperes: i16) -> Option<f32> {
    (centiamperes != -1).then_some(f32::from(centiamperes) * 0.01)
}

impl ReceivedData for SYSTEM_TIME_DATA {
    fn into_message(self, source: SenderId) -> Option<InboundMessage> {
        Some(InboundMessage::Date(source, Date::from_unix_s(self.time_unix_usec / 1_000_000)))
    }
}

impl ReceivedData for NAMED_VALUE_FLOAT_DATA {
    fn into_message(self, source: SenderId) -> Option<InboundMessage> {
        Some(InboundMessage::NamedValue(source, WrappingMillis::new(self.time_boot_ms)))
    }
}

impl ReceivedData for COMMAND_LONG_DATA {
    fn into_message(self, source: SenderId) -> Option<InboundMessage> {
        Some(InboundMessage::Command(ReceivedCommand {
            sender_id: source,
            target: Address { system_id: self.target_system, component_id: self.target_component },
            command_number: self.command.0,
            confirmation: self.confirmation,
            parameters: [self.param1, self.param2, self.param3, self.param4],
        }))
    }
}

impl ReceivedData for COMMAND_INT_DATA {
    fn into_message(self, source: SenderId) -> Option<InboundMessage> {
        Some(InboundMessage::Command(ReceivedCommand {
            sender_id: source,
            target: Address { system_id: self.target_system, component_id: self.target_component },
            command_number: self.command.0,
            confirmation: 0,
            parameters: [self.param1, self.param2, self.param3, self.param4],
        }))
    }
}

impl ReceivedData for COMMAND_ACK_DATA {
    fn into_message(self, source: SenderId) -> Option<InboundMessage> {
        Some(InboundMessage::Acknowledgement(Acknowledgement {
            sender_id: source,
            target: Address { system_id: self.target_system, component_id: self.target_component },
            command_number: self.command.0,
            result: self.result.0,
        }))
    }
}

fn received_parameter(name: CharArray<16>, value: f32, kind: MavParamType) -> ReceivedParameter {
    ReceivedParameter { name: ParameterName(name.into()), value_bits: value.to_bits(), kind }
}

impl ReceivedData for PARAM_VALUE_DATA {
    fn into_message(self, source: SenderId) -> Option<InboundMessage> {
        let parameter = received_parameter(self.param_id, self.param_value, self.param_type);
        Some(InboundMessage::Parameter(source, parameter))
    }
}

impl ReceivedData for PARAM_REQUEST_READ_DATA {
    fn into_message(self, _: SenderId) -> Option<InboundMessage> {
        let target = Address { system_id: self.target_system, component_id: self.target_component };
        let name = ParameterName(self.param_id.into());
        let request = ReceivedParameterRequest::Read { name, index: self.param_index };
        Some(InboundMessage::ParameterRequest(target, request))
    }
}

impl ReceivedData for PARAM_REQUEST_LIST_DATA {
    fn into_message(self, _: SenderId) -> Option<InboundMessage> {
        let target = Address { system_id: self.target_system, component_id: self.target_component };
        Some(InboundMessage::ParameterRequest(target, ReceivedParameterRequest::List))
    }
}

impl ReceivedData for PARAM_SET_DATA {
    fn into_message(self, _: SenderId) -> Option<InboundMessage> {
        let target = Address { system_id: self.target_system, component_id: self.target_component };
        let parameter = received_parameter(self.param_id, self.param_value, self.param_type);
        Some(InboundMessage::ParameterRequest(target, ReceivedParameterRequest::Write(parameter)))
    }
}
