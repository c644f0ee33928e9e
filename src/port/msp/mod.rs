//! MSP: the corrected field goes to the autopilot as its compass, and the autopilot is asked for its attitude.
//!
//! The field goes out from power-up, so that the autopilot finds its compass, and is not sent while it is not to be
//! trusted: the autopilot then does what it does without a compass.
//!
//! One request for the attitude is under way at a time, so that an answer is as young as it can be: autopilots answer in
//! 3.5 to 18 ms. As long as it is not known which firmware it is, and so which signs an attitude has, that is asked
//! instead. The others are asked about once a second, one after the other, the current between every two of them, and nobody
//! waits for their answers. The firmware stays one of them: an autopilot can be exchanged while the module runs.

use super::{Facts, Heard, Output, Pace, Protocol};
use crate::attitude::{Report, Source};
use crate::time::{Timestamp, WrappingMillis};
use crate::wire::msp::{Angles, Firmware, Function, Message, Receiver, compass, request};

/// Readings of the compass a second: INAV forgets a compass after 250 ms, ArduPilot after 500 ms, and ArduPilot's filter
/// takes ten a second.
const COMPASS_HZ: u8 = 50;

/// Requests for the attitude a second, at most.
const ATTITUDE_HZ: u8 = 50;

/// Requests for anything else a second: each of them about once, the current four times.
const OTHERS_HZ: u8 = OTHERS.len() as u8;

/// What is asked for now and then.
const OTHERS: [Function; 8] = [
    Function::Status,
    Function::Analog,
    Function::RawGps,
    Function::Analog,
    Function::Rtc,
    Function::Analog,
    Function::FcVariant,
    Function::Analog,
];

/// An answer that has not come after so long does not come, microseconds: nearly three times the longest that was seen.
const ANSWERED_WITHIN_US: u64 = 50_000;

/// What the autopilot said of itself is forgotten after so long a silence, microseconds: ten answers.
const MEMORY_US: u64 = 10_000_000;

/// The only compass on this line.
const INSTANCE: u8 = 0;

/// MSP with an autopilot.
#[derive(Debug, Default)]
pub struct Msp {
    receiver: Receiver,
    firmware: Option<Firmware>,
    armed: Option<(Timestamp, bool)>,
    /// When the attitude was asked for that has not come yet, or the firmware.
    asked_at: Option<Timestamp>,
    compass: Pace,
    attitude: Pace,
    others: Pace,
    /// Which of the others is asked for next.
    next: usize,
}

impl Msp {
    /// Nothing said, nothing heard.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            receiver: Receiver::new(),
            firmware: None,
            armed: None,
            asked_at: None,
            compass: Pace::new(),
            attitude: Pace::new(),
            others: Pace::new(),
            next: 0,
        }
    }

    fn take(&mut self, at: Timestamp, message: Message) -> Option<Heard> {
        if matches!(message, Message::Attitude(_) | Message::Refused(Function::Attitude)) {
            self.asked_at = None;
        }
        match message {
            Message::Attitude(angles) => return self.report(angles),
            Message::RawGps(place) => return place.map(Heard::Place),
            Message::Current(amperes) => return Some(Heard::Current(amperes)),
            Message::Rtc(day) => return day.map(Heard::Day),
            Message::FcVariant(firmware) => self.firmware = Some(firmware),
            Message::Armed(is_armed) => self.armed = Some((at, is_armed)),
            Message::Refused(_) => {}
        }
        None
    }

    fn report(&self, angles: Angles) -> Option<Heard> {
        // There is one sender, without a clock and without rates.
        let (source, sender_time) = (Source::default(), WrappingMillis::new(0));
        let attitude = self.firmware?.attitude(angles)?;
        Some(Heard::Attitude(Report { source, sender_time, attitude, rates_rad_s: [0.0; 3] }))
    }

    /// The next of the others.
    fn other(&mut self) -> Function {
        let [first, ..] = OTHERS;
        let function = OTHERS.get(self.next).copied().unwrap_or(first);
        self.next = (self.next + 1) % OTHERS.len();
        function
    }

    /// What is asked for as often as it is answered; none of an autopilot whose signs are not known.
    fn wanted(&self) -> Option<Function> {
        match self.firmware {
            None => Some(Function::FcVariant),
            Some(Firmware::Other) => None,
            Some(_) => Some(Function::Attitude),
        }
    }

    /// Whether the next of these may be asked for: none is under way, or it does not come.
    fn may_ask(&mut self, now: Timestamp) -> bool {
        if self.asked_at.is_some_and(|at| now.us_since(at) < ANSWERED_WITHIN_US) {
            return false;
        }
        if self.asked_at.take().is_some() {
            // What has begun to come has no end.
            self.receiver.forget();
        }
        true
    }
}

impl Protocol for Msp {
    fn byte(&mut self, at: Timestamp, byte: u8) -> Option<Heard> {
        let message = self.receiver.push(byte)?;
        Some(self.take(at, message).unwrap_or(Heard::Life))
    }

    fn is_armed(&self, now: Timestamp) -> Option<bool> {
        self.armed.filter(|(at, _)| now.us_since(*at) <= MEMORY_US).map(|(_, is_armed)| is_armed)
    }

    fn rejected(&self) -> u32 {
        self.receiver.rejected
    }

    fn poll(&mut self, facts: &Facts<'_>, out: &mut Output) {
        let now = facts.now;
        if let Some(field) = facts.estimate.compass
            && self.compass.is_due(now, COMPASS_HZ)
        {
            out.message(&[&compass(INSTANCE, facts.estimate.at.wrapping_millis().count(), field)]);
        }
        if self.others.is_due(now, OTHERS_HZ) {
            out.message(&[&request(self.other())]);
        }
        if let Some(function) = self.wanted()
            && self.may_ask(now)
            && self.attitude.is_due(now, ATTITUDE_HZ)
        {
            self.asked_at = out.message(&[&request(function)]).then_some(now);
        }
    }
}

#[cfg(test)]
mod tests;
