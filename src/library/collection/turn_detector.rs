//! The part of a flight to which a sample belongs: a left or a right turn, or level flight. Turns are detected by
//! sustained bank alone, `psi' = g tan(roll) / V`; the heading of the attitude source is not used.

use crate::calibration::{AttitudeEnvelope, CollectionPart, Sample};
use crate::time::WrappingMillis;

/// Bank at which a turn begins, radians: separates the planes of left and right turns.
pub(super) const ENTER_ROLL_RAD: f32 = AttitudeEnvelope::MIN_BANK_RAD;
/// Bank below which a turn ends, radians; hysteresis against bank wander. Largest absolute roll of a level sample.
pub const LEVEL_ROLL_RAD: f32 = 7_f32.to_radians();
/// Largest absolute pitch of a level sample, radians.
const LEVEL_PITCH_RAD: f32 = 12_f32.to_radians();
/// Largest bank, radians; attitude sources fail in aerobatics.
const MAX_ROLL_RAD: f32 = 60_f32.to_radians();
/// Largest absolute pitch in a turn, radians.
const MAX_PITCH_RAD: f32 = 20_f32.to_radians();
/// Time at the bank before samples count, milliseconds: 1 s of roll-in, 1 s for the attitude source to settle.
const SETTLING_MS: u32 = 2000;
/// Longest gap between samples within one turn, milliseconds.
pub(super) const MAX_GAP_MS: u32 = 500;

// Hysteresis needs distinct thresholds.
const _: () = assert!(LEVEL_ROLL_RAD < ENTER_ROLL_RAD && ENTER_ROLL_RAD < MAX_ROLL_RAD);

/// Whether a sample is of level flight.
pub(super) fn is_level(sample: &Sample) -> bool {
    sample.attitude.roll_rad.abs() <= LEVEL_ROLL_RAD && sample.attitude.pitch_rad.abs() <= LEVEL_PITCH_RAD
}

#[derive(Clone, Copy, Debug)]
struct SteadyBank {
    side: CollectionPart,
    started_at: WrappingMillis,
    last_sample_at: WrappingMillis,
}

#[derive(Debug)]
pub(super) struct TurnDetector {
    steady_bank: Option<SteadyBank>,
}

impl TurnDetector {
    pub const NO_TURN: Self = Self { steady_bank: None };

    /// Processes a sample; returns the part of the sustained turn it belongs to.
    pub fn process_sample(&mut self, sample: &Sample) -> Option<CollectionPart> {
        self.steady_bank = self.next_bank(sample);
        self.turn_side()
    }

    /// Part of the sustained turn in progress: left or right turns.
    pub fn turn_side(&self) -> Option<CollectionPart> {
        self.steady_bank
            .filter(|bank| bank.last_sample_at.ms_since(bank.started_at) >= SETTLING_MS)
            .map(|bank| bank.side)
    }

    fn next_bank(&self, sample: &Sample) -> Option<SteadyBank> {
        let roll_rad = sample.attitude.roll_rad;
        let side = if roll_rad < 0.0 { CollectionPart::LEFT } else { CollectionPart::RIGHT };
        let previous_bank = self
            .steady_bank
            .filter(|bank| bank.side == side && sample.time.ms_since(bank.last_sample_at) <= MAX_GAP_MS);
        let min_roll_rad = if previous_bank.is_some() { LEVEL_ROLL_RAD } else { ENTER_ROLL_RAD };
        let is_banked = (min_roll_rad..=MAX_ROLL_RAD).contains(&roll_rad.abs());
        let is_usable = is_banked && sample.attitude.pitch_rad.abs() <= MAX_PITCH_RAD;
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

    /// Sides detected at 10 samples/s of this roll and pitch, degrees, at a time in seconds.
    fn detect_sides(attitude_deg: impl Fn(f32) -> [f32; 2], seconds: u16) -> Vec<Option<CollectionPart>> {
        let mut detector = TurnDetector::NO_TURN;
        (0..seconds * 10)
            .map(|i| {
                let time_ms = FIRST_SAMPLE_MS.wrapping_add(u32::from(i) * 100);
                let [roll_deg, pitch_deg] = attitude_deg(f32::from(i) / 10.0);
                detector.process_sample(&banked_sample(roll_deg, pitch_deg, time_ms))
            })
            .collect()
    }

    /// All but the first 2 s of each turn count, in 3 deg of bank wander.
    #[test]
    fn sustained_banks_are_turns_of_their_side() {
        let wander_deg = |t_s: f32| 3.0 * (t_s * 4.2).sin();
        let turn = |t_s: f32| [wander_deg(t_s) + if t_s < 30.0 { 25.0 } else { -25.0 }, 3.0];
        let settling = [None; 20];
        let expected =
            [&settling[..], &[Some(CollectionPart::RIGHT); 280], &settling, &[Some(CollectionPart::LEFT); 280]]
                .concat();
        assert_eq!(detect_sides(turn, 60), expected);
        let small_bank = |t_s: f32| [12.0 + wander_deg(t_s), 0.0];
        assert_eq!(detect_sides(small_bank, 32), [&settling[..], &[Some(CollectionPart::RIGHT); 300]].concat());
    }

    #[test]
    fn only_sustained_moderate_banks_are_turns() {
        let constant = |roll_deg: f32, pitch_deg: f32| detect_sides(move |_| [roll_deg, pitch_deg], 60);
        for (name, detected) in [
            ("S-turns of 2 s a side", detect_sides(|t_s| [25.0 * (t_s * 1.5).sin(), 0.0], 60)),
            ("a wing kept low", detect_sides(|t_s| [6.0 + 3.0 * (t_s * 4.2).sin(), 0.0], 60)),
            ("75 deg of bank", constant(75.0, 0.0)),
            ("climbing at 30 deg", constant(25.0, 30.0)),
            ("not a number", constant(f32::NAN, 0.0)),
            ("not a number", constant(25.0, f32::NAN)),
        ] {
            assert!(detected.iter().all(Option::is_none), "{name}");
        }
        // The manual asks for 15 to 45 deg.
        for (roll_deg, pitch_deg) in [(15.0, 0.0), (-15.0, 10.0), (45.0, -10.0), (-45.0, 0.0)] {
            assert_eq!(constant(roll_deg, pitch_deg).iter().flatten().count(), 580, "{roll_deg} {pitch_deg}");
        }
    }

    /// The next sample after 3 s in a right turn, after a gap.
    #[test]
    fn a_turn_ends_with_its_bank_or_with_a_gap() {
        for (name, gap_ms, roll_deg, pitch_deg, is_turn) in [
            ("continued", 100, 25.0, 0.0, true),
            ("less bank than at the start of a turn", 100, 8.0, 0.0, true),
            ("level", 100, 6.0, 0.0, false),
            ("the other side", 100, -25.0, 0.0, false),
            ("aerobatics", 100, 65.0, 0.0, false),
            ("climb", 100, 25.0, 25.0, false),
            ("dive", 100, 25.0, -25.0, false),
            ("slow samples", 400, 25.0, 0.0, true),
            ("a gap", 700, 25.0, 0.0, false),
        ] {
            let mut detector = TurnDetector::NO_TURN;
            let mut side_at = |roll_deg, pitch_deg, ms| {
                detector.process_sample(&banked_sample(roll_deg, pitch_deg, FIRST_SAMPLE_MS.wrapping_add(ms)))
            };
            assert_eq!((0..=30).map(|i| side_at(25.0, 0.0, i * 100)).last(), Some(Some(CollectionPart::RIGHT)));
            assert_eq!(side_at(roll_deg, pitch_deg, 3000 + gap_ms), is_turn.then_some(CollectionPart::RIGHT), "{name}");
        }
    }
}
