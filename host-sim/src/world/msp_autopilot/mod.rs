//! An autopilot that answers MSP requests, and takes a compass's readings: bytes in, bytes out.
//!
//! It reads and writes frames by itself, with the signs and lengths that each firmware has, so that a mistake of the
//! library's shows. What it knows is told to it when it is asked for bytes: an answer is of the instant at which it is
//! sent, as an autopilot's is.

mod frame;
#[cfg(test)]
mod tests;

use std::collections::VecDeque;

use self::frame::{Answer, Frames, Request, encode};
use crate::random::{Purpose, Random};

/// Which firmware answers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Firmware {
    /// ArduPilot: pitch nose up.
    ArduPilot,
    /// INAV: pitch nose down.
    Inav,
}

/// What goes wrong, each with its probability for an answer, 0 to 1. The first that befalls it counts.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Troubles {
    /// It does not answer.
    pub dropped: f64,
    /// It answers that it cannot, by an error frame.
    pub refused: f64,
    /// Its answer ends somewhere within.
    pub cut: f64,
    /// Its answer waits for the next one, and comes joined with it.
    pub joined: f64,
}

/// What the autopilot knows at an instant.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Known {
    /// Bank, radians, right wing down positive.
    pub roll_rad: f64,
    /// Pitch, radians, nose up positive.
    pub pitch_rad: f64,
    /// Heading, radians.
    pub yaw_rad: f64,
    /// Whether it is armed.
    pub is_armed: bool,
    /// Latitude and longitude in degrees, north and east positive, and height in metres; none without a fix.
    pub place: Option<(f64, f64, f64)>,
    /// Seconds since 1970, UTC; none if its clock was not set.
    pub unix_s: Option<u64>,
    /// Current of its battery, amperes; none if it does not measure it.
    pub current_a: Option<f64>,
}

/// A reading of the compass, as it came.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CompassReading {
    /// When its last byte came, microseconds.
    pub at_us: u64,
    /// Which compass of several.
    pub instance: u8,
    /// The compass's own clock, milliseconds.
    pub time_ms: u32,
    /// Forward, right, down, milligauss.
    pub field_mg: [i16; 3],
}

/// From a request to its answer, milliseconds: the shortest and the longest that ArduPilot was seen to take.
const DELAY_MS: (f64, f64) = (3.5, 18.0);

/// The autopilot.
#[derive(Clone, Debug)]
pub struct MspAutopilot {
    firmware: Firmware,
    troubles: Troubles,
    random: Random,
    frames: Frames,
    /// What is to be answered, and when. In the order of the requests.
    waiting: VecDeque<(u64, Request)>,
    /// An answer that waits for the next one.
    held: Vec<u8>,
    readings: Vec<CompassReading>,
}

impl MspAutopilot {
    /// An autopilot that has just been switched on.
    #[must_use]
    pub fn new(firmware: Firmware, troubles: Troubles, seed: u64) -> Self {
        let random = Random::new(seed, Purpose::Msp);
        let (frames, waiting) = (Frames::default(), VecDeque::new());
        Self { firmware, troubles, random, frames, waiting, held: Vec::new(), readings: Vec::new() }
    }

    /// Takes a byte that came at an instant, microseconds.
    pub fn take(&mut self, at_us: u64, byte: u8) {
        let Some(request) = self.frames.push(byte) else { return };
        if let Some((instance, time_ms, field_mg)) = request.compass() {
            self.readings.push(CompassReading { at_us, instance, time_ms, field_mg });
        } else if !request.is_of_a_sensor() {
            let delay_us = 1e3 * self.random.uniform(DELAY_MS.0, DELAY_MS.1);
            // One after the other: it does not answer a later request first.
            let after_us = self.waiting.back().map_or(0, |(due_us, _)| *due_us);
            self.waiting.push_back((after_us.max(at_us + delay_us as u64), request));
        }
    }

    /// When it will send next, microseconds; none if nobody waits for anything.
    #[must_use]
    pub fn next_us(&self) -> Option<u64> {
        self.waiting.front().map(|(due_us, _)| *due_us)
    }

    /// What it sends by now, with what it knows now.
    pub fn send(&mut self, now_us: u64, known: &Known) -> Vec<u8> {
        let mut sent = Vec::new();
        while let Some((_, request)) = self.waiting.pop_front_if(|(due_us, _)| *due_us <= now_us) {
            let answer = self.answer(&request, known);
            self.pass_through_trouble(&answer, &request, &mut sent);
        }
        sent
    }

    /// The compass's readings since this was asked last.
    pub fn compass_readings(&mut self) -> Vec<CompassReading> {
        std::mem::take(&mut self.readings)
    }

    /// Frames that came with a wrong CRC.
    #[must_use]
    pub fn broken_frames(&self) -> u32 {
        self.frames.broken
    }

    fn answer(&self, request: &Request, known: &Known) -> Answer {
        frame::payload(self.firmware, request.function, known).map_or(
            match self.firmware {
                // ArduPilot acknowledges what it does not know.
                Firmware::ArduPilot => Answer::Reply(Vec::new()),
                Firmware::Inav => Answer::Error,
            },
            Answer::Reply,
        )
    }

    fn pass_through_trouble(&mut self, answer: &Answer, request: &Request, sent: &mut Vec<u8>) {
        let Troubles { dropped, refused, cut, joined } = self.troubles;
        // The first of the sums that is above it is its fate.
        let fate = self.random.uniform(0.0, 1.0);
        if fate < dropped {
            return;
        }
        let is_refused = fate < dropped + refused;
        let mut bytes = encode(request.function, if is_refused { &Answer::Error } else { answer });
        if !is_refused && fate < dropped + refused + cut {
            bytes.truncate((self.random.bits() % bytes.len() as u64) as usize);
        } else if !is_refused && fate < dropped + refused + cut + joined {
            self.held.append(&mut bytes);
            return;
        }
        sent.append(&mut self.held);
        sent.append(&mut bytes);
    }
}
