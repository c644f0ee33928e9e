//! Text of a message with a limited length.

use core::fmt;

/// Capacity, characters: five chunks of a STATUSTEXT, three of a LogMessage.
const TEXT_CAPACITY: usize = 240;

/// Text of limited length; characters beyond the capacity are cut.
#[derive(Debug, Default)]
pub(super) struct BoundedText(heapless::Vec<u8, TEXT_CAPACITY>);

impl BoundedText {
    /// Bytes of the text.
    pub fn bytes(&self) -> &[u8] {
        &self.0
    }
}

impl fmt::Write for BoundedText {
    fn write_str(&mut self, text: &str) -> fmt::Result {
        for byte in text.bytes() {
            let _ = self.0.push(byte);
        }
        Ok(())
    }
}
