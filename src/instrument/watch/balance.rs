//! What pitch tells of bank: a wrong roll mixes the turn into the pitch rate.
//!
//! The rates give `theta' = q cos(phi) - r sin(phi)` with the roll that is told. With one that is too large by `e` it
//! comes out wrong by `-psi' cos(theta) e`, and does not add up to the pitch that is told. So, in a turn, the sum of two
//! seconds measures `a_r + k phi` without the magnetometer.

use super::factored::Measurement;
use super::model::{BANK, ROLL, UNKNOWNS, Unknowns};
use crate::attitude::Motion;
use crate::frames::Attitude;

/// Time of a sum, seconds: long for the noise of pitch, short for a turn.
const WINDOW_S: f32 = 2.0;

/// What a mean over the window is off, square radians a second: the attitude's noise at both ends of it.
const VARIANCE: f32 = 0.006 * 0.006;

/// The sums under way.
#[derive(Clone, Copy, Debug)]
pub(super) struct Balance {
    /// Pitch where they began, radians; none before the first sample.
    from_pitch_rad: Option<f32>,
    time_s: f32,
    pitched_rad: f32,
    turned_rad: f32,
    /// Roll times time.
    rolled_rad_s: f32,
}

impl Balance {
    /// No sums.
    pub const NOTHING: Self =
        Self { from_pitch_rad: None, time_s: 0.0, pitched_rad: 0.0, turned_rad: 0.0, rolled_rad_s: 0.0 };

    /// Takes a sample, `step_s` after the one before; gives what two seconds of them measure.
    pub fn see(
        &mut self,
        reported: Attitude,
        motion: &Motion,
        step_s: f32,
        unknowns: &Unknowns,
    ) -> Option<Measurement<UNKNOWNS>> {
        let Some(from_pitch_rad) = self.from_pitch_rad else {
            self.from_pitch_rad = Some(reported.pitch_rad);
            return None;
        };
        self.time_s += step_s;
        self.pitched_rad += motion.pitch_rad_s * step_s;
        self.turned_rad += motion.heading_rad_s * step_s;
        self.rolled_rad_s += reported.roll_rad * step_s;
        if self.time_s < WINDOW_S {
            return None;
        }
        let (heading_rad_s, roll_rad) = (self.turned_rad / self.time_s, self.rolled_rad_s / self.time_s);
        let unbalanced = (self.pitched_rad - (reported.pitch_rad - from_pitch_rad)) / self.time_s;
        *self = Self { from_pitch_rad: Some(reported.pitch_rad), ..Self::NOTHING };
        let mut row = [0.0; UNKNOWNS];
        row[ROLL] = -heading_rad_s;
        row[BANK] = -heading_rad_s * roll_rad;
        let predicted = row[ROLL] * unknowns[ROLL] + row[BANK] * unknowns[BANK];
        Some(Measurement { row, residual: unbalanced - predicted, variance: VARIANCE })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::attitude::{Report, Source};
    use crate::time::WrappingMillis;

    /// A level turn at 45 deg of bank and 0.3 rad/s, told with a roll that is too large by this and this part of itself:
    /// what two seconds of it measure.
    fn measured(bias_rad: f32, bank: f32, unknowns: &Unknowns) -> Measurement<UNKNOWNS> {
        let (roll_rad, heading_rad_s) = (0.8_f32, 0.3);
        let told = Attitude { roll_rad: roll_rad * (1.0 + bank) + bias_rad, pitch_rad: 0.0 };
        // Level: q and r are the turn's parts along the axes.
        let rates_rad_s = [0.0, heading_rad_s * roll_rad.sin(), heading_rad_s * roll_rad.cos()];
        let report =
            Report { source: Source::default(), sender_time: WrappingMillis::default(), attitude: told, rates_rad_s };
        let motion = Motion::of(&report).unwrap();
        let mut balance = Balance::NOTHING;
        (0..30).find_map(|_| balance.see(told, &motion, 0.1, unknowns)).unwrap()
    }

    /// A bias of 0.02 rad in a turn of 0.3 rad/s makes pitch drift by 6 mrad a second; a tenth of the bank, 24 mrad.
    #[test]
    fn a_wrong_bank_shows_in_the_pitch() {
        let right = measured(0.0, 0.0, &[0.0; UNKNOWNS]);
        assert!(right.residual.abs() < 1e-6, "{right:?}");
        let biased = measured(0.02, 0.0, &[0.0; UNKNOWNS]);
        assert!((biased.residual + 0.006).abs() < 1e-4, "{biased:?}");
        let scaled = measured(0.0, 0.1, &[0.0; UNKNOWNS]);
        assert!((scaled.residual + 0.024).abs() < 2e-4, "{scaled:?}");
        // What explains it leaves nothing.
        let mut unknowns = [0.0; UNKNOWNS];
        unknowns[ROLL] = 0.02;
        assert!(measured(0.02, 0.0, &unknowns).residual.abs() < 2e-4);
        let mut unknowns = [0.0; UNKNOWNS];
        // Of the roll that is told, 1.1 times the true one.
        unknowns[BANK] = 0.1 / 1.1;
        assert!(measured(0.0, 0.1, &unknowns).residual.abs() < 3e-4);
    }

    /// A climb that the rates show balances.
    #[test]
    fn what_pitches_by_its_rates_balances() {
        let motion = Motion { pitch_rad_s: 0.05, heading_rad_s: 0.2, roll_rad_s: 0.0 };
        let mut balance = Balance::NOTHING;
        let told = |i: u8| Attitude { roll_rad: 0.3, pitch_rad: 0.05 * 0.1 * f32::from(i) };
        let (i, found) =
            (0..60).find_map(|i| Some((i, balance.see(told(i), &motion, 0.1, &[0.0; UNKNOWNS])?))).unwrap();
        assert!((20..=21).contains(&i), "two seconds: {i}");
        assert!(found.residual.abs() < 1e-5, "{found:?}");
        assert!((found.row[ROLL] + 0.2).abs() < 1e-5 && (found.row[BANK] + 0.06).abs() < 1e-5, "{found:?}");
        // The next window begins where this one ended.
        let next = (i + 1..60).find_map(|i| balance.see(told(i), &motion, 0.1, &[0.0; UNKNOWNS])).unwrap();
        assert!(next.residual.abs() < 1e-5, "{next:?}");
    }
}
