//! Transfers to send: data types, CRC, division into frames.

use crc::{CRC_16_IBM_3740, Crc, Table};

use super::frame::{CanFrame, FRAME_CAPACITY, FrameHeader, NodeId, TailByte, TransferKind};

/// Longest sent payload, bytes: a tunnelled piece with its header.
pub const PAYLOAD_CAPACITY: usize = 128;

/// Sent payload.
pub type Payload = heapless::Vec<u8, PAYLOAD_CAPACITY>;

/// Payload bytes of a frame, before its tail byte.
const FRAME_PAYLOAD_LENGTH: usize = FRAME_CAPACITY - 1;

/// Bytes of the CRC that begins a transfer of several frames.
pub(super) const CRC_LENGTH: usize = 2;

/// CRC-16-CCITT without a table, for few transfers a second.
const CRC: Crc<u16, Table<0>> = Crc::<u16, Table<0>>::new(&CRC_16_IBM_3740);

/// Number and signature of a data type. The signature is the seed of the CRC, so that both ends agree on the layout.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct DataType {
    /// Number of the data type.
    pub type_id: u16,
    /// Whether the data type is a service.
    pub is_service: bool,
    /// Signature of the data type's DSDL definition.
    pub signature: u64,
}

impl DataType {
    /// Data type of uavcan.protocol.NodeStatus.
    pub const NODE_STATUS: Self = Self::message_type(341, 0x0F08_68D0_C1A7_C6F1);
    /// Data type of uavcan.protocol.GetNodeInfo.
    pub const GET_NODE_INFO: Self = Self::service_type(1, 0xEE46_8A81_21C4_6A9E);
    /// Data type of uavcan.protocol.dynamic_node_id.Allocation.
    pub const ALLOCATION: Self = Self::message_type(1, 0x0B2A_8126_20A1_1D40);
    /// Data type of uavcan.protocol.param.GetSet.
    pub const GET_SET: Self = Self::service_type(11, 0xA7B6_22F9_39D1_A4D5);
    /// Data type of uavcan.protocol.param.ExecuteOpcode.
    pub const EXECUTE_OPCODE: Self = Self::service_type(10, 0x3B13_1AC5_EB69_D2CD);
    /// Data type of uavcan.protocol.RestartNode.
    pub const RESTART_NODE: Self = Self::service_type(5, 0x569E_0539_4A30_17F0);
    /// Data type of uavcan.protocol.GetTransportStats.
    pub const GET_TRANSPORT_STATS: Self = Self::service_type(4, 0xBE6F_76A7_EC31_2B04);
    /// Data type of uavcan.protocol.debug.LogMessage.
    pub const LOG_MESSAGE: Self = Self::message_type(16_383, 0xD654_A48E_0C04_9D75);
    /// Data type of uavcan.protocol.file.BeginFirmwareUpdate.
    pub const BEGIN_FIRMWARE_UPDATE: Self = Self::service_type(40, 0xB7D7_25DF_7272_4126);
    /// Data type of uavcan.equipment.ahrs.MagneticFieldStrength2.
    pub const MAGNETIC_FIELD_STRENGTH_2: Self = Self::message_type(1002, 0xB6AC_0C44_2430_297E);
    /// Data type of uavcan.tunnel.Targetted.
    pub const TARGETTED: Self = Self::message_type(3001, 0xB138_E7EA_72A2_A2E9);
    /// Data type of uavcan.equipment.power.BatteryInfo.
    pub const BATTERY_INFO: Self = Self::message_type(1092, 0x249C_2654_8A71_1966);
    /// Data type of uavcan.equipment.gnss.Fix2.
    pub const FIX_2: Self = Self::message_type(1063, 0xCA41_E700_0F37_435F);
    /// Data type of uavcan.equipment.safety.ArmingStatus.
    pub const ARMING_STATUS: Self = Self::message_type(1100, 0x8700_F375_556A_8003);

    const fn message_type(id: u16, signature: u64) -> Self {
        Self { type_id: id, is_service: false, signature }
    }

    const fn service_type(id: u16, signature: u64) -> Self {
        Self { type_id: id, is_service: true, signature }
    }

    /// Whether a frame with this header is of this type.
    #[must_use]
    pub const fn matches_header(&self, header: FrameHeader) -> bool {
        header.type_id == self.type_id && self.is_service != matches!(header.transfer_kind, TransferKind::Message)
    }

    /// CRC of a payload, seeded with the signature.
    pub(super) fn crc(&self, payload: &[u8]) -> u16 {
        let mut digest = CRC.digest();
        digest.update(&self.signature.to_le_bytes());
        digest.update(payload);
        digest.finalize()
    }
}

/// A message or a response, ready to be divided into frames.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct OutboundTransfer {
    /// Data type of the payload.
    pub data_type: DataType,
    /// Priority, 0 (highest) to 31.
    pub priority: u8,
    /// Kind of the transfer.
    pub transfer_kind: TransferKind,
    /// Number of the transfer, 0 to 31.
    pub transfer_id: u8,
    /// Encoded message, request or response.
    pub payload: Payload,
}

impl OutboundTransfer {
    /// Number of frames that the transfer needs.
    #[must_use]
    pub fn frame_count(&self) -> usize {
        if self.is_single() { 1 } else { (self.payload.len() + CRC_LENGTH).div_ceil(FRAME_PAYLOAD_LENGTH) }
    }

    fn is_single(&self) -> bool {
        self.payload.len() <= FRAME_PAYLOAD_LENGTH
    }

    /// Frames in order. A sender without a number sends an anonymous message; it must fit into one frame.
    pub fn frames(&self, source: Option<NodeId>) -> impl Iterator<Item = CanFrame> + '_ {
        let mut header = FrameHeader {
            priority: self.priority,
            transfer_kind: self.transfer_kind,
            type_id: self.data_type.type_id,
            source_node: source,
        };
        if source.is_none() {
            header.type_id = self.data_type.type_id & 3 | anonymous_discriminator(&self.payload) << 2;
        }
        let crc = (!self.is_single()).then(|| self.data_type.crc(&self.payload).to_le_bytes());
        let crc_length = crc.map_or(0, |crc| crc.len());
        let count = self.frame_count();
        (0..count).filter_map(move |number| {
            let mut data = heapless::Vec::<u8, FRAME_CAPACITY>::new();
            data.extend(crc.filter(|_| number == 0).into_iter().flatten());
            let rest =
                self.payload.get((number * FRAME_PAYLOAD_LENGTH).saturating_sub(crc_length)..).unwrap_or_default();
            let _ = data.extend_from_slice(rest.get(..FRAME_PAYLOAD_LENGTH - data.len()).unwrap_or(rest));
            let tail = TailByte::new(number == 0, number + 1 == count, number % 2 == 1, self.transfer_id);
            let _ = data.push(tail.0);
            CanFrame::new(header.to_id(), &data)
        })
    }
}

/// Discriminator of an anonymous message, 14 bits, never zero in practice: it makes identifiers of two anonymous
/// senders differ unless their payloads are equal.
fn anonymous_discriminator(payload: &[u8]) -> u16 {
    (CRC.checksum(payload) & 0x7FFE) >> 1
}
