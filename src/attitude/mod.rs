//! Attitude in time: from reports that arrive late and in steps to the attitude at the instant of a measurement.

mod clock;
mod plausibility;
mod senders;

use core::f32::consts::FRAC_PI_2;

use crate::frames::{Attitude, Body, Field, wrap_pi};
use crate::time::{Timestamp, WrappingMillis};
use crate::trig;
use clock::SenderClock;
use plausibility::{Freeze, Spikes};
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

impl Report {
    /// Whether its source gives rates: those of what moves are never all nothing.
    fn has_rates(&self) -> bool {
        self.rates_rad_s.iter().any(|rate_rad_s| rate_rad_s.abs() > 0.0)
    }
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
    /// The source repeats itself: what it says now is not known.
    Frozen,
}

/// Reports that were not believed so far; each wraps.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Doubted {
    /// Too far from where the ones before lead to.
    pub spikes: u32,
    /// Of a source that repeats itself.
    pub frozen: u32,
}

impl Doubted {
    /// All were believed.
    pub const NONE: Self = Self { spikes: 0, frozen: 0 };
}

/// The last few reports on the module's clock, without those that cannot be true.
#[derive(Debug)]
pub struct Track {
    config: Config,
    reports: heapless::Deque<Stamped, 8>,
    clock: SenderClock,
    spikes: Spikes,
    freeze: Freeze,
    doubted: Doubted,
}

impl Track {
    /// No reports yet.
    #[must_use]
    pub const fn new(config: Config) -> Self {
        Self {
            config,
            reports: heapless::Deque::new(),
            clock: SenderClock::new(),
            spikes: Spikes::new(),
            freeze: Freeze::new(),
            doubted: Doubted::NONE,
        }
    }

    /// Takes a report whose last byte arrived at `arrival`.
    pub fn push(&mut self, arrival: Timestamp, report: Report) {
        if self.reports.back().is_some_and(|last| last.report.source != report.source) {
            // Another sender has another clock and another attitude: nothing leads from one to the other.
            *self = Self { doubted: self.doubted, ..Self::new(self.config) };
        }
        let sent = self.clock.sent_at(arrival, report.sender_time, &self.config);
        let at = sent.minus_us(u64::from(self.config.latency_us));
        // A report that is not newer than the last says nothing new; one from a rebooted sender starts afresh.
        if self.reports.back().is_some_and(|last| last.at >= at) {
            return;
        }
        self.freeze.see(at, &report);
        if self.freeze.frozen_at().is_some() {
            self.doubted.frozen = self.doubted.frozen.wrapping_add(1);
            return;
        }
        let max_gap_us = u64::from(self.config.max_gap_us);
        let last = self.reports.back().filter(|last| at.us_since(last.at) <= max_gap_us);
        if self.spikes.see(last, at, report.attitude) {
            self.doubted.spikes = self.doubted.spikes.wrapping_add(1);
            return;
        }
        if self.reports.is_full() {
            self.reports.pop_front();
        }
        // There is room: one was just taken out if there was none.
        let _ = self.reports.push_back(Stamped { at, report });
    }

    /// Takes the corrected field of a reading: one that turns while the reports repeat shows that they are frozen.
    pub fn see_field(&mut self, field: Field<Body>) {
        self.freeze.see_field(field);
    }

    /// How fast the aircraft turns about any axis by the newest report, radians a second; none where the source gives
    /// no rates.
    #[must_use]
    pub fn turning_rad_s(&self) -> Option<f32> {
        let report = &self.reports.back()?.report;
        let [p, q, r] = report.rates_rad_s;
        report.has_rates().then(|| libm::sqrtf(p * p + q * q + r * r))
    }

    /// Reports that were not believed so far.
    #[must_use]
    pub const fn doubted(&self) -> Doubted {
        self.doubted
    }

    /// The attitude at an instant.
    #[must_use]
    pub fn at(&self, at: Timestamp) -> Lookup {
        let Some(newest) = self.reports.back() else { return Lookup::Stale };
        match at.us_since(newest.at) {
            0 if at == newest.at => return Lookup::Interpolated(newest.report.attitude),
            0 => {}
            _ if self.repeats_at(at) => return Lookup::Frozen,
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

    /// Whether reports come, and are all the same.
    fn repeats_at(&self, at: Timestamp) -> bool {
        let max_age_us = u64::from(self.config.max_extrapolation_us);
        self.freeze.frozen_at().is_some_and(|frozen_at| at.us_since(frozen_at) <= max_age_us)
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
