//! Client of the autopilot's parameters: reads or writes one at a time by its name, with time-outs and repetitions.
//!
//! A write is complete when a read afterwards returns the number: the reply to a write alone may be lost, or be the
//! answer to a ground station that writes at the same time.

use autoswing::time::Timestamp;
use autoswing_module::messages::ParameterName;

/// Time for a reply, microseconds: ArduPilot answers from a queue that it serves every 0.1 s, and a tunnel adds frames.
const REPLY_TIMEOUT_US: u64 = 500_000;

/// Number of requests without a reply, of a parameter that does not exist: on a line that loses every third frame, in
/// either direction, one in twenty requests for an existing one fails.
const ATTEMPTS: u8 = 5;

/// Time for INAV to save its settings, which is requested once, microseconds.
const SAVE_TIMEOUT_US: u64 = 3_000_000;

/// Request to the autopilot.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ParameterRequest {
    /// Read a parameter.
    Read(ParameterName),
    /// Write a parameter, whose kind was read.
    Write(ParameterName, f32),
    /// Save all settings; only INAV needs it.
    Save,
    /// Restart the autopilot.
    Restart,
}

/// Error of a read or write.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ParameterError {
    /// No reply, or a refusal: the autopilot has no such parameter, or the line is broken.
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
    Save,
    Done(Result<f32, ParameterError>),
}

/// Client of the autopilot's parameters.
#[derive(Debug, Default)]
pub struct ParameterClient {
    name: ParameterName,
    step: Step,
    /// Number of requests of this step.
    attempts: u8,
    requested_at: Timestamp,
}

impl ParameterClient {
    /// Whether the next read or write may begin.
    pub(super) fn is_idle(&self) -> bool {
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

    /// Begins to write the parameter that was read last.
    pub(super) fn begin_write(&mut self, number: f32) {
        self.begin_step(Step::Write(number));
    }

    /// Begins to save all settings.
    pub(super) fn begin_save(&mut self) {
        self.begin_step(Step::Save);
    }

    /// Takes the result of the last read or write: the parameter's number.
    pub fn take_result(&mut self) -> Option<Result<f32, ParameterError>> {
        let Step::Done(result) = self.step else { return None };
        self.step = Step::Idle;
        Some(result)
    }

    /// Processes a parameter of the autopilot, and its number if it is decodable; returns whether it is a read's.
    pub fn on_number(&mut self, name: ParameterName, number: Option<f32>) -> bool {
        if name != self.name || self.attempts == 0 {
            return false;
        }
        let read_number = number.ok_or(ParameterError::Undecodable);
        match self.step {
            Step::Read => {
                self.step = Step::Done(read_number);
                return true;
            }
            Step::Write(number) => self.begin_step(Step::ReadBack(number)),
            Step::ReadBack(number) => {
                let check_number = |read: f32| {
                    if is_same_number(read, number) { Ok(read) } else { Err(ParameterError::NotChanged(read)) }
                };
                self.step = Step::Done(read_number.and_then(check_number));
            }
            Step::Idle | Step::Save | Step::Done(_) => {}
        }
        false
    }

    /// Processes an answer without a number: of a write or a save, or that a parameter does not exist.
    pub fn on_answer(&mut self) {
        if self.attempts > 0 {
            self.give_up_step();
        }
    }

    /// Next request, if due.
    pub(super) fn due_request(&mut self, now: Timestamp) -> Option<ParameterRequest> {
        let (timeout_us, attempts) =
            if self.step == Step::Save { (SAVE_TIMEOUT_US, 1) } else { (REPLY_TIMEOUT_US, ATTEMPTS) };
        if self.attempts > 0 && now.us_since(self.requested_at) < timeout_us {
            return None;
        }
        if self.attempts >= attempts {
            self.give_up_step();
        }
        match self.step {
            Step::Idle | Step::Done(_) => None,
            Step::Read | Step::ReadBack(_) => Some(ParameterRequest::Read(self.name)),
            Step::Write(number) => Some(ParameterRequest::Write(self.name, number)),
            Step::Save => Some(ParameterRequest::Save),
        }
    }

    /// Records that the due request was sent.
    pub(super) const fn on_request_sent(&mut self, now: Timestamp) {
        self.attempts += 1;
        self.requested_at = now;
    }

    fn begin_step(&mut self, step: Step) {
        (self.step, self.attempts) = (step, 0);
    }

    /// Ends a step without a number. A write without a reply may have been executed.
    fn give_up_step(&mut self) {
        match self.step {
            Step::Read | Step::ReadBack(_) | Step::Save => {
                self.begin_step(Step::Done(Err(ParameterError::NoReply)));
            }
            Step::Write(number) => self.begin_step(Step::ReadBack(number)),
            Step::Idle | Step::Done(_) => {}
        }
    }
}

/// Whether numbers are the same up to the rounding of an autopilot that stores or prints them otherwise.
pub(super) fn is_same_number(first: f32, second: f32) -> bool {
    (first - second).abs() <= 1e-6 * first.abs().max(second.abs())
}
