//! Syntaxes of DataFlash, binary and text. Binary: `A3 95`, message number, then the columns declared by a FMT message.

use std::collections::HashMap;
use std::io::{self, Read};

use super::super::flight::{LogFormat, LoggedFlight};
use super::super::read_window::ReadWindow;
use super::super::scalar::ScalarType;
use super::messages::{LogMessage, MESSAGES_TO_READ, ardupilot_builder, record_message};

const FRAME_START: [u8; 2] = [0xA3, 0x95];
const FMT_MESSAGE_NUMBER: u8 = 128;
const FMT_MESSAGE_LENGTH: usize = 89;
const HEADER_LENGTH: usize = 3;

pub fn matches_header(first_bytes: &[u8]) -> bool {
    let header = [FRAME_START[0], FRAME_START[1], FMT_MESSAGE_NUMBER];
    first_bytes
        .windows(FMT_MESSAGE_LENGTH)
        .any(|message| message.starts_with(&header) && MessageLayout::from_fmt(message).is_some())
}

/// Whether these are messages without definitions: frames at least as often as once in 256 bytes.
pub fn is_without_start(first_bytes: &[u8]) -> bool {
    const MIN_FRAMES: usize = 20;
    let frame_count = first_bytes.windows(FRAME_START.len()).filter(|window| *window == FRAME_START).count();
    frame_count >= MIN_FRAMES.max(first_bytes.len() / 256)
}

/// Whether the log is one of PX4's sdlog2, which has the same frames and other messages: its clock is `TIME.StartTime`.
pub fn is_sdlog2(first_bytes: &[u8]) -> bool {
    matches_header(first_bytes) && first_bytes.windows(9).any(|window| window == b"StartTime")
}

/// Reads a flight.
pub fn read_binary(source: &mut dyn Read) -> io::Result<LoggedFlight> {
    let mut window = ReadWindow::new(source);
    let mut layouts: [Option<MessageLayout>; 256] = std::array::from_fn(|_| None);
    let mut builder = ardupilot_builder(LogFormat::DataFlash);
    loop {
        let bytes = window.peek_bytes(256)?;
        let [first, second, message_number, ..] = *bytes else { break };
        let consumed_bytes = if [first, second] != FRAME_START {
            None
        } else if message_number == FMT_MESSAGE_NUMBER {
            bytes.get(..FMT_MESSAGE_LENGTH).map(|message| {
                if let Some((message_number, layout)) = MessageLayout::from_fmt(message) {
                    layouts[usize::from(message_number)] = Some(layout);
                }
                FMT_MESSAGE_LENGTH
            })
        } else {
            layouts[usize::from(message_number)].as_ref().and_then(|layout| {
                let body = bytes.get(HEADER_LENGTH..layout.length)?;
                if layout.is_wanted {
                    record_message(&mut builder, &layout.name, &BinaryMessage { layout, body });
                }
                Some(layout.length)
            })
        };
        builder.flight.skipped_counts.garbage += u64::from(consumed_bytes.is_none());
        window.consume_bytes(consumed_bytes.unwrap_or(1));
    }
    Ok(builder.finish_flight())
}

struct MessageLayout {
    length: usize,
    name: String,
    is_wanted: bool,
    columns: Vec<MessageColumn>,
}

struct MessageColumn {
    name: String,
    format_letter: u8,
    offset: usize,
}

impl MessageLayout {
    /// Parses number, length, name (4), format (16), columns (64); none if inconsistent.
    fn from_fmt(message: &[u8]) -> Option<(u8, Self)> {
        let [_, _, _, number, length, rest @ ..] = message else { return None };
        let (name, format_letters, names) =
            (decode_text(rest.get(..4)?), decode_text(rest.get(4..20)?), decode_text(rest.get(20..84)?));
        let mut byte_offset = 0;
        let mut columns = Vec::new();
        let mut names = names.split(',');
        for format_letter in format_letters.bytes() {
            columns.push(MessageColumn {
                name: names.next().unwrap_or_default().trim().to_owned(),
                format_letter,
                offset: byte_offset,
            });
            byte_offset += format_byte_len(format_letter)?;
        }
        let length = usize::from(*length);
        let is_wanted = MESSAGES_TO_READ.contains(&name.as_str());
        (length >= HEADER_LENGTH + byte_offset).then_some((*number, Self { length, name, is_wanted, columns }))
    }
}

/// Type of a column's number by its format letter, and the part of a unit that it counts (LogStructure.h).
const fn number_format(format_letter: u8) -> Option<(ScalarType, f64)> {
    Some(match format_letter {
        b'b' => (ScalarType::Signed(1), 1.0),
        b'B' | b'M' => (ScalarType::Unsigned(1), 1.0),
        b'h' => (ScalarType::Signed(2), 1.0),
        b'H' => (ScalarType::Unsigned(2), 1.0),
        b'c' => (ScalarType::Signed(2), 100.0),
        b'C' => (ScalarType::Unsigned(2), 100.0),
        b'i' => (ScalarType::Signed(4), 1.0),
        b'I' => (ScalarType::Unsigned(4), 1.0),
        b'e' => (ScalarType::Signed(4), 100.0),
        b'E' => (ScalarType::Unsigned(4), 100.0),
        b'L' => (ScalarType::Signed(4), 1e7),
        b'f' => (ScalarType::Float(4), 1.0),
        b'q' => (ScalarType::Signed(8), 1.0),
        b'Q' => (ScalarType::Unsigned(8), 1.0),
        b'd' => (ScalarType::Float(8), 1.0),
        _ => return None,
    })
}

/// Bytes of a column by its format letter.
const fn format_byte_len(format_letter: u8) -> Option<usize> {
    match (number_format(format_letter), format_letter) {
        (Some((scalar_type, _)), _) => Some(scalar_type.byte_len()),
        (None, b'g') => Some(2),
        (None, b'n') => Some(4),
        (None, b'N') => Some(16),
        (None, b'a' | b'Z') => Some(64),
        _ => None,
    }
}

pub(super) const fn is_plain_integer(format_letter: u8) -> bool {
    matches!(format_letter, b'b' | b'B' | b'h' | b'H' | b'i' | b'I' | b'q' | b'Q')
}

struct BinaryMessage<'a> {
    layout: &'a MessageLayout,
    body: &'a [u8],
}

impl BinaryMessage<'_> {
    fn column_bytes(&self, name: &str) -> Option<(u8, &[u8])> {
        let column = self.layout.columns.iter().find(|column| column.name == name)?;
        Some((
            column.format_letter,
            self.body.get(column.offset..column.offset + format_byte_len(column.format_letter)?)?,
        ))
    }
}

impl LogMessage for BinaryMessage<'_> {
    fn numeric_field(&self, name: &str) -> Option<f64> {
        let (format_letter, bytes) = self.column_bytes(name)?;
        let (scalar_type, units) = number_format(format_letter)?;
        Some(scalar_type.decode_number(bytes)? / units)
    }

    fn has_column(&self, name: &str) -> bool {
        self.layout.columns.iter().any(|column| column.name == name)
    }

    fn is_plain_integer(&self, name: &str) -> bool {
        self.column_bytes(name).is_some_and(|(format_letter, _)| is_plain_integer(format_letter))
    }

    fn text_field(&self, name: &str) -> Option<String> {
        let (format_letter, bytes) = self.column_bytes(name)?;
        matches!(format_letter, b'n' | b'N' | b'Z').then(|| decode_text(bytes))
    }
}

/// Text up to the first zero byte.
fn decode_text(bytes: &[u8]) -> String {
    let text_length = bytes.iter().position(|&byte| byte == 0).unwrap_or(bytes.len());
    String::from_utf8_lossy(&bytes[..text_length]).trim().to_owned()
}

const MAX_MESSAGE_KINDS: usize = 512;

/// Reads a flight.
pub fn read_text(source: &mut dyn Read) -> io::Result<LoggedFlight> {
    let mut window = ReadWindow::new(source);
    let mut columns: HashMap<String, LineLayout> = HashMap::new();
    let mut builder = ardupilot_builder(LogFormat::DataFlashText);
    while let Some(line) = window.next_line()? {
        let mut values = line.split(',').map(str::trim);
        let name = values.next().unwrap_or_default();
        if name == "FMT" {
            // Values of a FMT line: type, length, name, format, columns.
            if let Some(name) = values.nth(2).filter(|_| columns.len() < MAX_MESSAGE_KINDS) {
                let format_letters = values.next().unwrap_or_default().bytes().take(32).collect();
                columns.insert(
                    name.to_owned(),
                    LineLayout { format_letters, names: values.take(32).map(str::to_owned).collect() },
                );
            }
        } else if let Some(layout) = columns.get(name) {
            if MESSAGES_TO_READ.contains(&name) {
                record_message(&mut builder, name, &TextMessage { layout, values: values.collect() });
            }
        } else {
            builder.flight.skipped_counts.garbage += u64::from(!name.is_empty());
        }
    }
    Ok(builder.finish_flight())
}

struct LineLayout {
    format_letters: Vec<u8>,
    names: Vec<String>,
}

struct TextMessage<'a> {
    layout: &'a LineLayout,
    values: Vec<&'a str>,
}

impl TextMessage<'_> {
    fn column_index(&self, name: &str) -> Option<usize> {
        self.layout.names.iter().position(|column| column == name)
    }
}

impl LogMessage for TextMessage<'_> {
    fn numeric_field(&self, name: &str) -> Option<f64> {
        let number = self.values.get(self.column_index(name)?)?.parse::<f64>().ok()?;
        // Some ground stations write the raw integer of 1e-7 deg.
        let is_raw_place = matches!(name, "Lat" | "Lng") && number.abs() > 180.0;
        Some(if is_raw_place { number * 1e-7 } else { number })
    }

    fn has_column(&self, name: &str) -> bool {
        self.column_index(name).is_some()
    }

    fn is_plain_integer(&self, name: &str) -> bool {
        self.column_index(name)
            .and_then(|index| self.layout.format_letters.get(index))
            .is_some_and(|&format_letter| is_plain_integer(format_letter))
    }

    /// Only the last column may contain commas.
    fn text_field(&self, name: &str) -> Option<String> {
        let index = self.column_index(name)?;
        let column_values = self.values.get(index..)?;
        if index + 1 == self.layout.names.len() {
            Some(column_values.join(", "))
        } else {
            column_values.first().map(|&word| word.to_owned())
        }
    }
}
