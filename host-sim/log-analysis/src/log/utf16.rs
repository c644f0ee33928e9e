//! Text in UTF-16 with a byte-order mark, as spreadsheets save it.

use std::io::{self, Read};

/// The text of a source whose `first_bytes` are a byte-order mark; invalid units become U+FFFD. Only tables are in UTF-16,
/// and no spreadsheet saves one this long.
pub(super) fn utf16_text(first_bytes: &[u8], source: &mut dyn Read) -> io::Result<Option<String>> {
    const MAX_BYTES: u64 = 1 << 28;
    let decode_unit = match first_bytes {
        [0xFF, 0xFE, ..] => u16::from_le_bytes,
        [0xFE, 0xFF, ..] => u16::from_be_bytes,
        _ => return Ok(None),
    };
    let mut bytes = Vec::new();
    source.take(MAX_BYTES).read_to_end(&mut bytes)?;
    let units: Vec<u16> = bytes.as_chunks().0.iter().skip(1).map(|pair| decode_unit(*pair)).collect();
    Ok(Some(String::from_utf16_lossy(&units)))
}
