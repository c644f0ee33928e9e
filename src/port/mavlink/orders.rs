//! Commands to the module, and what is answered.

use ::mavlink::dialects::common::{MavCmd, MavResult};

use super::{COMPONENT, Line};
use crate::attitude::Source;
use crate::compass::Refusal;
use crate::port::Order;
use crate::time::Timestamp;
use crate::wire::mavlink::{Address, Command, Outgoing};

/// The commands of a compass calibration, of ArduPilot's dialect. Their parameters are not read: there is one compass, and
/// a calibration is always stored.
const DO_START_MAG_CAL: u16 = 42_424;
const DO_ACCEPT_MAG_CAL: u16 = 42_425;
const DO_CANCEL_MAG_CAL: u16 = 42_426;

/// A command that is repeated within this time, microseconds, was carried out already.
const REPEATED_US: u64 = 1_000_000;

/// An order that is not answered within this time, microseconds, is not waited for any longer.
const PATIENCE_US: u64 = 5_000_000;

/// The last order that was passed on.
#[derive(Clone, Copy, Debug)]
struct Passed {
    at: Timestamp,
    by: Source,
    command: u16,
    order: Order,
    /// None: it was not answered yet.
    result: Option<MavResult>,
}

/// An answer to be sent.
#[derive(Clone, Copy, Debug)]
struct Answer {
    to: Source,
    command: u16,
    result: MavResult,
}

/// Commands to the module.
#[derive(Debug, Default)]
pub(super) struct Orders {
    last: Option<Passed>,
    /// In the order of their commands. While it is full others are not answered, and whoever sent them asks again.
    answers: heapless::Deque<Answer, 4>,
}

impl Orders {
    /// Takes a command to this component; an order to be passed on, if it is one.
    pub fn take(&mut self, at: Timestamp, command: &Command, is_armed: bool) -> Option<Order> {
        match self.judge(at, command, is_armed) {
            Ok(order) => {
                let (by, command) = (command.source, command.command);
                self.last = Some(Passed { at, by, command, order, result: None });
                Some(order)
            }
            Err(result) => {
                self.reply(command.source, command.command, result);
                None
            }
        }
    }

    /// What became of the last order.
    pub fn answer(&mut self, order: Order, result: Result<(), &Refusal>) {
        let result = match result {
            Ok(()) => MavResult::MAV_RESULT_ACCEPTED,
            Err(Refusal::Armed | Refusal::Busy) => MavResult::MAV_RESULT_TEMPORARILY_REJECTED,
            Err(_) => MavResult::MAV_RESULT_DENIED,
        };
        if let Some(passed) = self.last.as_mut().filter(|passed| passed.order == order && passed.result.is_none()) {
            passed.result = Some(result);
            let Passed { by, command, .. } = *passed;
            self.reply(by, command, result);
        }
    }

    /// Sends the answer that waits longest; whether there was one, and room for it.
    pub fn tell(&mut self, line: &mut Line<'_>) -> bool {
        let Some(&Answer { to, command, result }) = self.answers.front() else { return false };
        let is_sent = line.send(Outgoing::acknowledgement(Address::of(to), command, result));
        if is_sent {
            self.answers.pop_front();
        }
        is_sent
    }

    /// The order that a command is, or what is answered at once.
    fn judge(&self, at: Timestamp, command: &Command, is_armed: bool) -> Result<Order, MavResult> {
        let order = order(command)?;
        if let Some(last) = self.last {
            let age_us = at.us_since(last.at);
            let is_open = last.result.is_none() && age_us <= PATIENCE_US;
            let is_the_same = last.by == command.source && last.command == command.command;
            if is_the_same && command.confirmation > 0 && (is_open || age_us <= REPEATED_US) {
                return Err(last.result.unwrap_or(MavResult::MAV_RESULT_IN_PROGRESS));
            }
            if is_open {
                return Err(MavResult::MAV_RESULT_TEMPORARILY_REJECTED);
            }
        }
        if order == Order::Reboot && is_armed {
            return Err(MavResult::MAV_RESULT_TEMPORARILY_REJECTED);
        }
        Ok(order)
    }

    fn reply(&mut self, to: Source, command: u16, result: MavResult) {
        let _ = self.answers.push_back(Answer { to, command, result });
    }
}

fn order(command: &Command) -> Result<Order, MavResult> {
    const REBOOT: u16 = MavCmd::MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN as u16;
    match command.command {
        DO_START_MAG_CAL => Ok(Order::Start),
        DO_ACCEPT_MAG_CAL => Ok(Order::Accept),
        DO_CANCEL_MAG_CAL => Ok(Order::Cancel),
        REBOOT if wants_restart(command.parameters) => Ok(Order::Reboot),
        // To shut down, or to wait in a bootloader, it does not know.
        REBOOT => Err(MavResult::MAV_RESULT_DENIED),
        _ => Err(MavResult::MAV_RESULT_UNSUPPORTED),
    }
}

/// Whether the parameters ask who is addressed to restart: the first, as every component takes it, or the third, which is
/// for the component that the fourth names, 0 for all (MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN in common.xml).
fn wants_restart([autopilot, _companion, component, which]: [f32; 4]) -> bool {
    const RESTART: f32 = 1.0;
    autopilot == RESTART || (component == RESTART && [0.0, f32::from(COMPONENT)].contains(&which))
}
