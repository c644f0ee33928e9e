//! Logs of which each topic or sensor is a table in a file of its own.
//!
//! | files | of |
//! |---|---|
//! | `flight_sensor_mag_0.csv`, ... | PX4's `ulog2csv` |
//! | `Gyroscope.csv`, `Gravity.csv`, `MagnetometerUncalibrated.csv`, ... | the app Sensor Logger |
//! | `Gyroscope.csv`, `Accelerometer.csv`, `Magnetometer.csv` | the app phyphox |
//! | `Inertial.csv`, `Magnetometer.csv` | xio's x-IMU3 |

use std::io::{self, Read};

use super::csv::{self, CsvError, FieldUnit, TableReader};
use super::flight::LoggedFlight;
use super::log_error::LogError;
use super::ulog::{UlogReader, topic_of_file};

/// A table of a log.
pub struct TableFile<'a> {
    /// Name of the log: the folder, followed by the beginning of the file's name if topics follow it.
    pub log_name: &'a str,
    file_stem: &'a str,
    /// Topic and its instance, of `ulog2csv`.
    topic: Option<(&'static str, u8)>,
}

impl<'a> TableFile<'a> {
    /// The table of this path, if its header is one.
    pub fn new(path: &'a str, first_bytes: &[u8]) -> Option<Self> {
        let path = path.strip_suffix(".csv")?;
        let header = String::from_utf8_lossy(first_bytes.split(|&byte| byte == b'\n').next()?);
        let (folder, file_stem) = path.rsplit_once('/').unwrap_or(("", path));
        if let Some((log_name, topic, instance)) = topic_of_file(path).filter(|_| header.starts_with("timestamp")) {
            return Some(Self { log_name, file_stem, topic: Some((topic, instance)) });
        }
        csv::is_sensor_table(&header, file_stem).then_some(Self { log_name: folder, file_stem, topic: None })
    }
}

/// The tables of a log that were read.
#[derive(Default)]
pub struct TableSet {
    /// Name of the log.
    pub log_name: String,
    topics: Option<UlogReader>,
    sensors: Option<TableReader>,
    first_error: Option<CsvError>,
}

impl TableSet {
    /// The log of this name, without tables.
    pub fn new(log_name: &str) -> Self {
        Self { log_name: log_name.to_owned(), ..Self::default() }
    }

    /// Reads a table. An error of a sensor's table is that of the log.
    pub fn read_table(&mut self, file: &TableFile<'_>, source: &mut dyn Read, unit: FieldUnit) -> io::Result<()> {
        if let Some((topic, instance)) = file.topic {
            return self.topics.get_or_insert_with(UlogReader::new).read_table(topic, instance, source);
        }
        let table_reader = self.sensors.get_or_insert_with(TableReader::new);
        if let Err(error) = csv::read_table(table_reader, source, unit, file.file_stem) {
            self.first_error.get_or_insert(error);
        }
        Ok(())
    }

    /// The flight of all tables; `None` without any.
    pub fn finish_flight(self) -> Option<Result<LoggedFlight, LogError>> {
        if let Some(topics) = self.topics {
            return Some(Ok(topics.finish_flight()));
        }
        let flight = self.sensors?.finish_flight();
        Some(self.first_error.map_or(flight, Err).map_err(LogError::Csv))
    }
}
