//! The same flight in every format, whole, damaged, and as bytes that nobody wrote.

mod px4;

use nalgebra::Vector3;

use super::csv::Unit;
use super::write::{Instant, Recording, csv, dataflash, dataflash_text, tlog, ulog};
use super::*;
use crate::random::{Purpose, Random};
use crate::world::rotation::Euler;

/// ArduPilot's parameters of two compasses, all of a kind that is undone.
const ARDUPILOT: [(&str, f64); 18] = [
    ("COMPASS_OFS_X", 120.0),
    ("COMPASS_OFS_Y", -60.0),
    ("COMPASS_OFS_Z", 35.0),
    ("COMPASS_DIA_X", 1.1),
    ("COMPASS_DIA_Y", 0.95),
    ("COMPASS_DIA_Z", 1.02),
    ("COMPASS_ODI_X", 0.04),
    ("COMPASS_ODI_Y", -0.03),
    ("COMPASS_ODI_Z", 0.02),
    ("COMPASS_SCALE", 1.2),
    ("COMPASS_MOTCT", 2.0),
    ("COMPASS_MOT_X", 3.0),
    ("COMPASS_MOT_Z", -2.0),
    ("COMPASS_USE", 1.0),
    ("COMPASS_USE2", 0.0),
    ("COMPASS_OFS2_X", -40.0),
    ("COMPASS_DIA2_X", 0.0),
    ("COMPASS_SCALE2", 0.0),
];

const PX4: [(&str, f64); 9] = [
    ("CAL_MAG0_ID", 396_809.0),
    ("CAL_MAG1_ID", 263_202.0),
    ("CAL_MAG0_ROT", 2.0),
    ("CAL_MAG0_XOFF", 0.12),
    ("CAL_MAG0_YOFF", -0.05),
    ("CAL_MAG0_ZSCALE", 1.1),
    ("CAL_MAG0_XODIAG", 0.05),
    ("CAL_MAG1_ROT", -1.0),
    ("SENS_BOARD_ROT", 4.0),
];

/// Half a minute of a turn with two compasses, the second with other iron.
fn recording(parameters: &[(&str, f64)]) -> Recording {
    let instants = (0..300_u64).map(|i| {
        let t_s = i as f64 / 10.0;
        let (roll, pitch, yaw) = (0.4 * (t_s / 3.0).sin(), 0.1 * (t_s / 2.0).cos(), (t_s / 4.0).sin() * 3.0);
        let euler = Euler { roll_rad: roll, pitch_rad: pitch, heading_rad: yaw };
        let field = euler.field(50.0, 1.1);
        let second = Vector3::new(field.x * 1.1 + 10.0, field.y, field.z - 20.0);
        Instant {
            at_us: 40_000_000 + i * 100_000,
            field_ut: vec![field.into(), second.into()],
            attitude_rad: [roll, pitch, yaw],
            rates_rad_s: [0.1, -0.2, 0.3],
            heading_rad: yaw,
            velocity_m_s: [-9.0, -12.0],
            moved_m: [0.0; 2],
            current_a: 10.0 + t_s / 10.0,
            is_armed: true,
        }
    });
    Recording {
        instants: instants.collect(),
        parameters: parameters.iter().map(|(name, value)| ((*name).to_owned(), *value)).collect(),
        place: Some([48.0, 11.3, 500.0]),
        declination_deg: 0.0,
        is_copter: false,
        age_s: 0.0,
    }
}

/// The flight in each format, and how exactly its field is logged, microtesla.
fn each() -> [(Format, Vec<u8>, f64); 5] {
    let (ardupilot, px4) = (recording(&ARDUPILOT), recording(&PX4));
    [
        (Format::DataFlash, dataflash(&ardupilot), 0.12),
        (Format::DataFlashText, dataflash_text(&ardupilot), 0.12),
        (Format::TLog, tlog(&ardupilot), 0.12),
        (Format::ULog, ulog(&px4), 0.001),
        (Format::Csv, csv(&ardupilot), 0.01),
    ]
}

fn read_bytes(bytes: &[u8]) -> Result<Flight, LogError> {
    let mut source = bytes;
    read(&mut source, Unit::Milligauss)
}

/// Whatever the format, and whatever the autopilot had applied: the raw field in body axes, attitude, rates, current, place.
#[test]
fn every_format_gives_the_raw_field_in_body_axes() {
    let original = recording(&[]);
    for (format, bytes, exactly_ut) in each() {
        let flight = read_bytes(&bytes).unwrap();
        assert_eq!(flight.format, format);
        let compasses = if format == Format::Csv { 1 } else { 2 };
        assert_eq!(flight.compasses.iter().map(|c| c.number).collect::<Vec<_>>(), [1, 2][..compasses], "{format:?}");
        for (index, compass) in flight.compasses.iter().enumerate() {
            // Before its first heartbeat nothing of a link is believed.
            let late = original.instants.len() - compass.field.rows().len();
            assert!(late <= 1, "{format:?}: {late}");
            for (row, instant) in compass.field.rows().iter().zip(&original.instants[late..]) {
                let raw = Vector3::new(row.of[0], row.of[1], row.of[2]).map(f64::from);
                let off_ut = (raw - Vector3::from(instant.field_ut[index])).norm();
                // The autopilot's matrix undone makes a count more or less than it was.
                assert!(off_ut < exactly_ut * 1.5, "{format:?} compass {}: {off_ut} uT at {}", index + 1, row.t_s);
            }
        }
        let (row, instant) = (&flight.attitude.rows()[100], &original.instants[100]);
        let [roll, pitch, yaw] = instant.attitude_rad;
        assert!(
            (f64::from(row.of[0]) - roll).abs() < 2e-4 && (f64::from(row.of[1]) - pitch).abs() < 2e-4,
            "{format:?}"
        );
        assert!(format == Format::Csv || (f64::from(row.of[2]) - yaw).abs() < 2e-4, "{format:?}");
        let rates = flight.rates.at(row.t_s, 1.0).unwrap();
        assert!(
            rates.iter().zip([0.1, -0.2, 0.3]).all(|(rate, expected)| (rate - expected).abs() < 1e-4),
            "{format:?}"
        );
        let [current] = flight.current.held_at(row.t_s, 2.0).unwrap();
        assert!((f64::from(current) - instant.current_a).abs() < 0.1, "{format:?}: {current}");
        let gps = Gps::from_columns(flight.gps.rows()[5].of);
        assert!((gps.latitude_deg - 48.0).abs() < 1e-4 && (gps.height_m - 500.0).abs() < 0.1, "{format:?}: {gps:?}");
        let over_ground = [gps.speed_m_s, gps.course_deg.rem_euclid(360.0)];
        let is_right = (over_ground[0] - 15.0).abs() < 0.01 && (over_ground[1] - 233.13).abs() < 0.01;
        assert!(is_right, "{format:?}: {gps:?}");
        assert_eq!(flight.counts, Counts::default(), "{format:?}");
        assert!(!flight.is_copter, "{format:?}");
        assert!(flight.truth.is_empty() || format == Format::Csv);
    }
}

#[test]
fn what_the_autopilot_says_of_itself_is_told() {
    let flights = each().map(|(_, bytes, _)| read_bytes(&bytes).unwrap());
    let [bin, text, link, px4, table] = flights;
    for flight in [&bin, &text] {
        assert_eq!(flight.firmware.as_deref(), Some("ArduPlane V4.6.0 (host-sim)"));
    }
    assert_eq!(px4.firmware.as_deref(), Some("PX4 1.15.0"));
    assert_eq!(
        [bin.autopilot, link.autopilot, px4.autopilot],
        [Autopilot::ArduPilot, Autopilot::ArduPilot, Autopilot::Px4]
    );
    assert_eq!(bin.compasses[0].is_used.zip(bin.compasses[1].is_used), Some((true, false)));
    assert_eq!([&bin, &link, &px4, &table].map(|flight| flight.day.is_some()), [true, true, true, false]);
    assert_eq!((link.is_armed(5.0), table.is_armed(5.0), bin.is_armed(5.0)), (Some(true), Some(true), None));
}

#[test]
fn a_copter_is_known_as_one() {
    let copter = |parameters| Recording { is_copter: true, ..recording(parameters) };
    let (ardupilot, px4) = (copter(&ARDUPILOT), copter(&PX4));
    for bytes in [dataflash(&ardupilot), dataflash_text(&ardupilot), tlog(&ardupilot), ulog(&px4)] {
        let flight = read_bytes(&bytes).unwrap();
        assert!(flight.is_copter, "{:?}", flight.format);
    }
}

/// Nothing, something else, or a log without what is needed.
#[test]
fn what_is_no_log_is_told() {
    assert!(matches!(read_bytes(b""), Err(LogError::Empty)));
    for bytes in [&b"hello"[..], b"time,x\n1,2\n", b"\x89PNG\r\n\x1a\n0000000000000000", &[0; 5000]] {
        assert!(matches!(read_bytes(bytes), Err(LogError::Unknown)), "{bytes:?}");
    }
    let nothing = Recording { instants: Vec::new(), ..recording(&[]) };
    assert!(matches!(read_bytes(&dataflash(&nothing)), Err(LogError::NoField(Format::DataFlash, 0))));
    assert!(matches!(read_bytes(&ulog(&nothing)), Err(LogError::NoField(Format::ULog, 0))));
}

/// Garbage between messages costs itself, and the message that it hits.
#[test]
fn damage_in_the_middle_costs_little() {
    for (format, bytes, _) in each() {
        let whole = read_bytes(&bytes).unwrap().compasses[0].field.rows().len();
        let mut damaged = bytes.clone();
        let middle = bytes.len() / 2;
        damaged.splice(middle..middle, *b"\n\x00garbage\xff\xa3\x95\xfd\n");
        let flight = read_bytes(&damaged).unwrap();
        let rows = flight.compasses[0].field.rows().len();
        assert!(rows + 12 >= whole && flight.counts.garbage > 0, "{format:?}: {rows} of {whole}, {:?}", flight.counts);
        let cut = read_bytes(&bytes[..=bytes.len() * 3 / 4]).unwrap();
        assert!(cut.compasses[0].field.rows().len() > whole * 2 / 3, "{format:?}");
    }
}

/// The autopilot starts again: its clock begins anew, and time goes on.
#[test]
fn a_restart_in_the_file_goes_on_later() {
    let mut twice = recording(&ARDUPILOT);
    let mut again = twice.instants.clone();
    for instant in &mut again {
        instant.at_us -= 35_000_000;
    }
    twice.instants.extend(again);
    for bytes in [dataflash(&twice), dataflash_text(&twice), csv(&twice), ulog(&twice)] {
        let flight = read_bytes(&bytes).unwrap();
        assert_eq!(flight.counts.restarts, 1);
        let rows = flight.compasses[0].field.rows();
        assert!(rows.len() >= 598, "{}", rows.len());
        let steps: Vec<f64> =
            rows.windows(2).map(|pair| pair[1].t_s - pair[0].t_s).filter(|step| *step > 1.0).collect();
        assert!(steps.len() == 1 && steps[0] > 9.0 && steps[0] < 12.0, "{steps:?}");
    }
}

/// Another vehicle and a ground station on the same link are not this one.
#[test]
fn only_the_first_autopilot_of_a_link_counts() {
    let (own, mut other) = (recording(&ARDUPILOT), recording(&[]));
    for instant in &mut other.instants {
        instant.field_ut[0] = [1.0, 2.0, 3.0];
    }
    let other = tlog(&other);
    let mut both = tlog(&own);
    // The system's number stands at 8 + 5, the checksum must be right: the other is written as it is, and renumbered.
    let renumbered = renumbered(&other, 2);
    both.extend(renumbered);
    let flight = read_bytes(&both).unwrap();
    assert!(flight.counts.others > 600 && flight.counts.vehicles == 1, "{:?}", flight.counts);
    assert_eq!(read_bytes(&tlog(&own)).unwrap().counts.vehicles, 0);
    assert_eq!(flight.compasses[0].field.rows().len(), 300);
}

/// Two vehicles that fly at the same time, and before them a ground station that says it is a generic autopilot: each is read
/// when it is asked for, and one that is not there is named, with those that are.
#[test]
fn the_vehicle_that_is_asked_for_is_read() {
    let frames = |bytes: &[u8]| {
        let mut rest = bytes;
        std::iter::from_fn(move || {
            let end = 8 + 10 + usize::from(*rest.get(9)?) + 2;
            let (frame, next) = rest.split_at(end);
            rest = next;
            Some(frame.to_vec())
        })
        .collect::<Vec<_>>()
    };
    let mut other = recording(&[]);
    other.instants.iter_mut().for_each(|instant| instant.field_ut[0] = [1.0, 2.0, 3.0]);
    let [one, two] = [tlog(&recording(&ARDUPILOT)), renumbered(&tlog(&other), 2)].map(|bytes| frames(&bytes));
    let mut station = one[0].clone();
    // Kind, autopilot, and the system behind eight bytes of clock.
    (station[8 + 10 + 4], station[8 + 10 + 5]) = (6, 0);
    let mut link = renumbered(&station, 255);
    // The writer's parameters make the two unequal in number.
    for i in 0..one.len().max(two.len()) {
        link.extend([one.get(i), two.get(i)].into_iter().flatten().flatten());
    }
    for (asked, systems, x_ut) in [(None, [1, 2], None), (Some(1), [1, 2], None), (Some(2), [2, 1], Some(1.0))] {
        let flight = read_of(&mut &link[..], Unit::Milligauss, asked).unwrap();
        assert_eq!(flight.systems, systems, "{asked:?}");
        let rows = flight.compasses[0].field.rows();
        assert!(rows.len() >= 299, "{asked:?}: {}", rows.len());
        let is_the_other = rows.iter().all(|row| (row.of[0] - 1.0).abs() < 0.01);
        assert_eq!(is_the_other, x_ut.is_some(), "{asked:?}");
    }
    let none = read_of(&mut &link[..], Unit::Milligauss, Some(7)).unwrap_err();
    assert_eq!(none.to_string(), "there is no vehicle of system 7; there is 1, 2");
    let table = read_of(&mut &csv(&recording(&[]))[..], Unit::Milligauss, Some(1)).unwrap_err();
    assert_eq!(table.to_string(), "there is no system 1: no vehicle says its number");
}

/// A frame with a wrong checksum says nothing, though the next one follows it.
#[test]
fn a_damaged_frame_is_not_believed() {
    let mut bytes = tlog(&recording(&ARDUPILOT));
    let mut damaged = 0;
    let mut at = 0;
    while at + 20 < bytes.len() {
        let is_attitude = bytes[at + 15..at + 18] == [30, 0, 0];
        if is_attitude && at % 3 == 0 {
            // The exponent of its roll.
            bytes[at + 18 + 7] ^= 0x20;
            damaged += 1;
        }
        at += 8 + 10 + usize::from(bytes[at + 9]) + 2;
    }
    let flight = read_bytes(&bytes).unwrap();
    assert!(damaged > 50);
    assert!(flight.attitude.rows().len() <= 300 - damaged, "{} of 300, {damaged}", flight.attitude.rows().len());
}

/// Before 2017 CURR had hundredths of an ampere as whole numbers, and before 2015 words and events had no stamp.
#[test]
fn what_ardupilot_logged_otherwise_once_is_read() {
    let original = recording(&ARDUPILOT);
    let expected = |t_s: f64| 10.0 + t_s / 10.0;
    let mut lines = Vec::new();
    for line in String::from_utf8(dataflash_text(&original)).unwrap().lines() {
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
    assert_eq!(text.firmware.as_deref(), Some("ArduPlane V4.6.0 (host-sim)"));
    // It was disarmed at the last instant that had a stamp, 29.9 s after the first.
    assert_eq!((text.is_armed(29.8), text.is_armed(29.91)), (Some(true), Some(false)));
    // The same as bytes: the number of another letter.
    let mut bytes = dataflash(&original);
    let format = bytes.windows(7).position(|at| at == [0xA3, 0x95, 128, 70, 20, b'B', b'A']).unwrap();
    bytes[format + 5..format + 9].copy_from_slice(b"CURR");
    bytes[format + 12] = b'i';
    for at in (0..=bytes.len() - 20).filter(|&at| bytes[at..at + 3] == [0xA3, 0x95, 70]).collect::<Vec<_>>() {
        let amperes = f32::from_le_bytes(bytes[at + 16..at + 20].try_into().unwrap());
        bytes[at + 16..at + 20].copy_from_slice(&((amperes * 100.0).round() as i32).to_le_bytes());
    }
    for flight in [text, read_bytes(&bytes).unwrap()] {
        for row in flight.current.rows() {
            let off = f64::from(row.of[0]) - expected(row.t_s);
            assert!(off.abs() < 0.006, "{:?}: {row:?}", flight.format);
        }
        assert_eq!(flight.current.rows().len(), 300);
    }
}

/// The table as spreadsheets and scripts write it: in capitals, with a line that names the separator, times from 1970, a
/// reference that is not always there, lines sorted by something else or from the end.
#[test]
fn a_table_is_read_in_any_shape() {
    let text = String::from_utf8(csv(&recording(&[]))).unwrap();
    let (header, rows) = text.split_once('\n').unwrap();
    let rows: Vec<&str> = rows.lines().collect();
    let each = |change: &dyn Fn(usize, Vec<String>) -> Vec<String>| {
        let changed =
            rows.iter().enumerate().map(|(i, row)| change(i, row.split(',').map(str::to_owned).collect()).join(","));
        format!("{header}\n{}", changed.collect::<Vec<_>>().join("\n"))
    };
    let sorted_by = |key: &dyn Fn(&str) -> i64| {
        let mut rows = rows.clone();
        rows.sort_by_key(|row| key(row));
        format!("{header}\n{}", rows.join("\n"))
    };
    let unix = each(&|_, mut row| {
        row[0] = format!("{:.3}", row[0].parse::<f64>().unwrap() + 1.7e9);
        row
    });
    let without = each(&|i, mut row| {
        if i % 2 == 1 {
            row[6] = "NaN".to_owned();
        }
        row
    });
    let by_field = sorted_by(&|row| (row.split(',').nth(1).unwrap().parse::<f64>().unwrap() * 10.0) as i64);
    let from_the_end = sorted_by(&|row| -(row.split(',').next().unwrap().parse::<f64>().unwrap() * 1000.0) as i64);
    let expected = read_bytes(text.as_bytes()).unwrap();
    let capitals = text.replace(header, &header.to_uppercase());
    for (shape, table) in [
        ("capitals", capitals),
        ("separator", format!("sep=,\n{text}")),
        ("from 1970", unix),
        ("half a reference", without),
        ("by the field", by_field),
        ("from the end", from_the_end),
    ] {
        let flight = read_bytes(table.as_bytes()).unwrap();
        assert_eq!(flight.counts, Counts::default(), "{shape}");
        let [found, as_before] = [&flight, &expected].map(|flight| {
            let rows = flight.compasses[0].field.rows();
            rows.iter()
                .map(|row| ((row.t_s - rows[0].t_s) * 1e3).round() as i64)
                .zip(rows.iter().map(|row| row.of))
                .collect::<Vec<_>>()
        });
        assert!(found == as_before, "{shape}");
        let references = flight.reference.rows().len();
        assert_eq!(references, if shape == "half a reference" { 150 } else { 300 }, "{shape}");
        assert_eq!(flight.is_armed(flight.lasts_s()[1]), Some(true), "{shape}");
    }
    // A time that cannot be is counted, and a field of nothing is told.
    let far = read_bytes(format!("{text}1e9,1,2,3,0,0\n").as_bytes()).unwrap();
    assert_eq!(far.counts.bad_times, 1);
    let nothing = read_bytes(b"t_s,mx,my,mz,roll_deg,pitch_deg\n0,0,0,0,1,2\n").unwrap_err();
    assert!(matches!(nothing, LogError::NoField(Format::Csv, 1)), "{nothing}");
}

/// The frames of a log, sent by another system.
fn renumbered(bytes: &[u8], system: u8) -> Vec<u8> {
    use mavlink::Message as _;
    let (mut out, mut rest) = (Vec::new(), bytes);
    while rest.len() > 20 {
        let end = 8 + 10 + usize::from(rest[9]);
        let mut frame = rest[..end].to_vec();
        frame[13] = system;
        let extra =
            mavlink::dialects::common::MavMessage::extra_crc(u32::from_le_bytes([rest[15], rest[16], rest[17], 0]));
        frame.extend(mavlink::calculate_crc(&frame[9..], extra).to_le_bytes());
        out.extend(frame);
        rest = &rest[end + 2..];
    }
    out
}

/// Inputs of a reader: a small log with bytes changed, taken out, doubled and cut; some of nothing but chance.
fn hostile(random: &mut Random, good: &[u8]) -> Vec<u8> {
    let mut below = |limit: usize| (random.uniform(0.0, limit.max(1) as f64) as usize).min(limit.saturating_sub(1));
    if below(10) == 0 {
        return (0..below(600)).map(|_| below(256) as u8).collect();
    }
    let from = if below(2) == 0 { 0 } else { below(good.len()) };
    let mut bytes = good[from..(from + 200 + below(3000)).min(good.len())].to_vec();
    for _ in 0..below(12) {
        if bytes.is_empty() {
            break;
        }
        let at = below(bytes.len());
        match below(4) {
            0 => bytes[at] = below(256) as u8,
            1 => bytes[at] = [0, 255, b'[', b';', b',', b'\n', 0xFD, 0xA3][below(8)],
            2 => drop(bytes.drain(at..(at + below(20)).min(bytes.len()))),
            _ => {
                let part = bytes[at..(at + below(60)).min(bytes.len())].to_vec();
                bytes.splice(at..at, part);
            }
        }
    }
    bytes
}

/// No bytes make a reader panic, and what comes out can be gone on with: as many inputs a format.
fn fuzz(inputs: usize) {
    for (format, bytes, _) in each() {
        let mut random = Random::new(1, Purpose::Damage);
        let mut flights = 0;
        for _ in 0..inputs {
            let input = hostile(&mut random, &bytes);
            if let Ok(flight) = read_bytes(&input) {
                flights += 1;
                let rows = flight.compasses.iter().map(|compass| compass.field.rows().len()).sum::<usize>();
                assert!(rows <= input.len(), "{format:?}");
                let rows = crate::replay::rows(&flight, &flight.compasses[0], 0.05, None).0;
                assert!(rows.iter().all(|row| row.t_s.is_finite()), "{format:?}");
            }
        }
        assert!(flights > inputs / 50, "{format:?}: only {flights} of {inputs} were read at all");
    }
}

#[test]
fn no_bytes_make_a_reader_panic() {
    fuzz(400);
}

/// A million inputs a reader: `cargo test --release -p host-sim --lib log::tests::a_million -- --ignored`.
#[test]
#[ignore = "minutes, in a release build"]
fn a_million_inputs_make_no_reader_panic() {
    fuzz(1_000_000);
}

/// A file that pretends to be longer than memory: a stream of one message, again and again.
#[test]
#[ignore = "reads 2 GB, in a release build"]
fn two_gigabytes_are_read_in_bounded_memory() {
    struct Endless {
        head: Vec<u8>,
        message: Vec<u8>,
        at: u64,
    }
    impl Read for Endless {
        fn read(&mut self, into: &mut [u8]) -> io::Result<usize> {
            const ALL: u64 = 2_000_000_000;
            let head = self.head.len() as u64;
            for (i, byte) in into.iter_mut().enumerate() {
                let at = self.at + i as u64;
                if at >= ALL {
                    self.at += i as u64;
                    return Ok(i);
                }
                *byte = if at < head {
                    self.head[at as usize]
                } else {
                    let (number, offset) =
                        ((at - head) / self.message.len() as u64, (at - head) % self.message.len() as u64);
                    // The clock of each: 1 ms on.
                    let stamp = (70_000_000 + number * 1_000).to_le_bytes();
                    if (3..11).contains(&offset) { stamp[offset as usize - 3] } else { self.message[offset as usize] }
                };
            }
            self.at += into.len() as u64;
            Ok(into.len())
        }
    }
    let head = dataflash(&recording(&ARDUPILOT));
    let at = head.windows(3).position(|bytes| bytes == [0xA3, 0x95, 67]).unwrap();
    let length = 3 + 8 + 1 + 18 + 1 + 4;
    let message = head[at..at + length].to_vec();
    let flight = read(&mut Endless { head, message, at: 0 }, Unit::Milligauss).unwrap();
    assert!(flight.compasses[0].field.rows().len() <= 1 << 20);
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let peak_kb =
        status.lines().find_map(|line| line.strip_prefix("VmHWM:")?.trim().split(' ').next()?.parse::<u64>().ok());
    assert!(peak_kb.is_none_or(|kb| kb < 500_000), "{peak_kb:?} kB");
}
