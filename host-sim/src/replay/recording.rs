//! Recorded flights: comma-separated values with a header line.

use std::fmt;
use std::path::Path;

use autoswing::frames::{Attitude, Field, Sensor};

use super::rates;

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
    /// Body rates p, q, r at that instant, rad/s, where there are any.
    pub rates_rad_s: Option<[f32; 3]>,
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
    /// A column of the rates is missing, though another is there; its name.
    NoRate(&'static str),
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
            Self::NoRate(name) => write!(f, "no column {name}; p_dps, q_dps and r_dps belong together"),
            Self::BadLine { line, column, found } => write!(f, "line {line}, {column}: {found:?} is not a number"),
            Self::TimeGoesBack { line } => write!(f, "line {line}: t_s is not later than in the line before"),
            Self::Empty => f.write_str("there are no rows"),
        }
    }
}

impl std::error::Error for RecordingError {}

/// Reads a recording: columns `t_s,mx,my,mz,roll_deg,pitch_deg`, optional `use` (0: not to be fitted to),
/// `yaw_ref_deg`, and `p_dps,q_dps,r_dps`, the mean body rates since the row before; others are passed over. A
/// reference or rates that are left empty on a line are not known there.
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
    rates::at_the_rows(&mut rows);
    if rows.is_empty() { Err(RecordingError::Empty) } else { Ok(rows) }
}

fn line_of(record: &csv::StringRecord) -> u64 {
    record.position().map_or(0, csv::Position::line)
}

/// Where the columns stand.
struct Columns {
    needed: [(&'static str, usize); 6],
    rates: Option<[(&'static str, usize); 3]>,
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
        Ok(Self { needed, rates: rates_in(header)?, usable: find("use"), reference: find("yaw_ref_deg") })
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
        let is_given = |index: usize| record.get(index).is_some_and(|text| !text.is_empty());
        let rates = match self.rates.filter(|rates| rates.iter().any(|&(_, index)| is_given(index))) {
            Some([p, q, r]) => Some([number(p.0, p.1)?, number(q.0, q.1)?, number(r.0, r.1)?]),
            None => None,
        };
        let reference = self.reference.filter(|&index| is_given(index));
        Ok(Row {
            t_s,
            field: Field::from_ut(x, y, z),
            attitude: Attitude::from_deg(roll_deg as f32, pitch_deg as f32),
            rates_rad_s: rates.map(|rates| rates.map(|dps| dps.to_radians() as f32)),
            usable: self.usable.map_or(Ok(1.0), |index| number("use", index))? != 0.0,
            reference_deg: reference.map(|index| number("yaw_ref_deg", index)).transpose()?,
        })
    }
}

/// Where the columns of the rates stand: all three or none.
fn rates_in(header: &csv::StringRecord) -> Result<Option<[(&'static str, usize); 3]>, RecordingError> {
    let names = ["p_dps", "q_dps", "r_dps"];
    let found = names.map(|name| header.iter().position(|column| column == name));
    match found {
        [Some(p), Some(q), Some(r)] => Ok(Some([(names[0], p), (names[1], q), (names[2], r)])),
        [None, None, None] => Ok(None),
        [p, q, _] => Err(RecordingError::NoRate(if p.is_none() {
            names[0]
        } else if q.is_none() {
            names[1]
        } else {
            names[2]
        })),
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

    /// Means since the row before, in degrees a second; on the last line they are not known.
    #[test]
    fn rates_are_of_their_row_s_instant() {
        let text = "t_s,mx,my,mz,roll_deg,pitch_deg,r_dps,p_dps,q_dps\n\
                    0,1,2,3,4,5,30,10,20\n1,1,2,3,4,5,30,10,20\n2,1,2,3,4,5,60,30,10\n3,1,2,3,4,5,,,\n";
        let rows = parse(text.as_bytes(), Unit::Milligauss).unwrap();
        let expected = [Some([10.0, 20.0, 30.0]), Some([20.0, 15.0, 45.0]), Some([30.0, 10.0, 60.0]), None];
        assert_eq!(rows.len(), expected.len());
        for (row, expected) in rows.iter().zip(expected) {
            assert_eq!(row.rates_rad_s.map(|rates| rates.map(|rate| rate.to_degrees().round())), expected);
        }
        assert!(parse(GOOD.as_bytes(), Unit::Milligauss).unwrap().iter().all(|row| row.rates_rad_s.is_none()));
    }

    #[test]
    fn rates_are_known_all_three_or_none() {
        for (columns, missing) in
            [("q_dps,r_dps", "p_dps"), ("p_dps,r_dps", "q_dps"), ("q_dps,p_dps", "r_dps"), ("r_dps", "p_dps")]
        {
            let text = format!("t_s,mx,my,mz,roll_deg,pitch_deg,{columns}\n");
            let error = parse(text.as_bytes(), Unit::Milligauss).unwrap_err();
            assert_eq!(error, RecordingError::NoRate(missing));
            assert!(error.to_string().starts_with(&format!("no column {missing};")), "{error}");
        }
        for (rates, column, found) in [(",2,3", "p_dps", ""), ("1,,3", "q_dps", ""), ("1,2,inf", "r_dps", "inf")] {
            let text = format!("t_s,mx,my,mz,roll_deg,pitch_deg,p_dps,q_dps,r_dps\n0,1,2,3,4,5,{rates}\n");
            let error = RecordingError::BadLine { line: 2, column, found: found.to_owned() };
            assert_eq!(parse(text.as_bytes(), Unit::Milligauss), Err(error));
        }
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
