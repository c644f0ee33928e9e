//! Simulated autopilot that answers MSP requests and receives compass samples.
//!
//! The encoding of its replies, with the signs and lengths of each firmware, is independent of the library, so that
//! errors of the library are detected. An answer contains the autopilot's state at the time of sending.

mod frame;
mod settings;

use std::collections::VecDeque;

pub use self::frame::{AutopilotState, MspFirmware};
pub use self::settings::InavSettings;

use self::frame::{MspRequest, RequestReader};
use crate::random::{RandomStream, StreamPurpose};
use testkit::frames::msp_frame;

/// Probabilities (0 to 1) of communication faults per answer. At most one fault occurs per answer.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct AnswerFaults {
    /// Probability of no answer.
    pub drop_probability: f64,
    /// Probability of an error frame.
    pub rejection_probability: f64,
    /// Probability of a truncated answer.
    pub truncation_probability: f64,
    /// Probability that an answer is delayed until the next one and sent with it.
    pub delay_probability: f64,
}

impl AnswerFaults {
    /// No faults.
    pub const NO_FAULTS: Self =
        Self { drop_probability: 0.0, rejection_probability: 0.0, truncation_probability: 0.0, delay_probability: 0.0 };
}

/// Received compass sample.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CompassSample {
    /// Reception time of the last byte, microseconds.
    pub received_at_us: u64,
    /// Time stamp of the compass's own clock, milliseconds.
    pub time_ms: u32,
    /// Field forward, right, down, milligauss.
    pub field_mg: [i16; 3],
}

/// Shortest and longest delay from request to answer observed with ArduPilot, milliseconds.
const ANSWER_DELAY_RANGE_MS: (f64, f64) = (3.5, 18.0);

/// MSP autopilot.
#[derive(Clone, Debug)]
pub struct MspAutopilot {
    firmware: MspFirmware,
    answer_faults: AnswerFaults,
    random: RandomStream,
    request_reader: RequestReader,
    /// Pending requests with answer time, in order of reception.
    waiting_requests: VecDeque<(u64, MspRequest)>,
    held_bytes: Vec<u8>,
    compass_samples: Vec<CompassSample>,
    /// Settings of INAV.
    pub settings: InavSettings,
    /// Number of restarts by request.
    pub restart_count: u32,
}

impl MspAutopilot {
    /// An autopilot that was just switched on.
    #[must_use]
    pub fn new(firmware: MspFirmware, answer_faults: AnswerFaults, seed: u64) -> Self {
        Self {
            firmware,
            answer_faults,
            random: RandomStream::new(seed, StreamPurpose::Msp),
            request_reader: RequestReader::default(),
            waiting_requests: VecDeque::new(),
            held_bytes: Vec::new(),
            compass_samples: Vec::new(),
            settings: InavSettings::new(),
            restart_count: 0,
        }
    }

    /// Processes a byte received at `at_us`.
    pub fn receive_byte(&mut self, at_us: u64, byte: u8) {
        let Some(request) = self.request_reader.push_byte(byte) else { return };
        if let Some((time_ms, field_mg)) = request.compass_sample() {
            self.compass_samples.push(CompassSample { received_at_us: at_us, time_ms, field_mg });
        } else if !request.is_sensor_function() {
            let delay_us = 1e3 * self.random.uniform(ANSWER_DELAY_RANGE_MS.0, ANSWER_DELAY_RANGE_MS.1);
            // Requests are answered in order.
            let after_us = self.waiting_requests.back().map_or(0, |(due_us, _)| *due_us);
            self.waiting_requests.push_back((after_us.max(at_us + delay_us as u64), request));
        }
    }

    /// Bytes of all answers due by `now_us`, with the present state.
    pub fn due_reply_bytes(&mut self, now_us: u64, autopilot_state: &AutopilotState) -> Vec<u8> {
        let mut sent_bytes = Vec::new();
        while let Some((_, request)) = self.waiting_requests.pop_front_if(|(due_us, _)| *due_us <= now_us) {
            let reply = self.reply_payload(&request, autopilot_state);
            self.send_with_faults(reply, request.function_code, &mut sent_bytes);
        }
        sent_bytes
    }

    /// Returns and clears the received compass samples.
    pub fn take_compass_samples(&mut self) -> Vec<CompassSample> {
        std::mem::take(&mut self.compass_samples)
    }

    /// Payload of the reply; `None` for an error frame.
    fn reply_payload(&mut self, request: &MspRequest, autopilot_state: &AutopilotState) -> Option<Vec<u8>> {
        if self.firmware == MspFirmware::ArduPilot {
            // ArduPilot acknowledges unknown functions.
            let reply = frame::reply_payload(self.firmware, request.function_code, autopilot_state);
            return Some(reply.unwrap_or_default());
        }
        match request.function_code {
            frame::SETTING_INFO => self.settings.info(&request.payload),
            frame::SET_SETTING => self.settings.change(&request.payload).map(|()| Vec::new()),
            frame::EEPROM_WRITE if !autopilot_state.is_armed => {
                self.settings.save();
                Some(Vec::new())
            }
            frame::REBOOT => {
                self.restart_count += 1;
                self.settings.load();
                Some(Vec::new())
            }
            function => frame::reply_payload(self.firmware, function, autopilot_state),
        }
    }

    fn send_with_faults(&mut self, reply: Option<Vec<u8>>, function_code: u16, sent_bytes: &mut Vec<u8>) {
        let AnswerFaults { drop_probability, rejection_probability, truncation_probability, delay_probability } =
            self.answer_faults;
        // A uniform random number selects the fault by cumulative probability.
        let draw = self.random.uniform(0.0, 1.0);
        if draw < drop_probability {
            return;
        }
        let answer_start = drop_probability + rejection_probability;
        let is_error = draw < answer_start;
        let mut bytes = match reply.filter(|_| !is_error) {
            Some(payload) => msp_frame(b'>', function_code, &payload),
            None => msp_frame(b'!', function_code, &[]),
        };
        if !is_error && draw < answer_start + truncation_probability {
            bytes.truncate((self.random.random_bits() % bytes.len() as u64) as usize);
        } else if !is_error && draw < answer_start + truncation_probability + delay_probability {
            self.held_bytes.append(&mut bytes);
            return;
        }
        sent_bytes.append(&mut self.held_bytes);
        sent_bytes.append(&mut bytes);
    }
}

#[cfg(test)]
pub(super) mod tests;
