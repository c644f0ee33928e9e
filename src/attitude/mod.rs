//! Attitude in time: from reports that arrive late and in steps to the attitude at the instant of a measurement.

use crate::frames::{Attitude, wrap_pi};
use crate::time::WrappingMillis;
use crate::trig;

/// Fixed numbers of this module.
#[derive(Clone, Copy, Debug)]
pub struct Config {
    /// How old a report's attitude is when its last byte has arrived, microseconds. Autopilots estimate, schedule and
    /// send within about 20 ms; an error of 10 ms costs 0.3 deg of bank while it changes by 30 deg/s, nothing in a turn.
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
    /// The sender's clock when it was sent. Some senders have none and leave it 0.
    pub sender_time: WrappingMillis,
    /// Roll and pitch.
    pub attitude: Attitude,
    /// Body rates p, q, r, rad/s; zero where the sender gave none.
    pub rates_rad_s: [f32; 3],
}

/// A report with the instant at which its attitude was true, microseconds of the module's clock.
#[derive(Clone, Copy, Debug)]
struct Stamped {
    time_us: u64,
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
        Self { config, reports: heapless::Deque::new(), clock: SenderClock { last: None } }
    }

    /// Takes a report whose last byte arrived at `arrival_us`.
    pub fn push(&mut self, arrival_us: u64, report: Report) {
        let sent_us = self.clock.on_module_clock(arrival_us, report.sender_time.count(), &self.config);
        let time_us = sent_us.saturating_sub(u64::from(self.config.latency_us));
        // A report that is not newer than the last says nothing new; one from a rebooted sender starts afresh.
        if self.reports.back().is_some_and(|last| last.time_us >= time_us) {
            return;
        }
        if self.reports.is_full() {
            self.reports.pop_front();
        }
        // There is room: one was just taken out if there was none.
        let _ = self.reports.push_back(Stamped { time_us, report });
    }

    /// The attitude at an instant.
    #[must_use]
    pub fn at(&self, time_us: u64) -> Lookup {
        let Some(newest) = self.reports.back() else { return Lookup::Stale };
        if time_us > newest.time_us {
            let ahead_us = time_us - newest.time_us;
            return if ahead_us <= u64::from(self.config.max_extrapolation_us) {
                Lookup::Extrapolated(extrapolate(&newest.report, ahead_us as f32 * 1e-6))
            } else {
                Lookup::Stale
            };
        }
        let pairs = self.reports.iter().zip(self.reports.iter().skip(1));
        for (before, after) in pairs {
            if (before.time_us..=after.time_us).contains(&time_us) {
                let gap_us = after.time_us - before.time_us;
                if gap_us > u64::from(self.config.max_gap_us) {
                    return Lookup::Missing;
                }
                let fraction = (time_us - before.time_us) as f32 / gap_us as f32;
                return Lookup::Interpolated(interpolate(&before.report, &after.report, fraction));
            }
        }
        Lookup::Missing
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
        pitch_rad: (pitch_rad + pitch_rate * ahead_s)
            .clamp(-core::f32::consts::FRAC_PI_2, core::f32::consts::FRAC_PI_2),
    }
}

/// The sender's clock against the module's: the smallest delay seen is the one without queueing, so time stamps
/// follow the sender's even spacing and not the line's jitter.
#[derive(Debug)]
struct SenderClock {
    /// The last report's sender time in milliseconds, and module time less sender time of the least delayed report in
    /// microseconds.
    last: Option<(u32, i64)>,
}

impl SenderClock {
    /// When the report was sent, on the module's clock.
    fn on_module_clock(&mut self, arrival_us: u64, sender_ms: u32, config: &Config) -> u64 {
        let sender_us = i64::from(sender_ms) * 1000;
        let observed_us = arrival_us.cast_signed() - sender_us;
        let offset_us = match self.last {
            Some((last_ms, offset_us))
                if sender_ms > last_ms
                    && (observed_us - offset_us).unsigned_abs() <= u64::from(config.max_clock_error_us) =>
            {
                observed_us.min(offset_us + i64::from(config.clock_leak_us))
            }
            // First report, a rebooted sender, or one without a clock: the arrival is all there is.
            _ => observed_us,
        };
        self.last = Some((sender_ms, offset_us));
        (sender_us + offset_us).max(0) as u64
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const CONFIG: Config = Config::DEFAULT;

    fn report(sender_ms: u32, roll_deg: f32, p_deg_s: f32) -> Report {
        Report {
            sender_time: WrappingMillis::new(sender_ms),
            attitude: Attitude::from_deg(roll_deg, 0.0),
            rates_rad_s: [p_deg_s.to_radians(), 0.0, 0.0],
        }
    }

    fn roll_deg(lookup: Lookup) -> f32 {
        match lookup {
            Lookup::Interpolated(a) | Lookup::Extrapolated(a) => a.roll_rad.to_degrees(),
            other => panic!("{other:?}"),
        }
    }

    /// 50 Hz reports of a 10 deg/s roll: the attitude asked for is the one that was true, latency taken out.
    #[test]
    fn interpolates_and_extrapolates_to_the_instant() {
        let mut track = Track::new(CONFIG);
        for i in 0..8_u32 {
            let true_us = 1_000_000 + u64::from(i) * 20_000;
            track.push(true_us + u64::from(CONFIG.latency_us), report(500 + i * 20, 0.2 * i as f32, 10.0));
        }
        let lookup = track.at(1_050_000);
        assert!(matches!(lookup, Lookup::Interpolated(_)));
        assert!((roll_deg(lookup) - 0.5).abs() < 1e-3);
        let lookup = track.at(1_180_000);
        assert!(matches!(lookup, Lookup::Extrapolated(_)));
        assert!((roll_deg(lookup) - 1.8).abs() < 1e-3);
        assert_eq!(track.at(1_400_000), Lookup::Stale);
        assert_eq!(track.at(900_000), Lookup::Missing);
    }

    /// Reports delayed at random by up to 15 ms on the line: stamps keep the sender's spacing to the least delay.
    #[test]
    fn jitter_of_the_line_is_taken_out() {
        let mut track = Track::new(CONFIG);
        for i in 0..200_u32 {
            let jitter_us = u64::from(i * 7919 % 15) * 1000;
            let sent_us = 1_000_000 + u64::from(i) * 20_000;
            track.push(sent_us + jitter_us, report(i * 20, i as f32 * 0.2, 0.0));
        }
        // Roll rises by 10 deg/s: 0.3 ms of stamp error is 0.003 deg; without the clock it would be up to 0.15.
        let asked_us = 1_000_000 + 197 * 20_000 - u64::from(CONFIG.latency_us);
        assert!((roll_deg(track.at(asked_us)) - 197.0 * 0.2).abs() < 0.003);
    }

    #[test]
    fn a_sender_without_clock_or_after_reboot_is_stamped_by_arrival() {
        let mut track = Track::new(CONFIG);
        for (i, sender_ms) in [900_000, 900_020, 0, 0, 0].into_iter().enumerate() {
            track.push(2_000_000 + i as u64 * 20_000, report(sender_ms, i as f32, 0.0));
        }
        let newest_us = 2_080_000 - u64::from(CONFIG.latency_us);
        assert!((roll_deg(track.at(newest_us)) - 4.0).abs() < 1e-3);
    }

    #[test]
    fn roll_is_interpolated_the_short_way_round() {
        let mut track = Track::new(CONFIG);
        track.push(1_020_000, report(0, 179.0, 0.0));
        track.push(1_040_000, report(20, -179.0, 0.0));
        assert!((roll_deg(track.at(1_010_000)).abs() - 180.0).abs() < 1e-3);
    }
}
