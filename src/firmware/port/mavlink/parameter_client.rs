//! Client of the autopilot's parameters: reads or writes one at a time by its name, with time-outs and repetitions.
//!
//! A write is complete when a read afterwards returns the number: the reply to a PARAM_SET alone may be lost, or be the
//! answer to a ground station that writes at the same time.

use mavlink_dialect::MavParamType;

use super::transmitter::Transmitter;
use crate::wire::mavlink::{Address, OutboundMessage, ParameterEncoding, ReceivedParameter};
use autoswing::time::Timestamp;
use autoswing_module::messages::ParameterName;

/// Time for a reply, microseconds: ArduPilot answers from a queue that it serves every 0.1 s, and a tunnel adds frames.
const REPLY_TIMEOUT_US: u64 = 500_000;

/// Number of requests without a reply, of a parameter that does not exist: on a line that loses every third frame, in
/// either direction, one in twenty requests for an existing one fails.
const ATTEMPTS: u8 = 5;

/// Error of a read or write.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum ParameterError {
    /// No reply: the autopilot has no such parameter, or the line is broken.
    NoReply,
    /// The kind of number is unknown, or the number is not finite.
    Undecodable,
    /// The parameter has this number after the write.
    NotChanged(f32),
}

#[derive(Clone, Copy, Debug, Default, PartialEq)]
enum Step {
    #[default]
    Idle,
    Read,
    /// Writes the number.
    Write(f32),
    /// Reads after the number was written.
    ReadBack(f32),
    Done(Result<f32, ParameterError>),
}

/// Client of the autopilot's parameters.
#[derive(Debug, Default)]
pub(super) struct ParameterClient {
    name: ParameterName,
    /// Kind of the last parameter that was read.
    kind: MavParamType,
    step: Step,
    /// Number of requests of this step.
    attempts: u8,
    requested_at: Timestamp,
}

impl ParameterClient {
    /// Whether the next read or write may begin.
    pub fn is_idle(&self) -> bool {
        self.step == Step::Idle
    }

    /// Time of the last request.
    pub const fn last_request_at(&self) -> Timestamp {
        self.requested_at
    }

    /// Begins to read a parameter.
    pub fn begin_read(&mut self, name: ParameterName) {
        self.name = name;
        self.begin_step(Step::Read);
    }

    /// Begins to write the parameter that was read last, whose kind is known.
    pub fn begin_write(&mut self, number: f32) {
        self.begin_step(Step::Write(number));
    }

    /// Takes the result of the last read or write: the parameter's number.
    pub fn take_result(&mut self) -> Option<Result<f32, ParameterError>> {
        let Step::Done(result) = self.step else { return None };
        self.step = Step::Idle;
        Some(result)
    }

    /// Processes a parameter of the autopilot.
    pub fn on_parameter(&mut self, received: &ReceivedParameter, encoding: ParameterEncoding) {
        if received.name != self.name || self.attempts == 0 {
            return;
        }
        let read_number = received.number(encoding).ok_or(ParameterError::Undecodable);
        match self.step {
            Step::Read => {
                self.kind = received.kind;
                self.step = Step::Done(read_number);
            }
            Step::Write(number) => self.begin_step(Step::ReadBack(number)),
            Step::ReadBack(number) => {
                let check_number = |read: f32| {
                    if is_same_number(read, number) { Ok(read) } else { Err(ParameterError::NotChanged(read)) }
                };
                self.step = Step::Done(read_number.and_then(check_number));
            }
            Step::Idle | Step::Done(_) => {}
        }
    }

    /// Sends the due request; returns whether one was sent.
    pub fn send_due_request(
        &mut self,
        now: Timestamp,
        autopilot: Address,
        encoding: ParameterEncoding,
        line: &mut Transmitter<'_>,
    ) -> bool {
        if self.attempts > 0 && now.us_since(self.requested_at) < REPLY_TIMEOUT_US {
            return false;
        }
        if self.attempts >= ATTEMPTS {
            self.give_up_step();
        }
        let message = match self.step {
            Step::Idle | Step::Done(_) => return false,
            Step::Read | Step::ReadBack(_) => OutboundMessage::parameter_request(autopilot, self.name),
            Step::Write(number) => OutboundMessage::parameter_change(autopilot, self.name, number, self.kind, encoding),
        };
        let is_sent = line.send_message(message);
        if is_sent {
            self.attempts += 1;
            self.requested_at = now;
        }
        is_sent
    }

    fn begin_step(&mut self, step: Step) {
        (self.step, self.attempts) = (step, 0);
    }

    /// Ends a step without a reply. A write without a reply may have been executed.
    fn give_up_step(&mut self) {
        match self.step {
            Step::Read | Step::ReadBack(_) => self.begin_step(Step::Done(Err(ParameterError::NoReply))),
            Step::Write(number) => self.begin_step(Step::ReadBack(number)),
            Step::Idle | Step::Done(_) => {}
        }
    }
}

/// Whether numbers are the same up to the rounding of an autopilot that stores or prints them otherwise.
pub(super) fn is_same_number(first: f32, second: f32) -> bool {
    (first - second).abs() <= 1e-6 * first.abs().max(second.abs())
}
