//! MAVLink in, versions 1 and 2: ATTITUDE, and the HEARTBEAT that says whose it is.
//!
//! The module needs two messages of the hundreds that share the line. So the receiver looks for frames that claim to be
//! one of them, checks their CRC and passes over everything else byte by byte. It never trusts the length of a frame it
//! cannot check, which is why garbage costs at most the frame it lies in.

use crc::{CRC_16_MCRF4XX, Crc};
use mavlink::dialects::common::{ATTITUDE_DATA, HEARTBEAT_DATA, MavAutopilot, MavModeFlag};
use mavlink::{MavlinkVersion, MessageData};

use crate::attitude::{Heartbeat, Report, Source};
use crate::frames::Attitude;
use crate::time::WrappingMillis;

/// What the receiver understands.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Message {
    /// ATTITUDE: roll and pitch with their rates.
    Attitude(Report),
    /// HEARTBEAT: what its sender is, and whether it is armed.
    Heartbeat(Heartbeat),
}

/// A message that is looked for.
struct Wanted {
    id: u32,
    /// Bytes of payload, before version 2 cuts zeros off.
    length: usize,
    extra_crc: u8,
    /// What a payload of a sender means; none if that is impossible.
    decode: fn(Source, MavlinkVersion, &[u8]) -> Option<Message>,
}

impl Wanted {
    const fn of<M: MessageData>(decode: fn(Source, MavlinkVersion, &[u8]) -> Option<Message>) -> Self {
        Self { id: M::ID, length: M::ENCODED_LEN, extra_crc: M::EXTRA_CRC, decode }
    }
}

/// All that are looked for, the longest first.
const WANTED: [Wanted; 2] = [Wanted::of::<ATTITUDE_DATA>(attitude), Wanted::of::<HEARTBEAT_DATA>(heartbeat)];
const MAX_LENGTH: usize = ATTITUDE_DATA::ENCODED_LEN;
const _: () = assert!(HEARTBEAT_DATA::ENCODED_LEN <= MAX_LENGTH, "the longest first");

/// Bytes before the payload, by version.
const V1_HEADER: usize = 6;
const V2_HEADER: usize = 10;

/// A version 2 frame: header, payload, 2 bytes of CRC, 13 of signature.
const MAX_FRAME: usize = V2_HEADER + MAX_LENGTH + 2 + 13;

/// Finds the frames of its messages in a stream of bytes.
#[derive(Debug, Default)]
pub struct Receiver {
    buffer: heapless::Vec<u8, { MAX_FRAME }>,
    /// Fewer bytes than these in the buffer tell nothing new.
    needed: usize,
    /// Frames that claimed to be one of its messages but failed their CRC or held impossible values; wraps.
    pub rejected: u32,
}

/// Where a candidate frame's parts lie, and what it claims to be.
struct Layout {
    wanted: &'static Wanted,
    source: Source,
    version: MavlinkVersion,
    header: usize,
    payload: usize,
    signature: usize,
}

impl Layout {
    fn frame(&self) -> usize {
        self.header + self.payload + 2 + self.signature
    }
}

/// What the bytes at the start of the buffer are.
enum Candidate {
    /// Not the start of a wanted frame.
    No,
    /// It may be one, but so many bytes are needed to tell.
    Unknown(usize),
    /// The header is that of a wanted frame.
    Yes(Layout),
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

    /// Reads frames off the front of the buffer until more bytes are needed.
    fn scan(&mut self) -> Option<Message> {
        loop {
            match candidate(&self.buffer) {
                Candidate::No => self.drop_front(1),
                Candidate::Unknown(needed) => {
                    self.needed = needed;
                    return None;
                }
                Candidate::Yes(layout) => {
                    self.needed = layout.frame();
                    if self.buffer.len() < self.needed {
                        return None;
                    }
                    let message = decode(&self.buffer, &layout);
                    if message.is_some() {
                        self.drop_front(layout.frame());
                        return message;
                    }
                    // A true frame may start inside the false one: go on at its second byte.
                    self.rejected = self.rejected.wrapping_add(1);
                    self.drop_front(1);
                }
            }
        }
    }

    fn drop_front(&mut self, count: usize) {
        self.needed = 0;
        let count = count.min(self.buffer.len());
        self.buffer.rotate_left(count);
        self.buffer.truncate(self.buffer.len() - count);
    }
}

fn candidate(bytes: &[u8]) -> Candidate {
    const V1: u8 = 0xFE;
    const V2: u8 = 0xFD;
    const SIGNED: u8 = 0x01;
    match *bytes {
        [V1, length, _, system, component, id, ..] => {
            let payload = usize::from(length);
            let is_it = |wanted: &&Wanted| wanted.id == u32::from(id) && wanted.length == payload;
            WANTED.iter().find(is_it).map_or(Candidate::No, |wanted| {
                let (version, source) = (MavlinkVersion::V1, source(system, component));
                Candidate::Yes(Layout { wanted, source, version, header: V1_HEADER, payload, signature: 0 })
            })
        }
        [V2, length, incompatibility, _, _, system, component, m0, m1, m2, ..] => {
            let payload = usize::from(length);
            let id = u32::from_le_bytes([m0, m1, m2, 0]);
            // A flag that is not known may change what the bytes mean. Trailing zeros are cut off the payload, to one
            // byte at least.
            let is_known = incompatibility & !SIGNED == 0;
            let is_it = |wanted: &&Wanted| is_known && wanted.id == id && (1..=wanted.length).contains(&payload);
            WANTED.iter().find(is_it).map_or(Candidate::No, |wanted| {
                let (version, source) = (MavlinkVersion::V2, source(system, component));
                let signature = if incompatibility & SIGNED == 0 { 0 } else { 13 };
                Candidate::Yes(Layout { wanted, source, version, header: V2_HEADER, payload, signature })
            })
        }
        [] | [V1, ..] => Candidate::Unknown(V1_HEADER),
        [V2, ..] => Candidate::Unknown(V2_HEADER),
        _ => Candidate::No,
    }
}

/// A sender's number: its system and its component.
fn source(system: u8, component: u8) -> Source {
    Source::new(u16::from_be_bytes([system, component]))
}

/// Checks CRC and values of a complete frame.
fn decode(frame: &[u8], layout: &Layout) -> Option<Message> {
    let crc_at = layout.header + layout.payload;
    let checked = frame.get(1..crc_at)?;
    let crc = frame.get(crc_at..crc_at + 2)?;
    if checksum(checked, layout.wanted.extra_crc).to_le_bytes() != crc {
        return None;
    }
    (layout.wanted.decode)(layout.source, layout.version, frame.get(layout.header..crc_at)?)
}

/// Of everything but the magic byte, and the message's extra byte. The mavlink library's own copies a table of half a
/// kilobyte for every frame.
fn checksum(bytes: &[u8], extra: u8) -> u16 {
    static CRC: Crc<u16> = Crc::<u16>::new(&CRC_16_MCRF4XX);
    let mut digest = CRC.digest();
    digest.update(bytes);
    digest.update(&[extra]);
    digest.finalize()
}

fn attitude(source: Source, version: MavlinkVersion, payload: &[u8]) -> Option<Message> {
    let data = ATTITUDE_DATA::deser(version, payload).ok()?;
    let rate = |rad_s: f32| if rad_s.is_finite() { rad_s } else { 0.0 };
    let possible = data.roll.abs() <= MAX_ROLL_RAD && data.pitch.abs() <= MAX_PITCH_RAD;
    possible.then(|| {
        Message::Attitude(Report {
            source,
            sender_time: WrappingMillis::new(data.time_boot_ms),
            attitude: Attitude { roll_rad: data.roll, pitch_rad: data.pitch },
            rates_rad_s: [rate(data.rollspeed), rate(data.pitchspeed), rate(data.yawspeed)],
        })
    })
}

/// Angles beyond these (with room for rounding) are not roll and pitch; the comparison refuses NaN too.
const MAX_ROLL_RAD: f32 = core::f32::consts::PI + 0.001;
const MAX_PITCH_RAD: f32 = core::f32::consts::FRAC_PI_2 + 0.001;

/// Reads two of its bytes. The library's deserialiser would refuse the whole message for a kind of vehicle or of
/// autopilot that is younger than it.
#[expect(clippy::unnecessary_wraps, reason = "one of the table's decoders")]
fn heartbeat(source: Source, _: MavlinkVersion, payload: &[u8]) -> Option<Message> {
    const AUTOPILOT: usize = 5;
    const BASE_MODE: usize = 6;
    // What version 2 has cut off is zero.
    let byte = |at: usize| payload.get(at).copied().unwrap_or(0);
    Some(Message::Heartbeat(Heartbeat {
        source,
        is_autopilot: byte(AUTOPILOT) != MavAutopilot::MAV_AUTOPILOT_INVALID as u8,
        is_armed: byte(BASE_MODE) & MavModeFlag::MAV_MODE_FLAG_SAFETY_ARMED.bits() != 0,
    }))
}

#[cfg(test)]
mod tests;
