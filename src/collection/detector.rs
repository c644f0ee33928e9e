//! Recognises sustained turns from bank alone.
//!
//! An aeroplane that holds a bank turns: `psi' = g tan(roll) / V`. Heading is not needed for it, and the source's yaw
//! is not looked at. Whether the heading really went round is seen by the dataset, from the field itself.

use crate::calibration::{Sample, Side};
use crate::time::WrappingMillis;

/// Fixed numbers of the detector.
#[derive(Clone, Copy, Debug)]
pub struct Config {
    /// A turn begins at this bank, radians: 10 deg. Gentler turns separate the two planes too little.
    pub enter_roll_rad: f32,
    /// and ends below this one: 7 deg, so that wander about the threshold does not cut it up.
    pub leave_roll_rad: f32,
    /// Steeper is aerobatics, where attitude sources fail: 60 deg.
    pub max_roll_rad: f32,
    /// More pitch than this is a manoeuvre of its own: 20 deg.
    pub max_pitch_rad: f32,
    /// The bank must have been held so long before the first sample counts, milliseconds: a roll-in takes about 1 s,
    /// and attitude sources settle in another.
    pub settle_ms: u32,
    /// A gap in the samples longer than this ends the turn, milliseconds.
    pub max_gap_ms: u32,
}

impl Config {
    /// Numbers for fixed-wing UAVs.
    pub const DEFAULT: Self = Self {
        enter_roll_rad: 0.175,
        leave_roll_rad: 0.122,
        max_roll_rad: 1.05,
        max_pitch_rad: 0.35,
        settle_ms: 2000,
        max_gap_ms: 500,
    };
}

/// A bank being held.
#[derive(Clone, Copy, Debug)]
struct Bank {
    side: Side,
    since: WrappingMillis,
    last: WrappingMillis,
}

/// Follows the bank from sample to sample.
#[derive(Debug)]
pub struct Detector {
    config: Config,
    bank: Option<Bank>,
}

impl Detector {
    /// Not in a turn.
    #[must_use]
    pub const fn new(config: Config) -> Self {
        Self { config, bank: None }
    }

    /// Takes the next sample in time; says which turn it belongs to, if any.
    pub fn push(&mut self, sample: &Sample) -> Option<Side> {
        self.bank = self.follow(sample);
        self.turning()
    }

    /// The sustained turn the aircraft is in.
    #[must_use]
    pub fn turning(&self) -> Option<Side> {
        self.bank.filter(|bank| bank.last.since(bank.since) >= self.config.settle_ms).map(|bank| bank.side)
    }

    fn follow(&self, sample: &Sample) -> Option<Bank> {
        let roll_rad = sample.attitude.roll_rad;
        let side = if roll_rad < 0.0 { Side::Left } else { Side::Right };
        let held = self.bank.filter(|bank| bank.side == side && sample.time.since(bank.last) <= self.config.max_gap_ms);
        let least_rad = if held.is_some() { self.config.leave_roll_rad } else { self.config.enter_roll_rad };
        let usable = (least_rad..=self.config.max_roll_rad).contains(&roll_rad.abs())
            && sample.attitude.pitch_rad.abs() <= self.config.max_pitch_rad;
        usable.then(|| Bank { side, since: held.map_or(sample.time, |bank| bank.since), last: sample.time })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frames::{Attitude, Field};

    /// Runs a bank history at 10 Hz; gives for each sample what the detector said.
    fn run(roll_deg: impl Fn(f32) -> f32, pitch_deg: f32, seconds: u16) -> Vec<Option<Side>> {
        let mut detector = Detector::new(Config::DEFAULT);
        (0..seconds * 10)
            .map(|i| {
                let t_s = f32::from(i) / 10.0;
                detector.push(&Sample {
                    field: Field::from_ut(20.0, 0.0, 40.0),
                    attitude: Attitude::from_deg(roll_deg(t_s), pitch_deg),
                    // Starts just before the milliseconds wrap, as a module does after 49 days.
                    time: WrappingMillis::new((u32::from(i) * 100).wrapping_sub(1000)),
                })
            })
            .collect()
    }

    fn count(said: &[Option<Side>], side: Side) -> usize {
        said.iter().filter(|s| **s == Some(side)).count()
    }

    #[test]
    fn sustained_banks_are_turns_of_their_side() {
        // 30 s each way with 3 deg of wander at 1.5 s; 28 s of each count, since 2 s settle.
        let said = run(|t| (if t < 30.0 { 25.0 } else { -25.0 }) + 3.0 * (t * 4.2).sin(), 3.0, 60);
        assert_eq!(count(&said, Side::Right), 280);
        assert_eq!(count(&said, Side::Left), 280);
    }

    #[test]
    fn short_banks_level_flight_and_aerobatics_are_not_turns() {
        assert_eq!(run(|t| 25.0 * (t * 1.5).sin(), 0.0, 60).iter().flatten().count(), 0, "S-turns of 2 s a side");
        assert_eq!(run(|t| 6.0 + 3.0 * (t * 4.2).sin(), 0.0, 60).iter().flatten().count(), 0, "a wing kept low");
        assert_eq!(run(|_| 75.0, 0.0, 60).iter().flatten().count(), 0, "75 deg of bank");
        assert_eq!(run(|_| 25.0, 30.0, 60).iter().flatten().count(), 0, "climbing at 30 deg");
        assert_eq!(run(|_| f32::NAN, 0.0, 10).iter().flatten().count(), 0, "not a number");
    }
}
