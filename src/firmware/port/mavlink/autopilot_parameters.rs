//! The autopilot's parameters: one client, and its users in turn. A check or a setup comes before the trims, and these
//! before the offsets.

use mavlink_dialect::{MavAutopilot, MavParamType};

use super::attitude_trims::AttitudeTrims;
use super::compass_offsets::CompassOffsets;
use super::transmitter::Transmitter;
use crate::port::autopilot::{AutopilotKind, AutopilotSession, AutopilotState, ParameterRequest};
use crate::port::snapshot::Snapshot;
use crate::wire::mavlink::{Address, OutboundMessage, ParameterEncoding, ReceivedParameter};
use autoswing::attitude::SenderId;
use autoswing::frames::RollPitch;
use autoswing::time::Timestamp;
use autoswing_module::compass::{AutopilotAction, Command};
use autoswing_module::messages::Message;

/// Time after which trims and offsets are read again, microseconds: a change without a message, or whose message was
/// lost.
const MONITOR_PERIOD_US: u64 = 30_000_000;

/// Parameters of the selected autopilot.
#[derive(Debug, Default)]
pub(super) struct AutopilotParameters {
    /// Autopilot to which the rest belongs, and its firmware.
    autopilot: Option<(SenderId, MavAutopilot)>,
    pub session: AutopilotSession,
    /// Kind of number of the last parameter that was read.
    parameter_kind: MavParamType,
    trims: AttitudeTrims,
    offsets: CompassOffsets,
}

impl AutopilotParameters {
    /// Processes the heartbeat of the selected autopilot.
    pub fn on_heartbeat(&mut self, autopilot: SenderId, firmware: MavAutopilot) {
        if self.autopilot != Some((autopilot, firmware)) {
            *self = Self { autopilot: Some((autopilot, firmware)), ..Self::default() };
        }
    }

    /// Address and firmware of the selected autopilot.
    pub fn autopilot(&self) -> Option<(Address, MavAutopilot)> {
        self.autopilot.map(|(sender, firmware)| (Address::from_sender(sender), firmware))
    }

    /// Processes a parameter of the selected autopilot.
    pub fn on_parameter(&mut self, received: &ReceivedParameter) {
        let number = received.number(self.encoding());
        if let Some(number) = number {
            self.trims.on_parameter(received.name, number);
        }
        if self.session.client.on_number(received.name, number) {
            self.parameter_kind = received.kind;
        }
    }

    /// Attitude in the frame in which the autopilot uses a compass.
    pub fn untrimmed_attitude(&self, sender: SenderId, sent: RollPitch) -> RollPitch {
        let is_trimmed = self.is_ardupilot() && self.autopilot.is_some_and(|(autopilot, _)| autopilot == sender);
        if is_trimmed { self.trims.untrimmed_attitude(sent) } else { sent }
    }

    /// Begins an action on the autopilot, in place of one in progress.
    pub fn begin_action(&mut self, action: AutopilotAction) {
        self.session.begin_action(action, self.kind());
    }

    /// Takes a message for all users.
    pub fn take_message(&mut self, now: Timestamp) -> Option<Message> {
        if self.trims.take_ambiguity() {
            return Some(Message::TrimsAmbiguous);
        }
        if let Some(report) = self.offsets.take_report() {
            return Some(Message::Autopilot(report));
        }
        self.session.take_message(now)
    }

    /// Takes a command for the state machine.
    pub const fn take_command(&mut self) -> Option<Command> {
        self.session.take_command()
    }

    /// Sends the due request; returns whether one was sent.
    pub fn send_due_request(&mut self, snapshot: &Snapshot<'_>, is_disarmed: bool, line: &mut Transmitter<'_>) -> bool {
        let (Some((autopilot, _)), now) = (self.autopilot(), snapshot.now) else { return false };
        if let Some(kind) = self.kind().filter(|_| self.session.is_running()) {
            let trims_deg = if self.is_ardupilot() { self.trims.trims_rad().map(f32::to_degrees) } else { [0.0; 2] };
            self.session.advance(snapshot, AutopilotState { kind, is_disarmed, trims_deg, msp_choice: None });
        } else if self.is_ardupilot() {
            self.monitor_parameters(now, snapshot.can_node);
        }
        let Some(request) = self.session.due_request(now, is_disarmed) else { return false };
        let message = match request {
            ParameterRequest::Read(name) => OutboundMessage::parameter_request(autopilot, name),
            ParameterRequest::Write(name, number) => {
                let (kind, encoding) = (self.parameter_kind, self.encoding());
                OutboundMessage::parameter_change(autopilot, name, number, kind, encoding)
            }
            ParameterRequest::Restart => OutboundMessage::autopilot_restart(autopilot),
            ParameterRequest::Save => return false,
        };
        let is_sent = line.send_message(message);
        if is_sent {
            self.session.on_request_sent(now, request);
        }
        is_sent
    }

    /// Reads trims and offsets, one at a time.
    fn monitor_parameters(&mut self, now: Timestamp, can_node: Option<u8>) {
        if let Some(result) = self.session.client.take_result() {
            self.session.is_monitoring = false;
            if self.trims.next_name().is_some() {
                self.trims.advance_reading();
            } else {
                self.offsets.complete_reading(result.ok(), can_node);
            }
        }
        if self.session.is_monitoring || self.session.is_running() {
            return;
        }
        if now.us_since(self.session.client.last_request_at()) >= MONITOR_PERIOD_US {
            self.trims.restart_reading();
            self.offsets.restart_reading();
        }
        if let Some(name) = self.trims.next_name().or_else(|| self.offsets.next_name()) {
            self.session.client.begin_read(name);
            self.session.is_monitoring = true;
        }
    }

    fn kind(&self) -> Option<AutopilotKind> {
        match self.autopilot?.1 {
            MavAutopilot::MAV_AUTOPILOT_ARDUPILOTMEGA => Some(AutopilotKind::ArduPilot),
            MavAutopilot::MAV_AUTOPILOT_PX4 => Some(AutopilotKind::Px4),
            _ => None,
        }
    }

    fn is_ardupilot(&self) -> bool {
        self.kind() == Some(AutopilotKind::ArduPilot)
    }

    fn encoding(&self) -> ParameterEncoding {
        if self.kind() == Some(AutopilotKind::Px4) { ParameterEncoding::Bytewise } else { ParameterEncoding::Cast }
    }
}
