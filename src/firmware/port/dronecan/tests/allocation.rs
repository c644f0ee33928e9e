//! Dynamic allocation of numbers, by an allocator written from its specification.

use super::*;
use crate::wire::dronecan::Allocation;

/// Allocator: grants numbers from 125 down, remembers them by unique id, and forgets an exchange after 500 ms.
struct Allocator {
    granted_ids: Vec<[u8; UNIQUE_ID_LENGTH]>,
    received_id: Vec<u8>,
    last_part_us: u64,
    transfer_id: u8,
}

impl Allocator {
    const fn new() -> Self {
        Self { granted_ids: Vec::new(), received_id: Vec::new(), last_part_us: 0, transfer_id: 0 }
    }

    fn answer_request(&mut self, now_us: u64, request: &CanFrame) -> Option<OutboundTransfer> {
        let header = FrameHeader::from_id(request.frame_id()).unwrap();
        let (_, [first, part @ ..]) = request.data().split_last()? else { return None };
        if header.source_node.is_some() || header.type_id != 1 {
            return None;
        }
        if now_us > self.last_part_us + 500_000 {
            self.received_id.clear();
        }
        match (first & 1, self.received_id.len()) {
            (1, _) => self.received_id = part.to_vec(),
            (_, 6 | 12) => self.received_id.extend_from_slice(part),
            _ => return None,
        }
        self.last_part_us = now_us;
        let mut number = 0;
        if let Ok(unique_id) = <[u8; UNIQUE_ID_LENGTH]>::try_from(&self.received_id[..]) {
            let known = self.granted_ids.iter().position(|granted| *granted == unique_id);
            let position = known.unwrap_or_else(|| {
                self.granted_ids.push(unique_id);
                self.granted_ids.len() - 1
            });
            number = 125 - position as u8;
        }
        let payload = [&[number << 1], &self.received_id[..]].concat();
        if number > 0 {
            self.received_id.clear();
        }
        self.transfer_id = (self.transfer_id + 1) % 32;
        Some(transfer_from_peer(DataType::ALLOCATION, self.transfer_id, &payload))
    }
}

/// A bus of unallocated nodes, an allocator, and a peer with a message each second.
struct AllocationBus {
    nodes: Vec<Bench>,
    allocator: Allocator,
}

impl AllocationBus {
    fn new(first_id_bytes: &[u8]) -> Self {
        let nodes = first_id_bytes.iter().map(|&first| Bench::unallocated(first)).collect();
        Self { nodes, allocator: Allocator::new() }
    }

    fn node_numbers(&self) -> Vec<Option<u8>> {
        self.nodes.iter().map(|bench| bench.node.node_id().map(NodeId::number)).collect()
    }

    /// Runs until all nodes have numbers; returns the time in milliseconds.
    fn run_until_allocated(&mut self, time_limit_ms: u64) -> Option<u64> {
        for now_us in (0..time_limit_ms * 1000).step_by(READING_PERIOD_US as usize) {
            // Frames with the index of the sending node, or none.
            let mut on_bus = Vec::new();
            for (number, bench) in self.nodes.iter_mut().enumerate() {
                bench.now_us = now_us;
                bench.poll();
                bench.send_all_node_frames();
                on_bus.extend(bench.sent_frames.drain(..).map(|frame| (Some(number), frame)));
            }
            let mut transfers: Vec<_> =
                on_bus.iter().filter_map(|(_, frame)| self.allocator.answer_request(now_us, frame)).collect();
            if now_us.is_multiple_of(1_000_000) {
                transfers.push(transfer_from_peer(DataType::ARMING_STATUS, 0, &[0]));
            }
            on_bus.extend(
                transfers.iter().flat_map(|sent| sent.frames(NodeId::new(PEER_NODE))).map(|frame| (None, frame)),
            );
            for (sender, frame) in on_bus {
                for (number, bench) in self.nodes.iter_mut().enumerate() {
                    if sender != Some(number) {
                        bench.receive_frame(&frame);
                    }
                }
            }
            if self.node_numbers().iter().all(Option::is_some) {
                return Some(now_us / 1000);
            }
        }
        None
    }
}

/// After a collision both modules start their exchanges again.
#[test]
fn two_modules_on_one_bus_get_different_numbers() {
    for first_id_byte in 0..50 {
        let mut bus = AllocationBus::new(&[first_id_byte, 200 - first_id_byte]);
        assert!(bus.run_until_allocated(20_000).is_some());
        let mut numbers = bus.node_numbers();
        numbers.sort_unstable();
        assert_eq!(numbers, [Some(124), Some(125)]);
    }
}

/// Milliseconds until the next request of a client after a message with a part of a unique id.
fn request_delay_ms(client: &mut AllocationClient, source: Option<u8>, unique_id: &[u8]) -> u64 {
    let step = Allocation { node: None, unique_id };
    assert_eq!(client.receive_allocation(Timestamp::START, source.map(node_id), step), None);
    (0..=1000).find(|ms| client.due_request(Timestamp::from_us(ms * 1000)).is_some()).unwrap()
}

/// Another client's request, an empty id or a part of another unique id ends the exchange.
#[test]
fn only_an_allocator_continues_an_exchange() {
    let unique_id = node_info(1).unique_id;
    let own_part = &unique_id[..6];
    let mut client = AllocationClient::new(unique_id);
    for (source, part) in [(None, own_part), (Some(PEER_NODE), &[]), (Some(PEER_NODE), &[9; 6])] {
        assert!(request_delay_ms(&mut client, Some(PEER_NODE), own_part) <= 400);
        let step = Allocation { node: None, unique_id: own_part };
        client.receive_allocation(Timestamp::START, Some(node_id(PEER_NODE)), step);
        assert!(request_delay_ms(&mut client, source, part) >= 600, "{source:?} {part:?}");
    }
}

/// A bus with another bit rate has no valid frames. Without an allocator the node asks every 0.6 to 1 s.
#[test]
fn a_node_is_silent_until_it_receives_a_frame_and_then_only_asks_for_a_number() {
    let mut bench = Bench::unallocated(1);
    assert_eq!(bench.run_ms(5000), []);
    bench.deliver_transfer(PEER_NODE, &transfer_from_peer(DataType::ARMING_STATUS, 0, &[0]));
    let sent = bench.run_ms(60_000);
    assert!((60..=101).contains(&sent.len()), "{}", sent.len());
    assert!(sent.iter().all(|sent| {
        has_data_type(sent, DataType::ALLOCATION) && sent.header.source_node.is_none() && sent.payload.len() == 7
    }));
}

/// The allocator remembers the unique id, and grants it the same number again.
#[test]
fn a_number_that_another_node_has_is_given_up_for_an_unused_one() {
    let mut bus = AllocationBus::new(&[7]);
    bus.run_until_allocated(5000).unwrap();
    let bench = &mut bus.nodes[0];
    assert!(!bench.sent_in_ms(DataType::MAGNETIC_FIELD_STRENGTH_2, 1000).is_empty());
    bench.now_us += 100_000;
    bench.poll();
    assert!(bench.node.frame_to_send().is_some());
    for _ in 0..2 {
        bench.deliver_transfer(125, &transfer_from_peer(DataType::ARMING_STATUS, 0, &[0]));
    }
    assert_eq!(bench.node.node_id(), None);
    assert_eq!(bench.node.frame_to_send(), None, "a field with the number of another node");
    let conflict = |is_given_up| Some(Notice::NodeNumberConflict { number: 125, is_given_up });
    assert_eq!([(); 2].map(|()| bench.node.take_message(bench.now())), [conflict(true), None]);
    assert!(bench.run_ms(500).iter().all(|sent| sent.header.source_node.is_none()));
    bus.run_until_allocated(20_000).unwrap();
    let number = bus.node_numbers()[0].unwrap();
    assert!((1..125).contains(&number) && number != PEER_NODE, "{number}");
}
