//! White-noise fraction of the norm residuals.
//!
//! Averaging readings reduces white noise only. Other norm errors (unmodelled iron, temperature) vary as slowly as the
//! aircraft turns and are common to all readings of a sample. The second difference of three successive samples removes
//! linear trends and has six times the variance of the white noise. With samples far apart the fraction is an upper
//! limit.

use crate::calibration::model::CLIPPED_MEAN_SQUARE;
use crate::calibration::types::samples::PART_COUNT;
use crate::time::WrappingMillis;

/// Maximum time between neighbouring samples, milliseconds: 20 deg in an ordinary turn.
const MAX_GAP_MS: u32 = 1500;

const MIN_DIFFERENCES: f32 = 20.0;

#[derive(Clone, Copy, Debug, Default)]
pub(in crate::calibration) struct WhiteNoiseFraction {
    /// Residual of the sample before the last, residual and time of the last, of each part.
    previous_residuals: [Option<(Option<f32>, f32, WrappingMillis)>; PART_COUNT],
    difference_squares: f32,
    difference_count: f32,
}

impl WhiteNoiseFraction {
    pub fn add_residual(&mut self, part: usize, time: WrappingMillis, residual: f32) {
        let Some(previous) = self.previous_residuals.get_mut(part) else { return };
        let recent = previous.filter(|(.., last_time)| time.ms_since(*last_time) <= MAX_GAP_MS);
        if let Some((Some(first), second, _)) = recent {
            let difference = first - 2.0 * second + residual;
            self.difference_squares += difference * difference;
            self.difference_count += 1.0;
        }
        *previous = Some((recent.map(|(_, second, _)| second), residual, time));
    }

    /// White fraction of the residuals' variance; 1 with too few samples. Not limited to 1, which would bias it low.
    pub fn white_noise_fraction(&self) -> f32 {
        if self.difference_count < MIN_DIFFERENCES {
            return 1.0;
        }
        self.difference_squares / (6.0 * CLIPPED_MEAN_SQUARE * self.difference_count)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::calibration::tests::synthetic::Random;

    fn white_fraction_of(number: u32, step_ms: u32, mut signal: impl FnMut(f32) -> f32) -> f32 {
        let mut fraction = WhiteNoiseFraction::default();
        for i in 0..number {
            fraction.add_residual(1, WrappingMillis::new(i * step_ms), signal(i as f32));
        }
        fraction.white_noise_fraction()
    }

    /// Clipped white noise, linear trend, sine with a period of 30 samples, mixture. Tolerance 10 %: three sigmas of
    /// 2,000 samples.
    #[test]
    fn the_white_noise_fraction_is_estimated_to_10_percent() {
        let mut random = Random(4);
        let all = white_fraction_of(2000, 400, |_| random.normal().clamp(-2.0, 2.0));
        assert!((0.9..1.1).contains(&all), "{all}");
        assert!(white_fraction_of(100, 400, |i| 0.01 * i) < 1e-6);
        assert!(white_fraction_of(100, 400, |i| (i * 0.21).sin()) < 1e-3);
        let part = white_fraction_of(2000, 400, |i| 0.5 * random.normal() + (i * 0.21).sin());
        assert!((0.25 * 0.9 / 0.9205..0.25 * 1.1 / 0.9205).contains(&part), "{part}");
    }

    #[test]
    fn without_enough_differences_all_noise_counts_as_white() {
        for (number, step_ms, is_known) in [(50, 400, true), (10, 400, false), (50, 1000, true), (50, 3000, false)] {
            let found = white_fraction_of(number, step_ms, |i| 0.01 * i);
            assert_eq!(found < 0.5, is_known, "{number} residuals {step_ms} ms apart: {found}");
        }
    }

    #[test]
    fn only_successive_residuals_of_a_part_are_compared() {
        let mut fraction = WhiteNoiseFraction::default();
        let first = [(0, 0, 1.0), (1, 100, -1.0), (0, 400, 1.0), (1, 500, -1.0), (0, 800, 1.5)];
        let after_a_gap = [(0, 5000, 0.0), (0, 5400, 0.0)];
        for (residuals, number, squares) in [
            (&first[..], 1.0, 0.25),
            (&after_a_gap, 1.0, 0.25),
            (&[(0, 5800, 2.0)], 2.0, 4.25),
            (&[(7, 5900, 2.0)], 2.0, 4.25),
        ] {
            for &(part, ms, residual) in residuals {
                fraction.add_residual(part, WrappingMillis::new(ms), residual);
            }
            let found: [f32; 2] = [fraction.difference_count, fraction.difference_squares];
            assert_eq!(found.map(f32::to_bits), [number, squares].map(f32::to_bits), "{residuals:?}");
        }
    }
}
