//! Texts of the module that are sent in pieces.

use core::fmt::{self, Write as _};

use crate::port::message_schedule::MessageSchedule;
use autoswing::time::Timestamp;
use autoswing_module::messages::Severity;

/// Capacity for texts: progress of a collection, its end, and the outcome of the solve.
const QUEUE_CAPACITY: usize = 3;

/// Capacity of a text, characters: five or six chunks of a STATUSTEXT, three of a LogMessage.
const TEXT_CAPACITY: usize = 240;

/// Rate of pieces, Hz; leaves room for headings on a slow line.
const PIECE_RATE_HZ: u8 = 10;

/// Characters of a text; those beyond the capacity are cut.
#[derive(Debug, Default)]
struct Characters(heapless::Vec<u8, TEXT_CAPACITY>);

impl fmt::Write for Characters {
    fn write_str(&mut self, text: &str) -> fmt::Result {
        for byte in text.bytes() {
            let _ = self.0.push(byte);
        }
        Ok(())
    }
}

/// Next piece of the first text.
pub(super) struct TextPiece<'a> {
    pub severity: Severity,
    pub characters: &'a [u8],
    /// Number of the piece in its text, from 0.
    pub index: u8,
    /// Whether all characters of the text are sent with this piece.
    pub is_last: bool,
}

/// Queue of texts. When full, the oldest is dropped, except one whose first piece was sent.
#[derive(Debug, Default)]
pub(super) struct TextQueue {
    texts: heapless::Vec<(Severity, Characters), QUEUE_CAPACITY>,
    /// Number of sent pieces of the first text.
    sent_piece_count: u8,
    /// Characters of the first text before the next piece, and before the one after it.
    piece_start: usize,
    next_start: usize,
    schedule: MessageSchedule,
}

impl TextQueue {
    /// Queues a text.
    pub fn push_text(&mut self, severity: Severity, text: fmt::Arguments<'_>) {
        let mut characters = Characters::default();
        let _ = characters.write_fmt(text);
        if self.texts.is_full() {
            self.texts.remove(usize::from(self.sent_piece_count > 0));
        }
        let _ = self.texts.push((severity, characters));
    }

    /// Next piece of at most this length, if due. It ends with a space, unless a word is longer.
    pub fn due_piece(&mut self, now: Timestamp, max_length: usize) -> Option<TextPiece<'_>> {
        let (severity, Characters(characters)) = self.texts.first()?;
        if !self.schedule.is_due(now, PIECE_RATE_HZ) {
            return None;
        }
        let unsent = characters.get(self.piece_start..).unwrap_or_default();
        let is_last = unsent.len() <= max_length;
        let space = unsent.iter().take(max_length).rposition(|byte| *byte == b' ');
        let length = if is_last { unsent.len() } else { space.map_or(max_length, |space| space + 1) };
        self.next_start = self.piece_start + length;
        let characters = unsent.get(..length).unwrap_or(unsent);
        Some(TextPiece { severity: *severity, characters, index: self.sent_piece_count, is_last })
    }

    /// Goes on after a sent piece: to the next one, or after the last one to the next text.
    pub fn advance(&mut self, was_last: bool) {
        (self.sent_piece_count, self.piece_start) = (self.sent_piece_count + 1, self.next_start);
        if was_last {
            self.texts.remove(0);
            (self.sent_piece_count, self.piece_start) = (0, 0);
        }
    }
}
