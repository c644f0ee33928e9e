//! The module as a node of a CAN bus, beside an autopilot's node and others, on a simulated bus with faults.

use autoswing::time::Timestamp;
use autoswing_firmware::wire::dronecan::outbound::NodeStatus;
use autoswing_firmware::wire::dronecan::{
    Allocation, BusMessage, CanFrame, DataType, FrameHeader, InboundTransfer, NodeId, OutboundTransfer, Payload,
    Targetted, TransferKind, TransferReceiver, priority,
};
use simulator::devices::can::{CanEnd, CanFaults, SimulatedCanBus};
use simulator::faults::Faults;
use simulator::module::Module as _;
use simulator::rig::Rig;
use simulator::world::WorldConfig;
use simulator::world::cable_far_end::FarEnd;
use simulator::world::mavlink_autopilot::{AutopilotInputs, MavlinkAutopilot, MavlinkFirmware};
use testkit::frames::mavlink_command;

use crate::autopilot_view::{frames_with_id, status_texts};

const COMMAND_ACK: u32 = 77;

const FIELD_TYPE: DataType = DataType::MAGNETIC_FIELD_STRENGTH_2;

fn node_id(number: u8) -> NodeId {
    NodeId::new(number).expect("1 to 127")
}

fn source_node(frame: &CanFrame) -> Option<NodeId> {
    FrameHeader::from_id(frame.frame_id()).and_then(|header| header.source_node)
}

fn is_message(frame: &CanFrame, data_type: DataType) -> bool {
    FrameHeader::from_id(frame.frame_id())
        .is_some_and(|header| (header.transfer_kind, header.type_id) == (TransferKind::Message, data_type.type_id))
}

/// Autopilot: sends its status and its armed state, and allocates numbers.
struct Autopilot {
    bus_end: CanEnd,
    node_number: NodeId,
    transfer_id: u8,
    allocated_unique_ids: Vec<Vec<u8>>,
    unique_id_so_far: Vec<u8>,
    is_armed: bool,
    /// Frames of other nodes.
    received_frames: Vec<CanFrame>,
}

impl Autopilot {
    fn new(bus: &SimulatedCanBus) -> Self {
        Self {
            bus_end: bus.attach_node(),
            node_number: node_id(10),
            transfer_id: 0,
            allocated_unique_ids: Vec::new(),
            unique_id_so_far: Vec::new(),
            is_armed: false,
            received_frames: Vec::new(),
        }
    }

    fn send_transfer(&mut self, data_type: DataType, kind: TransferKind, payload: &[u8]) {
        let payload = Payload::from_slice(payload).expect("a short payload");
        self.transfer_id = (self.transfer_id + 1) % 32;
        let transfer = OutboundTransfer {
            data_type,
            priority: priority::LOW_PRIORITY,
            transfer_kind: kind,
            transfer_id: self.transfer_id,
            payload,
        };
        for frame in transfer.frames(Some(self.node_number)) {
            self.bus_end.queue_frame(&frame);
        }
    }

    /// Sends status and armed state, twice a second as ArduPilot does.
    fn send_status(&mut self) {
        self.send_transfer(DataType::NODE_STATUS, TransferKind::Message, &NodeStatus::default().payload());
        self.send_transfer(DataType::ARMING_STATUS, TransferKind::Message, &[u8::from(self.is_armed) * 255]);
    }

    fn process_frames(&mut self) {
        for frame in self.bus_end.take_received() {
            if is_message(&frame, DataType::ALLOCATION) && source_node(&frame).is_none() {
                self.answer_allocation(&frame);
            }
            self.received_frames.push(frame);
        }
    }

    /// Answers a node-number request, which comes in three parts; a known unique id keeps its number.
    fn answer_allocation(&mut self, request: &CanFrame) {
        let [first, part @ .., _tail] = request.data() else { return };
        if first & 1 == 1 {
            self.unique_id_so_far.clear();
        }
        self.unique_id_so_far.extend_from_slice(part);
        let mut number = 0;
        if self.unique_id_so_far.len() == 16 {
            let position =
                self.allocated_unique_ids.iter().position(|known| *known == self.unique_id_so_far).unwrap_or_else(
                    || {
                        self.allocated_unique_ids.push(self.unique_id_so_far.clone());
                        self.allocated_unique_ids.len() - 1
                    },
                );
            number = 125 - position as u8;
        }
        let answer = Allocation { node: NodeId::new(number), unique_id: &self.unique_id_so_far };
        let payload = [&[answer.node.map_or(0, NodeId::number) << 1], answer.unique_id].concat();
        self.send_transfer(DataType::ALLOCATION, TransferKind::Message, &payload);
    }

    fn take_field_count(&mut self, number: u8) -> usize {
        let frames = std::mem::take(&mut self.received_frames);
        let is_field = |frame: &&CanFrame| is_message(frame, FIELD_TYPE) && source_node(frame) == Some(node_id(number));
        frames.iter().filter(is_field).count()
    }
}

/// A module on a bus, with an autopilot.
struct Bench {
    rig: Rig,
    bus: SimulatedCanBus,
    autopilot: Autopilot,
}

impl Bench {
    fn new(faults: CanFaults) -> Self {
        let mut rig = Rig::with_port_devices(
            WorldConfig::of_table1(7),
            Faults::default(),
            [FarEnd::Unconnected, FarEnd::Unconnected],
        );
        let bus = SimulatedCanBus::new(faults);
        rig.attach_can(bus.attach_node(), 1);
        Self { rig, autopilot: Autopilot::new(&bus), bus }
    }

    /// Runs in steps of 5 ms; calls a function in each.
    fn run_ms_with(&mut self, ms: u64, mut step: impl FnMut(&mut Self)) {
        let end_us = self.rig.now_us() + ms * 1000;
        while self.rig.now_us() < end_us {
            let now_us = self.rig.now_us();
            if now_us.is_multiple_of(500_000) {
                self.autopilot.send_status();
            }
            step(self);
            self.autopilot.process_frames();
            let _ = self.rig.run_until(now_us + 5_000);
        }
    }

    fn run_ms(&mut self, ms: u64) {
        self.run_ms_with(ms, |_| {});
    }

    /// Fields that a node sends in the next `ms`.
    fn field_count(&mut self, node: u8, ms: u64) -> usize {
        self.autopilot.take_field_count(node);
        self.run_ms(ms);
        self.autopilot.take_field_count(node)
    }

    fn status(&mut self) -> String {
        self.rig.console.send_bytes(b"status all\r");
        self.run_ms(100);
        String::from_utf8_lossy(&self.rig.console.receive_bytes()).into_owned()
    }
}

/// An uncalibrated module sends the raw field, as by MSP, so that the autopilot finds its compass within five seconds.
#[test]
fn a_module_is_a_compass_within_seconds() {
    let mut bench = Bench::new(CanFaults::default());
    bench.run_ms(2_500);
    assert!(bench.autopilot.take_field_count(125) > 5);
    assert!(bench.field_count(125, 2_000).abs_diff(100) <= 2);
}

/// A twentieth of the frames lost, a twentieth repeated, a twentieth late.
#[test]
fn a_module_is_a_compass_on_a_bad_bus() {
    for seed in 0..5 {
        let mut bench =
            Bench::new(CanFaults { seed, loss_share: 0.05, duplication_share: 0.05, reordering_share: 0.05 });
        bench.run_ms(15_000);
        let fields = bench.field_count(125, 2_000);
        assert!((85..=115).contains(&fields), "seed {seed}: {fields}");
    }
}

/// After a restart the allocator recognises the unique id, so that the autopilot keeps the calibration of this compass.
#[test]
fn a_module_keeps_its_number_over_a_restart() {
    let mut bench = Bench::new(CanFaults::default());
    bench.run_ms(3_000);
    bench.rig.reset_module();
    assert!(bench.field_count(125, 3_000) > 10);
    assert_eq!(bench.autopilot.allocated_unique_ids.len(), 1);
}

/// In the second after bus-off the field is sent at its usual 50 Hz, without old frames.
#[test]
fn a_module_sends_again_after_bus_off() {
    let mut bench = Bench::new(CanFaults::default());
    bench.run_ms(3_000);
    bench.bus.switch_bus_off(2_000_000);
    bench.run_ms(2_000);
    let fields = bench.field_count(125, 1_000);
    assert!(fields.abs_diff(50) <= 2, "{fields}");
    let status = bench.status();
    let line = status.lines().find(|line| line.starts_with("can: ")).unwrap_or_default();
    assert!(
        line.starts_with("can: node by allocation, 50 Hz, covariance off, termination off; node 125; "),
        "{status}"
    );
    assert!(line.ends_with(" 32 errors"), "{status}");
}

/// A node sends 20 frames each 5 ms, half of the bus: random data of types that the module receives, under random node
/// numbers.
#[test]
fn a_babbling_node_does_not_stop_the_field() {
    let mut bench = Bench::new(CanFaults::default());
    bench.run_ms(3_000);
    bench.autopilot.take_field_count(125);
    let babbler = bench.bus.attach_node();
    let mut random = testkit::random::Random(3);
    bench.run_ms_with(5_000, |_| {
        for _ in 0..20 {
            let types = [DataType::TARGETTED, DataType::ALLOCATION, DataType::BATTERY_INFO, DataType::FIX_2];
            let type_id = types[random.bits() as usize % types.len()].type_id;
            let source = NodeId::new(1 + random.byte() % 124);
            let header =
                FrameHeader { priority: 0, transfer_kind: TransferKind::Message, type_id, source_node: source };
            let data = random.bytes(8);
            babbler.queue_frame(&CanFrame::new(header.to_id(), &data).unwrap());
        }
    });
    let fields = bench.autopilot.take_field_count(125);
    assert!(fields > 240, "{fields}");
}

/// A second node with the module's number starts while the module runs.
#[test]
fn a_second_node_with_this_number_silences_the_field() {
    let mut bench = Bench::new(CanFaults::default());
    bench.rig.console.send_bytes(b"set can-node 42\rreboot\r");
    bench.run_ms(3_000);
    assert!(bench.autopilot.take_field_count(42) > 10);
    let second = bench.bus.attach_node();
    let status = OutboundTransfer {
        data_type: DataType::NODE_STATUS,
        priority: priority::LOW_PRIORITY,
        transfer_kind: TransferKind::Message,
        transfer_id: 0,
        payload: NodeStatus::default().payload(),
    };
    bench.run_ms_with(5_000, |bench| {
        if bench.rig.now_us().is_multiple_of(1_000_000) {
            status.frames(Some(node_id(42))).for_each(|frame| second.queue_frame(&frame));
        }
    });
    bench.autopilot.take_field_count(42);
    let status = bench.status();
    assert_eq!(bench.field_count(42, 800), 0);
    assert!(status.contains("; node 42, which another node has, too"), "{status}");
    bench.run_ms(4_000);
    assert!(bench.autopilot.take_field_count(42) > 10, "the other one is gone");
}

/// Without a console: the attitude arrives, and a ground station's MAV_CMD_USER_1 writes the autopilot's parameters.
#[test]
fn the_autopilot_is_set_up_through_the_tunnel() {
    let mut bench = Bench::new(CanFaults::default());
    let mut receiver = TransferReceiver::default();
    let mut ardupilot = MavlinkAutopilot::new(bench.rig.world.attitude_source(), MavlinkFirmware::ArduPilot, 0);
    for (name, number) in [("COMPASS_DEV_ID", 97_539.0), ("COMPASS_PRIO1_ID", 97_539.0)] {
        ardupilot.parameters.set_number(name, number);
    }
    let mut run_ms = |bench: &mut Bench, ms: u64, from_ground_station: &[u8]| {
        let mut pending_bytes = from_ground_station.to_vec();
        bench.run_ms_with(ms, |bench| {
            let now_us = bench.rig.now_us();
            for frame in std::mem::take(&mut bench.autopilot.received_frames) {
                let at = Timestamp::from_us(now_us);
                if let Some(InboundTransfer { message: BusMessage::Targetted(piece), .. }) =
                    receiver.push_frame(at, Some(bench.autopilot.node_number), &frame)
                {
                    ardupilot.receive_bytes(now_us, piece.serial_bytes);
                }
            }
            let inputs = AutopilotInputs { true_state: bench.rig.world.true_state(now_us), ..Default::default() };
            pending_bytes.extend(ardupilot.due_messages(now_us, &inputs, |_| {}));
            for serial_bytes in std::mem::take(&mut pending_bytes).chunks(Targetted::MAX_DATA_LENGTH) {
                let protocol = Targetted::MAVLINK_2_PROTOCOL;
                let piece =
                    Targetted { protocol, target: 125, serial_line: 0, tunnel_options: 1, baud: 57_600, serial_bytes };
                bench.autopilot.send_transfer(DataType::TARGETTED, TransferKind::Message, &piece.payload());
            }
        });
        ardupilot.take_received()
    };
    run_ms(&mut bench, 6_000, &[]);
    let set_up = mavlink_command([255, 190], [1, 158], 31_010, 0, [2.0, 0.0, 0.0, 0.0]);
    let received = run_ms(&mut bench, 30_000, &set_up);
    assert_eq!(frames_with_id(COMMAND_ACK, &received).len(), 1);
    let texts = status_texts(&received);
    assert!(texts.iter().any(|text| text.contains("this module, DroneCAN bus 0 node 125")), "{texts:?}");
    assert!(texts.iter().any(|text| text.contains("19 right, 0 wrong, 3 changed; restart it")), "{texts:?}");
    let status = bench.status();
    assert!(status.contains("attitude: roll "), "{status}");
    assert_eq!(ardupilot.parameters.number("COMPASS_OFS_X"), Some(1.0));
}
