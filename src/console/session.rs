//! A console session: bytes in, requests out, echo and replies gathered for sending.

use core::cell::{Cell, RefCell};
use core::convert::Infallible;
use core::fmt;

use embedded_cli::cli::{Cli, CliBuilder, CliHandle};
use embedded_cli::command::RawCommand;

use super::{LINE_CAPACITY, Line, LineError, Request, parse};

/// What stands before the cursor when a line is awaited.
pub const PROMPT: &str = "> ";

/// The Unicode minus sign: how a `-` before a number passes embedded-cli, which would take `-3` for an option.
pub(super) const MINUS: char = '\u{2212}';

/// Output waiting to be sent. The longest, `status` after a whole line of echo, takes half of it.
pub type Output = heapless::Vec<u8, 2048>;

/// Gathers what the line editor and the replies write, until the task sends it. What does not fit is cut: a terminal
/// that takes nothing must not stop the module.
#[derive(Clone, Copy, Debug)]
pub struct Sink<'a>(&'a RefCell<Output>);

impl embedded_io::ErrorType for Sink<'_> {
    type Error = Infallible;
}

/// For the line editor, which hands over whole characters.
impl embedded_io::Write for Sink<'_> {
    fn write(&mut self, bytes: &[u8]) -> Result<usize, Self::Error> {
        let mut output = self.0.borrow_mut();
        for c in core::str::from_utf8(bytes).unwrap_or_default().chars() {
            let plain = if c == MINUS { '-' } else { c };
            let _ = output.push(u8::try_from(plain).unwrap_or(b'?'));
        }
        Ok(bytes.len())
    }

    fn flush(&mut self) -> Result<(), Self::Error> {
        Ok(())
    }
}

/// For replies; line ends become those of terminals.
impl fmt::Write for Sink<'_> {
    fn write_str(&mut self, text: &str) -> fmt::Result {
        let mut output = self.0.borrow_mut();
        for byte in text.bytes() {
            if byte == b'\n' {
                let _ = output.push(b'\r');
            }
            let _ = output.push(byte);
        }
        Ok(())
    }
}

/// One terminal's line editor.
pub struct Session<'a> {
    cli: Cli<Sink<'a>, Infallible, [u8; LINE_CAPACITY + 16], [u8; 256]>,
    sink: Sink<'a>,
    previous: u8,
    /// Characters typed since the last line end.
    typed: usize,
}

impl<'a> Session<'a> {
    /// A session that writes into `output`: prints the greeting and the prompt.
    pub fn new(output: &'a RefCell<Output>, greeting: impl FnOnce(&mut Sink<'a>) -> fmt::Result) -> Self {
        let mut sink = Sink(output);
        // A sink never fails.
        let _ = greeting(&mut sink);
        let Ok(cli) = CliBuilder::default()
            .writer(sink)
            .command_buffer([0; LINE_CAPACITY + 16])
            .history_buffer([0; 256])
            .prompt(PROMPT)
            .build();
        Self { cli, sink, previous: 0, typed: 0 }
    }

    /// Takes a byte from the terminal; gives a request, or what is wrong with it, when it ends a line that holds one.
    /// Bytes that no key sends are passed over.
    pub fn byte(&mut self, byte: u8) -> Option<Result<Request, LineError>> {
        let previous = core::mem::replace(&mut self.previous, byte);
        match byte {
            b'\r' | b'\n' => return self.line_end(byte),
            0x08 | 0x7F => {
                self.typed = self.typed.saturating_sub(1);
                return self.feed(0x08);
            }
            b' '..=b'~' => self.typed += 1,
            b'\t' | 0x1B => {}
            _ => return None,
        }
        if self.typed > LINE_CAPACITY {
            return None;
        }
        if byte == b'-' && previous == b' ' {
            let mut utf8 = [0; 4];
            let minus = MINUS.encode_utf8(&mut utf8);
            return minus.bytes().filter_map(|b| self.feed(b)).last();
        }
        self.feed(byte)
    }

    fn line_end(&mut self, byte: u8) -> Option<Result<Request, LineError>> {
        let too_long = core::mem::take(&mut self.typed) > LINE_CAPACITY;
        if too_long {
            for _ in 0..LINE_CAPACITY {
                self.feed(0x08);
            }
        }
        let entered = self.feed(byte);
        if too_long { Some(Err(LineError::TooLong)) } else { entered }
    }

    fn feed(&mut self, byte: u8) -> Option<Result<Request, LineError>> {
        // A cell, because the processor's opaque type keeps its borrow to the end of this function.
        let entered = Cell::new(None);
        let mut process = RawCommand::processor(|_: &mut CliHandle<'_, Sink<'a>, Infallible>, raw| {
            entered.set(Some(parse(raw)));
            Ok(())
        });
        let Ok(()) = self.cli.process_byte::<Line<'_>, _>(byte, &mut process);
        entered.take()
    }

    /// Writes the reply to the line just entered, then the prompt.
    pub fn reply(&mut self, write: impl FnOnce(&mut Sink<'a>) -> fmt::Result) {
        {
            let mut output = self.sink.0.borrow_mut();
            // The editor has prompted already; the reply goes before that.
            if output.ends_with(PROMPT.as_bytes()) {
                let keep = output.len() - PROMPT.len();
                output.truncate(keep);
            }
        }
        let _ = write(&mut self.sink);
        let _ = fmt::Write::write_str(&mut self.sink, PROMPT);
    }

    /// Writes a line between what the person is typing.
    pub fn notice(&mut self, write: impl FnOnce(&mut Sink<'a>) -> fmt::Result) {
        let mut sink = self.sink;
        let Ok(()) = self.cli.write(|_| {
            let _ = write(&mut sink);
            Ok(())
        });
    }
}
