//! PX4's logs through the years, and as it logs several compasses.

use super::*;

/// The messages of a ULog, changed: kind and body.
fn ulog_with(bytes: &[u8], change: &dyn Fn(u8, Vec<u8>) -> Vec<u8>) -> Vec<u8> {
    let (mut out, mut rest) = (bytes[..16].to_vec(), &bytes[16..]);
    while let [low, high, kind, after @ ..] = rest {
        let (body, next) = after.split_at(usize::from(u16::from_le_bytes([*low, *high])));
        let body = change(*kind, body.to_vec());
        out.extend((body.len() as u16).to_le_bytes());
        out.push(*kind);
        out.extend(body);
        rest = next;
    }
    out
}

/// Until 1.8 PX4 logged its field and its rates in `sensor_combined` alone: the field is that of the instant that it tells.
#[test]
fn px4s_old_sensor_combined_is_read() {
    let renamed = |body: &[u8], pairs: [(&str, &str); 2]| {
        let text = String::from_utf8_lossy(body).into_owned();
        pairs.iter().fold(text, |text, (old, new)| text.replace(old, new)).into_bytes()
    };
    let mut one = recording(&PX4);
    one.instants.iter_mut().for_each(|instant| instant.field_ut.truncate(1));
    let bytes = ulog_with(&ulog(&one), &|kind, body| match (kind, &body[..]) {
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
        // Measured 20 ms before.
        (b'D', [0, 0, rest @ ..]) => [&[0, 0], &rest[..8], &(-20_000_i32).to_le_bytes(), &rest[12..]].concat(),
        _ => body,
    });
    let flight = read_bytes(&bytes).unwrap();
    let rows = flight.compasses[0].field.rows();
    assert_eq!((flight.compasses.len(), rows.len()), (1, 300));
    for (row, instant) in rows.iter().zip(&one.instants) {
        let raw = Vector3::new(row.of[0], row.of[1], row.of[2]).map(f64::from);
        assert!((raw - Vector3::from(instant.field_ut[0])).norm() < 0.001, "{row:?}");
        assert!((row.t_s + 0.02 - (instant.at_us as f64 / 1e6 - 40.0)).abs() < 1e-6, "{row:?}");
    }
}

/// Noise of some kilobytes in twenty places, in which headers of long messages stand by chance: each costs itself and
/// the messages that it tears, of six an instant, so an instant at most.
#[test]
fn noise_in_a_ulog_costs_itself() {
    let mut bytes = ulog(&recording(&PX4));
    let mut random = Random::new(7, Purpose::Damage);
    for part in (1..=20).rev() {
        let at = bytes.len() / 40 + bytes.len() * part / 22;
        let noise: Vec<u8> = (0..3000).map(|_| random.uniform(0.0, 256.0) as u8).collect();
        bytes.splice(at..at, noise);
    }
    let rows = read_bytes(&bytes).unwrap().compasses[0].field.rows().len();
    assert!((300 - 20..=300).contains(&rows), "{rows}");
}

/// The same log with `sensor_mag` of the first compass beside it, every so manyeth row: its field as it is measured.
fn with_sensor_mag(one: &Recording, every: usize) -> Vec<u8> {
    const TOPIC: [u8; 2] = [60, 0];
    let (mut out, bytes) = (Vec::new(), ulog(one));
    let (mut rest, mut rows) = (&bytes[16..], 0);
    out.extend(&bytes[..16]);
    let mut write = |kind: u8, body: &[u8]| {
        out.extend((body.len() as u16).to_le_bytes());
        out.push(kind);
        out.extend(body);
    };
    write(b'F', b"sensor_mag:uint64_t timestamp;uint32_t device_id;float x;float y;float z;");
    while let [low, high, kind, after @ ..] = rest {
        let (body, next) = after.split_at(usize::from(u16::from_le_bytes([*low, *high])));
        write(*kind, body);
        if *kind == b'A' && body[1] == 0 {
            write(b'A', &[&[0], &TOPIC[..], b"sensor_mag"].concat());
        }
        if *kind == b'D' && body[..2] == [0, 0] {
            if rows % every == 0 {
                let gauss = one.instants[rows].field_ut[0].map(|axis| ((axis / 100.0) as f32).to_le_bytes());
                // What stands there is stamp and device.
                write(b'D', &[&TOPIC, &body[2..14], gauss.as_flattened()].concat());
            }
            rows += 1;
        }
        rest = next;
    }
    out
}

/// PX4 logs `sensor_mag` once a second unless it is told otherwise, and the corrected field oftener: what tells more of a
/// flight is read, with its correction undone, and of two that come as often the one without.
#[test]
fn of_raw_and_corrected_field_that_which_comes_oftener_is_read() {
    let parameters = [("CAL_MAG0_ID", 396_809.0), ("CAL_MAG0_XOFF", 0.12), ("CAL_MAG0_YSCALE", 1.1)];
    let mut one = recording(&parameters);
    one.instants.iter_mut().for_each(|instant| instant.field_ut.truncate(1));
    for every in [1, 10] {
        let flight = read_bytes(&with_sensor_mag(&one, every)).unwrap();
        let [compass] = flight.compasses.as_slice() else { panic!("one compass") };
        assert_eq!(compass.field.rows().len(), 300, "1 of {every}");
        for (row, instant) in compass.field.rows().iter().zip(&one.instants) {
            let [raw, logged] = [[row.of[0], row.of[1], row.of[2]], [row.of[3], row.of[4], row.of[5]]];
            let original = Vector3::from(instant.field_ut[0]);
            assert!((Vector3::from(raw).map(f64::from) - original).norm() < 0.001, "1 of {every}: {row:?}");
            let corrected = Vector3::new(original.x - 12.0, original.y * 1.1, original.z);
            assert!((Vector3::from(logged).map(f64::from) - corrected).norm() < 0.001, "1 of {every}: {row:?}");
        }
    }
}

/// A log of a filter that is not the one in use stands in where `vehicle_attitude` is not logged.
#[test]
fn an_estimators_attitude_stands_in() {
    let renamed = ulog_with(&ulog(&recording(&PX4)), &|kind, body| match kind {
        b'F' | b'A' => String::from_utf8_lossy(&body).replace("vehicle_attitude", "estimator_attitude").into_bytes(),
        _ => body,
    });
    let [own, other] = [ulog(&recording(&PX4)), renamed].map(|bytes| read_bytes(&bytes).unwrap());
    assert_eq!((own.attitude_from, other.attitude_from), (None, Some("estimator_attitude")));
    assert_eq!(own.attitude.rows(), other.attitude.rows());
}

/// After a crash the autopilot appends what it knows of it: the last message may be torn, and words follow.
#[test]
fn what_is_appended_to_a_torn_ulog_costs_the_torn_message() {
    let mut bytes = ulog(&recording(&PX4));
    bytes.truncate(bytes.len() - 10);
    let words = [&[b"char[20] hardfault_plain".len() as u8], &b"char[20] hardfault_plain"[..], &[b'x'; 20]].concat();
    for _ in 0..3 {
        bytes.extend((words.len() as u16).to_le_bytes());
        bytes.push(b'I');
        bytes.extend(&words);
    }
    let rows = read_bytes(&bytes).unwrap().compasses[0].field.rows().len();
    assert!(rows >= 299, "{rows}");
}
