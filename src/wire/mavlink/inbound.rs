//! What the module understands: the messages that are looked for, and what their payloads mean.
//!
//! Of the library come numbers, lengths and extra bytes of messages; its deserialisers would refuse a whole message for a
//! kind of vehicle, of autopilot or of command that is younger than the library or of another dialect, as the commands of a
//! compass calibration are; and they do not know the fields that version 2 has added to a message.

use core::array::from_fn;

use mavlink::MessageData;
use mavlink::dialects::common::{
    ATTITUDE_DATA, BATTERY_STATUS_DATA, COMMAND_ACK_DATA, COMMAND_INT_DATA, COMMAND_LONG_DATA,
    GLOBAL_POSITION_INT_DATA, HEARTBEAT_DATA, MavAutopilot, MavModeFlag, SYS_STATUS_DATA, SYSTEM_TIME_DATA,
};

use super::Address;
use crate::attitude::{Heartbeat, Report, Source};
use crate::earth::{Day, Place};
use crate::frames::Attitude;
use crate::time::WrappingMillis;

/// What the receiver understands.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Message {
    /// ATTITUDE: roll and pitch with their rates.
    Attitude(Report),
    /// HEARTBEAT: what its sender is, and whether it is armed.
    Heartbeat(Heartbeat),
    /// GLOBAL_POSITION_INT: where its sender is, if it knows.
    Place(Source, Option<Place>),
    /// SYSTEM_TIME: its sender's day, if it knows.
    Day(Source, Option<Day>),
    /// SYS_STATUS, or BATTERY_STATUS of the first battery: the current that is drawn, amperes, if its sender measures it.
    Current(Source, Option<f32>),
    /// COMMAND_LONG or COMMAND_INT.
    Command(Command),
    /// COMMAND_ACK.
    Acknowledgement(Acknowledgement),
}

/// A command to somebody.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Command {
    /// Who wants something.
    pub source: Source,
    /// From whom.
    pub target: Address,
    /// What: a `MAV_CMD`.
    pub command: u16,
    /// Counts the repetitions of a command that was not answered. A COMMAND_INT has no such count.
    pub confirmation: u8,
    /// The first four parameters: those that are alike in both messages.
    pub parameters: [f32; 4],
}

/// What became of a command.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Acknowledgement {
    /// Who says it.
    pub source: Source,
    /// To whom; version 1 does not tell, which is to all.
    pub target: Address,
    /// The command: a `MAV_CMD`.
    pub command: u16,
    /// A `MAV_RESULT`, also one that is younger than this code.
    pub result: u8,
}

/// A message that is looked for.
pub(super) struct Wanted {
    pub id: u32,
    /// Bytes of payload in version 1.
    pub length: usize,
    /// The same with the fields that version 2 has added, before it cuts zeros off.
    pub extended: usize,
    pub extra_crc: u8,
    /// What a payload of a sender means; none if that is impossible.
    pub decode: fn(Source, &[u8]) -> Option<Message>,
}

impl Wanted {
    const fn of<M: MessageData>(decode: fn(Source, &[u8]) -> Option<Message>) -> Self {
        Self { id: M::ID, length: M::ENCODED_LEN, extended: M::ENCODED_LEN, extra_crc: M::EXTRA_CRC, decode }
    }

    const fn extended(self, extended: usize) -> Self {
        Self { extended, ..self }
    }
}

/// All that are looked for, the most frequent first.
pub(super) const WANTED: [Wanted; 9] = [
    Wanted::of::<ATTITUDE_DATA>(attitude),
    Wanted::of::<SYS_STATUS_DATA>(system_status).extended(43),
    Wanted::of::<HEARTBEAT_DATA>(heartbeat),
    Wanted::of::<GLOBAL_POSITION_INT_DATA>(place),
    Wanted::of::<BATTERY_STATUS_DATA>(battery_status).extended(54),
    Wanted::of::<SYSTEM_TIME_DATA>(day),
    Wanted::of::<COMMAND_LONG_DATA>(command_long),
    Wanted::of::<COMMAND_INT_DATA>(command_int),
    Wanted::of::<COMMAND_ACK_DATA>(acknowledgement).extended(10),
];

/// The longest payload of one that is looked for.
pub(super) const MAX_LENGTH: usize = {
    let mut longest = 0;
    let mut at = 0;
    while at < WANTED.len() {
        if WANTED[at].extended > longest {
            longest = WANTED[at].extended;
        }
        at += 1;
    }
    longest
};

/// A payload, field by field, little endian. What version 2 has cut off is zero.
struct Fields<'a>(&'a [u8]);

impl Fields<'_> {
    fn u8(&self, at: usize) -> u8 {
        self.0.get(at).copied().unwrap_or(0)
    }

    fn u16(&self, at: usize) -> u16 {
        u16::from_le_bytes([self.u8(at), self.u8(at + 1)])
    }

    fn u32(&self, at: usize) -> u32 {
        // Whole, but for the last fields of a payload that was cut.
        match self.0.get(at..).and_then(|rest| rest.first_chunk()) {
            Some(whole) => u32::from_le_bytes(*whole),
            None => u32::from_le_bytes(from_fn(|byte| self.u8(at + byte))),
        }
    }

    fn f32(&self, at: usize) -> f32 {
        f32::from_bits(self.u32(at))
    }

    /// A number of so many units.
    fn scaled(&self, at: usize, unit: f32) -> f32 {
        self.u32(at).cast_signed() as f32 * unit
    }

    fn address(&self, at: usize) -> Address {
        Address { system: self.u8(at), component: self.u8(at + 1) }
    }
}

fn attitude(source: Source, payload: &[u8]) -> Option<Message> {
    const ROLL: usize = 4;
    const PITCH: usize = 8;
    const RATES: usize = 16;
    let fields = Fields(payload);
    let (roll_rad, pitch_rad) = (fields.f32(ROLL), fields.f32(PITCH));
    let rate = |axis| {
        let rad_s = fields.f32(RATES + 4 * axis);
        if rad_s.is_finite() { rad_s } else { 0.0 }
    };
    let is_possible = roll_rad.abs() <= MAX_ROLL_RAD && pitch_rad.abs() <= MAX_PITCH_RAD;
    is_possible.then(|| {
        Message::Attitude(Report {
            source,
            sender_time: WrappingMillis::new(fields.u32(0)),
            attitude: Attitude { roll_rad, pitch_rad },
            rates_rad_s: from_fn(rate),
        })
    })
}

/// Angles beyond these (with room for rounding) are not roll and pitch; the comparison refuses NaN too.
const MAX_ROLL_RAD: f32 = core::f32::consts::PI + 0.001;
const MAX_PITCH_RAD: f32 = core::f32::consts::FRAC_PI_2 + 0.001;

#[expect(clippy::unnecessary_wraps, reason = "one of the table's decoders")]
fn heartbeat(source: Source, payload: &[u8]) -> Option<Message> {
    const AUTOPILOT: usize = 5;
    const BASE_MODE: usize = 6;
    let fields = Fields(payload);
    Some(Message::Heartbeat(Heartbeat {
        source,
        is_autopilot: fields.u8(AUTOPILOT) != MavAutopilot::MAV_AUTOPILOT_INVALID as u8,
        is_armed: fields.u8(BASE_MODE) & MavModeFlag::MAV_MODE_FLAG_SAFETY_ARMED.bits() != 0,
    }))
}

/// Latitude and longitude in 1e-7 deg, height above mean sea level in millimetres.
#[expect(clippy::unnecessary_wraps, reason = "one of the table's decoders")]
fn place(source: Source, payload: &[u8]) -> Option<Message> {
    const LATITUDE: usize = 4;
    const LONGITUDE: usize = 8;
    const HEIGHT: usize = 12;
    let fields = Fields(payload);
    let (latitude_deg, longitude_deg) = (fields.scaled(LATITUDE, 1e-7), fields.scaled(LONGITUDE, 1e-7));
    Some(Message::Place(source, Place::new(latitude_deg, longitude_deg, fields.scaled(HEIGHT, 1e-3))))
}

#[expect(clippy::unnecessary_wraps, reason = "one of the table's decoders")]
fn system_status(source: Source, payload: &[u8]) -> Option<Message> {
    const CURRENT: usize = 16;
    Some(Message::Current(source, amperes(Fields(payload).u16(CURRENT))))
}

/// Of another battery than the first nothing is told: SYS_STATUS is of the first, too.
#[expect(clippy::unnecessary_wraps, reason = "one of the table's decoders")]
fn battery_status(source: Source, payload: &[u8]) -> Option<Message> {
    const CURRENT: usize = 30;
    const BATTERY: usize = 32;
    let fields = Fields(payload);
    let is_first = fields.u8(BATTERY) == 0;
    Some(Message::Current(source, amperes(fields.u16(CURRENT)).filter(|_| is_first)))
}

/// Of hundredths of an ampere, of which -1 is not known.
fn amperes(centiamperes: u16) -> Option<f32> {
    let centiamperes = centiamperes.cast_signed();
    (centiamperes != -1).then_some(f32::from(centiamperes) * 0.01)
}

/// Unix time in microseconds.
#[expect(clippy::unnecessary_wraps, reason = "one of the table's decoders")]
fn day(source: Source, payload: &[u8]) -> Option<Message> {
    let fields = Fields(payload);
    let unix_us = u64::from(fields.u32(4)) << 32 | u64::from(fields.u32(0));
    Some(Message::Day(source, Day::from_unix_s(unix_us / 1_000_000)))
}

#[expect(clippy::unnecessary_wraps, reason = "one of the table's decoders")]
fn command_long(source: Source, payload: &[u8]) -> Option<Message> {
    const CONFIRMATION: usize = 32;
    Some(Message::Command(command(source, payload, Fields(payload).u8(CONFIRMATION))))
}

/// Has a frame of coordinates where a COMMAND_LONG has its count of repetitions; what is read before that is alike.
#[expect(clippy::unnecessary_wraps, reason = "one of the table's decoders")]
fn command_int(source: Source, payload: &[u8]) -> Option<Message> {
    Some(Message::Command(command(source, payload, 0)))
}

fn command(source: Source, payload: &[u8], confirmation: u8) -> Command {
    const COMMAND: usize = 28;
    const TARGET: usize = 30;
    let fields = Fields(payload);
    Command {
        source,
        target: fields.address(TARGET),
        command: fields.u16(COMMAND),
        confirmation,
        parameters: from_fn(|parameter| fields.f32(4 * parameter)),
    }
}

#[expect(clippy::unnecessary_wraps, reason = "one of the table's decoders")]
fn acknowledgement(source: Source, payload: &[u8]) -> Option<Message> {
    const COMMAND: usize = 0;
    const RESULT: usize = 2;
    const TARGET: usize = 8;
    let fields = Fields(payload);
    Some(Message::Acknowledgement(Acknowledgement {
        source,
        target: fields.address(TARGET),
        command: fields.u16(COMMAND),
        result: fields.u8(RESULT),
    }))
}
