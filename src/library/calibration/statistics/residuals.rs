//! Statistics of the residuals of one pass over the samples.

use super::discrepancy::Discrepancy;
use crate::calibration::fit::information_matrix::InformationMatrix;
use crate::calibration::model::{CLIPPED_MEAN_SQUARE, Vector13};
use crate::calibration::types::samples::PART_COUNT;
use crate::frames::RollPitch;
use crate::time::WrappingMillis;

#[derive(Clone, Debug)]
pub(in crate::calibration) struct ResidualStatistics {
    /// Information of the inclination residuals.
    pub inclination_information: InformationMatrix,
    /// Lag-1 autocorrelation of the norm and inclination residuals.
    pub autocorrelation: Autocorrelation,
    pub heteroscedasticity: Heteroscedasticity,
    pub discrepancy: Discrepancy,
    pub white_noise: WhiteNoiseFraction,
}

impl ResidualStatistics {
    pub fn zero() -> Self {
        Self {
            inclination_information: InformationMatrix::zero(),
            autocorrelation: Autocorrelation::default(),
            heteroscedasticity: Heteroscedasticity::default(),
            discrepancy: Discrepancy::default(),
            white_noise: WhiteNoiseFraction::default(),
        }
    }

    /// Variance inflation by autocorrelation, the larger of both residuals'.
    #[inline(never)]
    pub fn autocorrelation_inflation(&self) -> f32 {
        let [norm_excess, inclination_excess] = self.autocorrelation.excess_variance_inflation();
        1.0 + norm_excess.max(inclination_excess)
    }

    /// `(x - reference_inflation) H_incl vector`, `x` the variance inflation of the inclination residuals; at least 0.
    pub fn excess_inclination_information_times(&self, vector: &Vector13, reference_inflation: f32) -> Vector13 {
        let [_, inclination_excess] = self.autocorrelation.excess_variance_inflation();
        self.inclination_information.multiply_vector(vector) * (1.0 + inclination_excess - reference_inflation).max(0.0)
    }
}

/// Upper limit of rho: an effective sample size of 1/39.
const MAX_AUTOCORRELATION: f32 = 0.95;

/// Lag-1 autocorrelation of the residuals of a flight.
///
/// For first-order autoregressive errors with autocorrelation rho, the effective sample size is `(1 - rho) / (1 + rho)`
/// of the number of samples.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(in crate::calibration) struct Autocorrelation {
    lag_products: [f32; 2],
    square_sums: [f32; 2],
    previous_residuals: [[f32; 2]; PART_COUNT],
}

impl Autocorrelation {
    pub fn add_residuals(&mut self, part: usize, residuals: [f32; 2]) {
        let Some(previous) = self.previous_residuals.get_mut(part) else { return };
        for (kind, residual) in residuals.into_iter().enumerate() {
            self.lag_products[kind] += residual * previous[kind];
            self.square_sums[kind] += residual * residual;
        }
        *previous = residuals;
    }

    /// Variance inflation minus one, `2 rho / (1 - rho)`, of norm and inclination residuals; 0 for negative rho.
    pub fn excess_variance_inflation(&self) -> [f32; 2] {
        [0, 1].map(|kind| {
            let (products, squares) = (self.lag_products[kind], self.square_sums[kind]);
            let rho = if squares > 0.0 { (products / squares).clamp(0.0, MAX_AUTOCORRELATION) } else { 0.0 };
            2.0 * rho / (1.0 - rho)
        })
    }

    pub fn sums_of_squares(&self) -> [f32; 2] {
        self.square_sums
    }
}

/// Mean squared tilt below which a vehicle does not tilt, square radians: (3 deg)^2.
const MIN_MEAN_SQUARE_TILT_RAD2: f32 = 0.003;

/// Upper limit of the variance ratio.
const MAX_VARIANCE_RATIO: f32 = 5.0;

#[derive(Clone, Copy, Debug, Default, PartialEq)]
/// Heteroscedasticity of the inclination residuals (H. White, "A Heteroskedasticity-Consistent Covariance Matrix
/// Estimator", Econometrica 48, 1980).
///
/// The solver assumes equal variance. The attitude source of a vehicle that tilts to accelerate is worse while tilted,
/// and these samples determine the mounting about the vertical axis. So the variance is weighted by the squared tilt of
/// each sample, a one-dimensional form of White's estimator. Without it, 2 of 100 simulated copter calibrations had a
/// constant error of three times the expected one.
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

/// Maximum time between neighbouring samples, milliseconds: 20 deg in an ordinary turn.
const MAX_GAP_MS: u32 = 1500;

const MIN_DIFFERENCES: f32 = 20.0;

#[derive(Clone, Copy, Debug, Default)]
/// White-noise fraction of the norm residuals.
///
/// Averaging readings reduces white noise only. Other norm errors (unmodelled iron, temperature) vary as slowly as the
/// aircraft turns and are common to all readings of a sample. The second difference of three successive samples removes
/// linear trends and has six times the variance of the white noise. With samples far apart the fraction is an upper
/// limit.
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
mod heteroscedasticity_tests {
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

#[cfg(test)]
mod white_noise_fraction_tests {
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
