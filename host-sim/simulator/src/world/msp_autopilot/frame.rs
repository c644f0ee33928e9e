//! MSP version 2 requests as an autopilot decodes them, and the payloads of its replies.

use testkit::frames::crc_8_dvb_s2;

const FC_VARIANT: u16 = 2;
const MSP_STATUS: u16 = 101;
const RAW_IMU: u16 = 102;
const RAW_GPS: u16 = 106;
const MSP_ATTITUDE: u16 = 108;
const MSP_ANALOG: u16 = 110;
const MSP_RTC: u16 = 247;
const SENSOR_COMPASS: u16 = 0x1F04;
pub(super) const REBOOT: u16 = 68;
pub(super) const EEPROM_WRITE: u16 = 250;
pub(super) const SET_SETTING: u16 = 0x1004;
pub(super) const SETTING_INFO: u16 = 0x1007;

#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct MspRequest {
    pub function_code: u16,
    pub payload: Vec<u8>,
}

impl MspRequest {
    /// Whether the function is in the sensor range, which is never answered.
    pub fn is_sensor_function(&self) -> bool {
        (0x1F00..=0x1FFF).contains(&self.function_code)
    }

    /// Time stamp (ms) and field (milligauss) if the request is a compass sample.
    pub fn compass_sample(&self) -> Option<(u32, [i16; 3])> {
        let [_instance, t0, t1, t2, t3, x0, x1, y0, y1, z0, z1] = *self.payload.as_slice() else { return None };
        let field_mg = [[x0, x1], [y0, y1], [z0, z1]].map(i16::from_le_bytes);
        (self.function_code == SENSOR_COMPASS).then_some((u32::from_le_bytes([t0, t1, t2, t3]), field_mg))
    }
}

#[derive(Clone, Debug, Default)]
pub(super) struct RequestReader(Vec<u8>);

impl RequestReader {
    /// Processes one byte and returns a completed request; bytes outside frames are dropped.
    pub fn push_byte(&mut self, byte: u8) -> Option<MspRequest> {
        self.0.push(byte);
        let begun = self.0.len().min(3);
        if self.0[..begun] != b"$X<"[..begun] {
            self.0.clear();
            return None;
        }
        let &[_, _, _, _flags, f0, f1, n0, n1, ref payload @ .., crc] = self.0.as_slice() else { return None };
        if payload.len() < usize::from(u16::from_le_bytes([n0, n1])) {
            return None;
        }
        let request = MspRequest { function_code: u16::from_le_bytes([f0, f1]), payload: payload.to_vec() };
        let is_intact = crc_8_dvb_s2(&self.0[3..self.0.len() - 1]) == crc;
        self.0.clear();
        is_intact.then_some(request)
    }
}

/// Reply payload of a firmware; `None` for an unknown function.
pub(super) fn reply_payload(firmware: MspFirmware, function: u16, autopilot_state: &AutopilotState) -> Option<Vec<u8>> {
    match function {
        FC_VARIANT => Some(match firmware {
            MspFirmware::ArduPilot => b"ARDU".to_vec(),
            MspFirmware::Inav => b"INAV".to_vec(),
        }),
        MSP_STATUS => Some(encode_status_reply(firmware, autopilot_state.is_armed)),
        RAW_IMU => encode_raw_imu_reply(firmware, autopilot_state),
        RAW_GPS => Some(encode_raw_gps_reply(autopilot_state)),
        MSP_ATTITUDE => Some(encode_attitude_reply(firmware, autopilot_state)),
        MSP_ANALOG => Some(encode_analog_reply(firmware, autopilot_state.current_a)),
        MSP_RTC => Some(encode_rtc_reply(firmware, autopilot_state.unix_s)),
        _ => None,
    }
}

fn encode_attitude_reply(firmware: MspFirmware, autopilot_state: &AutopilotState) -> Vec<u8> {
    let decidegrees = |rad: f64| rad.to_degrees() * 10.0;
    let yaw_deg = autopilot_state.yaw_rad.to_degrees().rem_euclid(360.0) as i16;
    // ArduPilot truncates tenths of a degree, INAV rounds.
    let (roll, pitch) = match firmware {
        MspFirmware::ArduPilot => {
            (decidegrees(autopilot_state.roll_rad) as i16, decidegrees(autopilot_state.pitch_rad) as i16)
        }
        MspFirmware::Inav => (
            decidegrees(autopilot_state.roll_rad).round() as i16,
            decidegrees(-autopilot_state.pitch_rad).round() as i16,
        ),
    };
    [roll, pitch, yaw_deg].map(i16::to_le_bytes).concat()
}

/// Status payload: 22 bytes for ArduPilot, 11 for INAV. The mode flags start at byte 6, with the armed flag in bit 0;
/// INAV has other flags set as well.
fn encode_status_reply(firmware: MspFirmware, is_armed: bool) -> Vec<u8> {
    let (length, mode_flags) = match firmware {
        MspFirmware::ArduPilot => (22, 0),
        MspFirmware::Inav => (11, 0x0A),
    };
    let mut payload = vec![0; length];
    payload[6] = u8::from(is_armed) | mode_flags;
    payload
}

/// Accelerometer, gyro and magnetometer of INAV, of which the module uses the gyro: whole deg/s in axes forward, left,
/// up. ArduPilot does not support it.
fn encode_raw_imu_reply(firmware: MspFirmware, autopilot_state: &AutopilotState) -> Option<Vec<u8>> {
    let [p, q, r] = autopilot_state.body_rates_rad_s.map(|rate| rate.to_degrees().round() as i16);
    let numbers = [0, 0, 512, p, -q, -r, 0, 0, 0];
    (firmware == MspFirmware::Inav).then(|| numbers.map(i16::to_le_bytes).concat())
}

fn encode_raw_gps_reply(autopilot_state: &AutopilotState) -> Vec<u8> {
    let (latitude_deg, longitude_deg, height_m) = autopilot_state.position.unwrap_or_default();
    let mut payload = vec![if autopilot_state.position.is_some() { 2 } else { 0 }, 9];
    payload.extend(((latitude_deg * 1e7).round() as i32).to_le_bytes());
    payload.extend(((longitude_deg * 1e7).round() as i32).to_le_bytes());
    payload.extend((height_m as i16).to_le_bytes());
    // Remaining fields of MSP_RAW_GPS: speed, course, dilution of precision.
    payload.extend([0; 6]);
    payload
}

/// Voltage, charge, signal strength and current; ArduPilot repeats the voltage. Current is 0 if not measured.
fn encode_analog_reply(firmware: MspFirmware, current_a: Option<f64>) -> Vec<u8> {
    let mut payload = vec![168, 0, 0, 0, 0];
    payload.extend(((current_a.unwrap_or(0.0) * 100.0).round() as i16).to_le_bytes());
    if firmware == MspFirmware::ArduPilot {
        payload.extend(1680_u16.to_le_bytes());
    }
    payload
}

fn encode_rtc_reply(firmware: MspFirmware, unix_s: Option<u64>) -> Vec<u8> {
    match firmware {
        MspFirmware::Inav => [&(unix_s.unwrap_or(0) as u32).to_le_bytes()[..], &[0, 0]].concat(),
        MspFirmware::ArduPilot => {
            let (year, month, day) = unix_s.map_or((1900, 1, 0), utc_date);
            let second = unix_s.unwrap_or(0) % 86_400;
            let [y0, y1] = year.to_le_bytes();
            let time = [second / 3_600, second / 60 % 60, second % 60].map(|time_field| time_field as u8);
            [&[y0, y1, month, day][..], &time, &[0, 0]].concat()
        }
    }
}

/// Calendar date of a Unix time, counted by years and months, independent of the library.
fn utc_date(unix_s: u64) -> (u16, u8, u8) {
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

/// Firmware that the simulated autopilot imitates.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MspFirmware {
    /// ArduPilot, whose pitch is positive nose up.
    ArduPilot,
    /// INAV, whose pitch is positive nose down.
    Inav,
}

/// State of the autopilot at an instant.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct AutopilotState {
    /// Roll, radians, right wing down positive.
    pub roll_rad: f64,
    /// Pitch, radians, nose up positive.
    pub pitch_rad: f64,
    /// Reported heading, radians.
    pub yaw_rad: f64,
    /// Body rates p, q, r, radians per second.
    pub body_rates_rad_s: [f64; 3],
    /// Whether the autopilot is armed.
    pub is_armed: bool,
    /// Latitude and longitude in degrees, north and east positive, and height in metres; `None` without a fix.
    pub position: Option<(f64, f64, f64)>,
    /// Unix time in seconds, UTC; `None` if the clock is not set.
    pub unix_s: Option<u64>,
    /// Battery current, amperes; `None` if not measured.
    pub current_a: Option<f64>,
}
