//! Frames of MSP version 2 as an autopilot reads and writes them.

use super::{Firmware, Known};

const FC_VARIANT: u16 = 2;
const STATUS: u16 = 101;
const RAW_GPS: u16 = 106;
const ATTITUDE: u16 = 108;
const ANALOG: u16 = 110;
const RTC: u16 = 247;
const SENSOR_COMPASS: u16 = 0x1F04;

/// A request that came.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Request {
    pub function: u16,
    payload: Vec<u8>,
}

impl Request {
    /// Whether it is a sensor's, which is not answered.
    pub fn is_of_a_sensor(&self) -> bool {
        (0x1F00..=0x1FFF).contains(&self.function)
    }

    /// Instance, time and field of a compass's reading, if it is one.
    pub fn compass(&self) -> Option<(u8, u32, [i16; 3])> {
        let [instance, t0, t1, t2, t3, x0, x1, y0, y1, z0, z1] = *self.payload.as_slice() else { return None };
        let field_mg = [[x0, x1], [y0, y1], [z0, z1]].map(i16::from_le_bytes);
        (self.function == SENSOR_COMPASS).then_some((instance, u32::from_le_bytes([t0, t1, t2, t3]), field_mg))
    }
}

/// Finds requests in what comes.
#[derive(Clone, Debug, Default)]
pub(super) struct Frames {
    bytes: Vec<u8>,
    pub broken: u32,
}

impl Frames {
    /// Takes a byte; gives the request that it ends. What does not begin like a frame is dropped as it comes.
    pub fn push(&mut self, byte: u8) -> Option<Request> {
        self.bytes.push(byte);
        let begun = self.bytes.len().min(3);
        if self.bytes[..begun] != b"$X<"[..begun] {
            self.bytes.clear();
            return None;
        }
        let &[_, _, _, _flags, f0, f1, n0, n1, ref payload @ .., crc] = self.bytes.as_slice() else { return None };
        if payload.len() < usize::from(u16::from_le_bytes([n0, n1])) {
            return None;
        }
        let request = Request { function: u16::from_le_bytes([f0, f1]), payload: payload.to_vec() };
        let is_intact = crc_8_dvb_s2(&self.bytes[3..self.bytes.len() - 1]) == crc;
        self.bytes.clear();
        if !is_intact {
            self.broken += 1;
        }
        is_intact.then_some(request)
    }
}

/// Polynomial 0xD5, nothing before, nothing after.
pub(super) fn crc_8_dvb_s2(bytes: &[u8]) -> u8 {
    bytes.iter().fold(0, |crc, byte| {
        (0..8).fold(crc ^ byte, |crc: u8, _| if crc & 0x80 == 0 { crc << 1 } else { (crc << 1) ^ 0xD5 })
    })
}

/// What becomes of a request.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Answer {
    Reply(Vec<u8>),
    Error,
}

/// An answer as it is sent.
pub(super) fn encode(function: u16, answer: &Answer) -> Vec<u8> {
    let (direction, payload) = match answer {
        Answer::Reply(payload) => (b'>', payload.as_slice()),
        Answer::Error => (b'!', [].as_slice()),
    };
    let mut frame = vec![b'$', b'X', direction, 0];
    frame.extend(function.to_le_bytes());
    frame.extend((payload.len() as u16).to_le_bytes());
    frame.extend(payload);
    frame.push(crc_8_dvb_s2(&frame[3..]));
    frame
}

/// What a firmware says to a request; none if it does not know it.
pub(super) fn payload(firmware: Firmware, function: u16, known: &Known) -> Option<Vec<u8>> {
    match function {
        FC_VARIANT => Some(match firmware {
            Firmware::ArduPilot => b"ARDU".to_vec(),
            Firmware::Inav => b"INAV".to_vec(),
        }),
        STATUS => Some(status(firmware, known.is_armed)),
        RAW_GPS => Some(raw_gps(known)),
        ATTITUDE => Some(attitude(firmware, known)),
        ANALOG => Some(analog(firmware, known.current_a)),
        RTC => Some(rtc(firmware, known.unix_s)),
        _ => None,
    }
}

fn attitude(firmware: Firmware, known: &Known) -> Vec<u8> {
    let decidegrees = |rad: f64| rad.to_degrees() * 10.0;
    let yaw_deg = known.yaw_rad.to_degrees().rem_euclid(360.0) as i16;
    // ArduPilot's cast leaves the fraction away, INAV rounds.
    let (roll, pitch) = match firmware {
        Firmware::ArduPilot => (decidegrees(known.roll_rad) as i16, decidegrees(known.pitch_rad) as i16),
        Firmware::Inav => (decidegrees(known.roll_rad).round() as i16, decidegrees(-known.pitch_rad).round() as i16),
    };
    [roll, pitch, yaw_deg].map(i16::to_le_bytes).concat()
}

/// ArduPilot's has 22 bytes, INAV's 11; the boxes begin at the sixth. Of the others INAV has some set.
fn status(firmware: Firmware, is_armed: bool) -> Vec<u8> {
    let (length, others) = match firmware {
        Firmware::ArduPilot => (22, 0),
        Firmware::Inav => (11, 0x0A),
    };
    let mut payload = vec![0; length];
    payload[6] = u8::from(is_armed) | others;
    payload
}

fn raw_gps(known: &Known) -> Vec<u8> {
    let (latitude_deg, longitude_deg, height_m) = known.place.unwrap_or_default();
    let mut payload = vec![if known.place.is_some() { 2 } else { 0 }, 9];
    payload.extend(((latitude_deg * 1e7).round() as i32).to_le_bytes());
    payload.extend(((longitude_deg * 1e7).round() as i32).to_le_bytes());
    payload.extend((height_m as i16).to_le_bytes());
    // Speed, course, dilution.
    payload.extend([0; 6]);
    payload
}

/// Voltage, charge, signal strength, current; ArduPilot's has the voltage once more. One that is not measured is none.
fn analog(firmware: Firmware, current_a: Option<f64>) -> Vec<u8> {
    let mut payload = vec![168, 0, 0, 0, 0];
    payload.extend(((current_a.unwrap_or(0.0) * 100.0).round() as i16).to_le_bytes());
    if firmware == Firmware::ArduPilot {
        payload.extend(1680_u16.to_le_bytes());
    }
    payload
}

/// A date and a time from ArduPilot, seconds and milliseconds from INAV.
fn rtc(firmware: Firmware, unix_s: Option<u64>) -> Vec<u8> {
    match firmware {
        Firmware::Inav => [&(unix_s.unwrap_or(0) as u32).to_le_bytes()[..], &[0, 0]].concat(),
        Firmware::ArduPilot => {
            let (year, month, day) = unix_s.map_or((1900, 1, 0), date);
            let second = unix_s.unwrap_or(0) % 86_400;
            let [y0, y1] = year.to_le_bytes();
            let time = [second / 3_600, second / 60 % 60, second % 60].map(|number| number as u8);
            [&[y0, y1, month, day][..], &time, &[0, 0]].concat()
        }
    }
}

/// The date of a time, counted year by year and month by month.
fn date(unix_s: u64) -> (u16, u8, u8) {
    let is_leap = |year: u16| year.is_multiple_of(4) && (!year.is_multiple_of(100) || year.is_multiple_of(400));
    let mut days = unix_s / 86_400;
    let mut year = 1970;
    while days >= 365 + u64::from(is_leap(year)) {
        days -= 365 + u64::from(is_leap(year));
        year += 1;
    }
    let february = 28 + u64::from(is_leap(year));
    let mut month = 1;
    for length in [31, february, 31, 30, 31, 30, 31, 31, 30, 31, 30, 31] {
        if days < length {
            break;
        }
        days -= length;
        month += 1;
    }
    (year, month, days as u8 + 1)
}
