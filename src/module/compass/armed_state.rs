//! Armed state. A report of disarming ends a flight once the vehicle is at rest, so that a forged one cannot interrupt
//! it.

use autoswing::calibration::Sample;
use autoswing::frames::{Field, Sensor};
use autoswing::time::WrappingMillis;
use autoswing::trig::VectorLength as _;

/// Time without motion after which a vehicle is at rest, milliseconds. In level flight and in hover, turbulence exceeds
/// the limit within this time.
const MIN_REST_MS: u32 = 5_000;

/// Longest interval between samples at rest, milliseconds.
const MAX_GAP_MS: u32 = 1_000;

/// Largest change of the field at rest, microtesla: six times the noise of a sample, or 1 deg of rotation.
const MAX_FIELD_CHANGE_UT: f32 = 0.7;

/// Number of samples (5 s) after which no armed state is expected; autopilots send heartbeats at 1 Hz.
const REPORT_TIMEOUT_SAMPLES: u8 = 50;

/// Reported armed state, and the evidence for rest.
#[derive(Debug)]
pub(super) struct ArmedState {
    reported_state: Option<bool>,
    /// Number of samples since start-up, saturating at the timeout.
    samples_since_startup: u8,
    /// Whether the vehicle moved while armed, and has not been at rest while disarmed since.
    has_flown_since_rest: bool,
    /// Field of the first sample at rest; times of the first and the last one.
    rest_evidence: Option<(Field<Sensor>, WrappingMillis, WrappingMillis)>,
}

impl ArmedState {
    pub const UNKNOWN: Self =
        Self { reported_state: None, samples_since_startup: 0, has_flown_since_rest: false, rest_evidence: None };

    /// Armed state by the autopilot's last report, if known.
    pub const fn reported_state(&self) -> Option<bool> {
        self.reported_state
    }

    /// Processes the autopilot's report; `None` without a recent one.
    pub const fn update_reported(&mut self, reported: Option<bool>) {
        self.reported_state = reported;
    }

    /// Whether the vehicle is armed, or the armed state is unavailable.
    pub fn is_assumed_armed(&self) -> bool {
        self.reported_state.unwrap_or(self.samples_since_startup == REPORT_TIMEOUT_SAMPLES)
    }

    /// Updates the evidence for rest, and the count of samples.
    pub fn update_motion(&mut self, sample: &Sample) {
        self.samples_since_startup = self.samples_since_startup.saturating_add(1).min(REPORT_TIMEOUT_SAMPLES);
        let is_steady = |(field, _, last): &(Field<Sensor>, WrappingMillis, WrappingMillis)| {
            (sample.field.ut - field.ut).vector_length() <= MAX_FIELD_CHANGE_UT
                && sample.time.ms_since(*last) <= MAX_GAP_MS
        };
        let steady = self.rest_evidence.filter(is_steady);
        self.has_flown_since_rest |=
            self.reported_state == Some(true) && self.rest_evidence.is_some() && steady.is_none();
        let (field, since, _) = steady.unwrap_or((sample.field, sample.time, sample.time));
        self.rest_evidence = Some((field, since, sample.time));
        self.has_flown_since_rest &= self.reported_state != Some(false) || sample.time.ms_since(since) < MIN_REST_MS;
    }

    /// Whether the vehicle is armed, or has flown and still moves. Without samples there is no evidence of motion.
    pub fn is_in_flight(&self, now: WrappingMillis) -> bool {
        let has_samples = self.rest_evidence.is_some_and(|(_, _, last)| now.ms_since(last) <= MIN_REST_MS);
        match self.reported_state {
            Some(is_armed) => is_armed || (self.has_flown_since_rest && has_samples),
            None => false,
        }
    }
}
