//! MAVLink versions 1 and 2: receiver, and messages to send.
//!
//! The receiver decodes a few of the hundreds of messages that share the line: it searches for their headers, checks
//! the CRC and skips all other bytes one at a time (`frame_buffer.rs`).
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

use super::frame_buffer::FrameBuffer;
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

/// Receiver of supported messages in a stream of bytes. It rejects frames with a wrong CRC, impossible values, or a
/// missing or wrong signature.
#[derive(Debug, Default)]
pub struct MavlinkReceiver {
    buffer: FrameBuffer<MAX_FRAME_LENGTH>,
    /// Signatures of received and sent frames.
    pub signatures: Signatures,
}

impl MavlinkReceiver {
    /// Processes a received byte; returns the message that it completes.
    #[inline]
    pub fn push_byte(&mut self, byte: u8) -> Option<InboundMessage> {
        let Self { buffer, signatures } = self;
        buffer.push_byte(byte, frame_length, |frame| {
            let layout = FrameLayout::parse_header(frame)?;
            let message = decode_message(frame, &layout)?;
            signatures.accept_frame(frame, layout.source, layout.signature_length > 0).then_some(message)
        })
    }

    /// Number of rejected frames; wraps.
    #[must_use]
    pub const fn rejected_count(&self) -> u32 {
        self.buffer.rejected_count
    }
}

struct FrameLayout {
    message: &'static MessageSpec,
    source: SenderId,
    header_length: usize,
    payload_length: usize,
    signature_length: usize,
}

impl FrameLayout {
    /// Layout of a frame by its complete header; none of an unsupported message.
    fn parse_header(bytes: &[u8]) -> Option<Self> {
        let (header_length, length, flags, [system_id, component_id], id) = match *bytes {
            [V1_START_BYTE, length, _, system, component, id, ..] => {
                (V1_HEADER_LENGTH, length, 0, [system, component], u32::from(id))
            }
            [V2_START_BYTE, length, flags, _, _, system, component, id_0, id_1, id_2, ..] => {
                (V2_HEADER_LENGTH, length, flags, [system, component], u32::from_le_bytes([id_0, id_1, id_2, 0]))
            }
            _ => return None,
        };
        let payload_length = usize::from(length);
        let message = SUPPORTED_MESSAGES.iter().find(|message| message.message_id == id)?;
        // Version 2 truncates zeros at the end of the payload, to one byte at least. An unknown flag may change the format.
        let (min_length, max_length) = if header_length == V1_HEADER_LENGTH {
            (message.payload_length, message.payload_length)
        } else {
            (1, message.extended_length)
        };
        let is_supported = (min_length..=max_length).contains(&payload_length) && flags & !signature::SIGNED_FLAG == 0;
        is_supported.then(|| Self {
            message,
            source: Address { system_id, component_id }.sender_id(),
            header_length,
            payload_length,
            signature_length: if flags == 0 { 0 } else { signature::SIGNATURE_SIZE },
        })
    }
}

fn frame_length(bytes: &[u8]) -> Option<usize> {
    match bytes {
        [] | [V1_START_BYTE, ..] if bytes.len() < V1_HEADER_LENGTH => Some(V1_HEADER_LENGTH),
        [V2_START_BYTE, ..] if bytes.len() < V2_HEADER_LENGTH => Some(V2_HEADER_LENGTH),
        _ => FrameLayout::parse_header(bytes)
            .map(|layout| layout.header_length + layout.payload_length + 2 + layout.signature_length),
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
