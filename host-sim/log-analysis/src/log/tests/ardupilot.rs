use super::*;

/// The flight in DataFlash text.
fn ardupilot_text() -> String {
    String::from_utf8(encode_dataflash_text(&two_compass_recording(&ARDUPILOT_PARAMETERS))).unwrap()
}

/// Before 2017 CURR had integer hundredths of an ampere; before 2015 text and events had no stamp.
#[test]
fn old_ardupilot_formats_are_read() {
    let original = two_compass_recording(&ARDUPILOT_PARAMETERS);
    let expected = |t_s: f64| 10.0 + (t_s - 40.0) / 10.0;
    let mut lines = Vec::new();
    for line in ardupilot_text().lines() {
        let values: Vec<&str> = line.split(", ").collect();
        lines.push(match values[..] {
            ["FMT", .., "BAT", _, _] | ["FMT", _, _, "BAT", ..] => {
                "FMT, 70, 17, CURR, QhhhHfh, TimeUS,Throttle,Volt,Curr,Vcc,CurrTot,Volt2".to_owned()
            }
            ["FMT", _, _, "MSG", ..] => "FMT, 65, 67, MSG, Z, Message\nFMT, 71, 4, EV, B, Id".to_owned(),
            ["BAT", us, _, _, amperes] => {
                format!("CURR, {us}, 300, 1200, {:.0}, 5000, 0, 0", amperes.parse::<f64>().unwrap() * 100.0)
            }
            ["MSG", _, words] => format!("MSG, {words}"),
            _ => line.to_owned(),
        });
    }
    lines.push("EV, 11".to_owned());
    let text = read_bytes(lines.join("\n").as_bytes()).unwrap();
    assert_eq!(text.firmware_name.as_deref(), Some("ArduPlane V4.6.0 (host-sim)"));
    // Disarmed at the last stamp, 69.9 s.
    assert_eq!((text.is_armed(69.8), text.is_armed(69.91)), (Some(true), Some(false)));
    // CURR in a binary log, with an integer column of hundredths of an ampere.
    let mut bytes = encode_dataflash(&original);
    let format = bytes.windows(7).position(|at| at == [0xA3, 0x95, 128, 70, 20, b'B', b'A']).unwrap();
    bytes[format + 5..format + 9].copy_from_slice(b"CURR");
    bytes[format + 12] = b'i';
    for at in (0..=bytes.len() - 20).filter(|&at| bytes[at..at + 3] == [0xA3, 0x95, 70]).collect::<Vec<_>>() {
        let amperes = f32::from_le_bytes(bytes[at + 16..at + 20].try_into().unwrap());
        bytes[at + 16..at + 20].copy_from_slice(&((amperes * 100.0).round() as i32).to_le_bytes());
    }
    for flight in [text, read_bytes(&bytes).unwrap()] {
        for row in flight.battery_current.rows() {
            let error = f64::from(row.row_values[0]) - expected(row.t_s);
            assert!(error.abs() < 0.006, "{:?}: {row:?}", flight.log_format);
        }
        assert_eq!(flight.battery_current.rows().len(), 300);
    }
}

/// Moving baseline: the receiver of the second antenna has the heading, the first the position.
#[test]
fn the_heading_of_a_second_receiver_is_read() {
    let with_yaw = ardupilot_text().replace(
        "QBBIHLLeff, TimeUS,I,Status,GMS,GWk,Lat,Lng,Alt,Spd,GCrs",
        "QBBIHLLefff, \
        TimeUS,I,Status,GMS,GWk,Lat,Lng,Alt,Spd,GCrs,Yaw",
    );
    let second =
        |at_us: u32, status: u8, yaw: f32| format!("GPS, {at_us}, 1, {status}, 0, 2400, 1, 2, 3, 9, 9, {yaw}\n");
    let second = [(69_700_000, 3, 359.0), (69_900_000, 3, 1.0), (70_100_000, 3, 0.0), (70_300_000, 1, 90.0)]
        .map(|(at_us, status, yaw)| second(at_us, status, yaw));
    let [without, with] =
        [with_yaw.clone(), with_yaw + &second.concat()].map(|log| read_bytes(log.as_bytes()).unwrap());
    let yaws = |flight: &LoggedFlight| -> Vec<(i32, f32)> {
        let rows = flight.gps.rows().iter().filter(|row| row.row_values[5].is_finite());
        rows.map(|row| ((row.t_s * 10.0).round() as i32, row.row_values[5])).collect()
    };
    assert_eq!(yaws(&without), []);
    let [(698, yaw_deg)] = yaws(&with)[..] else { panic!("{:?}", yaws(&with)) };
    assert!(yaw_deg.min(360.0 - yaw_deg) < 0.01, "{yaw_deg}");
    let positions =
        |flight: &LoggedFlight| flight.gps.rows().iter().map(|row| (row.t_s, row.row_values[0])).collect::<Vec<_>>();
    assert_eq!(positions(&with), positions(&without));
}

/// Until 2021 arming was a generic event: manual (10) or automatic (15).
#[test]
fn arming_events_give_the_armed_state() {
    let log = ardupilot_text();
    let events = [(72, 10), (74, 11), (76, 15), (78, 25), (80, 11)];
    let events = events.map(|(at_s, id)| format!("EV, {at_s}000000, {id}\n")).concat();
    let flight = read_bytes(format!("{log}FMT, 71, 12, EV, QB, TimeUS,Id\n{events}").as_bytes()).unwrap();
    let armed = [71.0, 73.0, 75.0, 77.0, 79.0, 81.0].map(|t_s| flight.is_armed(t_s).unwrap());
    assert_eq!(armed, [false, true, false, true, true, false]);
}

#[test]
fn only_the_first_of_several_sensors_is_used() {
    let log = ardupilot_text();
    let further_messages = [
        "IMU, 70000000, 1, 9, 9, 9",
        "GPS, 70000000, 1, 3, 0, 2400, 11, 22, 33, 9, 9",
        "BAT, 70000000, 1, 12, 99",
        "MAG, 70000000, 0, 1, 2, 3, 0, 0, 0, 0, 0, 0, 0, 0",
    ];
    let [without, with] =
        [log.clone(), log + &further_messages.join("\n")].map(|log| read_bytes(log.as_bytes()).unwrap());
    let rows = |flight: &LoggedFlight| {
        [
            flight.body_rates.rows().len(),
            flight.gps.rows().len(),
            flight.battery_current.rows().len(),
            flight.compasses[0].field.rows().len(),
        ]
    };
    assert_eq!(rows(&with), rows(&without));
    assert_eq!((without.skipped_counts.rejected_readings, with.skipped_counts.rejected_readings), (0, 1));
}

/// Parameters in which the first two slots are exchanged, and the priorities with them.
fn with_exchanged_slots(parameters: &[(&str, f64)]) -> Vec<(String, f64)> {
    let exchanged = |name: &str| match name.split_at_checked(11) {
        Some((group @ ("COMPASS_OFS" | "COMPASS_DIA" | "COMPASS_ODI" | "COMPASS_MOT"), axis))
            if axis.starts_with('_') =>
        {
            format!("{group}2{axis}")
        }
        _ => match name {
            "COMPASS_SCALE" | "COMPASS_DEV_ID" => format!("{name}2"),
            _ if name.starts_with("COMPASS_PRIO") || name.starts_with("COMPASS_USE") => name.to_owned(),
            _ => name.replace("2_", "_").trim_end_matches('2').to_owned(),
        },
    };
    parameters.iter().map(|(name, value)| (exchanged(name), *value)).collect()
}

/// The same flight, of which the parameters are in other slots: `MAG` and `RAW_IMU` follow the priority.
#[test]
fn a_compass_is_corrected_by_the_parameters_of_its_slot() {
    let original = two_compass_recording(&ARDUPILOT_PARAMETERS);
    let exchanged = with_exchanged_slots(&ARDUPILOT_PARAMETERS);
    let mut text = ardupilot_text();
    for (name, value) in &ARDUPILOT_PARAMETERS {
        text = text.replacen(&format!(", {name}, {value}, "), &format!(", @{name}, {value}, "), 1);
    }
    for ((name, _), (new_name, _)) in ARDUPILOT_PARAMETERS.iter().zip(&exchanged) {
        text = text.replacen(&format!(", @{name},"), &format!(", {new_name},"), 1);
    }
    let expected = read_bytes(&encode_dataflash_text(&original)).unwrap();
    let found = read_bytes(text.as_bytes()).unwrap();
    assert_eq!([&expected, &found].map(|flight| flight.compasses[0].slot), [Ok(1), Ok(2)]);
    assert_eq!(found.parameters.last_value("COMPASS_OFS2_Y"), Some(-60.0));
    for (found, expected) in found.compasses.iter().zip(&expected.compasses) {
        assert_eq!(found.correction, expected.correction);
        assert_eq!(found.field.rows(), expected.field.rows());
        assert_eq!(found.is_used_for_heading, expected.is_used_for_heading);
        assert_eq!(found.device_id, expected.device_id);
    }
    // Priorities as logged, of slots that have other offsets than those in use.
    let contradictory =
        text.replacen(", COMPASS_DEV_ID,", ", @,", 1).replacen(", COMPASS_DEV_ID2,", ", COMPASS_DEV_ID,", 1);
    let contradictory = read_bytes(contradictory.replacen(", @,", ", COMPASS_DEV_ID2,", 1).as_bytes()).unwrap();
    for compass in &contradictory.compasses {
        assert!(
            compass.slot.is_err_and(UnknownSlot::is_contradictory) && compass.correction.is_none(),
            "{:?}",
            compass.slot
        );
        assert!(compass.field.rows().iter().all(|row| raw_ut(row) == logged_ut(row)));
    }
}

/// The test ratio of the filter's first core, and texts about compasses.
#[test]
fn the_autopilots_own_judgement_of_the_magnetometer_is_read() {
    let log = ardupilot_text();
    let rows = "FMT, 90, 21, XKF4, QBf, TimeUS,C,SM\nXKF4, 70000000, 0, 0.4\nXKF4, 70000000, 1, 7\nXKF4, 70100000, 0, 1.5\n\
                MSG, 70200000, EKF3 IMU0 ground mag anomaly, yaw re-aligned\nMSG, 70300000, Throttle armed\n";
    let flight = read_bytes(format!("{log}{rows}").as_bytes()).unwrap();
    let ratios: Vec<f32> = flight.magnetometer_test_ratio.rows().iter().map(|row| row.row_values[0]).collect();
    assert_eq!(ratios, [0.4, 1.5]);
    let texts: Vec<&str> = flight.compass_texts.iter().map(|(_, text)| text.as_str()).collect();
    assert_eq!(texts, ["EKF3 IMU0 ground mag anomaly, yaw re-aligned"]);
}
