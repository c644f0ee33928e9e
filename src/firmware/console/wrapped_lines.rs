//! Lines of a terminal, broken between words.

use core::fmt::{self, Write};

/// Width of a line, columns of the narrowest usual terminal.
const LINE_COLUMNS: usize = 79;

/// Capacity of a word and the space before it; a longer one may be broken.
const WORD_CAPACITY: usize = 24;

/// Writer that breaks longer lines between words. A word is written at the space or line end after it.
pub struct WrappedLines<'a> {
    out: &'a mut dyn Write,
    column: usize,
    word: heapless::String<WORD_CAPACITY>,
}

impl<'a> WrappedLines<'a> {
    /// Creates a writer at the beginning of a line.
    pub const fn new(out: &'a mut dyn Write) -> Self {
        Self { out, column: 0, word: heapless::String::new() }
    }

    fn end_word(&mut self) -> fmt::Result {
        if self.column + self.word.len() > LINE_COLUMNS {
            self.out.write_str("\n ")?;
            self.column = 1;
        }
        self.column += self.word.len();
        self.out.write_str(&self.word)?;
        self.word.clear();
        Ok(())
    }
}

impl Write for WrappedLines<'_> {
    fn write_str(&mut self, text: &str) -> fmt::Result {
        for character in text.chars() {
            if matches!(character, ' ' | '\n') || self.word.len() + character.len_utf8() > WORD_CAPACITY {
                self.end_word()?;
            }
            if character == '\n' {
                self.column = 0;
                self.out.write_char(character)?;
            } else {
                // A word has room: it was written when it was full.
                let _ = self.word.push(character);
            }
        }
        Ok(())
    }
}
