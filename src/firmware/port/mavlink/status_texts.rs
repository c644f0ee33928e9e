//! Text messages as STATUSTEXT, which every ground station shows.

use core::fmt::Write as _;

use mavlink_dialect::MavSeverity;

use super::transmitter::Transmitter;
use crate::port::bounded_text::BoundedText;
use crate::port::message_schedule::MessageSchedule;
use crate::wire::mavlink::OutboundMessage;
use autoswing::time::Timestamp;
use autoswing_module::messages::{Message, Severity};

/// Capacity for texts: progress of a collection, its end, and the outcome of the solve.
const QUEUE_CAPACITY: usize = 3;

/// Rate of chunks, Hz; leaves room for headings on a slow line.
const CHUNK_RATE_HZ: u8 = 10;

/// Prefix of every text: a ground station shows the texts of all components in one list.
const TEXT_PREFIX: &str = "autoswing: ";

#[derive(Debug)]
struct PendingText {
    severity: MavSeverity,
    characters: BoundedText,
}

/// Pending texts. When full, the oldest is dropped, except one whose first chunk was sent.
#[derive(Debug, Default)]
pub(super) struct PendingTexts {
    queued_texts: heapless::Vec<PendingText, QUEUE_CAPACITY>,
    /// Number of sent chunks of the first text.
    sent_chunk_count: u8,
    /// STATUSTEXT's `id`, counted for texts of several chunks; 0 is for texts of one chunk.
    text_id: u16,
    schedule: MessageSchedule,
}

impl PendingTexts {
    /// Queues a message.
    pub fn push_message(&mut self, message: &Message) {
        let severity = match message.severity() {
            Severity::Info => MavSeverity::MAV_SEVERITY_INFO,
            Severity::Warning => MavSeverity::MAV_SEVERITY_WARNING,
        };
        let mut characters = BoundedText::default();
        let _ = write!(characters, "{TEXT_PREFIX}{message}");
        if self.queued_texts.is_full() {
            self.queued_texts.remove(usize::from(self.sent_chunk_count > 0));
        }
        let _ = self.queued_texts.push(PendingText { severity, characters });
    }

    /// Sends the next due chunk; returns whether one was sent.
    pub fn send_next_chunk(&mut self, now: Timestamp, line: &mut Transmitter<'_>) -> bool {
        let Some(text) = self.queued_texts.first() else { return false };
        if !self.schedule.is_due(now, CHUNK_RATE_HZ) {
            return false;
        }
        let characters = text.characters.bytes();
        let is_long = characters.len() > OutboundMessage::STATUSTEXT_CAPACITY;
        let unsent = characters
            .get(usize::from(self.sent_chunk_count) * OutboundMessage::STATUSTEXT_CAPACITY..)
            .unwrap_or_default();
        let chunk = unsent.get(..OutboundMessage::STATUSTEXT_CAPACITY).unwrap_or(unsent);
        let text_id = if is_long { self.text_id.max(1) } else { 0 };
        if !line.send_message(OutboundMessage::status_text(text.severity, chunk, text_id, self.sent_chunk_count)) {
            return false;
        }
        self.sent_chunk_count += 1;
        // The last of several chunks must not be full: an empty one follows if all are.
        if !is_long || chunk.len() < OutboundMessage::STATUSTEXT_CAPACITY {
            self.queued_texts.remove(0);
            (self.sent_chunk_count, self.text_id) = (0, text_id.wrapping_add(1));
        }
        true
    }
}
