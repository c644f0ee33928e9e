use super::*;

/// Message of a ULog: its type and its body.
type Message = (u8, Vec<u8>);

/// A ULog in which each message becomes the messages that `change` gives.
fn with_changed_messages(bytes: &[u8], change: &mut dyn FnMut(u8, Vec<u8>) -> Vec<Message>) -> Vec<u8> {
    let (mut changed_log, mut remaining) = (bytes[..16].to_vec(), &bytes[16..]);
    while let [low, high, kind, after @ ..] = remaining {
        let (body, next) = after.split_at(usize::from(u16::from_le_bytes([*low, *high])));
        changed_log = with_appended_messages(changed_log, &change(*kind, body.to_vec()));
        remaining = next;
    }
    changed_log
}

fn with_appended_messages(mut bytes: Vec<u8>, messages: &[Message]) -> Vec<u8> {
    for (message_type, body) in messages {
        bytes.extend((body.len() as u16).to_le_bytes());
        bytes.push(*message_type);
        bytes.extend(body);
    }
    bytes
}

/// The flight of a log of PX4 with further messages at its end.
fn flight_with_messages(messages: &[Message]) -> LoggedFlight {
    read_bytes(&with_appended_messages(px4_log(), messages)).unwrap()
}

fn px4_log() -> Vec<u8> {
    encode_ulog(&two_compass_recording(&PX4_PARAMETERS))
}

/// Declares the columns of a topic after its time stamp.
fn format_message(topic: &str, columns: &str) -> Message {
    (b'F', format!("{topic}:uint64_t timestamp;{columns}").into_bytes())
}

/// Message that subscribes a message id to an instance of a topic.
fn subscription_message(message_id: u8, instance: u8, topic: &str) -> Message {
    (b'A', [&[instance, message_id, 0], topic.as_bytes()].concat())
}

fn row_message(message_id: u8, at_us: u64, values: &[&[u8]]) -> Message {
    (b'D', [&[message_id, 0][..], &at_us.to_le_bytes(), &values.concat()].concat())
}

/// Until 1.8 field and rates were in `sensor_combined` only.
#[test]
fn px4s_old_sensor_combined_is_read() {
    let renamed = |body: &[u8], pairs: [(&str, &str); 2]| {
        let text = String::from_utf8_lossy(body).into_owned();
        pairs.iter().fold(text, |text, (old, new)| text.replace(old, new)).into_bytes()
    };
    let mut one_compass = two_compass_recording(&PX4_PARAMETERS);
    one_compass.samples.iter_mut().for_each(|sample| sample.field_ut.truncate(1));
    let sensor_combined = [
        ("vehicle_magnetometer", "sensor_combined"),
        ("uint32_t device_id", "int32_t magnetometer_timestamp_relative"),
    ];
    let bytes = with_changed_messages(&encode_ulog(&one_compass), &mut |message_type, body| {
        let changed = match (message_type, &body[..]) {
            (b'F', text) if text.starts_with(b"vehicle_magnetometer") => renamed(text, sensor_combined),
            (b'F', text) if text.starts_with(b"vehicle_angular") => {
                renamed(text, [("vehicle_angular_velocity", "sensor_combined_of_rates"), ("xyz", "gyro_rad")])
            }
            (b'A', text) if text.ends_with(b"sensor_mag") => renamed(text, [("sensor_mag", "none"), ("none", "none")]),
            (b'A', text) => renamed(text, [sensor_combined[0], ("vehicle_angular_velocity", "none")]),
            // The field was measured 20 ms before the row's time.
            (b'D', [0, 0, rest @ ..]) => [&[0, 0], &rest[..8], &(-20_000_i32).to_le_bytes(), &rest[12..]].concat(),
            _ => body,
        };
        vec![(message_type, changed)]
    });
    let flight = read_bytes(&bytes).unwrap();
    let rows = flight.compasses[0].field.rows();
    assert_eq!((flight.compasses.len(), rows.len()), (1, 300));
    for (row, sample) in rows.iter().zip(&one_compass.samples) {
        assert!((raw_ut(row) - Vector3::from(sample.field_ut[0])).norm() < 0.001, "{row:?}");
        assert!((row.t_s + 0.02 - sample.time_us as f64 / 1e6).abs() < 1e-6, "{row:?}");
    }
}

/// 20 insertions of 3 KB, in which message headers occur by chance. A sample has six messages, so each insertion costs
/// at most one sample.
#[test]
fn noise_in_a_ulog_costs_at_most_one_sample_each() {
    let mut bytes = px4_log();
    let mut random = Random(7);
    for insertion in (1..=20).rev() {
        let offset = bytes.len() / 40 + bytes.len() * insertion / 22;
        let noise: Vec<u8> = random.bytes(3000);
        bytes.splice(offset..offset, noise);
    }
    let rows = read_bytes(&bytes).unwrap().compasses[0].field.rows().len();
    assert!((300 - 20..=300).contains(&rows), "{rows}");
}

/// A priority above zero does not show which compass is used.
#[test]
fn a_compass_of_priority_zero_is_not_used() {
    let parameters = [&PX4_PARAMETERS[..], &[("CAL_MAG0_PRIO", 50.0), ("CAL_MAG1_PRIO", 0.0)]].concat();
    let flight = read_bytes(&encode_ulog(&two_compass_recording(&parameters))).unwrap();
    assert_eq!(
        flight.compasses.iter().map(|compass| compass.is_used_for_heading).collect::<Vec<_>>(),
        [None, Some(false)]
    );
}

/// A second battery does not supply the motors.
#[test]
fn the_current_of_the_first_battery_is_used() {
    let current = |amperes: f32| [&amperes.to_le_bytes()[..], &[1, 0, 0, 0]].concat();
    let flight = flight_with_messages(&[
        subscription_message(90, 0, "battery_status"),
        subscription_message(91, 1, "battery_status"),
        row_message(90, 70_000_000, &[&current(33.0)]),
        row_message(91, 70_100_000, &[&current(2.0)]),
    ]);
    assert_eq!(flight.battery_current.rows().len(), 301);
    assert_eq!(flight.battery_current.rows().last().unwrap().row_values.map(f32::to_bits), [33.0_f32.to_bits()]);
}

/// The column names since 1.14, without velocity components; a 2D fix and a second receiver are ignored.
#[test]
fn gps_columns_are_read_by_their_new_names() {
    let columns = "double latitude_deg;double longitude_deg;double altitude_msl_m;float vel_m_s;float cog_rad;\
                   float heading;uint8_t fix_type;";
    let fix = |message_id: u8, at_us: u64, fix_type: u8| {
        let position_bytes = [48.0_f64, 11.3, 500.0].map(f64::to_le_bytes).concat();
        let speed_and_course = [12.0_f32, 0.5, 1.5].map(f32::to_le_bytes).concat();
        row_message(message_id, at_us, &[&position_bytes, &speed_and_course, &[fix_type]])
    };
    let original = FlightRecording { start_position: None, ..two_compass_recording(&PX4_PARAMETERS) };
    let messages = [
        format_message("vehicle_gps_position", columns),
        subscription_message(90, 0, "vehicle_gps_position"),
        subscription_message(91, 1, "vehicle_gps_position"),
        fix(90, 70_000_000, 2),
        fix(90, 70_200_000, 3),
        fix(91, 70_400_000, 3),
    ];
    let flight = read_bytes(&with_appended_messages(encode_ulog(&original), &messages)).unwrap();
    let [fix] = flight.gps.rows() else { panic!("{:?}", flight.gps) };
    let Gps { latitude_deg, speed_m_s, course_deg, yaw_deg, .. } = Gps::from_columns(fix.row_values);
    assert_eq!((latitude_deg, speed_m_s), (48.0, 12.0));
    assert!((course_deg - 0.5_f32.to_degrees()).abs() < 1e-4 && (yaw_deg - 1.5_f32.to_degrees()).abs() < 1e-4);
}

#[test]
fn a_vtol_is_no_copter() {
    for (is_vtol, is_copter) in [(0, true), (1, false)] {
        let flight = flight_with_messages(&[
            subscription_message(90, 0, "vehicle_status"),
            row_message(90, 70_000_000, &[&[1, is_vtol]]),
        ]);
        assert_eq!(flight.is_copter, is_copter);
    }
}

/// `arming_state` 2 means armed.
#[test]
fn an_arming_state_is_read() {
    let mut messages =
        vec![format_message("vehicle_status", "uint8_t arming_state;"), subscription_message(90, 0, "vehicle_status")];
    let states = [(70, 1), (71, 2), (72, 5), (73, 2), (74, 3)];
    messages.extend(states.map(|(at_s, state)| row_message(90, at_s * 1_000_000, &[&[state]])));
    let flight = flight_with_messages(&messages);
    let armed = [70.5, 71.5, 72.5, 73.5, 74.5].map(|t_s| flight.is_armed(t_s).unwrap());
    assert_eq!(armed, [false, true, false, true, false]);
}

#[test]
fn a_sample_has_its_timestamp_sample() {
    let rates = [0.1_f32, 0.2, 0.3].map(f32::to_le_bytes).concat();
    let flight = flight_with_messages(&[
        format_message("vehicle_angular_velocity", "uint64_t timestamp_sample;float[3] xyz;"),
        subscription_message(90, 0, "vehicle_angular_velocity"),
        row_message(90, 70_100_000, &[&70_060_000_u64.to_le_bytes(), &rates]),
    ]);
    let last = flight.body_rates.rows().last().unwrap();
    assert!((last.t_s - 70.06).abs() < 1e-6, "{last:?}");
}

const SENSOR_MAG_COLUMNS: &str = "uint32_t device_id;float x;float y;float z;";

/// Before 1.11 `sensor_mag` was corrected by the driver.
#[test]
fn sensor_mag_is_raw_since_1_11() {
    let empty_recording = FlightRecording { samples: Vec::new(), ..two_compass_recording(&PX4_PARAMETERS) };
    let gauss = [0.2_f32, -0.1, 0.4].map(f32::to_le_bytes).concat();
    let level_quaternion = [1.0_f32, 0.0, 0.0, 0.0].map(f32::to_le_bytes).concat();
    let messages = [
        format_message("sensor_mag", SENSOR_MAG_COLUMNS),
        subscription_message(90, 0, "sensor_mag"),
        subscription_message(91, 0, "vehicle_attitude"),
        row_message(91, 70_000_000, &[&level_quaternion]),
        row_message(90, 70_100_000, &[&396_809_u32.to_le_bytes(), &gauss]),
    ];
    let log_of_version = |minor| {
        let bytes = with_changed_messages(&encode_ulog(&empty_recording), &mut |message_type, mut body| {
            let version = body.windows(4).position(|bytes| bytes == [255, 0, 15, 1]).filter(|_| message_type == b'I');
            if let Some(at) = version {
                body[at + 2] = minor;
            }
            vec![(message_type, body)]
        });
        read_bytes(&with_appended_messages(bytes, &messages))
    };
    assert!(matches!(log_of_version(10), Err(LogError::NoMagnetometer(LogFormat::ULog, 0))));
    // Turned by 90 deg: the sensor's y is the body's -x.
    let flight = log_of_version(11).unwrap();
    let [row] = flight.compasses[0].field.rows() else { panic!("{:?}", flight.compasses) };
    assert!((raw_ut(row).xy() - Vector3::new(10.0, 20.0, 0.0).xy()).norm() < 1e-4, "{row:?}");
}

/// `sensor_mag` of the first compass is added in one sample of `stride`.
fn with_sensor_mag(recording: &FlightRecording, stride: usize) -> Vec<u8> {
    const SENSOR_MAG_ID: u8 = 60;
    let mut row_count = 0;
    let bytes = with_changed_messages(&encode_ulog(recording), &mut |message_type, body| {
        let mut messages = vec![(message_type, body.clone())];
        match (message_type, &body[..]) {
            (b'A', [_, 0, ..]) => messages.push(subscription_message(SENSOR_MAG_ID, 0, "sensor_mag")),
            (b'D', [0, 0, rest @ ..]) => {
                if row_count % stride == 0 {
                    let field_ut = recording.samples[row_count].field_ut[0];
                    let gauss = field_ut.map(|axis| ((axis / 100.0) as f32).to_le_bytes());
                    messages.push((b'D', [&[SENSOR_MAG_ID, 0], &rest[..12], gauss.as_flattened()].concat()));
                }
                row_count += 1;
            }
            _ => {}
        }
        messages
    });
    let (head, messages) = bytes.split_at(16);
    let with_format = with_appended_messages(head.to_vec(), &[format_message("sensor_mag", SENSOR_MAG_COLUMNS)]);
    [&with_format, messages].concat()
}

/// PX4 logs `sensor_mag` at 1 Hz by default and the corrected field faster; at equal rates the raw field is used.
#[test]
fn the_faster_logged_of_raw_and_corrected_field_is_read() {
    let parameters = [("CAL_MAG0_ID", 396_809.0), ("CAL_MAG0_XOFF", 0.12), ("CAL_MAG0_YSCALE", 1.1)];
    let mut one_compass = two_compass_recording(&parameters);
    one_compass.samples.iter_mut().for_each(|sample| sample.field_ut.truncate(1));
    for stride in [1, 10] {
        let flight = read_bytes(&with_sensor_mag(&one_compass, stride)).unwrap();
        let [compass] = flight.compasses.as_slice() else { panic!("one compass") };
        assert_eq!(compass.field.rows().len(), 300, "1 of {stride}");
        for (row, sample) in compass.field.rows().iter().zip(&one_compass.samples) {
            let original = Vector3::from(sample.field_ut[0]);
            let corrected = Vector3::new(original.x - 12.0, original.y * 1.1, original.z);
            assert!((raw_ut(row) - original).norm() < 0.001, "1 of {stride}: {row:?}");
            assert!((logged_ut(row) - corrected).norm() < 0.001, "1 of {stride}: {row:?}");
        }
    }
}

#[test]
fn an_estimator_attitude_replaces_a_missing_one() {
    let renamed = with_changed_messages(&px4_log(), &mut |message_type, body| {
        let is_name = [b'F', b'A'].contains(&message_type);
        let renamed = String::from_utf8_lossy(&body).replace("vehicle_attitude", "estimator_attitude").into_bytes();
        vec![(message_type, if is_name { renamed } else { body })]
    });
    let [with_attitude, with_estimator] = [px4_log(), renamed].map(|bytes| read_bytes(&bytes).unwrap());
    assert_eq!(
        (with_attitude.fallback_attitude_message, with_estimator.fallback_attitude_message),
        (None, Some("estimator_attitude"))
    );
    assert_eq!(with_attitude.attitude.rows(), with_estimator.attitude.rows());
}

/// Message of the information `key` with a value.
fn information_message(key: &str, value: &[u8]) -> Message {
    (b'I', [&[key.len() as u8], key.as_bytes(), value].concat())
}

/// PX4 appends hard-fault messages after a crash, behind a message that the crash truncated.
#[test]
fn messages_after_a_torn_ulog_cost_only_the_torn_message() {
    let mut bytes = px4_log();
    bytes.truncate(bytes.len() - 10);
    let hard_fault = information_message("char[20] hardfault_plain", &[b'x'; 20]);
    let bytes = with_appended_messages(bytes, &vec![hard_fault; 3]);
    let rows = read_bytes(&bytes).unwrap().compasses[0].field.rows().len();
    assert!(rows >= 299, "{rows}");
}

#[test]
fn a_ulog_of_other_firmware_has_its_name() {
    for (name, firmware) in [("PX4", "PX4 1.15.0"), ("Other autopilot", "Other autopilot")] {
        let key = format!("char[{}] sys_name", name.len());
        let (head, messages) = (px4_log()[..16].to_vec(), &px4_log()[16..]);
        let with_name = with_appended_messages(head, &[information_message(&key, name.as_bytes())]);
        let flight = read_bytes(&[&with_name, messages].concat()).unwrap();
        assert_eq!(flight.firmware_name.as_deref(), Some(firmware));
    }
}

/// Test ratios until 1.10, and since.
#[test]
fn px4s_test_ratios_of_the_magnetometer_are_read() {
    let flight = flight_with_messages(&[
        format_message("estimator_status", "float mag_test_ratio;"),
        format_message("estimator_innovation_test_ratios", "float[3] mag_field;"),
        subscription_message(90, 0, "estimator_status"),
        subscription_message(91, 0, "estimator_innovation_test_ratios"),
        row_message(90, 70_000_000, &[&1.5_f32.to_le_bytes()]),
        row_message(91, 70_100_000, &[&0.1_f32.to_le_bytes(), &2.5_f32.to_le_bytes(), &0.2_f32.to_le_bytes()]),
    ]);
    let ratios: Vec<f32> = flight.magnetometer_test_ratio.rows().iter().map(|row| row.row_values[0]).collect();
    assert_eq!(ratios, [1.5, 2.5]);
}
