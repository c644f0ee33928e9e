//! DataFlash writer, binary and text.

use std::fmt::Write as _;

use super::recording::FlightRecording;

/// Number, name, format letters and columns of each message written.
const WRITTEN_MESSAGES: [(u8, &str, &str, &str); 11] = [
    (128, "FMT", "BBnNZ", "Type,Length,Name,Format,Columns"),
    (64, "PARM", "QNff", "TimeUS,Name,Value,Default"),
    (65, "MSG", "QZ", "TimeUS,Message"),
    (66, "ATT", "Qfff", "TimeUS,Roll,Pitch,Yaw"),
    (67, "MAG", "QBhhhhhhhhhBI", "TimeUS,I,MagX,MagY,MagZ,OfsX,OfsY,OfsZ,MOX,MOY,MOZ,Health,S"),
    (68, "IMU", "QBfff", "TimeUS,I,GyrX,GyrY,GyrZ"),
    (69, "GPS", "QBBIHLLeff", "TimeUS,I,Status,GMS,GWk,Lat,Lng,Alt,Spd,GCrs"),
    (70, "BAT", "QBff", "TimeUS,Inst,Volt,Curr"),
    (71, "RCOU", "QHHHHHHHHHHHHHH", "TimeUS,C1,C2,C3,C4,C5,C6,C7,C8,C9,C10,C11,C12,C13,C14"),
    (72, "ESC", "QBff", "TimeUS,Instance,Volt,Curr"),
    (73, "MODE", "QMBB", "TimeUS,Mode,ModeNum,Rsn"),
];

/// GPS week 2400 began 2026-01-04.
const FLIGHT_GPS_WEEK: u16 = 2400;

#[derive(Clone)]
enum ColumnValue {
    Number(f64),
    Text(String),
}

impl From<f64> for ColumnValue {
    fn from(number: f64) -> Self {
        Self::Number(number)
    }
}

/// Encodes a recording as binary DataFlash.
#[must_use]
pub fn encode_dataflash(recording: &FlightRecording) -> Vec<u8> {
    let mut bytes = Vec::new();
    write_messages(recording, &mut |index, values| {
        let (message_number, _, format_codes, _) = WRITTEN_MESSAGES[index];
        bytes.extend([0xA3, 0x95, message_number]);
        for (format_code, value) in format_codes.bytes().zip(values) {
            match value {
                ColumnValue::Text(text) => bytes.extend(padded_text(text, format_size(format_code))),
                ColumnValue::Number(message_number) => bytes.extend(encode_number(format_code, *message_number)),
            }
        }
    });
    bytes
}

/// Encodes a recording as DataFlash text.
#[must_use]
pub fn encode_dataflash_text(recording: &FlightRecording) -> Vec<u8> {
    let mut text = String::new();
    write_messages(recording, &mut |index, values| {
        let (_, name, format_codes, _) = WRITTEN_MESSAGES[index];
        text.push_str(name);
        for (format_code, value) in format_codes.bytes().zip(values) {
            let _ = match value {
                ColumnValue::Text(words) => write!(text, ", {words}"),
                ColumnValue::Number(message_number) if matches!(format_code, b'f' | b'L' | b'e') => {
                    write!(text, ", {message_number}")
                }
                ColumnValue::Number(message_number) => write!(text, ", {message_number:.0}"),
            };
        }
        text.push('\n');
    });
    text.into_bytes()
}

/// Writes each message: index in [`WRITTEN_MESSAGES`] and values.
fn write_messages(recording: &FlightRecording, write: &mut dyn FnMut(usize, &[ColumnValue])) {
    let first_us = recording.samples.first().map_or(0.0, |sample| sample.time_us as f64);
    let text_value = |text: &str| ColumnValue::Text(text.to_owned());
    for (message_number, name, format_codes, columns) in WRITTEN_MESSAGES {
        let length = 3 + format_codes.bytes().map(format_size).sum::<usize>();
        let numbers = [f64::from(message_number), length as f64].map(ColumnValue::from);
        write(0, &[&numbers[..], &[name, format_codes, columns].map(text_value)].concat());
    }
    let firmware = if recording.is_copter { "ArduCopter V4.6.0 (host-sim)" } else { "ArduPlane V4.6.0 (host-sim)" };
    write(2, &[first_us.into(), text_value(firmware)]);
    for (name, value) in &recording.parameters {
        write(1, &[first_us.into(), text_value(name), (*value).into(), 0.0.into()]);
    }
    for (i, sample) in recording.samples.iter().enumerate() {
        let time_us = sample.time_us as f64;
        let mut row = |index: usize, numbers: &[f64]| {
            let values: Vec<ColumnValue> =
                std::iter::once(time_us).chain(numbers.iter().copied()).map(ColumnValue::from).collect();
            write(index, &values);
        };
        if i == 0 || recording.samples[i - 1].flight_mode != sample.flight_mode {
            row(10, &[f64::from(sample.flight_mode), f64::from(sample.flight_mode), 0.0]);
        }
        row(3, &sample.attitude_rad.map(f64::to_degrees));
        for compass_number in 1..=recording.compass_count() {
            let (field, motor) = recording.ardupilot_field_ut(sample, compass_number);
            let [x, y, z] = field.map(|axis| axis * 10.0);
            let [mx, my, mz] = motor.map(|axis| axis * 10.0);
            let [ox, oy, oz] = recording.ardupilot_vector("OFS", compass_number).map(f64::trunc);
            row(4, &[(compass_number - 1) as f64, x, y, z, ox, oy, oz, mx, my, mz, 1.0, 0.0]);
        }
        let [p, q, r] = sample.rates_rad_s;
        row(5, &[0.0, p, q, r]);
        for (battery, current_a) in [sample.current_a].iter().chain(&sample.further_currents_a).enumerate() {
            row(7, &[battery as f64, 12.0, *current_a]);
        }
        if !sample.outputs.is_empty() {
            row(8, &sample.output_pulses_us::<14>());
        }
        for (esc, current_a) in sample.esc_currents_a.iter().enumerate() {
            row(9, &[esc as f64, 12.0, *current_a]);
        }
        if let Some([latitude, longitude, height]) = recording.sample_position(sample).filter(|_| i % 2 == 0) {
            let [speed_m_s, course_rad] = sample.speed_and_course();
            let speed_and_course = [speed_m_s, course_rad.to_degrees()];
            let gps_values = [0.0, 3.0, time_us / 1e3, f64::from(FLIGHT_GPS_WEEK), latitude, longitude, height];
            row(6, &[&gps_values[..], &speed_and_course].concat());
        }
    }
}

const fn format_size(format_code: u8) -> usize {
    match format_code {
        b'B' | b'M' => 1,
        b'h' | b'H' => 2,
        b'Q' => 8,
        b'N' => 16,
        b'Z' => 64,
        _ => 4,
    }
}

fn encode_number(format_code: u8, number: f64) -> Vec<u8> {
    match format_code {
        b'B' | b'M' => vec![number as u8],
        b'h' => (number.round() as i16).to_le_bytes().to_vec(),
        b'H' => (number as u16).to_le_bytes().to_vec(),
        b'I' => (number as u32).to_le_bytes().to_vec(),
        b'L' => ((number * 1e7).round() as i32).to_le_bytes().to_vec(),
        b'e' => ((number * 100.0).round() as i32).to_le_bytes().to_vec(),
        b'Q' => (number as u64).to_le_bytes().to_vec(),
        _ => (number as f32).to_le_bytes().to_vec(),
    }
}

fn padded_text(text: &str, length: usize) -> Vec<u8> {
    let mut bytes: Vec<u8> = text.bytes().take(length).collect();
    bytes.resize(length, 0);
    bytes
}
