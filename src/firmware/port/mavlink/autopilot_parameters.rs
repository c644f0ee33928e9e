//! The autopilot's parameters: one client, and its users in turn. A check or a setup comes before the trims, and these
//! before the offsets.

use mavlink_dialect::MavAutopilot;

use super::attitude_trims::AttitudeTrims;
use super::autopilot_setup::{AutopilotSetup, SetupContext};
use super::compass_offsets::CompassOffsets;
use super::parameter_client::ParameterClient;
use super::transmitter::Transmitter;
use crate::port::message_schedule::MessageSchedule;
use crate::port::snapshot::Snapshot;
use crate::wire::mavlink::{Address, OutboundMessage, ParameterEncoding, ReceivedParameter};
use autoswing::attitude::SenderId;
use autoswing::frames::RollPitch;
use autoswing::time::Timestamp;
use autoswing_module::compass::{AutopilotAction, Command, IndicatorState};
use autoswing_module::messages::{AutopilotReport, Message};

/// Time after which trims and offsets are read again, microseconds: a change without a message, or whose message was
/// lost.
const MONITOR_PERIOD_US: u64 = 30_000_000;

/// Rate of reports, Hz: a text of three chunks takes 0.3 s.
const REPORT_HZ: u8 = 3;

/// Parameters of the selected autopilot.
#[derive(Debug, Default)]
pub(super) struct AutopilotParameters {
    /// Autopilot to which the rest belongs, and its firmware.
    autopilot: Option<(SenderId, MavAutopilot)>,
    client: ParameterClient,
    trims: AttitudeTrims,
    offsets: CompassOffsets,
    /// Whether the client's read is one of trims and offsets.
    is_monitoring: bool,
    setup: AutopilotSetup,
    awaits_restart: bool,
    report_schedule: MessageSchedule,
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
        let encoding = self.encoding();
        if let Some(number) = received.number(encoding) {
            self.trims.on_parameter(received.name, number);
        }
        self.client.on_parameter(received, encoding);
    }

    /// Attitude in the frame in which the autopilot uses a compass.
    pub fn untrimmed_attitude(&self, sender: SenderId, sent: RollPitch) -> RollPitch {
        let is_trimmed = self.is_ardupilot() && self.autopilot.is_some_and(|(autopilot, _)| autopilot == sender);
        if is_trimmed { self.trims.untrimmed_attitude(sent) } else { sent }
    }

    /// Begins an action on the autopilot, in place of a check or a setup in progress.
    pub fn begin_action(&mut self, action: AutopilotAction) {
        if !self.is_monitoring {
            self.client = ParameterClient::default();
        }
        match (action, self.autopilot) {
            (AutopilotAction::Restart, Some(_)) => self.awaits_restart = true,
            (
                AutopilotAction::Check | AutopilotAction::Setup | AutopilotAction::Undo,
                Some((_, firmware @ (MavAutopilot::MAV_AUTOPILOT_ARDUPILOTMEGA | MavAutopilot::MAV_AUTOPILOT_PX4))),
            ) => self.setup.begin(action, firmware),
            _ => self.setup.end(AutopilotReport::NoAutopilot),
        }
    }

    /// Takes a message for all users.
    pub fn take_message(&mut self, now: Timestamp) -> Option<Message> {
        if self.trims.take_ambiguity() {
            return Some(Message::TrimsAmbiguous);
        }
        if let Some(report) = self.offsets.take_report() {
            return Some(Message::Autopilot(report));
        }
        if self.setup.has_report() && self.report_schedule.is_due(now, REPORT_HZ) {
            return self.setup.take_report().map(Message::Autopilot);
        }
        None
    }

    /// Takes a command for the state machine.
    pub const fn take_command(&mut self) -> Option<Command> {
        self.setup.take_command()
    }

    /// Sends the due request; returns whether one was sent.
    pub fn send_due_request(&mut self, snapshot: &Snapshot<'_>, is_disarmed: bool, line: &mut Transmitter<'_>) -> bool {
        let Some((autopilot, firmware)) = self.autopilot else { return false };
        let address = Address::from_sender(autopilot);
        if self.awaits_restart {
            self.awaits_restart = is_disarmed && !line.send_message(OutboundMessage::autopilot_restart(address));
            return is_disarmed && !self.awaits_restart;
        }
        if self.setup.is_running() && !self.is_monitoring {
            let is_calibrated = snapshot.indicator_state == IndicatorState::Calibrated;
            let heading = snapshot.estimate.heading.ok().filter(|_| is_calibrated);
            let context = SetupContext {
                now: snapshot.now,
                firmware,
                can_node: snapshot.can_node,
                sends_vision_yaw: snapshot.settings.sends_vision_yaw,
                is_calibrated,
                is_disarmed,
                heading_deg: heading.map(|heading| heading.magnetic_deg()),
                trims_deg: if self.is_ardupilot() { self.trims.trims_rad().map(f32::to_degrees) } else { [0.0; 2] },
                replaced_numbers: &snapshot.settings.replaced_numbers,
            };
            self.setup.advance(context, &mut self.client);
        } else if self.is_ardupilot() {
            self.monitor_parameters(snapshot.now, snapshot.can_node);
        }
        self.client.send_due_request(snapshot.now, address, self.encoding(), line)
    }

    /// Reads trims and offsets, one at a time.
    fn monitor_parameters(&mut self, now: Timestamp, can_node: Option<u8>) {
        if let Some(result) = self.client.take_result() {
            self.is_monitoring = false;
            if self.trims.next_name().is_some() {
                self.trims.advance_reading();
            } else {
                self.offsets.complete_reading(result.ok(), can_node);
            }
        }
        if self.is_monitoring || self.setup.is_running() {
            return;
        }
        if now.us_since(self.client.last_request_at()) >= MONITOR_PERIOD_US {
            self.trims.restart_reading();
            self.offsets.restart_reading();
        }
        if let Some(name) = self.trims.next_name().or_else(|| self.offsets.next_name()) {
            self.client.begin_read(name);
            self.is_monitoring = true;
        }
    }

    fn is_ardupilot(&self) -> bool {
        self.autopilot.is_some_and(|(_, firmware)| firmware == MavAutopilot::MAV_AUTOPILOT_ARDUPILOTMEGA)
    }

    fn encoding(&self) -> ParameterEncoding {
        match self.autopilot {
            Some((_, MavAutopilot::MAV_AUTOPILOT_PX4)) => ParameterEncoding::Bytewise,
            _ => ParameterEncoding::Cast,
        }
    }
}
