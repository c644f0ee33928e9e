//! Texts for whoever looks at a ground station: STATUSTEXT, which all of them show.

use ::mavlink::dialects::common::MavSeverity;

use super::Line;
use crate::port::Pace;
use crate::time::Timestamp;
use crate::wire::mavlink::Outgoing;

/// So many texts wait. There are few of them: how a collection goes on, and what becomes of it.
const WAITING: usize = 3;

/// Characters of a text, its beginning included: five pieces. What is longer is cut.
const LENGTH: usize = 240;

/// Pieces a second: they are to leave room for headings on a slow line.
const PIECES_HZ: u8 = 10;

/// What a text begins with: a ground station shows those of all components in one list.
const NAME: &str = "autoswing: ";

#[derive(Debug)]
struct Text {
    severity: MavSeverity,
    characters: heapless::Vec<u8, LENGTH>,
}

/// Texts to be sent. Of more than [`WAITING`] the newest stay, and the one that was begun.
#[derive(Debug, Default)]
pub(super) struct Texts {
    waiting: heapless::Vec<Text, WAITING>,
    /// Pieces of the first that were sent.
    sent: u8,
    /// Of the texts of more than one piece.
    number: u16,
    pace: Pace,
}

impl Texts {
    /// Takes a line.
    pub fn note(&mut self, text: &str) {
        let warns = ["refused", "iron-moved", "collection-lost"].iter().any(|word| text.starts_with(word));
        let severity = if warns { MavSeverity::MAV_SEVERITY_WARNING } else { MavSeverity::MAV_SEVERITY_INFO };
        let mut characters = heapless::Vec::new();
        // What is too long is cut, and what is cut fits.
        let text = text.as_bytes().trim_ascii_end();
        let fitting = text.get(..LENGTH - NAME.len()).unwrap_or(text);
        let _ = characters.extend_from_slice(NAME.as_bytes());
        let _ = characters.extend_from_slice(fitting);
        if self.waiting.is_full() {
            self.waiting.remove(usize::from(self.sent > 0));
        }
        let _ = self.waiting.push(Text { severity, characters });
    }

    /// Sends the next piece if there is one and it is due; whether so, and there was room for it.
    pub fn tell(&mut self, now: Timestamp, line: &mut Line<'_>) -> bool {
        let Some(text) = self.waiting.first() else { return false };
        if !self.pace.is_due(now, PIECES_HZ) {
            return false;
        }
        let is_long = text.characters.len() > Outgoing::TEXT;
        let rest = text.characters.get(usize::from(self.sent) * Outgoing::TEXT..).unwrap_or_default();
        let piece = rest.get(..Outgoing::TEXT).unwrap_or(rest);
        let number = if is_long { self.number.max(1) } else { 0 };
        if !line.send(Outgoing::text(text.severity, piece, number, self.sent)) {
            return false;
        }
        self.sent += 1;
        // Of a text of several pieces one that is not full is the last, and an empty one if all are full.
        if !is_long || piece.len() < Outgoing::TEXT {
            self.waiting.remove(0);
            (self.sent, self.number) = (0, number.wrapping_add(1));
        }
        true
    }
}
