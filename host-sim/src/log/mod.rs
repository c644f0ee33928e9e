//! Flights from logs as autopilots write them: one common form of them all.
//!
//! | format | file | known by |
//! |---|---|---|
//! | ArduPilot DataFlash | `.bin` | a FMT message: `A3 95 80` |
//! | the same as text | `.log` | a line that begins with `FMT,` |
//! | PX4 ULog | `.ulg` | its seven magic bytes |
//! | MAVLink with the receiver's clock, or without | `.tlog` | frames with right checksums, after eight bytes each or none |
//! | values separated by comma, semicolon or tab | `.csv` | a first line that names `t_s` |
//!
//! A format is recognised by content, and read as a stream: a [`Flight`] holds what is needed of a flight, at most half a
//! million rows of each kind, whatever the length of the file. Any bytes give a flight or an error.
//!
//! The readers of DataFlash and ULog are own ones. `ardupilot-binlog` 0.2 computes a length that may fall below nothing, and
//! gives up after 256 damaged bytes; `px4-ulog` 0.6 panics on a key that is longer than its message (file_reader.rs, line
//! 419, found by changing single bytes of a log); `yule_log` 0.4 prints to standard output, follows a format that contains
//! itself, and brings regular expressions and a logger along. MAVLink's messages and checksums are those of the `mavlink`
//! crate.

mod correction;
pub mod csv;
mod dataflash;
mod flight;
mod parameters;
mod recorder;
mod rotation;
pub mod series;
#[cfg(test)]
mod tests;
mod timeline;
mod tlog;
mod ulog;
mod window;
pub mod write;

pub(crate) use correction::px4_mounting;
pub use correction::{Iron, missing_of_ardupilot, turned_in_flight};
pub use flight::{Autopilot, Compass, Counts, Flight, Format, Gps};
pub use parameters::Parameters;
pub use rotation::Rotation;

use std::fmt;
use std::io::{self, Read};
use std::path::Path;

use csv::{CsvError, Unit};

/// So many bytes at the beginning say which format it is.
const HEAD: usize = 1 << 16;

/// Why a log cannot be read.
#[derive(Debug)]
pub enum LogError {
    /// The file cannot be opened or read.
    Io(io::Error),
    /// There is nothing in it.
    Empty,
    /// It is none of the formats.
    Unknown,
    /// What is wrong with the values of a table.
    Csv(CsvError),
    /// It is such a log, but holds no field; readings of one that are none.
    NoField(Format, u64),
    /// It is such a log, but holds no attitude.
    NoAttitude(Format),
    /// It has no such system; those that it has.
    NoSystem(u8, Vec<u8>),
    /// It is such a log, but nothing in it tells when its rows were written.
    NoTime(Format),
}

impl fmt::Display for LogError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Io(why) => why.fmt(f),
            Self::Empty => f.write_str("the file is empty"),
            Self::Unknown => f.write_str(
                "not a log that is known: ArduPilot DataFlash (.bin, .log), PX4 ULog (.ulg), MAVLink (.tlog), or a table \
                 whose first line names t_s,mx,my,mz,roll_deg,pitch_deg",
            ),
            Self::Csv(why) => why.fmt(f),
            Self::NoField(format, 0) => write!(f, "{}: no magnetometer is logged", format.name()),
            Self::NoField(format, unhealthy) => write!(
                f,
                "{}: of {unhealthy} readings of a magnetometer each is nothing, or called unhealthy by the autopilot",
                format.name()
            ),
            Self::NoAttitude(format) => write!(f, "{}: no attitude is logged", format.name()),
            Self::NoSystem(system, heard) if heard.is_empty() => {
                write!(f, "there is no system {system}: no vehicle says its number")
            }
            Self::NoSystem(system, heard) => {
                let heard: Vec<String> = heard.iter().map(u8::to_string).collect();
                write!(f, "there is no vehicle of system {system}; there is {}", heard.join(", "))
            }
            Self::NoTime(format) => write!(
                f,
                "{}: its messages carry no time, as it was until 2014: when a field was measured, and in which attitude, \
                 cannot be told",
                format.name()
            ),
        }
    }
}

impl std::error::Error for LogError {}

impl From<io::Error> for LogError {
    fn from(why: io::Error) -> Self {
        Self::Io(why)
    }
}

/// Reads a flight from a file, or from standard input if its name is `-`. `unit` is that of the field in a table, `system` the
/// vehicle on a MAVLink link, else the first that is heard.
///
/// # Errors
///
/// Why it cannot be read.
pub fn open(path: &Path, unit: Unit, system: Option<u8>) -> Result<Flight, LogError> {
    if path.as_os_str() == "-" {
        return read_of(&mut io::stdin().lock(), unit, system);
    }
    read_of(&mut std::fs::File::open(path)?, unit, system)
}

/// As [`open`], from any source, the first vehicle that is heard.
///
/// # Errors
///
/// As [`open`].
pub fn read(source: &mut dyn Read, unit: Unit) -> Result<Flight, LogError> {
    read_of(source, unit, None)
}

/// As [`open`], from any source.
///
/// # Errors
///
/// As [`open`].
pub fn read_of(source: &mut dyn Read, unit: Unit, system: Option<u8>) -> Result<Flight, LogError> {
    let mut head = Vec::new();
    (&mut *source).take(HEAD as u64).read_to_end(&mut head)?;
    let format = recognised(&head)?;
    let mut source = io::Cursor::new(head).chain(source);
    let flight = match format {
        Format::DataFlash => dataflash::read_binary(&mut source)?,
        Format::DataFlashText => dataflash::read_text(&mut source)?,
        Format::ULog => ulog::read(&mut source)?,
        Format::TLog => tlog::read(&mut source, system)?,
        Format::Csv => csv::read(source, unit).map_err(LogError::Csv)?,
    };
    if let Some(system) = system.filter(|system| flight.systems.first() != Some(system)) {
        return Err(LogError::NoSystem(system, flight.systems));
    }
    if flight.compasses.is_empty() && flight.unstamped > 0 {
        return Err(LogError::NoTime(format));
    }
    if flight.compasses.is_empty() {
        return Err(LogError::NoField(format, flight.counts.unhealthy));
    }
    if flight.attitude.is_empty() {
        return Err(LogError::NoAttitude(format));
    }
    Ok(flight)
}

/// Which format begins so.
fn recognised(head: &[u8]) -> Result<Format, LogError> {
    let text = || head.split(|&byte| byte == b'\n').take(100);
    if head.is_empty() {
        Err(LogError::Empty)
    } else if head.starts_with(&ulog::MAGIC) {
        Ok(Format::ULog)
    } else if dataflash::begins_in(head) {
        Ok(Format::DataFlash)
    } else if tlog::begins_in(head) {
        Ok(Format::TLog)
    } else if text().any(|line| line.starts_with(b"FMT,")) {
        Ok(Format::DataFlashText)
    } else if csv::begins_in(head) {
        Ok(Format::Csv)
    } else {
        Err(LogError::Unknown)
    }
}
