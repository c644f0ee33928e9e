//! Attitude in time: from reports that arrive late and in steps to the attitude at the instant of a measurement.

mod aligning;
mod clock;
mod lines;
mod motion;
mod plausibility;
mod rates;
mod senders;

use core::f32::consts::FRAC_PI_2;

use crate::frames::{Attitude, Body, Field, Sensor, wrap_pi};
use crate::time::{Timestamp, WrappingMillis};
use aligning::Aligning;
use clock::SenderClock;
pub use lines::Lines;
use motion::Integral;
pub use motion::{Motion, Turning};
use plausibility::{Freeze, Spikes};
use rates::Rates;
pub use senders::{Heartbeat, Senders, Source};

/// Fixed numbers of this module.
#[derive(Clone, Copy, Debug)]
pub struct Config {
    /// How old a report's attitude is when its last byte has arrived, microseconds. Autopilots estimate, schedule and
    /// send within about 20 ms; an error of 10 ms costs 0.3 deg of bank while it changes by 30 deg/s, nothing in a
    /// turn. Negative: the field is older than the attitude, as of a source that averages or filters it.
    pub latency_us: i32,
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
    /// Rates are not integrated over more time than this between two reports: two seconds of them lost in a turn that
    /// is steady leave the heading to a degree or two.
    pub max_integrated_gap_us: u32,
}

impl Config {
    /// Numbers for MAVLink autopilots.
    pub const DEFAULT: Self = Self {
        latency_us: 20_000,
        max_extrapolation_us: 200_000,
        max_gap_us: 250_000,
        max_clock_error_us: 100_000,
        clock_leak_us: 10,
        max_integrated_gap_us: 2_000_000,
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
    /// Whether its source gives rates: those of what moves are never all nothing, and no gyro reads more than
    /// [`MAX_RATE_RAD_S`].
    pub(crate) fn has_rates(&self) -> bool {
        self.rates_rad_s.iter().any(|rate_rad_s| rate_rad_s.abs() > 0.0)
            && self.rates_rad_s.iter().all(|rate_rad_s| rate_rad_s.abs() <= MAX_RATE_RAD_S)
    }

    /// How fast it turns about any axis, radians a second; none where the source gives no rates.
    fn turning_rad_s(&self) -> Option<f32> {
        let [p, q, r] = self.rates_rad_s;
        self.has_rates().then(|| libm::sqrtf(p * p + q * q + r * r))
    }
}

/// 2,000 deg/s, where the gyros of autopilots end, and a little.
const MAX_RATE_RAD_S: f32 = 36.0;

/// A report with the instant at which it was sent, and the integral of its rates up to there.
#[derive(Clone, Copy, Debug)]
struct Stamped {
    at: Timestamp,
    report: Report,
    integral: Integral,
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
    /// The source still seeks its attitude.
    Aligning,
}

/// Reports that were not believed so far; each wraps.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Doubted {
    /// Too far from where the ones before lead to.
    pub spikes: u32,
    /// Of a source that repeats itself.
    pub frozen: u32,
    /// Whose body rates contradict their attitude: they were taken without.
    pub rates: u32,
}

impl Doubted {
    /// All were believed.
    pub const NONE: Self = Self { spikes: 0, frozen: 0, rates: 0 };
}

/// The last few reports on the module's clock, without those that cannot be true.
#[derive(Debug)]
pub struct Track {
    config: Config,
    reports: heapless::Deque<Stamped, 8>,
    clock: SenderClock,
    spikes: Spikes,
    freeze: Freeze,
    aligning: Aligning,
    /// The last report of a source that still seeks its attitude, until it has found it.
    aligning_at: Option<Timestamp>,
    rates: Rates,
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
            aligning: Aligning::new(),
            aligning_at: None,
            rates: Rates::NOTHING,
            doubted: Doubted::NONE,
        }
    }

    /// Takes a report whose last byte arrived at `arrival`.
    pub fn push(&mut self, arrival: Timestamp, mut report: Report) {
        if self.reports.back().is_some_and(|last| last.report.source != report.source) {
            // Another sender has another clock and another attitude: nothing leads from one to the other.
            *self = Self { doubted: self.doubted, ..Self::new(self.config) };
        }
        let at = self.clock.sent_at(arrival, report.sender_time, &self.config);
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
        // Rates that are known to be wrong tell of nothing.
        let is_aligning = self.aligning.see(at, &report) && !self.rates.contradict();
        self.aligning_at = is_aligning.then_some(at);
        if is_aligning {
            return;
        }
        if self.rates.see(at, &report) {
            self.doubted.rates = self.doubted.rates.wrapping_add(1);
            report.rates_rad_s = [0.0; 3];
        }
        if self.reports.is_full() {
            self.reports.pop_front();
        }
        let integral = self.integral_at(at, &report);
        // There is room: one was just taken out if there was none.
        let _ = self.reports.push_back(Stamped { at, report, integral });
    }

    /// Takes the corrected field of a reading: one that turns while the reports repeat shows that they are frozen.
    pub fn see_field(&mut self, field: Field<Body>) {
        self.freeze.see_field(field);
    }

    /// Takes the raw field of a reading: one that is still while the reports are not shows that they are sought yet.
    pub fn see_raw_field(&mut self, field: Field<Sensor>) {
        self.aligning.see_field(field);
    }

    /// How fast the aircraft turns about any axis by the newest report, radians a second; none where the source gives
    /// no rates.
    #[must_use]
    pub fn turning_rad_s(&self) -> Option<f32> {
        self.reports.back()?.report.turning_rad_s()
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
        let sent = self.sent(at);
        if sent == newest.at {
            return Lookup::Interpolated(newest.report.attitude);
        }
        let ahead_us = sent.us_since(newest.at);
        if ahead_us > 0 {
            return match self.why_not(sent) {
                Some(doubted) => doubted,
                None if ahead_us <= u64::from(self.config.max_extrapolation_us) => {
                    Lookup::Extrapolated(extrapolate(&newest.report, ahead_us as f32 * 1e-6))
                }
                None => Lookup::Stale,
            };
        }
        self.around(sent)
            .and_then(|(before, after)| self.between(before, after, sent))
            .map_or(Lookup::Missing, Lookup::Interpolated)
    }

    /// What the gyro says of an instant; none where there is no attitude, or the source gives no rates.
    #[must_use]
    pub fn turning_at(&self, at: Timestamp) -> Option<Turning> {
        let newest = self.reports.back()?;
        let sent = self.sent(at);
        if sent >= newest.at {
            let ahead_us = sent.us_since(newest.at);
            let known = ahead_us <= u64::from(self.config.max_extrapolation_us) && self.why_not(sent).is_none();
            return newest.integral.ahead(ahead_us as f32 * 1e-6).filter(|_| known || ahead_us == 0);
        }
        let (before, after) = self.around(sent)?;
        let gap_us = after.at.us_since(before.at) as f32;
        before.integral.between(&after.integral, gap_us * 1e-6, sent.us_since(before.at) as f32 / gap_us)
    }

    /// When a report was sent whose attitude was true at an instant.
    const fn sent(&self, at: Timestamp) -> Timestamp {
        at.shifted_us(self.config.latency_us)
    }

    fn integral_at(&self, at: Timestamp, report: &Report) -> Integral {
        let Some(last) = self.reports.back() else { return Integral::NOTHING.next(report, None) };
        let gap_us = at.us_since(last.at);
        let step_s = (gap_us <= u64::from(self.config.max_integrated_gap_us)).then_some(gap_us as f32 * 1e-6);
        last.integral.next(report, step_s)
    }

    /// Why the reports that come at a time of sending are not believed; none if they are.
    fn why_not(&self, sent: Timestamp) -> Option<Lookup> {
        let max_age_us = u64::from(self.config.max_extrapolation_us);
        let is_of = |last: Option<Timestamp>| last.is_some_and(|last| sent.us_since(last) <= max_age_us);
        if is_of(self.freeze.frozen_at()) {
            Some(Lookup::Frozen)
        } else {
            is_of(self.aligning_at).then_some(Lookup::Aligning)
        }
    }

    /// The reports before and after a time of sending, of which the first may be of that very time.
    fn around(&self, sent: Timestamp) -> Option<(&Stamped, &Stamped)> {
        let mut pairs = self.reports.iter().zip(self.reports.iter().skip(1));
        pairs.find(|(before, after)| (before.at..after.at).contains(&sent))
    }

    /// Between two reports, unless they are too far apart.
    fn between(&self, before: &Stamped, after: &Stamped, sent: Timestamp) -> Option<Attitude> {
        let gap_us = after.at.us_since(before.at);
        let fraction = sent.us_since(before.at) as f32 / gap_us as f32;
        (sent == before.at || gap_us <= u64::from(self.config.max_gap_us))
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

/// Carries a report on with its body rates.
fn extrapolate(report: &Report, ahead_s: f32) -> Attitude {
    let Attitude { roll_rad, pitch_rad } = report.attitude;
    let Motion { roll_rad_s, pitch_rad_s, .. } = Motion::of(report).unwrap_or_default();
    Attitude {
        roll_rad: wrap_pi(roll_rad + roll_rad_s * ahead_s),
        pitch_rad: (pitch_rad + pitch_rad_s * ahead_s).clamp(-FRAC_PI_2, FRAC_PI_2),
    }
}

#[cfg(test)]
mod tests;
