//! Readers for autopilot logs; every format becomes one [`LoggedFlight`].
//!
//! | format | file | recognised by |
//! |---|---|---|
//! | ArduPilot DataFlash | `.bin` | a FMT message: `A3 95 80` |
//! | the same as text | `.log` | a line that begins with `FMT,` |
//! | PX4 ULog | `.ulg` | its seven magic bytes |
//! | MAVLink, with or without clock | `.tlog` | frames with valid checksums, each after eight clock bytes or none |
//! | both, decoded by `mavlogdump` | `.json`, `.txt`, `.csv` | a line that is a message (`decoded.rs`) |
//! | values separated by comma, semicolon or tab | `.csv` | a first line that names `t_s` |
//! | INAV's and Betaflight's blackbox | `.TXT`, `.bbl`, `.BFL` | its first line (`blackbox/`) |
//! | the same, decoded by `blackbox_decode` | `.csv` | `loopIteration,` |
//! | tables of one topic or sensor each | `.csv` in a folder or archive | name and header (`table_set.rs`) |
//! | an archive with these | `.zip`, `.gz` | `PK`, `1F 8B` |
//!
//! The format is detected from the content, not the file name. Logs are read as streams: a [`LoggedFlight`] holds at most
//! a hundred thousand rows of each series, whatever the length of the file. Any input gives a flight or an error.
//!
//! Published readers were rejected: `ardupilot-binlog` 0.2 can underflow a length and gives up after 256 damaged bytes;
//! `px4-ulog` 0.6 panics on a key longer than its message (file_reader.rs, line 419, found by fuzzing); `yule_log` 0.4
//! prints to standard output, recurses into a format that contains itself, and depends on regular expressions and a
//! logger. They are not faster: of a DataFlash log 49 MB/s beside 43 here with all checks of the flight, of PX4's sample log
//! 156 (`px4-ulog`) and 56 (`yule_log`) beside 155, on one core. MAVLink messages and checksums come from the `mavlink` crate.

mod blackbox;
mod compass_slot;
mod correction;
mod correction_residual;
pub mod csv;
mod dataflash;
mod decoded;
mod flight;
mod flight_builder;
mod heading_integral;
mod load;
mod log_error;
pub mod log_writers;
mod mounting;
mod parameters;
mod rates;
mod read_window;
mod scalar;
mod table_set;
pub mod time_series;
mod timeline;
mod tlog;
mod ulog;
mod vtol_view;
mod zip;

use std::io::{self, Read};

use flate2::read::MultiGzDecoder;

use csv::FieldUnit;
use table_set::{TableFile, TableSet};
use zip::BoundedContent;

#[cfg(test)]
pub(crate) use compass_slot::UnknownSlot;
pub(crate) use compass_slot::{ARDUPILOT_SLOTS, DeviceId, ardupilot_index, ardupilot_vector, external_parameter};
pub use correction::FieldCorrection;
pub(crate) use correction::symmetric_matrix;
pub(crate) use correction_residual::CorrectionResidual;
pub(crate) use flight::{AttitudeView, LoggedCompass, missing_ardupilot_parameters, mounting_parameter_changes};
pub use flight::{AutopilotKind, Gps, LogFormat, LoggedFlight, RatesProblem};
pub(crate) use heading_integral::{HeadingIntegral, MAX_PITCH_RAD};
pub(crate) use load::LoadSource;
pub use log_error::LogError;
pub(crate) use mounting::{
    CustomRotation, NumberedRotation, SensorOrientation, logged_mounting, orientation_parameter, px4_external_trim,
    px4_mounting,
};
pub(crate) use parameters::ParameterHistory;
pub use zip::EntryVisitor;

/// Bytes searched to detect the format.
const FORMAT_DETECTION_BYTES: usize = 1 << 16;

/// First bytes of a gzip file.
const GZIP_MAGIC: [u8; 2] = [0x1F, 0x8B];

/// Largest number of archives in one another.
const MAX_ARCHIVE_DEPTH: u8 = 3;

/// Unit of a table's field, and MAVLink system to read.
type ReadingOptions = (FieldUnit, Option<u8>);

/// Receives a log of a source: its name within the source, empty if it is the whole source; and its flight.
pub type LogVisitor<'a> = dyn FnMut(&str, Result<LoggedFlight, LogError>) + 'a;

/// Reads the only flight of a source, of the first autopilot.
///
/// # Errors
///
/// As [`only_flight`] of [`visit_flights`].
pub fn read_flight(source: &mut dyn Read, unit: FieldUnit) -> Result<LoggedFlight, LogError> {
    only_flight(&mut |visit| visit_flights(source, unit, None, visit))
}

/// The only flight that is visited.
///
/// # Errors
///
/// The visit fails, or holds no usable flight, or several.
pub fn only_flight(
    visit_flights: &mut dyn FnMut(&mut LogVisitor<'_>) -> Result<(), LogError>,
) -> Result<LoggedFlight, LogError> {
    let (mut names, mut first_flight, mut first_error) = (Vec::new(), None, LogError::Empty);
    visit_flights(&mut |name, flight| match flight {
        Ok(flight) => {
            names.push(name.to_owned());
            first_flight.get_or_insert(flight);
        }
        Err(error) if matches!(first_error, LogError::Empty) => first_error = error,
        Err(_) => {}
    })?;
    if names.len() > 1 { Err(LogError::SeveralLogs(names)) } else { first_flight.ok_or(first_error) }
}

/// Reads each log of a source: a file, the files of an archive, the flights of a blackbox. `unit` is the unit of a table's
/// field, `system` the MAVLink system to read (default: the first autopilot).
///
/// # Errors
///
/// The source cannot be read, or is an archive without logs.
pub fn visit_flights(
    source: &mut dyn Read,
    unit: FieldUnit,
    system: Option<u8>,
    visit: &mut LogVisitor<'_>,
) -> Result<(), LogError> {
    visit_unchecked(source, (unit, system), &mut checked(visit))
}

/// Reads the logs of which each topic or sensor is a table among the files of a folder; others are ignored.
///
/// # Errors
///
/// A file cannot be read, or none of the files is a table of a log.
pub fn visit_folder(
    visit_files: &mut dyn FnMut(&mut EntryVisitor<'_>) -> io::Result<()>,
    unit: FieldUnit,
    visit: &mut LogVisitor<'_>,
) -> Result<(), LogError> {
    // At this depth a file that is not a table is no archive.
    LogReader { options: (unit, None), visit: &mut checked(visit) }.visit_files("", visit_files, MAX_ARCHIVE_DEPTH)
}

/// Whether a file is a table of a log that has further tables.
///
/// # Errors
///
/// The source cannot be read.
pub fn is_table_of_log(name: &str, source: &mut dyn Read) -> io::Result<bool> {
    Ok(TableFile::new(name, &read_first_bytes(source)?).is_some())
}

/// A visitor that gets each flight with its body rates and headings checked.
fn checked(visit: &mut LogVisitor<'_>) -> impl FnMut(&str, Result<LoggedFlight, LogError>) {
    |name, flight| {
        let checked = flight.map(|mut flight| {
            rates::check_and_repair_rates(&mut flight);
            heading_integral::remove_heading_latencies(&mut flight);
            flight
        });
        visit(name, checked);
    }
}

/// Reads each log, without checks of its body rates.
fn visit_unchecked(source: &mut dyn Read, options: ReadingOptions, visit: &mut LogVisitor<'_>) -> Result<(), LogError> {
    LogReader { options, visit }.visit_source("", source, 0)
}

struct LogReader<'a, 'b> {
    options: ReadingOptions,
    visit: &'a mut LogVisitor<'b>,
}

impl LogReader<'_, '_> {
    /// Visits the logs of a source; none if it is unknown, or the number of archives around it is too large.
    fn visit_source(&mut self, name: &str, source: &mut dyn Read, depth: u8) -> Result<(), LogError> {
        let first_bytes = read_first_bytes(source)?;
        let mut source = first_bytes.as_slice().chain(source);
        if depth > MAX_ARCHIVE_DEPTH {
            Err(LogError::UnknownFormat)
        } else if first_bytes.starts_with(&GZIP_MAGIC) {
            let mut content = BoundedContent::new(MultiGzDecoder::new(source));
            self.visit_source(name, &mut content, depth + 1)
        } else if zip::matches_header(&first_bytes) {
            self.visit_files(name, &mut |visit| zip::visit_entries(&mut source, visit), depth)
        } else if blackbox::matches_header(&first_bytes) {
            self.visit_blackbox(name, &mut source)
        } else {
            let flight = read_content(&first_bytes, &mut source, self.options)?;
            (self.visit)(name, Ok(flight));
            Ok(())
        }
    }

    /// Visits the logs of an archive or folder.
    fn visit_files(
        &mut self,
        name: &str,
        visit_files: &mut dyn FnMut(&mut EntryVisitor<'_>) -> io::Result<()>,
        depth: u8,
    ) -> Result<(), LogError> {
        let (mut log_count, mut others, mut tables) = (0, Vec::new(), TableSet::default());
        visit_files(&mut |entry, content| {
            let first_bytes = read_first_bytes(content)?;
            let mut content = first_bytes.as_slice().chain(content);
            if let Some(file) = TableFile::new(&entry, &first_bytes) {
                if tables.log_name != file.log_name {
                    log_count += self.visit_tables(name, std::mem::replace(&mut tables, TableSet::new(file.log_name)));
                }
                return tables.read_table(&file, &mut content, self.options.0);
            }
            let entry_name = joined_name(name, &entry);
            match self.visit_source(&entry_name, &mut content, depth + 1) {
                Err(LogError::UnknownFormat | LogError::Empty) => others.push(entry),
                Err(LogError::Io(error)) => return Err(error),
                Err(error) => {
                    log_count += 1;
                    (self.visit)(&entry_name, Err(error));
                }
                Ok(()) => log_count += 1,
            }
            Ok(())
        })?;
        log_count += self.visit_tables(name, tables);
        if log_count == 0 { Err(LogError::ArchiveWithoutLog(others)) } else { Ok(()) }
    }

    /// Visits the log of the tables, if there are any; returns the number of logs.
    fn visit_tables(&mut self, name: &str, tables: TableSet) -> usize {
        let log_name = joined_name(name, &tables.log_name);
        let Some(flight) = tables.finish_flight() else { return 0 };
        (self.visit)(&log_name, flight.and_then(|flight| check_flight(flight, None)));
        1
    }

    /// Flights of a blackbox have numbers, unless there is one alone.
    fn visit_blackbox(&mut self, name: &str, source: &mut dyn Read) -> Result<(), LogError> {
        let (mut count, mut previous) = (0, None);
        let mut visit = |flight_name: &str, flight| (self.visit)(flight_name, check_flight(flight, None));
        let number = |count: usize| joined_name(name, &format!("flight {count}"));
        blackbox::visit_flights(source, &mut |flight| {
            if let Some(previous) = previous.replace(flight) {
                visit(&number(count), previous);
            }
            count += 1;
        })?;
        if let Some(last) = previous {
            visit(&if count == 1 { name.to_owned() } else { number(count) }, last);
        }
        Ok(())
    }
}

fn joined_name(outer: &str, inner: &str) -> String {
    if outer.is_empty() || inner.is_empty() { format!("{outer}{inner}") } else { format!("{outer}/{inner}") }
}

fn read_content(
    first_bytes: &[u8],
    mut source: &mut dyn Read,
    options: ReadingOptions,
) -> Result<LoggedFlight, LogError> {
    let (_, system) = options;
    let format = detect_format(first_bytes);
    if matches!(format, Err(LogError::UnknownFormat))
        && let Some(format) = decoded::decoded_format(first_bytes)
    {
        return check_flight(decoded::read_decoded(&mut source, format, system)?, system);
    }
    if matches!(format, Err(LogError::UnknownFormat))
        && let Some(text) = utf16_text(first_bytes, source)?
    {
        return read_format(detect_format(text.as_bytes())?, &mut text.as_bytes(), options);
    }
    read_format(format?, source, options)
}

fn read_first_bytes(source: &mut dyn Read) -> io::Result<Vec<u8>> {
    let mut first_bytes = Vec::new();
    source.take(FORMAT_DETECTION_BYTES as u64).read_to_end(&mut first_bytes)?;
    Ok(first_bytes)
}

fn read_format(
    format: LogFormat,
    mut source: &mut dyn Read,
    (unit, system): ReadingOptions,
) -> Result<LoggedFlight, LogError> {
    let flight = match format {
        LogFormat::DataFlash => dataflash::read_binary(&mut source)?,
        LogFormat::DataFlashText => dataflash::read_text(&mut source)?,
        LogFormat::ULog => ulog::read_ulog(&mut source)?,
        LogFormat::TLog => tlog::read_tlog(&mut source, system)?,
        LogFormat::Csv => csv::read_csv(source, unit).map_err(LogError::Csv)?,
        // Its flights are visited one by one.
        LogFormat::Blackbox => return Err(LogError::UnknownFormat),
    };
    check_flight(flight, system)
}

/// Whether the flight has what any judgement needs.
fn check_flight(flight: LoggedFlight, system: Option<u8>) -> Result<LoggedFlight, LogError> {
    let format = flight.log_format;
    if let Some(system) = system.filter(|system| flight.autopilot_system_ids.first() != Some(system)) {
        return Err(LogError::SystemNotFound(system, flight.autopilot_system_ids));
    }
    if flight.compasses.is_empty() && flight.rows_without_time > 0 {
        return Err(LogError::NoTimeStamps(format));
    }
    if flight.compasses.is_empty() && flight.skipped_counts.unassigned_fields > 0 {
        return Err(LogError::UnassignedFields(format));
    }
    if flight.compasses.is_empty() {
        return Err(LogError::NoMagnetometer(format, flight.skipped_counts.rejected_readings));
    }
    if flight.attitude.is_empty() {
        return Err(LogError::NoAttitude(format));
    }
    Ok(flight)
}

/// Formats that are known and not read: position and bytes that they begin with, and what to do instead.
const UNREAD_FORMATS: [(usize, &[u8], &str); 7] = [
    (0, b"#ROSBAG", ROS_ADVICE),
    (0, b"\x89MCAP0\r\n", ROS_2_ADVICE),
    (0, b"SQLite format 3", ROS_2_ADVICE),
    (0, b"MATLAB 5.0 MAT-file", MATLAB_ADVICE),
    (0, b"MATLAB 7.3 MAT-file", MATLAB_ADVICE),
    (16, b"BUILD", DJI_ADVICE),
    (0, b"Clock:Tick#", DJI_ADVICE),
];

const ROS_ADVICE: &str = "a ROS bag is not read: write a table with the columns t_s, mx, my, mz, roll_deg, pitch_deg";
const ROS_2_ADVICE: &str =
    "a ROS 2 bag is not read: write a table with the columns t_s, mx, my, mz, roll_deg, pitch_deg";
const MATLAB_ADVICE: &str = "a MATLAB file is not read: give the log that it was made of";
const DJI_ADVICE: &str = "DJI's flight recorder is not read: its aircraft take no compass parameters";

fn detect_format(first_bytes: &[u8]) -> Result<LogFormat, LogError> {
    let text = || first_bytes.split(|&byte| byte == b'\n').take(100);
    let unread = UNREAD_FORMATS
        .iter()
        .find(|(offset, magic, _)| first_bytes.get(*offset..).is_some_and(|bytes| bytes.starts_with(magic)));
    if first_bytes.is_empty() {
        Err(LogError::Empty)
    } else if let Some((_, _, advice)) = unread {
        Err(LogError::UnreadFormat(advice))
    } else if first_bytes.starts_with(&ulog::ULOG_MAGIC) || ulog::has_definitions(first_bytes) {
        Ok(LogFormat::ULog)
    } else if dataflash::is_sdlog2(first_bytes) {
        Err(LogError::UnreadFormat(
            "PX4's log before ULog (sdlog2, until 2017) is not read: fly with a firmware that writes .ulg",
        ))
    } else if dataflash::matches_header(first_bytes) {
        Ok(LogFormat::DataFlash)
    } else if tlog::matches_header(first_bytes) {
        Ok(LogFormat::TLog)
    } else if text().any(|line| line.starts_with(b"FMT,")) {
        Ok(LogFormat::DataFlashText)
    } else if csv::is_table(first_bytes) {
        Ok(LogFormat::Csv)
    } else if dataflash::is_without_start(first_bytes) || ulog::is_without_start(first_bytes) {
        Err(LogError::UnreadFormat(
            "the start of the file is missing, which defines its messages: copy the whole log from the card",
        ))
    } else {
        Err(LogError::UnknownFormat)
    }
}

/// The text of a source whose `first_bytes` are a byte-order mark; invalid units become U+FFFD. Only tables are in UTF-16,
/// and no spreadsheet saves one this long.
fn utf16_text(first_bytes: &[u8], source: &mut dyn Read) -> io::Result<Option<String>> {
    const MAX_BYTES: u64 = 1 << 28;
    let decode_unit = match first_bytes {
        [0xFF, 0xFE, ..] => u16::from_le_bytes,
        [0xFE, 0xFF, ..] => u16::from_be_bytes,
        _ => return Ok(None),
    };
    let mut bytes = Vec::new();
    source.take(MAX_BYTES).read_to_end(&mut bytes)?;
    let units: Vec<u16> = bytes.as_chunks().0.iter().skip(1).map(|pair| decode_unit(*pair)).collect();
    Ok(Some(String::from_utf16_lossy(&units)))
}

#[cfg(test)]
mod tests;
