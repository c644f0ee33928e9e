//! Blackbox writer, with the fields, units and axes of INAV.

use super::recording::{FlightRecording, FlightSample};

/// Frames from an I frame to the next; the firmware's default is 32.
const FRAMES_PER_I: i32 = 8;

/// Counts of the field in one microtesla: INAV's calibration gives the Earth's field 1024.
const COUNTS_PER_UT: f64 = 20.0;

/// Parts of deg/s in a count of the gyro, which the header declares; INAV writes whole ones, at a thousand frames a second.
const COUNTS_PER_DPS: f64 = 100.0;

/// Main fields: name, predictor and encoding of an I frame, predictor and encoding of a P frame.
const MAIN_FIELDS: [(&str, [u8; 4]); 14] = [
    ("loopIteration", [0, 1, 6, 9]),
    ("time", [0, 1, 2, 0]),
    ("magADC[0]", [0, 0, 1, 0]),
    ("magADC[1]", [0, 0, 1, 0]),
    ("magADC[2]", [0, 0, 1, 0]),
    ("gyroADC[0]", [0, 0, 3, 0]),
    ("gyroADC[1]", [0, 0, 3, 0]),
    ("gyroADC[2]", [0, 0, 3, 0]),
    ("attitude[0]", [0, 0, 3, 0]),
    ("attitude[1]", [0, 0, 3, 0]),
    ("attitude[2]", [0, 0, 3, 0]),
    ("amperage", [0, 0, 1, 0]),
    ("motor[0]", [4, 1, 3, 0]),
    ("motor[1]", [5, 0, 3, 0]),
];

const GPS_FIELDS: &str = "GPS_fixType,GPS_numSat,GPS_coord[0],GPS_coord[1],GPS_altitude,GPS_speed,GPS_ground_course";

const MINIMUM_THROTTLE: i32 = 1080;

/// Encodes a recording as INAV's blackbox; parameters are not logged.
pub fn encode_blackbox(recording: &FlightRecording) -> Vec<u8> {
    let mut bytes = encode_header(recording).into_bytes();
    let home = recording.start_position.map_or([0; 2], position_counts);
    let (mut last, mut before_last) = (Vec::new(), Vec::new());
    for (iteration, sample) in (0..).zip(&recording.samples) {
        let numbers = main_numbers(iteration, sample);
        if iteration % FRAMES_PER_I == 0 {
            bytes.push(b'H');
            for number in home {
                write_signed(&mut bytes, number);
            }
            bytes.push(b'I');
            write_fields(&mut bytes, &numbers, [&numbers; 2], false);
            before_last.clone_from(&numbers);
        } else {
            bytes.push(b'P');
            write_fields(&mut bytes, &numbers, [&last, &before_last], true);
            before_last = last;
        }
        last = numbers;
        if let Some(position) = recording.sample_position(sample) {
            write_gps(&mut bytes, sample, position, home);
        }
    }
    bytes.extend(b"E\xFFEnd of log\0");
    bytes
}

fn encode_header(recording: &FlightRecording) -> String {
    let names = MAIN_FIELDS.map(|(name, _)| name).join(",");
    let numbers = |column: usize| MAIN_FIELDS.map(|(_, numbers)| numbers[column].to_string()).join(",");
    // Of the navigation of a multirotor, or of an aeroplane; empty here.
    let navigation = if recording.is_copter { "mcPosAxisP[0]" } else { "fwPosP" };
    format!(
        "H Product:Blackbox flight data recorder by Nicholas Sherlock\nH Data version:2\nH I interval:{FRAMES_PER_I}\n\
         H Field I name:{names},{navigation}\nH Field I predictor:{},0\nH Field I encoding:{},9\n\
         H Field P predictor:{},0\nH Field P encoding:{},9\n\
         H Field G name:{GPS_FIELDS}\nH Field G predictor:0,0,7,7,0,0,0\nH Field G encoding:1,1,0,0,0,1,1\n\
         H Field H name:GPS_home[0],GPS_home[1]\nH Field H predictor:0,0\nH Field H encoding:0,0\n\
         H Firmware revision:INAV 8.0.1 (host-sim)\nH Log start datetime:2026-01-04T00:00:00.000+00:00\n\
         H minthrottle:{MINIMUM_THROTTLE}\nH motorOutput:1000,2000\nH gyro_scale:{:#x}\n",
        numbers(0),
        numbers(1),
        numbers(2),
        numbers(3),
        (1.0 / COUNTS_PER_DPS as f32).to_bits(),
    )
}

/// Numbers of the main fields, in axes forward, left, up and with a pitch positive nose down.
fn main_numbers(iteration: i32, sample: &FlightSample) -> Vec<i32> {
    let rounded = |number: f64| number.round() as i32;
    let [x, y, z] = sample.field_ut.first().copied().unwrap_or_default().map(|axis| axis * COUNTS_PER_UT);
    let [p, q, r] = sample.rates_rad_s.map(|rate| rate.to_degrees() * COUNTS_PER_DPS);
    let [roll, pitch, yaw] = sample.attitude_rad.map(|angle| angle.to_degrees() * 10.0);
    let sensors = [x, -y, -z, p, -q, -r, roll, -pitch, yaw.rem_euclid(3600.0), sample.current_a * 100.0];
    let motors = sample.output_pulses_us::<2>();
    let first = [iteration, sample.time_us as i32];
    first.into_iter().chain(sensors.into_iter().chain(motors).map(rounded)).collect()
}

/// Writes the differences of a frame from its prediction.
fn write_fields(bytes: &mut Vec<u8>, numbers: &[i32], [last, before_last]: [&[i32]; 2], is_predicted: bool) {
    for (index, (_, [i_predictor, i_encoding, p_predictor, p_encoding])) in MAIN_FIELDS.into_iter().enumerate() {
        let (predictor, encoding) = if is_predicted { (p_predictor, p_encoding) } else { (i_predictor, i_encoding) };
        let difference = numbers[index].wrapping_sub(match predictor {
            1 => last[index],
            2 => last[index].wrapping_mul(2).wrapping_sub(before_last[index]),
            3 => last[index].midpoint(before_last[index]),
            4 => MINIMUM_THROTTLE,
            5 => numbers[index - 1],
            6 => last[index] + 1,
            _ => 0,
        });
        match encoding {
            1 => write_unsigned(bytes, difference.cast_unsigned()),
            9 => {}
            _ => write_signed(bytes, difference),
        }
    }
}

fn write_unsigned(bytes: &mut Vec<u8>, mut number: u32) {
    while number > 0x7F {
        bytes.push(number as u8 | 0x80);
        number >>= 7;
    }
    bytes.push(number as u8);
}

fn write_signed(bytes: &mut Vec<u8>, number: i32) {
    write_unsigned(bytes, (number << 1 ^ number >> 31).cast_unsigned());
}

fn write_gps(bytes: &mut Vec<u8>, sample: &FlightSample, position: [f64; 3], home: [i32; 2]) {
    bytes.push(b'G');
    write_unsigned(bytes, 2);
    write_unsigned(bytes, 12);
    for (number, home) in position_counts(position).into_iter().zip(home) {
        write_signed(bytes, number - home);
    }
    write_signed(bytes, position[2].round() as i32);
    let [speed_m_s, course_rad] = sample.speed_and_course();
    write_unsigned(bytes, (speed_m_s * 100.0).round() as u32);
    write_unsigned(bytes, (course_rad.to_degrees() * 10.0).round() as u32);
}

fn position_counts([latitude_deg, longitude_deg, _]: [f64; 3]) -> [i32; 2] {
    [latitude_deg, longitude_deg].map(|angle| (angle * 1e7).round() as i32)
}
