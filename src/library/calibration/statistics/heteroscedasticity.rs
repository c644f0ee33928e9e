//! Heteroscedasticity of the inclination residuals (H. White, "A Heteroskedasticity-Consistent Covariance Matrix
//! Estimator", Econometrica 48, 1980).
//!
//! The solver assumes equal variance. The attitude source of a vehicle that tilts to accelerate is worse while tilted,
//! and these samples determine the mounting about the vertical axis. So the variance is weighted by the squared tilt of
//! each sample, a one-dimensional form of White's estimator. Without it, 2 of 100 simulated copter calibrations had a
//! constant error of three times the expected one.

use crate::frames::RollPitch;

/// Mean squared tilt below which a vehicle does not tilt, square radians: (3 deg)^2.
const MIN_MEAN_SQUARE_TILT_RAD2: f32 = 0.003;

/// Upper limit of the variance ratio.
const MAX_VARIANCE_RATIO: f32 = 5.0;

#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(in crate::calibration) struct Heteroscedasticity {
    tilt_weighted_squares: f32,
    squared_tilts: f32,
    squared_residuals: f32,
    sample_count: f32,
}

impl Heteroscedasticity {
    pub fn add_residual(&mut self, attitude: RollPitch, residual: f32) {
        let RollPitch { roll_rad, pitch_rad } = attitude;
        let tilt = (roll_rad * roll_rad + pitch_rad * pitch_rad).min(1.0);
        let square = residual * residual;
        self.tilt_weighted_squares += square * tilt;
        self.squared_tilts += tilt;
        self.squared_residuals += square;
        self.sample_count += 1.0;
    }

    /// Ratio of the tilt-weighted to the plain variance; at least 1.
    pub fn variance_ratio(&self) -> f32 {
        if self.squared_tilts < MIN_MEAN_SQUARE_TILT_RAD2 * self.sample_count || self.squared_residuals <= 0.0 {
            return 1.0;
        }
        let ratio = (self.tilt_weighted_squares / self.squared_tilts) * (self.sample_count / self.squared_residuals);
        // A NaN ratio counts as 1.
        if ratio > 1.0 { ratio.min(MAX_VARIANCE_RATIO) } else { 1.0 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn variance_ratio_of(samples: &[(f32, f32)]) -> f32 {
        let mut sums = Heteroscedasticity::default();
        for &(tilt_deg, residual) in samples {
            sums.add_residual(RollPitch::from_deg(0.6 * tilt_deg, -0.8 * tilt_deg), residual);
        }
        sums.variance_ratio()
    }

    /// Half of the samples level, half tilted with twice the residual: 4 over the mean of 1 and 4.
    #[test]
    fn inclination_residuals_are_weighted_by_squared_tilt() {
        assert!((variance_ratio_of(&[(0.0, 1.0), (20.0, -2.0)]) - 4.0 / 2.5).abs() < 1e-5);
        // Weighted by squared tilt: (16 * 4 + 1 * 1) / 17 over the mean of 4, 1 and 1.
        assert!((variance_ratio_of(&[(20.0, 2.0), (5.0, 1.0), (0.0, 1.0)]) - (65.0 / 17.0) / 2.0).abs() < 1e-4);
        assert!((variance_ratio_of(&[(0.0, 2.0), (20.0, 1.0)]) - 1.0).abs() < f32::EPSILON);
        assert!((variance_ratio_of(&[(25.0, 1.0), (25.0, -1.0)]) - 1.0).abs() < 1e-5);
        // In level flight the tilt is noise.
        assert!((variance_ratio_of(&[(0.0, 1.0), (2.0, 2.0)]) - 1.0).abs() < f32::EPSILON);
    }

    #[test]
    fn ratio_is_limited_and_finite() {
        let mut one_in_ten = [(0.0, 0.0); 10];
        one_in_ten[9] = (20.0, 1.0);
        assert!((variance_ratio_of(&one_in_ten) - 5.0).abs() < 1e-6);
        for samples in [&[][..], &[(20.0, 0.0)], &[(20.0, f32::NAN), (20.0, 1.0)], &[(f32::NAN, 1.0), (20.0, 1.0)]] {
            assert!((variance_ratio_of(samples) - 1.0).abs() < f32::EPSILON, "{samples:?}");
        }
    }
}
