//! A line editor for terminals.
//!
//! A character typed at the end of a line is echoed; any other change redraws the line, for which a terminal needs only
//! carriage return and `ESC [ 2 K`.

use core::fmt;

use heapless::Vec;

/// Capacity of a line, characters.
pub const LINE_CAPACITY: usize = 64;

/// Prompt at the start of the input line.
pub const PROMPT: &str = "> ";

/// Key, decoded from one or more bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Key {
    /// Printable character.
    Character(u8),
    /// Enters the edited line.
    Enter,
    /// Completes the word.
    Tab,
    /// Deletes the character before the cursor.
    Backspace,
    /// Deletes the character under the cursor.
    Delete,
    /// Moves the cursor left.
    Left,
    /// Moves the cursor right.
    Right,
    /// Moves the cursor to the beginning.
    Home,
    /// Moves the cursor to the end.
    End,
    /// Recalls the previous line of history.
    Up,
    /// Recalls the next line of history.
    Down,
    /// Deletes all characters before the cursor.
    EraseToStart,
    /// Discards the line.
    Cancel,
}

/// Decoder from bytes to keys.
#[derive(Debug, Default)]
pub struct KeyDecoder {
    key_sequence: KeySequence,
    /// The last byte was a carriage return: a line feed after it belongs to the same line end.
    after_carriage_return: bool,
}

#[derive(Clone, Copy, Debug, Default)]
enum KeySequence {
    #[default]
    None,
    /// State after an ESC byte.
    Escape,
    /// After `ESC [` or `ESC O`: the first number, and whether it is complete.
    Control(u8, bool),
}

impl KeyDecoder {
    /// Returns the key that this byte completes. Unknown bytes are ignored; an invalid byte ends a sequence.
    pub fn push_byte(&mut self, byte: u8) -> Option<Key> {
        let after_return = core::mem::replace(&mut self.after_carriage_return, byte == b'\r');
        match (core::mem::take(&mut self.key_sequence), byte) {
            (KeySequence::Escape, b'[' | b'O') => self.key_sequence = KeySequence::Control(0, false),
            (KeySequence::Control(number, is_complete), b' '..=b'?') => {
                let digit = byte.wrapping_sub(b'0');
                self.key_sequence = if digit > 9 || is_complete {
                    KeySequence::Control(number, true)
                } else {
                    KeySequence::Control(number.saturating_mul(10).saturating_add(digit), false)
                };
            }
            (KeySequence::Control(number, _), b'@'..=b'~') => return key_of_sequence(number, byte),
            (_, b'\n') if after_return => {}
            (_, 0x1B) => self.key_sequence = KeySequence::Escape,
            (_, byte) => return plain_key(byte),
        }
        None
    }
}

const fn plain_key(byte: u8) -> Option<Key> {
    const fn control_character(key: u8) -> u8 {
        key & 0x1F
    }
    const CTRL_A: u8 = control_character(b'A');
    const CTRL_C: u8 = control_character(b'C');
    const CTRL_E: u8 = control_character(b'E');
    const CTRL_U: u8 = control_character(b'U');
    Some(match byte {
        b' '..=b'~' => Key::Character(byte),
        b'\r' | b'\n' => Key::Enter,
        b'\t' => Key::Tab,
        0x08 | 0x7F => Key::Backspace,
        CTRL_A => Key::Home,
        CTRL_C => Key::Cancel,
        CTRL_E => Key::End,
        CTRL_U => Key::EraseToStart,
        _ => return None,
    })
}

/// Decodes a control sequence from its last byte and, for `~`, its first number (ECMA-48; xterm, VT220, Linux console).
const fn key_of_sequence(number: u8, final_byte: u8) -> Option<Key> {
    Some(match (final_byte, number) {
        (b'A', _) => Key::Up,
        (b'B', _) => Key::Down,
        (b'C', _) => Key::Right,
        (b'D', _) => Key::Left,
        (b'H', _) | (b'~', 1 | 7) => Key::Home,
        (b'F', _) | (b'~', 4 | 8) => Key::End,
        (b'~', 3) => Key::Delete,
        _ => return None,
    })
}

/// The line being typed, and previous lines; printable ASCII only.
#[derive(Debug, Default)]
pub struct Editor {
    line: Vec<u8, LINE_CAPACITY>,
    cursor: usize,
    /// Number of characters beyond the capacity.
    excess_character_count: usize,
    /// Previous lines, the newest last, each with a line feed at its end.
    history: Vec<u8, 256>,
    /// Index of the recalled line from the newest; none for a typed line.
    history_index: Option<usize>,
}

impl Editor {
    /// Text of the line.
    pub fn line(&self) -> &str {
        line_text(&self.line)
    }

    /// Text before the cursor.
    pub fn text_before_cursor(&self) -> &str {
        self.line().get(..self.cursor).unwrap_or_default()
    }

    /// Whether more characters were typed than fit.
    pub const fn is_too_long(&self) -> bool {
        self.excess_character_count > 0
    }

    /// Applies a key to the line and updates the terminal.
    pub fn process_key(&mut self, key: Key, out: &mut dyn fmt::Write) {
        let line_length = self.line.len();
        match key {
            Key::Character(byte) => return self.insert_character(byte, out),
            Key::Backspace if self.excess_character_count > 0 => self.excess_character_count -= 1,
            Key::Backspace if self.cursor == 0 => {}
            Key::Backspace => {
                self.cursor -= 1;
                self.remove_character(self.cursor);
            }
            Key::Delete => self.remove_character(self.cursor),
            Key::Left => self.cursor = self.cursor.saturating_sub(1),
            Key::Right => self.cursor = line_length.min(self.cursor + 1),
            Key::Home => self.cursor = 0,
            Key::End => self.cursor = line_length,
            Key::Up => self.recall_line(self.history_index.map_or(0, |back| back + 1)),
            Key::Down => match self.history_index {
                Some(back) if back > 0 => self.recall_line(back - 1),
                _ => self.clear(),
            },
            Key::EraseToStart => {
                self.line.rotate_left(self.cursor);
                self.line.truncate(line_length - self.cursor);
                (self.cursor, self.excess_character_count, self.history_index) = (0, 0, None);
            }
            Key::Enter | Key::Tab | Key::Cancel => return,
        }
        self.draw_line(out);
    }

    /// Redraws the line.
    pub fn draw_line(&self, out: &mut dyn fmt::Write) {
        // Output beyond its capacity is cut.
        let _ = write!(out, "\r\x1b[2K{PROMPT}{}", self.line());
        for _ in self.cursor..self.line.len() {
            let _ = out.write_str("\x08");
        }
    }

    /// Stores the line in history and clears it.
    pub fn submit_line(&mut self) {
        let newest = self.history_line(0);
        if !self.is_too_long() && !self.line.is_empty() && newest != self.line.as_slice() {
            while self.history.len() + self.line.len() >= self.history.capacity() {
                let oldest =
                    self.history.iter().position(|&byte| byte == b'\n').map_or(self.history.len(), |end| end + 1);
                self.history.rotate_left(oldest);
                self.history.truncate(self.history.len() - oldest);
            }
            // Infallible: the loop above freed the capacity for the line and its end.
            let _ = self.history.extend_from_slice(&self.line);
            let _ = self.history.push(b'\n');
        }
        self.clear();
    }

    /// Clears the line.
    pub fn clear(&mut self) {
        self.line.clear();
        (self.cursor, self.excess_character_count, self.history_index) = (0, 0, None);
    }

    fn insert_character(&mut self, byte: u8, out: &mut dyn fmt::Write) {
        if self.is_too_long() || self.line.insert(self.cursor, byte).is_err() {
            self.excess_character_count += 1;
            return;
        }
        self.cursor += 1;
        if self.cursor == self.line.len() {
            let _ = out.write_char(char::from(byte));
        } else {
            self.draw_line(out);
        }
    }

    fn remove_character(&mut self, position: usize) {
        if position < self.line.len() {
            self.line.remove(position);
        }
    }

    fn recall_line(&mut self, lines_back: usize) {
        let Ok(line) = Vec::from_slice(self.history_line(lines_back)) else { return };
        if line.is_empty() {
            return;
        }
        self.clear();
        self.cursor = line.len();
        self.line = line;
        self.history_index = Some(lines_back);
    }

    /// Line of history, counted from the newest; empty beyond the oldest.
    fn history_line(&self, lines_back: usize) -> &[u8] {
        self.history.rsplit(|&byte| byte == b'\n').nth(lines_back + 1).unwrap_or_default()
    }
}

fn line_text(line: &[u8]) -> &str {
    // Printable ASCII is always UTF-8.
    core::str::from_utf8(line).unwrap_or_default()
}

#[cfg(test)]
mod tests;
