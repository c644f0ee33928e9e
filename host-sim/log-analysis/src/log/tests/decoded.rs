//! What `mavlogdump` makes of a log gives the flight of the log. Lines are as pymavlink 2.4 writes them.

use super::*;

/// Time, name, and fields with their values as text; a word is in quotation marks in JSON only.
type Message = (u64, String, Vec<(String, String)>);

fn dataflash_messages(recording: &FlightRecording) -> Vec<Message> {
    let text = String::from_utf8(encode_dataflash_text(recording)).unwrap();
    let mut columns: Vec<(String, Vec<String>)> = Vec::new();
    let mut messages = Vec::new();
    for line in text.lines() {
        let values: Vec<&str> = line.split(", ").collect();
        if let ["FMT", _, _, name, _, names] = values[..] {
            columns.push((name.to_owned(), names.split(',').map(str::to_owned).collect()));
        } else if let Some((name, names)) = columns.iter().find(|(name, _)| name == values[0]) {
            let fields = names.iter().cloned().zip(values[1..].iter().map(|value| (*value).to_owned())).collect();
            messages.push((0, name.clone(), fields));
        }
    }
    messages
}

fn mavlink_messages(recording: &FlightRecording) -> Vec<Message> {
    let mut messages = Vec::new();
    for (index, sample) in recording.samples.iter().enumerate() {
        let (us, ms) = (sample.time_us, sample.time_us / 1000);
        let mut message = |name: &str, fields: &[(&str, String)]| {
            let fields = fields.iter().map(|(field, value)| ((*field).to_owned(), value.clone())).collect();
            messages.push((us, name.to_owned(), fields));
        };
        let number = |value: f64| value.to_string();
        if index % 10 == 0 {
            let state = [("type", 2), ("autopilot", 3), ("base_mode", 129), ("system_status", 4)];
            message("HEARTBEAT", &state.map(|(field, value)| (field, value.to_string())));
        }
        if index == 5 {
            for (name, value) in &recording.parameters {
                message("PARAM_VALUE", &[("param_id", name.clone()), ("param_value", number(*value))]);
            }
        }
        let [roll, pitch, yaw] = sample.attitude_rad.map(number);
        message("ATTITUDE", &[("time_boot_ms", ms.to_string()), ("roll", roll), ("pitch", pitch), ("yaw", yaw)]);
        let (field, _) = recording.ardupilot_field_ut(sample, 1);
        let [x, y, z] = field.map(|axis| number((axis * 10.0).round()));
        message("RAW_IMU", &[("time_usec", us.to_string()), ("xmag", x), ("ymag", y), ("zmag", z)]);
    }
    messages
}

fn to_json((us, name, fields): &Message) -> String {
    let fields = fields.iter().map(|(field, value)| {
        let is_number = value.parse::<f64>().is_ok();
        if is_number { format!("\"{field}\": {value}") } else { format!("\"{field}\": \"{value}\"") }
    });
    let (seconds, fields) = (*us as f64 / 1e6, fields.collect::<Vec<_>>().join(", "));
    format!("{{\"meta\": {{\"type\": \"{name}\", \"timestamp\": {seconds}}}, \"data\": {{{fields}}}}}")
}

fn to_text((us, name, fields): &Message) -> String {
    let fields = fields.iter().map(|(field, value)| format!("{field} : {value}")).collect::<Vec<_>>().join(", ");
    let (second, hundredth) = (us / 1_000_000, us / 10_000 % 100);
    format!("2026-11-27 10:{:02}:{:02}.{hundredth:02}: {name} {{{fields}}}", second / 60, second % 60)
}

fn to_table(messages: &[Message]) -> Vec<String> {
    let columns_of =
        |(_, name, fields): &Message| fields.iter().map(|(field, _)| format!("{name}.{field}")).collect::<Vec<_>>();
    let mut columns: Vec<String> = messages.iter().flat_map(columns_of).collect();
    columns.sort();
    columns.dedup();
    let row = |message: &Message| {
        let own = columns_of(message);
        let value = |column: &String| own.iter().position(|name| name == column).map_or("", |i| &*message.2[i].1);
        let values: Vec<&str> = columns.iter().map(value).collect();
        format!("{:.8},{}", message.0 as f64 / 1e6, values.join(","))
    };
    let head = format!("timestamp,{}", columns.join(","));
    std::iter::once(head).chain(messages.iter().map(row)).collect()
}

/// A log in each syntax.
pub fn logs_in_each_syntax() -> [Vec<u8>; 3] {
    let messages = mavlink_messages(&two_compass_recording(&ARDUPILOT_PARAMETERS));
    let each = |line: fn(&Message) -> String| messages.iter().map(line).collect::<Vec<_>>();
    [each(to_json), each(to_text), to_table(&messages)].map(|lines| lines.join("\n").into_bytes())
}

#[test]
fn a_decoded_log_gives_the_flight_of_the_log() {
    // The current, of which the motor compensation is made, is in no message below.
    let is_compensation = |(name, _): &&(&str, f64)| name.starts_with("COMPASS_MOT");
    let parameters: Vec<(&str, f64)> =
        ARDUPILOT_PARAMETERS.iter().filter(|parameter| !is_compensation(parameter)).copied().collect();
    let recording = FlightRecording { is_copter: true, ..two_compass_recording(&parameters) };
    let (dataflash, mavlink) = (dataflash_messages(&recording), mavlink_messages(&recording));
    let logs = [encode_dataflash_text(&recording), encode_tlog(&recording)];
    let [dataflash_log, mavlink_log] = logs.map(|log| read_bytes(&log).unwrap());
    let each = |messages: &[Message], line: fn(&Message) -> String| messages.iter().map(line).collect::<Vec<_>>();
    for (lines, log) in [
        (each(&dataflash, to_json), &dataflash_log),
        (each(&dataflash, to_text), &dataflash_log),
        (each(&mavlink, to_json), &mavlink_log),
        (each(&mavlink, to_text), &mavlink_log),
        (to_table(&mavlink), &mavlink_log),
    ] {
        let flight = read_bytes(lines.join("\n").as_bytes()).unwrap();
        assert_eq!((flight.log_format, flight.is_copter), (log.log_format, log.is_copter));
        assert_eq!(flight.compasses[0].field, log.compasses[0].field, "{}", lines[0]);
        assert_eq!(flight.attitude, log.attitude, "{}", lines[0]);
        assert_eq!(flight.is_armed(60.0), log.is_armed(60.0), "{}", lines[0]);
        assert_eq!(flight.skipped_counts.garbage, 0);
    }
}

/// A ground station's log has other sources, numbers that JSON does not have, and broken lines.
#[test]
fn foreign_sources_and_broken_lines_are_passed_over() {
    let messages = mavlink_messages(&two_compass_recording(&ARDUPILOT_PARAMETERS));
    let own: Vec<String> = messages
        .iter()
        .map(|message| {
            to_json(message).replace("\"timestamp\"", "\"srcSystem\": 7, \"srcComponent\": 1, \"timestamp\"")
        })
        .collect();
    let mut lines = Vec::new();
    for line in &own {
        lines.push(line.clone());
        lines.push(line.replace("\"srcSystem\": 7", "\"srcSystem\": 8").replace("0.", "1."));
        lines.push(line[..line.len() / 2].to_owned());
        if line.contains("ATTITUDE") {
            lines.push(line.replace("ATTITUDE", "NEW_MESSAGE").replace("\"roll\": ", "\"roll\": NaN, \"x\": "));
        }
    }
    let [flight, alone] = [lines, own].map(|lines| read_bytes(lines.join("\n").as_bytes()).unwrap());
    assert_eq!(flight.autopilot_system_ids, [7, 8]);
    assert_eq!(flight.attitude, alone.attitude);
    assert_eq!(flight.compasses[0].field, alone.compasses[0].field);
}
