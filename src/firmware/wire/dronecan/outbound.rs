//! Payloads of sent messages and responses.

use super::bit_stream::BitWriter;
use super::inbound::{GetSetValue, Targetted, UNIQUE_ID_LENGTH};
use super::transfer::Payload;
use autoswing_module::messages::Severity;

/// Health of a node.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum NodeHealth {
    /// The node works.
    #[default]
    Ok = 0,
    /// The node does not work; autopilots then refuse to arm.
    Error = 2,
}

/// Mode of a node.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum NodeMode {
    /// Normal operation.
    #[default]
    Operational = 0,
    /// Start-up, before the first reading.
    Initialization = 1,
    /// About to load another firmware.
    SoftwareUpdate = 3,
}

/// State of a node.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct NodeStatus {
    /// Time since the start, seconds.
    pub uptime_s: u32,
    /// Health of the node.
    pub health: NodeHealth,
    /// Operating mode of the node.
    pub node_mode: NodeMode,
    /// Code of the vendor.
    pub vendor_code: u16,
}

impl NodeStatus {
    /// Fields with their widths, bits.
    const fn fields(self) -> [(u64, u32); 5] {
        let (health, mode) = (self.health as u64, self.node_mode as u64);
        [(self.uptime_s as u64, 32), (health, 2), (mode, 3), (0, 3), (self.vendor_code as u64, 16)]
    }

    /// Encoded NodeStatus message.
    #[must_use]
    pub fn payload(self) -> Payload {
        encode_payload(&self.fields(), &[])
    }
}

/// Payload of fields with their widths, bits, and of bytes behind them.
fn encode_payload(fields: &[(u64, u32)], bytes: &[u8]) -> Payload {
    let mut out = BitWriter::default();
    out.put_fields(fields);
    out.put_bytes(bytes);
    out.into_payload()
}

/// Software of a node.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SoftwareVersion {
    /// Major version of the software.
    pub major_version: u8,
    /// Minor version of the software.
    pub minor_version: u8,
    /// First 32 bits of the commit, if known.
    pub commit: Option<u32>,
    /// CRC of the image, if known.
    pub image_crc: Option<u64>,
}

impl SoftwareVersion {
    /// Version of this firmware, with the first 32 bits of its commit, if known.
    #[must_use]
    pub const fn from_firmware(commit: Option<u32>) -> Self {
        const fn parse_number(text: &str) -> u8 {
            match u8::from_str_radix(text, 10) {
                Ok(number) => number,
                Err(_) => 0,
            }
        }
        let (major, minor) =
            (parse_number(env!("CARGO_PKG_VERSION_MAJOR")), parse_number(env!("CARGO_PKG_VERSION_MINOR")));
        Self { major_version: major, minor_version: minor, commit, image_crc: None }
    }

    /// First 32 bits of the commit in a text such as `0.1.0 (148f00e4eb)`.
    #[must_use]
    pub fn parse_commit(text: &str) -> Option<u32> {
        let (_, commit) = text.split_once('(')?;
        u32::from_str_radix(commit.get(..8)?, 16).ok()
    }
}

/// Description of a node.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct NodeInfo {
    /// Name, a reversed domain, at most 80 characters.
    pub node_name: &'static str,
    /// Software version of the node.
    pub software_version: SoftwareVersion,
    /// Major and minor version of the hardware.
    pub hardware_version: [u8; 2],
    /// Unique id of the hardware.
    pub unique_id: [u8; UNIQUE_ID_LENGTH],
}

impl NodeInfo {
    /// Response to GetNodeInfo.
    #[must_use]
    pub fn payload(&self, status: NodeStatus) -> Payload {
        let SoftwareVersion { major_version: major, minor_version: minor, commit, image_crc } = self.software_version;
        let mut out = BitWriter::default();
        out.put_fields(&status.fields());
        out.put_bytes(&[major, minor, u8::from(commit.is_some()) | u8::from(image_crc.is_some()) << 1]);
        out.put_bits(commit.unwrap_or(0).into(), 32);
        out.put_bits(image_crc.unwrap_or(0), 64);
        out.put_bytes(&self.hardware_version);
        out.put_bytes(&self.unique_id);
        // No certificate of authenticity.
        out.put_bytes(&[0]);
        out.put_bytes(self.node_name.as_bytes());
        out.into_payload()
    }
}

/// Request of an allocation: the next part of the unique id.
#[must_use]
pub fn allocation_payload(is_first_part: bool, unique_id_part: &[u8]) -> Payload {
    // A request without a preferred number: the allocator remembers the number of each unique id.
    encode_payload(&[(0, 7), (is_first_part.into(), 1)], unique_id_part)
}

/// Response to GetSet. Without a name the parameter does not exist, and all values are empty.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ParameterResponse<'a> {
    /// Value of the parameter.
    pub value: GetSetValue<'a>,
    /// Default value of the parameter.
    pub default_value: GetSetValue<'a>,
    /// Largest value: an integer, a number, or empty.
    pub max_value: GetSetValue<'a>,
    /// Smallest value: an integer, a number, or empty.
    pub min_value: GetSetValue<'a>,
    /// Name of the parameter.
    pub parameter_name: &'a str,
}

impl ParameterResponse<'_> {
    /// Encoded response to GetSet.
    #[must_use]
    pub fn payload(&self) -> Payload {
        let mut out = BitWriter::default();
        for (value, tag_bits) in [(self.value, 3), (self.default_value, 3), (self.max_value, 2), (self.min_value, 2)] {
            out.put_bits(0, 8 - tag_bits);
            put_value(&mut out, value, tag_bits);
        }
        out.put_bytes(self.parameter_name.as_bytes());
        out.into_payload()
    }
}

fn put_value(out: &mut BitWriter, value: GetSetValue<'_>, tag_bits: u32) {
    match value {
        GetSetValue::Empty => out.put_bits(0, tag_bits),
        GetSetValue::Integer(number) => out.put_fields(&[(1, tag_bits), (number.cast_unsigned(), 64)]),
        GetSetValue::Real(number) => out.put_fields(&[(2, tag_bits), (number.to_bits().into(), 32)]),
        GetSetValue::Boolean(is_on) => out.put_fields(&[(3, tag_bits), (is_on.into(), 8)]),
        GetSetValue::Text(text) => {
            out.put_fields(&[(4, tag_bits), (text.len() as u64, 8)]);
            out.put_bytes(text);
        }
    }
}

/// Response to ExecuteOpcode.
#[must_use]
pub fn opcode_result(is_ok: bool) -> Payload {
    encode_payload(&[(0, 48), (is_ok.into(), 1)], &[])
}

/// Response to RestartNode.
#[must_use]
pub fn restart_result(is_ok: bool) -> Payload {
    encode_payload(&[(is_ok.into(), 1)], &[])
}

/// Counters of a bus since the start.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct BusCounts {
    /// Number of sent frames.
    pub sent_frames: u32,
    /// Number of received frames.
    pub received_frames: u32,
    /// Errors of the bus.
    pub bus_errors: u32,
}

/// Response to GetTransportStats: sent and received transfers, errors; the same of frames for the only bus.
#[must_use]
pub fn transport_stats(transfers: BusCounts, frames: BusCounts) -> Payload {
    let mut out = BitWriter::default();
    for BusCounts { sent_frames: sent, received_frames: received, bus_errors: errors } in [transfers, frames] {
        for count in [sent, received, errors] {
            out.put_bits(count.into(), 48);
        }
    }
    out.into_payload()
}

/// Largest length of a text, bytes.
pub const MAX_LOG_TEXT_LENGTH: usize = 90;

/// Text for people; `source` of at most 31 and `text` of at most 90 bytes.
#[must_use]
pub fn log_message(severity: Severity, source: &str, text: &[u8]) -> Payload {
    let level = match severity {
        Severity::Info => 1,
        Severity::Warning => 2,
    };
    let mut out = BitWriter::default();
    out.put_fields(&[(level, 3), (source.len() as u64, 5)]);
    out.put_bytes(source.as_bytes());
    out.put_bytes(text);
    out.into_payload()
}

/// Magnetic field, gauss, with the variances of the axes, square gauss, if given.
#[must_use]
pub fn magnetic_field(sensor: u8, field_gauss: [f32; 3], variances: Option<[f32; 3]>) -> Payload {
    let mut out = BitWriter::default();
    out.put_bytes(&[sensor]);
    for number in field_gauss.into_iter().chain(variances.into_iter().flatten()) {
        out.put_f16(number);
    }
    out.into_payload()
}

/// Result of a request to load another firmware.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum UpdateResult {
    /// Accepted: the boot loader loads the image.
    Ok = 0,
    /// Rejected: the node's state does not allow an update.
    InvalidMode = 1,
    /// The update has begun.
    InProgress = 2,
    /// Rejected: the request is invalid.
    Unknown = 255,
}

/// Response to BeginFirmwareUpdate, with a reason of at most 80 bytes.
#[must_use]
pub fn update_result(result: UpdateResult, reason: &str) -> Payload {
    encode_payload(&[(result as u64, 8)], reason.as_bytes())
}

impl Targetted<'_> {
    /// Message to a node.
    #[must_use]
    pub fn payload(&self) -> Payload {
        let serial_line = i64::from(self.serial_line).cast_unsigned();
        let fields = [
            (self.protocol.into(), 8),
            (self.target.into(), 7),
            (serial_line, 5),
            (self.tunnel_options.into(), 4),
            (self.baud.into(), 24),
        ];
        encode_payload(&fields, self.serial_bytes)
    }
}
