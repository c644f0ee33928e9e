//! How much of the norms' scatter is white.
//!
//! Only what is white shrinks when readings are averaged, so only that is more in a single reading than in a sample. What
//! else is in the norms - iron that the model does not have, temperature - changes as slowly as the aircraft turns, and is
//! the same in all readings of a sample. Of three samples that follow each other, the second difference takes out what
//! changes evenly and leaves six times the variance of what is white.
//!
//! It is an upper limit: of samples that are far apart it tells little, and of some seconds nothing.

use super::likelihood::CLIPPED_MEAN_SQUARE;
use super::time_order::PARTS;
use crate::time::WrappingMillis;

/// Samples further apart than this, milliseconds, are of other headings: 20 deg in an ordinary turn.
const MAX_STEP_MS: u32 = 1500;

/// Of fewer second differences than this, nothing is said.
const MIN_NUMBER: f32 = 20.0;

/// Sums over samples that follow each other in a part of a flight.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Roughness {
    /// Of each part, the residuals of the sample before the last and of the last, with the time of that.
    before: [Option<(Option<f32>, f32, WrappingMillis)>; PARTS],
    squares: f32,
    number: f32,
}

impl Roughness {
    /// Adds the clipped residual over sigma of the next sample of a part.
    pub fn add(&mut self, part: usize, time: WrappingMillis, residual: f32) {
        let Some(slot) = self.before.get_mut(part) else { return };
        let near = slot.filter(|(.., last)| time.since(*last) <= MAX_STEP_MS);
        if let Some((Some(first), second, _)) = near {
            let difference = first - 2.0 * second + residual;
            self.squares += difference * difference;
            self.number += 1.0;
        }
        *slot = Some((near.map(|(_, second, _)| second), residual, time));
    }

    /// The white part of the residuals' variance, as a share of all; all of it where samples do not tell. By chance it is
    /// some per cent more than all: to cut that off would make it too small on the average.
    pub fn white_share(&self) -> f32 {
        if self.number < MIN_NUMBER {
            return 1.0;
        }
        self.squares / (6.0 * CLIPPED_MEAN_SQUARE * self.number)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::calibration::tests::synthetic::Random;

    /// The white share of a signal of so many samples, so many milliseconds apart.
    fn share(number: u32, step_ms: u32, mut signal: impl FnMut(f32) -> f32) -> f32 {
        let mut roughness = Roughness::default();
        for i in 0..number {
            roughness.add(1, WrappingMillis::new(i * step_ms), signal(i as f32));
        }
        roughness.white_share()
    }

    /// White noise, clipped as the residuals are, is all white; what changes evenly is not, nor what goes round once in
    /// thirty samples; of a mixture the white part is found. A tenth is what 2,000 samples leave to chance, thrice over.
    #[test]
    fn the_white_part_is_found() {
        let mut random = Random(4);
        let all = share(2000, 400, |_| random.normal().clamp(-2.0, 2.0));
        assert!((0.9..1.1).contains(&all), "{all}");
        assert!(share(100, 400, |i| 0.01 * i) < 1e-6);
        assert!(share(100, 400, |i| (i * 0.21).sin()) < 1e-3);
        let part = share(2000, 400, |i| 0.5 * random.normal() + (i * 0.21).sin());
        assert!((0.25 * 0.9 / 0.9205..0.25 * 1.1 / 0.9205).contains(&part), "{part}");
    }

    /// Twenty second differences, of samples no further apart than a second and a half; else all of it counts as white.
    #[test]
    fn where_samples_do_not_tell_all_is_white() {
        for (number, step_ms, is_told) in [(22, 400, true), (21, 400, false), (50, 1500, true), (50, 1501, false)] {
            let found = share(number, step_ms, |i| 0.01 * i);
            assert_eq!(found < 0.5, is_told, "{number} {step_ms}: {found}");
        }
    }

    /// Parts are followed each for itself, and a gap begins anew.
    #[test]
    fn only_neighbours_are_compared() {
        let mut roughness = Roughness::default();
        for (part, ms, residual) in [(0, 0, 1.0), (1, 100, -1.0), (0, 400, 1.0), (1, 500, -1.0), (0, 800, 1.5)] {
            roughness.add(part, WrappingMillis::new(ms), residual);
        }
        let sums = |roughness: &Roughness| [roughness.number, roughness.squares].map(f32::to_bits);
        let are = |number: f32, squares: f32| [number, squares].map(f32::to_bits);
        assert_eq!(sums(&roughness), are(1.0, 0.25));
        for (ms, residual) in [(5000, 0.0), (5400, 0.0)] {
            roughness.add(0, WrappingMillis::new(ms), residual);
        }
        assert_eq!(sums(&roughness), are(1.0, 0.25));
        roughness.add(0, WrappingMillis::new(5800), 2.0);
        assert_eq!(sums(&roughness), are(2.0, 4.25));
        roughness.add(7, WrappingMillis::new(5900), 2.0);
        assert_eq!(sums(&roughness), are(2.0, 4.25));
    }
}
