//! Detector of sustained turns, from bank alone: `psi' = g tan(roll) / V`. The heading of the attitude source is not
//! used.

use crate::calibration::{AttitudeEnvelope, Sample, Side};
use crate::time::WrappingMillis;

#[derive(Clone, Copy, Debug)]
pub(super) struct TurnDetectorConfig {
    /// Bank at which a turn begins, radians: separates the planes of left and right turns.
    pub enter_roll_rad: f32,
    /// Bank below which a turn ends, radians; hysteresis against bank wander.
    pub leave_roll_rad: f32,
    /// Largest bank, radians; attitude sources fail in aerobatics.
    pub max_roll_rad: f32,
    /// Largest absolute pitch, radians.
    pub max_pitch_rad: f32,
    /// Time at the bank before samples count, milliseconds: 1 s of roll-in, 1 s for the attitude source to settle.
    pub settling_ms: u32,
    /// Longest gap between samples within one turn, milliseconds.
    pub max_gap_ms: u32,
}

impl TurnDetectorConfig {
    /// Thresholds for fixed-wing UAVs.
    pub const DEFAULT: Self = Self {
        enter_roll_rad: AttitudeEnvelope::MIN_BANK_RAD,
        leave_roll_rad: 7_f32.to_radians(),
        max_roll_rad: 60_f32.to_radians(),
        max_pitch_rad: 20_f32.to_radians(),
        settling_ms: 2000,
        max_gap_ms: 500,
    };
}

// Hysteresis needs distinct thresholds.
const _: () = assert!(TurnDetectorConfig::DEFAULT.leave_roll_rad < TurnDetectorConfig::DEFAULT.enter_roll_rad);
const _: () = assert!(TurnDetectorConfig::DEFAULT.enter_roll_rad < TurnDetectorConfig::DEFAULT.max_roll_rad);

#[derive(Clone, Copy, Debug)]
struct SteadyBank {
    side: Side,
    started_at: WrappingMillis,
    last_sample_at: WrappingMillis,
}

#[derive(Debug)]
pub(super) struct TurnDetector {
    config: TurnDetectorConfig,
    steady_bank: Option<SteadyBank>,
}

impl TurnDetector {
    pub const fn new(config: TurnDetectorConfig) -> Self {
        Self { config, steady_bank: None }
    }

    /// Processes a sample; returns the side of the sustained turn it belongs to.
    pub fn process_sample(&mut self, sample: &Sample) -> Option<Side> {
        self.steady_bank = self.next_bank(sample);
        self.turn_side()
    }

    /// Side of the sustained turn in progress.
    pub fn turn_side(&self) -> Option<Side> {
        self.steady_bank
            .filter(|bank| bank.last_sample_at.ms_since(bank.started_at) >= self.config.settling_ms)
            .map(|bank| bank.side)
    }

    fn next_bank(&self, sample: &Sample) -> Option<SteadyBank> {
        let roll_rad = sample.attitude.roll_rad;
        let side = if roll_rad < 0.0 { Side::Left } else { Side::Right };
        let previous_bank = self
            .steady_bank
            .filter(|bank| bank.side == side && sample.time.ms_since(bank.last_sample_at) <= self.config.max_gap_ms);
        let min_roll_rad =
            if previous_bank.is_some() { self.config.leave_roll_rad } else { self.config.enter_roll_rad };
        let is_banked = (min_roll_rad..=self.config.max_roll_rad).contains(&roll_rad.abs());
        let is_usable = is_banked && sample.attitude.pitch_rad.abs() <= self.config.max_pitch_rad;
        is_usable.then(|| SteadyBank {
            side,
            started_at: previous_bank.map_or(sample.time, |bank| bank.started_at),
            last_sample_at: sample.time,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::super::test_samples::banked_sample;
    use super::*;

    /// 1 s before the millisecond counter wraps.
    const FIRST_SAMPLE_MS: u32 = u32::MAX - 999;

    fn detect_sides(roll_deg: impl Fn(f32) -> f32, pitch_deg: f32, seconds: u16) -> Vec<Option<Side>> {
        let mut detector = TurnDetector::new(TurnDetectorConfig::DEFAULT);
        (0..seconds * 10)
            .map(|i| {
                let time_ms = FIRST_SAMPLE_MS.wrapping_add(u32::from(i) * 100);
                detector.process_sample(&banked_sample(roll_deg(f32::from(i) / 10.0), pitch_deg, time_ms))
            })
            .collect()
    }

    fn count_of_side(detected: &[Option<Side>], side: Side) -> usize {
        detected.iter().filter(|s| **s == Some(side)).count()
    }

    fn is_detected(roll_deg: f32, pitch_deg: f32) -> bool {
        detect_sides(|_| roll_deg, pitch_deg, 5).iter().any(Option::is_some)
    }

    fn side_after_turn(gap_ms: u32, roll_deg: f32, pitch_deg: f32) -> Option<Side> {
        let mut detector = TurnDetector::new(TurnDetectorConfig::DEFAULT);
        for i in 0..=30 {
            detector.process_sample(&banked_sample(25.0, 0.0, FIRST_SAMPLE_MS.wrapping_add(i * 100)));
        }
        assert_eq!(detector.turn_side(), Some(Side::Right));
        detector.process_sample(&banked_sample(roll_deg, pitch_deg, FIRST_SAMPLE_MS.wrapping_add(3000 + gap_ms)))
    }

    #[test]
    fn sustained_banks_are_turns_of_their_side() {
        // Right, then left turn of 30 s each, with 3 deg of bank wander; the first 2 s of each do not count.
        let detected = detect_sides(|t| (if t < 30.0 { 25.0 } else { -25.0 }) + 3.0 * (t * 4.2).sin(), 3.0, 60);
        assert_eq!(count_of_side(&detected, Side::Right), 280);
        assert_eq!(count_of_side(&detected, Side::Left), 280);
    }

    #[test]
    fn only_sustained_moderate_banks_are_turns() {
        assert_eq!(
            detect_sides(|t| 25.0 * (t * 1.5).sin(), 0.0, 60).iter().flatten().count(),
            0,
            "S-turns of 2 s a side"
        );
        assert_eq!(
            detect_sides(|t| 6.0 + 3.0 * (t * 4.2).sin(), 0.0, 60).iter().flatten().count(),
            0,
            "a wing kept low"
        );
        assert_eq!(detect_sides(|_| 75.0, 0.0, 60).iter().flatten().count(), 0, "75 deg of bank");
        assert_eq!(detect_sides(|_| 25.0, 30.0, 60).iter().flatten().count(), 0, "climbing at 30 deg");
        assert_eq!(detect_sides(|_| f32::NAN, 0.0, 10).iter().flatten().count(), 0, "not a number");
        assert_eq!(detect_sides(|_| 25.0, f32::NAN, 10).iter().flatten().count(), 0, "not a number");
    }

    #[test]
    fn a_turn_begins_at_ten_degrees_of_bank() {
        for sign in [1.0, -1.0] {
            assert!(is_detected(sign * 10.1, 0.0));
            assert!(!is_detected(sign * 9.9, 0.0));
        }
    }

    #[test]
    fn a_turn_ends_below_seven_degrees() {
        assert_eq!(side_after_turn(100, 7.1, 0.0), Some(Side::Right));
        assert_eq!(side_after_turn(100, 6.9, 0.0), None);
        // Wander down to 9 deg does not end a turn.
        let detected = detect_sides(|t| 12.0 + 3.0 * (t * 4.2).sin(), 0.0, 32);
        assert_eq!(count_of_side(&detected, Side::Right), 300, "all but the 2 s of settling");
    }

    #[test]
    fn more_than_sixty_degrees_of_bank_is_no_turn() {
        for sign in [1.0, -1.0] {
            assert!(is_detected(sign * 59.9, 0.0));
            assert!(!is_detected(sign * 60.1, 0.0));
        }
        assert_eq!(side_after_turn(100, 60.1, 0.0), None);
    }

    #[test]
    fn more_than_twenty_degrees_of_pitch_is_no_turn() {
        for sign in [1.0, -1.0] {
            assert!(is_detected(25.0, sign * 19.9));
            assert!(!is_detected(25.0, sign * 20.1));
            assert_eq!(side_after_turn(100, 25.0, sign * 20.1), None);
        }
    }

    #[test]
    fn a_turn_is_detected_after_two_seconds() {
        for (last_ms, expected) in [(1999, None), (2000, Some(Side::Right))] {
            let mut detector = TurnDetector::new(TurnDetectorConfig::DEFAULT);
            for time_ms in [0, 400, 800, 1200, 1600] {
                assert_eq!(
                    detector.process_sample(&banked_sample(25.0, 0.0, FIRST_SAMPLE_MS.wrapping_add(time_ms))),
                    None
                );
            }
            assert_eq!(
                detector.process_sample(&banked_sample(25.0, 0.0, FIRST_SAMPLE_MS.wrapping_add(last_ms))),
                expected
            );
        }
    }

    #[test]
    fn a_gap_ends_a_turn() {
        assert_eq!(side_after_turn(500, 25.0, 0.0), Some(Side::Right));
        assert_eq!(side_after_turn(501, 25.0, 0.0), None);
    }

    #[test]
    fn a_turn_to_the_other_side_is_another_turn() {
        assert_eq!(side_after_turn(100, -25.0, 0.0), None);
    }
}
