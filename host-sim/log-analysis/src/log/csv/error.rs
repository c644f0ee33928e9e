//! Errors of reading a table.

use std::fmt;

use crate::numbers::quantile;

/// Reason why a table cannot be read.
#[derive(Clone, Debug, PartialEq)]
pub enum CsvError {
    /// The source cannot be read, with the reason.
    Unreadable(String),
    /// A required column is missing; its name.
    MissingColumn(String),
    /// A column of body rates is missing although others are present; its name.
    MissingRateColumn(&'static str),
    /// The header declares a unit that is not known; names of the column and of the unit.
    UnknownUnit(String, String),
    /// Seconds between rows are too many for this unit; their median.
    TimeUnit(f64),
    /// Angles are too large for their unit; the largest.
    AngleUnit(f64),
    /// The field of this axis wraps at 16 bits.
    FieldWraps(char),
    /// The table has no valid row; line number, column name and content of the first invalid cell.
    NoRows(Option<(u64, String, String)>),
}

impl CsvError {
    /// Stable code of the reason, for programs.
    pub const fn stable_code(&self) -> &'static str {
        match self {
            Self::Unreadable(_) => "unreadable-file",
            Self::MissingColumn(_) | Self::MissingRateColumn(_) => "missing-column",
            Self::UnknownUnit(..) => "unknown-unit",
            Self::TimeUnit(_) => "time-unit",
            Self::AngleUnit(_) => "angle-unit",
            Self::FieldWraps(_) => "field-wraps",
            Self::NoRows(_) => "no-rows",
        }
    }
}

impl fmt::Display for CsvError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Unreadable(reason) => f.write_str(reason),
            Self::MissingColumn(name) => {
                write!(
                    f,
                    "no column {name}; needed are t_s, mx, my, mz, roll_deg, pitch_deg (or time, MagX, MagY, MagZ, roll, \
                     pitch), named in the first line; p_dps, q_dps, r_dps, ax, ay, az give roll and pitch, too"
                )
            }
            Self::MissingRateColumn(name) => write!(f, "no column {name}; p_dps, q_dps and r_dps belong together"),
            Self::UnknownUnit(column, unit) => write!(f, "{column} has no unit {unit:?}"),
            Self::TimeUnit(step) => write!(
                f,
                "rows are {step:.0} apart in t_s, which is in seconds: name another unit in the header, as `t_s (ms)` or \
                 `t_s (us)`"
            ),
            Self::AngleUnit(largest) => write!(
                f,
                "the attitude reaches {largest:.0}, and is in degrees: name another unit in the header, as `roll (cdeg)` for \
                 hundredths"
            ),
            Self::FieldWraps(axis) => write!(
                f,
                "m{axis} jumps between -32768 and 32767, the ends of 16 bits: the field was recorded with too few bits, or in \
                 too small a unit"
            ),
            Self::NoRows(None) => f.write_str("there are no rows"),
            Self::NoRows(Some((line, column, found))) => {
                write!(f, "there are no rows; line {line}, {column}: {found:?} cannot be read")
            }
        }
    }
}

impl std::error::Error for CsvError {}

/// Longest median interval between rows, seconds: no attitude is interpolated over more than a second.
const MAX_STEP_S: f64 = 5.0;

/// Fewest rows by which a table is judged.
const MIN_ROWS: usize = 20;

/// Largest angle, degrees; and smallest fraction of the rows beyond it.
const MAX_ANGLE_DEG: f64 = 400.0;
const MIN_FRACTION_BEYOND: f64 = 0.01;

/// Smallest step of a value that wraps at 16 bits, and the fewest of them: a spike is two.
const MIN_WRAP_STEP: f64 = 40_000.0;
const MIN_WRAPS: usize = 4;
const MAX_16_BITS: f64 = 32_768.0;

/// Angles and fields of the rows of a table, so far.
#[derive(Debug, Default)]
pub(super) struct ScaleMonitor {
    rows: usize,
    rows_beyond: usize,
    largest_angle: f64,
    last_field: Option<[f64; 3]>,
    largest_field: f64,
    wraps: [usize; 3],
}

impl ScaleMonitor {
    /// Adds a row with the numbers of its cells.
    pub fn add_row(&mut self, angles: [f64; 2], field: [f64; 3]) {
        let angle = angles[0].abs().max(angles[1].abs());
        self.rows += 1;
        self.rows_beyond += usize::from(angle > MAX_ANGLE_DEG);
        self.largest_angle = self.largest_angle.max(angle);
        self.largest_field = field.iter().fold(self.largest_field, |largest, axis| largest.max(axis.abs()));
        let last = self.last_field.replace(field).unwrap_or(field);
        for (axis, wraps) in self.wraps.iter_mut().enumerate() {
            *wraps += usize::from((field[axis] - last[axis]).abs() > MIN_WRAP_STEP);
        }
    }

    /// Problem of all rows; rows that are not in order of time show no wrap.
    pub fn problem(&self, is_unordered: bool) -> Option<CsvError> {
        if self.rows >= MIN_ROWS && self.rows_beyond as f64 > MIN_FRACTION_BEYOND * self.rows as f64 {
            return Some(CsvError::AngleUnit(self.largest_angle));
        }
        let wrapped = self.wraps.iter().position(|wraps| *wraps >= MIN_WRAPS);
        let is_of_16_bits = self.largest_field <= MAX_16_BITS && !is_unordered;
        wrapped.filter(|_| is_of_16_bits).map(|axis| CsvError::FieldWraps(['x', 'y', 'z'][axis]))
    }
}

/// Problem of the sorted times of the first rows.
pub(super) fn time_problem(times_s: &[f64]) -> Option<CsvError> {
    let steps_s: Vec<f64> = times_s.windows(2).map(|pair| pair[1] - pair[0]).filter(|step_s| *step_s > 0.0).collect();
    let (count, median_s) = (steps_s.len(), quantile(steps_s, 0.5)?);
    (count >= MIN_ROWS && median_s > MAX_STEP_S).then_some(CsvError::TimeUnit(median_s))
}
