//! Reader for tables: values separated by comma, semicolon or tab, with column names in the first line.
//!
//! | column | unit, axes and sign |
//! |---|---|
//! | `t_s` | seconds |
//! | `mx`, `my`, `mz` | uncorrected field in body axes forward, right, down; milligauss, or microtesla on request |
//! | `mx2`, `my2`, `mz2`, ... | the same of a second compass, up to the eighth |
//! | `roll_deg`, `pitch_deg` | attitude; right wing down and nose up positive |
//! | `use` | optional: 0 excludes a row from fit and score |
//! | `p_dps`, `q_dps`, `r_dps` | optional: body rates, deg/s, each the mean since the row before |
//! | `ax`, `ay`, `az` | specific force, m/s^2, (0, 0, -9.8) level at rest: with body rates in place of roll and pitch |
//! | `yaw_ref_deg` | optional: reference heading, from any north |
//! | `yaw_deg` | optional: the autopilot's own yaw, from true north |
//! | `current_a` | optional: current, amperes |
//! | `lat_deg`, `lon_deg`, `height_m` | optional: position |
//! | `speed_m_s`, `course_deg` | optional, with position: speed and course over ground, from true north |
//! | `armed` | optional: 0 or 1 |
//!
//! A unit in the header applies: `mx (uT)`, `roll [rad]`, `time_ms`. Of the required columns, `time`, `time_s`, `t`, `seconds`, `MagX`, `mag_x`, `roll`, `pitch` are other names. Other
//! columns are ignored, as are lines that begin with `#` and a spreadsheet's `sep=`. Column names are
//! case-insensitive. With semicolon or tab a comma is a decimal point. Empty and `nan` mean unknown. An invalid line is
//! skipped and counted.
//!
//! Lines are parsed by hand in bounded memory: the crate `csv` buffers a record of any length, and real tables have
//! unclosed quotes, decimal commas and truncated lines.

mod columns;
mod error;
mod reader;
mod table_layout;

use std::io::Read;

pub use columns::FieldUnit;
pub(super) use error::CsvError;

use super::flight::LoggedFlight;
use super::read_window::ReadWindow;
use columns::is_comment;
pub(super) use columns::is_sensor_table;
pub(super) use reader::TableReader;
use table_layout::{TableLayout, is_header};

/// Whether the first line that is no comment is the header of a table: it names `t_s`, or half of the required columns.
pub(super) fn is_table(first_bytes: &[u8]) -> bool {
    let first = first_bytes.split(|&byte| byte == b'\n').find(|line| !is_comment(line));
    first.is_some_and(|line| is_header(&String::from_utf8_lossy(line)))
}

/// Reads a flight.
pub(super) fn read_csv(source: impl Read, unit: FieldUnit) -> Result<LoggedFlight, CsvError> {
    let mut table_reader = TableReader::new();
    read_table(&mut table_reader, source, unit, "")?;
    table_reader.finish_flight()
}

/// Reads a table whose log has further tables if it has a name.
pub(super) fn read_table(
    table_reader: &mut TableReader,
    mut source: impl Read,
    unit: FieldUnit,
    file_stem: &str,
) -> Result<(), CsvError> {
    let mut window = ReadWindow::new(&mut source);
    let mut line_number = 0_u64;
    let mut next_line = || {
        while let Some(line) = window.next_line().map_err(|error| CsvError::Unreadable(error.to_string()))? {
            line_number += 1;
            if !is_comment(line.as_bytes()) {
                return Ok(Some((line_number, line)));
            }
        }
        Ok(None)
    };
    let Some((_, header)) = next_line()? else { return Err(CsvError::MissingColumn("t_s".to_owned())) };
    let table = TableLayout::from_header(&header, file_stem)?;
    let mut first_lines = Vec::new();
    while first_lines.len() < MAX_ORDER_CHECK_LINES
        && let Some(line) = next_line()?
    {
        first_lines.push(line);
    }
    table_reader.begin_table(&table, &first_lines);
    for (line_number, line) in first_lines {
        table_reader.record_line(&table, unit, line_number, &line);
    }
    while let Some((line_number, line)) = next_line()? {
        table_reader.record_line(&table, unit, line_number, &line);
    }
    Ok(())
}

/// Lines examined for their order in time.
const MAX_ORDER_CHECK_LINES: usize = 1000;

#[cfg(test)]
mod tests {
    use super::super::time_series::Series;
    use super::reader::rates_at_rows;
    use super::*;

    const VALID_TABLE: &str =
        "t_s,extra,mx,my,mz,roll_deg,pitch_deg,use\n0,9,100,-200,400,10,-2,1\n0.1,9,101,-201,401,11,-3,0\n";

    fn read_text(text: &str) -> Result<LoggedFlight, CsvError> {
        read_csv(text.as_bytes(), FieldUnit::Milligauss)
    }

    fn field_of(text: &str) -> Series<6> {
        read_text(text).unwrap().compasses.remove(0).field
    }

    #[test]
    fn columns_are_found_by_name_and_units_converted() {
        let flight = read_text(VALID_TABLE).unwrap();
        let rows = flight.compasses[0].field.rows();
        assert_eq!(rows.len(), 2);
        assert_eq!(rows[0].row_values.map(f32::to_bits), [10.0_f32, -20.0, 40.0, 10.0, -20.0, 40.0].map(f32::to_bits));
        assert!((flight.attitude.rows()[1].row_values[1].to_degrees() + 3.0).abs() < 1e-5);
        assert_eq!(flight.row_usability.rows().iter().map(|row| row.row_values[0]).collect::<Vec<_>>(), [1.0, 0.0]);
        let flight_in_ut = read_csv(VALID_TABLE.as_bytes(), FieldUnit::Microtesla).unwrap();
        assert_eq!(flight_in_ut.compasses[0].field.rows()[0].row_values[..3], [100.0, -200.0, 400.0]);
    }

    #[test]
    fn semicolons_tabs_decimal_commas_comments_and_ends_of_lines_are_read() {
        for text in [
            VALID_TABLE.replace(',', ";").replace('.', ","),
            VALID_TABLE.replace(',', "\t"),
            format!("# of a boat\n\n{}", VALID_TABLE.replace('\n', "\r\n")),
            VALID_TABLE.replace("t_s", "\u{feff}\"t_s\""),
        ] {
            assert_eq!(field_of(&text), field_of(VALID_TABLE), "{text}");
            assert!(is_table(text.as_bytes()), "{text}");
        }
        assert!(!is_table(b"time,mx\n") && !is_table(b""));
    }

    #[test]
    fn other_names_of_columns_are_known_and_the_missing_one_is_named() {
        let names = ["t_s", "mx", "my", "mz", "roll_deg", "pitch_deg"];
        for alternative_names in [
            ["time", "MagX", "MagY", "MagZ", "Roll", "Pitch"],
            ["time_s", "mag_x", "mag_y", "mag_z", "roll_deg", "pitch_deg"],
        ] {
            let renamed = std::iter::zip(names, alternative_names)
                .fold(VALID_TABLE.to_owned(), |text, (name, alternative_name)| {
                    text.replacen(name, alternative_name, 1)
                });
            let renamed = format!("\u{feff}{renamed}");
            assert!(is_table(renamed.as_bytes()), "{renamed}");
            assert_eq!(field_of(&renamed), field_of(VALID_TABLE));
            let missing = renamed.replacen(alternative_names[4], "bank", 1);
            assert!(is_table(missing.as_bytes()), "{missing}");
            assert_eq!(read_text(&missing).unwrap_err(), CsvError::MissingColumn("roll_deg".to_owned()));
        }
    }

    #[test]
    fn a_yaw_may_be_named_as_that_of_a_log() {
        for (name, yaw_deg) in [("yaw_deg", 90.0), ("yaw_log_deg", 90.0), ("yaw_cdeg", 0.9), ("yaw_old_deg", f32::NAN)]
        {
            let table = format!("t_s,mx,my,mz,roll_deg,pitch_deg,{name}\n0,200,0,400,1,2,90\n0.1,200,0,400,1,2,90\n");
            let found_deg = read_text(&table).unwrap().attitude.rows()[0].row_values[2].to_degrees();
            assert!(
                (found_deg - yaw_deg).abs() < 1e-4 || (found_deg.is_nan() && yaw_deg.is_nan()),
                "{name}: {found_deg}"
            );
        }
    }

    #[test]
    fn a_malformed_line_costs_only_that_line() {
        for malformed_line in [
            "0.2,9,10",
            "0.2,9,1,5,-200,400,10,-2,1",
            "0.2,9,x,-200,400,10,-2,1\n",
            "0.2,9,100,,400,10,-2,1\n",
            "0.2,9,100,inf,400,10,-2,1",
        ] {
            let flight = read_text(&format!("{VALID_TABLE}{malformed_line}")).unwrap();
            let counts = (flight.compasses[0].field.rows().len(), flight.skipped_counts.garbage);
            assert_eq!(counts, (2, 1), "{malformed_line}");
        }
    }

    #[test]
    fn rows_are_sorted_and_duplicate_times_dropped() {
        let text = format!("{VALID_TABLE}0.05,9,100,-200,400,10,-2,1\n0.1,9,0,0,0.1,0,0,1\n");
        let flight = read_text(&text).unwrap();
        let times: Vec<f64> = flight.compasses[0].field.rows().iter().map(|row| row.t_s).collect();
        assert_eq!(times.len(), 3);
        assert!(times.is_sorted() && flight.skipped_counts.repeated_times > 0);
    }

    #[test]
    fn a_parse_error_names_line_and_column() {
        let error = |text: &str| read_text(text).unwrap_err();
        assert_eq!(error("t_s,mx,my,mz,roll_deg\n"), CsvError::MissingColumn("pitch_deg".to_owned()));
        assert_eq!(error("t_s,mx,my,mz,roll_deg,pitch_deg\n"), CsvError::NoRows(None));
        let expected_error = CsvError::NoRows(Some((2, "my".to_owned(), "nan".to_owned())));
        assert_eq!(error("t_s,mx,my,mz,roll_deg,pitch_deg\n1,1,nan,3,4,5\n"), expected_error);
        let decimal_commas = error("t_s,mx,my,mz,roll_deg,pitch_deg\n0,1,1,5,2,3,4,0\n").to_string();
        assert!(
            decimal_commas.contains("line 2, beyond the last column (decimal commas need semicolons"),
            "{decimal_commas}"
        );
        for (rate_columns, missing) in
            [("q_dps,r_dps", "p_dps"), ("p_dps,r_dps", "q_dps"), ("q_dps,p_dps", "r_dps"), ("r_dps", "p_dps")]
        {
            let error = error(&format!("t_s,mx,my,mz,roll_deg,pitch_deg,{rate_columns}\n"));
            assert_eq!(error, CsvError::MissingRateColumn(missing));
            assert!(error.to_string().starts_with(&format!("no column {missing};")), "{error}");
        }
    }

    #[test]
    fn units_in_the_header_apply() {
        let expected = read_text(VALID_TABLE).unwrap();
        let (header, rows) = VALID_TABLE.split_once('\n').unwrap();
        for (name, declared, cells) in [
            ("t_s", "time_ms", &["0,9", "100,9"][..]),
            ("t_s", "t_s [us]", &["0,9", "100000,9"]),
            ("roll_deg", "Roll (cdeg)", &[",1000,", ",1100,"]),
            ("roll_deg", "roll_rad", &[",0.17453293,", ",0.19198622,"]),
            ("mx", "mx (uT)", &[",10,", ",10.1,"]),
            ("mx", "MagX_nT", &[",10000,", ",10100,"]),
        ] {
            let original = match name {
                "t_s" => ["0,9", "0.1,9"],
                "roll_deg" => [",10,", ",11,"],
                _ => [",100,", ",101,"],
            };
            let rows = original.iter().zip(cells).fold(rows.to_owned(), |rows, (old, new)| rows.replacen(old, new, 1));
            let text = format!("{}\n{rows}", header.replacen(name, declared, 1));
            assert!(is_table(text.as_bytes()), "{text}");
            let flight = read_text(&text).unwrap();
            for (row, expected) in flight.compasses[0].field.rows().iter().zip(expected.compasses[0].field.rows()) {
                assert!((row.t_s - expected.t_s).abs() < 1e-9, "{declared}");
                assert!((row.row_values[0] - expected.row_values[0]).abs() < 1e-4, "{declared}");
            }
            let roll_rad = flight.attitude.rows()[1].row_values[0];
            assert!((roll_rad - expected.attitude.rows()[1].row_values[0]).abs() < 1e-6, "{declared}");
        }
        let error = read_text(&VALID_TABLE.replacen("mx", "mx (furlong)", 1)).unwrap_err();
        assert_eq!((error.stable_code(), &*error.to_string()), ("unknown-unit", "mx has no unit \"furlong\""));
    }

    /// Twenty-five rows at 10 Hz that turn, with the numbers of other units.
    #[test]
    fn values_beyond_the_units_of_the_columns_are_named() {
        let table = |row: &dyn Fn(f64) -> [f64; 3]| {
            let rows = (0..25).map(|i| {
                let [t, mx, roll] = row(f64::from(i));
                format!("{t},{mx},20000,30000,{roll},1\n")
            });
            format!("t_s,mx,my,mz,roll_deg,pitch_deg\n{}", rows.collect::<String>())
        };
        let wrapped = |number: f64| (number + 32_768.0).rem_euclid(65_536.0) - 32_768.0;
        for (row, code) in [
            (&(|i| [i / 10.0, 300.0, i]) as &dyn Fn(f64) -> [f64; 3], ""),
            (&|i| [i * 100.0, 300.0, i], "time-unit"),
            (&|i| [i / 10.0, 300.0, i * 100.0], "angle-unit"),
            (&|i| [i / 10.0, wrapped(32_700.0 + 200.0 * libm::sin(i)), i], "field-wraps"),
        ] {
            let error = read_text(&table(row)).err();
            assert_eq!(error.as_ref().map_or("", CsvError::stable_code), code, "{error:?}");
        }
    }

    /// Rates of one axis at the rows of a table with these mean rates.
    fn interpolated_rates(mean_rates: &[(f64, f32)]) -> Vec<f32> {
        let rates = mean_rates.iter().map(|&(t_s, rate)| (t_s, [0.0, rate, -rate])).collect();
        let by_axis = rates_at_rows(&rates).into_iter().map(|(_, rates)| rates);
        by_axis
            .map(|[p, q, r]| {
                assert!(p.abs() < 1e-9 && (r + q).abs() < 1e-9);
                q
            })
            .collect()
    }

    /// A rate of 1 per s² from zero: the mean of each second lags by half a second.
    #[test]
    fn a_mean_rate_is_interpolated_to_the_time_of_its_row() {
        let mean_rates: Vec<_> = (0..5).map(|i| (f64::from(i), i as f32 - 0.5)).collect();
        assert_eq!(interpolated_rates(&mean_rates), [0.5, 1.0, 2.0, 3.0, 3.5]);
    }

    /// Of the steps between rows, 1 s each, one of 2 s is no gap, and one of 5 s is.
    #[test]
    fn rates_are_not_interpolated_across_a_gap() {
        let mean_rates =
            [(0.0, 9.0), (1.0, 2.0), (2.0, 4.0), (4.0, 8.0), (5.0, 2.0), (10.0, 7.0), (11.0, 4.0), (12.0, 6.0)];
        let expected = [2.0, 3.0, 6.0, 5.0, 2.0, 4.0, 5.0, 6.0];
        assert_eq!(interpolated_rates(&mean_rates), expected);
        assert_eq!(interpolated_rates(&[(0.0, 1.0)]), [1.0]);
        assert_eq!(interpolated_rates(&[(0.0, 1.0), (1.0, 3.0), (9.0, 5.0)]).last(), Some(&5.0));
    }
}
