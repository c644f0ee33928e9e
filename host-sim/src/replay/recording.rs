//! Recorded flights: comma-separated values with a header line.

use std::fmt;
use std::path::Path;

use autoswing::frames::{Attitude, Field, Sensor};

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

/// One row.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Row {
    /// Seconds.
    pub t_s: f64,
    /// The field in the chip's axes.
    pub field: Field<Sensor>,
    /// The attitude as the autopilot logged it.
    pub attitude: Attitude,
    /// Whether the row may be fitted to.
    pub usable: bool,
    /// A reference heading in degrees, from any north, where there is one.
    pub reference_deg: Option<f64>,
}

/// Why a recording cannot be read.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum RecordingError {
    /// The file cannot be opened or read; why.
    File(String),
    /// A column is missing; its name.
    NoColumn(&'static str),
    /// A line does not hold what it must.
    BadLine {
        /// Its number, the header being 1.
        line: u64,
        /// The column.
        column: &'static str,
        /// What stands there.
        found: String,
    },
    /// Time does not go on from one row to the next.
    TimeGoesBack {
        /// The number of the later line.
        line: u64,
    },
    /// There are no rows.
    Empty,
}

impl fmt::Display for RecordingError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::File(why) => f.write_str(why),
            Self::NoColumn(name) => {
                write!(f, "no column {name}; needed are t_s, mx, my, mz, roll_deg, pitch_deg, named in the first line")
            }
            Self::BadLine { line, column, found } => write!(f, "line {line}, {column}: {found:?} is not a number"),
            Self::TimeGoesBack { line } => write!(f, "line {line}: t_s is not later than in the line before"),
            Self::Empty => f.write_str("there are no rows"),
        }
    }
}

impl std::error::Error for RecordingError {}

/// Reads a recording: columns `t_s,mx,my,mz,roll_deg,pitch_deg`, optional `use` (0: not to be fitted to) and
/// `yaw_ref_deg`; others are passed over.
///
/// # Errors
///
/// What is wrong, and on which line.
pub fn read(path: &Path, unit: Unit) -> Result<Vec<Row>, RecordingError> {
    let file = std::fs::File::open(path).map_err(|e| RecordingError::File(format!("{}: {e}", path.display())))?;
    parse(file, unit)
}

/// As [`read`], from any source.
///
/// # Errors
///
/// As [`read`].
pub fn parse(source: impl std::io::Read, unit: Unit) -> Result<Vec<Row>, RecordingError> {
    let mut reader = csv::ReaderBuilder::new().trim(csv::Trim::All).comment(Some(b'#')).from_reader(source);
    let unreadable = |e: csv::Error| RecordingError::File(e.to_string());
    let columns = Columns::find(reader.headers().map_err(unreadable)?)?;
    let mut rows: Vec<Row> = Vec::new();
    for record in reader.records() {
        let record = record.map_err(unreadable)?;
        let row = columns.row(&record, unit)?;
        if rows.last().is_some_and(|last| row.t_s <= last.t_s) {
            return Err(RecordingError::TimeGoesBack { line: line_of(&record) });
        }
        rows.push(row);
    }
    if rows.is_empty() { Err(RecordingError::Empty) } else { Ok(rows) }
}

fn line_of(record: &csv::StringRecord) -> u64 {
    record.position().map_or(0, csv::Position::line)
}

/// Where the columns stand.
struct Columns {
    needed: [(&'static str, usize); 6],
    usable: Option<usize>,
    reference: Option<usize>,
}

impl Columns {
    fn find(header: &csv::StringRecord) -> Result<Self, RecordingError> {
        let find = |name: &str| header.iter().position(|column| column == name);
        let mut needed = ["t_s", "mx", "my", "mz", "roll_deg", "pitch_deg"].map(|name| (name, 0));
        for (name, index) in &mut needed {
            *index = find(name).ok_or(RecordingError::NoColumn(name))?;
        }
        Ok(Self { needed, usable: find("use"), reference: find("yaw_ref_deg") })
    }

    fn row(&self, record: &csv::StringRecord, unit: Unit) -> Result<Row, RecordingError> {
        let number = |column: &'static str, index: usize| {
            let text = record.get(index).unwrap_or_default();
            let bad = || RecordingError::BadLine { line: line_of(record), column, found: text.to_owned() };
            text.parse::<f64>().ok().filter(|n| n.is_finite()).ok_or_else(bad)
        };
        let mut values = [0.0; 6];
        for (value, (column, index)) in values.iter_mut().zip(self.needed) {
            *value = number(column, index)?;
        }
        let [t_s, x, y, z, roll_deg, pitch_deg] = values;
        let [x, y, z] = [x, y, z].map(|value| (value * unit.microtesla()) as f32);
        let reference = self.reference.filter(|&index| record.get(index).is_some_and(|text| !text.is_empty()));
        Ok(Row {
            t_s,
            field: Field::from_ut(x, y, z),
            attitude: Attitude::from_deg(roll_deg as f32, pitch_deg as f32),
            usable: self.usable.map_or(Ok(1.0), |index| number("use", index))? != 0.0,
            reference_deg: reference.map(|index| number("yaw_ref_deg", index)).transpose()?,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const GOOD: &str =
        "t_s,extra,mx,my,mz,roll_deg,pitch_deg,use\n0,9,100,-200,400,10,-2,1\n0.1,9,101,-201,401,11,-3,0\n";

    #[test]
    fn columns_are_found_by_name_and_units_converted() {
        let rows = parse(GOOD.as_bytes(), Unit::Milligauss).unwrap();
        assert_eq!(rows.len(), 2);
        assert_eq!(rows[0].field, Field::from_ut(10.0, -20.0, 40.0));
        assert!((rows[1].attitude.pitch_rad.to_degrees() + 3.0).abs() < 1e-5);
        assert!(rows[0].usable && !rows[1].usable && rows[0].reference_deg.is_none());
        let in_ut = parse(GOOD.as_bytes(), Unit::Microtesla).unwrap();
        assert_eq!(in_ut[0].field, Field::from_ut(100.0, -200.0, 400.0));
    }

    #[test]
    fn what_is_wrong_is_named_with_its_line() {
        let parse = |text: &str| parse(text.as_bytes(), Unit::Milligauss).unwrap_err();
        assert_eq!(parse("t_s,mx,my,mz,roll_deg\n"), RecordingError::NoColumn("pitch_deg"));
        assert_eq!(parse("t_s,mx,my,mz,roll_deg,pitch_deg\n"), RecordingError::Empty);
        let bad = RecordingError::BadLine { line: 3, column: "my", found: "nan".to_owned() };
        assert_eq!(parse("t_s,mx,my,mz,roll_deg,pitch_deg\n0,1,2,3,4,5\n1,1,nan,3,4,5\n"), bad);
        let back = RecordingError::TimeGoesBack { line: 3 };
        assert_eq!(parse("t_s,mx,my,mz,roll_deg,pitch_deg\n1,1,2,3,4,5\n1,1,2,3,4,5\n"), back);
        assert!(matches!(parse("t_s,mx,my,mz,roll_deg,pitch_deg\n1,1\n"), RecordingError::File(_)));
    }
}
