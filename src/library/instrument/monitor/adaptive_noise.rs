//! Adaptive measurement noise, a mixture of the calibration's and that of the last seconds; lag-1 autocorrelation of
//! the inclination residual.

use crate::trig::sqrt;

/// Noise variances of an averaged sample.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct SampleNoise {
    /// Variance of the relative field strength.
    pub strength_variance: f32,
    /// Variance of the tilt about each horizontal axis, square radians.
    pub tilt_variance_rad2: f32,
}

/// Time constant of the recent noise, seconds.
const RECENT_NOISE_TIME_CONSTANT_S: f32 = 10.0;

/// Weight of the recent variance; the rest is the weight of the calibration's variance. Fitted to recorded flights, as
/// the limits below.
const RECENT_NOISE_WEIGHT: f32 = 0.75;

/// Clipping of inclination and strength residuals, in sigmas.
const MAX_RESIDUAL_SIGMAS: f32 = 4.0;

/// Clipping of second differences of the strength, in sigmas of the calibration.
const MAX_STRENGTH_DIFFERENCE_SIGMAS: f32 = 6.0;

/// Lower limit of the strength sigma.
const MIN_STRENGTH_SIGMA: f32 = 0.003;

/// Upper limit of the strength sigma; more is a disturbance.
const MAX_STRENGTH_SIGMA: f32 = 0.008;

/// Time constant of the autocorrelation and of the strength residual, seconds.
const AUTOCORRELATION_AVERAGING_S: f32 = 30.0;

/// Initial lag-1 autocorrelation of the inclination residual.
const INITIAL_AUTOCORRELATION: f32 = 0.78;
/// Lower limit of the autocorrelation.
const MIN_AUTOCORRELATION: f32 = 0.6;
/// Upper limit of the autocorrelation.
const MAX_AUTOCORRELATION: f32 = 0.9;

#[derive(Clone, Copy, Debug)]
pub(super) struct AdaptiveNoise {
    recent_noise: SampleNoise,
    last_strengths: [f32; 2],
    /// Last residual, radians, and running means of its square and lag-1 product.
    last_inclination_residual_rad: f32,
    inclination_residual_mean_square_rad2: f32,
    inclination_residual_lag_1_product_rad2: f32,
    /// Running mean square of the strength residual, slow errors included.
    strength_residual_mean_square: f32,
}

impl AdaptiveNoise {
    pub fn new(calibration_noise: SampleNoise, strength: f32) -> Self {
        let dip_squared = calibration_noise.tilt_variance_rad2 + calibration_noise.strength_variance;
        Self {
            recent_noise: calibration_noise,
            last_strengths: [strength; 2],
            last_inclination_residual_rad: 0.0,
            inclination_residual_mean_square_rad2: dip_squared,
            inclination_residual_lag_1_product_rad2: INITIAL_AUTOCORRELATION * dip_squared,
            strength_residual_mean_square: calibration_noise
                .strength_variance
                .max(MIN_STRENGTH_SIGMA * MIN_STRENGTH_SIGMA),
        }
    }

    /// Variance inflation by autocorrelation `rho`: `(1 + rho) / (1 - rho)`.
    pub fn correlated_noise_factor(&self) -> f32 {
        let rho = self.inclination_residual_lag_1_product_rad2 / self.inclination_residual_mean_square_rad2;
        // 0/0 gives NaN, which is not above the lower limit.
        let rho = if rho > MIN_AUTOCORRELATION { rho.min(MAX_AUTOCORRELATION) } else { MIN_AUTOCORRELATION };
        (1.0 + rho) / (1.0 - rho)
    }

    pub fn sample_noise(&self, calibration_noise: SampleNoise) -> SampleNoise {
        let mixed = |recent: f32, calibration_noise: f32| {
            calibration_noise + RECENT_NOISE_WEIGHT * (recent - calibration_noise)
        };
        SampleNoise {
            strength_variance: mixed(self.recent_noise.strength_variance, calibration_noise.strength_variance),
            tilt_variance_rad2: mixed(
                self.recent_noise.tilt_variance_rad2.max(0.0),
                calibration_noise.tilt_variance_rad2,
            ),
        }
    }

    pub const fn strength_residual_mean_square(&self) -> f32 {
        self.strength_residual_mean_square
    }

    pub fn update_strength_residual(&mut self, residual: f32, step_s: f32) {
        let least = MIN_STRENGTH_SIGMA * MIN_STRENGTH_SIGMA;
        let most = MAX_RESIDUAL_SIGMAS * MAX_RESIDUAL_SIGMAS * self.strength_residual_mean_square;
        update_moving_average(
            &mut self.strength_residual_mean_square,
            (residual * residual).min(most).max(least),
            step_s / AUTOCORRELATION_AVERAGING_S,
        );
        self.strength_residual_mean_square =
            self.strength_residual_mean_square.min(MAX_STRENGTH_SIGMA * MAX_STRENGTH_SIGMA);
    }

    /// Updates the white part of the strength noise with a sample `step_s` after the last. A second difference has six
    /// times the variance of white noise, and slow changes cancel in it.
    pub fn update_strength_noise(&mut self, calibration_noise: SampleNoise, strength: f32, step_s: f32) {
        let [before, last] = self.last_strengths;
        self.last_strengths = [last, strength];
        let second = strength - 2.0 * last + before;
        let most =
            MAX_STRENGTH_DIFFERENCE_SIGMAS * MAX_STRENGTH_DIFFERENCE_SIGMAS * calibration_noise.strength_variance;
        update_moving_average(
            &mut self.recent_noise.strength_variance,
            (second * second / 6.0).min(most),
            step_s / RECENT_NOISE_TIME_CONSTANT_S,
        );
    }

    /// Updates tilt noise and autocorrelation with an inclination residual, radians, `step_s` after the last. The
    /// sensor's noise in it is subtracted.
    pub fn update_tilt_noise(&mut self, calibration_noise: SampleNoise, residual_rad: f32, step_s: f32) {
        let most = MAX_RESIDUAL_SIGMAS * MAX_RESIDUAL_SIGMAS * calibration_noise.tilt_variance_rad2;
        let most_rad = sqrt(most);
        let residual_rad = residual_rad.max(-most_rad).min(most_rad);
        update_moving_average(
            &mut self.recent_noise.tilt_variance_rad2,
            residual_rad * residual_rad - self.recent_noise.strength_variance,
            step_s / RECENT_NOISE_TIME_CONSTANT_S,
        );
        let part = step_s / AUTOCORRELATION_AVERAGING_S;
        update_moving_average(&mut self.inclination_residual_mean_square_rad2, residual_rad * residual_rad, part);
        update_moving_average(
            &mut self.inclination_residual_lag_1_product_rad2,
            residual_rad * self.last_inclination_residual_rad,
            part,
        );
        self.last_inclination_residual_rad = residual_rad;
    }
}

fn update_moving_average(mean: &mut f32, value: f32, weight: f32) {
    *mean += weight.min(1.0) * (value - *mean);
}
