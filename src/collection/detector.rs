//! Recognises sustained turns from bank alone.
//!
//! An aeroplane that holds a bank turns: `psi' = g tan(roll) / V`. Heading is not needed for it, and the source's yaw
//! is not looked at. Whether the heading really went round is seen by the dataset, from the field itself.

use crate::calibration::{Envelope, Sample, Side};
use crate::time::WrappingMillis;

/// Fixed numbers of the detector.
#[derive(Clone, Copy, Debug)]
pub(super) struct Config {
    /// A turn begins at this bank, radians. Gentler turns separate the two planes too little, and their samples show
    /// level headings alone.
    pub enter_roll_rad: f32,
    /// A turn ends below this bank, radians, so that wander about the first threshold does not cut it up.
    pub leave_roll_rad: f32,
    /// Steeper is aerobatics, where attitude sources fail.
    pub max_roll_rad: f32,
    /// More pitch than this is a manoeuvre of its own.
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
        enter_roll_rad: Envelope::MIN_BANK_RAD,
        leave_roll_rad: 7_f32.to_radians(),
        max_roll_rad: 60_f32.to_radians(),
        max_pitch_rad: 20_f32.to_radians(),
        settle_ms: 2000,
        max_gap_ms: 500,
    };
}

// Hysteresis, and room above it.
const _: () = assert!(Config::DEFAULT.leave_roll_rad < Config::DEFAULT.enter_roll_rad);
const _: () = assert!(Config::DEFAULT.enter_roll_rad < Config::DEFAULT.max_roll_rad);

/// A bank being held.
#[derive(Clone, Copy, Debug)]
struct Bank {
    side: Side,
    since: WrappingMillis,
    last: WrappingMillis,
}

/// Follows the bank from sample to sample.
#[derive(Debug)]
pub(super) struct Detector {
    config: Config,
    bank: Option<Bank>,
}

impl Detector {
    /// Not in a turn.
    pub const fn new(config: Config) -> Self {
        Self { config, bank: None }
    }

    /// Takes the next sample in time; says which turn it belongs to, if any.
    pub fn push(&mut self, sample: &Sample) -> Option<Side> {
        self.bank = self.follow(sample);
        self.turning()
    }

    /// The sustained turn the aircraft is in.
    pub fn turning(&self) -> Option<Side> {
        self.bank.filter(|bank| bank.last.since(bank.since) >= self.config.settle_ms).map(|bank| bank.side)
    }

    fn follow(&self, sample: &Sample) -> Option<Bank> {
        let roll_rad = sample.attitude.roll_rad;
        let side = if roll_rad < 0.0 { Side::Left } else { Side::Right };
        let held = self.bank.filter(|bank| bank.side == side && sample.time.since(bank.last) <= self.config.max_gap_ms);
        let least_rad = if held.is_some() { self.config.leave_roll_rad } else { self.config.enter_roll_rad };
        let is_banked = (least_rad..=self.config.max_roll_rad).contains(&roll_rad.abs());
        let is_usable = is_banked && sample.attitude.pitch_rad.abs() <= self.config.max_pitch_rad;
        is_usable.then(|| Bank { side, since: held.map_or(sample.time, |bank| bank.since), last: sample.time })
    }
}

#[cfg(test)]
mod tests {
    use super::super::testing::banked;
    use super::*;

    /// Starts just before the milliseconds wrap, as a module does after 49 days.
    const START_MS: u32 = u32::MAX - 999;

    /// Runs a bank history at 10 Hz; gives for each sample what the detector said.
    fn run(roll_deg: impl Fn(f32) -> f32, pitch_deg: f32, seconds: u16) -> Vec<Option<Side>> {
        let mut detector = Detector::new(Config::DEFAULT);
        (0..seconds * 10)
            .map(|i| {
                let time_ms = START_MS.wrapping_add(u32::from(i) * 100);
                detector.push(&banked(roll_deg(f32::from(i) / 10.0), pitch_deg, time_ms))
            })
            .collect()
    }

    fn count(said: &[Option<Side>], side: Side) -> usize {
        said.iter().filter(|s| **s == Some(side)).count()
    }

    /// Whether a steady bank and pitch is ever a turn.
    fn turns(roll_deg: f32, pitch_deg: f32) -> bool {
        run(|_| roll_deg, pitch_deg, 5).iter().any(Option::is_some)
    }

    /// After 3 s in a right turn of 25 deg, what is said of a sample so many milliseconds later at this attitude.
    fn after_a_turn(gap_ms: u32, roll_deg: f32, pitch_deg: f32) -> Option<Side> {
        let mut detector = Detector::new(Config::DEFAULT);
        for i in 0..=30 {
            detector.push(&banked(25.0, 0.0, START_MS.wrapping_add(i * 100)));
        }
        assert_eq!(detector.turning(), Some(Side::Right));
        detector.push(&banked(roll_deg, pitch_deg, START_MS.wrapping_add(3000 + gap_ms)))
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
        assert_eq!(run(|_| 25.0, f32::NAN, 10).iter().flatten().count(), 0, "not a number");
    }

    #[test]
    fn a_turn_begins_at_ten_degrees_of_bank() {
        for sign in [1.0, -1.0] {
            assert!(turns(sign * 10.1, 0.0));
            assert!(!turns(sign * 9.9, 0.0));
        }
    }

    #[test]
    fn a_turn_once_begun_ends_below_seven_degrees() {
        assert_eq!(after_a_turn(100, 7.1, 0.0), Some(Side::Right));
        assert_eq!(after_a_turn(100, 6.9, 0.0), None);
        // 9 deg would not begin a turn; wander down to it does not end one.
        let said = run(|t| 12.0 + 3.0 * (t * 4.2).sin(), 0.0, 32);
        assert_eq!(count(&said, Side::Right), 300, "all but the 2 s of settling");
    }

    #[test]
    fn more_than_sixty_degrees_of_bank_is_no_turn() {
        for sign in [1.0, -1.0] {
            assert!(turns(sign * 59.9, 0.0));
            assert!(!turns(sign * 60.1, 0.0));
        }
        assert_eq!(after_a_turn(100, 60.1, 0.0), None);
    }

    #[test]
    fn more_than_twenty_degrees_of_pitch_is_no_turn() {
        for sign in [1.0, -1.0] {
            assert!(turns(25.0, sign * 19.9));
            assert!(!turns(25.0, sign * 20.1));
            assert_eq!(after_a_turn(100, 25.0, sign * 20.1), None);
        }
    }

    #[test]
    fn a_turn_counts_from_two_seconds_on() {
        for (last_ms, expected) in [(1999, None), (2000, Some(Side::Right))] {
            let mut detector = Detector::new(Config::DEFAULT);
            for time_ms in [0, 400, 800, 1200, 1600] {
                assert_eq!(detector.push(&banked(25.0, 0.0, START_MS.wrapping_add(time_ms))), None);
            }
            assert_eq!(detector.push(&banked(25.0, 0.0, START_MS.wrapping_add(last_ms))), expected);
        }
    }

    #[test]
    fn a_gap_ends_a_turn() {
        assert_eq!(after_a_turn(500, 25.0, 0.0), Some(Side::Right));
        assert_eq!(after_a_turn(501, 25.0, 0.0), None);
    }

    #[test]
    fn a_turn_to_the_other_side_is_another_turn() {
        assert_eq!(after_a_turn(100, -25.0, 0.0), None);
    }
}
