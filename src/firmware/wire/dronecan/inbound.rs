//! Received messages and requests, and the decoding of their payloads. Missing values at the end of a payload are zero
//! or empty, further bytes are ignored.
#![expect(clippy::unnecessary_wraps, reason = "the table's decoders have one signature")]

use super::bit_stream::BitReader;
use super::frame::NodeId;
use super::transfer::DataType;
use autoswing::earth::{Date, Position};

/// Length of a unique id, bytes.
pub const UNIQUE_ID_LENGTH: usize = 16;

/// Longest name of a parameter in a request, bytes.
const MAX_NAME_LENGTH: usize = 92;

/// Longest path of a firmware image, bytes.
pub const MAX_PATH_LENGTH: usize = 200;

/// Number that a request for a restart must contain.
const RESTART_MAGIC: u64 = 0xAC_CE55_1B1E;

/// Decoded message or request.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum BusMessage<'a> {
    /// Step of a dynamic allocation of node numbers.
    Allocation(Allocation<'a>),
    /// Request for the description of this node.
    GetNodeInfo,
    /// Request to read or write a parameter.
    GetSet(GetSetRequest<'a>),
    /// Request to save or to reset all parameters.
    ExecuteOpcode(ParameterOpcode),
    /// Request to restart; false without the number that confirms it.
    RestartNode(bool),
    /// Request for the counters of frames.
    GetTransportStats,
    /// Request to load a firmware image from a file server.
    BeginFirmwareUpdate {
        /// Node that serves the image file; `None` for the sender itself.
        server: Option<NodeId>,
        /// Path of the file.
        path: &'a [u8],
    },
    /// Bytes of a serial line.
    Targetted(Targetted<'a>),
    /// Whether the vehicle is armed.
    ArmingStatus(bool),
    /// State of a battery.
    Battery {
        /// Number of the battery at its node.
        battery_number: u8,
        /// Current, amperes, if measured.
        current_a: Option<f32>,
    },
    /// Position and date, each if known.
    Fix(Option<Position>, Option<Date>),
}

/// Step of an allocation.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Allocation<'a> {
    /// Allocated number; `None` until the unique id is complete.
    pub node: Option<NodeId>,
    /// Unique id, or its first bytes.
    pub unique_id: &'a [u8],
}

/// Request to read or write a parameter.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GetSetRequest<'a> {
    /// Position of the parameter; ignored if there is a name.
    pub parameter_index: u16,
    /// New value; empty to read.
    pub value: GetSetValue<'a>,
    /// Name, if not empty.
    pub parameter_name: &'a [u8],
}

/// Value of a parameter.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum GetSetValue<'a> {
    /// No value.
    #[default]
    Empty,
    /// Integer value.
    Integer(i64),
    /// Floating-point value.
    Real(f32),
    /// Boolean value.
    Boolean(bool),
    /// Text value.
    Text(&'a [u8]),
}

/// Operation on all parameters.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ParameterOpcode {
    /// Saves all parameters.
    Save,
    /// Reset to the defaults.
    Erase,
    /// Unknown operation.
    Other,
}

/// Bytes of a serial line between two nodes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Targetted<'a> {
    /// Kind of the bytes.
    pub protocol: u8,
    /// Number of the node to which the bytes are addressed.
    pub target: u8,
    /// Number of the serial line, -16 to 15; -1 is the default one.
    pub serial_line: i8,
    /// Option bits of the tunnel.
    pub tunnel_options: u8,
    /// Baud rate of the serial line, bits per second.
    pub baud: u32,
    /// Bytes of the serial line.
    pub serial_bytes: &'a [u8],
}

impl Targetted<'_> {
    /// Bytes are MAVLink, version 1 or 2.
    pub const MAVLINK_PROTOCOL: u8 = 0;
    /// Bytes are MAVLink 2.
    pub const MAVLINK_2_PROTOCOL: u8 = 1;
    /// Largest number of bytes of a message.
    pub const MAX_DATA_LENGTH: usize = 120;
}

/// Data type with its decoder.
pub(super) struct ReceivedType {
    pub data_type: DataType,
    pub decoder: for<'a> fn(&'a [u8]) -> Option<BusMessage<'a>>,
}

impl ReceivedType {
    const fn new(data_type: DataType, decode: for<'a> fn(&'a [u8]) -> Option<BusMessage<'a>>) -> Self {
        Self { data_type, decoder: decode }
    }
}

/// Received data types, the most frequent first.
static RECEIVED_TYPES: [ReceivedType; 11] = [
    ReceivedType::new(DataType::TARGETTED, parse_targetted),
    ReceivedType::new(DataType::ARMING_STATUS, parse_arming_status),
    ReceivedType::new(DataType::BATTERY_INFO, parse_battery_info),
    ReceivedType::new(DataType::FIX_2, parse_fix),
    ReceivedType::new(DataType::ALLOCATION, parse_allocation),
    ReceivedType::new(DataType::GET_NODE_INFO, |_| Some(BusMessage::GetNodeInfo)),
    ReceivedType::new(DataType::GET_SET, parse_get_set),
    ReceivedType::new(DataType::EXECUTE_OPCODE, parse_opcode),
    ReceivedType::new(DataType::RESTART_NODE, parse_restart),
    ReceivedType::new(DataType::GET_TRANSPORT_STATS, |_| Some(BusMessage::GetTransportStats)),
    ReceivedType::new(DataType::BEGIN_FIRMWARE_UPDATE, parse_firmware_update),
];

/// Received type with this number; of an anonymous message only the two low bits are known, and allocation is the only
/// one.
pub(super) fn find_type(is_service: bool, id: u16, is_anonymous: bool) -> Option<&'static ReceivedType> {
    RECEIVED_TYPES.iter().find(|received| {
        let DataType { type_id: known, is_service: is_known_service, .. } = received.data_type;
        (is_known_service, known) == (is_service, id) && (!is_anonymous || received.data_type == DataType::ALLOCATION)
    })
}

fn parse_allocation(payload: &[u8]) -> Option<BusMessage<'_>> {
    let mut fields = BitReader::new(payload);
    let node = NodeId::new(fields.read_bits(7) as u8);
    let _is_first_part = fields.read_bits(1);
    let unique_id = fields.read_remaining_bytes();
    (unique_id.len() <= UNIQUE_ID_LENGTH).then_some(BusMessage::Allocation(Allocation { node, unique_id }))
}

fn parse_get_set(payload: &[u8]) -> Option<BusMessage<'_>> {
    let mut fields = BitReader::new(payload);
    let index = fields.read_bits(13) as u16;
    let value = match fields.read_bits(3) {
        0 => GetSetValue::Empty,
        1 => GetSetValue::Integer(fields.read_bits(64).cast_signed()),
        2 => GetSetValue::Real(f32::from_bits(fields.read_bits(32) as u32)),
        3 => GetSetValue::Boolean(fields.read_bits(8) != 0),
        4 => {
            let length = fields.read_bits(8) as usize;
            let text = fields.read_bytes(length);
            (text.len() == length).then_some(GetSetValue::Text(text))?
        }
        _ => return None,
    };
    let name = fields.read_remaining_bytes();
    (name.len() <= MAX_NAME_LENGTH).then_some(BusMessage::GetSet(GetSetRequest {
        parameter_index: index,
        value,
        parameter_name: name,
    }))
}

fn parse_opcode(payload: &[u8]) -> Option<BusMessage<'_>> {
    Some(BusMessage::ExecuteOpcode(match BitReader::new(payload).read_bits(8) {
        0 if !payload.is_empty() => ParameterOpcode::Save,
        1 => ParameterOpcode::Erase,
        _ => ParameterOpcode::Other,
    }))
}

fn parse_restart(payload: &[u8]) -> Option<BusMessage<'_>> {
    Some(BusMessage::RestartNode(BitReader::new(payload).read_bits(40) == RESTART_MAGIC))
}

fn parse_firmware_update(payload: &[u8]) -> Option<BusMessage<'_>> {
    let mut fields = BitReader::new(payload);
    let server = NodeId::new(fields.read_bits(8) as u8);
    Some(BusMessage::BeginFirmwareUpdate { server, path: fields.read_remaining_bytes() })
}

fn parse_targetted(payload: &[u8]) -> Option<BusMessage<'_>> {
    let mut fields = BitReader::new(payload);
    let message = Targetted {
        protocol: fields.read_bits(8) as u8,
        target: fields.read_bits(7) as u8,
        serial_line: fields.read_signed(5) as i8,
        tunnel_options: fields.read_bits(4) as u8,
        baud: fields.read_bits(24) as u32,
        serial_bytes: fields.read_remaining_bytes(),
    };
    (message.serial_bytes.len() <= Targetted::MAX_DATA_LENGTH).then_some(BusMessage::Targetted(message))
}

fn parse_arming_status(payload: &[u8]) -> Option<BusMessage<'_>> {
    match payload {
        [0, ..] => Some(BusMessage::ArmingStatus(false)),
        [255, ..] => Some(BusMessage::ArmingStatus(true)),
        _ => None,
    }
}

/// Temperature, voltage, current, four more numbers, flags and percentages, then the number of the battery.
fn parse_battery_info(payload: &[u8]) -> Option<BusMessage<'_>> {
    const BYTES_BEFORE_CURRENT: usize = 4;
    const BYTES_FROM_CURRENT_TO_ID: usize = 12;
    let mut fields = BitReader::new(payload);
    fields.read_bytes(BYTES_BEFORE_CURRENT);
    let current_a = Some(fields.read_f16()).filter(|current_a| current_a.is_finite());
    fields.read_bytes(BYTES_FROM_CURRENT_TO_ID);
    Some(BusMessage::Battery { battery_number: fields.read_bits(8) as u8, current_a })
}

/// Times of the node and of the satellites in microseconds, longitude and latitude in 1e-8 deg, heights in millimetres.
fn parse_fix(payload: &[u8]) -> Option<BusMessage<'_>> {
    const TIME_STANDARD_UTC: u64 = 2;
    const VELOCITY_BITS: u32 = 96;
    const STATUS_3D_FIX: u64 = 3;
    let mut fields = BitReader::new(payload);
    fields.read_bits(56);
    let (satellite_us, time_standard) = (fields.read_bits(56), fields.read_bits(3));
    fields.read_bits(13 + 8);
    let [longitude_deg, latitude_deg] = [(); 2].map(|()| (fields.read_signed(37) as f64 * 1e-8) as f32);
    fields.read_bits(27);
    let height_m = fields.read_signed(27) as f32 / 1000.0;
    for _ in 0..VELOCITY_BITS / 32 {
        fields.read_bits(32);
    }
    fields.read_bits(6);
    let has_fix = fields.read_bits(2) == STATUS_3D_FIX;
    let date = (time_standard == TIME_STANDARD_UTC).then(|| Date::from_unix_s(satellite_us / 1_000_000)).flatten();
    let position = has_fix.then(|| Position::new(latitude_deg, longitude_deg, height_m)).flatten();
    Some(BusMessage::Fix(position, date))
}
