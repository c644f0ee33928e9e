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
//! | an archive with one of these | `.zip` | `PK` |
//!
//! The format is detected from the content, not the file name. Logs are read as streams: a [`LoggedFlight`] holds at most
//! a hundred thousand rows of each series, whatever the length of the file. Any input gives a flight or an error.
//!
//! Published readers were rejected: `ardupilot-binlog` 0.2 can underflow a length and gives up after 256 damaged bytes;
//! `px4-ulog` 0.6 panics on a key longer than its message (file_reader.rs, line 419, found by fuzzing); `yule_log` 0.4
//! prints to standard output, recurses into a format that contains itself, and depends on regular expressions and a
//! logger. MAVLink messages and checksums come from the `mavlink` crate.

mod battery_current;
mod compass_slot;
mod correction;
mod correction_residual;
pub mod csv;
mod dataflash;
mod decoded;
mod device_id;
mod flight;
mod flight_builder;
mod heading_integral;
mod heading_latency;
mod late_heading;
mod load;
mod log_error;
pub mod log_writers;
mod mounting;
mod parameters;
mod rates;
mod rates_problem;
mod read_window;
mod rotation;
pub mod time_series;
mod timeline;
mod tlog;
mod ulog;
mod utf16;
mod vtol_view;
mod zip;

pub(crate) use compass_slot::{ARDUPILOT_SLOTS, ardupilot_index, external_parameter};
pub use compass_slot::{CompassSlot, SlotEvidence, UnknownSlot};
pub use correction::FieldCorrection;
pub(crate) use correction::symmetric_matrix;
pub use correction_residual::CorrectionResidual;
pub use device_id::DeviceId;
pub use flight::{
    AttitudeView, AutopilotKind, Gps, LogFormat, LoggedCompass, LoggedFlight, SkippedCounts,
    missing_ardupilot_parameters, mounting_parameter_changes,
};
pub(crate) use heading_integral::{HeadingIntegral, MAX_PITCH_RAD};
pub use late_heading::HeadingLatency;
pub use load::{LoadSource, LoggedLoad};
pub use log_error::LogError;
pub use mounting::{CustomRotation, SensorOrientation};
pub(crate) use mounting::{logged_mounting, orientation_parameter, px4_external_trim, px4_mounting};
pub use parameters::ParameterHistory;
pub use rates_problem::RatesProblem;
pub use rotation::NumberedRotation;
pub use vtol_view::VtolView;

use std::io::{self, Read};

use csv::FieldUnit;
use utf16::Utf16Text;

/// Bytes searched to detect the format.
const FORMAT_DETECTION_BYTES: usize = 1 << 16;

/// Reads the first autopilot's flight from any source.
///
/// # Errors
///
/// As [`read_flight_of_system`].
pub fn read_flight(source: &mut dyn Read, unit: FieldUnit) -> Result<LoggedFlight, LogError> {
    read_flight_of_system(source, unit, None)
}

/// Reads a flight from any source. `unit` is the unit of a table's field, `system` the MAVLink system to read (default:
/// the first autopilot).
///
/// # Errors
///
/// The source cannot be read, or holds no usable flight.
pub fn read_flight_of_system(
    source: &mut dyn Read,
    unit: FieldUnit,
    system: Option<u8>,
) -> Result<LoggedFlight, LogError> {
    let mut flight = read_with_unchecked_rates(source, unit, system)?;
    rates::check_and_repair_rates(&mut flight);
    heading_latency::remove_heading_latencies(&mut flight);
    Ok(flight)
}

fn read_with_unchecked_rates(
    source: &mut dyn Read,
    unit: FieldUnit,
    system: Option<u8>,
) -> Result<LoggedFlight, LogError> {
    let first_bytes = read_first_bytes(source)?;
    if zip::matches_header(&first_bytes) {
        return read_archive(&mut io::Cursor::new(first_bytes).chain(source), unit, system);
    }
    read_content(&first_bytes, source, unit, system)
}

/// Reads the only log of an archive.
fn read_archive(source: &mut dyn Read, unit: FieldUnit, system: Option<u8>) -> Result<LoggedFlight, LogError> {
    let (mut logs, mut others, mut flight) = (Vec::new(), Vec::new(), None);
    zip::visit_entries(source, &mut |name, content| {
        let first_bytes = read_first_bytes(content)?;
        if detect_format(&first_bytes).is_err() {
            others.push(name);
        } else {
            logs.push(name);
            flight.get_or_insert_with(|| read_content(&first_bytes, content, unit, system));
        }
        Ok(())
    })?;
    flight.filter(|_| logs.len() == 1).unwrap_or(Err(match logs.len() {
        0 => LogError::ArchiveWithoutLog(others),
        _ => LogError::SeveralLogs(logs),
    }))
}

fn read_content(
    first_bytes: &[u8],
    source: &mut dyn Read,
    unit: FieldUnit,
    system: Option<u8>,
) -> Result<LoggedFlight, LogError> {
    let format = detect_format(first_bytes);
    let mut source = first_bytes.chain(source);
    if matches!(format, Err(LogError::UnknownFormat))
        && let Some(format) = decoded::decoded_format(first_bytes)
    {
        return check_flight(decoded::read_decoded(&mut source, format, system)?, format, system);
    }
    if matches!(format, Err(LogError::UnknownFormat))
        && let Some(mut text) = Utf16Text::new(first_bytes, &mut source)?
    {
        let first_bytes = read_first_bytes(&mut text)?;
        let format = detect_format(&first_bytes)?;
        return read_format(format, &mut io::Cursor::new(first_bytes).chain(text), unit, system);
    }
    read_format(format?, &mut source, unit, system)
}

fn read_first_bytes(source: &mut dyn Read) -> io::Result<Vec<u8>> {
    let mut first_bytes = Vec::new();
    source.take(FORMAT_DETECTION_BYTES as u64).read_to_end(&mut first_bytes)?;
    Ok(first_bytes)
}

fn read_format(
    format: LogFormat,
    mut source: &mut dyn Read,
    unit: FieldUnit,
    system: Option<u8>,
) -> Result<LoggedFlight, LogError> {
    let flight = match format {
        LogFormat::DataFlash => dataflash::read_binary(&mut source)?,
        LogFormat::DataFlashText => dataflash::read_text(&mut source)?,
        LogFormat::ULog => ulog::read_ulog(&mut source)?,
        LogFormat::TLog => tlog::read_tlog(&mut source, system)?,
        LogFormat::Csv => csv::read_csv(source, unit).map_err(LogError::Csv)?,
    };
    check_flight(flight, format, system)
}

/// Whether the flight has what any judgement needs.
fn check_flight(flight: LoggedFlight, format: LogFormat, system: Option<u8>) -> Result<LoggedFlight, LogError> {
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

fn detect_format(first_bytes: &[u8]) -> Result<LogFormat, LogError> {
    let text = || first_bytes.split(|&byte| byte == b'\n').take(100);
    if first_bytes.is_empty() {
        Err(LogError::Empty)
    } else if first_bytes.starts_with(&ulog::ULOG_MAGIC) {
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
    } else {
        Err(LogError::UnknownFormat)
    }
}

#[cfg(test)]
mod tests;
