//! Functions shared by the tasks of all lines: snapshots of the module, and routing of received messages.

use super::task_links::{AttitudeInput, AutopilotLine, Timestamped, increment_counter, publish_value};
use crate::app::task_links::TaskLinks;
use crate::port::{Mavlink, ReceivedMessage, Snapshot};
use crate::wire::dronecan::NodeId;
use autoswing::calibration::Calibration;
use autoswing::instrument::Correction;
use autoswing::time::Timestamp;
use autoswing_module::compass::IndicatorState;
use autoswing_module::settings::{ProtocolKind, Settings};

/// Active calibration, if it is to be reported. It is large and rarely changes.
pub(super) fn calibration_to_report(links: &TaskLinks, is_new: impl Fn(&Calibration) -> bool) -> Option<Correction> {
    links
        .correction
        .try_get_and(|correction| correction.calibration.as_ref().is_some_and(|(calibration, _)| is_new(calibration)))
}

/// Calls a function with a snapshot of the module's state; not before the first estimate.
pub(super) fn with_snapshot<R>(
    links: &TaskLinks,
    now: Timestamp,
    settings: &Settings,
    correction: Option<&Correction>,
    use_snapshot: impl FnOnce(&Snapshot<'_>) -> R,
) -> Option<R> {
    let estimate = links.estimates.try_get()?;
    let calibration = correction.and_then(|correction| correction.calibration.as_ref());
    let can_node = links.can_state().and_then(|state| state.node).map(NodeId::number);
    let indicator_state = links.indicator_state.try_get().unwrap_or(IndicatorState::Idle);
    Some(use_snapshot(&Snapshot { now, estimate: &estimate, settings, indicator_state, calibration, can_node }))
}

/// Publishes a line's protocol and armed state, and passes to its MAVLink whether another line has an autopilot.
pub(super) fn update_line_state(
    links: &TaskLinks,
    line: AutopilotLine,
    protocol: ProtocolKind,
    is_armed: Option<bool>,
    mavlink: &mut Mavlink,
) {
    links.update_line_state(line, protocol, is_armed);
    mavlink.set_has_other_line(links.lines_with_autopilot(ProtocolKind::Mavlink).any(|other| other != line));
}

/// Passes a received message to the task that needs it. `can_have_gyro`: whether this line's body rates are measured by
/// a gyro.
pub(super) fn route_message(
    links: &TaskLinks,
    line: AutopilotLine,
    at: Timestamp,
    message: ReceivedMessage,
    can_have_gyro: bool,
) {
    match message {
        ReceivedMessage::Attitude(report)
            if links.accept_attitude(line, at, report.body_rates.is_some() && can_have_gyro) =>
        {
            increment_counter(&links.event_counters.attitude_reports);
            let value = AttitudeInput::Report(report);
            links.queue_or_count(&links.attitude_inputs, Timestamped { timestamp: at, value });
        }
        ReceivedMessage::Attitude(_) | ReceivedMessage::RejectedAttitude => {
            increment_counter(&links.event_counters.attitude_of_other_senders);
        }
        ReceivedMessage::Command(command) => links.send_command(line, Some(command)),
        ReceivedMessage::Position(place) => links.update_position(at, place),
        ReceivedMessage::Date(day) => publish_value(&links.date, day),
        ReceivedMessage::Current(value) => links.motor_current.sender().send(Timestamped { timestamp: at, value }),
        ReceivedMessage::GroundSpeed(value) => links.ground_speed.sender().send(Timestamped { timestamp: at, value }),
        ReceivedMessage::Other => {}
    }
}
