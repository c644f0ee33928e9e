//! Encodings of the numbers in a frame (`blackbox_encoding.c`).

/// Reads numbers from the start of a frame.
pub struct FrameBytes<'a> {
    pub bytes: &'a [u8],
    pub position: usize,
}

/// Packings of `TAG2_3S32` by its tag: number of bytes, position of the lowest bit of each value, and bits of a value.
const PACKINGS: [(u8, [u8; 3], u32); 3] = [(1, [4, 2, 0], 2), (2, [8, 4, 0], 4), (3, [16, 8, 0], 6)];

impl FrameBytes<'_> {
    pub fn next_byte(&mut self) -> Option<u8> {
        let byte = self.bytes.get(self.position).copied();
        self.position += 1;
        byte
    }

    /// A number of seven bits a byte, lowest first.
    pub fn unsigned(&mut self) -> Option<u32> {
        let mut number = 0;
        for shift in (0..u32::BITS).step_by(7) {
            let byte = self.next_byte()?;
            number |= u32::from(byte & 0x7F) << shift;
            if byte < 0x80 {
                return Some(number);
            }
        }
        None
    }

    /// The same with the sign in the lowest bit.
    fn signed(&mut self) -> Option<i32> {
        let number = self.unsigned()?;
        Some((number >> 1).cast_signed() ^ -(number & 1).cast_signed())
    }

    /// Numbers of fields with these encodings; `None` if the frame ends before, or an encoding is unknown.
    pub fn decode_numbers(&mut self, encodings: &[u8]) -> Option<Vec<i32>> {
        let mut numbers = Vec::with_capacity(encodings.len());
        while let Some(&encoding) = encodings.get(numbers.len()) {
            let remaining = &encodings[numbers.len()..];
            let group_of = |limit: usize| remaining.iter().take(limit).take_while(|other| **other == encoding).count();
            match encoding {
                0 => numbers.push(self.signed()?),
                1 => numbers.push(self.unsigned()?.cast_signed()),
                3 => numbers.push(-sign_extend(self.unsigned()?, 14)),
                6 => self.decode_nonzero(group_of(8), &mut numbers)?,
                7 => numbers.extend(&self.decode_packed()?[..group_of(3)]),
                8 => numbers.extend(&self.decode_nibbles()?[..group_of(4)]),
                9 => numbers.push(0),
                _ => return None,
            }
        }
        Some(numbers)
    }

    /// `TAG8_8SVB`: a bit for each number that is not zero, lowest first, unless there is one number only.
    fn decode_nonzero(&mut self, count: usize, numbers: &mut Vec<i32>) -> Option<()> {
        let tag = if count == 1 { 1 } else { self.next_byte()? };
        for bit in 0..count {
            numbers.push(if tag >> bit & 1 == 0 { 0 } else { self.signed()? });
        }
        Some(())
    }

    /// `TAG2_3S32`: three numbers of the same number of bits, or of 1 to 4 bytes each.
    fn decode_packed(&mut self) -> Option<[i32; 3]> {
        let first = self.next_byte()?;
        let mut numbers = [0; 3];
        if let Some((byte_count, shifts, bits)) = PACKINGS.get(usize::from(first >> 6)) {
            let mut packed = u32::from(first);
            for _ in 1..*byte_count {
                packed = packed << 8 | u32::from(self.next_byte()?);
            }
            numbers = shifts.map(|shift| sign_extend(packed >> shift, *bits));
        } else {
            for (index, number) in numbers.iter_mut().enumerate() {
                let byte_count = u32::from(first >> (2 * index) & 3) + 1;
                let mut value = 0;
                for byte in 0..byte_count {
                    value |= u32::from(self.next_byte()?) << (8 * byte);
                }
                *number = sign_extend(value, 8 * byte_count);
            }
        }
        Some(numbers)
    }

    /// `TAG8_4S16`: two bits for each of four numbers say that it has 0, 1, 2 or 4 nibbles; high nibbles are first.
    fn decode_nibbles(&mut self) -> Option<[i32; 4]> {
        let (tag, mut low_nibble, mut numbers) = (self.next_byte()?, None, [0; 4]);
        for (index, number) in numbers.iter_mut().enumerate() {
            let nibble_count = [0, 1, 2, 4][usize::from(tag >> (2 * index) & 3)];
            let mut value = 0;
            for _ in 0..nibble_count {
                let nibble = if let Some(nibble) = low_nibble.take() {
                    nibble
                } else {
                    let byte = self.next_byte()?;
                    low_nibble = Some(byte & 0xF);
                    byte >> 4
                };
                value = value << 4 | u32::from(nibble);
            }
            *number = sign_extend(value, 4 * nibble_count);
        }
        Some(numbers)
    }
}

/// The number in the lowest bits.
const fn sign_extend(value: u32, bits: u32) -> i32 {
    if bits == 0 {
        return 0;
    }
    let unused = u32::BITS - bits;
    (value << unused).cast_signed() >> unused
}

#[cfg(test)]
mod tests {
    use super::*;

    /// By the packings of `blackbox_encoding.c`: seven bits a byte; the sign lowest; negated; marked if not zero; 2, 4 or 6
    /// bits, or 1 to 4 bytes; nibbles.
    #[test]
    fn each_encoding_gives_its_numbers() {
        let cases: [(u8, &[u8], &[i32]); 12] = [
            (1, &[0xAC, 0x02], &[300]),
            (0, &[0x03], &[-2]),
            (3, &[0x05], &[-5]),
            (6, &[0x04], &[2]),
            (6, &[0b101, 0x02, 0x01], &[1, 0, -1]),
            (7, &[0b00_01_11_10], &[1, -1, -2]),
            (7, &[0x47, 0x8F], &[7, -8, -1]),
            (7, &[0x9F, 0x20, 0x3F], &[31, -32, -1]),
            (7, &[0b11_11_01_00, 0xFF, 0x00, 0x01, 0, 0, 0, 0x80], &[-1, 256, i32::MIN]),
            (8, &[0b11_10_01_00, 0x78, 0x01, 0x23, 0x40], &[0, 7, -128, 0x1234]),
            (8, &[0x00], &[0; 4]),
            (9, &[], &[0]),
        ];
        for (encoding, bytes, numbers) in cases {
            let mut frame = FrameBytes { bytes, position: 0 };
            let decoded = frame.decode_numbers(&vec![encoding; numbers.len()]);
            assert_eq!((decoded.as_deref(), frame.position), (Some(numbers), bytes.len()), "{encoding} {bytes:?}");
        }
        let mut endless = FrameBytes { bytes: &[0x80; 8], position: 0 };
        assert_eq!(
            [endless.decode_numbers(&[1]), FrameBytes { bytes: &[], position: 0 }.decode_numbers(&[2])],
            [None, None]
        );
    }
}
