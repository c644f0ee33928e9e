//! MAVLink: the module as a component, usually 158, a peripheral, of the autopilot's system.
//!
//! The autopilot is the selected sender of attitude, or without attitude the first autopilot that sends a heartbeat.
//! Until one is known the module sends nothing, because its system is not known; with an attitude of its own it is a
//! component of system 1, and sends that attitude. Beside an autopilot it
//!
//! - sends a heartbeat with its state once a second;
//! - requests attitude, current, position and time from the autopilot;
//! - reads ArduPilot's trims, and turns its attitude back into the frame of its compasses;
//! - sends and changes its settings as parameters;
//! - accepts commands to its component from any sender. Commands to all components are left to the autopilot, whose own
//!   compass they are meant for;
//! - sends texts, progress and report of collections, and headings as named values;
//! - sends the heading as a pose if it is to replace the autopilot's own yaw.
//!
//! Current, position and date from other systems or components are ignored, as are the module's own messages that come
//! back.

mod attitude_trims;
mod autopilot_parameters;
mod collection;
mod commands;
mod compass_offsets;
mod component;
mod heading_reset;
mod own_parameters;
mod requests;
mod status_texts;
mod transmitter;

use mavlink_dialect::MavState;

use crate::port::autopilot::AutopilotSession;
use crate::port::message_schedule::MessageSchedule;
use crate::port::received_message::ReceivedMessage;
use crate::port::snapshot::Snapshot;
use crate::port::transmit_buffer::TransmitBuffer;
use crate::wire::mavlink::{Address, InboundMessage, MavlinkReceiver, OutboundMessage, Pose, ReceivedParameterRequest};
use autopilot_parameters::AutopilotParameters;
use autoswing::attitude::{AttitudeReport, HAS_OWN_ATTITUDE, SenderId, SenderSelector};
use autoswing::calibration::Calibration;
use autoswing::frames::wrap_pi;
use autoswing::heading::{Heading, NoHeading};
use autoswing::time::Timestamp;
use autoswing_module::compass::{AutopilotAction, Command, IndicatorState};
use autoswing_module::messages::{Message as Notice, Refusal};
use autoswing_module::settings::SigningKey;
use collection::CollectionReporter;
use commands::CommandHandler;
use component::{ComponentClaim, LISTENING_COMPONENT};
use heading_reset::HeadingReset;
use own_parameters::{OwnParameters, component_change};
use requests::RequestSequence;
use status_texts::PendingTexts;
pub(super) use transmitter::Transmitter;

/// Rate of poses, Hz. Autopilots take the errors of successive poses as independent, which those of a heading are not: at
/// 50 Hz EKF3's yaw error was up to 6.7 of its own sigmas, and no smaller (tests/promises/autopilot_filter.rs). PX4 detects a
/// loss below 5 Hz.
const POSE_HZ: u8 = 10;
const HEARTBEAT_HZ: u8 = 1;
/// Rate of named values, heading and sigma in turn, Hz.
const HEADING_OR_SIGMA_HZ: u8 = 10;
const PROGRESS_PERCENT_HZ: u8 = 1;
/// Rate of the attitude without an autopilot, Hz.
const ATTITUDE_HZ: u8 = 10;

/// System of a module without an autopilot.
const LONE_SYSTEM: Address = Address { system_id: 1, component_id: 0 };

/// MAVLink protocol of a port.
#[derive(Debug, Default)]
pub struct Mavlink {
    receiver: MavlinkReceiver,
    sender_selector: SenderSelector,
    /// Whether the module is a system of its own, without an autopilot.
    is_alone: bool,
    sequence_number: u8,
    component_claim: ComponentClaim,
    /// Command that changes the component, and the message about it.
    component_change: Option<Command>,
    component_notice: Option<Notice>,
    request_sequence: RequestSequence,
    autopilot_parameters: AutopilotParameters,
    own_parameters: OwnParameters,
    command_handler: CommandHandler,
    pending_texts: PendingTexts,
    collection_reporter: CollectionReporter,
    pose_schedule: MessageSchedule,
    heading_reset: HeadingReset,
    heartbeat_schedule: MessageSchedule,
    heading_schedule: MessageSchedule,
    attitude_schedule: MessageSchedule,
    /// Whether the next named value is the heading's sigma.
    is_sigma_next: bool,
    progress_percent_schedule: MessageSchedule,
}

impl Mavlink {
    /// Sets or removes the key of signatures.
    pub fn set_signing_key(&mut self, key: Option<SigningKey>) {
        self.receiver.signatures.set_key(key);
    }

    /// Whether a calibration differs from the last reported one.
    #[must_use]
    pub fn is_unreported_calibration(&self, calibration: &Calibration) -> bool {
        self.collection_reporter.is_unreported_calibration(calibration)
    }

    /// Acknowledges the command, and queues the reason of a refusal as a text. The output must be written before a
    /// restart.
    pub fn complete_command(&mut self, command: Command, result: Result<(), &Refusal>) {
        self.command_handler.complete_command(command, result);
        self.own_parameters.complete_command(command);
        self.queue_refusal(result.err().cloned());
    }

    /// Queues a message until an autopilot is known; of more than three pending messages the newest three are sent.
    pub fn queue_text(&mut self, message: &Notice) {
        if let Notice::Solved(outcome) = message {
            self.collection_reporter.record_outcome(outcome);
        }
        self.pending_texts.push_message(message, self.component_claim.component());
    }

    /// Takes a message about the autopilot, for all users.
    pub fn take_message(&mut self, now: Timestamp) -> Option<Notice> {
        self.component_notice.take().or_else(|| self.autopilot_parameters.take_message(now))
    }

    /// Takes a command that an action on the autopilot needs, or another module with the same component.
    pub fn take_command(&mut self) -> Option<Command> {
        self.component_change.take().or_else(|| self.autopilot_parameters.take_command())
    }

    /// Begins an action on the autopilot.
    pub fn begin_autopilot_action(&mut self, action: AutopilotAction) {
        self.autopilot_parameters.begin_action(action);
    }

    /// Actions on the line's autopilot, by whichever protocol.
    pub(super) const fn autopilot_session(&mut self) -> &mut AutopilotSession {
        &mut self.autopilot_parameters.session
    }

    /// Sets whether another line of the module has an autopilot by MAVLink.
    pub const fn set_has_other_line(&mut self, has_other_line: bool) {
        self.component_claim.has_other_line = has_other_line;
    }

    /// System of which the module is a component: the autopilot's, or its own.
    fn system(&self, autopilot: Option<SenderId>) -> Option<SenderId> {
        autopilot.or(self.is_alone.then_some(LONE_SYSTEM.sender_id()))
    }

    fn process_message(&mut self, at: Timestamp, message: InboundMessage) -> Option<ReceivedMessage> {
        let autopilot = self.sender_selector.autopilot_to_query(at);
        let is_autopilot = |source: &SenderId| Some(*source) == autopilot;
        let system = self.system(autopilot);
        let own_component = self.component_claim.component();
        let is_own_system = |source: SenderId| {
            let system_id = |sender| Address::from_sender(sender).system_id;
            system.is_some_and(|system| system_id(system) == system_id(source))
        };
        let is_component = |target: Address, component_id| {
            let own_address = |system| Address { component_id, ..Address::from_sender(system) };
            system.is_some_and(|system| is_addressed_to(target, own_address(system)))
        };
        let is_own = |target: Address| is_component(target, own_component);
        match message {
            InboundMessage::Heartbeat(heartbeat, firmware) => {
                self.sender_selector.update_heartbeat(at, heartbeat);
                let Address { component_id, .. } = Address::from_sender(heartbeat.sender);
                if is_own_system(heartbeat.sender) {
                    self.component_claim.on_heartbeat(component_id);
                }
                if self.sender_selector.autopilot_to_query(at) == Some(heartbeat.sender) {
                    self.autopilot_parameters.on_heartbeat(heartbeat.sender, firmware);
                }
                None
            }
            InboundMessage::Attitude(report) if self.sender_selector.accept_attitude(at, report.sender) => {
                self.request_sequence.on_attitude(at, report.sender_clock_at_sending);
                let attitude = self.autopilot_parameters.untrimmed_attitude(report.sender, report.attitude);
                Some(ReceivedMessage::Attitude(AttitudeReport { attitude, ..report }))
            }
            InboundMessage::Attitude(_) => Some(ReceivedMessage::RejectedAttitude),
            InboundMessage::Position(source, place) => {
                place.filter(|_| is_autopilot(&source)).map(ReceivedMessage::Position)
            }
            InboundMessage::Date(source, day) => day.filter(|_| is_autopilot(&source)).map(ReceivedMessage::Date),
            InboundMessage::Current(source, current) => {
                current.filter(|_| is_autopilot(&source)).map(ReceivedMessage::Current)
            }
            InboundMessage::Command(command)
                if command.target.component_id == own_component && is_own(command.target) =>
            {
                match self.command_handler.process_command(at, &command) {
                    Ok(command) => Some(ReceivedMessage::Command(command)),
                    Err(reason) => {
                        self.queue_refusal(reason);
                        None
                    }
                }
            }
            InboundMessage::Acknowledgement(ack) => {
                let is_to_module = is_own(ack.target) || is_component(ack.target, LISTENING_COMPONENT);
                if is_autopilot(&ack.sender_id) && is_to_module {
                    self.request_sequence.on_acknowledgement(at, ack);
                    self.heading_reset.on_acknowledgement(ack);
                }
                None
            }
            InboundMessage::ParameterRequest(target, request)
                if is_own(target)
                    && (target.component_id == own_component || request == ReceivedParameterRequest::List) =>
            {
                self.own_parameters.process_request(&request).map(ReceivedMessage::Command)
            }
            InboundMessage::Command(_) | InboundMessage::ParameterRequest(..) => None,
            InboundMessage::NamedValue(source, sender_clock) => {
                if is_own_system(source) {
                    self.component_claim.on_named_value(Address::from_sender(source).component_id, sender_clock);
                }
                None
            }
            InboundMessage::Parameter(source, parameter) => {
                if is_autopilot(&source) {
                    self.autopilot_parameters.on_parameter(&parameter);
                }
                None
            }
        }
    }

    /// Queues the reason of a refused command as a text.
    fn queue_refusal(&mut self, reason: Option<Refusal>) {
        if let Some(refusal) = reason {
            let component = self.component_claim.component();
            self.pending_texts.push_message(&Notice::CommandRejected(refusal), component);
        }
    }

    fn send_heading(&mut self, snapshot: &Snapshot<'_>, line: &mut Transmitter<'_>) -> bool {
        let (Ok(heading), _) = snapshot.selected_heading() else { return false };
        if !snapshot.settings.stream_on || !self.heading_schedule.is_due(snapshot.now, HEADING_OR_SIGMA_HZ) {
            return false;
        }
        let (name, value) =
            if self.is_sigma_next { ("hdg_sigma", heading.sigma_deg()) } else { ("hdg_mag", heading.magnetic_deg()) };
        self.is_sigma_next = !self.is_sigma_next;
        self.send_named_value(snapshot.now, name, value, line)
    }

    /// Sends the due pose, or a reset of the yaw to it.
    fn send_pose(&mut self, snapshot: &Snapshot<'_>, is_armed: bool, line: &mut Transmitter<'_>) -> bool {
        if !line.has_room_for_bulk() {
            return false;
        }
        let pose = current_pose(snapshot, self.collection_reporter.calibration_count());
        if let Some(autopilot) = self.autopilot_parameters.autopilot()
            && self.heading_reset.send_due_command(snapshot.now, autopilot, is_armed, pose.as_ref(), line)
        {
            return true;
        }
        let Some(pose) = pose else { return false };
        self.pose_schedule.is_due(snapshot.now, POSE_HZ) && line.send_message(OutboundMessage::pose_estimate(&pose))
    }

    fn send_heartbeat(&mut self, snapshot: &Snapshot<'_>, line: &mut Transmitter<'_>) -> bool {
        self.heartbeat_schedule.is_due(snapshot.now, HEARTBEAT_HZ)
            && line.send_message(OutboundMessage::heartbeat(mav_state(snapshot.indicator_state)))
    }

    /// Sends roll, pitch, heading and body rates, the heading true if the declination is known.
    fn send_attitude(&mut self, snapshot: &Snapshot<'_>, line: &mut Transmitter<'_>) -> bool {
        let Some(attitude) = snapshot.estimate.attitude else { return false };
        if !snapshot.settings.stream_on || !self.attitude_schedule.is_due(snapshot.now, ATTITUDE_HZ) {
            return false;
        }
        let declination_deg = snapshot.settings.declination_deg.unwrap_or(0.0);
        let yaw_rad = snapshot.selected_heading().0.map(|heading| yaw_rad(heading, declination_deg));
        line.send_message(OutboundMessage::attitude(
            snapshot.estimate.timestamp,
            [attitude.roll_rad, attitude.pitch_rad, yaw_rad.unwrap_or(f32::NAN)],
            snapshot.estimate.euler_rates.map_or([f32::NAN; 3], |rates| rates.to_body_rates(attitude)),
        ))
    }

    fn send_progress_percent(&mut self, snapshot: &Snapshot<'_>, line: &mut Transmitter<'_>) -> bool {
        let percent = f32::from(progress_percent(snapshot.indicator_state));
        self.progress_percent_schedule.is_due(snapshot.now, PROGRESS_PERCENT_HZ)
            && self.send_named_value(snapshot.now, "cal_pct", percent, line)
    }

    fn send_named_value(&mut self, now: Timestamp, name: &str, value: f32, line: &mut Transmitter<'_>) -> bool {
        let is_sent = line.send_message(OutboundMessage::named_value(now, name, value));
        if is_sent {
            self.component_claim.on_named_value_sent(now);
        }
        is_sent
    }

    /// Processes a received byte; returns the message that it completes.
    pub fn process_byte(&mut self, at: Timestamp, byte: u8) -> Option<ReceivedMessage> {
        let message = self.receiver.push_byte(byte)?;
        Some(self.process_message(at, message).unwrap_or(ReceivedMessage::Other))
    }

    /// Whether the autopilot is armed, if it has reported that recently.
    #[must_use]
    pub fn is_armed(&self, now: Timestamp) -> Option<bool> {
        self.sender_selector.is_armed(now)
    }

    /// Number of broken or impossible frames since the start; wraps.
    #[must_use]
    pub fn rejected_frame_count(&self) -> u32 {
        self.receiver.rejected_count()
    }

    /// Appends the due message; called for every estimate, at least ten times a second. One message at most, so that the
    /// other port's sentences of the same reading are not delayed. All messages together are fewer than the slowest
    /// sensor's readings.
    pub fn poll(&mut self, snapshot: &Snapshot<'_>, out: &mut TransmitBuffer) {
        let now = snapshot.now;
        self.sender_selector.record_field_contradiction(now, is_attitude_contradicted(snapshot.estimate.heading));
        self.collection_reporter.track_state(snapshot, &mut self.pending_texts);
        let autopilot = self.sender_selector.autopilot_to_query(now);
        self.is_alone = HAS_OWN_ATTITUDE && autopilot.is_none() && snapshot.estimate.tilt_sigmas_rad.is_some();
        let Some(system) = self.system(autopilot) else { return };
        let is_armed = self.sender_selector.is_armed(now);
        let is_settled = is_armed == Some(true) || self.is_alone;
        if let Some(component) = self.component_claim.update(now, snapshot.settings.component, is_settled) {
            self.component_change = component_change(component);
            self.component_notice = Some(Notice::ComponentTaken { taken: snapshot.settings.component, component });
        }
        let is_claimed = self.component_claim.is_claimed();
        let (mut sequence, mut signatures) = (self.sequence_number, core::mem::take(&mut self.receiver.signatures));
        let line = &mut Transmitter::new(
            out,
            (system, self.component_claim.sender_component()),
            &mut sequence,
            &mut signatures,
        );
        let is_sent = is_claimed && self.command_handler.send_next_acknowledgement(line)
            || !self.is_alone && self.send_pose(snapshot, is_armed == Some(true), line)
            || is_claimed && self.send_heartbeat(snapshot, line)
            || self.is_alone && self.send_attitude(snapshot, line)
            || autopilot.is_some_and(|autopilot| {
                self.autopilot_parameters.send_due_request(snapshot, is_armed == Some(false), line)
                    || self.request_sequence.send_due_request(now, autopilot, snapshot.settings.attitude_rate_hz, line)
            })
            || is_claimed
                && (self.own_parameters.send_next_parameter(snapshot.settings, line)
                    || self.collection_reporter.send_report_or_progress(snapshot, line)
                    || self.send_progress_percent(snapshot, line)
                    || self.pending_texts.send_next_chunk(now, line)
                    || self.send_heading(snapshot, line));
        if is_sent {
            self.component_claim.on_message_sent(now);
        }
        (self.sequence_number, self.receiver.signatures) = (sequence, signatures);
    }
}

/// Whether `target` includes `module_address`; an id of 0 addresses all systems or components.
fn is_addressed_to(target: Address, module_address: Address) -> bool {
    [0, module_address.system_id].contains(&target.system_id)
        && [0, module_address.component_id].contains(&target.component_id)
}

/// Whether attitude and field contradict each other; the attitude may be that of another vehicle.
const fn is_attitude_contradicted(heading: Result<Heading, NoHeading>) -> bool {
    matches!(heading, Err(NoHeading::AttitudeContradicted | NoHeading::FieldDisturbed | NoHeading::FieldChanged))
}

/// State of the module in MAVLink's terms.
const fn mav_state(indicator_state: IndicatorState) -> MavState {
    match indicator_state {
        IndicatorState::Idle => MavState::MAV_STATE_UNINIT,
        IndicatorState::Collecting(_) => MavState::MAV_STATE_CALIBRATING,
        IndicatorState::Calibrated => MavState::MAV_STATE_ACTIVE,
        IndicatorState::Refused => MavState::MAV_STATE_CRITICAL,
    }
}

/// Progress of the calibration, percent.
const fn progress_percent(indicator_state: IndicatorState) -> u8 {
    match indicator_state {
        IndicatorState::Idle | IndicatorState::Refused => 0,
        IndicatorState::Collecting(percent) => percent,
        IndicatorState::Calibrated => 100,
    }
}

/// Pose, if enabled, the declination known and the heading valid, with roll and pitch of the same instant. The heading is
/// the raw one: the autopilot smooths it by its own gyro, and EKF3's error after a change of iron is the same by either.
fn current_pose(snapshot: &Snapshot<'_>, reset_counter: u8) -> Option<Pose> {
    let Snapshot { estimate, settings, .. } = *snapshot;
    if !settings.sends_vision_yaw {
        return None;
    }
    let heading = estimate.heading.ok()?;
    let (declination_deg, attitude) = (settings.declination_deg?, estimate.attitude?);
    Some(Pose {
        timestamp: estimate.timestamp,
        roll_pitch_yaw_rad: [attitude.roll_rad, attitude.pitch_rad, yaw_rad(heading, declination_deg)],
        yaw_variance_rad2: heading.sigma_rad * heading.sigma_rad,
        reset_counter,
    })
}

/// True heading, radians, -pi..pi.
fn yaw_rad(heading: Heading, declination_deg: f32) -> f32 {
    wrap_pi(heading.magnetic_rad + declination_deg.to_radians())
}

#[cfg(test)]
mod tests;
