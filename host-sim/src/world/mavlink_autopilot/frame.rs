//! Frames of MAVLink 2 as they stand on a line, also those of messages that the library does not know.

use mavlink::dialects::common::MavMessage;
use mavlink::{Message, calculate_crc};

use super::MODULE;

/// A frame that somebody sent.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Frame {
    /// Counts the frames of its sender; wraps.
    pub sequence: u8,
    /// Its sender's system.
    pub system: u8,
    /// Its sender's component.
    pub component: u8,
    /// Which message it is.
    pub id: u32,
    /// What it says, with the zeros cut off.
    pub payload: Vec<u8>,
}

impl Frame {
    /// A byte of the payload: zero where it was cut off.
    #[must_use]
    pub fn byte(&self, at: usize) -> u8 {
        self.payload.get(at).copied().unwrap_or(0)
    }

    /// A number of the payload.
    #[must_use]
    pub fn float(&self, at: usize) -> f32 {
        f32::from_le_bytes([0, 1, 2, 3].map(|byte| self.byte(at + byte)))
    }

    /// The bytes of the frame, closed with the extra byte of its message.
    #[must_use]
    pub fn bytes(&self, extra_crc: u8) -> Vec<u8> {
        let end = self.payload.iter().rposition(|&byte| byte != 0).map_or(1, |last| last + 1);
        let payload = &self.payload[..end.min(self.payload.len())];
        let [id_0, id_1, id_2, _] = self.id.to_le_bytes();
        let Self { sequence, system, component, .. } = *self;
        let header = [0xFD, payload.len() as u8, 0, 0, sequence, system, component, id_0, id_1, id_2];
        let mut bytes = [&header, payload].concat();
        bytes.extend(calculate_crc(&bytes[1..], extra_crc).to_le_bytes());
        bytes
    }
}

/// A COMMAND_LONG to the module of a system, by its number, which may be one that the library does not know.
#[must_use]
pub fn command_long(from: [u8; 2], system: u8, command: u16, confirmation: u8, parameters: [f32; 7]) -> Vec<u8> {
    let mut payload: Vec<u8> = parameters.iter().flat_map(|parameter| parameter.to_le_bytes()).collect();
    payload.extend(command.to_le_bytes());
    payload.extend([system, MODULE, confirmation]);
    let [from_system, from_component] = from;
    Frame { sequence: 0, system: from_system, component: from_component, id: 76, payload }.bytes(152)
}

/// The extra byte of a message's CRC.
fn extra_crc(id: u32) -> u8 {
    /// MAG_CAL_PROGRESS, which is ArduPilot's.
    const MAG_CAL_PROGRESS: u32 = 191;
    if id == MAG_CAL_PROGRESS { 92 } else { MavMessage::extra_crc(id) }
}

/// Finds frames in bytes.
#[derive(Clone, Debug, Default)]
pub struct Reader {
    bytes: Vec<u8>,
    garbage: u64,
}

impl Reader {
    /// Takes bytes; the frames that they complete.
    pub fn read(&mut self, bytes: &[u8]) -> Vec<Frame> {
        self.bytes.extend_from_slice(bytes);
        let mut frames = Vec::new();
        while let [begin, length, ..] = *self.bytes.as_slice() {
            let end = 10 + usize::from(length);
            if begin == 0xFD && self.bytes.len() < end + 2 {
                break;
            }
            let frame = (begin == 0xFD).then(|| self.frame(end)).flatten();
            self.garbage += u64::from(frame.is_none());
            self.bytes.drain(..frame.as_ref().map_or(1, |_| end + 2));
            frames.extend(frame);
        }
        frames
    }

    /// Bytes that belong to no frame.
    #[must_use]
    pub const fn garbage(&self) -> u64 {
        self.garbage
    }

    fn frame(&self, end: usize) -> Option<Frame> {
        let [_, _, _, _, sequence, system, component, id_0, id_1, id_2, ..] = *self.bytes.as_slice() else {
            return None;
        };
        let id = u32::from_le_bytes([id_0, id_1, id_2, 0]);
        let is_right = calculate_crc(&self.bytes[1..end], extra_crc(id)).to_le_bytes() == self.bytes[end..end + 2];
        is_right.then(|| Frame { sequence, system, component, id, payload: self.bytes[10..end].to_vec() })
    }
}
