//! Columns of a table and the parser of its lines.

use super::super::flight_builder::MAX_COMPASSES;
use super::columns::{
    FieldUnit, HeaderCell, cell_separator, columns_with_units, find_with_unit, header_cells, trimmed_cell, unit_size,
};
use super::error::CsvError;

pub(super) struct TableLayout {
    cell_separator: char,
    /// Number of columns that the header names.
    column_count: usize,
    pub time_column: usize,
    pub field_columns: Vec<(u8, [usize; 3])>,
    /// Roll and pitch; without them gyro and accelerometer give the attitude.
    pub attitude_columns: Option<[usize; 2]>,
    pub force_columns: Option<[usize; 3]>,
    pub rate_columns: Option<[usize; 3]>,
    pub usable_column: Option<usize>,
    pub reference_column: Option<usize>,
    pub yaw_column: Option<usize>,
    pub current_column: Option<usize>,
    pub position_columns: Option<[usize; 2]>,
    pub height_column: Option<usize>,
    pub speed_and_course_columns: [Option<usize>; 2],
    pub armed_column: Option<usize>,
    /// Sizes of the declared units, by column.
    unit_sizes: Vec<Option<f64>>,
}

/// Required columns with their alternative names.
const ALTERNATIVE_NAMES: [(&str, &[&str]); 6] = [
    ("t_s", &["time", "time_s", "t", "seconds"]),
    ("mx", &["magx", "mag_x"]),
    ("my", &["magy", "mag_y"]),
    ("mz", &["magz", "mag_z"]),
    ("roll_deg", &["roll"]),
    ("pitch_deg", &["pitch"]),
];

/// Number of required column names that a line must contain to be the header of a table.
const MIN_REQUIRED_COLUMNS: usize = 3;

/// Index of the column with this name, or with one of its alternative names.
fn find_column(names: &[&str], name: &str) -> Option<usize> {
    let position = |name: &str| names.iter().position(|column| column.eq_ignore_ascii_case(name));
    let alternative_names = || {
        ALTERNATIVE_NAMES
            .iter()
            .find(|(required_name, _)| *required_name == name)
            .map_or(&[][..], |(_, alternative_names)| *alternative_names)
    };
    position(name).or_else(|| alternative_names().iter().find_map(|alternative_name| position(alternative_name)))
}

pub(super) fn is_header(line: &str) -> bool {
    let cells = header_cells(line, "");
    let names: Vec<&str> = cells.iter().map(|cell| &*cell.name).collect();
    let is_named = |name: &str| find_column(&names, name).is_some() || find_with_unit(&names, name).is_some();
    let named_columns = ALTERNATIVE_NAMES.iter().filter(|(name, _)| is_named(name)).count();
    let has_own_clock = line.split(cell_separator(line)).any(|cell| trimmed_cell(cell).eq_ignore_ascii_case("t_s"));
    named_columns >= MIN_REQUIRED_COLUMNS || has_own_clock
}

/// Name of a column, and the content of its invalid cell.
pub(super) type InvalidCell = (String, String);

impl TableLayout {
    /// Columns by the first line. `file_stem` is the file's name without extension if other files have further columns,
    /// else empty.
    pub fn from_header(header: &str, file_stem: &str) -> Result<Self, CsvError> {
        let cells = header_cells(header, file_stem);
        let names: Vec<&str> = cells.iter().map(|cell| &*cell.name).collect();
        let find =
            |name: &str| find_column(&names, name).or_else(|| find_with_unit(&names, name).map(|(index, _)| index));
        let need = |name: &str| find(name).ok_or_else(|| CsvError::MissingColumn(name.to_owned()));
        let find_all = |[x, y, z]: [&str; 3]| Some([find(x)?, find(y)?, find(z)?]);
        let rate_columns = find_rate_columns(&find)?;
        let force_columns = find_all(["ax", "ay", "az"]);
        let is_whole_log = file_stem.is_empty();
        // Sensor Logger and x-IMU3 have other angles.
        let attitude_columns =
            find("roll_deg").zip(find("pitch_deg")).map(|(roll, pitch)| [roll, pitch]).filter(|_| is_whole_log);
        if is_whole_log {
            need("mx").and(need("my")).and(need("mz"))?;
            if rate_columns.and(force_columns).is_none() {
                need("roll_deg").and(need("pitch_deg"))?;
            }
        }
        let fields = (1..=MAX_COMPASSES).filter_map(|compass_number| {
            let number = if compass_number == 1 { String::new() } else { compass_number.to_string() };
            let [x, y, z] = ["mx", "my", "mz"].map(|axis| find(&format!("{axis}{number}")));
            Some((compass_number, [x?, y?, z?]))
        });
        let position_columns = find("lat_deg").zip(find("lon_deg")).map(|(latitude, longitude)| [latitude, longitude]);
        let unit_sizes = declared_unit_sizes(&cells, &find)?;
        Ok(Self {
            unit_sizes,
            cell_separator: cell_separator(header),
            column_count: names.len(),
            time_column: need("t_s")?,
            field_columns: fields.collect(),
            attitude_columns,
            force_columns,
            rate_columns,
            usable_column: find("use"),
            reference_column: find("yaw_ref_deg"),
            yaw_column: find("yaw_deg").or_else(|| find("yaw_log_deg")),
            current_column: find("current_a"),
            position_columns,
            height_column: find("height_m"),
            speed_and_course_columns: ["speed_m_s", "course_deg"].map(find),
            armed_column: find("armed"),
        })
    }

    /// Rejects lines with more cells than columns, as decimal commas produce in a table separated by commas.
    pub fn reject_extra_cells(&self, cells: &LineCells<'_>) -> Result<(), InvalidCell> {
        let extra = cells.cells.iter().skip(self.column_count).find(|cell| !cell.is_empty());
        let where_found = "beyond the last column (decimal commas need semicolons between columns)";
        extra.map_or(Ok(()), |cell| Err((where_found.to_owned(), cell.chars().take(40).collect())))
    }

    /// Microtesla per unit of a column of the field.
    pub fn microtesla_per_unit(&self, index: usize, unit: FieldUnit) -> f64 {
        let declared = self.unit_sizes.get(index).copied().flatten();
        declared.map_or_else(|| unit.microtesla_per_unit(), |_| 1.0)
    }

    pub fn split_line<'a>(&'a self, line: &'a str) -> LineCells<'a> {
        LineCells {
            unit_sizes: &self.unit_sizes,
            cells: line.split(self.cell_separator).map(trimmed_cell).collect(),
            has_decimal_comma: self.cell_separator != ',',
        }
    }
}

/// Sizes of the units that the header declares for the columns that are read.
fn declared_unit_sizes(
    cells: &[HeaderCell<'_>],
    find: &dyn Fn(&str) -> Option<usize>,
) -> Result<Vec<Option<f64>>, CsvError> {
    let names: Vec<&str> = cells.iter().map(|cell| &*cell.name).collect();
    let mut sizes = vec![None; cells.len()];
    let further =
        (2..=MAX_COMPASSES).flat_map(|compass_number| ["mx", "my", "mz"].map(|axis| format!("{axis}{compass_number}")));
    for column in columns_with_units().map(str::to_owned).chain(further) {
        let Some(index) = find(&column) else { continue };
        sizes[index] = match cells[index].unit {
            Some(unit) => {
                let size =
                    unit_size(&column, unit).map_err(|()| CsvError::UnknownUnit(column.clone(), unit.to_owned()));
                Some(cells[index].sign * size?)
            }
            None if find_column(&names, &column).is_none() => find_with_unit(&names, &column).map(|(_, size)| size),
            None => None,
        };
    }
    Ok(sizes)
}

pub(super) struct LineCells<'a> {
    unit_sizes: &'a [Option<f64>],
    cells: Vec<&'a str>,
    has_decimal_comma: bool,
}

impl LineCells<'_> {
    /// The number in a column; none if empty or `nan`, NaN if invalid.
    pub fn number_in_column(&self, index: usize) -> Option<f64> {
        let text = self.cells.get(index).filter(|text| !text.is_empty() && !text.eq_ignore_ascii_case("nan"))?;
        // A cell with invalid text is an error, not a missing value.
        Some(self.parse_cell(text).unwrap_or(f64::NAN) * self.unit_sizes.get(index).copied().flatten().unwrap_or(1.0))
    }

    fn parse_cell(&self, text: &str) -> Option<f64> {
        if self.has_decimal_comma { text.replace(',', ".").parse().ok() } else { text.parse().ok() }
    }

    /// The numbers of three columns; none if all cells are empty.
    pub fn optional_vector(
        &self,
        columns: Option<[usize; 3]>,
        names: [&str; 3],
    ) -> Result<Option<[f64; 3]>, InvalidCell> {
        let is_given = |columns: &[usize; 3]| columns.iter().any(|&index| self.number_in_column(index).is_some());
        let Some([x, y, z]) = columns.filter(is_given) else { return Ok(None) };
        let number = |index, axis: usize| self.required_number(index, names[axis]);
        Ok(Some([number(x, 0)?, number(y, 1)?, number(z, 2)?]))
    }

    pub fn required_number(&self, index: usize, column: &str) -> Result<f64, InvalidCell> {
        let invalid_cell =
            || (column.to_owned(), self.cells.get(index).copied().unwrap_or_default().chars().take(40).collect());
        self.number_in_column(index).filter(|number| number.is_finite()).ok_or_else(invalid_cell)
    }
}

/// Indices of the rate columns: all three or none.
fn find_rate_columns(find: &dyn Fn(&str) -> Option<usize>) -> Result<Option<[usize; 3]>, CsvError> {
    let names = ["p_dps", "q_dps", "r_dps"];
    let rate_columns = names.map(find);
    if let [Some(p), Some(q), Some(r)] = rate_columns {
        return Ok(Some([p, q, r]));
    }
    let missing = names.iter().zip(rate_columns).find(|(_, index)| index.is_none());
    match missing {
        Some((name, _)) if rate_columns.iter().any(Option::is_some) => Err(CsvError::MissingRateColumn(name)),
        _ => Ok(None),
    }
}
