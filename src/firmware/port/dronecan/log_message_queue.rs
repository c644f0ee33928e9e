//! Texts for people, as LogMessage: what the module reports, and changes of its state.

use core::fmt::Write as _;

use crate::port::bounded_text::BoundedText;
use crate::port::message_schedule::MessageSchedule;
use crate::port::snapshot::Snapshot;
use crate::wire::dronecan::Payload;
use crate::wire::dronecan::outbound::{LogLevel, MAX_LOG_TEXT_LENGTH, log_message};
use autoswing::heading::NoHeading;
use autoswing::time::Timestamp;
use autoswing_module::compass::IndicatorState;
use autoswing_module::messages::{Message, Severity};

/// Name of the source in LogMessage.
const LOG_SOURCE: &str = "autoswing";

/// Capacity of the queue, texts: a full queue drops its oldest.
const QUEUE_CAPACITY: usize = 3;

/// Rate at which the pieces of texts are sent, Hz.
const LOG_MESSAGE_HZ: u8 = 10;

/// Time after which a state that lasts is reported, microseconds.
const MIN_STATE_DURATION_US: u64 = 2_000_000;

#[derive(Debug)]
struct QueuedText {
    log_level: LogLevel,
    characters: BoundedText,
    /// Number of bytes of the text already sent.
    sent_byte_count: usize,
}

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
    queued_texts: heapless::Deque<QueuedText, QUEUE_CAPACITY>,
    schedule: MessageSchedule,
    last_logged_state: Option<LoggedState>,
    /// State that differs from the last reported one, and since when.
    pending_state: Option<(LoggedState, Timestamp)>,
}

impl LogMessageQueue {
    /// Queues a message.
    pub fn push_message(&mut self, message: &Message) {
        let level = match message.severity() {
            Severity::Info => LogLevel::Info,
            Severity::Warning => LogLevel::Warning,
        };
        self.queue_text(level, format_args!("{message}"));
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
        match state.no_field_reason {
            // Without attitude nothing is collected: by MAVLink's tunnel, or on a serial port.
            _ if state.lacks_attitude => self.queue_text(
                LogLevel::Warning,
                format_args!("armed, and no attitude arrives: set up the tunnel, CAN_D1_UC_S1_NOD this node's number"),
            ),
            None => self.queue_text(LogLevel::Info, format_args!("{}", state.activity)),
            Some(reason) => {
                self.queue_text(
                    LogLevel::Warning,
                    format_args!("{}; no field: {}", state.activity, reason.stable_code()),
                );
            }
        }
    }

    fn queue_text(&mut self, level: LogLevel, text: core::fmt::Arguments<'_>) {
        let mut characters = BoundedText::default();
        let _ = characters.write_fmt(text);
        if self.queued_texts.is_full() {
            self.queued_texts.pop_front();
        }
        let _ = self.queued_texts.push_back(QueuedText { log_level: level, characters, sent_byte_count: 0 });
    }

    /// Next piece of a text, if due. A longer text is continued in the next message.
    pub fn next_log_message(&mut self, now: Timestamp) -> Option<Payload> {
        let text = self.queued_texts.front_mut()?;
        if !self.schedule.is_due(now, LOG_MESSAGE_HZ) {
            return None;
        }
        let rest = text.characters.bytes().get(text.sent_byte_count..).unwrap_or_default();
        let piece = rest.get(..MAX_LOG_TEXT_LENGTH).unwrap_or(rest);
        let payload = log_message(text.log_level, LOG_SOURCE, piece);
        text.sent_byte_count += piece.len();
        if piece.len() == rest.len() {
            self.queued_texts.pop_front();
        }
        Some(payload)
    }
}
