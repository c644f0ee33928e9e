//! Safe mode: console, ports and watchdog without any other task.

use std::cell::RefCell;
use std::collections::VecDeque;
use std::rc::Rc;

use embassy_futures::{block_on, poll_once};
use embassy_time::Timer;
use testkit::flash::SilentFault;

use super::devices::{DeviceBehaviour, FakeTransmitter, FakeWatchdog};
use super::{Flash, PAGE_COUNT, TaskBench, test_store};
use crate::app::can::{self, ReceiveFrame, SendFrame, UpdateHandOver};
use crate::app::task_links::CommandSource;
use crate::app::watchdog::MAX_FEED_INTERVAL_US;
use crate::app::{TaskLinks, safe_mode};
use crate::port::UpdateForBootLoader;
use crate::wire::dronecan::outbound::{NodeInfo, SoftwareVersion};
use crate::wire::dronecan::{CanFrame, DataType, FrameHeader, NodeId, OutboundTransfer, Payload, TransferKind};
use autoswing_module::compass::{Command, ModuleState, Reply};
use autoswing_module::messages::{Message, Refusal};
use autoswing_module::settings::{ProtocolKind, Settings};
use autoswing_module::store::{StoreChange, StoreError};

fn bench_in_safe_mode(flash: Flash) -> (TaskBench, [FakeTransmitter; 2], FakeWatchdog) {
    let mut bench = TaskBench::new();
    let (ports, watchdog) = (<[FakeTransmitter; 2]>::default(), FakeWatchdog::default());
    let (lines, fed) = (ports.clone(), watchdog.clone());
    bench.spawn_task("safe mode", |links| async move {
        Box::pin(safe_mode::run_safe_mode(&links, test_store(flash), lines, fed)).await;
    });
    bench.run_for_ms(1);
    (bench, ports, watchdog)
}

/// The ports send NMEA sentences, MAVLink heartbeats and a text without receiving anything.
#[test]
fn both_ports_report_safe_mode_in_both_protocols() {
    let (mut bench, ports, _) = bench_in_safe_mode(Flash::new(PAGE_COUNT));
    assert_eq!(bench.links.console_messages.try_receive(), Ok(Message::SafeMode));
    bench.run_for_ms(1_000);
    for port in &ports {
        let bytes = port.written.take();
        let text = String::from_utf8_lossy(&bytes).into_owned();
        assert_eq!(text.matches("$PASWH,,,safe-mode,*").count(), 2, "{text}");
        assert_eq!(text.matches("$HCHDM,,M*07\r\n").count(), 2, "{text}");
        assert_eq!(text.matches("autoswing: safe-mode: ").count(), 1, "{text}");
        // HEARTBEAT of 9 bytes from component 158 of system 1: MAV_AUTOPILOT_INVALID, MAV_STATE_CRITICAL.
        let beat = |frame: &&[u8]| frame[1] == 9 && frame[5..10] == [1, 158, 0, 0, 0] && frame[15..18] == [8, 0, 5];
        let frames = bytes.windows(20).filter(|window| window[0] == 0xFD);
        assert_eq!(frames.filter(beat).count(), 2, "{bytes:?}");
    }
}

/// One poll of the task executes the command, because this flash does not wait.
#[test]
fn safe_mode_erases_the_store() {
    let mut flash = Flash::new(PAGE_COUNT);
    let settings = Settings { stream_rate_hz: 20, ..Settings::DEFAULT };
    block_on(test_store(&mut flash).save_change(StoreChange::Settings(&settings))).unwrap();
    assert_eq!(block_on(test_store(&mut flash).load_state()).stored_values.settings, settings);
    let links = TaskLinks::new();
    links.commands.try_send((CommandSource::Console, Command::CalClear)).unwrap();
    let ports = <[FakeTransmitter; 2]>::default();
    let task = safe_mode::run_safe_mode(&links, test_store(&mut flash), ports, FakeWatchdog::default());
    assert!(poll_once(Box::pin(task)).is_pending());
    assert!(matches!(links.replies.try_receive(), Ok(Ok(Reply::Done(ModuleState::Uncalibrated)))));
    assert_eq!(block_on(test_store(&mut flash).load_state()).stored_values.settings, Settings::DEFAULT);
}

#[test]
fn safe_mode_restarts_and_refuses_other_commands() {
    let (mut bench, ..) = bench_in_safe_mode(Flash::new(PAGE_COUNT));
    assert!(matches!(bench.execute_command(Command::Status), Ok(Reply::SafeMode)));
    assert!(matches!(bench.execute_command(Command::CalSolve(None)), Err(Refusal::SafeMode)));
    assert!(bench.execute_command(Command::Restart).is_ok() && bench.links.restart_request.signaled());
}

/// Ports that accept nothing, and a flash that never completes an erase.
#[test]
fn broken_devices_do_not_starve_the_watchdog() {
    let mut flash = Flash::new(PAGE_COUNT);
    flash.silent_fault = Some(SilentFault::WritesHang);
    let (mut bench, ports, watchdog) = bench_in_safe_mode(flash);
    for port in &ports {
        port.behaviour.set(DeviceBehaviour::Hangs);
    }
    for _ in 0..20 {
        bench.send_command(CommandSource::Console, Command::CalClear);
        bench.run_for_ms(936);
        assert!(matches!(bench.links.replies.try_receive(), Ok(Err(Refusal::Store(StoreError::Timeout)))));
    }
    let (longest_us, last_us) = (watchdog.longest_interval_us.get(), watchdog.last_feed_us.get());
    assert!(longest_us <= MAX_FEED_INTERVAL_US && last_us > 18_000_000, "{longest_us} {last_us}");
}

/// CAN bus with one other node, the test, and the boot loader.
#[derive(Clone, Default)]
pub(super) struct FakeCanBus {
    frames_to_module: Rc<RefCell<VecDeque<CanFrame>>>,
    frames_from_module: Rc<RefCell<Vec<CanFrame>>>,
    handed_over_update: Rc<RefCell<Option<UpdateForBootLoader>>>,
    /// States of the termination, in order.
    pub termination_states: Rc<RefCell<Vec<bool>>>,
}

impl ReceiveFrame for FakeCanBus {
    async fn receive_frame(&mut self) -> CanFrame {
        loop {
            let next = self.frames_to_module.borrow_mut().pop_front();
            match next {
                Some(frame) => return frame,
                None => Timer::after_micros(100).await,
            }
        }
    }

    fn take_error_count(&mut self) -> u32 {
        0
    }
}

impl SendFrame for FakeCanBus {
    async fn send_frame(&mut self, frame: &CanFrame) {
        self.frames_from_module.borrow_mut().push(frame.clone());
    }

    fn set_termination(&mut self, is_on: bool) {
        self.termination_states.borrow_mut().push(is_on);
    }
}

impl UpdateHandOver for FakeCanBus {
    fn hand_over_update(&mut self, update: &UpdateForBootLoader) {
        *self.handed_over_update.borrow_mut() = Some(update.clone());
    }
}

const UNIQUE_ID: [u8; 16] = [7; 16];
pub(super) const OWN_NODE: u8 = 42;

impl FakeCanBus {
    /// A module in safe mode with a number of the bus.
    fn with_allocated_node() -> (TaskBench, Self) {
        let (mut bench, ..) = bench_in_safe_mode(Flash::new(PAGE_COUNT));
        let bus = Self::default();
        bus.run_node(&mut bench, bus.clone(), true);
        bus.queue_message(DataType::ARMING_STATUS, &[0]);
        bench.run_for_ms(1_100);
        let is_anonymous = |frame: &CanFrame| FrameHeader::from_id(frame.frame_id()).unwrap().source_node.is_none();
        assert!(bus.frames_from_module.take().iter().any(is_anonymous), "no request for a number");
        bus.queue_message(DataType::ALLOCATION, &[&[OWN_NODE << 1], &UNIQUE_ID[..]].concat());
        bench.run_for_ms(1_100);
        (bench, bus)
    }

    /// Runs the task of the bus.
    pub(super) fn run_node(
        &self,
        bench: &mut TaskBench,
        boot_loader: impl UpdateHandOver + 'static,
        is_safe_mode: bool,
    ) {
        let module = self.clone();
        let info = NodeInfo {
            node_name: "org.autoswing.test",
            software_version: SoftwareVersion::from_firmware(None),
            hardware_version: [1, 0],
            unique_id: UNIQUE_ID,
        };
        bench.spawn_task("can", move |links| async move {
            can::run_can(&links, info, module.clone(), module, boot_loader, is_safe_mode).await;
        });
    }

    /// Puts a message, or a request to the module, on the bus.
    pub(super) fn queue_message(&self, data_type: DataType, payload: &[u8]) {
        let kind = if data_type.is_service {
            TransferKind::Request(NodeId::new(OWN_NODE).unwrap())
        } else {
            TransferKind::Message
        };
        let payload = Payload::from_slice(payload).unwrap();
        let transfer_id = self.frames_to_module.borrow().len() as u8;
        let transfer = OutboundTransfer { data_type, priority: 16, transfer_kind: kind, transfer_id, payload };
        self.frames_to_module.borrow_mut().extend(transfer.frames(NodeId::new(10)));
    }

    /// Data of the sent frames of a type since the last call.
    pub(super) fn take_sent_data(&self, data_type: DataType) -> Vec<Vec<u8>> {
        let is_of = |frame: &CanFrame| data_type.matches_header(FrameHeader::from_id(frame.frame_id()).unwrap());
        self.frames_from_module.take().iter().filter(|frame| is_of(frame)).map(|frame| frame.data().to_vec()).collect()
    }
}

pub(super) const RESTART_PAYLOAD: [u8; 5] = [0x1E, 0x1B, 0x55, 0xCE, 0xAC];

/// Health ERROR, mode OPERATIONAL; reason 12, no field: docs/dronecan.md.
#[test]
fn the_node_of_a_can_bus_reports_safe_mode_and_restarts() {
    let (mut bench, bus) = FakeCanBus::with_allocated_node();
    let all = bus.take_sent_data(DataType::NODE_STATUS);
    assert!(!all.is_empty() && all.iter().all(|status| status[4..7] == [0x80, 0x4C, 0]), "{all:?}");
    assert_eq!(bench.links.lines_with_autopilot(ProtocolKind::Mavlink).count(), 0, "without an autopilot's MAVLink");
    bus.queue_message(DataType::GET_NODE_INFO, &[]);
    bench.run_for_ms(10);
    assert!(!bus.take_sent_data(DataType::GET_NODE_INFO).is_empty());
    for (is_armed, is_accepted) in [(255, 0), (0, 0x80)] {
        bus.queue_message(DataType::ARMING_STATUS, &[is_armed]);
        bus.queue_message(DataType::RESTART_NODE, &RESTART_PAYLOAD);
        bench.run_for_ms(10);
        assert_eq!(bus.take_sent_data(DataType::RESTART_NODE)[0][0], is_accepted);
        assert_eq!(bench.links.restart_request.signaled(), is_accepted != 0);
    }
}

#[test]
fn the_firmware_can_be_replaced_over_can() {
    let (mut bench, bus) = FakeCanBus::with_allocated_node();
    bus.take_sent_data(DataType::NODE_STATUS);
    bus.queue_message(DataType::BEGIN_FIRMWARE_UPDATE, &[&[0], &b"a.bin"[..]].concat());
    bench.run_for_ms(10);
    assert_eq!(bus.take_sent_data(DataType::BEGIN_FIRMWARE_UPDATE)[0][0], 0);
    assert!(bench.links.restart_request.signaled());
    let update = bus.handed_over_update.take().expect("a hand-over");
    assert_eq!(
        (update.server_node.number(), update.own_node.number(), update.file_path()),
        (10, OWN_NODE, &b"a.bin"[..])
    );
}
