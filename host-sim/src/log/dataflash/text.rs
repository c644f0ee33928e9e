//! DataFlash as text, as ground stations write it: a message a line, `FMT` lines telling the columns of the others.

use std::collections::HashMap;
use std::io::{self, Read};

use super::super::flight::{Flight, Format};
use super::super::window::Window;
use super::binary::is_whole;
use super::{Message, is_wanted, recorder, take};

/// No log has more kinds of messages.
const MAX_KINDS: usize = 512;

/// Reads a flight.
///
/// # Errors
///
/// What the source says.
pub fn read_text(source: &mut dyn Read) -> io::Result<Flight> {
    let mut window = Window::new(source);
    let mut columns: HashMap<String, Layout> = HashMap::new();
    let mut recorder = recorder(Format::DataFlashText);
    while let Some(line) = window.line()? {
        let mut values = line.split(',').map(str::trim);
        let name = values.next().unwrap_or_default();
        if name == "FMT" {
            // Type, length, name, format, columns.
            if let Some(name) = values.nth(2).filter(|_| columns.len() < MAX_KINDS) {
                let kinds = values.next().unwrap_or_default().bytes().take(32).collect();
                columns.insert(name.to_owned(), Layout { kinds, names: values.take(32).map(str::to_owned).collect() });
            }
        } else if let Some(layout) = columns.get(name) {
            if is_wanted(name) {
                take(&mut recorder, name, &Line { layout, values: values.collect() });
            }
        } else {
            recorder.flight.counts.garbage += u64::from(!name.is_empty());
        }
    }
    Ok(recorder.finish())
}

/// The letters and the names of a message's columns.
struct Layout {
    kinds: Vec<u8>,
    names: Vec<String>,
}

struct Line<'a> {
    layout: &'a Layout,
    values: Vec<&'a str>,
}

impl Line<'_> {
    fn index(&self, name: &str) -> Option<usize> {
        self.layout.names.iter().position(|column| column == name)
    }
}

impl Message for Line<'_> {
    fn number(&self, name: &str) -> Option<f64> {
        let number = self.values.get(self.index(name)?)?.parse::<f64>().ok()?;
        // Some ground stations leave places as they are in the binary log.
        let is_raw_place = matches!(name, "Lat" | "Lng") && number.abs() > 180.0;
        Some(if is_raw_place { number * 1e-7 } else { number })
    }

    fn has(&self, name: &str) -> bool {
        self.index(name).is_some()
    }

    fn is_whole(&self, name: &str) -> bool {
        self.index(name).and_then(|index| self.layout.kinds.get(index)).is_some_and(|&kind| is_whole(kind))
    }

    /// What stands last may have commas in it.
    fn words(&self, name: &str) -> Option<String> {
        let index = self.index(name)?;
        let rest = self.values.get(index..)?;
        if index + 1 == self.layout.names.len() {
            Some(rest.join(", "))
        } else {
            rest.first().map(|&word| word.to_owned())
        }
    }
}
