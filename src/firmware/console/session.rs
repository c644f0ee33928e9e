//! A console session: received bytes in, requests out, echo and replies buffered for sending.

use core::fmt::{self, Write};

use super::line_editor::{Editor, Key, KeyDecoder, PROMPT};
use super::parser::{self, LineError};
use crate::console::command_table::Request;
use crate::console::parser::parse_request;
use crate::console::wrapped_lines::WrappedLines;

/// Output buffer. The longest reply, `status` after a full line of echo, takes half of it. Output beyond the capacity
/// is cut: a terminal that accepts no bytes must not stop the module.
#[derive(Debug, Default)]
pub struct ConsoleOutput(heapless::Vec<u8, 2048>);

/// Writes carriage return and line feed for a line end.
impl Write for ConsoleOutput {
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

/// Session of one terminal.
#[derive(Debug)]
pub struct Session {
    keys: KeyDecoder,
    editor: Editor,
    output: ConsoleOutput,
}

impl Session {
    /// Creates a session with greeting and prompt in the output.
    pub fn new(greeting: impl FnOnce(&mut ConsoleOutput) -> fmt::Result) -> Self {
        let mut session =
            Self { keys: KeyDecoder::default(), editor: Editor::default(), output: ConsoleOutput::default() };
        session.write_reply(greeting);
        session
    }

    /// Pending output.
    #[must_use]
    pub fn pending_output(&self) -> &[u8] {
        &self.output.0
    }

    /// Clears the output after it was sent.
    pub fn clear_output(&mut self) {
        self.output.0.clear();
    }

    /// Processes a received byte; returns a request or an error at the end of a line that is not empty. The caller then
    /// has to call [`write_reply`](Self::write_reply).
    pub fn process_byte(&mut self, byte: u8) -> Option<Result<Request, LineError>> {
        match self.keys.push_byte(byte)? {
            Key::Enter => return self.submit_line(),
            Key::Tab => self.complete_line(),
            Key::Cancel => {
                self.editor.clear();
                self.write_text("^C\n");
                self.write_text(PROMPT);
            }
            key => self.editor.process_key(key, &mut self.output),
        }
        None
    }

    /// Writes the reply to the last line, then the prompt.
    pub fn write_reply(&mut self, write: impl FnOnce(&mut ConsoleOutput) -> fmt::Result) {
        // Writing to this output never fails.
        let _ = write(&mut self.output);
        self.write_text(PROMPT);
    }

    /// Writes an unsolicited message, and redraws the line being typed.
    pub fn write_notice(&mut self, write: impl FnOnce(&mut ConsoleOutput) -> fmt::Result) {
        self.write_text("\r\x1b[2K");
        let _ = write(&mut self.output);
        self.editor.draw_line(&mut self.output);
    }

    fn write_text(&mut self, text: &str) {
        let _ = self.output.write_str(text);
    }

    fn submit_line(&mut self) -> Option<Result<Request, LineError>> {
        self.write_text("\n");
        let entered =
            if self.editor.is_too_long() { Some(Err(LineError::TooLong)) } else { parse_request(self.editor.line()) };
        self.editor.submit_line();
        if entered.is_none() {
            self.write_text(PROMPT);
        }
        entered
    }

    /// Inserts the common continuation of all matching words, or lists the words if they share none.
    fn complete_line(&mut self) {
        let Self { editor, output, .. } = self;
        let completion = parser::complete_line(editor.text_before_cursor(), &mut |_| {});
        for byte in completion.continuation.bytes().chain((completion.match_count == 1).then_some(b' ')) {
            editor.process_key(Key::Character(byte), output);
        }
        if completion.continuation.is_empty() && completion.match_count > 1 {
            let _ = output.write_str("\n");
            let mut lines = WrappedLines::new(output);
            parser::complete_line(editor.text_before_cursor(), &mut |word| {
                let _ = write!(lines, "{word}  ");
            });
            let _ = lines.write_str("\n");
            editor.draw_line(output);
        }
    }
}
