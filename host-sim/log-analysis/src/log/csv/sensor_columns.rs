//! Columns by the names that recorders of gyro, accelerometer and magnetometer use, and their axes.

use std::borrow::Cow;

use super::column_unit::name_and_unit;
use super::table_cells::{cell_separator, trimmed_cell};

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
pub(super) fn is_sensor_table(header: &str, file_stem: &str) -> bool {
    let cells = header_cells(header, file_stem);
    let has = |own_name: &str| cells.iter().any(|cell| cell.name == own_name);
    let is_of_phyphox = PHYPHOX_FILES.contains(&file_stem.to_lowercase().as_str())
        && has("Time")
        && ["p_dps", "ax", "mx", "lat_deg"].into_iter().any(has);
    let has_clock = ["seconds_elapsed", "Timestamp (us)"].iter().any(|clock| header.contains(clock));
    (has_clock || is_of_phyphox) && !["p_dps", "ax", "mx"].into_iter().all(has)
}
