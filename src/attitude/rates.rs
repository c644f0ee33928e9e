//! Whether body rates are those of the attitude that they come with.
//!
//! A source may send degrees for radians, or another axis's sign, and every heading that the gyro smooths would follow.
//! Roll and pitch tell: what the rates add up to in a second is what they change by in it, as far as the attitude's
//! noise, lag and lean let it.

use super::{Motion, Report};
use crate::frames::{Attitude, wrap_pi};
use crate::time::Timestamp;

/// Rates are summed over this time, microseconds: longer than an attitude is late.
const CHUNK_US: u64 = 1_000_000;

/// Of what the rates say, the attitude must do at least this. One that reads a third of the bank does more.
const LEAST: f32 = 0.15;

/// What the attitude does more or less than that adds up to so much, square radians, before it is believed: (5 deg)^2. An
/// evidence of the other kind is taken off it, and no more is kept: however well the rates fitted before.
const ENOUGH: f32 = 0.0076;

/// Rates are too slow when they add up to less than this part of what the attitude does: half a third of it.
const TOO_SLOW: f32 = 0.15;

/// An attitude that changes by less than this in all may be noise, square radians: (7 deg)^2. Nor is more remembered of
/// rates that were fast enough.
const MIN_BY_ATTITUDE: f32 = 0.015;

/// Of what was before, so much counts when another second is added: twenty seconds are remembered. So a gyro with an offset
/// of 2 deg/s at rest does not add up to a contradiction.
const REMEMBERED: f32 = 0.95;

/// Rates that add up to more than this within a second, square radians, while the attitude does next to nothing, need no
/// second to be wrong: (12 deg)^2, and 15 % of it.
const MUCH_BY_RATES: f32 = 0.044;
const LITTLE: f32 = 0.022_5;

/// A longer time between two reports is not summed over, microseconds.
const MAX_STEP_US: u64 = 250_000;

/// Holds the rates against the attitude.
#[derive(Clone, Copy, Debug)]
pub(super) struct Rates {
    last: Option<(Timestamp, Attitude, Motion)>,
    /// Since the second began: its length, and the changes of roll and pitch by the rates and by the attitude.
    passed_us: u64,
    per_gyro: [f32; 2],
    per_attitude: [f32; 2],
    /// How far they fit, square radians, [`ENOUGH`] at most and at least.
    fit: f32,
    /// By how much they are fast enough, square radians of attitude.
    speed: f32,
    contradict: bool,
}

impl Rates {
    /// Nothing seen yet.
    pub const NOTHING: Self = Self {
        last: None,
        passed_us: 0,
        per_gyro: [0.0; 2],
        per_attitude: [0.0; 2],
        fit: 0.0,
        speed: 0.0,
        contradict: false,
    };

    /// Whether the rates contradict the attitude, by the reports so far.
    pub const fn contradict(&self) -> bool {
        self.contradict
    }

    /// Takes a report; says whether its rates contradict the attitude.
    pub fn see(&mut self, at: Timestamp, report: &Report) -> bool {
        let Some(motion) = Motion::of(report) else { return false };
        let attitude = report.attitude;
        if let Some((last_at, last, before)) = self.last.replace((at, attitude, motion)) {
            let step_us = at.us_since(last_at);
            if step_us <= MAX_STEP_US {
                let step_s = step_us as f32 * 1e-6;
                let mean = before.towards(&motion, 0.5);
                let per_attitude = [wrap_pi(attitude.roll_rad - last.roll_rad), attitude.pitch_rad - last.pitch_rad];
                for (i, rate_rad_s) in [mean.roll_rad_s, mean.pitch_rad_s].into_iter().enumerate() {
                    self.per_gyro[i] += rate_rad_s * step_s;
                    self.per_attitude[i] += per_attitude[i];
                }
                self.passed_us += step_us;
            }
        }
        let [by_gyro, by_attitude] = [self.per_gyro, self.per_attitude].map(square);
        if self.passed_us >= CHUNK_US {
            self.sum_up();
        }
        if by_gyro > MUCH_BY_RATES && by_attitude < LITTLE * by_gyro {
            self.fit = -ENOUGH;
        }
        if self.fit.abs() >= ENOUGH {
            self.contradict = self.fit < 0.0;
        }
        self.contradict
    }

    /// A second is over.
    fn sum_up(&mut self) {
        let (gyro, attitude) = (self.per_gyro, self.per_attitude);
        let (gyro_squared, attitude_squared) = (square(gyro), square(attitude));
        let both = gyro[0] * attitude[0] + gyro[1] * attitude[1];
        (self.passed_us, self.per_gyro, self.per_attitude) = (0, [0.0; 2], [0.0; 2]);
        self.fit = finite(REMEMBERED * self.fit + both - LEAST * gyro_squared).clamp(-ENOUGH, ENOUGH);
        if self.are_too_slow(gyro_squared, attitude_squared) {
            self.fit = -ENOUGH;
        }
    }

    /// Takes the squares of a second.
    fn are_too_slow(&mut self, gyro_squared: f32, attitude_squared: f32) -> bool {
        let enough = gyro_squared / (TOO_SLOW * TOO_SLOW) - attitude_squared;
        self.speed = finite(REMEMBERED * self.speed + enough).min(MIN_BY_ATTITUDE);
        self.speed < -MIN_BY_ATTITUDE
    }
}

/// What is no number would stay so for ever.
fn finite(sum: f32) -> f32 {
    if sum.is_finite() { sum } else { 0.0 }
}

/// Roll's and pitch's together.
fn square([roll, pitch]: [f32; 2]) -> f32 {
    roll * roll + pitch * pitch
}

#[cfg(test)]
mod tests {
    use testkit::random::Random;

    use super::super::Source;
    use super::*;
    use crate::time::WrappingMillis;

    /// Reports of 50 Hz that roll into a bank of 25 deg and out of it every so often, within two seconds, and wobble;
    /// told with 0.3 deg of noise, this part of the bank, this much late, and rates times this. After how many seconds
    /// they first contradict, of a hundred.
    fn contradict_after(told: f32, late_s: f32, rates: f32) -> Option<u32> {
        let mut random = Random(1);
        let mut check = Rates::NOTHING;
        let roll_rad = |t_s: f32| {
            let of_leg_s = t_s.rem_euclid(20.0);
            0.44 * ((of_leg_s - 8.0) / 2.0).clamp(0.0, 1.0) * ((20.0 - of_leg_s) / 2.0).clamp(0.0, 1.0)
                + 0.02 * (1.1 * t_s).sin()
        };
        (1..=5000).find_map(|i: u16| {
            let t_s = f32::from(i) * 0.02;
            let attitude = Attitude {
                roll_rad: told * roll_rad(t_s - late_s) + 0.005 * random.normal(),
                pitch_rad: 0.005 * random.normal(),
            };
            let p = (roll_rad(t_s - late_s + 0.01) - roll_rad(t_s - late_s - 0.01)) / 0.02;
            let rates_rad_s = [rates * p, 0.0, rates * 0.01];
            let report =
                Report { source: Source::default(), sender_time: WrappingMillis::default(), attitude, rates_rad_s };
            check.see(Timestamp::from_us(u64::from(i) * 20_000), &report).then(|| u32::from(i) / 50)
        })
    }

    /// Whatever an attitude source may have but a wrong unit or sign.
    #[test]
    fn true_rates_are_believed() {
        for (told, late_s) in [(1.0, 0.0), (0.7, 0.0), (0.3, 0.0), (1.0, 0.5), (1.2, 0.1)] {
            assert_eq!(contradict_after(told, late_s, 1.0), None, "{told} {late_s}");
        }
        assert_eq!(contradict_after(1.0, 0.0, 0.5), None);
        assert_eq!(contradict_after(1.0, 0.0, 2.0), None);
    }

    /// Degrees for radians show in the wobble of level flight, within two seconds; the rest when the aircraft has rolled
    /// into its first turn, ten seconds after the beginning.
    #[test]
    fn a_wrong_unit_or_sign_is_found_in_the_first_turn() {
        assert!(contradict_after(1.0, 0.0, 57.3).is_some_and(|s| s <= 2));
        assert!(contradict_after(1.0, 0.0, -1.0).is_some_and(|s| s <= 10));
        assert!(contradict_after(1.0, 0.0, 1.0 / 57.3).is_some_and(|s| s <= 11));
    }

    /// Rates of roll by this and of attitude by that, for so many seconds.
    fn fed(check: &mut Rates, from_s: u32, seconds: u32, per_gyro: f32, per_attitude: f32) -> bool {
        let mut contradict = false;
        for i in 10 * from_s..=10 * (from_s + seconds) {
            // Up for a second and down for another.
            let up = (i / 10) % 2 == 0;
            let part = f32::from((i % 10) as u8) / 10.0;
            let roll_rad = per_attitude * if up { part } else { 1.0 - part };
            let rate = per_gyro * if up { 1.0 } else { -1.0 };
            let report = Report {
                source: Source::default(),
                sender_time: WrappingMillis::default(),
                attitude: Attitude { roll_rad, pitch_rad: 0.0 },
                rates_rad_s: [rate, 0.0, 1e-6],
            };
            contradict = check.see(Timestamp::from_us(u64::from(i) * 100_000), &report);
        }
        contradict
    }

    /// Fifteen percent, both ways.
    #[test]
    fn the_limits_are_where_they_are() {
        for (per_gyro, per_attitude, expected) in
            [(0.5, 0.09, false), (0.5, 0.06, true), (0.09, 0.5, false), (0.06, 0.5, true), (0.5, -0.5, true)]
        {
            let found = fed(&mut Rates::NOTHING.clone(), 0, 40, per_gyro, per_attitude);
            assert_eq!(found, expected, "{per_gyro} {per_attitude}");
        }
        // Too little to say anything: 1.15 of 0.04^2 a second, and of an attitude that may be noise twenty times its square.
        for (seconds, per_gyro, per_attitude, expected) in
            [(4, 0.04, -0.04, false), (6, 0.04, -0.04, true), (60, 0.001, 0.025, false), (60, 0.001, 0.03, true)]
        {
            let found = fed(&mut Rates::NOTHING.clone(), 0, seconds, per_gyro, per_attitude);
            assert_eq!(found, expected, "{seconds} {per_gyro} {per_attitude}");
        }
    }

    /// However long they were right: what comes and goes is a fault of its own.
    #[test]
    fn rates_that_become_wrong_are_found_as_soon() {
        for (per_gyro, per_attitude, seconds) in [(0.04, -0.04, 12), (0.001, 0.05, 16), (0.3, 0.01, 2), (0.001, 0.2, 2)]
        {
            let mut check = Rates::NOTHING;
            assert!(!fed(&mut check, 0, 60, 0.3, 0.3));
            assert!(fed(&mut check, 61, seconds, per_gyro, per_attitude), "{per_gyro} {per_attitude}");
        }
    }

    /// Parked for an hour with a gyro that is off.
    #[test]
    fn an_offset_is_no_contradiction() {
        let mut check = Rates::NOTHING;
        for i in 0..36_000_u32 {
            let report = Report {
                source: Source::default(),
                sender_time: WrappingMillis::default(),
                attitude: Attitude { roll_rad: 0.0, pitch_rad: 0.0 },
                rates_rad_s: [0.03, -0.015, 0.0],
            };
            assert!(!check.see(Timestamp::from_us(u64::from(i) * 100_000), &report), "{i}");
        }
    }

    /// A source that has come to its senses is believed again within half a minute.
    #[test]
    fn rates_that_are_right_again_are_believed_again() {
        let mut check = Rates::NOTHING;
        assert!(fed(&mut check, 0, 20, 0.3, -0.3));
        assert!(!fed(&mut check, 21, 30, 0.3, 0.3));
    }

    /// What is no number is forgotten.
    #[test]
    fn numbers_stay_numbers() {
        let mut check = Rates::NOTHING;
        fed(&mut check, 0, 3, f32::INFINITY, 0.3);
        assert!(!fed(&mut check, 4, 40, 0.3, 0.3));
        assert!(check.fit.is_finite() && check.speed.is_finite());
    }
}
