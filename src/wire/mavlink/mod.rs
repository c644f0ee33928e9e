//! MAVLink, versions 1 and 2: what the module understands of the messages on a line, and what it sends.
//!
//! The module needs seven messages of the hundreds that share the line. So the receiver looks for frames that claim to be
//! one of them, checks their CRC and passes over everything else byte by byte. It never trusts the length of a frame it
//! cannot check, which is why garbage costs at most the frame it lies in.
//!
//! | file | holds |
//! |---|---|
//! | `mod.rs` | the receiver: frames in a stream of bytes |
//! | `inbound.rs` | what their payloads mean |
//! | `outbound.rs` | the messages that are sent, as frames of version 2 |

mod inbound;
mod outbound;

use crc::{CRC_16_MCRF4XX, Crc};

use crate::attitude::Source;
pub use inbound::{Acknowledgement, Command, Message};
use inbound::{MAX_LENGTH, WANTED, Wanted};
pub use outbound::{Frame, MagCalReport, Outgoing, Pose};

/// A component of a system: who sends, or who is meant. 0 is all of them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Address {
    /// The system: an aircraft, a ground station.
    pub system: u8,
    /// The component of it.
    pub component: u8,
}

impl Address {
    /// Of the sender with this number.
    #[must_use]
    pub const fn of(source: Source) -> Self {
        let [system, component] = source.number().to_be_bytes();
        Self { system, component }
    }

    /// The number of the sender at this address.
    #[must_use]
    pub const fn source(self) -> Source {
        Source::new(u16::from_be_bytes([self.system, self.component]))
    }
}

/// The byte that begins a frame, by version.
const V1: u8 = 0xFE;
const V2: u8 = 0xFD;

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
    #[inline]
    pub fn push(&mut self, byte: u8) -> Option<Message> {
        // Never full: `scan` leaves less than one frame behind.
        let _ = self.buffer.push(byte);
        if self.buffer.len() < self.needed { None } else { self.scan() }
    }

    /// Reads frames off the front of the buffer until more bytes are needed.
    #[inline(never)]
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
        self.buffer.copy_within(count.., 0);
        self.buffer.truncate(self.buffer.len() - count);
    }
}

fn candidate(bytes: &[u8]) -> Candidate {
    const SIGNED: u8 = 0x01;
    match *bytes {
        [V1, length, _, system, component, id, ..] => {
            let payload = usize::from(length);
            let is_it = |wanted: &&Wanted| wanted.id == u32::from(id) && wanted.length == payload;
            WANTED.iter().find(is_it).map_or(Candidate::No, |wanted| {
                let source = Address { system, component }.source();
                Candidate::Yes(Layout { wanted, source, header: V1_HEADER, payload, signature: 0 })
            })
        }
        [V2, length, incompatibility, _, _, system, component, m0, m1, m2, ..] => {
            let payload = usize::from(length);
            let id = u32::from_le_bytes([m0, m1, m2, 0]);
            // A flag that is not known may change what the bytes mean. Trailing zeros are cut off the payload, to one
            // byte at least.
            let is_known = incompatibility & !SIGNED == 0;
            let is_it = |wanted: &&Wanted| is_known && wanted.id == id && (1..=wanted.extended).contains(&payload);
            WANTED.iter().find(is_it).map_or(Candidate::No, |wanted| {
                let source = Address { system, component }.source();
                let signature = if incompatibility & SIGNED == 0 { 0 } else { 13 };
                Candidate::Yes(Layout { wanted, source, header: V2_HEADER, payload, signature })
            })
        }
        [] | [V1, ..] => Candidate::Unknown(V1_HEADER),
        [V2, ..] => Candidate::Unknown(V2_HEADER),
        _ => Candidate::No,
    }
}

/// Checks CRC and values of a complete frame.
fn decode(frame: &[u8], layout: &Layout) -> Option<Message> {
    let crc_at = layout.header + layout.payload;
    let checked = frame.get(1..crc_at)?;
    let crc = frame.get(crc_at..crc_at + 2)?;
    if checksum(checked, layout.wanted.extra_crc).to_le_bytes() != crc {
        return None;
    }
    (layout.wanted.decode)(layout.source, frame.get(layout.header..crc_at)?)
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

#[cfg(test)]
mod tests;
