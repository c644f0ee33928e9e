//! CAN bus at 1 Mbit/s: a frame occupies it for its bits, and reaches all other nodes. Faults are drawn from a seed.
//!
//! Arbitration is not modelled: frames are sent in the order in which nodes offer them.

use std::cell::RefCell;
use std::collections::VecDeque;
use std::future::poll_fn;
use std::mem;
use std::rc::Rc;
use std::task::{Context, Poll, Waker};

use autoswing_firmware::app::can::{ReceiveFrame, SendFrame};
use autoswing_firmware::wire::dronecan::CanFrame;
use testkit::clock;
use testkit::random::Random;

/// Capacity of a node's receiver, frames; further ones are lost.
const RECEIVER_CAPACITY_FRAMES: usize = 64;

/// Duration of a frame without data bytes, microseconds, with the mean number of stuff bits.
const EMPTY_FRAME_US: u64 = 75;
/// Duration of a data byte, microseconds, with the mean number of stuff bits.
const DATA_BYTE_US: u64 = 9;

/// Longest delay of a frame that later frames overtake, microseconds.
const MAX_OVERTAKEN_DELAY_US: f32 = 5_000.0;

/// Shares of frames with a fault, each for each receiver.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct CanFaults {
    /// Seed of the faults.
    pub seed: u64,
    /// Share of frames that are lost.
    pub loss_share: f32,
    /// Share of frames that are received twice.
    pub duplication_share: f32,
    /// Share of frames that are received up to 5 ms late, after later ones.
    pub reordering_share: f32,
}

/// Errors of a sender that lead to the state bus-off: each adds 8 to a counter whose limit is 256 (ISO 11898-1).
const ERRORS_TO_BUS_OFF: u32 = 32;

/// Bus with its nodes.
#[derive(Clone)]
pub struct SimulatedCanBus(Rc<RefCell<BusState>>);

struct BusState {
    faults: CanFaults,
    random: Random,
    free_at_us: u64,
    /// End of the state bus-off of all controllers.
    bus_off_until_us: u64,
    inboxes: Vec<FrameInbox>,
    sent_frame_count: u64,
}

#[derive(Default)]
struct FrameInbox {
    /// Frames with their times of arrival.
    frames: VecDeque<(u64, CanFrame)>,
    reader_waker: Option<Waker>,
    /// Detected errors of the bus.
    error_count: u32,
}

impl SimulatedCanBus {
    /// A bus without nodes.
    #[must_use]
    pub fn new(faults: CanFaults) -> Self {
        Self(Rc::new(RefCell::new(BusState {
            faults,
            random: Random(faults.seed),
            free_at_us: 0,
            bus_off_until_us: 0,
            inboxes: Vec::new(),
            sent_frame_count: 0,
        })))
    }

    /// Attaches a node to the bus and returns its end.
    #[must_use]
    pub fn attach_node(&self) -> CanEnd {
        let mut state = self.0.borrow_mut();
        state.inboxes.push(FrameInbox::default());
        CanEnd { bus: self.clone(), node_index: state.inboxes.len() - 1 }
    }

    /// Fault: no frame is sent for this time, as after many errors.
    pub fn switch_bus_off(&self, duration_us: u64) {
        let mut state = self.0.borrow_mut();
        state.bus_off_until_us = clock::now_us() + duration_us;
        state.inboxes.iter_mut().for_each(|inbox| inbox.error_count += ERRORS_TO_BUS_OFF);
    }

    /// Number of frames sent since the start.
    #[must_use]
    pub fn frame_count(&self) -> u64 {
        self.0.borrow().sent_frame_count
    }
}

/// A node's end of the bus. Clones share it.
#[derive(Clone)]
pub struct CanEnd {
    bus: SimulatedCanBus,
    node_index: usize,
}

impl CanEnd {
    /// Clears the receiver, as at the start of the node.
    pub fn clear_receiver(&self) {
        self.bus.0.borrow_mut().inboxes[self.node_index] = FrameInbox::default();
    }

    /// Sends a frame as soon as the bus is free, behind all frames offered before.
    pub fn queue_frame(&self, frame: &CanFrame) {
        self.bus.0.borrow_mut().broadcast_frame(self.node_index, frame, clock::now_us());
    }

    /// Returns and removes the received frames.
    #[must_use]
    pub fn take_received(&self) -> Vec<CanFrame> {
        std::iter::from_fn(|| self.bus.0.borrow_mut().inboxes[self.node_index].pop_frame(clock::now_us())).collect()
    }

    fn poll_send(&self, frame: &CanFrame, context: &Context<'_>) -> Poll<()> {
        let mut state = self.bus.0.borrow_mut();
        let now_us = clock::now_us();
        let ready_at_us = state.free_at_us.max(state.bus_off_until_us);
        if now_us < ready_at_us {
            embassy_time_driver::schedule_wake(ready_at_us, context.waker());
            return Poll::Pending;
        }
        state.broadcast_frame(self.node_index, frame, now_us);
        Poll::Ready(())
    }

    fn poll_receive(&self, context: &Context<'_>) -> Poll<CanFrame> {
        let inbox = &mut self.bus.0.borrow_mut().inboxes[self.node_index];
        if let Some(frame) = inbox.pop_frame(clock::now_us()) {
            return Poll::Ready(frame);
        }
        inbox.reader_waker = Some(context.waker().clone());
        if let Some((at_us, _)) = inbox.frames.front() {
            embassy_time_driver::schedule_wake(*at_us, context.waker());
        }
        Poll::Pending
    }
}

impl SendFrame for CanEnd {
    async fn send_frame(&mut self, frame: &CanFrame) {
        poll_fn(|context| self.poll_send(frame, context)).await;
    }
}

impl ReceiveFrame for CanEnd {
    async fn receive_frame(&mut self) -> CanFrame {
        poll_fn(|context| self.poll_receive(context)).await
    }

    fn take_error_count(&mut self) -> u32 {
        mem::take(&mut self.bus.0.borrow_mut().inboxes[self.node_index].error_count)
    }
}

impl BusState {
    fn broadcast_frame(&mut self, sender: usize, frame: &CanFrame, now_us: u64) {
        self.sent_frame_count += 1;
        self.free_at_us = self.free_at_us.max(now_us) + EMPTY_FRAME_US + DATA_BYTE_US * frame.data().len() as u64;
        let CanFaults { loss_share: loss, duplication_share: duplication, reordering_share: reordering, .. } =
            self.faults;
        for (_, inbox) in self.inboxes.iter_mut().enumerate().filter(|(node_index, _)| *node_index != sender) {
            let mut happens = |share: f32| share > 0.0 && self.random.uniform(0.0, 1.0) < share;
            if happens(loss) {
                continue;
            }
            let copies = if happens(duplication) { 2 } else { 1 };
            let is_late = happens(reordering);
            for _ in 0..copies {
                let added_latency_us =
                    if is_late { self.random.uniform(0.0, MAX_OVERTAKEN_DELAY_US) as u64 } else { 0 };
                inbox.push_frame(self.free_at_us + added_latency_us, frame);
            }
        }
    }
}

impl FrameInbox {
    fn push_frame(&mut self, at_us: u64, frame: &CanFrame) {
        if self.frames.len() >= RECEIVER_CAPACITY_FRAMES {
            return;
        }
        let insert_index = self.frames.partition_point(|(other_us, _)| *other_us <= at_us);
        self.frames.insert(insert_index, (at_us, frame.clone()));
        if let Some(reader_waker) = self.reader_waker.take() {
            reader_waker.wake();
        }
    }

    fn pop_frame(&mut self, now_us: u64) -> Option<CanFrame> {
        self.frames.pop_front_if(|(at_us, _)| *at_us <= now_us).map(|(_, frame)| frame)
    }
}
