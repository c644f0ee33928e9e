//! Queue of frames to send. A transfer is queued whole or not at all.

use crate::wire::dronecan::{CanFrame, DataType, NodeId, OutboundTransfer, Payload, TRANSFER_ID_MASK, TransferKind};
use autoswing::time::Timestamp;

/// Capacity of the queue, frames: two transfers of the longest tunnelled piece, and some short ones.
const CAPACITY_FRAMES: usize = 48;

/// Number of frames of the longest text: 90 characters with their source.
const MAX_FRAMES_PER_TEXT: usize = 15;

/// Number of frames of a magnetic field with its covariance.
const FRAMES_PER_FIELD: usize = 3;

/// Time without a sent frame after which the frames are out of date and dropped, microseconds.
const SEND_TIMEOUT_US: u64 = 1_000_000;

/// Messages with a counter of transfers.
const TYPES_WITH_TRANSFER_COUNTER: [DataType; 5] = [
    DataType::MAGNETIC_FIELD_STRENGTH_2,
    DataType::NODE_STATUS,
    DataType::LOG_MESSAGE,
    DataType::TARGETTED,
    DataType::ALLOCATION,
];

/// Queue of frames; a field is sent before the others, and replaces a waiting one.
#[derive(Debug, Default)]
pub(super) struct FrameOutbox {
    field_frames: heapless::Deque<CanFrame, FRAMES_PER_FIELD>,
    /// Whether the first frame of the field was sent.
    is_first_field_frame_sent: bool,
    other_frames: heapless::Deque<CanFrame, CAPACITY_FRAMES>,
    next_transfer_ids: [u8; TYPES_WITH_TRANSFER_COUNTER.len()],
    /// Time of the last sent frame, or of the first frame in an empty queue.
    last_progress_at: Timestamp,
    /// Number of queued transfers; wraps.
    pub transfer_count: u32,
    /// Number of transfers dropped for lack of room or time; wraps.
    pub lost_transfer_count: u32,
}

impl FrameOutbox {
    /// Queues a transfer; returns whether there was room.
    pub fn queue_transfer(&mut self, now: Timestamp, source: Option<NodeId>, transfer: &OutboundTransfer) -> bool {
        self.start_progress_timeout(now);
        if self.other_frames.len() + transfer.frame_count() > CAPACITY_FRAMES {
            return false;
        }
        for frame in transfer.frames(source) {
            let _ = self.other_frames.push_back(frame);
        }
        self.transfer_count = self.transfer_count.wrapping_add(1);
        true
    }

    /// Queues a message; returns whether there was room.
    pub fn queue_message(
        &mut self,
        now: Timestamp,
        source: Option<NodeId>,
        data_type: DataType,
        priority: u8,
        payload: Payload,
    ) -> bool {
        let transfer_id = self.transfer_id(data_type);
        let kind = TransferKind::Message;
        let is_queued = self.queue_transfer(
            now,
            source,
            &OutboundTransfer { data_type, priority, transfer_kind: kind, transfer_id, payload },
        );
        if is_queued {
            self.advance_transfer_id(data_type);
        }
        is_queued
    }

    /// Queues a field, in place of one of which no frame was sent.
    pub fn queue_field(&mut self, now: Timestamp, source: NodeId, priority: u8, payload: Payload) {
        self.start_progress_timeout(now);
        if !self.field_frames.is_empty() {
            self.lost_transfer_count = self.lost_transfer_count.wrapping_add(1);
            if self.is_first_field_frame_sent {
                return;
            }
            self.field_frames.clear();
        }
        let data_type = DataType::MAGNETIC_FIELD_STRENGTH_2;
        let transfer_id = self.transfer_id(data_type);
        let kind = TransferKind::Message;
        for frame in
            (OutboundTransfer { data_type, priority, transfer_kind: kind, transfer_id, payload }).frames(Some(source))
        {
            let _ = self.field_frames.push_back(frame);
        }
        self.is_first_field_frame_sent = false;
        self.transfer_count = self.transfer_count.wrapping_add(1);
        self.advance_transfer_id(data_type);
    }

    /// Next frame to send.
    pub fn first_frame(&self) -> Option<&CanFrame> {
        self.field_frames.front().or_else(|| self.other_frames.front())
    }

    /// Removes the next frame after it was sent.
    pub fn pop_frame(&mut self, now: Timestamp) {
        self.last_progress_at = now;
        self.is_first_field_frame_sent = self.field_frames.pop_front().is_some() || {
            self.other_frames.pop_front();
            false
        };
    }

    /// Drops the frames that the bus did not accept in time.
    pub fn drop_expired_frames(&mut self, now: Timestamp) {
        if self.first_frame().is_some() && now.us_since(self.last_progress_at) > SEND_TIMEOUT_US {
            self.clear();
            self.lost_transfer_count = self.lost_transfer_count.wrapping_add(1);
        }
    }

    /// Drops all frames.
    pub fn clear(&mut self) {
        self.field_frames.clear();
        self.other_frames.clear();
    }

    /// Whether a text fits.
    pub fn has_room_for_text(&self) -> bool {
        self.other_frames.len() + MAX_FRAMES_PER_TEXT <= CAPACITY_FRAMES
    }

    fn start_progress_timeout(&mut self, now: Timestamp) {
        if self.first_frame().is_none() {
            self.last_progress_at = now;
        }
    }

    fn transfer_id(&self, data_type: DataType) -> u8 {
        TYPES_WITH_TRANSFER_COUNTER
            .iter()
            .zip(&self.next_transfer_ids)
            .find(|(counted, _)| **counted == data_type)
            .map_or(0, |(_, &id)| id)
    }

    fn advance_transfer_id(&mut self, data_type: DataType) {
        for (counted, id) in TYPES_WITH_TRANSFER_COUNTER.iter().zip(&mut self.next_transfer_ids) {
            if *counted == data_type {
                *id = (*id + 1) & TRANSFER_ID_MASK;
            }
        }
    }
}
