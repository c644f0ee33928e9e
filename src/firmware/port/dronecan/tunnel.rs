//! MAVLink of a serial line of the autopilot, carried by the bus.

use crate::port::mavlink::Mavlink;
use crate::port::received_message::ReceivedMessage;
use crate::port::snapshot::Snapshot;
use crate::port::transmit_buffer::TransmitBuffer;
use crate::wire::dronecan::{InboundTransfer, NodeId, Payload, Targetted};
use autoswing::time::Timestamp;

/// Silence after which another node may use the tunnel, and nothing is sent, microseconds. An idle autopilot sends an
/// empty message twice a second.
const TUNNEL_RELEASE_US: u64 = 3_000_000;

/// Options of sent messages: none.
const TARGETTED_OPTIONS: u8 = 0;

/// Node at the other end of the tunnel, and its serial line.
#[derive(Clone, Copy, Debug)]
struct TunnelPeer {
    node: NodeId,
    protocol: u8,
    serial_line: i8,
    baud: u32,
    last_received_at: Timestamp,
    last_transfer_id: u8,
}

/// MAVLink with one node at a time.
#[derive(Debug, Default)]
pub(super) struct Tunnel {
    pub mavlink: Mavlink,
    transmit_buffer: TransmitBuffer,
    peer: Option<TunnelPeer>,
}

impl Tunnel {
    /// Processes received bytes; passes on the decoded messages.
    pub fn receive_targetted(
        &mut self,
        at: Timestamp,
        transfer: &InboundTransfer<'_>,
        piece: &Targetted<'_>,
        deliver: &mut dyn FnMut(ReceivedMessage),
    ) {
        let Some(node) = transfer.source_node else { return };
        if ![Targetted::MAVLINK_PROTOCOL, Targetted::MAVLINK_2_PROTOCOL].contains(&piece.protocol) {
            return;
        }
        let active = self.peer.filter(|peer| at.us_since(peer.last_received_at) <= TUNNEL_RELEASE_US);
        let is_other = |peer: TunnelPeer| (peer.node, peer.serial_line) != (node, piece.serial_line);
        let is_repeated = |peer: TunnelPeer| peer.last_transfer_id == transfer.transfer_id;
        if active.is_some_and(|peer| is_other(peer) || is_repeated(peer)) {
            return;
        }
        let Targetted { protocol, serial_line: serial, baud, .. } = *piece;
        self.peer = Some(TunnelPeer {
            node,
            protocol,
            serial_line: serial,
            baud,
            last_received_at: at,
            last_transfer_id: transfer.transfer_id,
        });
        for &byte in piece.serial_bytes {
            if let Some(message) = self.mavlink.process_byte(at, byte) {
                deliver(message);
            }
        }
    }

    /// Queues due messages while a node is at the other end.
    pub fn poll(&mut self, snapshot: &Snapshot<'_>) {
        if self.peer.is_some_and(|peer| snapshot.now.us_since(peer.last_received_at) <= TUNNEL_RELEASE_US) {
            self.mavlink.poll(snapshot, &mut self.transmit_buffer);
        } else {
            self.transmit_buffer.consume_bytes(usize::MAX);
        }
    }

    /// Next piece of the output, and its length.
    pub fn next_targetted(&self) -> Option<(Payload, usize)> {
        let TunnelPeer { node, protocol, serial_line: serial, baud, .. } = self.peer?;
        let pending = self.transmit_buffer.pending_bytes();
        let data = pending.get(..Targetted::MAX_DATA_LENGTH).unwrap_or(pending);
        let piece = Targetted {
            protocol,
            target: node.number(),
            serial_line: serial,
            tunnel_options: TARGETTED_OPTIONS,
            baud,
            serial_bytes: data,
        };
        (!data.is_empty()).then(|| (piece.payload(), data.len()))
    }

    /// Removes a sent piece.
    pub fn consume_bytes(&mut self, length: usize) {
        self.transmit_buffer.consume_bytes(length);
    }
}
