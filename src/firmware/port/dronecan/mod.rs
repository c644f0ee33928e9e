//! DroneCAN: the module as a compass node of the autopilot's CAN bus.
//!
//! The node is a pure value: frames and snapshots of the module in, frames and commands out. It is silent until it has
//! received a frame. Without a configured number it asks the autopilot for one. Then it
//!
//! - sends its status once a second, and the corrected field, while it is trusted;
//! - answers requests for its description, parameters, counters, a restart, a firmware update;
//! - sends what the module reports as texts;
//! - carries MAVLink of one serial line of the autopilot;
//! - uses armed state, battery current, position and date of other nodes.
//!
//! In safe mode it receives only what replacing the firmware needs, and reports the mode.
//!
//! The bus has no authentication: the state machine refuses its commands while the vehicle is armed, and a second node
//! with the same number stops the field.

mod allocation;
mod firmware_update;
mod frame_outbox;
mod log_message_queue;
mod node_services;
mod parameters;
mod status;
mod tunnel;
mod vehicle_reports;

use crate::health::CanState;
use crate::port::mavlink::Mavlink;
use crate::port::message_schedule::MessageSchedule;
use crate::port::received_message::ReceivedMessage;
use crate::port::snapshot::Snapshot;
use crate::wire::dronecan::outbound::{self, BusCounts, NodeInfo};
use crate::wire::dronecan::{
    BusMessage, CanFrame, DataType, FrameHeader, InboundTransfer, NodeId, TransferReceiver, priority,
};
use allocation::AllocationClient;
use autoswing::frames::{Body, Field};
use autoswing::instrument::Estimate;
use autoswing::time::Timestamp;
use autoswing::trig::sqrt;
use autoswing_module::compass::Command;
use autoswing_module::messages::{Message as Notice, Refusal};
use autoswing_module::settings::Settings;
pub use firmware_update::{BOOT_LOADER_HANDOVER_LENGTH, UpdateForBootLoader};
use frame_outbox::FrameOutbox;
use log_message_queue::LogMessageQueue;
use node_services::{RequestStep, Services};
use status::StatusMonitor;
use tunnel::Tunnel;
use vehicle_reports::VehicleReports;

/// Rate of NodeStatus, Hz.
const STATUS_HZ: u8 = 1;

/// Number of the only sensor. Autopilots recognise a compass by the numbers of node and sensor.
const SENSOR_NUMBER: u8 = 0;

/// Time without a frame of another node with the same number, after which the field is sent again, microseconds.
const NODE_CONFLICT_HOLD_US: u64 = 3_000_000;

/// Data types that are received in safe mode: any other one can be the cause of the panics.
const SAFE_MODE_TYPES: [DataType; 5] = [
    DataType::ALLOCATION,
    DataType::ARMING_STATUS,
    DataType::GET_NODE_INFO,
    DataType::RESTART_NODE,
    DataType::BEGIN_FIRMWARE_UPDATE,
];

/// Microtesla of a gauss.
const UT_PER_GAUSS: f32 = 100.0;

/// Number of this node, if it has one, and its origin.
#[derive(Debug)]
enum NodeAddress {
    Configured(NodeId),
    Allocated(NodeId),
    Unallocated,
}

/// State of the module, from which messages and answers are made.
#[derive(Clone, Copy, Debug)]
pub struct NodeContext<'a> {
    /// Snapshot as for a port, with the effective settings.
    pub snapshot: Snapshot<'a>,
    /// Settings as stored, for the parameters.
    pub stored_settings: &'a Settings,
}

/// Compass node of a CAN bus.
#[derive(Debug)]
pub struct CanNode {
    info: NodeInfo,
    is_safe_mode: bool,
    node_address: NodeAddress,
    allocation: AllocationClient,
    receiver: TransferReceiver,
    outbox: FrameOutbox,
    services: Services,
    status_monitor: StatusMonitor,
    vehicle_reports: VehicleReports,
    log_messages: LogMessageQueue,
    tunnel: Tunnel,
    field_schedule: MessageSchedule,
    status_schedule: MessageSchedule,
    /// Time of the last frame of another node with this number.
    last_conflict_at: Option<Timestamp>,
    conflict_message: Option<Notice>,
    frame_counts: BusCounts,
    received_transfer_count: u32,
}

impl CanNode {
    /// Creates a node with a number; 0 asks the allocator for one.
    #[must_use]
    pub fn new(info: NodeInfo, number: u8) -> Self {
        Self {
            node_address: NodeId::new(number).map_or(NodeAddress::Unallocated, NodeAddress::Configured),
            allocation: AllocationClient::new(info.unique_id),
            info,
            is_safe_mode: false,
            receiver: TransferReceiver::default(),
            outbox: FrameOutbox::default(),
            services: Services::default(),
            status_monitor: StatusMonitor::default(),
            vehicle_reports: VehicleReports::default(),
            log_messages: LogMessageQueue::default(),
            tunnel: Tunnel::default(),
            field_schedule: MessageSchedule::default(),
            status_schedule: MessageSchedule::default(),
            last_conflict_at: None,
            conflict_message: None,
            frame_counts: BusCounts::default(),
            received_transfer_count: 0,
        }
    }

    /// Creates a node for safe mode. Settings are not loaded there: it asks for a number, and the allocator remembers it.
    #[must_use]
    pub fn in_safe_mode(info: NodeInfo) -> Self {
        Self { is_safe_mode: true, ..Self::new(info, Settings::DEFAULT.can_node) }
    }

    /// Refuses firmware updates, on a board whose boot loader does not load them over the bus.
    pub const fn refuse_updates(&mut self) {
        self.services.refuse_updates();
    }

    /// Processes a frame; passes on the messages that it completes. A request is answered by [`poll`](Self::poll).
    pub fn receive_frame(&mut self, at: Timestamp, frame: &CanFrame, deliver: &mut dyn FnMut(ReceivedMessage)) {
        self.frame_counts.received_frames = self.frame_counts.received_frames.wrapping_add(1);
        let own = self.node_id();
        let header = FrameHeader::from_id(frame.frame_id());
        if let Some(source) = header.and_then(|header| header.source_node) {
            self.allocation.record_other_node(source);
            if own == Some(source) {
                self.on_number_conflict(at, source);
                return;
            }
        }
        if self.is_safe_mode
            && !header.is_some_and(|header| SAFE_MODE_TYPES.iter().any(|known| known.matches_header(header)))
        {
            return;
        }
        let Self { receiver, services, vehicle_reports, tunnel, allocation, .. } = self;
        let Some(transfer) = receiver.push_frame(at, own, frame) else { return };
        self.received_transfer_count = self.received_transfer_count.wrapping_add(1);
        let InboundTransfer { source_node: source, message, .. } = transfer;
        match (message, own, source) {
            (BusMessage::Allocation(step), None, _) => {
                if let Some(number) = allocation.receive_allocation(at, source, step) {
                    self.node_address = NodeAddress::Allocated(number);
                }
            }
            (BusMessage::Targetted(piece), Some(own), _) if piece.target == own.number() => {
                let has_battery = vehicle_reports.has_battery(at);
                tunnel.receive_targetted(at, &transfer, &piece, &mut |message| match message {
                    ReceivedMessage::Current(_) if has_battery => {}
                    message => deliver(message),
                });
            }
            (BusMessage::ArmingStatus(is_armed), _, Some(source)) => {
                vehicle_reports.update_armed(at, source, is_armed);
            }
            (BusMessage::Battery { battery_number, current_a: Some(current_a) }, _, Some(source))
                if vehicle_reports.accept_battery(at, source, battery_number) =>
            {
                deliver(ReceivedMessage::Current(current_a));
            }
            (BusMessage::Fix(position, date), _, Some(_)) => {
                position.map(ReceivedMessage::Position).into_iter().for_each(&mut *deliver);
                date.map(ReceivedMessage::Date).into_iter().for_each(&mut *deliver);
            }
            (_, Some(own), _) => services.receive_transfer(own, &transfer),
            _ => {}
        }
    }

    /// Queues due messages and answers; returns a command to execute, whose result [`complete_command`] takes. Called
    /// for every estimate, and after received frames.
    ///
    /// [`complete_command`]: Self::complete_command
    pub fn poll(&mut self, context: &NodeContext<'_>) -> Option<Command> {
        let NodeContext { snapshot, .. } = context;
        let now = snapshot.now;
        self.status_monitor.update_sensor_silence(snapshot);
        if !self.is_safe_mode {
            let is_armed = self.is_armed(now) == Some(true);
            self.log_messages.queue_state_change(snapshot, is_armed);
        }
        self.outbox.drop_expired_frames(now);
        if self.frame_counts.received_frames == 0 {
            return None;
        }
        let Some(own) = self.node_id() else {
            if let Some(payload) = self.allocation.due_request(now) {
                self.outbox.queue_message(now, None, DataType::ALLOCATION, priority::LOW_PRIORITY, payload);
            }
            return None;
        };
        self.queue_field(own, snapshot);
        self.queue_status(own, snapshot);
        let command = self.answer_requests(own, context);
        self.queue_tunnel_output(own, snapshot);
        self.queue_log_message(own, now);
        command.or_else(|| self.tunnel.mavlink.take_command())
    }

    /// Processes the result of a command: of a request, or of one through the tunnel.
    pub fn complete_command(&mut self, command: Command, result: Result<(), &Refusal>) {
        if !self.services.complete_command(command, result) {
            self.tunnel.mavlink.complete_command(command, result);
        }
    }

    /// Update to hand over to the boot loader before the restart that follows.
    #[must_use]
    pub const fn granted_update(&self) -> Option<&UpdateForBootLoader> {
        self.services.granted_update()
    }

    /// Queues a message for people.
    pub fn queue_text(&mut self, message: &Notice) {
        self.log_messages.push_message(message);
        self.tunnel.mavlink.queue_text(message);
    }

    /// Takes a message for all users.
    pub fn take_message(&mut self, now: Timestamp) -> Option<Notice> {
        self.conflict_message.take().or_else(|| self.tunnel.mavlink.take_message(now))
    }

    /// MAVLink of the autopilot at the other end of the tunnel.
    pub const fn mavlink(&mut self) -> &mut Mavlink {
        &mut self.tunnel.mavlink
    }

    /// Whether the vehicle is armed, if another node has reported that recently; `armed` of either report counts.
    #[must_use]
    pub fn is_armed(&self, now: Timestamp) -> Option<bool> {
        match (self.vehicle_reports.is_armed(now), self.tunnel.mavlink.is_armed(now)) {
            (Some(one), Some(two)) => Some(one || two),
            (known, None) | (None, known) => known,
        }
    }

    /// Frame to send next.
    #[must_use]
    pub fn frame_to_send(&self) -> Option<&CanFrame> {
        self.outbox.first_frame()
    }

    /// Removes the frame after it was sent.
    pub fn on_frame_sent(&mut self, now: Timestamp) {
        self.outbox.pop_frame(now);
        self.frame_counts.sent_frames = self.frame_counts.sent_frames.wrapping_add(1);
    }

    /// Whether a request waits for [`poll`](Self::poll).
    #[must_use]
    pub fn has_requests(&self) -> bool {
        self.services.has_requests()
    }

    /// Counts errors of the bus.
    pub const fn add_bus_errors(&mut self, count: u32) {
        self.frame_counts.bus_errors = self.frame_counts.bus_errors.wrapping_add(count);
    }

    /// State of the node for status reports.
    #[must_use]
    pub fn can_state(&self, now: Timestamp) -> CanState {
        CanState {
            node: self.node_id(),
            has_number_conflict: self.has_number_conflict(now),
            frame_counts: self.frame_counts,
        }
    }

    const fn node_id(&self) -> Option<NodeId> {
        match self.node_address {
            NodeAddress::Configured(number) | NodeAddress::Allocated(number) => Some(number),
            NodeAddress::Unallocated => None,
        }
    }

    /// Handles another node with this number: a configured number stays, but no field is sent; instead of an allocated
    /// one another is requested.
    fn on_number_conflict(&mut self, at: Timestamp, own_node: NodeId) {
        let is_given_up = matches!(self.node_address, NodeAddress::Allocated(_));
        if !self.has_number_conflict(at) {
            self.conflict_message = Some(Notice::NodeNumberConflict { number: own_node.number(), is_given_up });
        }
        self.last_conflict_at = Some(at);
        if is_given_up {
            self.node_address = NodeAddress::Unallocated;
            self.outbox.clear();
        }
    }

    fn has_number_conflict(&self, now: Timestamp) -> bool {
        self.last_conflict_at.is_some_and(|at| now.us_since(at) <= NODE_CONFLICT_HOLD_US)
    }

    fn queue_field(&mut self, own_node: NodeId, snapshot: &Snapshot<'_>) {
        let Settings { can_rate_hz: rate_hz, can_sends_covariance: sends_covariance, .. } = *snapshot.settings;
        let Some(field) = snapshot.estimate.compass_field.filter(|_| !self.has_number_conflict(snapshot.now)) else {
            return;
        };
        if field.ut.iter().all(|ut| ut.is_finite()) && self.field_schedule.is_due(snapshot.now, rate_hz) {
            let variances =
                if sends_covariance { variance_gauss2(snapshot.estimate, field).map(|axis| [axis; 3]) } else { None };
            let gauss = [field.ut.x, field.ut.y, field.ut.z].map(|ut| ut / UT_PER_GAUSS);
            let payload = outbound::magnetic_field(SENSOR_NUMBER, gauss, variances);
            self.outbox.queue_field(snapshot.now, own_node, priority::LOW_PRIORITY, payload);
        }
    }

    fn queue_status(&mut self, own_node: NodeId, snapshot: &Snapshot<'_>) {
        if self.status_schedule.is_due(snapshot.now, STATUS_HZ) {
            let status = self.node_status(snapshot);
            self.outbox.queue_message(
                snapshot.now,
                Some(own_node),
                DataType::NODE_STATUS,
                priority::LOW_PRIORITY,
                status.payload(),
            );
        }
    }

    fn node_status(&self, snapshot: &Snapshot<'_>) -> outbound::NodeStatus {
        self.status_monitor.status_message(
            snapshot,
            self.services.is_updating(),
            self.has_number_conflict(snapshot.now),
        )
    }

    fn answer_requests(&mut self, own_node: NodeId, context: &NodeContext<'_>) -> Option<Command> {
        let NodeContext { snapshot, stored_settings } = context;
        if self.services.is_idle() {
            return None;
        }
        let status = self.node_status(snapshot);
        let transfers = BusCounts {
            sent_frames: self.outbox.transfer_count,
            received_frames: self.received_transfer_count,
            bus_errors: self.receiver.rejected_count.wrapping_add(self.outbox.lost_transfer_count),
        };
        let Self { info, services, outbox, frame_counts: frames, .. } = self;
        let describe_node = |data_type| match data_type {
            DataType::GET_NODE_INFO => info.payload(status),
            _ => outbound::transport_stats(transfers, *frames),
        };
        loop {
            match services.next_request_step(snapshot.now, stored_settings, describe_node) {
                RequestStep::Execute(command) => return Some(command),
                RequestStep::Respond(response) if outbox.queue_transfer(snapshot.now, Some(own_node), &response) => {
                    services.remove_answered_request();
                }
                // If the queue is full, the response is made again later.
                RequestStep::Respond(_) | RequestStep::Idle => return None,
            }
        }
    }

    fn queue_tunnel_output(&mut self, own_node: NodeId, snapshot: &Snapshot<'_>) {
        self.tunnel.poll(snapshot);
        if let Some((payload, length)) = self.tunnel.next_targetted()
            && self.outbox.queue_message(
                snapshot.now,
                Some(own_node),
                DataType::TARGETTED,
                priority::MEDIUM_PRIORITY,
                payload,
            )
        {
            self.tunnel.consume_bytes(length);
        }
    }

    fn queue_log_message(&mut self, own_node: NodeId, now: Timestamp) {
        if self.outbox.has_room_for_text()
            && let Some(payload) = self.log_messages.next_log_message(now)
        {
            self.outbox.queue_message(now, Some(own_node), DataType::LOG_MESSAGE, priority::LOW_PRIORITY, payload);
        }
    }
}

/// Variance of each axis, square gauss: the heading's standard deviation is caused by an error across the horizontal
/// field. Unknown without a heading.
fn variance_gauss2(estimate: &Estimate, field: Field<Body>) -> Option<f32> {
    let (heading, attitude) = (estimate.heading.ok()?, estimate.attitude?);
    let level = attitude.to_level_frame(field);
    let horizontal_gauss = sqrt(level.ut.x * level.ut.x + level.ut.y * level.ut.y) / UT_PER_GAUSS;
    let sigma_gauss = heading.sigma_rad * horizontal_gauss;
    Some(sigma_gauss * sigma_gauss)
}

#[cfg(test)]
mod tests;
