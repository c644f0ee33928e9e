//! MAVLink versions 1 and 2: receiver, and messages to send.
//!
//! The receiver decodes a few of the hundreds of messages that share the line: it searches for their headers, checks
//! the CRC and skips all other bytes one at a time. It never skips by the length of a frame that it cannot check, so
//! that garbage costs at most the frame that contains it.
//!
//! | file | contents |
//! |---|---|
//! | `mod.rs` | receiver: frames in a stream of bytes |
//! | `frame.rs` | header, address and CRC |
//! | `inbound.rs` | decoding of payloads |
//! | `outbound.rs` | messages to send, as frames of version 2 |
//! | `parameter.rs` | names and numbers of an autopilot's parameters |
//! | `signature.rs` | signatures of frames of version 2 |

mod frame;
mod inbound;
mod outbound;
mod parameter;
mod signature;

use autoswing::attitude::SenderId;
pub use frame::Address;
use frame::{V1_HEADER_LENGTH, V1_START_BYTE, V2_HEADER_LENGTH, V2_START_BYTE, checksum};
pub use inbound::{Acknowledgement, InboundMessage, ReceivedCommand, ReceivedParameterRequest};
use inbound::{MAX_PAYLOAD_LENGTH, MessageSpec, PaddedPayload, SUPPORTED_MESSAGES};
pub use outbound::{EncodedFrame, OutboundMessage, Pose};
pub use parameter::{ParameterEncoding, ReceivedParameter};
pub use signature::{Signatures, key_from_passphrase};

/// Longest frame of version 2, bytes: header, payload, 2 of CRC, 13 of signature.
const MAX_FRAME_LENGTH: usize = V2_HEADER_LENGTH + MAX_PAYLOAD_LENGTH + 2 + signature::SIGNATURE_SIZE;

/// Receiver of supported messages in a stream of bytes.
#[derive(Debug, Default)]
pub struct MavlinkReceiver {
    buffer: heapless::Vec<u8, { MAX_FRAME_LENGTH }>,
    /// Buffered bytes below which a scan finds nothing new.
    required_length: usize,
    /// Number of frames with a supported header but a wrong CRC, impossible values, or a missing or wrong signature;
    /// wraps.
    pub rejected_count: u32,
    /// Signatures of received and sent frames.
    pub signatures: Signatures,
}

struct FrameLayout {
    message: &'static MessageSpec,
    source: SenderId,
    header_length: usize,
    payload_length: usize,
    signature_length: usize,
}

impl FrameLayout {
    fn frame_length(&self) -> usize {
        self.header_length + self.payload_length + 2 + self.signature_length
    }
}

enum FrameCandidate {
    /// The bytes are not the start of a supported frame.
    NoFrame,
    /// Whether a supported frame starts is unknown until this number of bytes is buffered.
    Incomplete(usize),
    /// The bytes start a supported frame with this layout.
    Frame(FrameLayout),
}

impl MavlinkReceiver {
    /// Creates an empty receiver.
    #[must_use]
    pub const fn new() -> Self {
        Self { buffer: heapless::Vec::new(), required_length: 0, rejected_count: 0, signatures: Signatures::new() }
    }

    /// Processes a received byte; returns the message that it completes.
    #[inline]
    pub fn push_byte(&mut self, byte: u8) -> Option<InboundMessage> {
        // The buffer is never full: `scan_buffer` leaves less than one frame.
        let _ = self.buffer.push(byte);
        if self.buffer.len() < self.required_length { None } else { self.scan_buffer() }
    }

    /// Decodes frames at the start of the buffer until more bytes are needed.
    fn scan_buffer(&mut self) -> Option<InboundMessage> {
        loop {
            match find_frame_candidate(&self.buffer) {
                FrameCandidate::NoFrame => self.drop_first_bytes(1),
                FrameCandidate::Incomplete(needed) => {
                    self.required_length = needed;
                    return None;
                }
                FrameCandidate::Frame(layout) => {
                    self.required_length = layout.frame_length();
                    if self.buffer.len() < self.required_length {
                        return None;
                    }
                    let message = decode_message(&self.buffer, &layout).filter(|_| self.is_signature_accepted(&layout));
                    if message.is_some() {
                        self.drop_first_bytes(layout.frame_length());
                        return message;
                    }
                    // A valid frame may start inside the invalid one: skip one byte only.
                    self.rejected_count = self.rejected_count.wrapping_add(1);
                    self.drop_first_bytes(1);
                }
            }
        }
    }

    fn is_signature_accepted(&mut self, layout: &FrameLayout) -> bool {
        let frame = self.buffer.get(..layout.frame_length()).unwrap_or_default();
        self.signatures.accept_frame(frame, layout.source, layout.signature_length > 0)
    }

    fn drop_first_bytes(&mut self, count: usize) {
        self.required_length = 0;
        let count = count.min(self.buffer.len());
        self.buffer.copy_within(count.., 0);
        self.buffer.truncate(self.buffer.len() - count);
    }
}

fn find_frame_candidate(bytes: &[u8]) -> FrameCandidate {
    match *bytes {
        [V1_START_BYTE, length, _, system, component, id, ..] => {
            let payload_length = usize::from(length);
            let matches_layout = |message: &&MessageSpec| {
                message.message_id == u32::from(id) && message.payload_length == payload_length
            };
            SUPPORTED_MESSAGES.iter().find(matches_layout).map_or(FrameCandidate::NoFrame, |message| {
                let source = Address { system_id: system, component_id: component }.sender_id();
                FrameCandidate::Frame(FrameLayout {
                    message,
                    source,
                    header_length: V1_HEADER_LENGTH,
                    payload_length,
                    signature_length: 0,
                })
            })
        }
        [V2_START_BYTE, length, incompatibility, _, _, system, component, m0, m1, m2, ..] => {
            let payload_length = usize::from(length);
            let id = u32::from_le_bytes([m0, m1, m2, 0]);
            // An unknown flag may change the format. Trailing zeros of the payload are truncated, to one byte at least.
            let is_known = incompatibility & !signature::SIGNED_FLAG == 0;
            let matches_layout = |message: &&MessageSpec| {
                is_known && message.message_id == id && (1..=message.extended_length).contains(&payload_length)
            };
            SUPPORTED_MESSAGES.iter().find(matches_layout).map_or(FrameCandidate::NoFrame, |message| {
                let source = Address { system_id: system, component_id: component }.sender_id();
                let signature_length =
                    if incompatibility & signature::SIGNED_FLAG == 0 { 0 } else { signature::SIGNATURE_SIZE };
                FrameCandidate::Frame(FrameLayout {
                    message,
                    source,
                    header_length: V2_HEADER_LENGTH,
                    payload_length,
                    signature_length,
                })
            })
        }
        [] | [V1_START_BYTE, ..] => FrameCandidate::Incomplete(V1_HEADER_LENGTH),
        [V2_START_BYTE, ..] => FrameCandidate::Incomplete(V2_HEADER_LENGTH),
        _ => FrameCandidate::NoFrame,
    }
}

/// Decodes a complete frame; none for a wrong CRC or impossible values.
fn decode_message(frame: &[u8], layout: &FrameLayout) -> Option<InboundMessage> {
    let crc_at = layout.header_length + layout.payload_length;
    let checked = frame.get(1..crc_at)?;
    let crc = frame.get(crc_at..crc_at + 2)?;
    if checksum(checked, layout.message.extra_crc).to_le_bytes() != crc {
        return None;
    }
    let mut payload: PaddedPayload = [0; MAX_PAYLOAD_LENGTH];
    payload.get_mut(..layout.payload_length)?.copy_from_slice(frame.get(layout.header_length..crc_at)?);
    (layout.message.decoder)(layout.source, &payload)
}

#[cfg(test)]
mod tests;
