//! Texts for people, as LogMessage: what the module reports, and changes of its state.

use crate::port::snapshot::Snapshot;
use crate::port::text_queue::TextQueue;
use crate::wire::dronecan::Payload;
use crate::wire::dronecan::outbound::{MAX_LOG_TEXT_LENGTH, log_message};
use autoswing::heading::NoHeading;
use autoswing::time::Timestamp;
use autoswing_module::compass::IndicatorState;
use autoswing_module::messages::{Message, Severity};

/// Name of the source in LogMessage.
const LOG_SOURCE: &str = "autoswing";

/// Time after which a state that lasts is reported, microseconds.
const MIN_STATE_DURATION_US: u64 = 2_000_000;

/// State that is reported when it changes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct LoggedState {
    activity: &'static str,
    /// Reason why no field is sent.
    no_field_reason: Option<NoHeading>,
    /// Whether the vehicle is armed and no attitude arrives.
    lacks_attitude: bool,
}

/// Queue of texts.
#[derive(Debug, Default)]
pub(super) struct LogMessageQueue {
    queue: TextQueue,
    last_logged_state: Option<LoggedState>,
    /// State that differs from the last reported one, and since when.
    pending_state: Option<(LoggedState, Timestamp)>,
}

impl LogMessageQueue {
    /// Queues a message.
    pub fn push_message(&mut self, message: &Message) {
        self.queue.push_text(message.severity(), format_args!("{message}"));
    }

    /// Queues a text about a state that has changed for two seconds.
    pub fn queue_state_change(&mut self, snapshot: &Snapshot<'_>, is_armed: bool) {
        let state = LoggedState {
            activity: match snapshot.indicator_state {
                IndicatorState::Idle => "uncalibrated",
                IndicatorState::Collecting(_) => "collecting",
                IndicatorState::Calibrated => "calibrated",
                IndicatorState::Refused => "calibration refused",
            },
            no_field_reason: snapshot.estimate.heading.err().filter(|_| snapshot.estimate.compass_field.is_none()),
            lacks_attitude: is_armed && snapshot.estimate.attitude.is_none(),
        };
        if self.last_logged_state == Some(state) {
            self.pending_state = None;
            return;
        }
        let since = self.pending_state.filter(|(candidate, _)| *candidate == state).map_or(snapshot.now, |(_, at)| at);
        self.pending_state = Some((state, since));
        if snapshot.now.us_since(since) < MIN_STATE_DURATION_US {
            return;
        }
        (self.last_logged_state, self.pending_state) = (Some(state), None);
        let (activity, queue) = (state.activity, &mut self.queue);
        match state.no_field_reason {
            // Without attitude nothing is collected: by MAVLink's tunnel, or on a serial port.
            _ if state.lacks_attitude => queue.push_text(
                Severity::Warning,
                format_args!("armed, and no attitude arrives: set up the tunnel, CAN_D1_UC_S1_NOD this node's number"),
            ),
            None => queue.push_text(Severity::Info, format_args!("{activity}")),
            Some(reason) => {
                queue.push_text(Severity::Warning, format_args!("{activity}; no field: {}", reason.stable_code()));
            }
        }
    }

    /// Next piece of a text, if due. A longer text is continued in the next message.
    pub fn next_log_message(&mut self, now: Timestamp) -> Option<Payload> {
        let piece = self.queue.due_piece(now, MAX_LOG_TEXT_LENGTH)?;
        let payload = log_message(piece.severity, LOG_SOURCE, piece.characters);
        let was_last = piece.is_last;
        self.queue.advance(was_last);
        Some(payload)
    }
}
