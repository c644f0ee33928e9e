//! Asks an autopilot for what the module needs of it.
//!
//! ArduPilot sends next to nothing to who does not ask, and denies what its main loop cannot do: 50 attitudes a second on
//! an aeroplane. So the module asks for less and less until it gets what it asks for; who knows no such command is asked in
//! the old way. It never asks oftener than once a second.

use ::mavlink::MessageData;
use ::mavlink::dialects::common::{
    ATTITUDE_DATA, GLOBAL_POSITION_INT_DATA, MavCmd, MavResult, SYS_STATUS_DATA, SYSTEM_TIME_DATA,
};

use super::Line;
use crate::attitude::Source;
use crate::time::{Timestamp, WrappingMillis};
use crate::wire::mavlink::{Acknowledgement, Address, Outgoing};

/// Something to ask for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Wish {
    /// ATTITUDE, so many times a second.
    Attitude(u8),
    /// The stream that it belongs to, so many times a second: what every autopilot that knows streams can do.
    Stream(u8),
    /// Another message by its number, so many times a second.
    Message(u32, u8),
}

/// In the order in which they are tried: what helps the calibration, then what the Earth's field is known by.
const WISHES: [Wish; 8] = [
    Wish::Attitude(50),
    Wish::Attitude(40),
    Wish::Attitude(25),
    Wish::Attitude(20),
    Wish::Stream(25),
    Wish::Message(SYS_STATUS_DATA::ID, CURRENT_HZ),
    Wish::Message(GLOBAL_POSITION_INT_DATA::ID, 1),
    Wish::Message(SYSTEM_TIME_DATA::ID, 1),
];

/// A copter's current is another one after half a second.
const CURRENT_HZ: u8 = 10;

/// Where the wishes for attitude end.
const AFTER_ATTITUDE: usize = 5;

/// A request is answered, and what is asked for comes, within this time, microseconds; and a request is not sent sooner
/// after another.
const PATIENCE_US: u64 = 1_000_000;

/// How often something is asked for that does not come.
const ATTEMPTS: u8 = 2;

/// Without attitude for longer than this, microseconds, everything is asked for again.
const SILENCE_US: u64 = 2_000_000;

/// An autopilot whose clock goes back by more than this, milliseconds, has restarted, and forgotten what it was asked for.
const RESTART_MS: i32 = 1_000;

/// What was asked for, and what came of it.
#[derive(Debug, Default)]
pub(super) struct Asking {
    /// Who is asked.
    autopilot: Option<Source>,
    /// The wish that is asked for now, or that is next: of [`WISHES`], past the end when there is none.
    wish: usize,
    /// How often it was asked for.
    attempts: u8,
    /// When it was asked for, or granted: from then on reports are counted.
    since: Timestamp,
    reports: u16,
    /// When the last report of attitude came, and its sender's clock.
    last: Option<(Timestamp, WrappingMillis)>,
}

impl Asking {
    /// A report of the attitude that is believed has come.
    pub fn reported(&mut self, at: Timestamp, sender_time: WrappingMillis) {
        if self.last.is_some_and(|(_, before)| before.difference(sender_time) > RESTART_MS) {
            self.begin(at);
        }
        self.reports = self.reports.saturating_add(1);
        self.last = Some((at, sender_time));
    }

    /// The autopilot has answered a command of this component.
    pub fn acknowledged(&mut self, at: Timestamp, ack: Acknowledgement) {
        let is_open = self.attempts > 0 && ack.command == MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL as u16;
        let is_granted = ack.result == MavResult::MAV_RESULT_ACCEPTED as u8;
        if !is_open || ack.result == MavResult::MAV_RESULT_IN_PROGRESS as u8 {
            return;
        }
        match WISHES.get(self.wish) {
            // Now it has to come.
            Some(Wish::Attitude(_)) if is_granted => self.count_from(at),
            Some(Wish::Attitude(_) | Wish::Message(..)) => self.go_on_to(self.wish + 1),
            Some(Wish::Stream(_)) | None => {}
        }
    }

    /// Sends the request that is due; whether there was one, and room for it.
    pub fn tell(&mut self, now: Timestamp, autopilot: Source, line: &mut Line<'_>) -> bool {
        if self.autopilot != Some(autopilot) {
            *self = Self { autopilot: Some(autopilot), ..Self::default() };
            self.begin(now);
        }
        let is_sent = self.due(now).is_some_and(|wish| line.send(wish.request(Address::of(autopilot))));
        if is_sent {
            self.attempts += 1;
            self.count_from(now);
        }
        is_sent
    }

    /// Looks how often attitude comes, then asks for everything.
    fn begin(&mut self, now: Timestamp) {
        self.go_on_to(0);
        self.count_from(now);
    }

    fn go_on_to(&mut self, wish: usize) {
        (self.wish, self.attempts) = (wish, 0);
    }

    fn count_from(&mut self, at: Timestamp) {
        (self.since, self.reports) = (at, 0);
    }

    fn due(&mut self, now: Timestamp) -> Option<Wish> {
        let elapsed_us = now.us_since(self.since);
        let wish = WISHES.get(self.wish);
        if wish.is_none() {
            let heard_us = self.last.map_or(elapsed_us, |(at, _)| now.us_since(at));
            if heard_us > SILENCE_US {
                self.begin(now);
            }
        }
        if elapsed_us < PATIENCE_US {
            return None;
        }
        if wish.is_some_and(|wish| wish.has_come(self.reports, elapsed_us)) {
            self.go_on_to(AFTER_ATTITUDE);
        } else if self.attempts >= ATTEMPTS {
            self.go_on_to(self.wish + 1);
        }
        WISHES.get(self.wish).copied()
    }
}

impl Wish {
    /// Whether so many reports of attitude in this time are what was wished for: 80 % of it, for what the autopilot's
    /// loop or the line swallow.
    fn has_come(self, reports: u16, elapsed_us: u64) -> bool {
        match self {
            Self::Attitude(rate_hz) | Self::Stream(rate_hz) => {
                u64::from(reports) * 1_250_000 >= u64::from(rate_hz) * elapsed_us
            }
            Self::Message(..) => false,
        }
    }

    fn request(self, autopilot: Address) -> Outgoing {
        match self {
            Self::Attitude(rate_hz) => Outgoing::set_message_interval(autopilot, ATTITUDE_DATA::ID, rate_hz),
            Self::Stream(rate_hz) => Outgoing::request_attitude_stream(autopilot, rate_hz),
            Self::Message(id, rate_hz) => Outgoing::set_message_interval(autopilot, id, rate_hz),
        }
    }
}
