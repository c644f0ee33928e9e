//! Attitude in time: from reports that arrive late and in steps to the attitude at the instant of a measurement.

mod clock;
mod senders;

use core::f32::consts::FRAC_PI_2;

use crate::frames::{Attitude, wrap_pi};
use crate::time::{Timestamp, WrappingMillis};
use crate::trig;
use clock::SenderClock;
pub use senders::{Heartbeat, Senders, Source};

/// Fixed numbers of this module.
#[derive(Clone, Copy, Debug)]
pub struct Config {
    /// How old a report's attitude is when its last byte has arrived, microseconds. Autopilots estimate, schedule and
    /// send within about 20 ms; an error of 10 ms costs 0.3 deg of bank while it changes by 30 deg/s, nothing in a
    /// turn.
    pub latency_us: u32,
    /// An attitude is not extrapolated further than this: a source of 10 Hz with one report lost. A turn entry, with
    /// its 30 deg/s of roll beginning just then, is 6 deg off by the end of it.
    pub max_extrapolation_us: u32,
    /// Two reports further apart than this are not interpolated between.
    pub max_gap_us: u32,
    /// If arrival differs from the sender's clock by more than this, the sender has rebooted or has no clock.
    pub max_clock_error_us: u32,
    /// How fast the estimate of the clock offset may grow, microseconds a report: 50 reports a second follow a
    /// drift of 500 ppm, ten times that of two bad crystals.
    pub clock_leak_us: u32,
}

impl Config {
    /// Numbers for MAVLink autopilots.
    pub const DEFAULT: Self = Self {
        latency_us: 20_000,
        max_extrapolation_us: 200_000,
        max_gap_us: 250_000,
        max_clock_error_us: 100_000,
        clock_leak_us: 10,
    };
}

/// What an attitude source reports, its yaw left out: that is what the module is asked for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Report {
    /// Who sent it.
    pub source: Source,
    /// The sender's clock when it was sent. Some senders have none and leave it 0.
    pub sender_time: WrappingMillis,
    /// Roll and pitch.
    pub attitude: Attitude,
    /// Body rates p, q, r, rad/s; zero where the sender gave none.
    pub rates_rad_s: [f32; 3],
}

/// A report with the instant at which its attitude was true.
#[derive(Clone, Copy, Debug)]
struct Stamped {
    at: Timestamp,
    report: Report,
}

/// Attitude at an asked instant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Lookup {
    /// Between two reports.
    Interpolated(Attitude),
    /// Later than the newest report: carried on with its rates.
    Extrapolated(Attitude),
    /// Before the oldest report kept, or inside a gap: there will never be an attitude for this instant.
    Missing,
    /// Later than the newest report by more than may be extrapolated, or no report yet.
    Stale,
}

/// The last few reports on the module's clock.
#[derive(Debug)]
pub struct Track {
    config: Config,
    reports: heapless::Deque<Stamped, 8>,
    clock: SenderClock,
}

impl Track {
    /// No reports yet.
    #[must_use]
    pub const fn new(config: Config) -> Self {
        Self { config, reports: heapless::Deque::new(), clock: SenderClock::new() }
    }

    /// Takes a report whose last byte arrived at `arrival`.
    pub fn push(&mut self, arrival: Timestamp, report: Report) {
        if self.reports.back().is_some_and(|last| last.report.source != report.source) {
            // Another sender has another clock and another attitude: nothing leads from one to the other.
            *self = Self::new(self.config);
        }
        let sent = self.clock.sent_at(arrival, report.sender_time, &self.config);
        let at = sent.minus_us(u64::from(self.config.latency_us));
        // A report that is not newer than the last says nothing new; one from a rebooted sender starts afresh.
        if self.reports.back().is_some_and(|last| last.at >= at) {
            return;
        }
        if self.reports.is_full() {
            self.reports.pop_front();
        }
        // There is room: one was just taken out if there was none.
        let _ = self.reports.push_back(Stamped { at, report });
    }

    /// The attitude at an instant.
    #[must_use]
    pub fn at(&self, at: Timestamp) -> Lookup {
        let Some(newest) = self.reports.back() else { return Lookup::Stale };
        match at.us_since(newest.at) {
            0 if at == newest.at => return Lookup::Interpolated(newest.report.attitude),
            0 => {}
            ahead_us if ahead_us <= u64::from(self.config.max_extrapolation_us) => {
                return Lookup::Extrapolated(extrapolate(&newest.report, ahead_us as f32 * 1e-6));
            }
            _ => return Lookup::Stale,
        }
        let mut pairs = self.reports.iter().zip(self.reports.iter().skip(1));
        pairs
            .find(|(before, after)| (before.at..after.at).contains(&at))
            .and_then(|(before, after)| self.between(before, after, at))
            .map_or(Lookup::Missing, Lookup::Interpolated)
    }

    /// Between two reports, unless they are too far apart.
    fn between(&self, before: &Stamped, after: &Stamped, at: Timestamp) -> Option<Attitude> {
        let gap_us = after.at.us_since(before.at);
        let fraction = at.us_since(before.at) as f32 / gap_us as f32;
        (at == before.at || gap_us <= u64::from(self.config.max_gap_us))
            .then(|| interpolate(&before.report, &after.report, fraction))
    }
}

/// Linear between two reports, the short way round in roll.
fn interpolate(before: &Report, after: &Report, fraction: f32) -> Attitude {
    let (a, b) = (before.attitude, after.attitude);
    Attitude {
        roll_rad: wrap_pi(a.roll_rad + fraction * wrap_pi(b.roll_rad - a.roll_rad)),
        pitch_rad: a.pitch_rad + fraction * (b.pitch_rad - a.pitch_rad),
    }
}

/// Carries a report on with its body rates p, q, r:
/// `roll' = p + tan(pitch) (q sin(roll) + r cos(roll))`, `pitch' = q cos(roll) - r sin(roll)`.
fn extrapolate(report: &Report, ahead_s: f32) -> Attitude {
    let Attitude { roll_rad, pitch_rad } = report.attitude;
    let [p, q, r] = report.rates_rad_s;
    let (sin_roll, cos_roll) = trig::sin_cos(roll_rad);
    // tan grows without bound at a vertical nose, where roll means nothing anyway.
    let (sin_pitch, cos_pitch) = trig::sin_cos(pitch_rad);
    let tan_pitch = (sin_pitch / cos_pitch).clamp(-5.0, 5.0);
    let roll_rate = p + tan_pitch * (q * sin_roll + r * cos_roll);
    let pitch_rate = q * cos_roll - r * sin_roll;
    Attitude {
        roll_rad: wrap_pi(roll_rad + roll_rate * ahead_s),
        pitch_rad: (pitch_rad + pitch_rate * ahead_s).clamp(-FRAC_PI_2, FRAC_PI_2),
    }
}

#[cfg(test)]
mod tests;
