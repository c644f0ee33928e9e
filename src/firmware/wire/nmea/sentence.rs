//! A sentence and its checksum.

/// ASCII sentence with checksum and line end; at most 82 characters by the standard.
pub type Sentence = heapless::Vec<u8, 82>;

/// Exclusive or of all characters between `$` and `*`.
#[must_use]
pub fn checksum(body: &[u8]) -> u8 {
    body.iter().fold(0, |sum, byte| sum ^ byte)
}
