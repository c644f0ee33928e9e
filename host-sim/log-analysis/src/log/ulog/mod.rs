//! Reader for PX4's ULog (docs.px4.io, "ULog File Format").

mod row_layout;
mod sensors;

use std::collections::HashMap;
use std::io::{self, Read};
use std::rc::Rc;

pub use row_layout::topic_of_file;
use row_layout::{
    READ_TOPICS, RowColumn, RowColumns, TopicRow, columns_of_header, parse_keyed_value, row_of_line, scalar_type,
};
use sensors::CompassAssignment;

use super::compass_slot::UnknownSlot;
use super::dataflash::quaternion_to_euler_rad;
use super::flight::{AutopilotKind, Gps, LogFormat, LoggedFlight};
use super::flight_builder::{FieldProcessing, FlightBuilder};
use super::load::LoadSource;
use super::read_window::{MAX_PEEK_BYTES, ReadWindow};
use super::time_series::Series;
use super::timeline::Timeline;
use crate::numbers::UT_PER_GAUSS;

/// Start of a log; version and time follow.
pub const ULOG_MAGIC: [u8; 7] = *b"ULog\x01\x12\x35";
const FILE_HEADER_LENGTH: usize = 16;
const HEADER_LENGTH: usize = 3;

/// First letters of the messages of a ULog.
const MESSAGE_TYPES: &[u8] = b"BFIMPQARDLCSO";

/// Largest number of message formats, to bound memory.
const MAX_FORMATS: usize = 4096;
const MAX_FORMAT_NESTING: u8 = 6;

/// `vehicle_status.arming_state` of an armed aircraft.
const ARMED_STATE: u8 = 2;

/// Lengths of the arrays of `esc_status`, `actuator_motors` and `actuator_outputs`.
const MAX_PX4_ESCS: usize = 8;
const MAX_PX4_MOTORS: usize = 12;
const MAX_PX4_OUTPUTS: usize = 16;

/// Reads a flight.
pub fn read_ulog(source: &mut dyn Read) -> io::Result<LoggedFlight> {
    let mut window = ReadWindow::new(source);
    window.peek_bytes(FILE_HEADER_LENGTH)?;
    window.consume_bytes(FILE_HEADER_LENGTH);
    let mut log = UlogReader::new();
    let mut is_lost = false;
    while let &[low, high, kind, ..] = window.peek_bytes(HEADER_LENGTH)? {
        let message_end = HEADER_LENGTH + usize::from(u16::from_le_bytes([low, high]));
        debug_assert!(message_end + HEADER_LENGTH <= MAX_PEEK_BYTES);
        if is_lost && !is_header_sequence(window.peek_bytes(RESYNC_MESSAGES * (HEADER_LENGTH + MAX_RESYNC_LENGTH))?) {
            log.builder.flight.skipped_counts.garbage += 1;
            window.consume_bytes(1);
            continue;
        }
        // A valid message is followed by another or by the end.
        let bytes = window.peek_bytes(message_end + HEADER_LENGTH)?;
        let is_followed = bytes.get(message_end + HEADER_LENGTH - 1).is_none_or(|next| MESSAGE_TYPES.contains(next));
        let body = bytes.get(HEADER_LENGTH..message_end).filter(|_| MESSAGE_TYPES.contains(&kind) && is_followed);
        let length = if let Some(body) = body {
            log.read_message(kind, body);
            is_lost = false;
            message_end
        } else {
            is_lost = true;
            log.builder.flight.skipped_counts.garbage += 1;
            1
        };
        window.consume_bytes(length);
    }
    Ok(log.finish_flight())
}

/// Whether the log has its definitions among the first bytes, although their start is damaged.
pub fn has_definitions(first_bytes: &[u8]) -> bool {
    const COLUMN: &[u8] = b"uint64_t timestamp;";
    first_bytes.windows(COLUMN.len()).any(|window| window == COLUMN)
}

/// Whether these are messages without definitions.
pub fn is_without_start(first_bytes: &[u8]) -> bool {
    const SEARCHED_BYTES: usize = 4096;
    let sequences = first_bytes.windows(RESYNC_MESSAGES * (HEADER_LENGTH + MAX_RESYNC_LENGTH));
    sequences.take(SEARCHED_BYTES).any(is_header_sequence)
}

/// Number of messages that must follow one another before reading resumes after damage: one byte in twenty of noise
/// looks like a message header, with a mean length of 32 KB.
const RESYNC_MESSAGES: usize = 3;
/// Largest length of each of these messages, bytes.
const MAX_RESYNC_LENGTH: usize = 1024;

/// Whether a sequence of valid message headers, or the end, follows.
fn is_header_sequence(bytes: &[u8]) -> bool {
    let mut remaining = bytes;
    (0..RESYNC_MESSAGES).all(|_| match *remaining {
        [low, high, kind, ref after @ ..] => {
            let length = usize::from(u16::from_le_bytes([low, high]));
            remaining = after.get(length..).unwrap_or_default();
            MESSAGE_TYPES.contains(&kind) && length <= MAX_RESYNC_LENGTH
        }
        _ => true,
    })
}

struct UlogTopic {
    name: String,
    instance: u8,
    columns: RowColumns,
}

/// Flight that is read from the messages of a log, or from a table of each topic.
#[derive(Default)]
pub struct UlogReader {
    builder: FlightBuilder,
    formats: HashMap<String, String>,
    topics: HashMap<u16, Rc<UlogTopic>>,
    /// Major and minor version of PX4. `sensor_mag` is raw since 1.11; before, drivers corrected it.
    px4_version: Option<(u8, u8)>,
    has_angular_velocity: bool,
    /// Field, gauss, and body rates of `sensor_combined`, used for logs up to 1.8 only.
    sensor_combined: (Series<3>, Series<3>),
    compass_assignment: CompassAssignment,
    /// Whether the log is the tables of its topics, which lack the parameters.
    is_of_tables: bool,
}

impl UlogReader {
    pub fn new() -> Self {
        let mut builder = FlightBuilder::new(LogFormat::ULog);
        builder.flight.autopilot = AutopilotKind::Px4;
        Self { builder, ..Self::default() }
    }

    /// Reads the table of a topic.
    pub fn read_table(&mut self, topic: &str, instance: u8, source: &mut dyn Read) -> io::Result<()> {
        let mut window = ReadWindow::new(source);
        let Some(header) = window.next_line()? else { return Ok(()) };
        let separator = header.chars().nth("timestamp".len()).unwrap_or(',');
        let columns = columns_of_header(&header, separator);
        self.is_of_tables = true;
        self.builder.timeline = Timeline::default();
        while let Some(line) = window.next_line()? {
            self.record_row(
                topic,
                instance,
                &TopicRow { columns: &columns, row_bytes: &row_of_line(&line, separator) },
            );
        }
        Ok(())
    }

    fn read_message(&mut self, message_type: u8, body: &[u8]) {
        match message_type {
            b'F' => {
                let text = String::from_utf8_lossy(body);
                if let Some((name, columns)) = text.split_once(':').filter(|_| self.formats.len() < MAX_FORMATS) {
                    self.formats.insert(name.to_owned(), columns.to_owned());
                }
            }
            b'A' => self.read_subscription(body),
            b'D' => self.read_row(body),
            b'I' => self.read_information(body),
            b'P' => {
                if let Some((type_name, name, value)) = parse_keyed_value(body)
                    && let Some(value) = scalar_type(type_name).and_then(|scalar_type| scalar_type.decode_number(value))
                {
                    self.builder.set_parameter(name, value);
                }
            }
            _ => {}
        }
    }

    fn read_information(&mut self, body: &[u8]) {
        let Some((_, name, value)) = parse_keyed_value(body) else { return };
        match (name, value) {
            ("ver_sw_release", &[_, patch, minor, major]) => {
                self.px4_version = Some((major, minor));
                self.builder.set_firmware(&format!("PX4 {major}.{minor}.{patch}"));
            }
            ("sys_name", name) if !name.starts_with(b"PX4") => {
                self.builder.set_firmware(&String::from_utf8_lossy(name));
            }
            _ => {}
        }
    }

    fn read_subscription(&mut self, body: &[u8]) {
        let [instance, low, high, name @ ..] = body else { return };
        let name = String::from_utf8_lossy(name).into_owned();
        let mut columns = RowColumns::new();
        let mut byte_offset = 0;
        if READ_TOPICS.contains(&name.as_str())
            && self.compute_columns(&name, "", &mut byte_offset, 0, &mut columns).is_some()
        {
            self.has_angular_velocity |= name == "vehicle_angular_velocity";
            let topic = UlogTopic { name, instance: *instance, columns };
            self.topics.insert(u16::from_le_bytes([*low, *high]), Rc::new(topic));
        }
    }

    /// Computes the columns of a format, with nested formats by `prefix`; none if invalid.
    fn compute_columns(
        &self,
        name: &str,
        prefix: &str,
        byte_offset: &mut usize,
        depth: u8,
        columns: &mut RowColumns,
    ) -> Option<()> {
        if depth > MAX_FORMAT_NESTING {
            return None;
        }
        for declared in self.formats.get(name)?.split(';').filter(|declared| !declared.is_empty()) {
            let (type_name, column) = declared.split_once(' ')?;
            let (type_name, array_length) = match type_name.split_once('[') {
                Some((type_name, array_length)) => (type_name, array_length.strip_suffix(']')?.parse::<usize>().ok()?),
                None => (type_name, 1),
            };
            if array_length > MAX_PEEK_BYTES || *byte_offset > MAX_PEEK_BYTES || columns.len() > 1024 {
                return None;
            }
            if let Some(scalar_type) = scalar_type(type_name) {
                columns.insert(
                    format!("{prefix}{column}"),
                    RowColumn { scalar_type, byte_offset: *byte_offset, array_len: array_length },
                );
                *byte_offset += scalar_type.byte_len() * array_length;
            } else {
                for i in 0..array_length.min(64) {
                    self.compute_columns(
                        type_name,
                        &format!("{prefix}{column}[{i}]."),
                        byte_offset,
                        depth + 1,
                        columns,
                    )?;
                }
            }
        }
        Some(())
    }

    fn read_row(&mut self, body: &[u8]) {
        let [low, high, body @ ..] = body else { return };
        let Some(topic) = self.topics.get(&u16::from_le_bytes([*low, *high])).cloned() else { return };
        self.record_row(&topic.name, topic.instance, &TopicRow { columns: &topic.columns, row_bytes: body });
    }

    /// Reads a row; `None` if it lacks its time, or a value that it should have.
    fn record_row(&mut self, topic: &str, instance: u8, row: &TopicRow<'_>) -> Option<()> {
        let timestamp_us = row.numeric_value("timestamp").filter(|us| *us >= 0.0)?;
        let t_s = self.builder.timeline.flight_time_s(timestamp_us as u64)?;
        // The sampling time precedes the publishing time.
        let sampled_s = row.numeric_value("timestamp_sample").filter(|sample| *sample > 0.0 && *sample <= timestamp_us);
        let sampled_s = sampled_s.map_or(t_s, |sample| t_s - ((timestamp_us - sample) / 1e6).min(1.0));
        let device_id = || row.numeric_value("device_id").unwrap_or(0.0) as u32;
        let builder = &mut self.builder;
        match topic {
            "sensor_mag" if self.px4_version.is_some_and(|version| version >= (1, 11)) => {
                self.record_field(true, instance, device_id(), sampled_s, row.vector_value(["x", "y", "z"])?);
            }
            "vehicle_magnetometer" => {
                self.record_field(false, instance, device_id(), sampled_s, row.array_values("magnetometer_ga")?);
            }
            "battery_status" => {
                let amperes = row.numeric_value("current_a")? as f32;
                if instance == 0 {
                    builder.push_current(t_s, amperes);
                } else {
                    let battery = LoadSource::Battery(instance.saturating_add(1));
                    builder.loads.push_value(battery, t_s, amperes);
                }
            }
            "vehicle_status" => {
                builder.flight.is_copter |= is_copter(row);
                builder.push_armed_report(t_s, row.numeric_value("arming_state")? as u8 == ARMED_STATE);
            }
            "vehicle_attitude_groundtruth" => builder.push_true_attitude(t_s, angles_rad(row)?),
            // The first instance of other topics.
            _ if instance > 0 => {}
            "vehicle_attitude" => {
                if let Some(angles_rad) = angles_rad(row) {
                    builder.push_attitude(sampled_s, angles_rad);
                }
                if !self.has_angular_velocity {
                    builder.push_rates(sampled_s, row.vector_value(["rollspeed", "pitchspeed", "yawspeed"])?);
                }
            }
            "estimator_attitude" => {
                builder.push_fallback_attitude(0, "estimator_attitude", sampled_s, angles_rad(row)?);
            }
            "estimator_innovation_test_ratios" => {
                let largest = row.array_values::<3>("mag_field")?.into_iter().fold(f32::NAN, f32::max);
                builder.flight.magnetometer_test_ratio.push_row(t_s, [largest]);
            }
            "estimator_status" => {
                let ratio = row.numeric_value("mag_test_ratio")? as f32;
                builder.flight.magnetometer_test_ratio.push_row(t_s, [ratio]);
            }
            "vehicle_angular_velocity" => builder.push_rates(sampled_s, row.array_values("xyz")?),
            "sensor_combined" => {
                if let Some(rates) = row.array_values("gyro_rad") {
                    self.sensor_combined.1.push_row(t_s, rates);
                }
                // The field's time is relative to the row's; an unchanged field repeats its time.
                let relative_us = row
                    .numeric_value("magnetometer_timestamp_relative")
                    .filter(|relative_us| relative_us.abs() < 1e6)?;
                self.sensor_combined.0.push_row(t_s + relative_us / 1e6, row.array_values("magnetometer_ga")?);
            }
            "vehicle_gps_position" => record_gps(builder, t_s, row)?,
            "esc_status" => {
                let current = |esc: usize| row.numeric_value(&format!("esc[{esc}].esc_current"));
                let currents_a = (0..MAX_PX4_ESCS).map(|esc| current(esc).map(|amperes| amperes as f32));
                builder.loads.push_values(LoadSource::Esc, t_s, currents_a);
            }
            "actuator_motors" => {
                let commands = row.array_values::<MAX_PX4_MOTORS>("control")?;
                builder.loads.push_values(LoadSource::Motor, t_s, commands.map(Some));
            }
            "actuator_outputs" => {
                let outputs = row.array_values::<MAX_PX4_OUTPUTS>("output")?;
                builder.loads.push_values(LoadSource::Output, t_s, outputs.map(Some));
            }
            _ => {}
        }
        Some(())
    }

    /// Adds a field in gauss.
    fn record_field(&mut self, is_raw: bool, instance: u8, device_id: u32, t_s: f64, gauss: [f32; 3]) {
        let Some(index) = self.compass_assignment.compass_index(&self.builder.flight.parameters, instance, device_id)
        else {
            return;
        };
        let processing = match is_raw {
            _ if self.is_of_tables => FieldProcessing::Unknown(UnknownSlot::NotInTables),
            true => FieldProcessing::Px4SensorRaw(index),
            false => FieldProcessing::Px4(index),
        };
        self.builder.push_field(index + 1, processing, t_s, gauss.map(|axis| axis * UT_PER_GAUSS as f32), None);
    }

    pub fn finish_flight(mut self) -> LoggedFlight {
        let (fields, rates) = std::mem::take(&mut self.sensor_combined);
        if self.compass_assignment.is_empty() {
            for row in fields.rows() {
                self.record_field(false, 0, 0, row.t_s, row.row_values);
            }
        }
        if self.builder.flight.body_rates.is_empty() {
            for row in rates.rows() {
                self.builder.push_rates(row.t_s, row.row_values);
            }
        }
        self.builder.finish_flight()
    }
}

/// Roll, pitch and yaw of the row's quaternion, radians.
fn angles_rad(row: &TopicRow<'_>) -> Option<[f32; 3]> {
    let quaternion = row.array_values("q")?;
    Some(quaternion_to_euler_rad(quaternion.map(f64::from)).map(|angle| angle as f32))
}

/// Whether a `vehicle_status` is a rotorcraft's. A VTOL in hover reports rotary wing too.
fn is_copter(row: &TopicRow<'_>) -> bool {
    const ROTARY_WING: f64 = 1.0;
    let flag = |name: &str| row.numeric_value(name).is_some_and(|number| number != 0.0);
    let rotors = row
        .numeric_value("vehicle_type")
        .map_or_else(|| flag("is_rotary_wing"), |vehicle_type| (vehicle_type - ROTARY_WING).abs() < 0.5);
    rotors && !flag("is_vtol")
}

/// Speed over ground, m/s, and course, radians, from the velocity if logged.
fn speed_and_course(row: &TopicRow<'_>) -> [f64; 2] {
    match (row.numeric_value("vel_n_m_s"), row.numeric_value("vel_e_m_s")) {
        (Some(north), Some(east)) => [libm::hypot(north, east), libm::atan2(east, north)],
        _ => ["vel_m_s", "cog_rad"].map(|name| row.numeric_value(name).unwrap_or(f64::NAN)),
    }
}

fn record_gps(builder: &mut FlightBuilder, t_s: f64, row: &TopicRow<'_>) -> Option<()> {
    row.numeric_value("fix_type").filter(|fix| *fix >= 3.0)?;
    let degrees =
        |old: &str, new: &str| row.numeric_value(old).map(|number| number * 1e-7).or_else(|| row.numeric_value(new));
    let latitude_deg = degrees("lat", "latitude_deg")? as f32;
    let longitude_deg = degrees("lon", "longitude_deg")? as f32;
    let height_m =
        row.numeric_value("alt").map(|mm| mm / 1e3).or_else(|| row.numeric_value("altitude_msl_m")).unwrap_or(0.0)
            as f32;
    let [speed_m_s, course_rad] = speed_and_course(row);
    let (speed_m_s, course_deg) = (speed_m_s as f32, course_rad.to_degrees() as f32);
    let yaw_deg = row.numeric_value("heading").unwrap_or(f64::NAN).to_degrees() as f32;
    builder.push_gps(t_s, Gps { latitude_deg, longitude_deg, height_m, speed_m_s, course_deg, yaw_deg });
    builder.set_day_from_unix_s((row.numeric_value("time_utc_usec").unwrap_or(0.0) / 1e6) as u64);
    Some(())
}
