//! An autopilot that answers: MAVLink both ways, with the attitude of an [`AttitudeSource`].
//!
//! A pure device on the time that it is told: bytes in, bytes out. What it does when it is asked for messages is what its
//! firmware does, as far as a module can tell. [`FarEnd`](super::far_end::FarEnd) puts it at a cable.

mod frame;

use mavlink::MessageData;
use mavlink::dialects::common::{
    ATTITUDE_DATA, COMMAND_LONG_DATA, GLOBAL_POSITION_INT_DATA, HEARTBEAT_DATA, MavCmd, MavMessage, MavResult,
    SYS_STATUS_DATA, SYSTEM_TIME_DATA,
};
use mavlink::{MavlinkVersion, Message};

use super::attitude_source::AttitudeSource;
use super::state::TrueState;
pub use frame::{Frame, Reader, command_long};

/// What an autopilot makes of requests.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Firmware {
    /// ArduPilot, an aeroplane at its default loop rate: attitude once a second until it is asked, and then no oftener than
    /// 40 times, for what its loop of 50 Hz cannot do is denied (`GCS_MAVLINK::cap_message_interval`).
    ArduPilot,
    /// PX4 in its mode "Onboard": 100 attitudes a second from the beginning, and whatever it is asked for.
    Px4,
    /// Does not know the command, and does not answer it, but knows streams.
    Streams,
    /// Takes no notice of anybody; attitude once a second.
    Deaf,
}

impl Firmware {
    /// Attitudes a second before it is asked.
    const fn unasked_hz(self) -> f64 {
        match self {
            Self::Px4 => 100.0,
            Self::ArduPilot | Self::Streams | Self::Deaf => 1.0,
        }
    }

    /// The shortest time between two messages that it agrees to, microseconds.
    const fn least_interval_us(self) -> f32 {
        match self {
            Self::ArduPilot => 25_000.0,
            Self::Px4 | Self::Streams | Self::Deaf => 1_000.0,
        }
    }
}

/// A message that is sent again and again.
#[derive(Clone, Copy, Debug)]
struct Stream {
    id: u32,
    period_us: u64,
    due_us: u64,
}

/// Where it says it is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Place {
    /// Degrees north.
    pub latitude_deg: f64,
    /// Degrees east.
    pub longitude_deg: f64,
    /// Metres above the sea.
    pub height_m: f64,
}

/// Xi'an, where the aircraft of Liu 2007 table 1 was measured.
pub const XIAN: Place = Place { latitude_deg: 34.341_6, longitude_deg: 108.939_8, height_m: 400.0 };

/// 2026-01-01, Unix time in microseconds: its time when the clock of the simulation starts.
pub const BEGAN_UNIX_US: u64 = 1_767_225_600_000_000;

/// The messages that it can send.
const KNOWN: [u32; 5] =
    [HEARTBEAT_DATA::ID, SYS_STATUS_DATA::ID, ATTITUDE_DATA::ID, GLOBAL_POSITION_INT_DATA::ID, SYSTEM_TIME_DATA::ID];

/// What it has found out itself.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Seen {
    /// Its attitude is that of an aircraft like this.
    pub truth: TrueState,
    /// Whether it is armed.
    pub is_armed: bool,
    /// The current that its battery monitor measures, amperes; none if it has none.
    pub current_a: Option<f64>,
}

/// The module's component.
const MODULE: u8 = 158;

const HEARTBEAT_US: u64 = 1_000_000;

/// The autopilot.
pub struct MavlinkAutopilot {
    source: AttitudeSource,
    firmware: Firmware,
    place: Option<Place>,
    started_us: u64,
    streams: Vec<Stream>,
    reader: Reader,
    answers: Vec<u8>,
    heard: Vec<Frame>,
}

impl MavlinkAutopilot {
    /// Switched on at an instant, with this source's attitude, in Xi'an.
    #[must_use]
    pub fn new(source: AttitudeSource, firmware: Firmware, now_us: u64) -> Self {
        let mut autopilot = Self {
            source,
            firmware,
            place: Some(XIAN),
            started_us: now_us,
            streams: Vec::new(),
            reader: Reader::default(),
            answers: Vec::new(),
            heard: Vec::new(),
        };
        autopilot.restart(now_us);
        autopilot
    }

    /// Restarts: its clock begins anew, and what it was asked for is forgotten.
    pub fn restart(&mut self, now_us: u64) {
        self.started_us = now_us;
        self.streams = vec![Stream { id: HEARTBEAT_DATA::ID, period_us: HEARTBEAT_US, due_us: now_us }];
        self.stream(ATTITUDE_DATA::ID, self.firmware.unasked_hz(), now_us);
        self.answers.clear();
    }

    /// It is here; none: it has no fix.
    pub fn set_place(&mut self, place: Option<Place>) {
        self.place = place;
    }

    /// How often a message is sent, per second; none: it is not.
    #[must_use]
    pub fn rate_hz(&self, id: u32) -> Option<f64> {
        self.streams.iter().find(|stream| stream.id == id).map(|stream| 1e6 / stream.period_us as f64)
    }

    /// Frames of others that have come since this was asked last.
    pub fn take_heard(&mut self) -> Vec<Frame> {
        std::mem::take(&mut self.heard)
    }

    /// Bytes that came and are no frame.
    #[must_use]
    pub fn garbage(&self) -> u64 {
        self.reader.garbage()
    }

    /// Takes bytes that have come at an instant.
    pub fn receive(&mut self, now_us: u64, bytes: &[u8]) {
        for frame in self.reader.read(bytes) {
            self.hear(now_us, &frame);
            self.heard.push(frame);
        }
    }

    /// When the next message is due.
    #[must_use]
    pub fn due_us(&self) -> u64 {
        let streams = self.streams.iter().map(|stream| stream.due_us);
        streams.min().filter(|_| self.answers.is_empty()).unwrap_or(0)
    }

    /// What is sent at an instant of what it has seen; each message of attitude goes through `tamper`.
    pub fn send(&mut self, now_us: u64, seen: &Seen, mut tamper: impl FnMut(&mut ATTITUDE_DATA)) -> Vec<u8> {
        let mut bytes = std::mem::take(&mut self.answers);
        let clock_us = now_us - self.started_us;
        for at in 0..self.streams.len() {
            let Stream { id, period_us, due_us } = self.streams[at];
            if due_us > now_us {
                continue;
            }
            self.streams[at].due_us = (due_us + period_us).max(now_us + 1);
            bytes.extend(match id {
                HEARTBEAT_DATA::ID => self.source.heartbeat_message(seen.is_armed),
                ATTITUDE_DATA::ID => {
                    let mut attitude = self.source.attitude(&seen.truth, clock_us);
                    tamper(&mut attitude);
                    self.source.encode(&attitude)
                }
                SYS_STATUS_DATA::ID => self.source.status_message(seen.current_a),
                GLOBAL_POSITION_INT_DATA::ID => self.position(clock_us),
                _ => {
                    let time_unix_usec = BEGAN_UNIX_US + now_us;
                    self.source.encode(&SYSTEM_TIME_DATA { time_unix_usec, time_boot_ms: (clock_us / 1000) as u32 })
                }
            });
        }
        bytes
    }

    fn position(&mut self, clock_us: u64) -> Vec<u8> {
        let place = self.place.unwrap_or(Place { latitude_deg: 0.0, longitude_deg: 0.0, height_m: 0.0 });
        self.source.encode(&GLOBAL_POSITION_INT_DATA {
            time_boot_ms: (clock_us / 1000) as u32,
            lat: (place.latitude_deg * 1e7) as i32,
            lon: (place.longitude_deg * 1e7) as i32,
            alt: (place.height_m * 1e3) as i32,
            hdg: u16::MAX,
            ..Default::default()
        })
    }

    fn hear(&mut self, now_us: u64, frame: &Frame) {
        if self.firmware == Firmware::Deaf {
            return;
        }
        if let Ok(MavMessage::COMMAND_LONG(command)) = MavMessage::parse(MavlinkVersion::V2, frame.id, &frame.payload)
            && self.is_for_it(command.target_system, command.target_component)
        {
            self.obey(now_us, frame, &command);
        }
        if frame.id == REQUEST_DATA_STREAM && self.is_for_it(frame.byte(2), frame.byte(3)) && frame.byte(4) == EXTRA1 {
            let asked_hz = f64::from(u16::from_le_bytes([frame.byte(0), frame.byte(1)]));
            let most_hz = 1e6 / f64::from(self.firmware.least_interval_us());
            self.stream(ATTITUDE_DATA::ID, asked_hz.min(most_hz), now_us);
        }
    }

    fn is_for_it(&self, system: u8, component: u8) -> bool {
        let identity = self.source.identity();
        system == identity.system_id && component == identity.component_id
    }

    fn obey(&mut self, now_us: u64, frame: &Frame, command: &COMMAND_LONG_DATA) {
        if self.firmware == Firmware::Streams {
            return;
        }
        let result = if command.command != MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL {
            MavResult::MAV_RESULT_UNSUPPORTED
        } else if command.param2 < self.firmware.least_interval_us() {
            MavResult::MAV_RESULT_DENIED
        } else if !KNOWN.contains(&(command.param1 as u32)) {
            MavResult::MAV_RESULT_FAILED
        } else {
            self.stream(command.param1 as u32, 1e6 / f64::from(command.param2), now_us);
            MavResult::MAV_RESULT_ACCEPTED
        };
        let [low, high] = (command.command as u16).to_le_bytes();
        let payload = [low, high, result as u8, 0, 0, 0, 0, 0, frame.system, frame.component];
        let answer = self.source.framed(77, 143, &payload);
        self.answers.extend(answer);
    }

    fn stream(&mut self, id: u32, rate_hz: f64, now_us: u64) {
        if id == ATTITUDE_DATA::ID {
            self.source.set_rate_hz(rate_hz);
        }
        let period_us = (1e6 / rate_hz).round() as u64;
        self.streams.retain(|stream| stream.id != id);
        self.streams.push(Stream { id, period_us, due_us: now_us + period_us });
    }
}

/// What SET_MESSAGE_INTERVAL has superseded.
const REQUEST_DATA_STREAM: u32 = 66;

/// The stream that ATTITUDE belongs to.
const EXTRA1: u8 = 10;

#[cfg(test)]
mod tests;
