//! Header lines of a blackbox log, which name the fields of its frames and settings; encodings of the fields.

use std::collections::HashMap;

/// Largest number of header lines, and of fields in a frame; no firmware writes half as many.
const MAX_LINES: usize = 1000;
const MAX_FIELDS: usize = 256;

/// Values of the header lines by name: `H Data version:2`.
#[derive(Default)]
pub struct BlackboxHeader(HashMap<String, String>);

/// Fields of a kind of frame. No frame is read if the header declares them wrongly.
#[derive(Default)]
pub struct FrameFields {
    pub names: Vec<String>,
    predictors: Vec<u8>,
    encodings: Vec<u8>,
    first_motor: Option<usize>,
    minimum_throttle: i32,
    battery_reference: i32,
    minimum_motor: i32,
}

/// Frames that a frame is predicted by.
#[derive(Clone, Copy, Default)]
pub struct PrecedingFrames<'a> {
    pub last: &'a [i32],
    pub before_last: &'a [i32],
    /// Time of the last main frame, microseconds.
    pub time_us: i32,
    /// Latitude and longitude of the home position, 1e-7 deg.
    pub home: Option<[i32; 2]>,
}

impl BlackboxHeader {
    pub fn add_line(&mut self, line: &str) {
        if let Some((name, value)) = line.split_once(':').filter(|_| self.0.len() < MAX_LINES) {
            self.0.insert(name.to_owned(), value.to_owned());
        }
    }

    pub fn text(&self, name: &str) -> &str {
        self.0.get(name).map_or("", String::as_str)
    }

    /// The first number of a line; 0 for a missing or empty line.
    pub fn number(&self, name: &str) -> i32 {
        self.text(name).split(',').next().and_then(|number| number.parse().ok()).unwrap_or(0)
    }

    /// Fields of the frames that begin with this letter.
    pub fn layout(&self, letter: char) -> FrameFields {
        let values = |letter: char, property: &str| {
            let text = self.text(&format!("Field {letter} {property}"));
            text.split(',').map(|value| value.trim().to_owned()).take(MAX_FIELDS).collect::<Vec<_>>()
        };
        let numbers =
            |property: &str| values(letter, property).iter().map_while(|number| number.parse().ok()).collect();
        let names = values(if letter == 'P' { 'I' } else { letter }, "name");
        let (predictors, encodings): (Vec<u8>, Vec<u8>) = (numbers("predictor"), numbers("encoding"));
        if [predictors.len(), encodings.len()] != [names.len(); 2] {
            return FrameFields::default();
        }
        FrameFields {
            first_motor: names.iter().position(|name| name == "motor[0]"),
            names,
            predictors,
            encodings,
            minimum_throttle: self.number("minthrottle"),
            battery_reference: self.number("vbatref"),
            minimum_motor: self.number("motorOutput"),
        }
    }
}

impl FrameFields {
    pub fn index(&self, name: &str) -> Option<usize> {
        self.names.iter().position(|known| known == name)
    }

    /// Numbers of a frame; `None` if the bytes are not a frame.
    pub fn decode_frame(&self, bytes: &mut FrameBytes<'_>, preceding: &PrecedingFrames<'_>) -> Option<Vec<i32>> {
        let mut numbers = bytes.decode_numbers(&self.encodings).filter(|numbers| !numbers.is_empty())?;
        for index in 0..numbers.len() {
            numbers[index] = numbers[index].wrapping_add(self.prediction(index, &numbers, preceding)?);
        }
        Some(numbers)
    }

    /// What a field is the difference from (`FLIGHT_LOG_FIELD_PREDICTOR`).
    fn prediction(&self, index: usize, numbers: &[i32], preceding: &PrecedingFrames<'_>) -> Option<i32> {
        let of = |frame: &[i32]| frame.get(index).copied().unwrap_or(0);
        let (last, before_last) = (of(preceding.last), of(preceding.before_last));
        Some(match self.predictors[index] {
            0 => 0,
            1 => last,
            2 => last.wrapping_mul(2).wrapping_sub(before_last),
            3 => last.midpoint(before_last),
            4 => self.minimum_throttle,
            5 => numbers[self.first_motor.filter(|motor| *motor < index)?],
            6 => last.wrapping_add(1),
            7 => preceding.home?[usize::from(!self.names[index].ends_with("[0]"))],
            8 => 1500,
            9 => self.battery_reference,
            10 => preceding.time_us,
            11 => self.minimum_motor,
            _ => return None,
        })
    }
}

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
