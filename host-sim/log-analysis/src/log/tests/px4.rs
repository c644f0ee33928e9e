use super::*;

/// A ULog with each message's body changed by type.
fn with_changed_messages(bytes: &[u8], change: &dyn Fn(u8, Vec<u8>) -> Vec<u8>) -> Vec<u8> {
    let (mut changed_log, mut remaining) = (bytes[..16].to_vec(), &bytes[16..]);
    while let [low, high, kind, after @ ..] = remaining {
        let (body, next) = after.split_at(usize::from(u16::from_le_bytes([*low, *high])));
        let body = change(*kind, body.to_vec());
        changed_log.extend((body.len() as u16).to_le_bytes());
        changed_log.push(*kind);
        changed_log.extend(body);
        remaining = next;
    }
    changed_log
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
    let bytes =
        with_changed_messages(&encode_ulog(&one_compass), &|message_type, body| match (message_type, &body[..]) {
            (b'F', text) if text.starts_with(b"vehicle_magnetometer") => renamed(
                text,
                [
                    ("vehicle_magnetometer", "sensor_combined"),
                    ("uint32_t device_id", "int32_t magnetometer_timestamp_relative"),
                ],
            ),
            (b'F', text) if text.starts_with(b"vehicle_angular") => {
                renamed(text, [("vehicle_angular_velocity", "sensor_combined_of_rates"), ("xyz", "gyro_rad")])
            }
            (b'A', text) => {
                renamed(text, [("vehicle_magnetometer", "sensor_combined"), ("vehicle_angular_velocity", "none")])
            }
            // The field was measured 20 ms before the row's time.
            (b'D', [0, 0, rest @ ..]) => [&[0, 0], &rest[..8], &(-20_000_i32).to_le_bytes(), &rest[12..]].concat(),
            _ => body,
        });
    let flight = read_bytes(&bytes).unwrap();
    let rows = flight.compasses[0].field.rows();
    assert_eq!((flight.compasses.len(), rows.len()), (1, 300));
    for (row, sample) in rows.iter().zip(&one_compass.samples) {
        let raw = Vector3::new(row.row_values[0], row.row_values[1], row.row_values[2]).map(f64::from);
        assert!((raw - Vector3::from(sample.field_ut[0])).norm() < 0.001, "{row:?}");
        assert!((row.t_s + 0.02 - sample.time_us as f64 / 1e6).abs() < 1e-6, "{row:?}");
    }
}

/// 20 insertions of 3 KB, in which message headers occur by chance. A sample has six messages, so each insertion costs
/// at most one sample.
#[test]
fn noise_in_a_ulog_costs_at_most_one_sample_each() {
    let mut bytes = encode_ulog(&two_compass_recording(&PX4_PARAMETERS));
    let mut random = Random(7);
    for insertion in (1..=20).rev() {
        let offset = bytes.len() / 40 + bytes.len() * insertion / 22;
        let noise: Vec<u8> = random.bytes(3000);
        bytes.splice(offset..offset, noise);
    }
    let rows = read_bytes(&bytes).unwrap().compasses[0].field.rows().len();
    assert!((300 - 20..=300).contains(&rows), "{rows}");
}

fn with_appended_messages(mut bytes: Vec<u8>, messages: &[(u8, Vec<u8>)]) -> Vec<u8> {
    for (message_type, body) in messages {
        bytes.extend((body.len() as u16).to_le_bytes());
        bytes.push(*message_type);
        bytes.extend(body);
    }
    bytes
}

/// Message that subscribes a message id to an instance of a topic.
fn subscription_message(message_id: u8, instance: u8, topic: &str) -> (u8, Vec<u8>) {
    (b'A', [&[instance, message_id, 0], topic.as_bytes()].concat())
}

fn row_message(message_id: u8, at_us: u64, values: &[&[u8]]) -> (u8, Vec<u8>) {
    (b'D', [&[message_id, 0][..], &at_us.to_le_bytes(), &values.concat()].concat())
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
    let messages = [
        subscription_message(90, 0, "battery_status"),
        subscription_message(91, 1, "battery_status"),
        row_message(90, 70_000_000, &[&current(33.0)]),
        row_message(91, 70_100_000, &[&current(2.0)]),
    ];
    let flight =
        read_bytes(&with_appended_messages(encode_ulog(&two_compass_recording(&PX4_PARAMETERS)), &messages)).unwrap();
    assert_eq!(flight.battery_current.rows().len(), 301);
    assert_eq!(flight.battery_current.rows().last().unwrap().row_values.map(f32::to_bits), [33.0_f32.to_bits()]);
}

/// The column names since 1.14, without velocity components; a 2D fix and a second receiver are ignored.
#[test]
fn gps_columns_are_read_by_their_new_names() {
    let format = "vehicle_gps_position:uint64_t timestamp;double latitude_deg;double longitude_deg;double altitude_msl_m;\
                  float vel_m_s;float cog_rad;float heading;uint8_t fix_type;";
    let fix = |at_us: u64, fix_type: u8| {
        let position_bytes = [48.0_f64, 11.3, 500.0].map(f64::to_le_bytes).concat();
        let speed_and_course = [12.0_f32, 0.5, 1.5].map(f32::to_le_bytes).concat();
        row_message(90, at_us, &[&position_bytes, &speed_and_course, &[fix_type]])
    };
    let mut original = two_compass_recording(&PX4_PARAMETERS);
    original.start_position = None;
    let second = (b'D', [&[91, 0], &fix(70_400_000, 3).1[2..]].concat());
    let messages = [
        (b'F', format.as_bytes().to_vec()),
        subscription_message(90, 0, "vehicle_gps_position"),
        subscription_message(91, 1, "vehicle_gps_position"),
        fix(70_000_000, 2),
        fix(70_200_000, 3),
        second,
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
        let messages = [subscription_message(90, 0, "vehicle_status"), row_message(90, 70_000_000, &[&[1, is_vtol]])];
        let flight =
            read_bytes(&with_appended_messages(encode_ulog(&two_compass_recording(&PX4_PARAMETERS)), &messages))
                .unwrap();
        assert_eq!(flight.is_copter, is_copter);
    }
}

/// `arming_state` 2 means armed.
#[test]
fn an_arming_state_is_read() {
    let format = "vehicle_status:uint64_t timestamp;uint8_t arming_state;";
    let states = [(70, 1), (71, 2), (72, 5), (73, 2), (74, 3)];
    let mut messages = vec![(b'F', format.as_bytes().to_vec()), subscription_message(90, 0, "vehicle_status")];
    messages.extend(states.map(|(at_s, state)| row_message(90, at_s * 1_000_000, &[&[state]])));
    let flight =
        read_bytes(&with_appended_messages(encode_ulog(&two_compass_recording(&PX4_PARAMETERS)), &messages)).unwrap();
    let armed = [70.5, 71.5, 72.5, 73.5, 74.5].map(|t_s| flight.is_armed(t_s).unwrap());
    assert_eq!(armed, [false, true, false, true, false]);
}

#[test]
fn a_sample_has_its_timestamp_sample() {
    let format = "vehicle_angular_velocity:uint64_t timestamp;uint64_t timestamp_sample;float[3] xyz;";
    let rates = [0.1_f32, 0.2, 0.3].map(f32::to_le_bytes).concat();
    let messages = [
        (b'F', format.as_bytes().to_vec()),
        subscription_message(90, 0, "vehicle_angular_velocity"),
        row_message(90, 70_100_000, &[&70_060_000_u64.to_le_bytes(), &rates]),
    ];
    let flight =
        read_bytes(&with_appended_messages(encode_ulog(&two_compass_recording(&PX4_PARAMETERS)), &messages)).unwrap();
    let last = flight.body_rates.rows().last().unwrap();
    assert!((last.t_s - 70.06).abs() < 1e-6, "{last:?}");
}

/// Before 1.11 `sensor_mag` was corrected by the driver.
#[test]
fn sensor_mag_is_raw_since_1_11() {
    let empty_recording = FlightRecording { samples: Vec::new(), ..two_compass_recording(&PX4_PARAMETERS) };
    let format = "sensor_mag:uint64_t timestamp;uint32_t device_id;float x;float y;float z;";
    let gauss = [0.2_f32, -0.1, 0.4].map(f32::to_le_bytes).concat();
    let level_quaternion = [1.0_f32, 0.0, 0.0, 0.0].map(f32::to_le_bytes).concat();
    let messages = [
        (b'F', format.as_bytes().to_vec()),
        subscription_message(90, 0, "sensor_mag"),
        subscription_message(91, 0, "vehicle_attitude"),
        row_message(91, 70_000_000, &[&level_quaternion]),
        row_message(90, 70_100_000, &[&396_809_u32.to_le_bytes(), &gauss]),
    ];
    for (minor, is_raw) in [(10, false), (11, true)] {
        let bytes = with_changed_messages(&encode_ulog(&empty_recording), &|message_type, body| {
            let version = body.windows(4).position(|bytes| bytes == [255, 0, 15, 1]).filter(|_| message_type == b'I');
            version.map_or_else(|| body.clone(), |at| [&body[..at], &[255, 0, minor, 1]].concat())
        });
        let flight = read_bytes(&with_appended_messages(bytes, &messages));
        if !is_raw {
            assert!(matches!(flight, Err(LogError::NoMagnetometer(LogFormat::ULog, 0))), "1.{minor}");
            continue;
        }
        // Turned by 90 deg: the sensor's y is the body's -x.
        let flight = flight.unwrap();
        let [row] = flight.compasses[0].field.rows() else { panic!("{:?}", flight.compasses) };
        assert!((row.row_values[0] - 10.0).abs() < 1e-4 && (row.row_values[1] - 20.0).abs() < 1e-4, "{row:?}");
    }
}

/// `sensor_mag` of the first compass is added in one sample of `stride`.
fn with_sensor_mag(recording: &FlightRecording, stride: usize) -> Vec<u8> {
    const SENSOR_MAG_ID: [u8; 2] = [60, 0];
    let (mut changed_log, bytes) = (Vec::new(), encode_ulog(recording));
    let (mut remaining, mut rows) = (&bytes[16..], 0);
    changed_log.extend(&bytes[..16]);
    let mut write = |kind: u8, body: &[u8]| {
        changed_log.extend((body.len() as u16).to_le_bytes());
        changed_log.push(kind);
        changed_log.extend(body);
    };
    write(b'F', b"sensor_mag:uint64_t timestamp;uint32_t device_id;float x;float y;float z;");
    while let [low, high, kind, after @ ..] = remaining {
        let (body, next) = after.split_at(usize::from(u16::from_le_bytes([*low, *high])));
        write(*kind, body);
        if *kind == b'A' && body[1] == 0 {
            write(b'A', &[&[0], &SENSOR_MAG_ID[..], b"sensor_mag"].concat());
        }
        if *kind == b'D' && body[..2] == [0, 0] {
            if rows % stride == 0 {
                let gauss = recording.samples[rows].field_ut[0].map(|axis| ((axis / 100.0) as f32).to_le_bytes());
                write(b'D', &[&SENSOR_MAG_ID, &body[2..14], gauss.as_flattened()].concat());
            }
            rows += 1;
        }
        remaining = next;
    }
    changed_log
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
            let [raw, logged] = [
                [row.row_values[0], row.row_values[1], row.row_values[2]],
                [row.row_values[3], row.row_values[4], row.row_values[5]],
            ];
            let original = Vector3::from(sample.field_ut[0]);
            assert!((Vector3::from(raw).map(f64::from) - original).norm() < 0.001, "1 of {stride}: {row:?}");
            let corrected = Vector3::new(original.x - 12.0, original.y * 1.1, original.z);
            assert!((Vector3::from(logged).map(f64::from) - corrected).norm() < 0.001, "1 of {stride}: {row:?}");
        }
    }
}

#[test]
fn an_estimator_attitude_replaces_a_missing_one() {
    let renamed =
        with_changed_messages(&encode_ulog(&two_compass_recording(&PX4_PARAMETERS)), &|message_type, body| {
            match message_type {
                b'F' | b'A' => {
                    String::from_utf8_lossy(&body).replace("vehicle_attitude", "estimator_attitude").into_bytes()
                }
                _ => body,
            }
        });
    let [with_attitude, with_estimator] =
        [encode_ulog(&two_compass_recording(&PX4_PARAMETERS)), renamed].map(|bytes| read_bytes(&bytes).unwrap());
    assert_eq!(
        (with_attitude.fallback_attitude_message, with_estimator.fallback_attitude_message),
        (None, Some("estimator_attitude"))
    );
    assert_eq!(with_attitude.attitude.rows(), with_estimator.attitude.rows());
}

/// PX4 appends hard-fault messages after a crash, behind a message that the crash truncated.
#[test]
fn messages_after_a_torn_ulog_cost_only_the_torn_message() {
    let mut bytes = encode_ulog(&two_compass_recording(&PX4_PARAMETERS));
    bytes.truncate(bytes.len() - 10);
    let torn_message =
        [&[b"char[20] hardfault_plain".len() as u8], &b"char[20] hardfault_plain"[..], &[b'x'; 20]].concat();
    for _ in 0..3 {
        bytes.extend((torn_message.len() as u16).to_le_bytes());
        bytes.push(b'I');
        bytes.extend(&torn_message);
    }
    let rows = read_bytes(&bytes).unwrap().compasses[0].field.rows().len();
    assert!(rows >= 299, "{rows}");
}

#[test]
fn a_ulog_of_other_firmware_has_its_name() {
    for (name, firmware) in [("PX4", "PX4 1.15.0"), ("Other autopilot", "Other autopilot")] {
        let key = format!("char[{}] sys_name", name.len());
        let body = [&[key.len() as u8], key.as_bytes(), name.as_bytes()].concat();
        let message = [&(body.len() as u16).to_le_bytes()[..], b"I", &body].concat();
        let mut bytes = encode_ulog(&two_compass_recording(&PX4_PARAMETERS));
        bytes.splice(16..16, message);
        assert_eq!(read_bytes(&bytes).unwrap().firmware_name.as_deref(), Some(firmware));
    }
}
