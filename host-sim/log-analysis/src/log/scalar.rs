//! Numbers of binary logs, little-endian.

/// Type of a number, with its length in bytes, at most eight.
#[derive(Clone, Copy, PartialEq, Eq)]
pub enum ScalarType {
    Signed(usize),
    Unsigned(usize),
    Float(usize),
}

impl ScalarType {
    pub const fn byte_len(self) -> usize {
        let (Self::Signed(byte_len) | Self::Unsigned(byte_len) | Self::Float(byte_len)) = self;
        byte_len
    }

    /// The number at the start of these bytes.
    pub fn decode_number(self, bytes: &[u8]) -> Option<f64> {
        let bytes = bytes.get(..self.byte_len())?;
        let is_negative = matches!(self, Self::Signed(_)) && bytes.last().is_some_and(|byte| *byte >= 0x80);
        let mut wide = [if is_negative { 0xFF } else { 0 }; size_of::<i128>()];
        wide[..bytes.len()].copy_from_slice(bytes);
        let number = i128::from_le_bytes(wide);
        Some(match self {
            Self::Float(4) => f64::from(f32::from_bits(number as u32)),
            Self::Float(_) => f64::from_bits(number as u64),
            _ => number as f64,
        })
    }
}
