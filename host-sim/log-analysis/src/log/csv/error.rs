//! Errors of tables.

use std::fmt;

/// Reason why a table cannot be read.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum CsvError {
    /// The source cannot be read, with the reason.
    Source(String),
    /// Name of a missing required column.
    NoColumn(String),
    /// Name of a missing rate column, if others are present.
    NoRate(&'static str),
    /// The table has no valid row. Line, column and content of the first invalid one.
    NoRows(Option<(u64, String, String)>),
}

impl fmt::Display for CsvError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Source(reason) => f.write_str(reason),
            Self::NoColumn(name) => {
                write!(
                    f,
                    "no column {name}; needed are t_s, mx, my, mz, roll_deg, pitch_deg (or time, MagX, MagY, MagZ, roll, \
                     pitch), named in the first line"
                )
            }
            Self::NoRate(name) => write!(f, "no column {name}; p_dps, q_dps and r_dps belong together"),
            Self::NoRows(None) => f.write_str("there are no rows"),
            Self::NoRows(Some((line, column, found))) => {
                write!(f, "there are no rows; line {line}, {column}: {found:?} cannot be read")
            }
        }
    }
}

impl std::error::Error for CsvError {}
