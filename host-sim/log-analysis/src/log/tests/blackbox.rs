//! What the blackbox has beside the flight that all formats share.

use super::*;

/// Fields of the main frames in the order of INAV, with the units of `blackbox_decode`.
const DECODED_HEADER: &str = "loopIteration, time (us), vbat (V), amperage (A), magADC[0], magADC[1], magADC[2], gyroADC[0], \
     gyroADC[1], gyroADC[2], attitude[0], attitude[1], attitude[2]";

fn visited(bytes: &[u8]) -> Vec<(String, Result<LoggedFlight, String>)> {
    let (mut source, mut flights) = (bytes, Vec::new());
    visit_unchecked(&mut source, (FieldUnit::Milligauss, None), &mut |name, flight| {
        flights.push((name.to_owned(), flight.map_err(|error| error.to_string())));
    })
    .unwrap();
    flights
}

/// A dump of the flash: three flights, the end of the second and the space after each erased.
#[test]
fn each_flight_of_a_blackbox_is_a_log() {
    let flight = encode_blackbox(&two_compass_recording(&[]));
    let erased = [0xFF; 5000];
    let torn = &flight[..flight.len() / 2];
    let flights = visited(&[&flight, &erased[..], torn, &erased[..], &flight].concat());
    let names: Vec<&str> = flights.iter().map(|(name, _)| name.as_str()).collect();
    assert_eq!(names, ["flight 1", "flight 2", "flight 3"]);
    let rows = flights.iter().map(|(_, flight)| flight.as_ref().unwrap().compasses[0].field.rows().len());
    let rows: Vec<usize> = rows.collect();
    assert!(rows[0] == 300 && rows[2] == 300 && (100..200).contains(&rows[1]), "{rows:?}");
    assert!(flights.iter().all(|(_, flight)| flight.as_ref().unwrap().skipped_counts.garbage < 60));
    assert!(matches!(read_bytes(&[&flight, &flight[..]].concat()), Err(LogError::SeveralLogs(_))));
}

/// Frames are differences from those before, without checksums: a changed number stays until the next I frame, of eight;
/// after a lost byte no frame is read until then.
#[test]
fn damage_changes_rows_until_the_next_i_frame_at_most() {
    let bytes = encode_blackbox(&two_compass_recording(&[]));
    let flight_of = |bytes: &[u8]| read_bytes(bytes).unwrap();
    let attitudes =
        |flight: &LoggedFlight| -> Vec<[f32; 3]> { flight.attitude.rows().iter().map(|row| row.row_values).collect() };
    let undamaged = attitudes(&flight_of(&bytes));
    let mut random = Random(3);
    for is_lost in [[false; 100], [true; 100]].concat() {
        let mut damaged = bytes.clone();
        let offset = bytes.len() / 2 + random.bits() as usize % (bytes.len() / 2);
        if is_lost {
            damaged.remove(offset);
        } else {
            damaged[offset] ^= 1 << (random.bits() % 8);
        }
        let flight = flight_of(&damaged);
        let rows = attitudes(&flight);
        let changed_count = rows.iter().filter(|row| !undamaged.contains(row)).count();
        let is_kept = rows.len() + 8 >= undamaged.len() && flight.skipped_counts.restarts == 0;
        assert!(is_kept && changed_count <= if is_lost { 2 } else { 8 }, "{is_lost} {changed_count} {}", rows.len());
    }
}

#[test]
fn a_decoded_blackbox_is_read_like_the_log() {
    let recording = two_compass_recording(&[]);
    let mut text = format!("{DECODED_HEADER}\n");
    for (index, sample) in recording.samples.iter().enumerate() {
        let [x, y, z] = sample.field_ut[0].map(|axis| axis * 20.0);
        let [p, q, r] = sample.rates_rad_s.map(f64::to_degrees);
        let [roll, pitch, yaw] = sample.attitude_rad.map(|angle| angle.to_degrees() * 10.0);
        let numbers = [15.1, sample.current_a, x, -y, -z, p, -q, -r, roll, -pitch, yaw];
        let numbers: Vec<String> = numbers.iter().map(|number| format!("{number:.3}")).collect();
        text.extend([format!("{index}, {}, ", sample.time_us), numbers.join(", "), "\n".to_owned()]);
    }
    let flight = read_bytes(text.as_bytes()).unwrap();
    let (row, sample) = (&flight.compasses[0].field.rows()[100], &recording.samples[100]);
    assert!((raw_ut(row) - Vector3::from(sample.field_ut[0])).norm() < 0.1, "{row:?} {:?}", sample.field_ut);
    assert!((f64::from(flight.attitude.rows()[100].row_values[1]) - sample.attitude_rad[1]).abs() < 1e-4);
    assert!((f64::from(flight.body_rates.rows()[100].row_values[2]) - 0.3).abs() < 1e-4);
    assert!((f64::from(flight.battery_current.rows()[100].row_values[0]) - sample.current_a).abs() < 1e-3);
}

#[test]
fn what_a_blackbox_lacks_is_named_with_the_setting_that_logs_it() {
    let text = String::from_utf8_lossy(&encode_blackbox(&two_compass_recording(&[]))).into_owned();
    let header = text.split("\nI").next().unwrap_or_default();
    for (field, command) in [("magADC", "`blackbox MAG`"), ("attitude", "`blackbox ATTI`")] {
        let mut bytes = encode_blackbox(&two_compass_recording(&[]));
        let names = bytes.windows(field.len()).enumerate().filter(|(_, bytes)| *bytes == field.as_bytes());
        let offsets: Vec<usize> = names.map(|(offset, _)| offset).filter(|offset| *offset < header.len()).collect();
        for offset in offsets {
            bytes[offset] = b'x';
        }
        let error = read_bytes(&bytes).unwrap_err().to_string();
        assert!(error.contains(command), "{error}");
    }
}
