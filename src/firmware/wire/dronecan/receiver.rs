//! Receiver of transfers: reassembly of frames, with bounds on every array.
//!
//! A transfer is dropped when its first frame is missing, when it is longer than the longest accepted one, when two
//! seconds pass between its frames, or when its CRC is wrong. A first frame always begins anew. A repeated frame, whose
//! toggle bit is wrong, is ignored; a missing one shows in the CRC.

use super::frame::{CanFrame, FRAME_CAPACITY, FrameHeader, NodeId, TailByte, TransferKind};
use super::inbound::{BusMessage, ReceivedType, find_type};
use super::transfer::{CRC_LENGTH, DataType};
use autoswing::time::Timestamp;

/// Longest received payload, bytes: GetSet with the longest string and name.
pub const MAX_RECEIVED_LENGTH: usize = 224;

/// Number of transfers of several frames that are received at the same time; the frames of one follow each other within
/// milliseconds.
const TRANSFER_SLOTS: usize = 4;

/// Longest time between two frames of a transfer, microseconds.
const TRANSFER_TIMEOUT_US: u64 = 2_000_000;

/// Bits of an identifier without the priority.
const TRANSFER_KEY_MASK: u32 = 0x00FF_FFFF;

/// Received transfer.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct InboundTransfer<'a> {
    /// Sender; `None` if anonymous.
    pub source_node: Option<NodeId>,
    /// Priority, which a response copies.
    pub priority: u8,
    /// Number of the transfer, which a response copies.
    pub transfer_id: u8,
    /// Decoded message or request.
    pub message: BusMessage<'a>,
}

/// Receiver of the transfers that this node understands. 1 KB.
#[derive(Debug)]
pub struct TransferReceiver {
    slots: [TransferSlot; TRANSFER_SLOTS],
    /// Frames and transfers dropped since the start; wraps.
    pub rejected_count: u32,
}

impl Default for TransferReceiver {
    fn default() -> Self {
        Self { slots: [const { TransferSlot::EMPTY }; TRANSFER_SLOTS], rejected_count: 0 }
    }
}

impl TransferReceiver {
    /// Processes a frame; returns the transfer that it completes. Requests to other nodes than `own_node` are ignored.
    pub fn push_frame<'a>(
        &'a mut self,
        at: Timestamp,
        own_node: Option<NodeId>,
        frame: &'a CanFrame,
    ) -> Option<InboundTransfer<'a>> {
        let header = FrameHeader::from_id(frame.frame_id())?;
        let ReceivedType { data_type, decoder: decode } = match header.transfer_kind {
            TransferKind::Message => find_type(false, header.type_id, header.source_node.is_none()),
            TransferKind::Request(to) if Some(to) == own_node => find_type(true, header.type_id, false),
            TransferKind::Request(_) | TransferKind::Response(_) => None,
        }?;
        let (tail, part) = frame.split_tail()?;
        let is_single = tail.is_start() && tail.is_end();
        let progress = if is_single {
            if tail.toggle() { FrameResult::Rejected } else { FrameResult::Complete(part) }
        } else if header.source_node.is_none() || (!tail.is_end() && part.len() + 1 < FRAME_CAPACITY) {
            FrameResult::Rejected
        } else {
            match find_or_claim_slot(&mut self.slots, frame.frame_id() & TRANSFER_KEY_MASK, tail.is_start()) {
                Some(slot) => slot.push_payload(at, tail, part, data_type),
                None => FrameResult::Rejected,
            }
        };
        let message = match progress {
            FrameResult::Waiting => return None,
            FrameResult::Rejected => None,
            FrameResult::Complete(payload) => decode(payload),
        };
        if message.is_none() {
            self.rejected_count = self.rejected_count.wrapping_add(1);
        }
        let (source, priority, transfer_id) = (header.source_node, header.priority, tail.transfer_id());
        message.map(|message| InboundTransfer { source_node: source, priority, transfer_id, message })
    }
}

/// Slot of a sender and type. A first frame without one takes a free slot, or that of the longest silent transfer.
fn find_or_claim_slot(
    slots: &mut [TransferSlot; TRANSFER_SLOTS],
    transfer_key: u32,
    is_start: bool,
) -> Option<&mut TransferSlot> {
    let index = slots.iter().position(|slot| slot.transfer_key == Some(transfer_key)).or_else(|| {
        let oldest = slots.iter().enumerate().min_by_key(|(_, slot)| (slot.transfer_key.is_some(), slot.last_frame_at));
        oldest.map(|(index, _)| index).filter(|_| is_start)
    })?;
    let slot = slots.get_mut(index)?;
    if is_start {
        *slot = TransferSlot { transfer_key: Some(transfer_key), ..TransferSlot::EMPTY };
    }
    Some(slot)
}

/// Effect of a frame on its transfer.
enum FrameResult<'a> {
    Waiting,
    Rejected,
    Complete(&'a [u8]),
}

/// Transfer being received.
#[derive(Debug)]
struct TransferSlot {
    /// Identifier without priority; `None` if free.
    transfer_key: Option<u32>,
    transfer_id: u8,
    /// Toggle bit of the next frame.
    expected_toggle: bool,
    last_frame_at: Timestamp,
    crc: [u8; CRC_LENGTH],
    payload: heapless::Vec<u8, MAX_RECEIVED_LENGTH>,
}

impl TransferSlot {
    const EMPTY: Self = Self {
        transfer_key: None,
        transfer_id: 0,
        expected_toggle: false,
        last_frame_at: Timestamp::START,
        crc: [0; CRC_LENGTH],
        payload: heapless::Vec::new(),
    };

    fn push_payload(&mut self, at: Timestamp, tail: TailByte, part: &[u8], data_type: &DataType) -> FrameResult<'_> {
        let part = if tail.is_start() {
            let Some((crc, part)) = part.split_first_chunk() else { return self.reject_transfer() };
            (self.transfer_id, self.crc) = (tail.transfer_id(), *crc);
            part
        } else {
            if tail.transfer_id() != self.transfer_id || at.us_since(self.last_frame_at) > TRANSFER_TIMEOUT_US {
                return self.reject_transfer();
            }
            part
        };
        if tail.toggle() != self.expected_toggle {
            return if tail.is_start() { self.reject_transfer() } else { FrameResult::Waiting };
        }
        (self.expected_toggle, self.last_frame_at) = (!self.expected_toggle, at);
        if self.payload.extend_from_slice(part).is_err() {
            return self.reject_transfer();
        }
        if !tail.is_end() {
            return FrameResult::Waiting;
        }
        self.transfer_key = None;
        if data_type.crc(&self.payload) == u16::from_le_bytes(self.crc) {
            FrameResult::Complete(&self.payload)
        } else {
            FrameResult::Rejected
        }
    }

    const fn reject_transfer(&mut self) -> FrameResult<'_> {
        self.transfer_key = None;
        FrameResult::Rejected
    }
}
