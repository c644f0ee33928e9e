//! Commands to the module, and their acknowledgements.

use mavlink_dialect::{MavCmd, MavResult};

use super::transmitter::Transmitter;
use crate::wire::mavlink::{Address, OutboundMessage, ReceivedCommand};
use autoswing::attitude::SenderId;
use autoswing::calibration::method_selection::Procedure;
use autoswing::time::Timestamp;
use autoswing_module::compass::{AutopilotAction, Command};
use autoswing_module::messages::Refusal;
use autoswing_module::settings::OutOfRange;

/// Command that starts a compass calibration, from ArduPilot's dialect. Its parameters are ignored: there is one
/// compass, and a calibration is always stored.
const DO_START_MAG_CAL: u16 = 42_424;
/// Command that accepts a calibration: ends the collection and solves. The module itself decides on acceptance.
const DO_ACCEPT_MAG_CAL: u16 = 42_425;
/// Command that cancels a compass calibration.
const DO_CANCEL_MAG_CAL: u16 = 42_426;

/// Time within which a repeated command counts as executed, microseconds.
const REPETITION_WINDOW_US: u64 = 1_000_000;

/// Timeout of a command's result, microseconds; after it the next command is accepted.
const RESULT_TIMEOUT_US: u64 = 5_000_000;

/// Last command that was passed on.
#[derive(Clone, Copy, Debug)]
struct LastCommand {
    received_at: Timestamp,
    sender: SenderId,
    command_number: u16,
    command: Command,
    /// Result of the command; none until it is known.
    result: Option<MavResult>,
}

/// Result of a command that is not passed on, with the reason, sent as a text; none for a repeated or unknown command.
type CommandRejection = (MavResult, Option<Refusal>);

#[derive(Clone, Copy, Debug)]
struct PendingAcknowledgement {
    addressee: SenderId,
    command: u16,
    result: MavResult,
}

/// Commands to the module, and their acknowledgements.
#[derive(Debug, Default)]
pub(super) struct CommandHandler {
    last_command: Option<LastCommand>,
    /// Acknowledgements in the order of their commands. While the queue is full, further commands are not acknowledged,
    /// so that their senders repeat them.
    acknowledgements: heapless::Deque<PendingAcknowledgement, 4>,
}

impl CommandHandler {
    /// Processes a command to this component; returns the command to pass on.
    ///
    /// # Errors
    ///
    /// The command is rejected, with the reason to send as a text, if any.
    pub fn process_command(&mut self, at: Timestamp, received: &ReceivedCommand) -> Result<Command, Option<Refusal>> {
        match self.evaluate_command(at, received) {
            Ok(command) => {
                let (sender, number) = (received.sender_id, received.command_number);
                self.last_command =
                    Some(LastCommand { received_at: at, sender, command_number: number, command, result: None });
                Ok(command)
            }
            Err((result, reason)) => {
                self.queue_acknowledgement(received.sender_id, received.command_number, result);
                Err(reason)
            }
        }
    }

    /// Records the result of the last command.
    pub fn complete_command(&mut self, command: Command, result: Result<(), &Refusal>) {
        let result = match result {
            Ok(()) => MavResult::MAV_RESULT_ACCEPTED,
            Err(Refusal::Armed | Refusal::Busy) => MavResult::MAV_RESULT_TEMPORARILY_REJECTED,
            Err(_) => MavResult::MAV_RESULT_DENIED,
        };
        if let Some(open_command) = self
            .last_command
            .as_mut()
            .filter(|open_command| open_command.command == command && open_command.result.is_none())
        {
            open_command.result = Some(result);
            let LastCommand { sender, command_number: number, .. } = *open_command;
            self.queue_acknowledgement(sender, number, result);
        }
    }

    /// Sends the oldest acknowledgement; returns whether one was sent.
    pub fn send_next_acknowledgement(&mut self, line: &mut Transmitter<'_>) -> bool {
        let Some(&PendingAcknowledgement { addressee, command, result }) = self.acknowledgements.front() else {
            return false;
        };
        let is_sent =
            line.send_message(OutboundMessage::acknowledgement(Address::from_sender(addressee), command, result));
        if is_sent {
            self.acknowledgements.pop_front();
        }
        is_sent
    }

    fn evaluate_command(&self, at: Timestamp, received: &ReceivedCommand) -> Result<Command, CommandRejection> {
        let command = requested_command(received)?;
        if let Some(last_command) = self.last_command {
            let age_us = at.us_since(last_command.received_at);
            let is_open = last_command.result.is_none() && age_us <= RESULT_TIMEOUT_US;
            let is_repeated =
                last_command.sender == received.sender_id && last_command.command_number == received.command_number;
            if is_repeated && received.confirmation > 0 && (is_open || age_us <= REPETITION_WINDOW_US) {
                return Err((last_command.result.unwrap_or(MavResult::MAV_RESULT_IN_PROGRESS), None));
            }
            if is_open {
                return Err((MavResult::MAV_RESULT_TEMPORARILY_REJECTED, Some(Refusal::Busy)));
            }
        }
        Ok(command)
    }

    #[inline(never)] // Inlined in both callers it takes 64 bytes more flash.
    fn queue_acknowledgement(&mut self, addressee: SenderId, command: u16, result: MavResult) {
        let _ = self.acknowledgements.push_back(PendingAcknowledgement { addressee, command, result });
    }
}

fn requested_command(received: &ReceivedCommand) -> Result<Command, CommandRejection> {
    const AUTOPILOT_COMMAND: u16 = MavCmd::MAV_CMD_USER_1.0;
    const REBOOT_COMMAND: u16 = MavCmd::MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN.0;
    match received.command_number {
        DO_START_MAG_CAL => Ok(Command::CalStart(Procedure::Flight)),
        DO_ACCEPT_MAG_CAL => Ok(Command::CalSolve(None)),
        DO_CANCEL_MAG_CAL => Ok(Command::CalAbort),
        AUTOPILOT_COMMAND => autopilot_action(received.parameters).map(Command::Autopilot),
        REBOOT_COMMAND if requests_module_restart(received.parameters, received.target.component_id) => {
            Ok(Command::Restart)
        }
        REBOOT_COMMAND => {
            const PARAMETER_OUT_OF_RANGE: OutOfRange =
                OutOfRange("the module can restart, but neither shut down nor wait in a bootloader");
            Err((MavResult::MAV_RESULT_DENIED, Some(Refusal::OutOfRange(PARAMETER_OUT_OF_RANGE))))
        }
        _ => Err((MavResult::MAV_RESULT_UNSUPPORTED, None)),
    }
}

/// Action on the autopilot by the first parameter: 1 checks, 2 sets up, 3 restarts it, 4 undoes the setup.
fn autopilot_action([action, ..]: [f32; 4]) -> Result<AutopilotAction, CommandRejection> {
    const ACTION_OUT_OF_RANGE: OutOfRange =
        OutOfRange("an action on the autopilot is 1 to 4: check, set up, restart, undo");
    match action {
        1.0 => Ok(AutopilotAction::Check),
        2.0 => Ok(AutopilotAction::Setup),
        3.0 => Ok(AutopilotAction::Restart),
        4.0 => Ok(AutopilotAction::Undo),
        _ => Err((MavResult::MAV_RESULT_DENIED, Some(Refusal::OutOfRange(ACTION_OUT_OF_RANGE)))),
    }
}

/// Whether the parameters request a restart of this component: the first one of all components, the third one of the
/// component in the fourth, 0 for all (MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN in common.xml).
fn requests_module_restart(
    [autopilot, _companion, component, addressed_component]: [f32; 4],
    own_component: u8,
) -> bool {
    const REBOOT_PARAMETER: f32 = 1.0;
    autopilot == REBOOT_PARAMETER
        || (component == REBOOT_PARAMETER && [0.0, f32::from(own_component)].contains(&addressed_component))
}
