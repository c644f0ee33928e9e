//! Logs of which each topic is a table of its own.

use std::fmt::Write as _;

use nalgebra::UnitQuaternion;

use super::*;

/// Tables as `ulog2csv` writes them, of the second compass and of the attitude, with a damaged line each.
fn topic_tables(log_name: &str) -> Vec<(String, String)> {
    let mut magnetometer = "timestamp,device_id,magnetometer_ga[0],magnetometer_ga[1],magnetometer_ga[2]\n".to_owned();
    let mut attitude = "timestamp,q[0],q[1],q[2],q[3],quat_reset_counter\n".to_owned();
    for sample in two_compass_recording(&[]).samples {
        let [x, y, z] = sample.field_ut[1].map(|ut| ut / 100.0);
        let [roll, pitch, yaw] = sample.attitude_rad;
        let q = UnitQuaternion::from_euler_angles(roll, pitch, yaw);
        writeln!(magnetometer, "{},7,{x},{y},{z}", sample.time_us).unwrap();
        writeln!(attitude, "{},{},{},{},{},0", sample.time_us, q.w, q.i, q.j, q.k).unwrap();
    }
    let table = |topic: &str, text: String| (format!("{log_name}_{topic}_0.csv"), text + "-,#\n");
    vec![table("vehicle_attitude", attitude), table("vehicle_magnetometer", magnetometer)]
}

/// Tables of a phone that turns about the vertical, twenty rows a second.
fn sensor_tables() -> Vec<(String, String)> {
    let table = |name: &str, numbers: &dyn Fn(&FlightSample) -> [f64; 3]| {
        let rows = two_compass_recording(&[]).samples.into_iter().map(|sample| {
            let [x, y, z] = numbers(&sample);
            format!("1,{},{z},{y},{x}\n", sample.time_us as f64 / 2e6)
        });
        (format!("{name}.csv"), rows.fold("time,seconds_elapsed,z,y,x\n".to_owned(), |text, row| text + &row))
    };
    vec![
        table("Gyroscope", &|_| [0.0, 0.0, -0.3]),
        table("Gravity", &|_| [0.0, 0.0, 9.8]),
        table("Magnetometer", &|sample| sample.field_ut[0]),
    ]
}

pub(super) fn tables_of_each_recorder() -> [Vec<(String, String)>; 2] {
    [topic_tables("a"), sensor_tables()]
}

/// The only log of the tables.
pub(super) fn read_tables(files: &[(&str, &[u8])]) -> Result<LoggedFlight, LogError> {
    let mut visit_files = |visit: &mut EntryVisitor<'_>| {
        files.iter().try_for_each(|(name, bytes)| visit((*name).to_owned(), &mut &**bytes))
    };
    only_flight(&mut |visit| visit_folder(&mut visit_files, FieldUnit::Milligauss, visit))
}

/// The parameters are not among the tables, so that the field stays as logged, and none are written.
#[test]
fn the_tables_of_ulog2csv_are_one_log() {
    let files = ["days/first", "days/second"].iter().flat_map(|name| topic_tables(name));
    let unread = [("days/second_cpuload_0.csv".to_owned(), "timestamp,load\n1,0.5\n".to_owned())];
    let files: Vec<_> = files.chain(unread).collect();
    let entries: Vec<_> = files.iter().map(|(name, text)| (name.as_str(), text.as_bytes())).collect();
    let expected = read_bytes(&encode_ulog(&two_compass_recording(&[]))).unwrap();
    let mut names = Vec::new();
    let bytes = archive::archive(&entries, archive::Packing::Deflated);
    visit_flights(&mut bytes.as_slice(), FieldUnit::Milligauss, None, &mut |name, flight| {
        let flight = flight.unwrap();
        names.push(name.to_owned());
        assert_eq!(flight.log_format, LogFormat::ULog);
        assert_eq!(flight.compasses[0].slot, Err(UnknownSlot::NotInTables));
        for (row, sample) in flight.compasses[0].field.rows().iter().zip(&two_compass_recording(&[]).samples) {
            assert!((logged_ut(row) - Vector3::from(sample.field_ut[1])).norm() < 0.001);
        }
        let [rows, expected_rows] = [&flight, &expected].map(|flight| flight.attitude.rows());
        assert_eq!(rows.len(), expected_rows.len());
        for (row, expected) in rows.iter().zip(expected_rows) {
            assert!((Vector3::from(row.row_values) - Vector3::from(expected.row_values)).norm() < 1e-4);
        }
    })
    .unwrap();
    assert_eq!(names, ["days/first", "days/second"]);
}
