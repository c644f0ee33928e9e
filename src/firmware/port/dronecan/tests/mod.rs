//! The node against frames of other nodes, at readings of 80 Hz.

mod allocation;
mod requests;
mod sending;
mod vehicle;

use super::*;
use crate::port::snapshot::tests::test_snapshot;
use crate::wire::dronecan::outbound::SoftwareVersion;
use crate::wire::dronecan::{OutboundTransfer, Payload, TransferKind, UNIQUE_ID_LENGTH};
use autoswing::frames::RollPitch;
use autoswing::heading::{Heading, NoHeading};
use autoswing_module::compass::IndicatorState;

const READING_PERIOD_US: u64 = 12_500;
const OWN_NODE: u8 = 42;
const PEER_NODE: u8 = 10;

fn node_id(number: u8) -> NodeId {
    NodeId::new(number).unwrap()
}

const fn node_info(first_id_byte: u8) -> NodeInfo {
    let mut unique_id = [7; UNIQUE_ID_LENGTH];
    unique_id[0] = first_id_byte;
    let software = SoftwareVersion { major_version: 0, minor_version: 1, commit: None, image_crc: None };
    NodeInfo { node_name: "org.autoswing.test", software_version: software, hardware_version: [1, 0], unique_id }
}

/// Transfer from another node; a request to this one if the type is a service.
fn transfer_from_peer(data_type: DataType, transfer_id: u8, payload: &[u8]) -> OutboundTransfer {
    let kind = if data_type.is_service { TransferKind::Request(node_id(OWN_NODE)) } else { TransferKind::Message };
    let payload = Payload::from_slice(payload).unwrap();
    OutboundTransfer { data_type, priority: 20, transfer_kind: kind, transfer_id, payload }
}

/// A transfer of several frames or of one, reassembled from sent frames.
#[derive(Clone, Debug, PartialEq)]
struct SentTransfer {
    header: FrameHeader,
    transfer_id: u8,
    payload: Vec<u8>,
}

/// Reassembles sent transfers of one node, and checks that none is incomplete.
fn reassemble(frames: &[CanFrame]) -> Vec<SentTransfer> {
    let mut open: Vec<(u32, Vec<u8>)> = Vec::new();
    let mut all = Vec::new();
    for frame in frames {
        let (&tail, part) = frame.data().split_last().unwrap();
        if tail & 0x80 != 0 {
            assert!(open.iter().all(|(id, _)| *id != frame.frame_id()), "a transfer begins within another");
            open.push((frame.frame_id(), Vec::new()));
        }
        let at = open.iter().position(|(id, _)| *id == frame.frame_id()).expect("a first frame before the others");
        open[at].1.extend_from_slice(part);
        if tail & 0x40 != 0 {
            let (id, mut payload) = open.remove(at);
            if tail & 0x80 == 0 {
                payload.drain(..2);
            }
            all.push(SentTransfer { header: FrameHeader::from_id(id).unwrap(), transfer_id: tail & 0x1F, payload });
        }
    }
    all
}

/// Node with its module.
struct Bench {
    node: CanNode,
    now_us: u64,
    settings: Settings,
    estimate: Estimate,
    indicator: IndicatorState,
    commands: Vec<Command>,
    delivered: Vec<ReceivedMessage>,
    sent_frames: Vec<CanFrame>,
}

const BODY_FIELD: Field<Body> = Field::from_ut(20.0, -5.0, 45.0);

const NORTH: Heading = Heading { magnetic_rad: 0.0, sigma_rad: 0.01, systematic_variance_rad2: 0.0 };

impl Bench {
    fn unallocated(first_id_byte: u8) -> Self {
        Self::with_settings(first_id_byte, Settings::DEFAULT)
    }

    /// Node 42, after a frame of another node.
    fn new() -> Self {
        let mut bench = Self::with_settings(1, Settings { can_node: OWN_NODE, ..Settings::DEFAULT });
        bench.deliver_transfer(PEER_NODE, &transfer_from_peer(DataType::ARMING_STATUS, 0, &[0]));
        bench
    }

    fn with_settings(first_id_byte: u8, settings: Settings) -> Self {
        Self {
            node: CanNode::new(node_info(first_id_byte), settings.can_node),
            now_us: 0,
            settings,
            estimate: Estimate {
                compass_field: Some(BODY_FIELD),
                heading: Ok(NORTH),
                attitude: Some(RollPitch::default()),
                ..Estimate::EMPTY
            },
            indicator: IndicatorState::Calibrated,
            commands: Vec::new(),
            delivered: Vec::new(),
            sent_frames: Vec::new(),
        }
    }

    fn now(&self) -> Timestamp {
        Timestamp::from_us(self.now_us)
    }

    fn deliver_transfer(&mut self, source: u8, transfer: &OutboundTransfer) {
        for frame in transfer.frames(NodeId::new(source)) {
            self.receive_frame(&frame);
        }
    }

    fn receive_frame(&mut self, frame: &CanFrame) {
        let (now, delivered) = (self.now(), &mut self.delivered);
        self.node.receive_frame(now, frame, &mut |message| delivered.push(message));
    }

    /// Polls once, without sending.
    fn poll(&mut self) {
        self.estimate.timestamp = self.now();
        let snapshot = Snapshot { indicator_state: self.indicator, ..test_snapshot(&self.estimate, &self.settings) };
        let context = NodeContext { snapshot, stored_settings: &self.settings };
        self.commands.extend(self.node.poll(&context));
    }

    /// Sends a frame; returns whether there was one.
    fn send_node_frame(&mut self) -> bool {
        let Some(frame) = self.node.frame_to_send().cloned() else { return false };
        self.node.on_frame_sent(self.now());
        self.sent_frames.push(frame);
        true
    }

    /// Sends all queued frames.
    fn send_all_node_frames(&mut self) {
        while self.send_node_frame() {}
    }

    /// Polls and sends for a time; returns the transfers sent in it.
    fn run_ms(&mut self, ms: u64) -> Vec<SentTransfer> {
        let end_us = self.now_us + ms * 1000;
        while self.now_us < end_us {
            self.now_us += READING_PERIOD_US;
            self.poll();
            self.send_all_node_frames();
        }
        reassemble(&std::mem::take(&mut self.sent_frames))
    }

    fn sent_in_ms(&mut self, data_type: DataType, ms: u64) -> Vec<SentTransfer> {
        self.run_ms(ms).into_iter().filter(|sent| has_data_type(sent, data_type)).collect()
    }

    /// Sends a request, runs for 25 ms, and returns the response.
    fn response_to_request(&mut self, data_type: DataType, payload: &[u8]) -> Option<Vec<u8>> {
        self.deliver_transfer(PEER_NODE, &transfer_from_peer(data_type, 9, payload));
        self.run_for_response(data_type)
    }

    fn run_for_response(&mut self, data_type: DataType) -> Option<Vec<u8>> {
        let mut sent = self.sent_in_ms(data_type, 25);
        assert!(sent.len() <= 1);
        sent.pop().map(|sent| {
            assert_eq!(
                (sent.header.transfer_kind, sent.header.priority),
                (TransferKind::Response(node_id(PEER_NODE)), 20)
            );
            assert_eq!((sent.header.source_node, sent.transfer_id), (Some(node_id(OWN_NODE)), 9));
            sent.payload
        })
    }
}

fn has_data_type(sent: &SentTransfer, data_type: DataType) -> bool {
    (sent.header.type_id, sent.header.transfer_kind != TransferKind::Message)
        == (data_type.type_id, data_type.is_service)
}
