//! Columns of a table and the parser of its lines.

use std::collections::HashMap;

use super::super::flight_builder::MAX_COMPASSES;
use super::columns::{
    COLUMNS_WITH_UNITS, ColumnNames, FieldUnit, HeaderCell, cell_separator, header_cells, trimmed_cell,
};
use super::error::CsvError;

pub(super) struct TableLayout {
    cell_separator: char,
    /// Number of columns that the header names.
    column_count: usize,
    /// Columns by the reader's own name.
    columns: HashMap<String, Column>,
    /// Number and columns of each compass.
    pub compasses: Vec<(u8, [String; 3])>,
    /// Whether the table has roll and pitch; without them gyro and accelerometer give the attitude.
    pub has_attitude: bool,
}

struct Column {
    index: usize,
    /// Size of the unit that the header declares.
    unit_size: Option<f64>,
}

/// Columns of which the header of a table has some.
const USUAL_COLUMNS: [&str; 6] = ["t_s", "mx", "my", "mz", "roll_deg", "pitch_deg"];

/// Columns of the body rates, degrees per second, and of the specific force, m/s^2.
pub(super) const RATE_COLUMNS: [&str; 3] = ["p_dps", "q_dps", "r_dps"];
pub(super) const FORCE_COLUMNS: [&str; 3] = ["ax", "ay", "az"];

/// Columns without a unit that a header may declare.
const COLUMNS_WITHOUT_UNITS: [&str; 8] =
    ["use", "current_a", "lat_deg", "lon_deg", "height_m", "speed_m_s", "course_deg", "armed"];

/// Number of the usual columns that a line must name to be the header of a table.
const MIN_USUAL_COLUMNS: usize = 3;

pub(super) fn is_header(line: &str) -> bool {
    let cells = header_cells(line, "");
    let is_named = |name: &&&str| !matches!(Column::find(&cells, name), Ok(None));
    let has_own_clock = line.split(cell_separator(line)).any(|cell| trimmed_cell(cell).eq_ignore_ascii_case("t_s"));
    USUAL_COLUMNS.iter().filter(is_named).count() >= MIN_USUAL_COLUMNS || has_own_clock
}

/// Name of a column, and the content of its invalid cell.
pub(super) type InvalidCell = (String, String);

impl Column {
    /// The column with this name, with one of its other names, or with a name and unit.
    fn find(cells: &[HeaderCell<'_>], name: &str) -> Result<Option<Self>, CsvError> {
        let position = |name: &str| cells.iter().position(|cell| cell.name.eq_ignore_ascii_case(name));
        let names = ColumnNames::of(name);
        let own_names = names.filter(|names| names.name == name);
        let with_name = position(name).or_else(|| own_names?.other_names.iter().find_map(|other| position(other)));
        let found = with_name.map(|index| (index, None));
        let with_unit = || own_names?.find_with_unit(cells).map(|(index, unit_size)| (index, Some(unit_size)));
        let Some((index, mut unit_size)) = found.or_else(with_unit) else { return Ok(None) };
        if let (Some(names), Some(unit)) = (names, cells[index].unit) {
            let unknown_unit = || CsvError::UnknownUnit(name.to_owned(), unit.to_owned());
            unit_size = Some(cells[index].sign * names.unit_size(unit).ok_or_else(unknown_unit)?);
        }
        Ok(Some(Self { index, unit_size }))
    }
}

impl TableLayout {
    /// Columns by the first line. `file_stem` is the file's name without extension if other files have further columns,
    /// else empty.
    pub fn from_header(header: &str, file_stem: &str) -> Result<Self, CsvError> {
        let cells = header_cells(header, file_stem);
        let compasses = (1..=MAX_COMPASSES).map(|compass_number| {
            let number = if compass_number == 1 { String::new() } else { compass_number.to_string() };
            (compass_number, ["mx", "my", "mz"].map(|axis| format!("{axis}{number}")))
        });
        let names = COLUMNS_WITH_UNITS.iter().map(|names| names.name).chain(COLUMNS_WITHOUT_UNITS).map(str::to_owned);
        let mut columns = HashMap::new();
        for name in names.chain(compasses.clone().skip(1).flat_map(|(_, axes)| axes)) {
            if let Some(column) = Column::find(&cells, &name)? {
                columns.insert(name, column);
            }
        }
        let need = |names: &[&str]| match names.iter().find(|name| !columns.contains_key(**name)) {
            Some(missing) => Err(CsvError::MissingColumn((*missing).to_owned())),
            None => Ok(()),
        };
        let is_whole_log = file_stem.is_empty();
        let has_rates = has_rate_columns(&columns)?;
        if is_whole_log {
            need(&["mx", "my", "mz"])?;
            if !has_rates || need(&FORCE_COLUMNS).is_err() {
                need(&["roll_deg", "pitch_deg"])?;
            }
        }
        need(&["t_s"])?;
        Ok(Self {
            cell_separator: cell_separator(header),
            column_count: cells.len(),
            compasses: compasses.filter(|(_, axes)| axes.iter().all(|axis| columns.contains_key(axis))).collect(),
            // Sensor Logger and x-IMU3 have other angles.
            has_attitude: is_whole_log && need(&["roll_deg", "pitch_deg"]).is_ok(),
            columns,
        })
    }

    /// Rejects lines with more cells than columns, as decimal commas produce in a table separated by commas.
    pub fn reject_extra_cells(&self, cells: &LineCells<'_>) -> Result<(), InvalidCell> {
        let extra = cells.cells.iter().skip(self.column_count).find(|cell| !cell.is_empty());
        let where_found = "beyond the last column (decimal commas need semicolons between columns)";
        extra.map_or(Ok(()), |cell| Err((where_found.to_owned(), cell.chars().take(40).collect())))
    }

    /// Microtesla per unit of a column of the field.
    pub fn microtesla_per_unit(&self, column: &str, unit: FieldUnit) -> f64 {
        let is_declared = self.columns.get(column).is_some_and(|column| column.unit_size.is_some());
        if is_declared { 1.0 } else { unit.microtesla_per_unit() }
    }

    pub fn split_line<'a>(&'a self, line: &'a str) -> LineCells<'a> {
        LineCells {
            columns: &self.columns,
            cells: line.split(self.cell_separator).map(trimmed_cell).collect(),
            has_decimal_comma: self.cell_separator != ',',
        }
    }
}

/// Whether the table has the rate columns: all three or none.
fn has_rate_columns(columns: &HashMap<String, Column>) -> Result<bool, CsvError> {
    match RATE_COLUMNS.iter().find(|name| !columns.contains_key(**name)) {
        Some(missing) if RATE_COLUMNS.iter().any(|name| columns.contains_key(*name)) => {
            Err(CsvError::MissingRateColumn(missing))
        }
        missing => Ok(missing.is_none()),
    }
}

pub(super) struct LineCells<'a> {
    columns: &'a HashMap<String, Column>,
    cells: Vec<&'a str>,
    has_decimal_comma: bool,
}

impl LineCells<'_> {
    /// The number in a column; none without the column, if empty or `nan`; NaN if invalid.
    pub fn number(&self, column: &str) -> Option<f64> {
        let column = self.columns.get(column)?;
        let text = self.cells.get(column.index)?;
        if text.is_empty() || text.eq_ignore_ascii_case("nan") {
            return None;
        }
        let number = if self.has_decimal_comma { text.replace(',', ".").parse() } else { text.parse() };
        // A cell with invalid text is an error, not a missing value.
        Some(number.unwrap_or(f64::NAN) * column.unit_size.unwrap_or(1.0))
    }

    pub fn required_number(&self, column: &str) -> Result<f64, InvalidCell> {
        self.optional_number(column)?.ok_or_else(|| self.invalid_cell(column))
    }

    /// The number of a column if its cell is not empty.
    pub fn optional_number(&self, column: &str) -> Result<Option<f64>, InvalidCell> {
        match self.number(column) {
            Some(number) if !number.is_finite() => Err(self.invalid_cell(column)),
            number => Ok(number),
        }
    }

    fn invalid_cell(&self, column: &str) -> InvalidCell {
        let text = self.columns.get(column).and_then(|column| self.cells.get(column.index));
        (column.to_owned(), text.copied().unwrap_or_default().chars().take(40).collect())
    }

    /// The numbers of three columns; none if all cells are empty, or a column is missing.
    pub fn optional_vector(&self, columns: [&str; 3]) -> Result<Option<[f64; 3]>, InvalidCell> {
        let is_given = columns.iter().any(|column| self.number(column).is_some());
        if !is_given || !columns.iter().all(|column| self.columns.contains_key(*column)) {
            return Ok(None);
        }
        let [x, y, z] = columns.map(|column| self.required_number(column));
        Ok(Some([x?, y?, z?]))
    }
}
