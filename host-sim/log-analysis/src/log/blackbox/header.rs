//! Header lines of a blackbox log: fields of the frames and settings.

use std::collections::HashMap;

use super::encoding::FrameBytes;

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

    /// The first number of a line, 0 if there is none.
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

    /// Numbers of a frame; `None` if the bytes are none.
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
