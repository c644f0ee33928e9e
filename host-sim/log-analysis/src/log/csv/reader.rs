//! Reader that turns the rows of a table into a flight.

use autoswing::inertial::{AttitudeFilter, InertialSample, InertialSensorErrors, SensorOffsets};
use autoswing::time::Timestamp;

use super::super::flight::{Gps, LogFormat, LoggedFlight};
use super::super::flight_builder::{FieldProcessing, FlightBuilder};
use super::super::time_series::Series;
use super::super::timeline::Timeline;
use super::columns::FieldUnit;
use super::error::{CsvError, ScaleMonitor, time_problem};
use super::table_layout::{FORCE_COLUMNS, InvalidCell, RATE_COLUMNS, TableLayout};

/// Clock value assigned to the median time of the first lines, microseconds; large, so that earlier lines have positive
/// values.
const MEDIAN_LINE_CLOCK_US: f64 = 1e13;

/// Largest difference of a line's time from the median time of the first lines, seconds; the times of other lines count
/// as bad.
const MAX_TIME_FROM_MEDIAN_S: f64 = 1e6;

/// Flight that is read from a table, or from one of each sensor.
pub struct TableReader {
    builder: FlightBuilder,
    rates: Series<3>,
    forces: Series<3>,
    armed_states: Series<1>,
    /// Median time of the first lines, seconds (possibly Unix time); rows with times far from it are rejected.
    median_time_s: f64,
    /// Whether the lines are not in order of time; then a step back is no restart of the clock.
    is_unordered: bool,
    first_invalid_cell: Option<(u64, String, String)>,
    time_problem: Option<CsvError>,
    scale_monitor: ScaleMonitor,
}

impl TableReader {
    /// A reader before its first table.
    pub fn new() -> Self {
        Self {
            builder: FlightBuilder::new(LogFormat::Csv),
            rates: Series::of_inertial_sensor(),
            forces: Series::of_inertial_sensor(),
            armed_states: Series::new(),
            median_time_s: 0.0,
            is_unordered: false,
            first_invalid_cell: None,
            time_problem: None,
            scale_monitor: ScaleMonitor::default(),
        }
    }

    /// Examines the first lines of a table. They are unordered if one step in ten goes back by more than 3 s (the disorder of
    /// a clock), or two in three go back at all.
    pub(super) fn begin_table(&mut self, table: &TableLayout, first_lines: &[(u64, String)]) {
        const MAX_REORDERING_S: f64 = 3.0;
        let mut times_s: Vec<f64> =
            first_lines.iter().filter_map(|(_, line)| table.split_line(line).required_number("t_s").ok()).collect();
        let steps =
            |is_counted: &dyn Fn(f64) -> bool| times_s.windows(2).filter(|pair| is_counted(pair[1] - pair[0])).count();
        let [back, far_back] = [steps(&|step_s| step_s < 0.0), steps(&|step_s| step_s < -MAX_REORDERING_S)];
        self.is_unordered = far_back * 10 > times_s.len() || back * 3 > times_s.len() * 2;
        times_s.sort_by(f64::total_cmp);
        self.median_time_s = times_s.get(times_s.len() / 2).copied().unwrap_or(0.0);
        self.builder.timeline = Timeline::default();
        // Positions may be rare.
        if !table.compasses.is_empty() {
            self.time_problem = self.time_problem.take().or_else(|| time_problem(&times_s));
        }
    }

    pub(super) fn record_line(&mut self, table: &TableLayout, unit: FieldUnit, line_number: u64, line: &str) {
        if let Err((column, found)) = self.read_line(table, unit, line) {
            self.builder.flight.skipped_counts.garbage += 1;
            self.first_invalid_cell.get_or_insert((line_number, column, found));
        }
    }

    fn read_line(&mut self, table: &TableLayout, unit: FieldUnit, line: &str) -> Result<(), InvalidCell> {
        let cells = table.split_line(line);
        table.reject_extra_cells(&cells)?;
        let t_s = cells.required_number("t_s")?;
        let attitude_deg = if table.has_attitude {
            Some([cells.required_number("roll_deg")?, cells.required_number("pitch_deg")?])
        } else {
            None
        };
        let mut fields = Vec::new();
        for (compass_number, axes) in &table.compasses {
            let is_required = *compass_number == 1 && attitude_deg.is_some();
            if is_required || axes.iter().all(|axis| cells.number(axis).is_some()) {
                let [x, y, z] = axes.each_ref().map(|axis| cells.required_number(axis));
                let field = [x?, y?, z?];
                if *compass_number == 1 {
                    self.scale_monitor.add_row(attitude_deg.unwrap_or_default(), field);
                }
                let microtesla_per_unit = axes.each_ref().map(|axis| table.microtesla_per_unit(axis, unit));
                let field_ut = std::array::from_fn(|axis| (field[axis] * microtesla_per_unit[axis]) as f32);
                fields.push((*compass_number, field_ut));
            }
        }
        let usable = cells.optional_number("use")?;
        let reference = cells.optional_number("yaw_ref_deg")?;
        let yaw = cells.optional_number("yaw_deg")?;
        let rates_dps = cells.optional_vector(RATE_COLUMNS)?;
        let force_m_s2 = cells.optional_vector(FORCE_COLUMNS)?;
        let Some(t_s) = self.row_time_s(t_s) else { return Ok(()) };
        if let Some(rates_dps) = rates_dps {
            self.rates.push_row(t_s, rates_dps.map(|dps| dps.to_radians() as f32));
        }
        if let Some(force_m_s2) = force_m_s2 {
            self.forces.push_row(t_s, force_m_s2.map(|axis| axis as f32));
        }
        if let Ok(Some(armed)) = cells.optional_number("armed") {
            self.armed_states.push_row(t_s, [f32::from(armed != 0.0)]);
        }
        let builder = &mut self.builder;
        for (compass_number, field_ut) in fields {
            builder.push_field(compass_number, FieldProcessing::BodyRaw, t_s, field_ut, None);
        }
        if let Some([roll_deg, pitch_deg]) = attitude_deg {
            let angles = [roll_deg, pitch_deg, yaw.unwrap_or(f64::NAN)];
            builder.push_attitude(t_s, angles.map(|deg| deg.to_radians() as f32));
        }
        let flight = &mut builder.flight;
        if let Some(reference) = reference {
            flight.reference_heading.push_row(t_s, [reference.to_radians() as f32]);
        }
        if let Some(usable) = usable {
            flight.row_usability.push_row(t_s, [f32::from(usable != 0.0)]);
        }
        if let Ok(Some(amperes)) = cells.optional_number("current_a") {
            builder.push_current(t_s, amperes as f32);
        }
        if let (Some(latitude), Some(longitude)) = (cells.number("lat_deg"), cells.number("lon_deg")) {
            let height_m = cells.number("height_m").unwrap_or(0.0) as f32;
            let [latitude_deg, longitude_deg] = [latitude, longitude].map(|deg| deg as f32);
            let [speed_m_s, course_deg] =
                ["speed_m_s", "course_deg"].map(|column| cells.number(column).map_or(f32::NAN, |value| value as f32));
            let yaw_deg = f32::NAN;
            builder.push_gps(t_s, Gps { latitude_deg, longitude_deg, height_m, speed_m_s, course_deg, yaw_deg });
        }
        Ok(())
    }

    /// Time of a row, seconds: as in the table until its clock restarts.
    fn row_time_s(&mut self, t_s: f64) -> Option<f64> {
        let since_s = t_s - self.median_time_s;
        if since_s.abs() >= MAX_TIME_FROM_MEDIAN_S {
            self.builder.flight.skipped_counts.bad_times += 1;
            None
        } else if self.is_unordered {
            Some(t_s)
        } else {
            let placed_s = self.builder.timeline.flight_time_s((since_s * 1e6 + MEDIAN_LINE_CLOCK_US).round() as u64)?;
            Some(placed_s - MEDIAN_LINE_CLOCK_US * 1e-6 + self.median_time_s)
        }
    }

    /// The flight of all tables.
    pub fn finish_flight(mut self) -> Result<LoggedFlight, CsvError> {
        let scale_problem = self.time_problem.take().or_else(|| self.scale_monitor.problem(self.is_unordered));
        if let Some(problem) = scale_problem {
            return Err(problem);
        }
        self.rates.sort_and_dedup();
        self.forces.sort_and_dedup();
        for (t_s, rates_rad_s) in rates_at_rows(&self.rates) {
            self.builder.push_rates(t_s, rates_rad_s);
        }
        if self.builder.flight.attitude.is_empty() {
            for (t_s, [roll_rad, pitch_rad]) in inertial_attitudes(&self.rates, &self.forces) {
                self.builder.push_attitude(t_s, [roll_rad, pitch_rad, f32::NAN]);
            }
        }
        self.armed_states.sort_and_dedup();
        for row in self.armed_states.rows() {
            self.builder.push_armed_report(row.t_s, row.row_values[0] != 0.0);
        }
        let flight = self.builder.finish_flight();
        // Rejected readings count as rows; the caller reports them.
        let is_empty =
            flight.compasses.is_empty() && flight.body_rates.is_empty() && flight.skipped_counts.rejected_readings == 0;
        if is_empty { Err(CsvError::NoRows(self.first_invalid_cell)) } else { Ok(flight) }
    }
}

/// Interval between rows, in median steps, that counts as a gap: a mean rate over it does not represent its ends.
const MAX_GAP_IN_MEDIAN_STEPS: f64 = 3.0;

/// Converts means over the preceding interval to rates at the rows: the average of the means before and after, which
/// has no lag. At a gap only the mean of the side without the gap is used, if there is one.
pub(super) fn rates_at_rows(mean_rates: &Series<3>) -> Vec<(f64, [f32; 3])> {
    let Some(step_s) = mean_rates.median_step_s() else {
        return mean_rates.rows().iter().map(|row| (row.t_s, row.row_values)).collect();
    };
    let rows = mean_rates.rows();
    let is_gap = |later: usize| rows[later].t_s - rows[later - 1].t_s > MAX_GAP_IN_MEDIAN_STEPS * step_s;
    (0..rows.len())
        .map(|i| {
            let before = rows[i].row_values;
            let after = rows.get(i + 1).filter(|_| !is_gap(i + 1)).map(|next| next.row_values);
            let is_after_gap = i == 0 || is_gap(i);
            let rate = match after {
                Some(after) if is_after_gap => after,
                Some(after) => std::array::from_fn(|axis| before[axis].midpoint(after[axis])),
                None => before,
            };
            (rows[i].t_s, rate)
        })
        .collect()
}

/// Longest interval of the accelerometer that is interpolated, seconds: that of the filter.
const MAX_GAP_S: f64 = 0.1;

/// Largest standard deviation of an attitude that is used, radians: 5 deg, at which the field's inclination scatters as
/// much as by a bad compass.
const MAX_TILT_SIGMA_RAD: f32 = 0.087;

/// Time, roll and pitch of each row of the gyro (rad/s) with a force of the accelerometer (m/s^2), body axes.
pub(super) fn inertial_attitudes<'a>(
    rates: &'a Series<3>,
    forces: &'a Series<3>,
) -> impl Iterator<Item = (f64, [f32; 2])> + 'a {
    let start_s = rates.rows().first().map_or(0.0, |row| row.t_s);
    let mut filter = AttitudeFilter::new(InertialSensorErrors::CALIBRATED, SensorOffsets::UNKNOWN);
    rates.rows().iter().filter_map(move |row| {
        let force = forces.interpolate_or_hold(row.t_s, MAX_GAP_S)?;
        let at = Timestamp::from_us(((row.t_s - start_s) * 1e6) as u64);
        let sample = InertialSample { rates_rad_s: row.row_values.into(), specific_force_m_s2: force.into() };
        filter.update(at, &sample, None);
        let estimate = filter.attitude().filter(|estimate| estimate.tilt_sigma_rad() < MAX_TILT_SIGMA_RAD)?;
        Some((row.t_s, [estimate.attitude.roll_rad, estimate.attitude.pitch_rad]))
    })
}
