//! Messages of a flight, by name, whatever their encoding.

use crate::log::flight::{AutopilotKind, Gps, LogFormat};
use crate::log::flight_builder::{FieldProcessing, FlightBuilder, MAX_COMPASSES, SECONDARY_ATTITUDE_RANK};
use crate::log::load::LoadSource;
use crate::numbers::UT_PER_MILLIGAUSS;

/// A message with named columns, scaled to degrees and m/s by their format letters.
pub(in crate::log) trait LogMessage {
    fn numeric_field(&self, name: &str) -> Option<f64>;
    fn has_column(&self, name: &str) -> bool;
    fn is_plain_integer(&self, name: &str) -> bool;
    fn text_field(&self, name: &str) -> Option<String>;
}

/// Names of the messages that are read.
pub(in crate::log) const MESSAGES_TO_READ: [&str; 27] = [
    "MAG", "MAG2", "MAG3", "ATT", "IMU", "GPS", "BAT", "CURR", "XKF1", "NKF1", "XKQ", "XKQ1", "NKQ", "NKQ1", "AHR2",
    "XKF4", "NKF4", "PARM", "MSG", "ARM", "EV", "SIM", "VER", "RCOU", "ESC", "CTUN", "MODE",
];

pub(in crate::log) fn ardupilot_builder(format: LogFormat) -> FlightBuilder {
    let mut builder = FlightBuilder::new(format);
    builder.flight.autopilot = AutopilotKind::ArduPilot;
    builder
}

/// Reads a message; `None` if it lacks its time, or a value that it should have.
pub(in crate::log) fn record_message(builder: &mut FlightBuilder, name: &str, message: &dyn LogMessage) -> Option<()> {
    if name == "PARM" {
        builder.set_parameter(&message.text_field("Name")?, message.numeric_field("Value")?);
        return Some(());
    }
    let t_s = match message_time_us(name, message) {
        Some(us) => builder.timeline.flight_time_s(us),
        None => time_of_unstamped_message_s(builder, name, message),
    }?;
    let is_first = |column: &str| message.numeric_field(column).unwrap_or(0.0) == 0.0;
    match name {
        "MAG" => {
            let compass_number = message.numeric_field("I").map_or(1, |instance| (instance as u8).saturating_add(1));
            record_field(builder, t_s, message, compass_number)?;
        }
        "MAG2" => record_field(builder, t_s, message, 2)?,
        "MAG3" => record_field(builder, t_s, message, 3)?,
        "ATT" => builder.push_attitude(t_s, angles_rad(message)?),
        "IMU" if is_first("I") => {
            let rates = numeric_fields(message, ["GyrX", "GyrY", "GyrZ"])?;
            let bias = builder.gyro_bias_rad_s;
            builder.push_rates(t_s, std::array::from_fn(|axis| rates[axis] as f32 - bias[axis]));
        }
        // Gyro bias of the autopilot's filter, deg/s.
        "XKF1" | "NKF1" if is_first("C") => {
            push_fallback_attitude(builder, name, t_s, message);
            let bias = numeric_fields(message, ["GX", "GY", "GZ"])?;
            if bias.iter().all(|axis| axis.abs() < 10.0) {
                builder.gyro_bias_rad_s = bias.map(|axis| axis.to_radians() as f32);
            }
        }
        "XKQ" | "XKQ1" | "NKQ" | "NKQ1" | "AHR2" if is_first("C") => {
            push_fallback_attitude(builder, name, t_s, message);
        }
        "XKF4" | "NKF4" if is_first("C") => {
            builder.flight.magnetometer_test_ratio.push_row(t_s, [message.numeric_field("SM")? as f32]);
        }
        "GPS" if is_first("I") => record_gps(builder, t_s, message)?,
        "GPS" if has_3d_fix(message) => {
            let receiver = message.numeric_field("I")? as u8;
            builder.push_other_receiver_yaw(receiver, t_s, gps_yaw_deg(message));
        }
        "BAT" => match instance(message) {
            0 => record_current(builder, t_s, message)?,
            battery => record_load(builder, t_s, LoadSource::Battery(battery.saturating_add(1)), message, "Curr")?,
        },
        "ESC" => record_load(builder, t_s, LoadSource::Esc(instance(message).saturating_add(1)), message, "Curr")?,
        "CTUN" => record_load(builder, t_s, LoadSource::Throttle, message, "ThO")?,
        "RCOU" => {
            let pulses_us = OUTPUT_COLUMNS.map(|column| message.numeric_field(column).map(|pulse_us| pulse_us as f32));
            builder.loads.push_values(LoadSource::Output, t_s, pulses_us);
        }
        "CURR" => record_current(builder, t_s, message)?,
        "ARM" => builder.push_armed(t_s, message.numeric_field("ArmState")? != 0.0),
        // Event ids of LogEvent: armed (10), auto-armed (15); disarmed (11).
        "EV" => match message.numeric_field("Id")? as u8 {
            10 | 15 => builder.push_armed(t_s, true),
            11 => builder.push_armed(t_s, false),
            _ => {}
        },
        "MODE" => {
            let mode = message.numeric_field("ModeNum").or_else(|| message.numeric_field("Mode"))?;
            builder.flight_modes.push_row(t_s, [mode as f32]);
        }
        "SIM" => record_true_attitude(builder, t_s, message)?,
        "VER" => builder.set_firmware(&message.text_field("FWS").unwrap_or_default()),
        "MSG" => {
            let text = message.text_field("Message").unwrap_or_default();
            if ["Ardu", "APM", "Rover", "Blimp", "Antenna"].iter().any(|prefix| text.starts_with(prefix)) {
                builder.set_firmware(&text);
            }
            builder.record_text(t_s, &text);
        }
        _ => {}
    }
    Some(())
}

/// Time of a message without a stamp (common until 2014): the newest stamp, seconds. Of several rows at one stamp the
/// first is kept.
fn time_of_unstamped_message_s(builder: &mut FlightBuilder, name: &str, message: &dyn LogMessage) -> Option<f64> {
    let is_damaged = ["TimeUS", "TimeMS"].iter().any(|column| name != "GPS" && message.has_column(column));
    if is_damaged {
        return None;
    }
    builder.flight.rows_without_time += u64::from(matches!(name, "MAG" | "MAG2"));
    let is_once = matches!(name, "MSG" | "EV");
    let is_row = matches!(name, "MAG" | "MAG2" | "ATT" | "IMU" | "GPS" | "CURR");
    (is_once || is_row && builder.timeline.has_accepted_stamp()).then(|| builder.timeline.newest_s())
}

/// Roll, pitch and yaw, radians, from columns in degrees; yaw is NaN if absent.
fn angles_rad(message: &dyn LogMessage) -> Option<[f32; 3]> {
    let [roll, pitch] = numeric_fields(message, ["Roll", "Pitch"])?;
    let yaw = message.numeric_field("Yaw").unwrap_or(f64::NAN);
    Some([roll, pitch, yaw].map(|deg| deg.to_radians() as f32))
}

/// Adds the attitude of the filter's first core, or of AHR2, used if `ATT` is not logged (`LOG_BITMASK`). Quaternions
/// rank after angles, since the board's trim is not removed from them.
fn push_fallback_attitude(builder: &mut FlightBuilder, name: &str, t_s: f64, message: &dyn LogMessage) {
    let (rank, from) = match name {
        "XKF1" => (0, "XKF1"),
        "NKF1" => (1, "NKF1"),
        "XKQ" | "XKQ1" => (2, "XKQ"),
        "NKQ" | "NKQ1" => (3, "NKQ"),
        _ => (SECONDARY_ATTITUDE_RANK, "AHR2"),
    };
    let of_quaternion = || {
        numeric_fields(message, ["Q1", "Q2", "Q3", "Q4"])
            .map(|quaternion| quaternion_to_euler_rad(quaternion).map(|angle| angle as f32))
    };
    if let Some(angles_rad) = angles_rad(message).or_else(of_quaternion) {
        builder.push_fallback_attitude(rank, from, t_s, angles_rad);
    }
}

fn message_time_us(name: &str, message: &dyn LogMessage) -> Option<u64> {
    let scaled_column = |column: &str, scale: f64| {
        let time_us = message.numeric_field(column)? * scale;
        (time_us >= 0.0).then_some(time_us as u64)
    };
    // In old GPS messages TimeMS is the time of week, and T the autopilot's clock.
    let time_ms = if name == "GPS" { scaled_column("T", 1e3) } else { scaled_column("TimeMS", 1e3) };
    scaled_column("TimeUS", 1.0).or(time_ms)
}

fn numeric_fields<const N: usize>(message: &dyn LogMessage, names: [&str; N]) -> Option<[f64; N]> {
    let mut values = [0.0; N];
    for (value, name) in values.iter_mut().zip(names) {
        *value = message.numeric_field(name).filter(|value| value.is_finite())?;
    }
    Some(values)
}

/// Adds a field row in milligauss.
fn record_field(builder: &mut FlightBuilder, t_s: f64, message: &dyn LogMessage, compass_number: u8) -> Option<()> {
    let field = numeric_fields(message, ["MagX", "MagY", "MagZ"])?;
    // ArduPilot logs existing compasses only.
    if (1..=MAX_COMPASSES).contains(&compass_number) {
        builder.compass_rows(compass_number, FieldProcessing::ArduPilot);
    }
    if message.numeric_field("Health") == Some(0.0) {
        builder.flight.skipped_counts.rejected_readings += 1;
        return None;
    }
    let motor =
        numeric_fields(message, ["MOX", "MOY", "MOZ"]).or_else(|| numeric_fields(message, ["MOfsX", "MOfsY", "MOfsZ"]));
    let microtesla = |milligauss: [f64; 3]| milligauss.map(|axis| (axis * UT_PER_MILLIGAUSS) as f32);
    if let Some(offsets_mg) = numeric_fields(message, ["OfsX", "OfsY", "OfsZ"]) {
        builder.push_offsets(compass_number, t_s, offsets_mg.map(|axis| axis as f32));
    }
    builder.push_field(compass_number, FieldProcessing::ArduPilot, t_s, microtesla(field), motor.map(microtesla));
    Some(())
}

fn has_3d_fix(message: &dyn LogMessage) -> bool {
    const FIX_3D: f64 = 3.0;
    message.numeric_field("Status").is_some_and(|status| status >= FIX_3D)
}

/// Heading of a receiver with two antennas, degrees; NaN if it has none, logged as 0.
fn gps_yaw_deg(message: &dyn LogMessage) -> f32 {
    message.numeric_field("Yaw").filter(|yaw| *yaw != 0.0).map_or(f32::NAN, |yaw| yaw as f32)
}

fn record_gps(builder: &mut FlightBuilder, t_s: f64, message: &dyn LogMessage) -> Option<()> {
    /// 1980-01-06 in Unix time; leap seconds (less than a minute) are ignored.
    const GPS_EPOCH_UNIX_S: f64 = 315_964_800.0;
    if !has_3d_fix(message) {
        return None;
    }
    let yaw_deg = gps_yaw_deg(message);
    let [latitude_deg, longitude_deg, height_m, speed_m_s, course_deg] =
        numeric_fields(message, ["Lat", "Lng", "Alt", "Spd", "GCrs"])?.map(|number| number as f32);
    builder.push_gps(t_s, Gps { latitude_deg, longitude_deg, height_m, speed_m_s, course_deg, yaw_deg });
    let week = message.numeric_field("GWk").or_else(|| message.numeric_field("Week")).filter(|week| *week > 0.0)?;
    let time_of_week_ms = message.numeric_field("GMS").unwrap_or(0.0);
    builder.set_day_from_unix_s((GPS_EPOCH_UNIX_S + week * 604_800.0 + time_of_week_ms / 1e3) as u64);
    Some(())
}

/// Columns of the first outputs in RCOU.
const OUTPUT_COLUMNS: [&str; 14] =
    ["C1", "C2", "C3", "C4", "C5", "C6", "C7", "C8", "C9", "C10", "C11", "C12", "C13", "C14"];

/// Number of a battery or a speed controller, from 0.
fn instance(message: &dyn LogMessage) -> u8 {
    message.numeric_field("Inst").or_else(|| message.numeric_field("Instance")).unwrap_or(0.0) as u8
}

fn record_load(
    builder: &mut FlightBuilder,
    t_s: f64,
    source: LoadSource,
    message: &dyn LogMessage,
    column: &str,
) -> Option<()> {
    builder.loads.push_value(source, t_s, message.numeric_field(column)? as f32);
    Some(())
}

/// Adds a current; CURR has integer hundredths of an ampere.
fn record_current(builder: &mut FlightBuilder, t_s: f64, message: &dyn LogMessage) -> Option<()> {
    let logged = message.numeric_field("Curr")?;
    let amperes = if message.is_plain_integer("Curr") { logged * 0.01 } else { logged };
    builder.push_current(t_s, amperes as f32);
    Some(())
}

/// Adds the simulator's attitude, by quaternion if logged, since the angles are rounded to 0.01 deg.
fn record_true_attitude(builder: &mut FlightBuilder, t_s: f64, message: &dyn LogMessage) -> Option<()> {
    let angles = numeric_fields(message, ["Q1", "Q2", "Q3", "Q4"]).map(quaternion_to_euler_rad);
    let logged = || numeric_fields(message, ["Roll", "Pitch", "Yaw"]).map(|angles| angles.map(f64::to_radians));
    builder.push_true_attitude(t_s, angles.or_else(logged)?.map(|angle| angle as f32));
    Some(())
}

/// Roll, pitch and yaw of a quaternion w, x, y, z from body axes to north, east, down.
pub(in crate::log) fn quaternion_to_euler_rad([w, x, y, z]: [f64; 4]) -> [f64; 3] {
    let roll = libm::atan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y));
    let pitch = libm::asin((2.0 * (w * y - z * x)).clamp(-1.0, 1.0));
    let yaw = libm::atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z));
    [roll, pitch, yaw]
}
