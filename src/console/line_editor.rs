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
mod tests {
    use super::*;

    fn decoded_keys(bytes: &[u8]) -> std::vec::Vec<Key> {
        let mut keys = KeyDecoder::default();
        // One byte at a time: a sequence may be split across reads.
        bytes.iter().filter_map(|&byte| keys.push_byte(byte)).collect()
    }

    #[test]
    fn byte_sequences_are_decoded_to_keys() {
        for (bytes, key) in [
            (&b" "[..], Key::Character(b' ')),
            (b"~", Key::Character(b'~')),
            (b"\r", Key::Enter),
            (b"\n", Key::Enter),
            (b"\r\n", Key::Enter),
            (b"\t", Key::Tab),
            (b"\x08", Key::Backspace),
            (b"\x7f", Key::Backspace),
            (b"\x01", Key::Home),
            (b"\x05", Key::End),
            (b"\x03", Key::Cancel),
            (b"\x15", Key::EraseToStart),
            (b"\x1b[A", Key::Up),
            (b"\x1bOA", Key::Up),
            (b"\x1b[B", Key::Down),
            (b"\x1b[C", Key::Right),
            (b"\x1b[1;5C", Key::Right),
            (b"\x1b[D", Key::Left),
            (b"\x1b[H", Key::Home),
            (b"\x1bOH", Key::Home),
            (b"\x1b[1~", Key::Home),
            (b"\x1b[7~", Key::Home),
            (b"\x1b[F", Key::End),
            (b"\x1bOF", Key::End),
            (b"\x1b[4~", Key::End),
            (b"\x1b[8~", Key::End),
            (b"\x1b[3~", Key::Delete),
            (b"\x1b[3;2~", Key::Delete),
        ] {
            assert_eq!(decoded_keys(bytes), [key], "{bytes:?}");
        }
        for nothing in
            [&b"\0"[..], b"\x02", b"\x1b", b"\x1b[", b"\x1b[5~", b"\x1b[13~", b"\x1b[Z", b"\x80", b"\xff", b"\x1b\x1b"]
        {
            assert_eq!(decoded_keys(nothing), [], "{nothing:?}");
        }
        assert_eq!(decoded_keys(b"\r\r\n\n"), [Key::Enter; 3]);
        assert_eq!(decoded_keys(b"\r\0\n"), [Key::Enter; 2]);
    }

    /// An invalid byte ends a sequence and counts as a key, a line end in particular.
    #[test]
    fn a_broken_escape_sequence_drops_no_further_key() {
        let x = Key::Character(b'x');
        for (bytes, found) in [
            (&b"\x1bx"[..], &[x][..]),
            (b"\x1b[\r", &[Key::Enter]),
            (b"\x1b[12\x03x", &[Key::Cancel, x]),
            (b"\x1b[99999999999999999999A", &[Key::Up]),
            (b"\x1b[\x1b[Hx", &[Key::Home, x]),
            (b"\x1b\x1b[Hx", &[Key::Home, x]),
            (b"\x1b[3\xffx", &[x]),
        ] {
            assert_eq!(decoded_keys(bytes), found, "{bytes:?}");
        }
    }

    #[derive(Default)]
    struct Screen {
        cells: std::vec::Vec<char>,
        column: usize,
    }

    impl fmt::Write for Screen {
        fn write_str(&mut self, text: &str) -> fmt::Result {
            let text = text.replace("\x1b[2K", "\x1b");
            for c in text.chars() {
                match c {
                    '\r' => self.column = 0,
                    '\x08' => self.column -= 1,
                    '\x1b' => self.cells.fill(' '),
                    c => {
                        self.cells.resize(self.cells.len().max(self.column + 1), ' ');
                        self.cells[self.column] = c;
                        self.column += 1;
                    }
                }
            }
            Ok(())
        }
    }

    /// Types bytes, and checks after each key that the screen shows the line and the cursor.
    fn type_bytes(editor: &mut Editor, screen: &mut Screen, bytes: &[u8]) {
        let mut keys = KeyDecoder::default();
        for key in bytes.iter().filter_map(|&byte| keys.push_byte(byte)) {
            if key == Key::Enter {
                editor.submit_line();
                editor.draw_line(screen);
            }
            editor.process_key(key, screen);
            let shown: String = screen.cells.iter().collect();
            assert_eq!(shown.trim_end(), format!("> {}", editor.line()).trim_end(), "{key:?}");
            assert_eq!(screen.column, 2 + editor.cursor, "{key:?}");
        }
    }

    fn new_editor_and_screen() -> (Editor, Screen) {
        let (editor, mut screen) = (Editor::default(), Screen::default());
        editor.draw_line(&mut screen);
        (editor, screen)
    }

    #[test]
    fn keys_edit_the_line() {
        for (bytes, line, before) in [
            (&b"status"[..], "status", "status"),
            (b"statusx\x7f", "status", "status"),
            (b"\x7f\x7fa", "a", "a"),
            (b"tatus\x1b[Hs", "status", "s"),
            (b"statu\x1b[H\x1b[Fs", "status", "status"),
            (b"sttus\x1b[D\x1b[D\x1b[Da", "status", "sta"),
            (b"staatus\x1b[D\x1b[D\x1b[D\x7f", "status", "sta"),
            (b"staatus\x01\x1b[C\x1b[C\x1b[3~", "status", "st"),
            (b"status\x1b[3~", "status", "status"),
            (b"\x1b[3~\x1b[D\x1b[Cab\x1b[D\x1b[D\x1b[D\x1b[D", "ab", ""),
            (b"nonsense\x15status", "status", "status"),
            (b"cal status\x1b[D\x1b[D\x1b[D\x1b[D\x1b[D\x1b[D\x15", "status", ""),
        ] {
            let (mut editor, mut screen) = new_editor_and_screen();
            type_bytes(&mut editor, &mut screen, bytes);
            assert_eq!((editor.line(), editor.text_before_cursor()), (line, before), "{bytes:?}");
        }
    }

    #[test]
    fn earlier_lines_are_recalled() {
        let (mut editor, mut screen) = new_editor_and_screen();
        type_bytes(&mut editor, &mut screen, b"\x1b[A\x1b[B");
        assert_eq!(editor.line(), "");
        type_bytes(&mut editor, &mut screen, b"one\rtwo\rtwo\r\rthree\r");
        for (key, line) in [
            (&b"\x1b[A"[..], "three"),
            (b"\x1b[A", "two"),
            (b"\x1b[A", "one"),
            (b"\x1b[A", "one"),
            (b"\x1b[B", "two"),
            (b"x", "twox"),
            (b"\x1b[B", "three"),
            (b"\x1b[B", ""),
            (b"\x1b[B", ""),
            (b"typed\x1b[A", "three"),
        ] {
            type_bytes(&mut editor, &mut screen, key);
            assert_eq!((editor.line(), editor.text_before_cursor()), (line, line), "{key:?}");
        }
        // A recalled line that is entered is the newest again.
        type_bytes(&mut editor, &mut screen, b"\x15\x1b[A\x1b[A\r\x1b[A");
        assert_eq!(editor.line(), "two");
    }

    /// 256 characters, line feeds included, hold three lines of full length; the oldest are dropped.
    #[test]
    fn history_holds_three_long_lines() {
        let (mut editor, mut screen) = new_editor_and_screen();
        for character in b'a'..=b'z' {
            type_bytes(&mut editor, &mut screen, &[character; LINE_CAPACITY]);
            type_bytes(&mut editor, &mut screen, b"\r");
        }
        for character in ["z", "y", "x", "x"] {
            type_bytes(&mut editor, &mut screen, b"\x1b[A");
            assert_eq!(editor.line(), character.repeat(LINE_CAPACITY));
        }
    }

    /// Characters beyond the capacity are counted, so that deleting them makes the line valid again; they are never
    /// inserted.
    #[test]
    fn characters_beyond_the_capacity_are_counted() {
        let (mut editor, mut screen) = new_editor_and_screen();
        type_bytes(&mut editor, &mut screen, &[b'a'; LINE_CAPACITY]);
        assert!(!editor.is_too_long());
        type_bytes(&mut editor, &mut screen, b"bc\x7f");
        assert!(editor.is_too_long());
        type_bytes(&mut editor, &mut screen, b"\x7f");
        assert!(!editor.is_too_long() && editor.line() == "a".repeat(LINE_CAPACITY));
        // No excess character is inserted in the middle of the line, nor another one after a deletion.
        type_bytes(&mut editor, &mut screen, b"\x1b[Dx\x1b[3~y");
        assert!(editor.is_too_long() && !editor.line().contains('y'));
        type_bytes(&mut editor, &mut screen, b"\r\x1b[A");
        assert_eq!(editor.line(), "", "it is not in history");
        type_bytes(&mut editor, &mut screen, &[b'a'; LINE_CAPACITY + 1]);
        type_bytes(&mut editor, &mut screen, b"\x15");
        assert!(!editor.is_too_long() && editor.line().is_empty());
    }

    /// Random bytes: the screen shows the line, the cursor stays within it, and only printable characters are stored.
    #[test]
    fn no_input_stops_the_editor() {
        let mut random = testkit::random::Random(3);
        let (mut editor, mut screen) = new_editor_and_screen();
        for _ in 0..3000 {
            let mut bytes = random.bytes(20);
            for byte in &mut bytes {
                if random.byte() < 100 {
                    *byte = b"\x1b[[[ABCDHF~3O\x7f\x08\r"[usize::from(*byte % 16)];
                }
            }
            type_bytes(&mut editor, &mut screen, &bytes);
            assert!(editor.cursor <= editor.line.len());
            assert!(
                editor.line.iter().chain(&editor.history).all(|byte| (b' '..=b'~').contains(byte) || *byte == b'\n')
            );
        }
    }
}
