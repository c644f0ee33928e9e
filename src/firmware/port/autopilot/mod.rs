//! Check and setup of an autopilot's parameters, on any line: MAVLink, or MSP of INAV.
//!
//! A line asks for the due request, encodes it, and passes the answers on. [`AutopilotSession`] does the rest: it makes
//! one request at a time, with repetitions (`parameter_client.rs`), and reads, compares and writes (`setup.rs`) the
//! parameters of a table (`wanted_parameters.rs`).

mod parameter_client;
mod setup;
mod wanted_parameters;

use crate::port::message_schedule::MessageSchedule;
use crate::port::snapshot::Snapshot;
use autoswing::time::Timestamp;
use autoswing_module::compass::{AutopilotAction, Command, IndicatorState};
use autoswing_module::messages::{AutopilotReport, Message};
pub(super) use autoswing_module::replaced_numbers::AutopilotKind;
use parameter_client::ParameterClient;
pub(super) use parameter_client::ParameterRequest;
use setup::{AutopilotSetup, SetupContext};
pub(super) use setup::{AutopilotState, is_device_of_module};
pub(super) use wanted_parameters::{COMPASS_COUNT, DEVICE_ID_PATTERN, OFFSET_PATTERNS};

/// Rate of reports, Hz: a text of three chunks takes 0.3 s.
const REPORT_HZ: u8 = 3;

/// Actions on an autopilot.
#[derive(Debug, Default)]
pub(super) struct AutopilotSession {
    pub client: ParameterClient,
    /// Whether the client's read is not one of an action.
    pub is_monitoring: bool,
    setup: AutopilotSetup,
    awaits_restart: bool,
    report_schedule: MessageSchedule,
}

impl AutopilotSession {
    /// Begins an action, in place of one in progress; `None` for an unknown autopilot.
    pub fn begin_action(&mut self, action: AutopilotAction, kind: Option<AutopilotKind>) {
        *self = Self::default();
        match (action, kind) {
            (AutopilotAction::Restart, Some(_)) => self.awaits_restart = true,
            (AutopilotAction::Check | AutopilotAction::Setup | AutopilotAction::Undo, Some(kind)) => {
                self.setup.begin(action, kind);
            }
            (_, None) => self.setup.end(AutopilotReport::NoAutopilot),
        }
    }

    /// Whether a check, a setup or an undo is in progress, which uses the client.
    pub const fn is_running(&self) -> bool {
        self.setup.is_running()
    }

    /// Whether any action is in progress.
    pub const fn has_action(&self) -> bool {
        self.is_running() || self.awaits_restart
    }

    /// Takes a message for all users.
    pub fn take_message(&mut self, now: Timestamp) -> Option<Message> {
        let is_due = self.setup.has_report() && self.report_schedule.is_due(now, REPORT_HZ);
        if is_due { self.setup.take_report().map(Message::Autopilot) } else { None }
    }

    /// Takes a command for the state machine.
    pub const fn take_command(&mut self) -> Option<Command> {
        self.setup.take_command()
    }

    /// Continues a check, a setup or an undo.
    pub fn advance(&mut self, snapshot: &Snapshot<'_>, autopilot: AutopilotState) {
        if !self.is_running() {
            return;
        }
        let is_calibrated = snapshot.indicator_state == IndicatorState::Calibrated;
        let heading = snapshot.estimate.heading.ok().filter(|_| is_calibrated);
        let context = SetupContext {
            now: snapshot.now,
            autopilot,
            can_node: snapshot.can_node,
            sends_vision_yaw: snapshot.settings.sends_vision_yaw,
            is_calibrated,
            heading_deg: heading.map(|heading| heading.magnetic_deg()),
            field: snapshot.estimate.compass_field,
            replaced_numbers: &snapshot.settings.replaced_numbers,
        };
        self.setup.advance(context, &mut self.client);
    }

    /// Next request, if due. A restart only while the autopilot reports that it is disarmed.
    pub fn due_request(&mut self, now: Timestamp, is_disarmed: bool) -> Option<ParameterRequest> {
        if self.awaits_restart && !is_disarmed {
            self.awaits_restart = false;
        }
        if self.awaits_restart { Some(ParameterRequest::Restart) } else { self.client.due_request(now) }
    }

    /// Records that a request was sent.
    pub const fn on_request_sent(&mut self, now: Timestamp, request: ParameterRequest) {
        match request {
            ParameterRequest::Restart => self.awaits_restart = false,
            _ => self.client.on_request_sent(now),
        }
    }
}
