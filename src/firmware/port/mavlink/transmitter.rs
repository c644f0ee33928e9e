//! The module as a sender: its address, and the numbers of its messages.

use crate::port::transmit_buffer::TransmitBuffer;
use crate::wire::mavlink::{Address, OutboundMessage, Signatures};
use autoswing::attitude::SenderId;

/// Numbers messages and appends them to an output.
pub(in crate::port) struct Transmitter<'a> {
    pub transmit_buffer: &'a mut TransmitBuffer,
    pub own_address: Address,
    pub sequence_number: &'a mut u8,
    pub signatures: &'a mut Signatures,
}

impl<'a> Transmitter<'a> {
    /// Creates a sender: a component of a system.
    pub fn new(
        out: &'a mut TransmitBuffer,
        (system, component_id): (SenderId, u8),
        sequence: &'a mut u8,
        signatures: &'a mut Signatures,
    ) -> Self {
        let own_address = Address { component_id, ..Address::from_sender(system) };
        Self { transmit_buffer: out, own_address, sequence_number: sequence, signatures }
    }

    /// Whether few bytes are pending, so that on a slow line other messages keep their room.
    pub fn has_room_for_bulk(&self) -> bool {
        const MAX_PENDING_BYTES: usize = 64;
        self.transmit_buffer.pending_bytes().len() <= MAX_PENDING_BYTES
    }

    /// Appends a message; returns whether there was room. Only appended messages take a sequence number, so that a gap
    /// means a loss on the line.
    pub fn send_message(&mut self, message: OutboundMessage) -> bool {
        let has_room = self.transmit_buffer.append_message(&[&message.into_frame(
            self.own_address,
            *self.sequence_number,
            self.signatures,
        )]);
        *self.sequence_number = self.sequence_number.wrapping_add(u8::from(has_room));
        has_room
    }
}
