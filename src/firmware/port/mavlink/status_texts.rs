//! Text messages as STATUSTEXT, which every ground station shows.

use mavlink_dialect::MavSeverity;

use super::transmitter::Transmitter;
use crate::port::text_queue::TextQueue;
use crate::wire::mavlink::OutboundMessage;
use autoswing::time::Timestamp;
use autoswing_module::messages::{Message, Severity};
use autoswing_module::settings::Settings;

/// Pending texts.
#[derive(Debug, Default)]
pub(super) struct PendingTexts {
    queue: TextQueue,
    /// STATUSTEXT's `id`, counted for texts of several chunks; 0 is for texts of one chunk.
    text_id: u16,
}

impl PendingTexts {
    /// Queues a message. A ground station shows the texts of all components in one list: a text names the module, and a
    /// component other than the usual one.
    pub fn push_message(&mut self, message: &Message, component: u8) {
        if component == Settings::DEFAULT.component {
            self.queue.push_text(message.severity(), format_args!("autoswing: {message}"));
        } else {
            self.queue.push_text(message.severity(), format_args!("autoswing {component}: {message}"));
        }
    }

    /// Sends the next due chunk; returns whether one was sent.
    pub fn send_next_chunk(&mut self, now: Timestamp, line: &mut Transmitter<'_>) -> bool {
        let Some(chunk) = self.queue.due_piece(now, OutboundMessage::STATUSTEXT_CAPACITY) else { return false };
        let severity = match chunk.severity {
            Severity::Info => MavSeverity::MAV_SEVERITY_INFO,
            Severity::Warning => MavSeverity::MAV_SEVERITY_WARNING,
        };
        let is_only = chunk.is_last && chunk.index == 0;
        let text_id = if is_only { 0 } else { self.text_id.max(1) };
        // A chunk that is not full ends the text: all before the last are filled, and an empty chunk follows a full last
        // one.
        let mut text = [if chunk.is_last { 0 } else { b' ' }; OutboundMessage::STATUSTEXT_CAPACITY];
        text.iter_mut().zip(chunk.characters).for_each(|(target, source)| *target = *source);
        let was_last = is_only || chunk.is_last && chunk.characters.len() < text.len();
        if !line.send_message(OutboundMessage::status_text(severity, &text, text_id, chunk.index)) {
            return false;
        }
        if was_last {
            self.text_id = text_id.wrapping_add(1);
        }
        self.queue.advance(was_last);
        true
    }
}
