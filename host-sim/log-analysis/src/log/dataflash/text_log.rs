//! DataFlash as text: one message a line, columns declared by `FMT` lines.

use std::collections::HashMap;
use std::io::{self, Read};

use super::super::flight::{LogFormat, LoggedFlight};
use super::super::read_window::ReadWindow;
use super::binary::is_plain_integer;
use super::messages::{LogMessage, MESSAGES_TO_READ, ardupilot_builder, record_message};

const MAX_MESSAGE_KINDS: usize = 512;

/// Reads a flight.
///
/// # Errors
///
/// The source cannot be read.
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
