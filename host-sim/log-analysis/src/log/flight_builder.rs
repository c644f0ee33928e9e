//! Builds a [`LoggedFlight`] from a log's messages.

use std::collections::BTreeMap;

use autoswing::earth::Date;
use autoswing::frames::wrap_pi;
use nalgebra::Vector3;

use super::compass_slot::{
    ArdupilotSlots, CompassSlot, DeviceId, MAX_OFFSET_ROUNDING_MG, UnknownSlot, ardupilot_index, ardupilot_vector,
};
use super::correction::{FieldCorrection, InvertibleCorrection};
use super::correction_residual::CorrectionResidual;
use super::flight::{AttitudeView, AutopilotKind, Gps, LogFormat, LoggedCompass, LoggedFlight};
use super::load::{LoadRows, repair_current};
use super::mounting::px4_mounting;
use super::parameters::ParameterHistory;
use super::time_series::{Series, TimedRow};
use super::timeline::Timeline;
use super::vtol_view::{ViewTrims, VtolView};

/// Largest compass number; no autopilot has more.
pub const MAX_COMPASSES: u8 = 8;

/// Largest accepted field component, microtesla: admits nanotesla read as microtesla, which replay reports.
const MAX_FIELD_UT: f32 = 200_000.0;

/// Rank of attitudes that are not the main filter's own.
pub const SECONDARY_ATTITUDE_RANK: u8 = 4;

const MAX_ARMED_CHANGES: usize = 100_000;

#[derive(Default)]
pub struct FlightBuilder {
    pub flight: LoggedFlight,
    pub timeline: Timeline,
    /// Gyro bias of the autopilot's filter, rad/s.
    pub gyro_bias_rad_s: [f32; 3],
    /// Attitudes of other messages by rank, lowest first, in case the autopilot's own is not logged.
    fallback_attitudes: BTreeMap<u8, (&'static str, Series<3>)>,
    /// Rows by compass: field and motor-current compensation, microtesla.
    field_rows: Vec<(u8, FieldProcessing, Series<6>)>,
    /// Headings of GPS receivers with two antennas other than the first, radians from true north.
    other_receiver_yaws: BTreeMap<u8, Series<1>>,
    /// Offsets in use by compass, milligauss.
    offset_rows: BTreeMap<u8, Series<3>>,
    /// Outputs, and currents beside that of the first battery.
    pub loads: LoadRows,
    /// Numbers of the flight modes, at each change or report.
    pub flight_modes: Series<1>,
}

/// Correction and axes of a logged magnetic field.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FieldProcessing {
    /// The logged field is corrected by ArduPilot, in body axes.
    ArduPilot,
    /// The logged field is corrected by PX4 with the parameters of this index, in body axes.
    Px4(u8),
    /// The logged field is uncorrected, in the axes of the PX4 sensor with this index.
    Px4SensorRaw(u8),
    /// The logged field is uncorrected, in body axes.
    BodyRaw,
    /// The logged field is corrected by parameters of an unknown slot, in body axes.
    Unknown(UnknownSlot),
}

impl FlightBuilder {
    pub fn new(format: LogFormat) -> Self {
        Self { flight: LoggedFlight::new(format), ..Self::default() }
    }

    /// Adds a row of a compass, microtesla, with the row's own motor-current compensation.
    pub fn push_field(
        &mut self,
        compass_number: u8,
        field_processing: FieldProcessing,
        t_s: f64,
        field_ut: [f32; 3],
        motor_compensation_ut: Option<[f32; 3]>,
    ) {
        let is_field =
            field_ut.iter().all(|axis| axis.abs() < MAX_FIELD_UT) && field_ut.iter().any(|axis| *axis != 0.0);
        if !is_field || compass_number == 0 || compass_number > MAX_COMPASSES {
            self.flight.skipped_counts.rejected_readings += 1;
            return;
        }
        let ([x, y, z], [mx, my, mz]) = (field_ut, motor_compensation_ut.unwrap_or([f32::NAN; 3]));
        self.compass_rows(compass_number, field_processing).push_row(t_s, [x, y, z, mx, my, mz]);
    }

    /// Adds the offsets that ArduPilot uses for a compass, milligauss.
    pub fn push_offsets(&mut self, compass_number: u8, t_s: f64, offsets_mg: [f32; 3]) {
        if (1..=MAX_COMPASSES).contains(&compass_number) {
            self.offset_rows.entry(compass_number).or_default().push_row(t_s, offsets_mg);
        }
    }

    /// Rows of a compass. A compass whose readings are all rejected is reported as failed.
    pub fn compass_rows(&mut self, compass_number: u8, field_processing: FieldProcessing) -> &mut Series<6> {
        let index = self.field_rows.iter().position(|&(row_number, row_processing, _)| {
            (row_number, row_processing) == (compass_number, field_processing)
        });
        let index = index.unwrap_or_else(|| {
            self.field_rows.push((compass_number, field_processing, Series::new()));
            self.field_rows.len() - 1
        });
        &mut self.field_rows[index].2
    }

    pub fn push_attitude(&mut self, t_s: f64, angles_rad: [f32; 3]) {
        if is_plausible_attitude(angles_rad) {
            self.flight.attitude.push_row(t_s, angles_rad);
        }
    }

    /// Adds an attitude from a message that replaces the autopilot's own if that is not logged; the lowest rank is
    /// preferred.
    pub fn push_fallback_attitude(&mut self, rank: u8, message_name: &'static str, t_s: f64, angles_rad: [f32; 3]) {
        if is_plausible_attitude(angles_rad) {
            self.fallback_attitudes.entry(rank).or_insert((message_name, Series::new())).1.push_row(t_s, angles_rad);
        }
    }

    pub fn push_rates(&mut self, t_s: f64, rates_rad_s: [f32; 3]) {
        if rates_rad_s.iter().all(|rate| rate.abs() < 100.0) {
            self.flight.body_rates.push_row(t_s, rates_rad_s);
        }
    }

    pub fn push_true_attitude(&mut self, t_s: f64, angles_rad: [f32; 3]) {
        if angles_rad.iter().all(|angle| angle.is_finite()) {
            self.flight.true_attitude.push_row(t_s, angles_rad);
        }
    }

    pub fn push_gps(&mut self, t_s: f64, gps: Gps) {
        self.flight.gps.push_row(t_s, gps.columns());
    }

    /// Adds a heading of a receiver other than the first, degrees from true north; NaN if it has none.
    pub fn push_other_receiver_yaw(&mut self, receiver: u8, t_s: f64, yaw_deg: f32) {
        if yaw_deg.is_finite() {
            self.other_receiver_yaws.entry(receiver).or_default().push_row(t_s, [yaw_deg.to_radians()]);
        }
    }

    pub fn push_current(&mut self, t_s: f64, amperes: f32) {
        if amperes.abs() < 10_000.0 {
            self.flight.battery_current.push_row(t_s, [amperes]);
        }
    }

    /// Adds a change of the arming state.
    pub fn push_armed(&mut self, t_s: f64, is_armed: bool) {
        let is_change = self.flight.armed_changes.last().is_none_or(|&(_, last)| last != is_armed);
        if is_change && self.flight.armed_changes.len() < MAX_ARMED_CHANGES {
            self.flight.armed_changes.push((t_s, is_armed));
        }
    }

    /// Adds an arming state that is reported regularly: before the first report it was the same.
    pub fn push_armed_report(&mut self, t_s: f64, is_armed: bool) {
        let is_first = self.flight.armed_changes.is_empty();
        self.push_armed(if is_first { f64::NEG_INFINITY } else { t_s }, is_armed);
    }

    pub fn set_parameter(&mut self, name: &str, value: f64) {
        self.flight.parameters.set_value(self.timeline.newest_s(), name, value);
    }

    /// Keeps the autopilot's first different texts about its compasses.
    pub fn record_text(&mut self, t_s: f64, text: &str) {
        const MAX_TEXTS: usize = 5;
        const SUBJECTS: [&str; 3] = ["compass", "mag anomaly", "magnetometer"];
        let lower = text.to_ascii_lowercase();
        let texts = &mut self.flight.compass_texts;
        let is_new = SUBJECTS.iter().any(|subject| lower.contains(subject)) && texts.len() < MAX_TEXTS;
        let text = printable(text);
        if is_new && texts.iter().all(|(_, known)| *known != text) {
            texts.push((t_s, text));
        }
    }

    pub fn set_firmware(&mut self, name: &str) {
        let name = printable(name);
        self.flight.is_copter |= name.contains("Copter");
        if !name.is_empty() {
            self.flight.firmware_name.get_or_insert(name);
        }
    }

    pub fn set_day_from_unix_s(&mut self, seconds: u64) {
        self.flight.flight_date = self.flight.flight_date.or_else(|| Date::from_unix_s(seconds));
    }

    /// Sorts all series and undoes the autopilot's corrections.
    pub fn finish_flight(mut self) -> LoggedFlight {
        let flight = &mut self.flight;
        flight.skipped_counts.bad_times += self.timeline.rejected_stamp_count;
        flight.skipped_counts.restarts = self.timeline.restart_count;
        replace_attitude(flight, std::mem::take(&mut self.fallback_attitudes));
        let attitude_repeats = flight.attitude.sort_and_dedup();
        drop_attitude_spikes(&mut flight.attitude);
        self.flight_modes.sort_and_dedup();
        undo_vtol_view(flight, &self.flight_modes);
        for series in [&mut flight.body_rates, &mut flight.true_attitude] {
            series.sort_and_dedup();
        }
        flight.gps.sort_and_dedup();
        fill_in_yaws(&mut flight.gps, std::mem::take(&mut self.other_receiver_yaws));
        flight.battery_current.sort_and_dedup();
        repair_current_of_flight(flight);
        flight.loads = std::mem::take(&mut self.loads).into_loads();
        flight.reference_heading.sort_and_dedup();
        flight.row_usability.sort_and_dedup();
        flight.skipped_counts.repeated_times += attitude_repeats as u64;
        if (flight.skipped_counts.rejected_readings == 0 || flight.rows_without_time > 0)
            && self.field_rows.iter().all(|(_, _, field)| field.rows().is_empty())
        {
            self.field_rows.clear();
        }
        let residuals = correction_residuals(flight, &self.field_rows);
        let sources = select_field_source(std::mem::take(&mut self.field_rows));
        let compass_count = sources.len();
        for (compass_number, field_processing, mut field) in sources {
            flight.skipped_counts.repeated_times += field.sort_and_dedup() as u64;
            let mut offsets = self.offset_rows.remove(&compass_number).unwrap_or_default();
            offsets.sort_and_dedup();
            let (slot, device_id) =
                slot_and_device_id(flight, compass_number, field_processing, compass_count, offsets.rows());
            if let Some(index) = slot.ok().filter(|_| field_processing == FieldProcessing::ArduPilot) {
                update_offset_parameters(&mut flight.parameters, index, offsets.rows());
            }
            let (correction, field) = undo_correction(flight, slot, field_processing, field);
            let is_used_for_heading = is_used_for_heading(flight, compass_number, slot);
            flight.compasses.push(LoggedCompass {
                compass_number,
                slot,
                device_id,
                field,
                correction,
                correction_residual: residuals.get(&compass_number).copied(),
                is_used_for_heading,
            });
        }
        self.flight
    }
}

/// Drops rows that differ by 20 deg from the rows before and after, which agree: damage, since no aircraft turns there and
/// back between two rows.
fn drop_attitude_spikes(attitude: &mut Series<3>) {
    const MIN_SPIKE_RAD: f32 = 0.35;
    const MAX_INTERVAL_S: f64 = 1.0;
    let is_spike = |rows: &[TimedRow<3>]| {
        let [before, row, after] = rows else { return false };
        let is_angle_spike = |angle: usize| {
            let [a, b, c] = [before, row, after].map(|row| row.row_values[angle]);
            let least_rad = wrap_pi(b - a).abs().min(wrap_pi(b - c).abs());
            least_rad > MIN_SPIKE_RAD && wrap_pi(c - a).abs() < least_rad / 3.0
        };
        after.t_s - before.t_s < MAX_INTERVAL_S && (0..3).any(is_angle_spike)
    };
    let spikes: Vec<bool> = attitude.rows().windows(3).map(is_spike).collect();
    attitude.retain_rows(|index, _| index.checked_sub(1).and_then(|first| spikes.get(first)) != Some(&true));
}

/// Repairs the battery current. Fields during a drop-out are not used, since their interference is unknown; a table's own
/// choice of rows has priority.
fn repair_current_of_flight(flight: &mut LoggedFlight) {
    let repair = repair_current(&mut flight.battery_current);
    flight.is_current_negated = repair.is_negated;
    flight.skipped_counts.current_dropouts = repair.dropout_count;
    if flight.row_usability.is_empty() {
        for [from_s, to_s] in repair.dropout_intervals_s {
            flight.row_usability.push_row(from_s, [0.0]);
            flight.row_usability.push_row(to_s, [1.0]);
        }
    }
}

/// Replaces a missing attitude, and a view of VTOL modes that may differ from the body.
fn replace_attitude(flight: &mut LoggedFlight, mut fallback_attitudes: BTreeMap<u8, (&'static str, Series<3>)>) {
    let view = VtolView::of_log(&flight.parameters, flight.log_format == LogFormat::TLog);
    let is_missing = flight.attitude.is_empty();
    match (fallback_attitudes.pop_first(), view) {
        (Some((_, (message_name, attitude))), _) if is_missing => {
            (flight.attitude, flight.fallback_attitude_message) = (attitude, Some(message_name));
        }
        (Some((rank, (message_name, attitude))), Some(_)) if rank < SECONDARY_ATTITUDE_RANK => {
            (flight.attitude, flight.attitude_view) = (attitude, AttitudeView::BodyForVtol(message_name));
        }
        (_, Some(view)) if !is_missing => flight.attitude_view = AttitudeView::Vtol(view),
        _ => {}
    }
}

/// Replaces a view of VTOL modes by the attitude of the body, if modes and trims show it.
fn undo_vtol_view(flight: &mut LoggedFlight, flight_modes: &Series<1>) {
    let is_telemetry = flight.log_format == LogFormat::TLog;
    if matches!(flight.attitude_view, AttitudeView::Vtol(_))
        && let Some(trims) = ViewTrims::of_log(&flight.parameters, is_telemetry)
        && let Some(attitude) = trims.body_attitude(&flight.attitude, flight_modes)
    {
        (flight.attitude, flight.attitude_view) = (attitude, AttitudeView::BodyByModes);
    }
}

/// Selects one source for each compass: the uncorrected one, unless the corrected one has more than twice its rows (PX4
/// logs uncorrected fields at 1 Hz by default), or four times if its correction is unknown.
fn select_field_source(mut logged: Vec<(u8, FieldProcessing, Series<6>)>) -> Vec<(u8, FieldProcessing, Series<6>)> {
    let weight = |field_processing: FieldProcessing, field: &Series<6>| {
        let source_weight = match field_processing {
            FieldProcessing::Px4SensorRaw(_) => 4,
            FieldProcessing::Unknown(_) => 1,
            _ => 2,
        };
        field.rows().len() * source_weight
    };
    logged.sort_by_key(|(compass_number, field_processing, field)| {
        (*compass_number, std::cmp::Reverse(weight(*field_processing, field)))
    });
    logged.dedup_by_key(|(compass_number, _, _)| *compass_number);
    logged
}

/// Compares the raw with the corrected fields of PX4's compasses, by number, since the last change of their parameters.
fn correction_residuals(
    flight: &LoggedFlight,
    logged: &[(u8, FieldProcessing, Series<6>)],
) -> BTreeMap<u8, CorrectionResidual> {
    let from_s = flight.parameters.change_times_s("CAL_MAG").last().copied().unwrap_or(f64::NEG_INFINITY);
    let residual = |(compass_number, processing, field): &(u8, FieldProcessing, Series<6>)| {
        let &FieldProcessing::Px4SensorRaw(index) = processing else { return None };
        let (_, _, corrected) = logged.iter().find(|(_, other, _)| *other == FieldProcessing::Px4(index))?;
        let mut corrected = corrected.clone();
        corrected.sort_and_dedup();
        let mounting = px4_mounting(&flight.parameters, f64::INFINITY, index);
        let body_row = |row: &TimedRow<6>| {
            let [x, y, z, ..] = row.row_values.map(f64::from);
            (row.t_s, (mounting * Vector3::new(x, y, z)).map(|axis| axis as f32).into())
        };
        let raw = field.rows().iter().map(body_row).collect();
        let correction = FieldCorrection::from_px4(&flight.parameters, index);
        let residual = CorrectionResidual::new(&raw, &corrected, &correction, &flight.battery_current, from_s)?;
        Some((*compass_number, residual))
    };
    logged.iter().filter_map(residual).collect()
}

/// Gives the rows of the first receiver, which has the position, the headings of others: moving baseline gives them to
/// the receiver of the second antenna.
fn fill_in_yaws(gps: &mut Series<6>, yaws: BTreeMap<u8, Series<1>>) {
    /// Longest interval of headings that is interpolated, seconds.
    const MAX_GAP_S: f64 = 0.5;
    for mut yaw in yaws.into_values() {
        yaw.sort_and_dedup();
        for row in gps.rows_mut().iter_mut().filter(|row| row.row_values[5].is_nan()) {
            if let Some([yaw_rad]) = yaw.interpolate_angles(row.t_s, MAX_GAP_S) {
                row.row_values[5] = yaw_rad.to_degrees().rem_euclid(360.0);
            }
        }
    }
}

fn is_plausible_attitude([roll_rad, pitch_rad, _]: [f32; 3]) -> bool {
    roll_rad.abs() <= 7.0 && pitch_rad.abs() <= 1.6
}

/// Parameter slot of a compass and the id of its sensor.
fn slot_and_device_id(
    flight: &LoggedFlight,
    compass_number: u8,
    field_processing: FieldProcessing,
    compass_count: usize,
    offsets: &[TimedRow<3>],
) -> (CompassSlot, Option<DeviceId>) {
    match field_processing {
        FieldProcessing::ArduPilot => {
            let slots = ArdupilotSlots {
                parameters: &flight.parameters,
                has_all_parameters: flight.log_format != LogFormat::TLog,
                firmware_name: flight.firmware_name.as_deref(),
                compass_count,
            };
            let slot = slots.slot(compass_number, offsets.first().map(|row| (row.t_s, row.row_values)));
            (slot, slots.device_id(compass_number, slot))
        }
        FieldProcessing::Px4(index) | FieldProcessing::Px4SensorRaw(index) => {
            let id = flight.parameters.last_value(&format!("CAL_MAG{index}_ID")).and_then(DeviceId::from_parameter);
            (Ok(index), id)
        }
        FieldProcessing::BodyRaw => (Ok(compass_number), None),
        FieldProcessing::Unknown(reason) => (Err(reason), None),
    }
}

/// Sets the offset parameters of a slot from the offsets in use: offsets learnt in flight (`COMPASS_LEARN`) or
/// calibrated on the ground appear in no PARM. Rows are truncated to whole milligauss, so a PARM that agrees is
/// preferred.
fn update_offset_parameters(parameters: &mut ParameterHistory, slot: u8, offsets: &[TimedRow<3>]) {
    let names = ardupilot_vector("OFS", slot);
    for row in offsets {
        for (name, offset_mg) in names.iter().zip(row.row_values.map(f64::from)) {
            if (parameters.value_at(row.t_s, name).unwrap_or(0.0) - offset_mg).abs() > MAX_OFFSET_ROUNDING_MG {
                parameters.insert_value(row.t_s, name, offset_mg);
            }
        }
    }
}

/// Raw and corrected field of each row, and the autopilot's last correction. Without a known correction the raw field is
/// the logged one.
fn undo_correction(
    flight: &LoggedFlight,
    slot: CompassSlot,
    field_processing: FieldProcessing,
    mut field: Series<6>,
) -> (Option<FieldCorrection>, Series<6>) {
    let parameters = &flight.parameters;
    let is_known = !matches!(field_processing, FieldProcessing::BodyRaw | FieldProcessing::Unknown(_));
    let Some(slot) = slot.ok().filter(|_| is_known) else {
        for row in field.rows_mut() {
            let [x, y, z, ..] = row.row_values;
            row.row_values = [x, y, z, x, y, z];
        }
        return (None, field);
    };
    let correction_at = |t_s: f64| match field_processing {
        FieldProcessing::ArduPilot => InvertibleCorrection::from_ardupilot_parameters(parameters, t_s, slot),
        _ => InvertibleCorrection::from_px4_parameters(parameters, t_s, slot),
    };
    let mounting = if let FieldProcessing::Px4SensorRaw(index) = field_processing {
        Some(px4_mounting(parameters, f64::INFINITY, index))
    } else {
        None
    };
    let prefix = if field_processing == FieldProcessing::ArduPilot { "COMPASS_" } else { "CAL_MAG" };
    let changes_s = parameters.change_times_s(prefix);
    let mut changes = changes_s.iter().peekable();
    let mut undo = correction_at(f64::NEG_INFINITY);
    for row in field.rows_mut() {
        while changes.next_if(|&&at_s| at_s <= row.t_s).is_some() {
            undo = correction_at(row.t_s);
        }
        let [x, y, z, mx, my, mz] = row.row_values.map(f64::from);
        let (logged, logged_motor) = (Vector3::new(x, y, z), Vector3::new(mx, my, mz));
        let current_a =
            flight.battery_current.interpolate_or_hold(row.t_s, 2.0).map_or(0.0, |[amperes]| f64::from(amperes));
        let (raw, corrected) = if let Some(body_from_sensor) = mounting {
            let raw = body_from_sensor * logged;
            (raw, undo.correction.correct_field(raw, current_a))
        } else {
            let motor = if mx.is_nan() { undo.motor_compensation_ut(current_a) } else { logged_motor };
            (undo.raw_ut(logged, motor), logged)
        };
        row.row_values = [raw.x, raw.y, raw.z, corrected.x, corrected.y, corrected.z].map(|component| component as f32);
    }
    let last = correction_at(f64::INFINITY);
    ((!parameters.is_empty()).then_some(last.correction), field)
}

/// At most 80 characters of a text of the log, without control characters.
fn printable(text: &str) -> String {
    text.chars().filter(|character| !character.is_control()).take(80).collect()
}

/// Whether the autopilot uses a compass for its heading. PX4 selects the healthy compass of highest priority, which no
/// parameter shows; priority 0 excludes it. ArduPilot's `COMPASS_USEn` are by priority, as the number of the compass.
fn is_used_for_heading(flight: &LoggedFlight, compass_number: u8, slot: CompassSlot) -> Option<bool> {
    let value = |name: String| flight.parameters.last_value(&name);
    match flight.autopilot {
        AutopilotKind::ArduPilot => {
            value(format!("COMPASS_USE{}", ardupilot_index(compass_number))).map(|used| used != 0.0)
        }
        AutopilotKind::Px4 => {
            let priority = value(format!("CAL_MAG{}_PRIO", slot.ok()?));
            priority.filter(|priority| *priority == 0.0).map(|_| false)
        }
        AutopilotKind::Inav | AutopilotKind::Unknown => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The raw x components of the first compass, microtesla.
    fn raw_x_ut(builder: FlightBuilder) -> Vec<f32> {
        builder.finish_flight().compasses[0].field.rows().iter().map(|row| row.row_values[0]).collect()
    }

    /// A current sensor at rest may read slightly below zero.
    #[test]
    fn only_plausible_currents_are_stored() {
        let mut builder = FlightBuilder::new(LogFormat::TLog);
        for (i, amperes) in [-0.1, 0.0, 5_000.0, 20_000.0, f32::NAN].into_iter().enumerate() {
            builder.push_current(i as f64, amperes);
        }
        let currents: Vec<f32> =
            builder.finish_flight().battery_current.rows().iter().map(|row| row.row_values[0]).collect();
        assert_eq!(currents, [0.0, 5_000.0]);
    }

    /// A current of 20 A that reads 0 from 0.2 to 0.7 s.
    #[test]
    fn fields_during_a_dropout_of_the_current_are_not_used() {
        let mut builder = FlightBuilder::new(LogFormat::DataFlash);
        for i in 0..10 {
            builder.push_current(f64::from(i) / 10.0, if (2..=7).contains(&i) { 0.0 } else { 20.0 });
        }
        let flight = builder.finish_flight();
        let usability: Vec<(f64, f32)> =
            flight.row_usability.rows().iter().map(|row| (row.t_s, row.row_values[0])).collect();
        assert_eq!(usability, [(0.1, 0.0), (0.8, 1.0)]);
        assert_eq!((flight.skipped_counts.current_dropouts, flight.battery_current.rows().len()), (6, 4));
    }

    /// Motor compensation of 10 A at 5 mG/A, by a current at 1 Hz of which one report may be lost.
    #[test]
    fn the_last_current_is_used_for_two_seconds() {
        let mut builder = FlightBuilder::new(LogFormat::TLog);
        builder.flight.autopilot = AutopilotKind::ArduPilot;
        for (name, value) in [("COMPASS_MOTCT", 2.0), ("COMPASS_MOT_X", 5.0)] {
            builder.set_parameter(name, value);
        }
        builder.push_current(0.0, 10.0);
        for t_s in [1.0, 1.9, 3.0, 100.0] {
            builder.push_field(1, FieldProcessing::ArduPilot, t_s, [20.0, 0.0, 40.0], None);
        }
        assert_eq!(raw_x_ut(builder), [15.0, 15.0, 20.0, 20.0]);
    }

    /// A field of 300 mT, compass 9, pitch beyond 90 deg and rates of 100 rad/s are invalid.
    #[test]
    fn implausible_values_are_skipped() {
        let mut builder = FlightBuilder::new(LogFormat::TLog);
        for (compass_number, field_ut) in
            [(1, 100_000.0), (1, 300_000.0), (1, f32::NAN), (1, 0.0), (0, 50.0), (8, 50.0), (9, 50.0)]
        {
            builder.push_field(compass_number, FieldProcessing::BodyRaw, 1.0, [field_ut, 0.0, 0.0], None);
        }
        for (i, angle) in [1.5, 1.7, f32::NAN].into_iter().enumerate() {
            builder.push_attitude(i as f64, [0.0, angle, 0.0]);
            builder.push_rates(i as f64, [0.0, 0.0, angle * 60.0]);
        }
        let flight = builder.finish_flight();
        assert_eq!(flight.compasses.iter().map(|compass| compass.compass_number).collect::<Vec<_>>(), [1, 8]);
        assert_eq!((flight.compasses[0].field.rows().len(), flight.skipped_counts.rejected_readings), (1, 5));
        assert_eq!((flight.attitude.rows().len(), flight.body_rates.rows().len()), (1, 1));
    }

    /// Roll of one row in a turn and in a roll, and the yaw of rows that pass north.
    #[test]
    fn a_damaged_attitude_costs_one_row() {
        for (angles_deg, kept) in [
            ([[10.0, 0.0, 5.0], [95.0, 0.0, 10.0], [12.0, 0.0, 15.0], [14.0, 0.0, 20.0]], 3),
            ([[0.0, 0.0, 5.0], [40.0, 0.0, 5.0], [80.0, 0.0, 5.0], [120.0, 0.0, 5.0]], 4),
            ([[0.0, 0.0, 355.0], [0.0, 0.0, 2.0], [0.0, 0.0, 356.0], [0.0, 0.0, 3.0]], 4),
        ] {
            let mut builder = FlightBuilder::new(LogFormat::ULog);
            for (i, angles_deg) in angles_deg.into_iter().enumerate() {
                builder.push_attitude(i as f64 / 10.0, angles_deg.map(f32::to_radians));
            }
            assert_eq!(builder.finish_flight().attitude.rows().len(), kept, "{angles_deg:?}");
        }
    }

    #[test]
    fn only_the_autopilots_correction_is_undone() {
        for (processing, motor_ut, expected_x_ut) in [
            (FieldProcessing::BodyRaw, None, 20.0),
            (FieldProcessing::ArduPilot, None, 10.0),
            (FieldProcessing::ArduPilot, Some([3.0, 0.0, -1.0]), 7.0),
        ] {
            let mut builder = FlightBuilder::new(LogFormat::DataFlash);
            builder.set_parameter("COMPASS_OFS_X", 100.0);
            builder.push_field(1, processing, 1.0, [20.0, 0.0, 40.0], motor_ut);
            let flight = builder.finish_flight();
            let compass = &flight.compasses[0];
            assert_eq!(compass.correction.is_some(), processing == FieldProcessing::ArduPilot, "{processing:?}");
            let expected_ut = [expected_x_ut, 0.0, 40.0 - motor_ut.map_or(0.0, |motor_ut: [f32; 3]| motor_ut[2])];
            assert_eq!(compass.field.rows()[0].row_values[..3], expected_ut, "{processing:?}");
        }
    }

    #[test]
    fn a_changed_parameter_applies_from_its_time_on() {
        let mut builder = FlightBuilder::new(LogFormat::DataFlash);
        builder.set_parameter("COMPASS_OFS_X", 100.0);
        for (time_us, offset) in [(1_000_000, None), (2_000_000, Some(50.0)), (3_000_000, None), (4_000_000, Some(0.0))]
        {
            let t_s = builder.timeline.flight_time_s(time_us).unwrap();
            if let Some(offset) = offset {
                builder.set_parameter("COMPASS_OFS_X", offset);
            }
            builder.push_field(1, FieldProcessing::ArduPilot, t_s, [20.0, 0.0, 40.0], None);
        }
        assert_eq!(raw_x_ut(builder), [10.0, 15.0, 15.0, 20.0]);
    }
}
