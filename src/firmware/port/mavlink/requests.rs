//! Requests for the messages that the module needs from the autopilot.
//!
//! ArduPilot sends next to nothing without a request. It denies a rate of more than 80 % of its main loop's, 40 Hz at
//! the default loop of an aeroplane (`GCS_MAVLINK::cap_message_interval`), and warns its pilot of the request. So the
//! module begins with 40 Hz, or with 50 Hz if the setting allows it, and lowers the rate until the messages come. An
//! autopilot without MAV_CMD_SET_MESSAGE_INTERVAL gets REQUEST_DATA_STREAM. Requests are at least a second apart.

use mavlink_dialect::{
    ATTITUDE_DATA, GLOBAL_POSITION_INT_DATA, MavCmd, MavResult, MessageData, SYS_STATUS_DATA, SYSTEM_TIME_DATA,
};

use super::transmitter::Transmitter;
use crate::wire::mavlink::{Acknowledgement, Address, OutboundMessage};
use autoswing::attitude::SenderId;
use autoswing::time::{Timestamp, WrappingMillis};

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum MessageRequest {
    /// ATTITUDE at this rate, Hz.
    Attitude(u8),
    /// The stream that contains ATTITUDE at this rate, Hz.
    Stream(u8),
    /// Another message by its number at this rate, Hz.
    Message(u32, u8),
}

/// Requests in order: first for the calibration, then for the field model.
const MESSAGE_REQUESTS: [MessageRequest; 8] = [
    MessageRequest::Attitude(50),
    MessageRequest::Attitude(40),
    MessageRequest::Attitude(25),
    MessageRequest::Attitude(20),
    MessageRequest::Stream(25),
    MessageRequest::Message(SYS_STATUS_DATA::ID, CURRENT_HZ),
    MessageRequest::Message(GLOBAL_POSITION_INT_DATA::ID, 1),
    MessageRequest::Message(SYSTEM_TIME_DATA::ID, 1),
];

/// Rate of SYS_STATUS, Hz: the current of a copter changes within half a second.
const CURRENT_HZ: u8 = 10;

/// Index of the first request after those for attitude.
const FIRST_NON_ATTITUDE_INDEX: usize = 5;

/// Time for the reply to a request and for the first messages, microseconds; also the least time between requests.
const REPLY_TIMEOUT_US: u64 = 1_000_000;

/// Number of requests for a message that does not arrive.
const ATTEMPTS_PER_REQUEST: u8 = 2;

/// Silence of the attitude after which all requests are repeated, microseconds.
const ATTITUDE_TIMEOUT_US: u64 = 2_000_000;

/// Backward step of the autopilot's clock, milliseconds, that indicates a restart, which discards its requests.
const MIN_RESTART_STEP_MS: i32 = 1_000;

/// Requests to the autopilot, and their progress.
#[derive(Debug, Default)]
pub(super) struct RequestSequence {
    /// The autopilot that receives the requests.
    autopilot: Option<SenderId>,
    /// Highest rate of attitude to request, Hz.
    max_attitude_hz: u8,
    /// Index of the present or next request; past the end when all are done.
    request_index: usize,
    /// Number of times this request was sent.
    attempts: u8,
    /// Time of the last request to the autopilot, or of its acceptance; attitude reports are counted from it, to measure
    /// their rate.
    report_count_started_at: Timestamp,
    report_count: u16,
    /// Time of the last attitude report, and its sender's clock.
    last_report: Option<(Timestamp, WrappingMillis)>,
}

impl RequestSequence {
    /// Records an attitude report of the selected sender.
    pub fn on_attitude(&mut self, at: Timestamp, sender_clock_at_sending: WrappingMillis) {
        if self.last_report.is_some_and(|(_, last_sender_time)| {
            last_sender_time.signed_ms_since(sender_clock_at_sending) > MIN_RESTART_STEP_MS
        }) {
            self.begin_requests(at);
        }
        self.report_count = self.report_count.saturating_add(1);
        self.last_report = Some((at, sender_clock_at_sending));
    }

    /// Processes the autopilot's acknowledgement of a request.
    pub fn on_acknowledgement(&mut self, at: Timestamp, ack: Acknowledgement) {
        let is_open = self.attempts > 0 && ack.command_number == MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL.0;
        let is_granted = ack.result == MavResult::MAV_RESULT_ACCEPTED.0;
        if !is_open || ack.result == MavResult::MAV_RESULT_IN_PROGRESS.0 {
            return;
        }
        match MESSAGE_REQUESTS.get(self.request_index) {
            // Reports are counted from the acceptance on.
            Some(MessageRequest::Attitude(_)) if is_granted => self.restart_rate_count(at),
            Some(MessageRequest::Attitude(_) | MessageRequest::Message(..)) => {
                self.select_request(self.request_index + 1);
            }
            Some(MessageRequest::Stream(_)) | None => {}
        }
    }

    /// Sends the due request; returns whether one was sent. All are repeated for another autopilot or highest rate.
    pub fn send_due_request(
        &mut self,
        now: Timestamp,
        autopilot: SenderId,
        max_attitude_hz: u8,
        line: &mut Transmitter<'_>,
    ) -> bool {
        if (self.autopilot, self.max_attitude_hz) != (Some(autopilot), max_attitude_hz) {
            *self = Self { autopilot: Some(autopilot), max_attitude_hz, ..Self::default() };
            self.begin_requests(now);
        }
        let is_sent = self.due_request(now).is_some_and(|periodic_request| {
            line.send_message(periodic_request.request_message(Address::from_sender(autopilot)))
        });
        if is_sent {
            self.attempts += 1;
            self.restart_rate_count(now);
        }
        is_sent
    }

    /// Measures the rate of the attitude, then requests everything.
    fn begin_requests(&mut self, now: Timestamp) {
        let is_allowed = |request: &MessageRequest| match request {
            MessageRequest::Attitude(rate_hz) => *rate_hz <= self.max_attitude_hz,
            MessageRequest::Stream(_) | MessageRequest::Message(..) => true,
        };
        self.select_request(MESSAGE_REQUESTS.iter().position(is_allowed).unwrap_or(0));
        self.restart_rate_count(now);
    }

    fn select_request(&mut self, index: usize) {
        (self.request_index, self.attempts) = (index, 0);
    }

    fn restart_rate_count(&mut self, at: Timestamp) {
        (self.report_count_started_at, self.report_count) = (at, 0);
    }

    fn due_request(&mut self, now: Timestamp) -> Option<MessageRequest> {
        let elapsed_us = now.us_since(self.report_count_started_at);
        let periodic_request = MESSAGE_REQUESTS.get(self.request_index);
        if periodic_request.is_none() {
            let silence_us = self.last_report.map_or(elapsed_us, |(at, _)| now.us_since(at));
            if silence_us > ATTITUDE_TIMEOUT_US {
                self.begin_requests(now);
            }
        }
        if elapsed_us < REPLY_TIMEOUT_US {
            return None;
        }
        if periodic_request.is_some_and(|periodic_request| periodic_request.is_satisfied(self.report_count, elapsed_us))
        {
            self.select_request(FIRST_NON_ATTITUDE_INDEX);
        } else if self.attempts >= ATTEMPTS_PER_REQUEST {
            self.select_request(self.request_index + 1);
        }
        MESSAGE_REQUESTS.get(self.request_index).copied()
    }
}

impl MessageRequest {
    /// Whether attitude arrives at 80 % of the requested rate or more; the autopilot's loop and the line lose some
    /// reports.
    fn is_satisfied(self, report_count: u16, elapsed_us: u64) -> bool {
        match self {
            Self::Attitude(rate_hz) | Self::Stream(rate_hz) => {
                u64::from(report_count) * 1_250_000 >= u64::from(rate_hz) * elapsed_us
            }
            Self::Message(..) => false,
        }
    }

    fn request_message(self, autopilot: Address) -> OutboundMessage {
        match self {
            Self::Attitude(rate_hz) => OutboundMessage::set_message_interval(autopilot, ATTITUDE_DATA::ID, rate_hz),
            Self::Stream(rate_hz) => OutboundMessage::request_attitude_stream(autopilot, rate_hz),
            Self::Message(id, rate_hz) => OutboundMessage::set_message_interval(autopilot, id, rate_hz),
        }
    }
}
