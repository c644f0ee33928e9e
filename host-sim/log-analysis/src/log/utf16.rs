//! Text in UTF-16 with a byte-order mark, as spreadsheets save it, decoded to UTF-8.

use std::io::{self, Read};

/// Reader of UTF-8 from a source in UTF-16; invalid units become U+FFFD.
pub(super) struct Utf16Text<R> {
    source: R,
    decode_unit: fn([u8; 2]) -> u16,
    /// First byte of a unit whose second one is not read yet.
    half_unit: Option<u8>,
    /// First unit of a pair whose second one is not read yet.
    high_surrogate: Option<u16>,
    decoded: io::Cursor<Vec<u8>>,
}

impl<R: Read> Utf16Text<R> {
    /// Text after the byte-order mark; none if `first_bytes`, the start of the source, has no mark.
    pub fn new(first_bytes: &[u8], mut source: R) -> io::Result<Option<Self>> {
        let decode_unit = match first_bytes {
            [0xFF, 0xFE, ..] => u16::from_le_bytes,
            [0xFE, 0xFF, ..] => u16::from_be_bytes,
            _ => return Ok(None),
        };
        source.read_exact(&mut [0; 2])?;
        let decoded = io::Cursor::default();
        Ok(Some(Self { source, decode_unit, half_unit: None, high_surrogate: None, decoded }))
    }

    fn decode(&mut self, bytes: &[u8]) {
        let bytes: Vec<u8> = self.half_unit.take().into_iter().chain(bytes.iter().copied()).collect();
        let (pairs, half_unit) = bytes.as_chunks::<2>();
        self.half_unit = half_unit.first().copied();
        let mut units: Vec<u16> =
            self.high_surrogate.take().into_iter().chain(pairs.iter().map(|pair| (self.decode_unit)(*pair))).collect();
        self.high_surrogate = units.pop_if(|unit| matches!(unit, 0xD800..=0xDBFF));
        let characters = char::decode_utf16(units).map(|unit| unit.unwrap_or(char::REPLACEMENT_CHARACTER));
        self.decoded = io::Cursor::new(characters.collect::<String>().into_bytes());
    }
}

impl<R: Read> Read for Utf16Text<R> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let mut bytes = [0; 4096];
        loop {
            let byte_count = self.decoded.read(buffer)?;
            if byte_count > 0 || buffer.is_empty() {
                return Ok(byte_count);
            }
            let byte_count = self.source.read(&mut bytes)?;
            if byte_count == 0 {
                return Ok(0);
            }
            self.decode(&bytes[..byte_count]);
        }
    }
}
