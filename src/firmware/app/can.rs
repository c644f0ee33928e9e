//! Task of a CAN bus: passes frames to the node and sends its frames, with every estimate and whenever the bus is free.
//!
//! A board implements [`ReceiveFrame`] and [`SendFrame`] for its controller, [`UpdateHandOver`] for its boot loader, and
//! runs this task beside those of the ports.

use core::future::pending;

use embassy_futures::select::{Either4, select4};
use embassy_time::{Duration, Instant, Timer};

use super::line::{calibration_to_report, route_message, update_line_state, with_snapshot};
use super::task_links::{AutopilotLine, increment_counter, now, subscribe};
use crate::app::task_links::TaskLinks;
use crate::port::{CanNode, NodeContext, Snapshot, UpdateForBootLoader};
use crate::wire::dronecan::CanFrame;
use crate::wire::dronecan::outbound::NodeInfo;
use autoswing::heading::NoHeading;
use autoswing::instrument::Estimate;
use autoswing::time::Timestamp;
use autoswing_module::compass::IndicatorState;
use autoswing_module::settings::{ProtocolKind, Settings};

/// Period of polls in safe mode, where there are no estimates: shorter than half a second, the time limit of an
/// allocation's next step.
const SAFE_MODE_POLL_PERIOD: Duration = Duration::from_millis(50);

/// Receiver of a CAN controller.
pub trait ReceiveFrame {
    /// Waits for a data frame with an extended identifier; drops others. A cancelled call loses no frame.
    fn receive_frame(&mut self) -> impl Future<Output = CanFrame>;

    /// Returns the number of errors that the controller has detected on the bus since the last call.
    fn take_error_count(&mut self) -> u32;
}

/// Sender of a CAN controller. It leaves the state bus-off within a second on its own, and does not disturb a bus with
/// another bit rate: it listens only until a frame is received.
pub trait SendFrame {
    /// Waits until the controller has accepted the frame. A cancelled call has not sent it.
    fn send_frame(&mut self, frame: &CanFrame) -> impl Future<Output = ()>;

    /// Switches the terminating resistor, which is off at the start, on a board that can.
    fn set_termination(&mut self, _is_on: bool) {}
}

/// Hand-over to the boot loader of a board.
pub trait UpdateHandOver {
    /// Whether the board has a boot loader that loads firmware over the bus; otherwise updates are refused.
    const ACCEPTS_UPDATES: bool = true;

    /// Stores the update where the boot loader finds it after the restart, which follows within 50 ms.
    fn hand_over_update(&mut self, update: &UpdateForBootLoader);
}

/// Board without a boot loader that loads firmware over the bus.
pub struct NoBootLoader;

impl UpdateHandOver for NoBootLoader {
    const ACCEPTS_UPDATES: bool = false;

    fn hand_over_update(&mut self, _update: &UpdateForBootLoader) {}
}

/// Runs the node for ever. It is silent until the settings are loaded; a changed node number applies after a restart.
/// In safe mode it runs without settings and estimates.
pub async fn run_can<B: UpdateHandOver>(
    links: &TaskLinks,
    info: NodeInfo,
    mut rx: impl ReceiveFrame,
    mut tx: impl SendFrame,
    mut boot_loader: B,
    is_safe_mode: bool,
) -> ! {
    let mut estimates = subscribe(&links.estimates);
    let mut changes = subscribe(&links.settings);
    let wires = links.links_of_line(AutopilotLine::Can);
    let mut settings = Settings::DEFAULT;
    let mut node = if is_safe_mode {
        CanNode::in_safe_mode(info)
    } else {
        settings = changes.changed().await;
        CanNode::new(info, settings.can_node)
    };
    if !B::ACCEPTS_UPDATES {
        node.refuse_updates();
    }
    tx.set_termination(settings.can_is_terminated);
    node.mavlink().set_signing_key(settings.signing_key);
    let poll_function = if is_safe_mode { poll_in_safe_mode } else { poll_can_node };
    let mut poll_at = Instant::now();
    loop {
        let send_frames = async {
            match node.frame_to_send() {
                None => pending().await,
                Some(frame) => tx.send_frame(frame).await,
            }
        };
        // The estimate is read again later: as this future's result it would occupy memory across every wait.
        let estimated = async {
            if is_safe_mode {
                Timer::at(poll_at).await;
            } else {
                estimates.changed().await;
            }
        };
        // Estimates come first: frames of a full bus must not delay them.
        let event = select4(estimated, send_frames, wires.command_results.wait(), rx.receive_frame()).await;
        // The answer to a changed setting has its new value.
        if let Some(changed) = changes.try_changed() {
            settings = changed;
            tx.set_termination(settings.can_is_terminated);
            node.mavlink().set_signing_key(settings.signing_key);
        }
        match event {
            Either4::First(()) => {
                increment_counter(&wires.heartbeat);
                node.add_bus_errors(rx.take_error_count());
                poll_at = Instant::now() + SAFE_MODE_POLL_PERIOD;
                if let Ok(message) = wires.messages.try_receive() {
                    node.queue_text(&message);
                }
                poll_function(links, &mut node, &settings);
            }
            Either4::Second(()) => node.on_frame_sent(now()),
            Either4::Third((command, result)) => {
                node.complete_command(command, result.as_ref().copied());
                if let Some(update) = node.granted_update() {
                    boot_loader.hand_over_update(update);
                }
                poll_function(links, &mut node, &settings);
            }
            Either4::Fourth(frame) => {
                let at = now();
                node.receive_frame(at, &frame, &mut |message| {
                    route_message(links, AutopilotLine::Can, at, message, true);
                });
                if node.has_requests() {
                    poll_function(links, &mut node, &settings);
                }
            }
        }
    }
}

/// Polls the node. A separate function, because the data is large and must not be kept across a wait.
#[inline(never)]
fn poll_can_node(links: &TaskLinks, node: &mut CanNode, settings: &Settings) {
    let now = now();
    update_can_state(links, node, now);
    links.set_can_state(node.can_state(now));
    if let Some(action) = links.take_autopilot_action(AutopilotLine::Can) {
        node.mavlink().begin_autopilot_action(action);
    }
    if let Some(message) = node.take_message(now) {
        links.broadcast_message(&message);
    }
    let Some(stored_settings) = links.stored_settings.try_get() else { return };
    let mavlink = node.mavlink();
    let correction = calibration_to_report(links, |calibration| mavlink.is_unreported_calibration(calibration));
    let command = with_snapshot(links, now, settings, correction.as_ref(), |snapshot| {
        node.poll(&NodeContext { snapshot: *snapshot, stored_settings: &stored_settings })
    });
    links.send_command(AutopilotLine::Can, command.flatten());
}

/// Polls the node in safe mode: without a heading, and without anything of the module.
#[inline(never)]
fn poll_in_safe_mode(links: &TaskLinks, node: &mut CanNode, settings: &Settings) {
    let now = now();
    let estimate = Estimate { timestamp: now, heading: Err(NoHeading::SafeMode), ..Estimate::EMPTY };
    let snapshot = Snapshot {
        now,
        estimate: &estimate,
        settings,
        indicator_state: IndicatorState::Idle,
        calibration: None,
        can_node: None,
    };
    update_can_state(links, node, now);
    let command = node.poll(&NodeContext { snapshot, stored_settings: settings });
    links.send_command(AutopilotLine::Can, command);
}

/// Publishes the state of the bus. Without an autopilot in its tunnel it is no line of MAVLink.
fn update_can_state(links: &TaskLinks, node: &mut CanNode, now: Timestamp) {
    let is_armed = node.is_armed(now);
    let mavlink = node.mavlink();
    let protocol = if mavlink.is_armed(now).is_some() { ProtocolKind::Mavlink } else { ProtocolKind::Auto };
    update_line_state(links, AutopilotLine::Can, protocol, is_armed, mavlink);
}
