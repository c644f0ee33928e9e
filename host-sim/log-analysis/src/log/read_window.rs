//! Buffered reader with bounded look-ahead.

use std::io::{self, Read};

/// Largest look-ahead, bytes: more than any message of any format.
pub const MAX_PEEK_BYTES: usize = 1 << 17;

pub struct ReadWindow<'a> {
    source: &'a mut dyn Read,
    buffer: Vec<u8>,
    buffered_start: usize,
    buffered_end: usize,
    is_at_end: bool,
}

impl<'a> ReadWindow<'a> {
    pub fn new(source: &'a mut dyn Read) -> Self {
        Self { source, buffer: vec![0; 2 * MAX_PEEK_BYTES], buffered_start: 0, buffered_end: 0, is_at_end: false }
    }

    /// Returns the next `byte_count` bytes without consuming them, fewer at the end of the source.
    pub fn peek_bytes(&mut self, byte_count: usize) -> io::Result<&[u8]> {
        let byte_count = byte_count.min(MAX_PEEK_BYTES);
        while self.buffered_end - self.buffered_start < byte_count && !self.is_at_end {
            if self.buffer.len() - self.buffered_start < MAX_PEEK_BYTES {
                self.buffer.copy_within(self.buffered_start..self.buffered_end, 0);
                (self.buffered_start, self.buffered_end) = (0, self.buffered_end - self.buffered_start);
            }
            match self.source.read(&mut self.buffer[self.buffered_end..]) {
                Ok(0) => self.is_at_end = true,
                Ok(byte_count_read) => self.buffered_end += byte_count_read,
                Err(e) if e.kind() == io::ErrorKind::Interrupted => {}
                Err(e) => return Err(e),
            }
        }
        let buffered_end = self.buffered_end.min(self.buffered_start + byte_count);
        Ok(&self.buffer[self.buffered_start..buffered_end])
    }

    /// Consumes the next line and returns it without its end; none at the end of the source. Splits lines longer than
    /// [`MAX_PEEK_BYTES`].
    pub fn next_line(&mut self) -> io::Result<Option<String>> {
        const READ_CHUNK_BYTES: usize = 4096;
        for byte_count in [READ_CHUNK_BYTES, MAX_PEEK_BYTES] {
            let bytes = self.peek_bytes(byte_count)?;
            let line_length = bytes.iter().position(|&byte| byte == b'\n');
            if line_length.is_none() && bytes.len() == READ_CHUNK_BYTES && byte_count == READ_CHUNK_BYTES {
                continue;
            }
            if bytes.is_empty() {
                break;
            }
            let bytes = &bytes[..line_length.unwrap_or(bytes.len())];
            let (line, length) = (String::from_utf8_lossy(bytes).trim_end_matches('\r').to_owned(), bytes.len() + 1);
            self.consume_bytes(length);
            return Ok(Some(line));
        }
        Ok(None)
    }

    /// Consumes bytes returned by [`Self::peek_bytes`].
    pub fn consume_bytes(&mut self, byte_count: usize) {
        self.buffered_start = self.buffered_end.min(self.buffered_start + byte_count);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A source that returns 1 to 7 bytes at a time.
    struct ShortReads<'a>(&'a [u8], usize);

    impl Read for ShortReads<'_> {
        fn read(&mut self, into: &mut [u8]) -> io::Result<usize> {
            self.1 = self.1 % 7 + 1;
            let number = self.1.min(into.len()).min(self.0.len());
            into[..number].copy_from_slice(&self.0[..number]);
            self.0 = &self.0[number..];
            Ok(number)
        }
    }

    #[test]
    fn lines_end_at_line_feeds_and_long_lines_are_cut() {
        let long = "x".repeat(MAX_PEEK_BYTES + 10);
        let text = format!("a\r\n\n{}\n{long}\nlast", "b".repeat(5000));
        let bytes = text.into_bytes();
        let mut source = ShortReads(&bytes, 0);
        let mut window = ReadWindow::new(&mut source);
        let lengths: Vec<usize> = std::iter::from_fn(|| window.next_line().unwrap()).map(|line| line.len()).collect();
        assert_eq!(lengths, [1, 0, 5000, MAX_PEEK_BYTES, 9, 4]);
    }

    #[test]
    fn every_byte_comes_once_and_in_order() {
        let bytes: Vec<u8> = (0..1_000_000_u32).map(|i| (i % 251) as u8).collect();
        let mut source = ShortReads(&bytes, 0);
        let mut window = ReadWindow::new(&mut source);
        let (mut consumed, mut step) = (Vec::new(), 1);
        loop {
            step = (step * 31 + 7) % 5_000 + 1;
            let peeked = window.peek_bytes(step).unwrap().to_vec();
            if peeked.is_empty() {
                break;
            }
            assert!(peeked.len() == step || consumed.len() + peeked.len() == bytes.len());
            window.consume_bytes(peeked.len());
            consumed.extend(peeked);
        }
        assert!(consumed == bytes);
    }
}
