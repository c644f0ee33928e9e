//! Dynamic allocation of the node's number by the autopilot.
//!
//! The client sends its unique id in three parts. The allocator repeats the parts received so far, and at the end
//! grants a number; it remembers the unique id, so that the number stays. Random delays separate clients that start
//! together. Any message that does not continue this client's exchange makes it begin again.

use crate::wire::dronecan::{Allocation, NodeId, Payload, UNIQUE_ID_LENGTH, outbound};
use autoswing::time::Timestamp;

/// Delay of a request, microseconds: a fixed and a random part.
const REQUEST_DELAY_US: [u64; 2] = [600_000, 400_000];

/// Random delay of a following part, microseconds.
const FOLLOW_UP_DELAY_US: [u64; 2] = [0, 400_000];

/// Longest part of the unique id in an anonymous message, bytes.
const MAX_ID_PART_LENGTH: usize = 6;

/// Largest number that the node takes; those above are reserved for tools.
const MAX_OWN_NUMBER: u8 = 125;

/// Client of an allocation.
#[derive(Debug)]
pub(super) struct AllocationClient {
    unique_id: [u8; UNIQUE_ID_LENGTH],
    random: u32,
    /// Bit by number: another node with this number has sent a frame.
    used_numbers: u128,
    /// Time of the next request with the first part of the unique id; `None` before the first poll.
    request_at: Option<Timestamp>,
    /// Time and offset, bytes, of the next following part of the unique id.
    follow_up: Option<(Timestamp, usize)>,
}

impl AllocationClient {
    pub fn new(unique_id: [u8; UNIQUE_ID_LENGTH]) -> Self {
        // FNV-1a; the state of the generator must not be zero.
        let random =
            unique_id.iter().fold(0x811C_9DC5_u32, |hash, &byte| (hash ^ u32::from(byte)).wrapping_mul(0x0100_0193));
        Self { unique_id, random: random | 1, used_numbers: 0, request_at: None, follow_up: None }
    }

    /// Records a frame of another node.
    pub const fn record_other_node(&mut self, node: NodeId) {
        self.used_numbers |= 1 << node.number();
    }

    /// Processes a step of any exchange on the bus; returns the granted number, or an unused one where another node has
    /// that: the allocator knows only this unique id, and grants it the same number again. ArduPilot registers the
    /// unique id under the number that a node has (`AP_DroneCAN_DNA_Server::Database::handle_node_info`).
    pub fn receive_allocation(
        &mut self,
        at: Timestamp,
        source: Option<NodeId>,
        allocation: Allocation<'_>,
    ) -> Option<NodeId> {
        self.follow_up = None;
        self.request_at = Some(self.random_time_after(at, REQUEST_DELAY_US));
        let received = allocation.unique_id.len();
        if source.is_none() || received == 0 || !self.unique_id.starts_with(allocation.unique_id) {
            return None;
        }
        if received == UNIQUE_ID_LENGTH {
            let granted = allocation.node?;
            return Some(if self.is_used(granted) { self.unused_number(granted) } else { granted });
        }
        self.follow_up = Some((self.random_time_after(at, FOLLOW_UP_DELAY_US), received));
        None
    }

    /// Next message, if due.
    pub fn due_request(&mut self, now: Timestamp) -> Option<Payload> {
        if let Some((_, offset)) = self.follow_up.take_if(|(at, _)| *at <= now) {
            let rest = self.unique_id.get(offset..).unwrap_or_default();
            return Some(outbound::allocation_payload(false, rest.get(..MAX_ID_PART_LENGTH).unwrap_or(rest)));
        }
        let request_at = self.request_at;
        if request_at.is_some_and(|at| now < at) {
            return None;
        }
        self.request_at = Some(self.random_time_after(now, REQUEST_DELAY_US));
        let first = self.unique_id.get(..MAX_ID_PART_LENGTH).unwrap_or_default();
        request_at.map(|_| outbound::allocation_payload(true, first))
    }

    const fn is_used(&self, node: NodeId) -> bool {
        self.used_numbers >> node.number() & 1 == 1
    }

    /// Number that no other node has used, or else this one.
    fn unused_number(&mut self, otherwise: NodeId) -> NodeId {
        let start = self.next_random();
        let numbers = (0..MAX_OWN_NUMBER).map(|step| (start + u32::from(step)) % u32::from(MAX_OWN_NUMBER) + 1);
        let mut unused = numbers.filter_map(|number| NodeId::new(number as u8)).filter(|node| !self.is_used(*node));
        unused.next().unwrap_or(otherwise)
    }

    /// Random time within a range after another.
    fn random_time_after(&mut self, at: Timestamp, [least_us, spread_us]: [u64; 2]) -> Timestamp {
        at.plus_us(least_us + u64::from(self.next_random()) % spread_us)
    }

    /// Xorshift (G. Marsaglia, J. Stat. Soft. 8, 2003).
    const fn next_random(&mut self) -> u32 {
        self.random ^= self.random << 13;
        self.random ^= self.random >> 17;
        self.random ^= self.random << 5;
        self.random
    }
}
