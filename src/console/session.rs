//! A console session: bytes in, requests out, echo and replies gathered for sending.

use core::fmt::{self, Write};

use super::editor::{Editor, Key, Keys, PROMPT};
use super::language::{self, LineError};
use super::{Request, parse};

/// What waits to be sent. The longest, `status` after a whole line of echo, takes half of it. What does not fit is cut:
/// a terminal that takes nothing must not stop the module.
#[derive(Debug, Default)]
pub struct Output(heapless::Vec<u8, 2048>);

/// Line ends become those of terminals.
impl Write for Output {
    fn write_str(&mut self, text: &str) -> fmt::Result {
        for byte in text.bytes() {
            if byte == b'\n' {
                let _ = self.0.push(b'\r');
            }
            let _ = self.0.push(byte);
        }
        Ok(())
    }
}

/// One terminal.
#[derive(Debug)]
pub struct Session {
    keys: Keys,
    editor: Editor,
    output: Output,
}

impl Session {
    /// A session that has written its greeting and the prompt.
    pub fn new(greeting: impl FnOnce(&mut Output) -> fmt::Result) -> Self {
        let mut session = Self { keys: Keys::default(), editor: Editor::default(), output: Output::default() };
        session.reply(greeting);
        session
    }

    /// What waits to be sent.
    #[must_use]
    pub fn output(&self) -> &[u8] {
        &self.output.0
    }

    /// It has been sent.
    pub fn sent(&mut self) {
        self.output.0.clear();
    }

    /// Takes a byte from the terminal; gives a request, or what is wrong with it, when it ends a line that holds one.
    /// Then [`reply`](Self::reply) is awaited. Bytes that no key sends are passed over.
    pub fn byte(&mut self, byte: u8) -> Option<Result<Request, LineError>> {
        match self.keys.byte(byte)? {
            Key::Enter => return self.enter(),
            Key::Tab => self.complete(),
            Key::Cancel => {
                self.editor.clear();
                self.print("^C\n");
                self.print(PROMPT);
            }
            key => self.editor.key(key, &mut self.output),
        }
        None
    }

    /// Writes the reply to the line just entered, then the prompt.
    pub fn reply(&mut self, write: impl FnOnce(&mut Output) -> fmt::Result) {
        // The output never fails.
        let _ = write(&mut self.output);
        self.print(PROMPT);
    }

    /// Writes a line between what the person is typing.
    pub fn notice(&mut self, write: impl FnOnce(&mut Output) -> fmt::Result) {
        self.print("\r\x1b[2K");
        let _ = write(&mut self.output);
        self.editor.draw(&mut self.output);
    }

    fn print(&mut self, text: &str) {
        let _ = self.output.write_str(text);
    }

    fn enter(&mut self) -> Option<Result<Request, LineError>> {
        self.print("\n");
        let entered = if self.editor.is_too_long() { Some(Err(LineError::TooLong)) } else { parse(self.editor.line()) };
        self.editor.enter();
        if entered.is_none() {
            self.print(PROMPT);
        }
        entered
    }

    /// Adds what the words that fit have in common; if that is nothing, shows them.
    fn complete(&mut self) {
        let Self { editor, output, .. } = self;
        let found = language::complete(editor.before_cursor(), &mut |_| {});
        for byte in found.rest.bytes().chain((found.fit == 1).then_some(b' ')) {
            editor.key(Key::Character(byte), output);
        }
        if found.rest.is_empty() && found.fit > 1 {
            let _ = output.write_str("\n");
            language::complete(editor.before_cursor(), &mut |word| {
                let _ = write!(output, "{word}  ");
            });
            let _ = output.write_str("\n");
            editor.draw(output);
        }
    }
}
