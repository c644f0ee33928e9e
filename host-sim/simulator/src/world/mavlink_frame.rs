//! MAVLink 2 frames of any message, as an autopilot receives them.

use mavlink_dialect::{MavMessage, Message, calculate_crc};

/// Received frame.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct MavlinkFrame {
    /// System ID of the sender.
    pub system_id: u8,
    /// Component ID of the sender.
    pub component_id: u8,
    /// Message ID.
    pub message_id: u32,
    /// Payload, trailing zeros removed.
    pub payload: Vec<u8>,
}

impl MavlinkFrame {
    /// Payload byte; zero beyond the truncated payload.
    #[must_use]
    pub fn byte_at(&self, byte_index: usize) -> u8 {
        self.payload.get(byte_index).copied().unwrap_or(0)
    }

    /// Little-endian payload float that starts at byte `byte_index`.
    #[must_use]
    pub fn float_at(&self, byte_index: usize) -> f32 {
        f32::from_le_bytes([0, 1, 2, 3].map(|byte| self.byte_at(byte_index + byte)))
    }
}

fn extra_crc(id: u32) -> u8 {
    /// MAG_CAL_PROGRESS of ArduPilot's dialect.
    const MAG_CAL_PROGRESS: u32 = 191;
    if id == MAG_CAL_PROGRESS { 92 } else { MavMessage::extra_crc(id) }
}

/// Extracts frames from a byte stream.
#[derive(Clone, Debug, Default)]
pub struct FrameReader {
    bytes: Vec<u8>,
    invalid_bytes: u64,
}

impl FrameReader {
    /// Appends bytes and returns the completed frames.
    pub fn read_frames(&mut self, bytes: &[u8]) -> Vec<MavlinkFrame> {
        self.bytes.extend_from_slice(bytes);
        let mut frames = Vec::new();
        while let [begin, length, ..] = *self.bytes.as_slice() {
            let frame_length = 10 + usize::from(length);
            if begin == 0xFD && self.bytes.len() < frame_length + 2 {
                break;
            }
            let frame = (begin == 0xFD).then(|| self.checked_frame(frame_length)).flatten();
            self.invalid_bytes += u64::from(frame.is_none());
            self.bytes.drain(..frame.as_ref().map_or(1, |_| frame_length + 2));
            frames.extend(frame);
        }
        frames
    }

    /// Number of bytes outside valid frames.
    #[must_use]
    pub const fn invalid_byte_count(&self) -> u64 {
        self.invalid_bytes
    }

    fn checked_frame(&self, frame_length: usize) -> Option<MavlinkFrame> {
        let [_, _, _, _, _, system, component, id_0, id_1, id_2, ..] = *self.bytes.as_slice() else {
            return None;
        };
        let id = u32::from_le_bytes([id_0, id_1, id_2, 0]);
        let is_right = calculate_crc(&self.bytes[1..frame_length], extra_crc(id)).to_le_bytes()
            == self.bytes[frame_length..frame_length + 2];
        is_right.then(|| MavlinkFrame {
            system_id: system,
            component_id: component,
            message_id: id,
            payload: self.bytes[10..frame_length].to_vec(),
        })
    }
}
