//! Commands to the module, and their acknowledgements.

use ::mavlink::dialects::common::{MavCmd, MavResult};

use super::{COMPONENT, Transmitter};
use crate::attitude::SenderId;
use crate::messages::Refusal;
use crate::port::Order;
use crate::settings::OutOfRange;
use crate::time::Timestamp;
use crate::wire::mavlink::{Address, OutboundMessage, ReceivedCommand};

/// Commands of a compass calibration, from ArduPilot's dialect. Their parameters are ignored: there is one compass, and
/// a calibration is always stored.
const DO_START_MAG_CAL: u16 = 42_424;
const DO_ACCEPT_MAG_CAL: u16 = 42_425;
const DO_CANCEL_MAG_CAL: u16 = 42_426;

/// Time within which a repeated command counts as executed, microseconds.
const REPEATED_US: u64 = 1_000_000;

/// Timeout of an order's result, microseconds; after it the next order is accepted.
const RESULT_TIMEOUT_US: u64 = 5_000_000;

/// Last order that was passed on.
#[derive(Clone, Copy, Debug)]
struct LastOrder {
    at: Timestamp,
    by: SenderId,
    command: u16,
    order: Order,
    /// Result; none until it is known.
    result: Option<MavResult>,
}

#[derive(Debug)]
struct Rejection {
    result: MavResult,
    /// Reason, sent as a text; none for a repeated or unknown command.
    reason: Option<Refusal>,
}

impl From<MavResult> for Rejection {
    fn from(result: MavResult) -> Self {
        Self { result, reason: None }
    }
}

#[derive(Clone, Copy, Debug)]
struct PendingAcknowledgement {
    to: SenderId,
    command: u16,
    result: MavResult,
}

/// Commands to the module, and their acknowledgements.
#[derive(Debug, Default)]
pub(super) struct CommandHandler {
    last: Option<LastOrder>,
    /// Acknowledgements in the order of their commands. While the queue is full, further commands are not acknowledged,
    /// so that their senders repeat them.
    answers: heapless::Deque<PendingAcknowledgement, 4>,
}

impl CommandHandler {
    /// Processes a command to this component; returns the order to pass on.
    ///
    /// # Errors
    ///
    /// The command is rejected, with the reason to send as a text, if any.
    pub fn process_command(
        &mut self,
        at: Timestamp,
        command: &ReceivedCommand,
        is_armed: bool,
    ) -> Result<Order, Option<Refusal>> {
        match self.evaluate(at, command, is_armed) {
            Ok(order) => {
                let (by, command) = (command.source, command.command);
                self.last = Some(LastOrder { at, by, command, order, result: None });
                Ok(order)
            }
            Err(Rejection { result, reason }) => {
                self.reply(command.source, command.command, result);
                Err(reason)
            }
        }
    }

    /// Records the result of the last order.
    pub fn complete_order(&mut self, order: Order, result: Result<(), &Refusal>) {
        let result = match result {
            Ok(()) => MavResult::MAV_RESULT_ACCEPTED,
            Err(Refusal::Armed | Refusal::Busy) => MavResult::MAV_RESULT_TEMPORARILY_REJECTED,
            Err(_) => MavResult::MAV_RESULT_DENIED,
        };
        if let Some(passed) = self.last.as_mut().filter(|passed| passed.order == order && passed.result.is_none()) {
            passed.result = Some(result);
            let LastOrder { by, command, .. } = *passed;
            self.reply(by, command, result);
        }
    }

    /// Sends the oldest acknowledgement; returns whether one was sent.
    pub fn send(&mut self, line: &mut Transmitter<'_>) -> bool {
        let Some(&PendingAcknowledgement { to, command, result }) = self.answers.front() else { return false };
        let is_sent = line.send(OutboundMessage::acknowledgement(Address::from_sender(to), command, result));
        if is_sent {
            self.answers.pop_front();
        }
        is_sent
    }

    fn evaluate(&self, at: Timestamp, command: &ReceivedCommand, is_armed: bool) -> Result<Order, Rejection> {
        let order = order(command)?;
        if let Some(last) = self.last {
            let age_us = at.us_since(last.at);
            let is_open = last.result.is_none() && age_us <= RESULT_TIMEOUT_US;
            let is_the_same = last.by == command.source && last.command == command.command;
            if is_the_same && command.confirmation > 0 && (is_open || age_us <= REPEATED_US) {
                return Err(last.result.unwrap_or(MavResult::MAV_RESULT_IN_PROGRESS).into());
            }
            if is_open {
                return Err(not_now(Refusal::Busy));
            }
        }
        if order == Order::Reboot && is_armed {
            return Err(not_now(Refusal::Armed));
        }
        Ok(order)
    }

    fn reply(&mut self, to: SenderId, command: u16, result: MavResult) {
        let _ = self.answers.push_back(PendingAcknowledgement { to, command, result });
    }
}

const fn not_now(reason: Refusal) -> Rejection {
    Rejection { result: MavResult::MAV_RESULT_TEMPORARILY_REJECTED, reason: Some(reason) }
}

fn order(command: &ReceivedCommand) -> Result<Order, Rejection> {
    const REBOOT: u16 = MavCmd::MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN as u16;
    match command.command {
        DO_START_MAG_CAL => Ok(Order::Start),
        DO_ACCEPT_MAG_CAL => Ok(Order::Accept),
        DO_CANCEL_MAG_CAL => Ok(Order::Cancel),
        REBOOT if wants_restart(command.parameters) => Ok(Order::Reboot),
        REBOOT => Err(Rejection {
            result: MavResult::MAV_RESULT_DENIED,
            reason: Some(Refusal::OutOfRange(OutOfRange(
                "the module can restart, but neither shut down nor wait in a bootloader",
            ))),
        }),
        _ => Err(MavResult::MAV_RESULT_UNSUPPORTED.into()),
    }
}

/// Whether the parameters request a restart of this component: the first one of all components, the third one of the
/// component in the fourth, 0 for all (MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN in common.xml).
fn wants_restart([autopilot, _companion, component, which]: [f32; 4]) -> bool {
    const RESTART: f32 = 1.0;
    autopilot == RESTART || (component == RESTART && [0.0, f32::from(COMPONENT)].contains(&which))
}
