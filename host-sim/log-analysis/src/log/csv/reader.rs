//! Reader that turns the rows of a table into a flight.

use super::super::flight::{Flight, Gps, LogFormat};
use super::super::flight_builder::{FieldProcessing, FlightBuilder};
use super::super::time_series::Series;
use super::error::CsvError;
use super::field_unit::FieldUnit;
use super::rates::rates_at_rows;
use super::table_layout::{InvalidCell, TableLayout};

/// Clock value assigned to the median time of the first lines, microseconds; large, so that earlier lines have positive
/// values.
const MEDIAN_CLOCK_US: f64 = 1e13;

/// Largest difference of a line's time from the median time of the first lines, seconds; the times of other lines count
/// as bad.
const MAX_TIME_FROM_START_S: f64 = 1e6;

/// Flight that is read from a table.
pub(super) struct TableReader {
    recorder: FlightBuilder,
    rates: Series<3>,
    armed: Series<1>,
    /// Median time of the first lines, seconds. Times may be Unix time.
    median_time_s: f64,
    /// Whether the lines are not in order of time; then a step back is no restart of the clock.
    is_unordered: bool,
    first_invalid: Option<(u64, String, String)>,
}

impl TableReader {
    /// Examines the first lines. They are unordered if one step in ten goes back by more than 3 s (the disorder of a
    /// clock), or two in three go back at all.
    pub fn from_first_lines(table: &TableLayout, first_lines: &[(u64, String)]) -> Self {
        const MAX_REORDERING_S: f64 = 3.0;
        let mut times_s: Vec<f64> = first_lines
            .iter()
            .filter_map(|(_, line)| table.line_values(line).required_number(table.time_column, "t_s").ok())
            .collect();
        let steps = |is: &dyn Fn(f64) -> bool| times_s.windows(2).filter(|pair| is(pair[1] - pair[0])).count();
        let [back, far_back] = [steps(&|step_s| step_s < 0.0), steps(&|step_s| step_s < -MAX_REORDERING_S)];
        let is_unordered = far_back * 10 > times_s.len() || back * 3 > times_s.len() * 2;
        times_s.sort_by(f64::total_cmp);
        let median_time_s = times_s.get(times_s.len() / 2).copied().unwrap_or(0.0);
        let recorder = FlightBuilder::new(LogFormat::Csv);
        Self { recorder, rates: Series::new(), armed: Series::new(), median_time_s, is_unordered, first_invalid: None }
    }

    pub fn record_line(&mut self, table: &TableLayout, unit: FieldUnit, line_number: u64, line: &str) {
        if let Err((column, found)) = self.read_line(table, unit, line) {
            self.recorder.flight.skipped_counts.garbage += 1;
            self.first_invalid.get_or_insert((line_number, column, found));
        }
    }

    fn read_line(&mut self, table: &TableLayout, unit: FieldUnit, line: &str) -> Result<(), InvalidCell> {
        let values = table.line_values(line);
        table.reject_extra_cells(&values)?;
        let t_s = values.required_number(table.time_column, "t_s")?;
        let [roll_deg, pitch_deg] = [
            values.required_number(table.attitude_columns[0], "roll_deg")?,
            values.required_number(table.attitude_columns[1], "pitch_deg")?,
        ];
        let mut fields = Vec::new();
        for &(compass_number, [x, y, z]) in &table.field_columns {
            let given = [x, y, z].map(|index| values.cell_value(index));
            if compass_number == 1 || given.iter().all(Option::is_some) {
                let field = [
                    values.required_number(x, "mx")?,
                    values.required_number(y, "my")?,
                    values.required_number(z, "mz")?,
                ];
                fields.push((compass_number, field.map(|axis| (axis * unit.microtesla_per_unit()) as f32)));
            }
        }
        let optional = |index: Option<usize>, name: &str| match index {
            Some(index) if values.cell_value(index).is_some() => values.required_number(index, name).map(Some),
            _ => Ok(None),
        };
        let usable = optional(table.usable_column, "use")?;
        let reference = optional(table.reference_column, "yaw_ref_deg")?;
        let yaw = optional(table.yaw_column, "yaw_deg")?;
        let read =
            match table.rate_columns.filter(|rates| rates.iter().any(|&index| values.cell_value(index).is_some())) {
                Some([p, q, r]) => Some([
                    values.required_number(p, "p_dps")?,
                    values.required_number(q, "q_dps")?,
                    values.required_number(r, "r_dps")?,
                ]),
                None => None,
            };
        let Some(t_s) = self.row_time(t_s) else { return Ok(()) };
        if let Some(read) = read {
            self.rates.push_row(t_s, read.map(|dps| dps.to_radians() as f32));
        }
        if let Ok(Some(armed)) = optional(table.armed_column, "armed") {
            self.armed.push_row(t_s, [f32::from(armed != 0.0)]);
        }
        let recorder = &mut self.recorder;
        for (compass_number, field_ut) in fields {
            recorder.push_field(compass_number, FieldProcessing::BodyRaw, t_s, field_ut, None);
        }
        let angles = [roll_deg, pitch_deg, yaw.unwrap_or(f64::NAN)];
        recorder.push_attitude(t_s, angles.map(|deg| deg.to_radians() as f32));
        let flight = &mut recorder.flight;
        if let Some(reference) = reference {
            flight.reference_heading.push_row(t_s, [reference.to_radians() as f32]);
        }
        if let Some(usable) = usable {
            flight.usable_rows.push_row(t_s, [f32::from(usable != 0.0)]);
        }
        if let Ok(Some(amperes)) = optional(table.current_column, "current_a") {
            recorder.push_current(t_s, amperes as f32);
        }
        if let Some([latitude, longitude]) =
            table.place_columns.map(|position_columns| position_columns.map(|index| values.cell_value(index)))
            && let (Some(latitude), Some(longitude)) = (latitude, longitude)
        {
            let height_m = table.height_column.and_then(|index| values.cell_value(index)).unwrap_or(0.0) as f32;
            let [latitude_deg, longitude_deg] = [latitude, longitude].map(|deg| deg as f32);
            let known = |index: Option<usize>| {
                index.and_then(|index| values.cell_value(index)).map_or(f32::NAN, |value| value as f32)
            };
            let [speed_m_s, course_deg] = table.over_ground.map(known);
            let yaw_deg = f32::NAN;
            recorder.push_gps(t_s, Gps { latitude_deg, longitude_deg, height_m, speed_m_s, course_deg, yaw_deg });
        }
        Ok(())
    }

    /// Time of a row, seconds: as in the table until its clock restarts.
    fn row_time(&mut self, t_s: f64) -> Option<f64> {
        let since_s = t_s - self.median_time_s;
        if since_s.abs() >= MAX_TIME_FROM_START_S {
            self.recorder.flight.skipped_counts.bad_times += 1;
            None
        } else if self.is_unordered {
            Some(t_s)
        } else {
            let placed_s = self.recorder.timeline.flight_time_s((since_s * 1e6 + MEDIAN_CLOCK_US).round() as u64)?;
            Some(placed_s - MEDIAN_CLOCK_US * 1e-6 + self.median_time_s)
        }
    }

    pub fn finish_flight(mut self) -> Result<Flight, CsvError> {
        self.rates.sort_and_dedup();
        for (t_s, at) in rates_at_rows(&self.rates) {
            self.recorder.push_rates(t_s, at);
        }
        self.armed.sort_and_dedup();
        for row in self.armed.rows() {
            self.recorder.push_armed(row.t_s, row.row_values[0] != 0.0);
        }
        let flight = self.recorder.finish_flight();
        // Rejected readings count as rows; the caller reports them.
        let is_empty = flight.compasses.is_empty() && flight.skipped_counts.unhealthy == 0;
        if is_empty { Err(CsvError::NoRows(self.first_invalid)) } else { Ok(flight) }
    }
}
