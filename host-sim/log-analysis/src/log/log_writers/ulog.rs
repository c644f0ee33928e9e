//! ULog writer, as PX4 with corrected compasses (`vehicle_magnetometer`) and slower raw ones (`sensor_mag`).

use nalgebra::Vector3;

use super::recording::{FLIGHT_START_UTC_US, FlightRecording};
use crate::log::correction::FieldCorrection;
use crate::log::mounting::px4_mounting;
use crate::log::parameters::ParameterHistory;
use crate::numbers::UT_PER_GAUSS;

const ULOG_FORMATS: [&str; 10] = [
    "vehicle_magnetometer:uint64_t timestamp;uint32_t device_id;float[3] magnetometer_ga;",
    "vehicle_attitude:uint64_t timestamp;float[4] q;",
    "vehicle_angular_velocity:uint64_t timestamp;float[3] xyz;",
    "battery_status:uint64_t timestamp;float current_a;bool connected;uint8_t[3] _padding0;",
    "vehicle_gps_position:uint64_t timestamp;int32_t lat;int32_t lon;int32_t alt;float vel_m_s;float vel_n_m_s;float \
     vel_e_m_s;float cog_rad;uint64_t time_utc_usec;uint8_t fix_type;",
    "vehicle_status:uint64_t timestamp;uint8_t vehicle_type;bool is_vtol;",
    "sensor_mag:uint64_t timestamp;uint32_t device_id;float x;float y;float z;",
    "actuator_outputs:uint64_t timestamp;uint32_t noutputs;float[16] output;",
    "esc_report:uint64_t timestamp;float esc_current;uint8_t esc_address;uint8_t[3] _padding0;",
    "esc_status:uint64_t timestamp;uint8_t esc_count;uint8_t[7] _padding0;esc_report[4] esc;",
];

/// Encodes a recording as ULog.
#[must_use]
pub fn encode_ulog(recording: &FlightRecording) -> Vec<u8> {
    let mut bytes = b"ULog\x01\x12\x35\x01".to_vec();
    bytes.extend(0_u64.to_le_bytes());
    let mut message = |type_name: u8, body: &[u8]| {
        bytes.extend((body.len() as u16).to_le_bytes());
        bytes.push(type_name);
        bytes.extend(body);
    };
    message(b'B', &[0; 40]);
    message(b'I', &encode_keyed_value("uint32_t ver_sw_release", &[255, 0, 15, 1]));
    for format in ULOG_FORMATS {
        message(b'F', format.as_bytes());
    }
    let mut parameters = ParameterHistory::default();
    for (name, value) in &recording.parameters {
        parameters.set_value(0.0, name, *value);
        let is_whole = name.ends_with("_ID") || name.ends_with("_ROT");
        let (type_name, value) = if is_whole {
            ("int32_t", (*value as i32).to_le_bytes())
        } else {
            ("float", (*value as f32).to_le_bytes())
        };
        message(b'P', &encode_keyed_value(&format!("{type_name} {name}"), &value));
    }
    let compasses = recording.compass_count();
    let mut subscribed: Vec<(u8, &str)> = (0..compasses).map(|i| (i as u8, "vehicle_magnetometer")).collect();
    let further_batteries = recording.samples.first().map_or(0, |sample| sample.further_currents_a.len());
    subscribed.extend(
        [
            "vehicle_attitude",
            "vehicle_angular_velocity",
            "battery_status",
            "vehicle_gps_position",
            "vehicle_status",
            "actuator_outputs",
            "esc_status",
        ]
        .map(|n| (0, n)),
    );
    subscribed.extend((0..further_batteries).map(|i| (i as u8 + 1, "battery_status")));
    let sensor_mag_id = subscribed.len();
    subscribed.extend((0..compasses).map(|i| (i as u8, "sensor_mag")));
    for (id, (instance, name)) in subscribed.iter().enumerate() {
        let [low, high] = (id as u16).to_le_bytes();
        message(b'A', &[&[*instance, low, high], name.as_bytes()].concat());
    }
    let corrections: Vec<FieldCorrection> =
        (0..compasses).map(|index| FieldCorrection::from_px4(&parameters, index as u8)).collect();
    for (i, sample) in recording.samples.iter().enumerate() {
        let mut data = |id: usize, body: &[&[u8]]| {
            let id = (id as u16).to_le_bytes();
            message(b'D', &[&[&id, &sample.time_us.to_le_bytes()[..]].concat()[..], &body.concat()].concat());
        };
        for (compass_number, correction) in corrections.iter().enumerate() {
            let raw = sample.field_ut[compass_number];
            let gauss = correction.correct_field(raw.into(), sample.current_a) / UT_PER_GAUSS;
            let id = recording.parameter_value(&format!("CAL_MAG{compass_number}_ID")) as u32;
            data(compass_number, &[&id.to_le_bytes(), &encode_floats(gauss.as_slice())]);
            // PX4 logs sensors at 1 Hz by default.
            if i % 10 == 0 {
                let mounting = px4_mounting(&parameters, f64::INFINITY, compass_number as u8);
                let sensor_gauss = mounting.transpose() * Vector3::from(raw) / UT_PER_GAUSS;
                data(sensor_mag_id + compass_number, &[&id.to_le_bytes(), &encode_floats(sensor_gauss.as_slice())]);
            }
        }
        data(compasses, &[&encode_floats(&quaternion_from_euler(sample.attitude_rad))]);
        data(compasses + 1, &[&encode_floats(&sample.rates_rad_s)]);
        data(compasses + 2, &[&encode_floats(&[sample.current_a]), &[1, 0, 0, 0]]);
        for (battery, current_a) in sample.further_currents_a.iter().enumerate() {
            data(compasses + 7 + battery, &[&encode_floats(&[*current_a]), &[1, 0, 0, 0]]);
        }
        if !sample.outputs.is_empty() {
            data(compasses + 5, &[&16_u32.to_le_bytes(), &encode_floats(&sample.output_pulses_us::<16>())]);
        }
        if !sample.esc_currents_a.is_empty() {
            let report = |esc: usize| {
                let current = encode_floats(&[sample.esc_currents_a.get(esc).copied().unwrap_or(f64::NAN)]);
                [&[0; 8], &current[..], &[0; 4]].concat()
            };
            data(
                compasses + 6,
                &[&[sample.esc_currents_a.len() as u8, 0, 0, 0, 0, 0, 0, 0], &[0, 1, 2, 3].map(report).concat()],
            );
        }
        if i % 10 == 0 {
            // Vehicle type: 1 is rotary wing, 2 is fixed wing.
            data(compasses + 4, &[&[if recording.is_copter { 1 } else { 2 }, 0]]);
        }
        if let Some([latitude, longitude, height]) = recording.sample_position(sample).filter(|_| i % 2 == 0) {
            let position_bytes: Vec<u8> = [latitude * 1e7, longitude * 1e7, height * 1e3]
                .iter()
                .flat_map(|n| (n.round() as i32).to_le_bytes())
                .collect();
            let ([speed_m_s, course_rad], [north, east]) = (sample.speed_and_course(), sample.velocity_m_s);
            let speed_and_course = encode_floats(&[speed_m_s, north, east, course_rad]);
            data(
                compasses + 3,
                &[&position_bytes, &speed_and_course, &(FLIGHT_START_UTC_US + sample.time_us).to_le_bytes(), &[3]],
            );
        }
    }
    bytes
}

fn encode_keyed_value(key: &str, value: &[u8]) -> Vec<u8> {
    [&[key.len() as u8], key.as_bytes(), value].concat()
}

fn encode_floats(numbers: &[f64]) -> Vec<u8> {
    numbers.iter().flat_map(|number| (*number as f32).to_le_bytes()).collect()
}

/// Quaternion w, x, y, z of roll, then pitch, then yaw.
fn quaternion_from_euler([roll, pitch, yaw]: [f64; 3]) -> [f64; 4] {
    let [(sr, cr), (sp, cp), (sy, cy)] = [roll, pitch, yaw].map(|angle| libm::sincos(angle / 2.0));
    [cr * cp * cy + sr * sp * sy, sr * cp * cy - cr * sp * sy, cr * sp * cy + sr * cp * sy, cr * cp * sy - sr * sp * cy]
}
