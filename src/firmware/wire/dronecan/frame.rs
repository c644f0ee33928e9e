//! CAN frames, and the meaning of their identifiers and tail bytes.

use core::num::NonZeroU8;

/// Largest transfer id; ids count from 0 and wrap.
pub const TRANSFER_ID_MASK: u8 = 0x1F;

/// Data bytes of a classic CAN frame.
pub const FRAME_CAPACITY: usize = 8;

/// Classic CAN frame with an extended identifier. `embedded-can` has traits for frames but none for an asynchronous
/// bus, so the frame is a plain value; a board converts it to its HAL's.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct CanFrame {
    id: u32,
    data: heapless::Vec<u8, FRAME_CAPACITY>,
}

impl CanFrame {
    /// A frame with a 29-bit identifier; `None` for more than eight bytes or a longer identifier.
    #[must_use]
    pub fn new(id: u32, data: &[u8]) -> Option<Self> {
        let data = heapless::Vec::from_slice(data).ok()?;
        (id >> 29 == 0).then_some(Self { id, data })
    }

    /// Identifier, 29 bits.
    #[must_use]
    pub const fn frame_id(&self) -> u32 {
        self.id
    }

    /// Data bytes, at most eight.
    #[must_use]
    pub fn data(&self) -> &[u8] {
        &self.data
    }

    /// Tail byte, and the part of the payload before it; `None` for an empty frame, which is not DroneCAN's.
    pub(super) fn split_tail(&self) -> Option<(TailByte, &[u8])> {
        self.data.split_last().map(|(&tail, payload)| (TailByte(tail), payload))
    }
}

/// Number of a node, 1 to 127.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct NodeId(NonZeroU8);

impl NodeId {
    /// Largest node number.
    pub const MAX_NODE_ID: u8 = 127;

    /// A node number; `None` for 0, which is no node, and above 127.
    #[must_use]
    pub fn new(number: u8) -> Option<Self> {
        NonZeroU8::new(number).filter(|number| number.get() <= Self::MAX_NODE_ID).map(Self)
    }

    /// The node number.
    #[must_use]
    pub const fn number(self) -> u8 {
        self.0.get()
    }
}

/// Transfer priorities, the highest first.
pub mod priority {
    /// Priority of tunnelled bytes.
    pub const MEDIUM_PRIORITY: u8 = 16;
    /// Priority of all other messages than tunnelled bytes.
    pub const LOW_PRIORITY: u8 = 24;
}

/// Kind of a transfer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TransferKind {
    /// Broadcast message.
    Message,
    /// Service request to a node.
    Request(NodeId),
    /// Service response to a node.
    Response(NodeId),
}

/// Meaning of an identifier.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FrameHeader {
    /// Priority, 0 (highest) to 31.
    pub priority: u8,
    /// Kind of the transfer.
    pub transfer_kind: TransferKind,
    /// Data type; of an anonymous message only the two low bits.
    pub type_id: u16,
    /// Sender; `None` for an anonymous message.
    pub source_node: Option<NodeId>,
}

impl FrameHeader {
    /// Decodes an identifier; `None` for a service without a sender or a destination.
    #[must_use]
    pub fn from_id(id: u32) -> Option<Self> {
        let [high, middle, low, last] = id.to_be_bytes();
        let (priority, is_service, source) = (high & 0x1F, last & 0x80 != 0, NodeId::new(last & NodeId::MAX_NODE_ID));
        let (kind, type_id) = if is_service {
            source?;
            let other = NodeId::new(low & NodeId::MAX_NODE_ID)?;
            let kind = if low & 0x80 == 0 { TransferKind::Response(other) } else { TransferKind::Request(other) };
            (kind, u16::from(middle))
        } else {
            let type_id = u16::from_be_bytes([middle, low]);
            (TransferKind::Message, if source.is_none() { type_id & 3 } else { type_id })
        };
        Some(Self { priority, transfer_kind: kind, type_id, source_node: source })
    }

    /// Encodes the identifier; that of an anonymous message has the discriminator in the high bits of its type.
    #[must_use]
    pub fn to_id(self) -> u32 {
        let source = self.source_node.map_or(0, NodeId::number);
        let [type_high, type_low] = self.type_id.to_be_bytes();
        let (middle, low, service) = match self.transfer_kind {
            TransferKind::Message => (type_high, type_low, 0),
            TransferKind::Request(to) => (type_low, 0x80 | to.number(), 0x80),
            TransferKind::Response(to) => (type_low, to.number(), 0x80),
        };
        u32::from_be_bytes([self.priority & 0x1F, middle, low, service | source])
    }
}

/// Last byte of a frame: position of the frame in its transfer, and the transfer's number.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct TailByte(pub u8);

impl TailByte {
    const START_OF_TRANSFER: u8 = 0x80;
    const END_OF_TRANSFER: u8 = 0x40;
    const TOGGLE: u8 = 0x20;

    pub fn new(is_start: bool, is_end: bool, toggle: bool, transfer_id: u8) -> Self {
        let flag = |is_set, flag| if is_set { flag } else { 0 };
        Self(
            flag(is_start, Self::START_OF_TRANSFER)
                | flag(is_end, Self::END_OF_TRANSFER)
                | flag(toggle, Self::TOGGLE)
                | transfer_id & TRANSFER_ID_MASK,
        )
    }

    pub const fn is_start(self) -> bool {
        self.0 & Self::START_OF_TRANSFER != 0
    }

    pub const fn is_end(self) -> bool {
        self.0 & Self::END_OF_TRANSFER != 0
    }

    pub const fn toggle(self) -> bool {
        self.0 & Self::TOGGLE != 0
    }

    pub const fn transfer_id(self) -> u8 {
        self.0 & TRANSFER_ID_MASK
    }
}
