//! How much more dips scatter where they tell most.
//!
//! The solver takes the dips of all samples for equally good. Those of a vehicle that tilts in order to accelerate are not:
//! its attitude source is worse just while it is tilted, and it is the tilted samples that tell how the sensor is turned
//! about the vertical. So the variance of what they leave is not that of all dips but of those dips, each counted by the
//! square of its tilt, as in the heteroscedasticity-consistent covariance of H. White, "A Heteroskedasticity-Consistent
//! Covariance Matrix Estimator", Econometrica 48, 1980, with one direction in the place of all.
//!
//! Of 100 calibrations of copters with attitude errors of a degree while they are pushed, two were off by three times of
//! what they expected without it, each by the same at all headings.

use crate::frames::Attitude;

/// Samples that tilt by less in the mean square, radians squared, about 3 deg, are of a vehicle that does not tilt.
const MIN_MEAN_SQUARE: f32 = 0.003;

/// No more than this is believed.
const MAX_RATIO: f32 = 5.0;

/// Sums over samples. 16 bytes.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Unevenness {
    /// Squares of dips' residuals over their sigma, each by the square of its sample's tilt; and those squares.
    by_tilt: f32,
    tilts: f32,
    /// Squares of the residuals; and their number.
    squares: f32,
    number: f32,
}

impl Unevenness {
    /// Adds the dip's residual over sigma of a sample at an attitude.
    pub fn add(&mut self, attitude: Attitude, residual: f32) {
        let Attitude { roll_rad, pitch_rad } = attitude;
        let tilt = (roll_rad * roll_rad + pitch_rad * pitch_rad).min(1.0);
        let square = residual * residual;
        self.by_tilt += square * tilt;
        self.tilts += tilt;
        self.squares += square;
        self.number += 1.0;
    }

    /// The variance of dips where they tell of headings over that of all dips; no less than one.
    pub fn ratio(&self) -> f32 {
        if self.tilts < MIN_MEAN_SQUARE * self.number || self.squares <= 0.0 {
            return 1.0;
        }
        let ratio = (self.by_tilt / self.tilts) * (self.number / self.squares);
        // What is no number is one.
        if ratio > 1.0 { ratio.min(MAX_RATIO) } else { 1.0 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ratio(samples: &[(f32, f32)]) -> f32 {
        let mut unevenness = Unevenness::default();
        for &(tilt_deg, residual) in samples {
            unevenness.add(Attitude::from_deg(0.6 * tilt_deg, -0.8 * tilt_deg), residual);
        }
        unevenness.ratio()
    }

    /// As many level as tilted, whose residuals are twice as large: 4 over the mean of 1 and 4. None that are less, or of
    /// those that do not tilt, makes it less than one.
    #[test]
    fn tilted_dips_count_by_their_tilt() {
        assert!((ratio(&[(0.0, 1.0), (20.0, -2.0)]) - 4.0 / 2.5).abs() < 1e-5);
        // By the squares of the tilts: (16 * 4 + 1 * 1) / 17 over the mean of 4, 1 and 1.
        assert!((ratio(&[(20.0, 2.0), (5.0, 1.0), (0.0, 1.0)]) - (65.0 / 17.0) / 2.0).abs() < 1e-4);
        assert!((ratio(&[(0.0, 2.0), (20.0, 1.0)]) - 1.0).abs() < f32::EPSILON);
        assert!((ratio(&[(25.0, 1.0), (25.0, -1.0)]) - 1.0).abs() < 1e-5);
        for (tilt_deg, uneven) in [(4.2, false), (4.6, true)] {
            assert_eq!(ratio(&[(0.0, 1.0), (tilt_deg, 2.0)]) > 1.5, uneven, "{tilt_deg}");
        }
    }

    #[test]
    fn what_cannot_be_is_not_believed() {
        assert!((ratio(&[(0.0, 0.0); 9].iter().copied().chain([(20.0, 1.0)]).collect::<Vec<_>>()) - 5.0).abs() < 1e-6);
        for samples in [&[][..], &[(20.0, 0.0)], &[(20.0, f32::NAN), (20.0, 1.0)], &[(f32::NAN, 1.0), (20.0, 1.0)]] {
            assert!((ratio(samples) - 1.0).abs() < f32::EPSILON, "{samples:?}");
        }
    }
}
