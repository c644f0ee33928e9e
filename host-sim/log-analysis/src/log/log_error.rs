//! Reasons why a log cannot be read.

use std::fmt;
use std::io;

use super::csv::CsvError;
use super::flight::LogFormat;

/// Reason why a log cannot be read.
#[derive(Debug)]
pub enum LogError {
    /// The source cannot be read.
    Io(io::Error),
    /// The file is empty.
    Empty,
    /// The content matches no supported format.
    UnknownFormat,
    /// The format is known and not read; what to do instead.
    UnreadFormat(&'static str),
    /// An archive without a log; names of its files.
    ArchiveWithoutLog(Vec<String>),
    /// Several logs in place of one; their names.
    SeveralLogs(Vec<String>),
    /// No log of the name that was asked for; names of those that are there.
    NoLogOfName(Vec<String>),
    /// Error in the values of a table.
    Csv(CsvError),
    /// The log has no valid magnetometer reading. Number of rejected ones.
    NoMagnetometer(LogFormat, u64),
    /// All fields are those of PX4 sensors without device id.
    UnassignedFields(LogFormat),
    /// The log has no attitude.
    NoAttitude(LogFormat),
    /// The requested MAVLink system is absent; systems that are present.
    SystemNotFound(u8, Vec<u8>),
    /// The log's messages carry no time.
    NoTimeStamps(LogFormat),
}

impl LogError {
    /// Stable code of the reason, for programs.
    #[must_use]
    pub const fn stable_code(&self) -> &'static str {
        match self {
            Self::Io(_) => "unreadable-file",
            Self::Empty => "empty-file",
            Self::UnknownFormat => "unknown-format",
            Self::UnreadFormat(_) => "unread-format",
            Self::ArchiveWithoutLog(_) => "archive-without-log",
            Self::SeveralLogs(_) => "several-logs",
            Self::NoLogOfName(_) => "no-such-log",
            Self::Csv(error) => error.stable_code(),
            Self::NoMagnetometer(..) => "no-field",
            Self::UnassignedFields(_) => "unassigned-field",
            Self::NoAttitude(_) => "no-attitude",
            Self::SystemNotFound(..) => "no-such-system",
            Self::NoTimeStamps(_) => "no-time",
        }
    }
}

/// Most names that a message lists.
const MAX_LISTED_NAMES: usize = 8;

fn name_list(names: &[String]) -> String {
    let listed = names.iter().take(MAX_LISTED_NAMES).map(String::as_str).collect::<Vec<_>>().join(", ");
    let further_count = names.len().saturating_sub(MAX_LISTED_NAMES);
    if further_count == 0 { listed } else { format!("{listed} and {further_count} more") }
}

impl fmt::Display for LogError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Io(error) => error.fmt(f),
            Self::Empty => f.write_str("the file is empty"),
            Self::UnknownFormat => f.write_str(
                "not a known log: ArduPilot DataFlash (.bin, .log), PX4 ULog (.ulg), MAVLink (.tlog), what mavlogdump \
                 makes of these, a blackbox of INAV or Betaflight, or a table whose first line names t_s,mx,my,mz,roll_deg,pitch_deg",
            ),
            Self::UnreadFormat(advice) => f.write_str(advice),
            Self::ArchiveWithoutLog(names) if names.is_empty() => f.write_str("the archive is empty"),
            Self::ArchiveWithoutLog(names) => write!(f, "the archive has no log; it has {}", name_list(names)),
            Self::SeveralLogs(names) => {
                write!(f, "these are several logs, of which one is judged at a time: {}", name_list(names))
            }
            Self::NoLogOfName(names) => write!(f, "the file has no log of this name; it has {}", name_list(names)),
            Self::Csv(error) => error.fmt(f),
            Self::NoMagnetometer(LogFormat::Blackbox, 0) => f.write_str(
                "blackbox: no magnetometer is logged: `blackbox MAG` in INAV's CLI logs it, in Betaflight's `set \
                 blackbox_disable_mag = OFF`",
            ),
            Self::NoMagnetometer(format, 0) => write!(f, "{}: no magnetometer is logged", format.format_name()),
            Self::NoMagnetometer(format, unhealthy) => write!(
                f,
                "{}: all {unhealthy} magnetometer readings are out of range, or marked unhealthy by the autopilot",
                format.format_name()
            ),
            Self::UnassignedFields(format) => write!(
                f,
                "{}: PX4 sends SCALED_IMU without device id and in the axes of the sensor, so that no parameters can be \
                 assigned to its field: use HIGHRES_IMU or the ULog of the flight",
                format.format_name()
            ),
            Self::NoAttitude(LogFormat::Blackbox) => f.write_str(
                "blackbox: no attitude is logged: `blackbox ATTI` in INAV's CLI logs it, in Betaflight's `set \
                 blackbox_disable_attitude = OFF`; Betaflight before 2025.12 has none to log",
            ),
            Self::NoAttitude(LogFormat::Csv) => f.write_str(
                "CSV: no attitude: it takes roll and pitch, or a gyro and an accelerometer with twenty rows a second or more",
            ),
            Self::NoAttitude(format) => write!(f, "{}: no attitude is logged", format.format_name()),
            Self::SystemNotFound(system, found) if found.is_empty() => {
                write!(f, "no system {system}: no vehicle of the log has this number")
            }
            Self::SystemNotFound(system, found) => {
                let found: Vec<String> = found.iter().map(u8::to_string).collect();
                write!(f, "there is no vehicle of system {system}; there is {}", found.join(", "))
            }
            Self::NoTimeStamps(format) => write!(
                f,
                "{}: its messages carry no time (logs until 2014): the attitude of a field is unknown",
                format.format_name()
            ),
        }
    }
}

impl std::error::Error for LogError {}

impl From<io::Error> for LogError {
    fn from(error: io::Error) -> Self {
        Self::Io(error)
    }
}
