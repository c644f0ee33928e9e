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
