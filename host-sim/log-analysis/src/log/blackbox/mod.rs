//! Reader for the blackbox logs of INAV and Betaflight (`blackbox/blackbox.c`), of one flight after the other, and for the
//! tables that `blackbox_decode` makes of them.
//!
//! The crate `blackbox-log` 0.4 was rejected: it takes a slice of the whole file, refuses INAV before 5 and Betaflight
//! before 4.2 or after 4.5, panics on a coordinate without sign, predicts the frame after an I frame by one before it, and
//! searches the erased end of a flash once for each of its bytes.

mod frames;
mod recorder;

use std::io::{self, Read};

use self::recorder::MainRecorder;
use super::flight::{Gps, LoggedFlight};
use super::read_window::ReadWindow;
use crate::numbers::median;
use frames::{BlackboxHeader, FrameBytes, FrameFields, PrecedingFrames};

/// First line of each flight.
const FIRST_LINE: &[u8] = b"H Product:Blackbox flight data recorder by Nicholas Sherlock";

/// First line of a decoded log.
const FIRST_COLUMN: &[u8] = b"loopIteration,";

/// Longest frame, bytes; firmware writes at most 256.
const MAX_FRAME_BYTES: usize = 512;

/// First letters of frames.
const FRAME_LETTERS: [u8; 6] = *b"IPGHSE";

/// Values of a motor at rest and at full throttle, if not declared, microseconds.
const USUAL_MOTOR_RANGE: [f64; 2] = [1000.0, 2000.0];

/// Strength of the Earth's field where the place is unknown, microtesla.
const USUAL_STRENGTH_UT: f64 = 50.0;

/// Receives the flights of a log, in their order.
type FlightVisitor<'a> = dyn FnMut(LoggedFlight) + 'a;

pub fn matches_header(first_bytes: &[u8]) -> bool {
    first_bytes.starts_with(FIRST_COLUMN) || first_bytes.windows(FIRST_LINE.len()).any(|line| line == FIRST_LINE)
}

/// Reads each flight.
pub fn visit_flights(source: &mut dyn Read, visit: &mut FlightVisitor<'_>) -> io::Result<()> {
    let mut window = ReadWindow::new(source);
    if window.peek_bytes(FIRST_COLUMN.len())? == FIRST_COLUMN {
        visit(read_decoded(&mut window)?);
        return Ok(());
    }
    while skip_to_flight(&mut window)? {
        let mut flight = FlightReader::new(&read_header(&mut window)?);
        loop {
            let bytes = window.peek_bytes(MAX_FRAME_BYTES)?;
            if bytes.is_empty() || bytes.starts_with(FIRST_LINE) || flight.is_ended {
                break;
            }
            let length = flight.read_frame(bytes);
            window.consume_bytes(length);
        }
        visit(finish_flight(flight.main));
    }
    Ok(())
}

/// Skips the bytes before the next flight; false if there is none.
fn skip_to_flight(window: &mut ReadWindow<'_>) -> io::Result<bool> {
    const SEARCHED_BYTES: usize = 1 << 14;
    loop {
        let bytes = window.peek_bytes(SEARCHED_BYTES)?;
        let found = bytes.windows(FIRST_LINE.len()).position(|line| line == FIRST_LINE);
        let is_last = bytes.len() < SEARCHED_BYTES;
        let skipped = found.unwrap_or(bytes.len().saturating_sub(FIRST_LINE.len()));
        window.consume_bytes(skipped);
        if found.is_some() || is_last {
            return Ok(found.is_some());
        }
    }
}

fn read_header(window: &mut ReadWindow<'_>) -> io::Result<BlackboxHeader> {
    let mut header = BlackboxHeader::default();
    while window.peek_bytes(2)? == b"H " {
        if let Some(line) = window.next_line()? {
            header.add_line(&line[2..]);
        }
    }
    Ok(header)
}

/// Frames of a flight.
struct FlightReader {
    main: MainRecorder,
    /// Layouts by the letter; I and P frames have the same fields.
    layouts: [FrameFields; FRAME_LETTERS.len()],
    /// The last two main frames; empty after damage, until the next I frame.
    last_frames: [Vec<i32>; 2],
    home: Option<[i32; 2]>,
    time_column: Option<usize>,
    /// Time of the last main frame, microseconds, continued beyond 32 bits.
    clock_us: u64,
    is_ended: bool,
}

impl FlightReader {
    fn new(header: &BlackboxHeader) -> Self {
        let layouts = FRAME_LETTERS.map(|letter| header.layout(char::from(letter)));
        let firmware = header.text("Firmware revision");
        // Bits of a float; 1 deg/s in all firmware that is read.
        let scale = ["gyro_scale", "gyro.scale"].map(|name| header.text(name)).concat();
        let scale = u32::from_str_radix(scale.trim_start_matches("0x"), 16).map_or(1.0, f32::from_bits);
        let resolution = if header.number("blackbox_high_resolution") == 1 { 10.0 } else { 1.0 };
        let motor_range = header.text("motorOutput").split(',').map(|number| number.parse().unwrap_or(0.0));
        let motor_range = <[f64; 2]>::try_from(motor_range.collect::<Vec<_>>()).unwrap_or(USUAL_MOTOR_RANGE);
        let mut main = MainRecorder::new(&layouts[0].names, firmware, f64::from(scale) / resolution, motor_range);
        if let Some(seconds) = unix_s(header.text("Log start datetime")) {
            main.builder.set_day_from_unix_s(seconds);
        }
        Self {
            main,
            time_column: layouts[0].index("time"),
            layouts,
            last_frames: [Vec::new(), Vec::new()],
            home: None,
            clock_us: 0,
            is_ended: false,
        }
    }

    /// Reads the frame at the start of these bytes; number of bytes that are read.
    fn read_frame(&mut self, bytes: &[u8]) -> usize {
        let mut frame = FrameBytes { bytes, position: 1 };
        // A frame is followed by another, or by the end.
        let is_followed = |frame: &FrameBytes<'_>| {
            frame.position <= bytes.len() && bytes.get(frame.position).is_none_or(|next| FRAME_LETTERS.contains(next))
        };
        let letter = bytes[0];
        if letter == b'E' && self.skip_event(&mut frame).is_some() && (self.is_ended || is_followed(&frame)) {
            return frame.position;
        }
        let numbers = self.decode_frame(letter, &mut frame).filter(|_| is_followed(&frame));
        if let Some(numbers) = numbers {
            self.record_frame(letter, numbers);
            return frame.position;
        }
        self.last_frames = [Vec::new(), Vec::new()];
        // Erased flash and allocated files are no damage.
        self.main.builder.flight.skipped_counts.garbage += u64::from(![0, 0xFF].contains(&letter));
        1
    }

    /// Time of the last main frame as the log has it.
    const fn time_us(&self) -> i32 {
        (self.clock_us as u32).cast_signed()
    }

    fn decode_frame(&self, letter: u8, frame: &mut FrameBytes<'_>) -> Option<Vec<i32>> {
        let [last, before_last] = &self.last_frames;
        let preceding = PrecedingFrames { last, before_last, time_us: self.time_us(), home: self.home };
        let index = FRAME_LETTERS.iter().position(|known| *known == letter)?;
        match letter {
            b'P' if last.is_empty() => None,
            b'P' => self.layouts[index].decode_frame(frame, &preceding),
            _ => self.layouts[index].decode_frame(frame, &PrecedingFrames { last: &[], before_last: &[], ..preceding }),
        }
    }

    fn record_frame(&mut self, letter: u8, numbers: Vec<i32>) {
        match letter {
            b'I' | b'P' => {
                let Some(&time_us) = self.time_column.and_then(|column| numbers.get(column)) else { return };
                let step_us = if self.last_frames[0].is_empty() && self.clock_us == 0 {
                    i64::from(time_us.cast_unsigned())
                } else {
                    i64::from(time_us.wrapping_sub(self.time_us()))
                };
                self.clock_us = self.clock_us.saturating_add_signed(step_us);
                self.main.record_frame(self.clock_us, &|column| numbers.get(column).copied().map_or(0.0, f64::from));
                // Nothing before an I frame is used after it.
                let before = if letter == b'I' { numbers.clone() } else { std::mem::take(&mut self.last_frames[0]) };
                self.last_frames = [numbers, before];
            }
            b'G' => self.record_gps(&numbers),
            b'H' => self.home = numbers.first().copied().zip(numbers.get(1).copied()).map(<[i32; 2]>::from),
            _ => {}
        }
    }

    fn record_gps(&mut self, numbers: &[i32]) {
        let number = |name: &str| Some(f64::from(*numbers.get(self.layouts[2].index(name)?)?));
        let has_fix = number("GPS_fixType").map_or(number("GPS_numSat") >= Some(5.0), |fix| fix >= 2.0);
        let [Some(latitude), Some(longitude), Some(speed), Some(course)] =
            ["GPS_coord[0]", "GPS_coord[1]", "GPS_speed", "GPS_ground_course"].map(number)
        else {
            return;
        };
        let gps = Gps {
            latitude_deg: (latitude * 1e-7) as f32,
            longitude_deg: (longitude * 1e-7) as f32,
            // Metres; Betaflight's decimetres are near enough for the model of the field.
            height_m: number("GPS_altitude").unwrap_or(0.0) as f32,
            speed_m_s: (speed / 100.0) as f32,
            course_deg: (course / 10.0) as f32,
            yaw_deg: f32::NAN,
        };
        if has_fix && self.main.builder.timeline.has_accepted_stamp() {
            let t_s = self.main.builder.timeline.newest_s();
            self.main.builder.push_gps(t_s, gps);
        }
    }

    /// Skips an event; `None` if it is none (`blackbox_fielddefs.h`).
    fn skip_event(&mut self, frame: &mut FrameBytes<'_>) -> Option<()> {
        const END_TEXT: &[u8] = b"End of log";
        let number_count = match frame.next_byte()? {
            0 | 15 | 40 => 1,
            14 | 30 => 2,
            13 => {
                let is_float = frame.next_byte()? & 0x80 != 0;
                frame.position += if is_float { 4 } else { 0 };
                usize::from(!is_float)
            }
            0xFF => {
                self.is_ended = frame.bytes.get(frame.position..)?.starts_with(END_TEXT);
                return self.is_ended.then_some(());
            }
            _ => return None,
        };
        (0..number_count).try_for_each(|_| frame.unsigned().map(drop))
    }
}

/// Reads a table of `blackbox_decode`, whose first line names the fields of the main frames.
fn read_decoded(window: &mut ReadWindow<'_>) -> io::Result<LoggedFlight> {
    let header = window.next_line()?.unwrap_or_default();
    let names: Vec<String> = header.split(',').map(|name| name.trim().to_owned()).collect();
    let time_column = names.iter().position(|name| name == "time (us)");
    let mut main = MainRecorder::new(&names, "", 1.0, USUAL_MOTOR_RANGE);
    while let Some(line) = window.next_line()? {
        let numbers: Vec<f64> = line.split(',').map(|cell| cell.trim().parse().unwrap_or(f64::NAN)).collect();
        match time_column.and_then(|column| numbers.get(column)).filter(|time_us| **time_us >= 0.0) {
            Some(time_us) => {
                main.record_frame(*time_us as u64, &|column| numbers.get(column).copied().unwrap_or(f64::NAN));
            }
            None => main.builder.flight.skipped_counts.garbage += u64::from(!line.is_empty()),
        }
    }
    Ok(finish_flight(main))
}

/// Scales the field, whose unit is that of the driver, or 1024 for the Earth's field after INAV's calibration, to the
/// strength of the Earth's field.
fn finish_flight(main: MainRecorder) -> LoggedFlight {
    let mut flight = main.builder.finish_flight();
    let strength_ut = flight.earth_field().map_or(USUAL_STRENGTH_UT, |(earth, _)| f64::from(earth.total_ut));
    for compass in &mut flight.compasses {
        let norm = |values: &[f32; 6]| values[..3].iter().map(|axis| axis * axis).sum::<f32>().sqrt();
        let usual = median(compass.field.rows().iter().map(|row| f64::from(norm(&row.row_values))));
        for row in compass.field.rows_mut() {
            row.row_values = row.row_values.map(|axis| axis * (strength_ut / usual) as f32);
        }
    }
    flight
}

/// Unix time of the day in `2022-02-02T15:04:53.139+00:00`, seconds.
fn unix_s(date_time: &str) -> Option<u64> {
    /// Days from March of the year 0 to 1970.
    const DAYS_TO_1970: u64 = 719_468;
    let mut numbers = date_time.get(..10)?.split('-').map(|number| number.parse::<u64>().ok());
    let [year, month, day] = [numbers.next()??, numbers.next()??, numbers.next()??];
    if !(1970..2100).contains(&year) || !(1..=12).contains(&month) || !(1..=31).contains(&day) {
        return None;
    }
    // Days of the year before each month, in years that begin with March (months of 31, 30, 31, 30, 31 days).
    let (year, month) = if month > 2 { (year, month - 3) } else { (year - 1, month + 9) };
    let days = 365 * year + year / 4 - year / 100 + year / 400 + (153 * month + 2) / 5 + day - 1;
    Some((days - DAYS_TO_1970) * 86_400)
}
