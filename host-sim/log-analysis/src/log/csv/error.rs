//! Errors of reading a table.

use std::fmt;

use super::scale_problem::ScaleProblem;

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
    /// The values contradict the units of the columns.
    Scale(ScaleProblem),
    /// The table has no valid row; line number, column name and content of the first invalid cell.
    NoRows(Option<(u64, String, String)>),
}

impl CsvError {
    /// Stable code of the reason, for programs.
    #[must_use]
    pub const fn stable_code(&self) -> &'static str {
        match self {
            Self::Unreadable(_) => "unreadable-file",
            Self::MissingColumn(_) | Self::MissingRateColumn(_) => "missing-column",
            Self::UnknownUnit(..) => "unknown-unit",
            Self::Scale(problem) => problem.stable_code(),
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
            Self::Scale(problem) => problem.fmt(f),
            Self::NoRows(None) => f.write_str("there are no rows"),
            Self::NoRows(Some((line, column, found))) => {
                write!(f, "there are no rows; line {line}, {column}: {found:?} cannot be read")
            }
        }
    }
}

impl std::error::Error for CsvError {}
