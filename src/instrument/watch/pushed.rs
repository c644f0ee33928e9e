//! How far an attitude may be off because the aircraft is accelerated.
//!
//! An attitude source leans on its accelerometers, which take an acceleration for tilt. What brakes on rotors, or pulls up,
//! raises its nose, and lowers it to go on; so the pitch tells when the attitude is worse than it was in the calibration,
//! before field and attitude contradict each other for it. Bank does not: an aeroplane banks to turn, and is not pushed.
//!
//! The pitch must have changed by what is told and by the rates: an attitude that jumps is wrong, and rates that are taken
//! with a wrong bank add up to anything.

use crate::attitude::Motion;
use crate::frames::Attitude;

/// Part of what the pitch differs from what it is as a rule, by which each angle may be off. Who brakes by tilt and drag
/// alike is pushed by `2 g` times it; 0.4 deg for each m/s^2 of that make a seventh.
const PART: f32 = 0.15;

/// More is no brake: who points up steeply flies, and is not pushed. Measured, too: on a recorded flight that banks to 90 deg
/// more loosens the heading from the field for nothing. Radians.
const MOST_RAD: f32 = 0.015;

/// As a rule is: in so many seconds. A long climb is none.
const AS_A_RULE_S: f32 = 20.0;

/// How far the pitch is from what it is as a rule.
#[expect(clippy::struct_field_names, reason = "the unit")]
#[derive(Clone, Copy, Debug)]
pub(super) struct Pushed {
    /// The last pitch, radians; none before the first sample.
    last_rad: Option<f32>,
    /// What it has changed by and not yet become the rule, radians: as told, and by the rates.
    told_rad: f32,
    by_rates_rad: f32,
}

impl Pushed {
    /// Nothing was seen.
    pub const NOT: Self = Self { last_rad: None, told_rad: 0.0, by_rates_rad: 0.0 };

    /// Takes the attitude of a sample and its rates, `step_s` after the one before.
    pub fn see(&mut self, Attitude { pitch_rad, .. }: Attitude, motion: &Motion, step_s: f32) {
        let last_rad = self.last_rad.replace(pitch_rad).unwrap_or(pitch_rad);
        let kept = (1.0 - step_s / AS_A_RULE_S).max(0.0);
        self.told_rad = kept * (self.told_rad + pitch_rad - last_rad);
        self.by_rates_rad = kept * (self.by_rates_rad + motion.pitch_rad_s * step_s);
    }

    /// By which either angle may be off, square radians.
    pub fn variance_rad2(&self) -> f32 {
        let off_rad = (PART * self.told_rad.abs().min(self.by_rates_rad.abs())).min(MOST_RAD);
        off_rad * off_rad
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// After a minute of level flight: the pitch rises by so much in half a second, told and by the rates, and stays for
    /// the rest of so many seconds. By how much an angle may be off then.
    fn off_rad(told_rad: f32, by_rates_rad: f32, seconds: u16) -> f32 {
        let mut pushed = Pushed::NOT;
        let mut see = |pitch_rad: f32, pitch_rad_s: f32| {
            let motion = Motion { pitch_rad_s, ..Motion::default() };
            pushed.see(Attitude { roll_rad: 0.3, pitch_rad }, &motion, 0.1);
        };
        for _ in 0..600 {
            see(0.05, 0.0);
        }
        for i in 1..=10 * seconds {
            let part = f32::from(i.min(5)) / 5.0;
            see(0.05 + part * told_rad, if i <= 5 { 2.0 * by_rates_rad } else { 0.0 });
        }
        libm::sqrtf(pushed.variance_rad2())
    }

    /// A seventh of what the nose rises or falls, to the part of a second that has become the rule.
    #[test]
    fn a_nose_that_rises_or_falls_says_so() {
        for side in [1.0, -1.0] {
            let found = off_rad(0.08 * side, 0.08 * side, 1);
            assert!((found - 0.012).abs() < 0.000_6, "{found}");
        }
        // The lesser counts.
        assert!((off_rad(0.08, 0.04, 1) - 0.006).abs() < 0.000_4);
        assert!((off_rad(0.04, -0.08, 1) - 0.006).abs() < 0.000_4);
        // There is a most.
        assert!((off_rad(0.5, 0.5, 1) - 0.015).abs() < 1e-6 && off_rad(0.095, 0.095, 1) < 0.014_5);
    }

    /// An attitude that jumps while nothing turns, rates that no attitude follows, a roll.
    #[test]
    fn one_of_them_alone_is_no_push() {
        assert!(off_rad(0.14, 0.0, 1) < 1e-6 && off_rad(0.0, 0.14, 1) < 1e-6);
        let mut pushed = Pushed::NOT;
        for i in 0..10_u8 {
            let motion = Motion { roll_rad_s: 0.5, heading_rad_s: 0.3, ..Motion::default() };
            pushed.see(Attitude { roll_rad: 0.05 * f32::from(i), pitch_rad: 0.1 }, &motion, 0.1);
        }
        assert!(pushed.variance_rad2() < 1e-12);
    }

    /// `1 - 1/e` of a climb is the rule after twenty seconds, all of it after a gap of more.
    #[test]
    fn a_climb_becomes_the_rule() {
        let found = off_rad(0.08, 0.08, 20) / 0.012;
        assert!((found - 0.372).abs() < 0.02, "{found}");
        let mut pushed = Pushed::NOT;
        for (pitch_rad, step_s) in [(0.0, 0.1), (0.3, 25.0)] {
            pushed.see(
                Attitude { roll_rad: 0.0, pitch_rad },
                &Motion { pitch_rad_s: 0.01, ..Motion::default() },
                step_s,
            );
        }
        assert!(pushed.variance_rad2() < 1e-12);
    }
}
