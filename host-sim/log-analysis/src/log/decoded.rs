//! Logs that `mavlogdump` of pymavlink has decoded: a message a line, of MAVLink or of DataFlash.
//!
//! | output of | a line |
//! |---|---|
//! | `mavlogdump.py --format json LOG` | `{"meta": {"type": "ATT", "timestamp": 1.5}, "data": {"TimeUS": 1500000, ...}}` |
//! | `mavlogdump.py LOG` | `2026-11-27 10:00:01.50: ATT {TimeUS : 1500000, Roll : 0.1, ...}` |
//! | `mavlogdump.py --format csv --types ATTITUDE,RAW_IMU,HEARTBEAT LOG.tlog` | `1.5,0.1,,` below `timestamp,ATTITUDE.roll,RAW_IMU.xmag,...` |
//!
//! Each message goes to the reader of its format.

use std::io::{self, Read};

use mavlink_dialect::{MavMessage, Message as _};
use serde_json::{Map, Value};

use super::dataflash::{LogMessage, MESSAGES_TO_READ, ardupilot_builder, record_message};
use super::flight::{LogFormat, LoggedFlight};
use super::read_window::ReadWindow;
use super::tlog::{Origin, TlogReader};

/// Sender of messages without a source, as written without `--show-source`.
const UNKNOWN_SENDER: [u8; 2] = [1, 1];

/// A decoded message.
struct DecodedMessage {
    name: String,
    /// Its time is of any epoch.
    origin: Origin,
    fields: Map<String, Value>,
}

/// Format of the log that was decoded, by its first bytes; `None` if no line of them is a message.
pub fn decoded_format(first_bytes: &[u8]) -> Option<LogFormat> {
    let text = String::from_utf8_lossy(first_bytes);
    let mut columns = None;
    text.lines().take(100).find_map(|line| format_of(&parse_line(line, &mut columns)?.name))
}

fn format_of(name: &str) -> Option<LogFormat> {
    if MavMessage::message_id_from_name(name).is_some() {
        Some(LogFormat::TLog)
    } else {
        // Every DataFlash log has these first.
        (MESSAGES_TO_READ.contains(&name) || matches!(name, "FMT" | "FMTU" | "UNIT" | "MULT"))
            .then_some(LogFormat::DataFlashText)
    }
}

/// Reads a flight of the decoded format.
pub fn read_decoded(source: &mut dyn Read, format: LogFormat, system: Option<u8>) -> io::Result<LoggedFlight> {
    let mut window = ReadWindow::new(source);
    let mut columns = None;
    if format == LogFormat::TLog {
        let mut log = TlogReader::new(system);
        while let Some(line) = window.next_line()? {
            if let Some(message) = parse_line(&line, &mut columns) {
                record_mavlink(&mut log, &message);
            }
        }
        return Ok(log.finish_flight());
    }
    let mut builder = ardupilot_builder(format);
    while let Some(line) = window.next_line()? {
        match parse_line(&line, &mut columns) {
            Some(message) if MESSAGES_TO_READ.contains(&message.name.as_str()) => {
                record_message(&mut builder, &message.name, &message);
            }
            Some(_) => {}
            None => builder.flight.skipped_counts.garbage += u64::from(!line.is_empty()),
        }
    }
    Ok(builder.finish_flight())
}

fn record_mavlink(log: &mut TlogReader, message: &DecodedMessage) {
    let number_at = &mut |field: &str, index: usize| {
        let value = message.fields.get(if field == "mavtype" { "type" } else { field });
        match value {
            Some(Value::String(text)) => text.as_bytes().get(index).map(|byte| f64::from(*byte)),
            Some(Value::Array(numbers)) => numbers.get(index).and_then(Value::as_f64),
            Some(Value::Null) => Some(f64::NAN),
            Some(number) => number.as_f64(),
            None => None,
        }
        .unwrap_or(0.0)
    };
    let Some(decoded) = MavMessage::from_numbers(&message.name, number_at) else { return };
    log.record_message(message.origin, Some(&decoded));
}

/// Message of a line; `None` of any other line. `columns` are those of a table, by its first line.
fn parse_line(line: &str, columns: &mut Option<Vec<String>>) -> Option<DecodedMessage> {
    if line.starts_with('{') {
        return parse_json(line);
    }
    if let Some(rest) = line.strip_prefix("timestamp,") {
        *columns = rest.contains('.').then(|| rest.split(',').map(str::to_owned).collect());
        return None;
    }
    columns.as_ref().map_or_else(|| parse_text(line), |columns| parse_row(line, columns))
}

/// A DataFlash message, whose fields `mavlogdump` has scaled.
impl LogMessage for DecodedMessage {
    fn numeric_field(&self, name: &str) -> Option<f64> {
        self.fields.get(name)?.as_f64()
    }

    fn has_column(&self, name: &str) -> bool {
        self.fields.contains_key(name)
    }

    fn is_plain_integer(&self, name: &str) -> bool {
        self.fields.get(name).is_some_and(Value::is_i64)
    }

    fn text_field(&self, name: &str) -> Option<String> {
        self.fields.get(name)?.as_str().map(str::to_owned)
    }
}

fn parse_json(line: &str) -> Option<DecodedMessage> {
    let parse = |text: &str| serde_json::from_str::<Value>(text).ok();
    // Python writes numbers that JSON does not have.
    let mut message = parse(line).or_else(|| parse(&line.replace("NaN", "null").replace("-Infinity", "null")))?;
    let meta = message.get("meta")?;
    let name = meta.get("type")?.as_str()?.to_owned();
    let id = |key: &str, unknown: u8| meta.get(key).and_then(Value::as_u64).map_or(unknown, |id| id as u8);
    let sender = [id("srcSystem", UNKNOWN_SENDER[0]), id("srcComponent", UNKNOWN_SENDER[1])];
    let received_us = meta.get("timestamp").and_then(Value::as_f64).map_or(0, |stamp_s| (stamp_s * 1e6) as u64);
    let Value::Object(fields) = message.get_mut("data")?.take() else { return None };
    Some(DecodedMessage { name, origin: Origin { received_us, sender }, fields })
}

/// A line such as `2026-11-27 10:00:01.50: ATT {TimeUS : 1500000, Roll : 0.1} srcSystem=1 srcComponent=1`.
fn parse_text(line: &str) -> Option<DecodedMessage> {
    let (stamp, rest) = line.split_once(": ")?;
    let (name, rest) = rest.split_once(" {")?;
    let (fields, source) = rest.rsplit_once('}')?;
    let id = |key: &str| source.split_ascii_whitespace().find_map(|word| word.strip_prefix(key)?.parse().ok());
    let sender = match [id("srcSystem="), id("srcComponent=")] {
        [Some(system), Some(component)] => [system, component],
        _ => UNKNOWN_SENDER,
    };
    let (name, received_us) = (name.to_owned(), stamp_us(stamp)?);
    Some(DecodedMessage { name, origin: Origin { received_us, sender }, fields: parse_fields(fields) })
}

/// Microseconds of `2026-11-27 10:00:01.50`, whose months count 31 days: only differences of seconds matter.
fn stamp_us(stamp: &str) -> Option<u64> {
    let mut numbers =
        stamp.split(['-', ' ', ':', '.']).map(|number| number.parse::<u64>().ok().filter(|n| *n < 10_000));
    let mut next = || numbers.next().flatten();
    let [year, month, day, hour, minute, second, hundredth] =
        [next()?, next()?, next()?, next()?, next()?, next()?, next()?];
    let seconds = (((year * 12 + month) * 31 + day) * 24 + hour) * 3600 + minute * 60 + second;
    Some((seconds * 100 + hundredth) * 10_000)
}

/// Fields `name : value, name : value`; a text may contain commas.
fn parse_fields(text: &str) -> Map<String, Value> {
    let mut pairs: Vec<(&str, String)> = Vec::new();
    for part in text.split(", ") {
        match (part.split_once(" : "), pairs.last_mut()) {
            (Some((name, value)), _) => pairs.push((name, value.to_owned())),
            (None, Some((_, value))) => {
                value.push_str(", ");
                value.push_str(part);
            }
            (None, None) => {}
        }
    }
    pairs.into_iter().map(|(name, value)| (name.to_owned(), parse_value(&value))).collect()
}

/// A number (null for NaN), or an array of numbers; else a text.
fn parse_value(value: &str) -> Value {
    if value.eq_ignore_ascii_case("nan") {
        return Value::Null;
    }
    let parsed = value.starts_with(|first: char| first == '-' || first == '[' || first.is_ascii_digit());
    let parsed = parsed.then(|| serde_json::from_str(value).ok()).flatten();
    parsed.unwrap_or_else(|| Value::String(value.to_owned()))
}

/// A row of a table that has the columns of one message filled.
fn parse_row(line: &str, columns: &[String]) -> Option<DecodedMessage> {
    let mut values = line.split(',');
    let received_us = (values.next()?.parse::<f64>().ok()? * 1e6) as u64;
    let mut name = None;
    let mut fields = Map::new();
    for (column, value) in columns.iter().zip(values).filter(|(_, value)| !value.is_empty()) {
        let (message, field) = column.split_once('.')?;
        fields.insert(field.to_owned(), parse_value(value));
        name = Some(message);
    }
    let origin = Origin { received_us, sender: UNKNOWN_SENDER };
    Some(DecodedMessage { name: name?.to_owned(), origin, fields })
}
