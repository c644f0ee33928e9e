//! A flight as a table: values separated by comma, semicolon or tab, with names in the first line.
//!
//! | column | unit, axes and sign |
//! |---|---|
//! | `t_s` | seconds |
//! | `mx`, `my`, `mz` | field in body axes forward, right, down, not corrected; milligauss, or microtesla on request |
//! | `mx2`, `my2`, `mz2`, ... | the same of a second compass, up to the eighth |
//! | `roll_deg`, `pitch_deg` | attitude; right wing down and nose up positive |
//! | `use` | optional: 0 keeps a row out of fit and score |
//! | `p_dps`, `q_dps`, `r_dps` | optional: body rates, deg/s, each the mean since the row before |
//! | `yaw_ref_deg` | optional: a heading to compare with, from any north |
//! | `yaw_deg` | optional: the autopilot's own yaw, from true north |
//! | `current_a` | optional: current, amperes |
//! | `lat_deg`, `lon_deg`, `height_m` | optional: where |
//! | `speed_m_s`, `course_deg` | optional, with those: speed and course over ground, from true north |
//! | `armed` | optional: 0 or 1 |
//!
//! Read by hand, a line at a time in bounded memory: quotes that never close, decimal commas and lines that are cut off are what
//! such tables have, and the crate `csv` holds a record however long it is.
//!
//! Others are passed over, and so are lines that begin with `#` and the `sep=` of a spreadsheet. Names may be in capitals. With
//! semicolon or tab a comma is a decimal point. What is empty or `nan` is not known there. A line that does not hold what it
//! must costs that line.

mod rates;
mod table;
#[cfg(test)]
mod tests;

use std::fmt;
use std::io::Read;

use super::flight::{Flight, Format};
use super::recorder::Recorder;
use super::series::Series;
use super::window::Window;
use rates::at_the_rows;
use table::Table;

/// The unit of the field's columns.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Unit {
    /// Milligauss, as ArduPilot logs.
    Milligauss,
    /// Microtesla.
    Microtesla,
}

impl Unit {
    const fn microtesla(self) -> f64 {
        match self {
            Self::Milligauss => 0.1,
            Self::Microtesla => 1.0,
        }
    }
}

/// Why a table cannot be read.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum CsvError {
    /// The source cannot be read; why.
    Source(String),
    /// A column is missing; its name.
    NoColumn(String),
    /// A column of the rates is missing, though another is there; its name.
    NoRate(&'static str),
    /// There are no rows; the first line that could have been one, its column and what stands there.
    Empty(Option<(u64, String, String)>),
}

impl fmt::Display for CsvError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Source(why) => f.write_str(why),
            Self::NoColumn(name) => {
                write!(f, "no column {name}; needed are t_s, mx, my, mz, roll_deg, pitch_deg, named in the first line")
            }
            Self::NoRate(name) => write!(f, "no column {name}; p_dps, q_dps and r_dps belong together"),
            Self::Empty(None) => f.write_str("there are no rows"),
            Self::Empty(Some((line, column, found))) => {
                write!(f, "there are no rows; line {line}, {column}: {found:?} is not a number")
            }
        }
    }
}

impl std::error::Error for CsvError {}

/// Whether a table begins so: a line with the name of its time.
#[must_use]
pub fn begins_in(head: &[u8]) -> bool {
    let names = |line: &[u8]| {
        let line = String::from_utf8_lossy(line).into_owned();
        let separator = separator(&line);
        line.split(separator).any(|name| trimmed(name).eq_ignore_ascii_case("t_s"))
    };
    head.split(|&byte| byte == b'\n').find(|line| !is_comment(line)).is_some_and(names)
}

fn is_comment(line: &[u8]) -> bool {
    let text = line.trim_ascii();
    text.is_empty() || text.starts_with(b"#") || text.starts_with(b"sep=")
}

/// What separates, by what there is most of in the first line.
fn separator(header: &str) -> char {
    [',', ';', '\t'].into_iter().max_by_key(|&separator| header.matches(separator).count()).unwrap_or(',')
}

fn trimmed(value: &str) -> &str {
    value.trim_start_matches('\u{feff}').trim().trim_matches('"').trim()
}

/// Reads a flight.
///
/// # Errors
///
/// What is wrong with it.
pub fn read(mut source: impl Read, unit: Unit) -> Result<Flight, CsvError> {
    let unreadable = |e: std::io::Error| CsvError::Source(e.to_string());
    let mut window = Window::new(&mut source);
    let mut number = 0_u64;
    let mut table: Option<Table> = None;
    // The first lines, until it is known whether they are in the order of time.
    let mut held = Vec::new();
    let mut reading: Option<Reading> = None;
    while let Some(line) = window.line().map_err(unreadable)? {
        number += 1;
        if is_comment(line.as_bytes()) {
            continue;
        }
        let Some(table) = &table else {
            table = Some(Table::of(&line)?);
            continue;
        };
        if let Some(reading) = &mut reading {
            reading.take(table, unit, number, &line);
            continue;
        }
        held.push((number, line));
        if held.len() == LOOKED_AT {
            let began = reading.insert(Reading::of(table, &held));
            held.drain(..).for_each(|(number, line)| began.take(table, unit, number, &line));
        }
    }
    let Some(table) = table else { return Err(CsvError::NoColumn("t_s".to_owned())) };
    let mut reading = reading.unwrap_or_else(|| Reading::of(&table, &held));
    held.drain(..).for_each(|(number, line)| reading.take(&table, unit, number, &line));
    reading.finish()
}

/// So many lines show whether a table is in the order of time.
const LOOKED_AT: usize = 1000;

/// What is being read.
struct Reading {
    recorder: Recorder,
    rates: Series<3>,
    armed: Series<1>,
    /// About the middle of the first lines' times, seconds; those of a table may count from 1970.
    about_s: f64,
    /// Whether the lines are sorted by something else: then times are believed as they stand, and no clock began anew.
    is_shuffled: bool,
    first_bad: Option<(u64, String, String)>,
}

impl Reading {
    /// By what the first lines say of their times. Where one in ten steps goes back by more than what a clock's disorder
    /// makes, or most go back at all, lines are not in the order of time.
    fn of(table: &Table, held: &[(u64, String)]) -> Self {
        const BACK_S: f64 = 3.0;
        let mut times_s: Vec<f64> =
            held.iter().filter_map(|(_, line)| table.values(line).need(table.t_s, "t_s").ok()).collect();
        let steps = |is: &dyn Fn(f64) -> bool| times_s.windows(2).filter(|pair| is(pair[1] - pair[0])).count();
        let [back, far_back] = [steps(&|step_s| step_s < 0.0), steps(&|step_s| step_s < -BACK_S)];
        let is_shuffled = far_back * 10 > times_s.len() || back * 3 > times_s.len() * 2;
        times_s.sort_by(f64::total_cmp);
        let about_s = times_s.get(times_s.len() / 2).copied().unwrap_or(0.0);
        let recorder = Recorder::new(Format::Csv);
        Self { recorder, rates: Series::new(), armed: Series::new(), about_s, is_shuffled, first_bad: None }
    }

    fn take(&mut self, table: &Table, unit: Unit, number: u64, line: &str) {
        if let Err((column, found)) = table.take(line, unit, self) {
            self.recorder.flight.counts.garbage += 1;
            self.first_bad.get_or_insert((number, column, found));
        }
    }

    /// Where a time lies on the flight's time line, seconds.
    fn at(&mut self, t_s: f64) -> Option<f64> {
        let since_s = t_s - self.about_s;
        if since_s.abs() >= MAX_S {
            self.recorder.flight.counts.bad_times += 1;
            None
        } else if self.is_shuffled {
            Some(since_s)
        } else {
            self.recorder.timeline.at((since_s * 1e6 + ZERO_US).round() as u64)
        }
    }

    fn finish(mut self) -> Result<Flight, CsvError> {
        self.rates.settle();
        for (t_s, at) in at_the_rows(&self.rates) {
            self.recorder.rates(t_s, at);
        }
        self.armed.settle();
        for row in self.armed.rows() {
            self.recorder.armed(row.t_s, row.of[0] != 0.0);
        }
        let flight = self.recorder.finish();
        // Of readings that are no field the rows are there.
        let is_empty = flight.compasses.is_empty() && flight.counts.unhealthy == 0;
        if is_empty { Err(CsvError::Empty(self.first_bad)) } else { Ok(flight) }
    }
}

/// Where the first lines' times stand on the clock of a log, microseconds: times before nothing are as good as others.
const ZERO_US: f64 = 1e13;

/// No flight is so far from its first lines, seconds.
const MAX_S: f64 = 1e6;
