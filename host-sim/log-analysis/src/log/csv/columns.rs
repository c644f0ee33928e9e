//! Columns of a table: units that its header declares, as `mx (uT)`, `roll [rad]`, `time_ms`; columns of each sensor.

use std::borrow::Cow;

use serde::Deserialize;

use crate::numbers::{UT_PER_GAUSS, UT_PER_MILLIGAUSS};

/// Quantity of a column, with the unit of the reader.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Quantity {
    /// Seconds.
    Time,
    /// Microtesla.
    Field,
    /// Degrees.
    Angle,
    /// Degrees per second.
    Rate,
    /// Meters per second squared.
    Force,
}

/// A column whose unit the header may declare.
pub(super) struct ColumnNames {
    /// The reader's own name.
    pub name: &'static str,
    quantity: Quantity,
    /// Other names of the column.
    pub other_names: &'static [&'static str],
    /// Names before a unit, as in `roll_rad`.
    before_unit: &'static [&'static str],
}

const fn column(
    name: &'static str,
    quantity: Quantity,
    other_names: &'static [&'static str],
    before_unit: &'static [&'static str],
) -> ColumnNames {
    ColumnNames { name, quantity, other_names, before_unit }
}

pub(super) const COLUMNS_WITH_UNITS: [ColumnNames; 14] = [
    column("t_s", Quantity::Time, &["time", "time_s", "t", "seconds"], &["t", "time"]),
    column("mx", Quantity::Field, &["magx", "mag_x"], &["mx", "magx", "mag_x"]),
    column("my", Quantity::Field, &["magy", "mag_y"], &["my", "magy", "mag_y"]),
    column("mz", Quantity::Field, &["magz", "mag_z"], &["mz", "magz", "mag_z"]),
    column("roll_deg", Quantity::Angle, &["roll"], &["roll"]),
    column("pitch_deg", Quantity::Angle, &["pitch"], &["pitch"]),
    column("yaw_ref_deg", Quantity::Angle, &[], &["yaw_ref"]),
    column("yaw_deg", Quantity::Angle, &["yaw_log_deg"], &["yaw"]),
    column("p_dps", Quantity::Rate, &[], &["p"]),
    column("q_dps", Quantity::Rate, &[], &["q"]),
    column("r_dps", Quantity::Rate, &[], &["r"]),
    column("ax", Quantity::Force, &[], &["ax"]),
    column("ay", Quantity::Force, &[], &["ay"]),
    column("az", Quantity::Force, &[], &["az"]),
];

/// Names of the units in lower case, and their sizes in that of the reader.
const UNITS: [(Quantity, &[&str], f64); 19] = [
    (Quantity::Time, &["s", "sec", "seconds"], 1.0),
    (Quantity::Time, &["ms", "millis", "milliseconds"], 1e-3),
    (Quantity::Time, &["us", "\u{b5}s", "\u{3bc}s", "micros", "microseconds"], 1e-6),
    (Quantity::Time, &["ns", "nanoseconds"], 1e-9),
    (Quantity::Field, &["mg", "mgauss", "milligauss"], UT_PER_MILLIGAUSS),
    (Quantity::Field, &["g", "ga", "gauss"], UT_PER_GAUSS),
    (Quantity::Field, &["ut", "\u{b5}t", "\u{3bc}t", "microtesla"], 1.0),
    (Quantity::Field, &["nt", "nanotesla"], 1e-3),
    (Quantity::Field, &["mt", "millitesla"], 1e3),
    (Quantity::Field, &["t", "tesla"], 1e6),
    // x-IMU3: 1 is the strength where it was calibrated, 50 uT to a third.
    (Quantity::Field, &["a.u."], 50.0),
    (Quantity::Angle, &["deg", "degrees", "\u{b0}"], 1.0),
    (Quantity::Angle, &["rad", "radians"], 180.0 / std::f64::consts::PI),
    (Quantity::Angle, &["cdeg", "centideg", "centidegrees"], 0.01),
    (Quantity::Rate, &["dps", "deg/s", "deg_s", "\u{b0}/s"], 1.0),
    (Quantity::Rate, &["rad/s", "rad_s", "radps"], 180.0 / std::f64::consts::PI),
    (Quantity::Rate, &["mdps"], 1e-3),
    (Quantity::Force, &["m/s2", "m/s^2", "m/s\u{b2}", "mps2", "m_s2"], 1.0),
    (Quantity::Force, &["g"], 9.806_65),
];

/// Splits a header's cell into name and declared unit.
pub(super) fn name_and_unit(cell: &str) -> (&str, Option<&str>) {
    match cell.split_once(['(', '[']) {
        Some((name, unit)) => (name.trim(), Some(unit.trim_end_matches([')', ']']).trim())),
        None => (cell, None),
    }
}

impl ColumnNames {
    /// Names of the column of this name, or of that of the first compass.
    pub fn of(column: &str) -> Option<&'static Self> {
        let base = column.trim_end_matches(|character: char| character.is_ascii_digit());
        COLUMNS_WITH_UNITS.iter().find(|names| names.name == base)
    }

    /// Size of a unit in that of the reader, if it is known and belongs to the quantity.
    pub fn unit_size(&self, unit: &str) -> Option<f64> {
        let unit = unit.to_lowercase();
        let is_unit =
            |&&(of, names, _): &&(Quantity, &[&str], f64)| of == self.quantity && names.contains(&unit.as_str());
        UNITS.iter().find(is_unit).map(|(.., size)| *size)
    }

    /// Index of a cell that names this column with a unit, as `roll_rad`, and the unit's size.
    pub fn find_with_unit(&self, cells: &[HeaderCell<'_>]) -> Option<(usize, f64)> {
        cells.iter().enumerate().find_map(|(index, cell)| {
            let name = cell.name.to_lowercase();
            let unit = self.before_unit.iter().find_map(|before| name.strip_prefix(before)?.strip_prefix('_'))?;
            Some((index, self.unit_size(unit)?))
        })
    }
}

/// Unit of the field columns.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
pub enum FieldUnit {
    /// Milligauss, as ArduPilot logs.
    #[serde(rename = "mg")]
    Milligauss,
    /// Microtesla.
    #[serde(rename = "ut")]
    Microtesla,
}

impl FieldUnit {
    pub(super) const fn microtesla_per_unit(self) -> f64 {
        match self {
            Self::Milligauss => UT_PER_MILLIGAUSS,
            Self::Microtesla => 1.0,
        }
    }
}

pub(super) fn is_comment(line: &[u8]) -> bool {
    let text = line.trim_ascii();
    text.is_empty() || text.starts_with(b"#") || text.starts_with(b"sep=")
}

/// The most frequent separator of the header.
pub(super) fn cell_separator(header: &str) -> char {
    [',', ';', '\t'].into_iter().max_by_key(|&cell_separator| header.matches(cell_separator).count()).unwrap_or(',')
}

pub(super) fn trimmed_cell(value: &str) -> &str {
    value.trim_start_matches('\u{feff}').trim().trim_matches('"').trim()
}

/// Cell of a header by the reader's own name of the column.
pub(super) struct HeaderCell<'a> {
    pub name: Cow<'a, str>,
    pub unit: Option<&'a str>,
    /// Sign of the column in body axes, 1 or -1.
    pub sign: f64,
}

type SensorColumns = (&'static str, [&'static str; 3], &'static str);

/// Sensors as columns name them (`Gyroscope X`), or files with the columns `x`, `y`, `z`: the reader's names of the axes
/// forward, right, down, and the unit if none is declared.
const SENSORS: [SensorColumns; 8] = [
    ("gyroscope", ["p_dps", "q_dps", "r_dps"], "rad/s"),
    ("accelerometer", ["ax", "ay", "az"], "m/s2"),
    ("acceleration", ["ax", "ay", "az"], "m/s2"),
    ("totalacceleration", ["ax", "ay", "az"], "m/s2"),
    ("gravity", ["ax", "ay", "az"], "m/s2"),
    ("magnetometer", ["mx", "my", "mz"], "uT"),
    ("magnetic field", ["mx", "my", "mz"], "uT"),
    ("magnetometeruncalibrated", ["mx2", "my2", "mz2"], "uT"),
];

/// Further names of columns, and the reader's own.
const OTHER_NAMES: [(&str, &str); 6] = [
    ("seconds_elapsed", "t_s"),
    ("timestamp", "t_s"),
    ("latitude", "lat_deg"),
    ("longitude", "lon_deg"),
    ("altitude", "height_m"),
    ("height", "height_m"),
];

/// Files of phyphox, in lower case; each has one sensor.
const PHYPHOX_FILES: [&str; 4] = ["gyroscope", "accelerometer", "magnetometer", "location"];

/// Units by which xio's recorders are known from phones.
const XIO_UNITS: [&str; 3] = ["deg/s", "g", "a.u."];

/// Axes forward, right, down and signs of a recorder's x, y and z. xio: x forward, y left, z up.
const XIO_AXES: [(usize, f64); 3] = [(0, 1.0), (1, -1.0), (2, -1.0)];

/// Phones: x right, y forward, z up from the screen.
const PHONE_AXES: [(usize, f64); 3] = [(1, 1.0), (0, 1.0), (2, -1.0)];

/// Cells of a header. `file_stem` is the file's name without extension if each sensor has a file of its own.
pub(super) fn header_cells<'a>(header: &'a str, file_stem: &str) -> Vec<HeaderCell<'a>> {
    let cells: Vec<_> = header.split(cell_separator(header)).map(trimmed_cell).map(name_and_unit).collect();
    let is_of_xio = cells.iter().any(|(_, unit)| unit.is_some_and(|unit| XIO_UNITS.contains(&unit)));
    let axes = if is_of_xio { XIO_AXES } else { PHONE_AXES };
    let stem = file_stem.to_lowercase();
    cells.into_iter().map(|(name, unit)| header_cell(name, unit, &stem, axes)).collect()
}

fn header_cell<'a>(name: &'a str, unit: Option<&'a str>, stem: &str, axes: [(usize, f64); 3]) -> HeaderCell<'a> {
    let lower = name.to_lowercase();
    if let Some(((_, columns, default_unit), axis)) = sensor_and_axis(&lower, stem) {
        let (index, sign) = axes[axis];
        return HeaderCell { name: Cow::Borrowed(columns[index]), unit: unit.or(Some(default_unit)), sign };
    }
    let other = OTHER_NAMES.iter().find(|(other, _)| *other == lower && (*other != "timestamp" || unit.is_some()));
    HeaderCell { name: Cow::Borrowed(other.map_or(name, |(_, own)| own)), unit, sign: 1.0 }
}

/// Sensor and index of the axis of a column. Phones' `Accelerometer.csv` with columns `x`, `y`, `z` lacks gravity.
fn sensor_and_axis(column: &str, stem: &str) -> Option<(SensorColumns, usize)> {
    let (sensor, axis) = match column {
        "x" | "y" | "z" if stem != "accelerometer" => (stem, column),
        _ => column.rsplit_once(' ')?,
    };
    let axis = ["x", "y", "z"].iter().position(|name| *name == axis)?;
    SENSORS.iter().find(|(name, ..)| *name == sensor).map(|columns| (*columns, axis))
}

/// Whether this is a table whose log has further tables: it has the clock of Sensor Logger or of x-IMU3, or is a file of phyphox;
/// and it is no whole log.
pub(in crate::log) fn is_sensor_table(header: &str, file_stem: &str) -> bool {
    let cells = header_cells(header, file_stem);
    let has = |own_name: &str| cells.iter().any(|cell| cell.name == own_name);
    let is_of_phyphox = PHYPHOX_FILES.contains(&file_stem.to_lowercase().as_str())
        && has("Time")
        && ["p_dps", "ax", "mx", "lat_deg"].into_iter().any(has);
    let has_clock = ["seconds_elapsed", "Timestamp (us)"].iter().any(|clock| header.contains(clock));
    (has_clock || is_of_phyphox) && !["p_dps", "ax", "mx"].into_iter().all(has)
}
