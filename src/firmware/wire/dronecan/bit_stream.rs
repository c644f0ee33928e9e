//! Bit packing of DSDL: a value as little-endian bytes, a partial last byte left-aligned, the most significant bit
//! first.

use super::transfer::Payload;

/// Writer of a payload. Values beyond the capacity are cut: all sent messages are shorter.
#[derive(Debug, Default)]
pub(super) struct BitWriter {
    bytes: Payload,
    /// Unused low bits of the last byte.
    free_bits: u32,
}

impl BitWriter {
    /// Appends the low bits of a value.
    pub fn put_bits(&mut self, value: u64, bits: u32) {
        let (mut value, mut left) = (value, bits);
        while left > 0 {
            let count = left.min(8);
            self.put_bits_of_byte(value as u8, count);
            value >>= 8;
            left -= count;
        }
    }

    /// Appends values with their widths, bits.
    pub fn put_fields(&mut self, fields: &[(u64, u32)]) {
        for &(value, bits) in fields {
            self.put_bits(value, bits);
        }
    }

    /// Appends 1 to 8 low bits of a byte.
    fn put_bits_of_byte(&mut self, value: u8, count: u32) {
        let aligned = value << (8 - count);
        match self.bytes.last_mut().filter(|_| self.free_bits > 0) {
            None => {
                let _ = self.bytes.push(aligned);
                self.free_bits = 8 - count;
            }
            Some(last) => {
                *last |= aligned >> (8 - self.free_bits);
                if count > self.free_bits {
                    let _ = self.bytes.push(aligned << self.free_bits);
                    self.free_bits += 8;
                }
                self.free_bits -= count;
            }
        }
    }

    /// Appends bytes.
    pub fn put_bytes(&mut self, bytes: &[u8]) {
        if self.free_bits == 0 && self.bytes.extend_from_slice(bytes).is_ok() {
            return;
        }
        for &byte in bytes {
            self.put_bits_of_byte(byte, 8);
        }
    }

    /// Appends a number of half precision.
    pub fn put_f16(&mut self, value: f32) {
        self.put_bytes(&half::f16::from_f32(value).to_le_bytes());
    }

    /// The payload, with the last byte filled up with zeros.
    pub fn into_payload(self) -> Payload {
        self.bytes
    }
}

/// Reader of a payload. Bits beyond its end are zero.
#[derive(Debug)]
pub(super) struct BitReader<'a> {
    bytes: &'a [u8],
    bit_position: usize,
}

impl<'a> BitReader<'a> {
    pub const fn new(bytes: &'a [u8]) -> Self {
        Self { bytes, bit_position: 0 }
    }

    /// Next bits, at most 64.
    pub fn read_bits(&mut self, bits: u32) -> u64 {
        let (mut value, mut shift) = (0, 0);
        while shift < bits {
            let count = (bits - shift).min(8);
            value |= u64::from(self.read_bits_of_byte(count)) << shift;
            shift += 8;
        }
        value
    }

    /// Next 1 to 8 bits.
    fn read_bits_of_byte(&mut self, count: u32) -> u8 {
        let byte = |index| self.bytes.get(index).copied().unwrap_or(0);
        let index = self.bit_position / 8;
        let two = u16::from_be_bytes([byte(index), byte(index + 1)]);
        let value = (two << (self.bit_position % 8)) >> (16 - count);
        self.bit_position += count as usize;
        value as u8
    }

    /// Takes the next `bits` bits as a signed integer.
    pub fn read_signed(&mut self, bits: u32) -> i64 {
        let unused = 64 - bits;
        (self.read_bits(bits) << unused).cast_signed() >> unused
    }

    /// Next number of half precision.
    pub fn read_f16(&mut self) -> f32 {
        half::f16::from_bits(self.read_bits(16) as u16).to_f32()
    }

    /// Next bytes, fewer at the end of the payload. Only used where all values before are whole bytes.
    pub fn read_bytes(&mut self, count: usize) -> &'a [u8] {
        let rest = self.bytes.get(self.bit_position.div_ceil(8)..).unwrap_or_default();
        let taken = rest.get(..count).unwrap_or(rest);
        self.bit_position += 8 * taken.len();
        taken
    }

    /// All bytes up to the end.
    pub fn read_remaining_bytes(&mut self) -> &'a [u8] {
        self.read_bytes(usize::MAX)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Widths that leave every bit offset, with values of all ones and of a pattern.
    #[test]
    fn values_of_every_width_are_read_back_at_every_offset() {
        for offset in 0..8 {
            for width in 1..=64 {
                for pattern in [u64::MAX, 0x0123_4567_89AB_CDEF, 1] {
                    let value = pattern & (u64::MAX >> (64 - width));
                    let mut writer = BitWriter::default();
                    writer.put_bits(0, offset);
                    writer.put_bits(pattern, width);
                    writer.put_bits(1, 1);
                    let payload = writer.into_payload();
                    let mut reader = BitReader::new(&payload);
                    assert_eq!(reader.read_bits(offset), 0);
                    assert_eq!(reader.read_bits(width), value, "{width} bits at {offset}");
                    assert_eq!(reader.read_bits(1), 1);
                }
            }
        }
    }
}
