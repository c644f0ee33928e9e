//! MSP version 2: requests and compass readings to an autopilot, and its replies.
//!
//! A frame is `$X`, a direction (`<` request, `>` reply, `!` error), flags, function and payload length of two bytes
//! each, low byte first, the payload, and CRC-8/DVB-S2 of all bytes from the flags on
//! (<https://github.com/iNavFlight/inav/wiki/MSP-V2>). The only crate for version 2 needs an allocator of an old
//! nightly compiler and has had no release since 2020.
//!
//! The receiver searches for headers of a few replies, checks the CRC, and skips all other bytes one at a time
//! (`frame_buffer.rs`).
//!
//! # Roll and pitch
//!
//! MSP_ATTITUDE has roll and pitch in tenths of a degree. Roll is positive right wing down in all firmwares; the sign
//! of pitch depends on the firmware, which MSP_FC_VARIANT reports:
//!
//! | firmware | pitch | source |
//! |---|---|---|
//! | `ARDU` | nose up | ArduPilot, AP_MSP_Telem_Backend.cpp, `msp_process_out_attitude`: `ahrs.pitch_sensor * 0.1`, the AHRS's own |
//! | `INAV` | nose down | INAV, fc_msp.c: `attitude.values.pitch`; telemetry/mavlink.c negates it for MAVLink's nose up |
//! | `BTFL` | nose down | Betaflight, msp.c, imu.c and telemetry/mavlink.c: as INAV's |
//!
//! INAV and Betaflight have body axes forward, left, up, and Earth axes north, west, up (imu.c: pitch is
//! `asin(-rMat[2][0])`, roll is `atan2(rMat[2][1], rMat[2][2])`; `rMat[2][0]` and `rMat[2][1]` are the upward
//! components of nose and left wing). ArduPilot's ports for DJI's goggles and for MSP DisplayPort can report `BTFL`
//! with a pitch positive nose up; its MSP port proper (SERIALn_PROTOCOL 32) reports `ARDU`.
//!
//! # Body rates
//!
//! MSP_RAW_IMU has the gyro's rates at byte 6, three integers of two bytes:
//!
//! | firmware | unit | axes | source |
//! |---|---|---|---|
//! | `INAV` | 1 deg/s, rounded | forward, left, up | INAV, sensors/gyro.c, `gyroRateDps`: `lrintf(gyro.gyroADCf[axis])` |
//! | `BTFL` | the sensor's counts: 1/16.4 deg/s, with some sensors 0.07 or 1/8.2 | forward, left, up | Betaflight, sensors/gyro.c, `gyroRateDps`: divided by `gyroDev.scale` |
//! | `ARDU` | not supported: an empty reply | | ArduPilot, AP_MSP_Telem_Backend.cpp, `msp_process_out_command` |
//!
//! Only INAV's are used: Betaflight's unit depends on a sensor that it does not report.
//!
//! # Armed state
//!
//! MSP_STATUS has the flight mode flags at byte 6. Their bits are the boxes in the order of MSP_BOXIDS. ARM is the
//! first box in INAV (fc_msp_box.c, `initActiveBoxIds`) and in Betaflight (msp_box.c, `BOXARM` is 0 and always
//! enabled); ArduPilot sets only this bit (`get_osd_flight_mode_bitmask`).

use crc::{CRC_8_DVB_S2, Crc};

use super::frame_buffer::FrameBuffer;
use autoswing::earth::{Date, Position};
use autoswing::frames::{Body, Field, RollPitch};
use autoswing_module::messages::ParameterName;

/// Function of a request or reply.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u16)]
pub enum MspFunction {
    /// MSP_FC_VARIANT: firmware of the flight controller.
    FcVariant = 2,
    /// MSP_STATUS: armed state, among others.
    Status = 101,
    /// MSP_RAW_IMU: body rates.
    RawImu = 102,
    /// MSP_RAW_GPS: GPS position.
    RawGps = 106,
    /// MSP_ATTITUDE: roll and pitch.
    Attitude = 108,
    /// MSP_ANALOG: battery current.
    Analog = 110,
    /// MSP_RTC: date of the real-time clock.
    Rtc = 247,
    /// MSP_REBOOT: restart.
    Reboot = 68,
    /// MSP_EEPROM_WRITE: save all settings.
    EepromWrite = 250,
    /// MSP2_COMMON_SET_SETTING: change a setting.
    SetSetting = 0x1004,
    /// MSP2_COMMON_SETTING_INFO: a setting with its kind, choices and number.
    SettingInfo = 0x1007,
}

impl MspFunction {
    /// Functions with replies that are decoded.
    const ALL_FUNCTIONS: [Self; 10] = [
        Self::FcVariant,
        Self::Status,
        Self::RawImu,
        Self::RawGps,
        Self::Attitude,
        Self::Analog,
        Self::Rtc,
        Self::EepromWrite,
        Self::SetSetting,
        Self::SettingInfo,
    ];

    fn from_number(number: u16) -> Option<Self> {
        Self::ALL_FUNCTIONS.into_iter().find(|function| *function as u16 == number)
    }
}

/// The firmware of an autopilot.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum AutopilotFirmware {
    /// ArduPilot.
    ArduPilot,
    /// INAV.
    Inav,
    /// Betaflight.
    Betaflight,
    /// Another firmware, with unknown signs.
    Other,
}

impl AutopilotFirmware {
    /// Converts MSP_ATTITUDE to FRD axes; none if the signs are unknown.
    #[must_use]
    pub fn attitude_from_angles(self, angles: MspAngles) -> Option<RollPitch> {
        let nose_up = match self {
            Self::ArduPilot => 0.1,
            Self::Inav | Self::Betaflight => -0.1,
            Self::Other => return None,
        };
        Some(RollPitch::from_deg(f32::from(angles.roll_decideg) * 0.1, f32::from(angles.pitch_decideg) * nose_up))
    }
}

/// Body rates p, q, r of INAV's MSP_RAW_IMU, rad/s.
#[must_use]
pub fn inav_body_rates_rad_s([forward, left, up]: [i16; 3]) -> [f32; 3] {
    let deg_s = [f32::from(forward), -f32::from(left), -f32::from(up)];
    deg_s.map(f32::to_radians)
}

/// Angles of MSP_ATTITUDE: roll and pitch in tenths of a degree, heading in degrees.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MspAngles {
    /// Roll, tenths of a degree, -1800..=1800, positive right wing down.
    pub roll_decideg: i16,
    /// Pitch, tenths of a degree, -900..=900; the sign depends on the firmware.
    pub pitch_decideg: i16,
    /// Heading of any reference, degrees, 0..=359: `yaw_sensor` of ArduPilot, `attitude.values.yaw` of INAV and
    /// Betaflight, truncated.
    pub heading_deg: i16,
}

/// Decoded reply.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum MspReply {
    /// Firmware of the flight controller.
    FcVariant(AutopilotFirmware),
    /// Whether the vehicle is armed.
    Armed(bool),
    /// Position; none without a fix.
    RawGps(Option<Position>),
    /// Roll, pitch and heading.
    Attitude(MspAngles),
    /// Gyro's rates, in unit and axes of the firmware.
    Gyro([i16; 3]),
    /// Current, amperes; 0 if it is not measured.
    Current(f32),
    /// Date; none if the clock was never set.
    Rtc(Option<Date>),
    /// Setting of INAV.
    Setting(SettingInfo),
    /// A setting was changed, or all were saved.
    Done,
    /// Function that the autopilot does not support: an error frame, or a reply without a payload, which ArduPilot
    /// sends for unknown functions and Betaflight without a clock.
    Refused(MspFunction),
}

/// Setting of INAV, as MSP2_COMMON_SETTING_INFO reports it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SettingInfo {
    /// Name of the setting.
    pub name: ParameterName,
    /// Number, of a choice its position.
    pub number: f32,
    /// Length of the number, bytes.
    pub length: u8,
    /// Number of the choice `MSP`, if it has one, which differs between versions.
    pub msp_choice: Option<f32>,
}

const FRAME_HEADER_SIZE: usize = 8;

/// Longest accepted payload, bytes: INAV's `mag_hardware` with the names of its choices has 153 in version 8, 162 in 9.
const MAX_PAYLOAD_LENGTH: usize = 192;

const MAX_FRAME_LENGTH: usize = FRAME_HEADER_SIZE + MAX_PAYLOAD_LENGTH + 1;

/// Receiver of supported replies in a stream of bytes. It rejects frames with a wrong CRC, a short payload or impossible
/// values.
#[derive(Debug, Default)]
pub struct MspReceiver {
    buffer: FrameBuffer<MAX_FRAME_LENGTH>,
}

impl MspReceiver {
    /// Processes a received byte; returns the message that it completes.
    pub fn push_byte(&mut self, byte: u8) -> Option<MspReply> {
        self.buffer.push_byte(byte, frame_length, decode_reply)
    }

    /// Drops a partly received frame.
    pub fn discard_partial(&mut self) {
        self.buffer.clear();
    }

    /// Number of rejected frames; wraps.
    #[must_use]
    pub const fn rejected_count(&self) -> u32 {
        self.buffer.rejected_count
    }
}

fn frame_length(bytes: &[u8]) -> Option<usize> {
    match *bytes {
        [b'$', b'X', b'>' | b'!', _, f0, f1, n0, n1, ..] => {
            let payload = usize::from(u16::from_le_bytes([n0, n1]));
            let is_wanted =
                MspFunction::from_number(u16::from_le_bytes([f0, f1])).is_some() && payload <= MAX_PAYLOAD_LENGTH;
            is_wanted.then_some(FRAME_HEADER_SIZE + payload + 1)
        }
        [] | [b'$'] | [b'$', b'X'] | [b'$', b'X', b'>' | b'!', ..] => Some(FRAME_HEADER_SIZE),
        _ => None,
    }
}

/// CRC of the bytes between the direction and the CRC.
fn checksum(bytes: &[u8]) -> u8 {
    static CRC: Crc<u8> = Crc::<u8>::new(&CRC_8_DVB_S2);
    CRC.checksum(bytes)
}

/// Decodes a frame; none for a wrong CRC, a short payload or impossible values.
fn decode_reply(frame: &[u8]) -> Option<MspReply> {
    let [_, _, _, checked @ .., crc] = frame else { return None };
    if checksum(checked) != *crc {
        return None;
    }
    let [_, _, direction, _, f0, f1, _, _, payload @ .., _crc] = frame else { return None };
    let function = MspFunction::from_number(u16::from_le_bytes([*f0, *f1]))?;
    let is_answer = matches!(function, MspFunction::SetSetting | MspFunction::EepromWrite);
    if *direction == b'>' && is_answer {
        return Some(MspReply::Done);
    }
    if *direction == b'!' || payload.is_empty() {
        return Some(MspReply::Refused(function));
    }
    match (function, payload) {
        (MspFunction::FcVariant, payload) => payload.get(..4).map(|name| MspReply::FcVariant(parse_firmware(name))),
        (MspFunction::Status, [_, _, _, _, _, _, flags, _, _, _, _profile, ..]) => {
            Some(MspReply::Armed(flags & 1 != 0))
        }
        (MspFunction::RawGps, payload) => parse_raw_gps(payload),
        (MspFunction::Attitude, [r0, r1, p0, p1, h0, h1, ..]) => parse_angles([[*r0, *r1], [*p0, *p1], [*h0, *h1]]),
        (MspFunction::RawImu, [_, _, _, _, _, _, x0, x1, y0, y1, z0, z1, ..]) => {
            Some(MspReply::Gyro([[*x0, *x1], [*y0, *y1], [*z0, *z1]].map(i16::from_le_bytes)))
        }
        // Voltage, charge, signal strength, then the current in hundredths of an ampere.
        (MspFunction::Analog, [_, _, _, _, _, c0, c1, ..]) => {
            Some(MspReply::Current(f32::from(i16::from_le_bytes([*c0, *c1])) * 0.01))
        }
        (MspFunction::Rtc, payload) => parse_rtc(payload),
        (MspFunction::SettingInfo, payload) => parse_setting(payload).map(MspReply::Setting),
        _ => None,
    }
}

/// Name, parameter group, type, section, mode, least and largest number, index, profile and number of profiles; the names
/// of all choices; the number (INAV, fc_msp.c, `mspSettingInfoCommand`; settings.h, `setting_type_e`).
fn parse_setting(payload: &[u8]) -> Option<SettingInfo> {
    const FIELDS_LENGTH: usize = 17;
    const MAX_INTEGER_KIND: u8 = 4;
    // The module asks for no longer name.
    let name_length = payload.iter().take(size_of::<ParameterName>() + 1).position(|byte| *byte == 0)?;
    let (name, rest) = payload.split_at_checked(name_length)?;
    let [_, fields @ ..] = rest else { return None };
    let (&[_, _, kind, _, mode, least, ..], values) = fields.split_first_chunk::<FIELDS_LENGTH>()?;
    if kind > MAX_INTEGER_KIND {
        return None;
    }
    let length = 1_usize << (kind / 2);
    let (choices, number) = values.split_at_checked(values.len().checked_sub(length)?)?;
    let is_negative = kind % 2 == 1 && number.last().is_some_and(|byte| byte & 0x80 != 0);
    let mut bytes = [if is_negative { 0xFF } else { 0 }; 4];
    bytes.iter_mut().zip(number).for_each(|(target, byte)| *target = *byte);
    let msp_choice = choices.split(|byte| *byte == 0).position(|choice| choice == b"MSP").filter(|_| mode != 0);
    Some(SettingInfo {
        name: ParameterName::new(core::str::from_utf8(name).ok()?),
        number: i32::from_le_bytes(bytes) as f32,
        length: length as u8,
        msp_choice: msp_choice.map(|position| f32::from(least) + position as f32),
    })
}

fn parse_firmware(name: &[u8]) -> AutopilotFirmware {
    match name {
        b"ARDU" => AutopilotFirmware::ArduPilot,
        b"INAV" => AutopilotFirmware::Inav,
        b"BTFL" => AutopilotFirmware::Betaflight,
        _ => AutopilotFirmware::Other,
    }
}

fn parse_angles(bytes: [[u8; 2]; 3]) -> Option<MspReply> {
    let [roll_decideg, pitch_decideg, heading_deg] = bytes.map(i16::from_le_bytes);
    let possible = (-1800..=1800).contains(&roll_decideg) && (-900..=900).contains(&pitch_decideg);
    possible.then_some(MspReply::Attitude(MspAngles { roll_decideg, pitch_decideg, heading_deg }))
}

/// Kind of fix, satellites, latitude and longitude in 1e-7 deg, height in metres, speed, course; later versions append
/// the dilution. The height is declared unsigned, but is negative below sea level.
fn parse_raw_gps(payload: &[u8]) -> Option<MspReply> {
    let [fix, _, a0, a1, a2, a3, o0, o1, o2, o3, h0, h1, _, _, _, _, ..] = *payload else { return None };
    let degrees = |bytes| i32::from_le_bytes(bytes) as f32 * 1e-7;
    let height_m = f32::from(i16::from_le_bytes([h0, h1]));
    let position = Position::new(degrees([a0, a1, a2, a3]), degrees([o0, o1, o2, o3]), height_m);
    Some(MspReply::RawGps(position.filter(|_| fix != 0)))
}

/// ArduPilot and Betaflight send year, month, day, hour, minute, second and milliseconds, nine bytes; INAV seconds
/// since 1970 and milliseconds, six.
fn parse_rtc(payload: &[u8]) -> Option<MspReply> {
    let day = match *payload {
        [y0, y1, month, day, _, _, _, _, _, ..] => parse_date(u16::from_le_bytes([y0, y1]), month, day),
        [s0, s1, s2, s3, _, _, ..] => Date::from_unix_s(u32::from_le_bytes([s0, s1, s2, s3]).into()),
        _ => return None,
    };
    Some(MspReply::Rtc(day))
}

/// Converts a date of the Gregorian calendar. Years begin in March, so that the leap day is their last.
fn parse_date(year: u16, month: u8, day: u8) -> Option<Date> {
    /// Days from March of the year 0 to 1970.
    const DAYS_BEFORE_1970: u32 = 719_469;
    if !((1970..=9999).contains(&year) && (1..=12).contains(&month) && (1..=31).contains(&day)) {
        return None;
    }
    let since_march = (u32::from(month) + 9) % 12;
    let years = u32::from(year) - u32::from(since_march >= 10);
    let days = 365 * years + years / 4 - years / 100 + years / 400 + (153 * since_march + 2) / 5 + u32::from(day);
    Date::from_unix_s(u64::from(days - DAYS_BEFORE_1970) * 86_400)
}

/// Encodes a request.
#[must_use]
pub fn encode_request(function: MspFunction) -> [u8; 9] {
    let [f0, f1] = (function as u16).to_le_bytes();
    let mut frame = [b'$', b'X', b'<', 0, f0, f1, 0, 0, 0];
    write_checksum(&mut frame);
    frame
}

/// Encoded request about a setting.
pub type SettingRequest = heapless::Vec<u8, { FRAME_HEADER_SIZE + size_of::<ParameterName>() + 1 + 4 + 1 }>;

/// Encodes a request for a setting, or its change to the bytes of a number.
#[must_use]
pub fn encode_setting_request(name: ParameterName, new_number: &[u8]) -> SettingRequest {
    let function = if new_number.is_empty() { MspFunction::SettingInfo } else { MspFunction::SetSetting };
    let name_length = name.0.iter().position(|byte| *byte == 0).unwrap_or(name.0.len());
    let payload_length = (name_length + 1 + new_number.len()) as u8;
    let [f0, f1] = (function as u16).to_le_bytes();
    let mut frame = SettingRequest::new();
    // The capacity is that of the longest name and number.
    for part in [
        &[b'$', b'X', b'<', 0, f0, f1, payload_length, 0],
        name.0.get(..name_length).unwrap_or_default(),
        &[0],
        new_number,
        &[0],
    ] {
        let _ = frame.extend_from_slice(part);
    }
    write_checksum(&mut frame);
    frame
}

/// MSP2_SENSOR_COMPASS: reading of a numbered compass, for [INAV](https://github.com/iNavFlight/inav) and ArduPilot. It
/// is a request without a reply.
///
/// The time is in milliseconds. The field, x forward, y right, z down, is sent in whole milligauss (1 uT is 10 mG),
/// limited to +-3,276.7 uT.
#[must_use]
pub fn compass_message(instance: u8, time_ms: u32, field: Field<Body>) -> [u8; 20] {
    // The cast saturates, and converts NaN to 0.
    let milligauss = |ut: f32| (libm::roundf(ut * 10.0) as i16).to_le_bytes();
    let ([t0, t1, t2, t3], [x0, x1]) = (time_ms.to_le_bytes(), milligauss(field.ut.x));
    let ([y0, y1], [z0, z1]) = (milligauss(field.ut.y), milligauss(field.ut.z));
    let mut frame = [b'$', b'X', b'<', 0, 0x04, 0x1F, 11, 0, instance, t0, t1, t2, t3, x0, x1, y0, y1, z0, z1, 0];
    write_checksum(&mut frame);
    frame
}

fn write_checksum(frame: &mut [u8]) {
    if let [_, _, _, checked @ .., crc] = frame {
        *crc = checksum(checked);
    }
}

#[cfg(test)]
mod tests;
