//! MSP version 2, both ways: requests and a compass's readings out, an autopilot's replies in.
//!
//! A frame is `$X`, a direction (`<` request, `>` reply, `!` error), flags, function and length of the payload with two
//! bytes each, low byte first, the payload, and CRC-8/DVB-S2 of all from the flags on
//! (<https://github.com/iNavFlight/inav/wiki/MSP-V2>). The one crate for it that knows version 2 wants an allocator of an
//! old nightly compiler and has had no release since 2020.
//!
//! The receiver is one like MAVLink's (`wire::mavlink`): it looks for frames that claim to be one of a few
//! replies, checks their CRC, and passes over everything else byte by byte. A length is believed when the CRC has proved
//! it.
//!
//! # Roll and pitch
//!
//! MSP_ATTITUDE has roll and pitch in tenths of a degree. Roll is right wing down positive in all firmwares; the sign of
//! pitch is that of the firmware, which MSP_FC_VARIANT tells ([`Firmware::attitude`]):
//!
//! | firmware | pitch | source |
//! |---|---|---|
//! | `ARDU` | nose up | ArduPilot, AP_MSP_Telem_Backend.cpp, `msp_process_out_attitude`: `ahrs.pitch_sensor * 0.1`, the AHRS's own |
//! | `INAV` | nose down | INAV, fc_msp.c: `attitude.values.pitch`; telemetry/mavlink.c negates it for MAVLink's nose up |
//! | `BTFL` | nose down | Betaflight, msp.c, imu.c and telemetry/mavlink.c: as INAV's |
//!
//! In the latter two the body axes are forward, left, up, and the Earth's north, west, up (imu.c: pitch is
//! `asin(-rMat[2][0])`, and `rMat[2][0]` is how far up the nose points; roll is `atan2(rMat[2][1], rMat[2][2])`, where
//! `rMat[2][1]` is how far up the left wing does). ArduPilot's ports for DJI's goggles and for MSP DisplayPort can say
//! `BTFL` with a pitch that is nose up; its MSP port proper (SERIALn_PROTOCOL 32) says `ARDU`.
//!
//! # Whether it is armed
//!
//! MSP_STATUS has the flight mode flags at byte 6. Their bits are the boxes in the order of MSP_BOXIDS, in which ARM is the
//! first in INAV (fc_msp_box.c, `initActiveBoxIds`) and in Betaflight (msp_box.c, `BOXARM` is 0 and always enabled);
//! ArduPilot sets this bit alone (`get_osd_flight_mode_bitmask`).

use crc::{CRC_8_DVB_S2, Crc, NoTable};

use crate::earth::{Day, Place};
use crate::frames::{Attitude, Body, Field};

/// What an autopilot is asked for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u16)]
pub enum Function {
    /// MSP_FC_VARIANT: which firmware it is.
    FcVariant = 2,
    /// MSP_STATUS: whether it is armed, among other things.
    Status = 101,
    /// MSP_RAW_GPS: where it is.
    RawGps = 106,
    /// MSP_ATTITUDE: roll and pitch.
    Attitude = 108,
    /// MSP_ANALOG: what current it draws.
    Analog = 110,
    /// MSP_RTC: what day it is.
    Rtc = 247,
}

impl Function {
    const ALL: [Self; 6] = [Self::FcVariant, Self::Status, Self::RawGps, Self::Attitude, Self::Analog, Self::Rtc];

    /// The function of a reply.
    fn of(number: u16) -> Option<Self> {
        Self::ALL.into_iter().find(|function| *function as u16 == number)
    }
}

/// The firmware of an autopilot.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Firmware {
    /// ArduPilot.
    ArduPilot,
    /// INAV.
    Inav,
    /// Betaflight.
    Betaflight,
    /// Another, whose signs are not known.
    Other,
}

impl Firmware {
    /// The attitude that the numbers of an MSP_ATTITUDE mean, in FRD axes; none where the signs are not known.
    #[must_use]
    pub fn attitude(self, angles: Angles) -> Option<Attitude> {
        let nose_up = match self {
            Self::ArduPilot => 0.1,
            Self::Inav | Self::Betaflight => -0.1,
            Self::Other => return None,
        };
        Some(Attitude::from_deg(f32::from(angles.roll_decideg) * 0.1, f32::from(angles.pitch_decideg) * nose_up))
    }
}

/// Roll and pitch as they are sent, tenths of a degree.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Angles {
    /// Right wing down positive, -1800..=1800.
    pub roll_decideg: i16,
    /// -900..=900; which way is positive depends on the [`Firmware`].
    pub pitch_decideg: i16,
}

/// What the receiver understands.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Message {
    /// Which firmware it is.
    FcVariant(Firmware),
    /// Whether it is armed.
    Armed(bool),
    /// Where it is; none without a fix.
    RawGps(Option<Place>),
    /// Roll and pitch.
    Attitude(Angles),
    /// The current that is drawn, amperes. One that is not measured is sent as nothing.
    Current(f32),
    /// What day it is; none if its clock was never set.
    Rtc(Option<Day>),
    /// It does not answer this: an error frame, or a reply without a payload, which is what ArduPilot sends for what it
    /// does not know, and Betaflight without a clock.
    Refused(Function),
}

/// Bytes before the payload.
const HEADER: usize = 8;

/// The longest payload that is taken. MSP_STATUS has 11 to 40 bytes, by firmware and version.
const MAX_PAYLOAD: usize = 64;

const MAX_FRAME: usize = HEADER + MAX_PAYLOAD + 1;

/// Finds the frames of its messages in a stream of bytes.
#[derive(Debug, Default)]
pub struct Receiver {
    buffer: heapless::Vec<u8, MAX_FRAME>,
    /// Fewer bytes than these in the buffer tell nothing new.
    needed: usize,
    /// Frames that claimed to be one of its messages but failed their CRC, were too short or held impossible values;
    /// wraps.
    pub rejected: u32,
}

impl Receiver {
    /// An empty receiver.
    #[must_use]
    pub const fn new() -> Self {
        Self { buffer: heapless::Vec::new(), needed: 0, rejected: 0 }
    }

    /// Takes one byte; gives a message when it completes a valid frame of one.
    pub fn push(&mut self, byte: u8) -> Option<Message> {
        // Never full: `scan` leaves less than one frame behind.
        let _ = self.buffer.push(byte);
        if self.buffer.len() < self.needed { None } else { self.scan() }
    }

    /// Forgets the beginning of a frame, whose end does not come.
    pub fn forget(&mut self) {
        self.buffer.clear();
        self.needed = 0;
    }

    /// Reads frames off the front of the buffer until more bytes are needed.
    fn scan(&mut self) -> Option<Message> {
        loop {
            let Some(needed) = length_of_frame(&self.buffer) else {
                self.drop_front(1);
                continue;
            };
            self.needed = needed;
            let frame = self.buffer.get(..needed)?;
            let message = if is_intact(frame) { decode(frame) } else { None };
            if message.is_some() {
                self.drop_front(needed);
                return message;
            }
            // A true frame may start inside the false one: go on at its second byte.
            self.rejected = self.rejected.wrapping_add(1);
            self.drop_front(1);
        }
    }

    fn drop_front(&mut self, count: usize) {
        self.needed = 0;
        let count = count.min(self.buffer.len());
        self.buffer.rotate_left(count);
        self.buffer.truncate(self.buffer.len() - count);
    }
}

/// How many bytes the frame at the start of the buffer has, or those that tell it; none if there is no wanted frame.
fn length_of_frame(bytes: &[u8]) -> Option<usize> {
    match *bytes {
        [b'$', b'X', b'>' | b'!', _, f0, f1, n0, n1, ..] => {
            let payload = usize::from(u16::from_le_bytes([n0, n1]));
            let is_wanted = Function::of(u16::from_le_bytes([f0, f1])).is_some() && payload <= MAX_PAYLOAD;
            is_wanted.then_some(HEADER + payload + 1)
        }
        [] | [b'$'] | [b'$', b'X'] | [b'$', b'X', b'>' | b'!', ..] => Some(HEADER),
        _ => None,
    }
}

/// CRC of everything between the direction and the CRC itself. Bit by bit: its table would be a quarter of a kilobyte of
/// flash for some hundred bytes a second.
fn checksum(bytes: &[u8]) -> u8 {
    static CRC: Crc<u8, NoTable> = Crc::<u8, NoTable>::new(&CRC_8_DVB_S2);
    CRC.checksum(bytes)
}

fn is_intact(frame: &[u8]) -> bool {
    matches!(frame, [_, _, _, checked @ .., crc] if checksum(checked) == *crc)
}

/// What an intact frame means; none if its payload is too short or holds what cannot be.
fn decode(frame: &[u8]) -> Option<Message> {
    let [_, _, direction, _, f0, f1, _, _, payload @ .., _crc] = frame else { return None };
    let function = Function::of(u16::from_le_bytes([*f0, *f1]))?;
    if *direction == b'!' || payload.is_empty() {
        return Some(Message::Refused(function));
    }
    match (function, payload) {
        (Function::FcVariant, payload) => payload.get(..4).map(|name| Message::FcVariant(firmware(name))),
        (Function::Status, [_, _, _, _, _, _, flags, _, _, _, _profile, ..]) => Some(Message::Armed(flags & 1 != 0)),
        (Function::RawGps, payload) => raw_gps(payload),
        (Function::Attitude, [r0, r1, p0, p1, _, _, ..]) => angles([*r0, *r1], [*p0, *p1]),
        // Voltage, charge, signal strength, and the current in hundredths of an ampere.
        (Function::Analog, [_, _, _, _, _, c0, c1, ..]) => {
            Some(Message::Current(f32::from(i16::from_le_bytes([*c0, *c1])) * 0.01))
        }
        (Function::Rtc, payload) => rtc(payload),
        _ => None,
    }
}

fn firmware(name: &[u8]) -> Firmware {
    match name {
        b"ARDU" => Firmware::ArduPilot,
        b"INAV" => Firmware::Inav,
        b"BTFL" => Firmware::Betaflight,
        _ => Firmware::Other,
    }
}

fn angles(roll: [u8; 2], pitch: [u8; 2]) -> Option<Message> {
    let (roll_decideg, pitch_decideg) = (i16::from_le_bytes(roll), i16::from_le_bytes(pitch));
    let possible = (-1800..=1800).contains(&roll_decideg) && (-900..=900).contains(&pitch_decideg);
    possible.then_some(Message::Attitude(Angles { roll_decideg, pitch_decideg }))
}

/// Kind of fix, satellites, latitude and longitude in 1e-7 deg, height in metres, speed, course; later versions add the
/// dilution. The height is sent as if it had no sign; below the sea it has one.
fn raw_gps(payload: &[u8]) -> Option<Message> {
    let [fix, _, a0, a1, a2, a3, o0, o1, o2, o3, h0, h1, _, _, _, _, ..] = *payload else { return None };
    let degrees = |bytes| i32::from_le_bytes(bytes) as f32 * 1e-7;
    let height_m = f32::from(i16::from_le_bytes([h0, h1]));
    let place = Place::new(degrees([a0, a1, a2, a3]), degrees([o0, o1, o2, o3]), height_m);
    Some(Message::RawGps(place.filter(|_| fix != 0)))
}

/// ArduPilot and Betaflight send year, month, day, hour, minute, second and milliseconds, nine bytes; INAV seconds since
/// 1970 and milliseconds, six.
fn rtc(payload: &[u8]) -> Option<Message> {
    let day = match *payload {
        [y0, y1, month, day, _, _, _, _, _, ..] => date(u16::from_le_bytes([y0, y1]), month, day),
        [s0, s1, s2, s3, _, _, ..] => Day::from_unix_s(u32::from_le_bytes([s0, s1, s2, s3]).into()),
        _ => return None,
    };
    Some(Message::Rtc(day))
}

/// The day of a date of the Gregorian calendar, counted in years that begin in March, so that the leap day is the last of
/// them.
fn date(year: u16, month: u8, day: u8) -> Option<Day> {
    /// Days from March of the year 0 to 1970.
    const BEFORE_1970: u32 = 719_469;
    if !((1970..=9999).contains(&year) && (1..=12).contains(&month) && (1..=31).contains(&day)) {
        return None;
    }
    let since_march = (u32::from(month) + 9) % 12;
    let years = u32::from(year) - u32::from(since_march >= 10);
    let days = 365 * years + years / 4 - years / 100 + years / 400 + (153 * since_march + 2) / 5 + u32::from(day);
    Day::from_unix_s(u64::from(days - BEFORE_1970) * 86_400)
}

/// Asks an autopilot for something.
#[must_use]
pub fn request(function: Function) -> [u8; 9] {
    let [f0, f1] = (function as u16).to_le_bytes();
    let mut frame = [b'$', b'X', b'<', 0, f0, f1, 0, 0, 0];
    seal(&mut frame);
    frame
}

/// MSP2_SENSOR_COMPASS: what the compass of this instance reads, for [INAV](https://github.com/iNavFlight/inav) and
/// ArduPilot. It is sent as a request, and no reply comes.
///
/// The time is in milliseconds. The field, which is x forward, y right, z down, is sent in whole milligauss (1 uT is 10
/// mG), which end at +-3,276.7 uT.
#[must_use]
pub fn compass(instance: u8, time_ms: u32, field: Field<Body>) -> [u8; 20] {
    // The cast saturates, and takes what is no number to nothing.
    let milligauss = |ut: f32| (libm::roundf(ut * 10.0) as i16).to_le_bytes();
    let ([t0, t1, t2, t3], [x0, x1]) = (time_ms.to_le_bytes(), milligauss(field.ut.x));
    let ([y0, y1], [z0, z1]) = (milligauss(field.ut.y), milligauss(field.ut.z));
    let mut frame = [b'$', b'X', b'<', 0, 0x04, 0x1F, 11, 0, instance, t0, t1, t2, t3, x0, x1, y0, y1, z0, z1, 0];
    seal(&mut frame);
    frame
}

/// Puts in the CRC at the end.
fn seal(frame: &mut [u8]) {
    if let [_, _, _, checked @ .., crc] = frame {
        *crc = checksum(checked);
    }
}

#[cfg(test)]
mod tests;
