//! Adaptive measurement noise, a mixture of the calibration's and that of the last seconds; lag-1 autocorrelation of
//! the inclination residual.

use crate::trig::sqrt;
/// Noise variances of an averaged sample.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct SampleNoise {
    /// Of the relative field strength.
    pub strength_variance: f32,
    /// Of the tilt about each horizontal axis, square radians.
    pub tilt_rad2: f32,
}

#[derive(Clone, Copy, Debug)]
pub struct AdaptiveNoiseConfig {
    /// Time constant of the recent noise, seconds.
    pub recent_time_s: f32,
    /// Weight of the recent variance; the rest is the calibration's.
    pub recent_weight: f32,
    /// Clipping of inclination residuals, in sigmas of the calibration.
    pub max_tilt_sigmas: f32,
    /// Clipping of second differences of the strength, in sigmas of the calibration.
    pub max_strength_sigmas: f32,
    /// Lower limit of the strength sigma.
    pub min_strength_sigma: f32,
    /// Upper limit of the strength sigma; more is a disturbance.
    pub max_strength_sigma: f32,
    /// Time constant of the autocorrelation and of the strength residual, seconds.
    pub autocorrelation_averaging_s: f32,
    /// Initial lag-1 autocorrelation of the inclination residual.
    pub initial_autocorrelation: f32,
    pub autocorrelation_limits: [f32; 2],
}

impl AdaptiveNoiseConfig {
    /// Fitted to recorded flights.
    pub const DEFAULT: Self = Self {
        recent_time_s: 10.0,
        recent_weight: 0.75,
        max_tilt_sigmas: 4.0,
        max_strength_sigmas: 6.0,
        min_strength_sigma: 0.003,
        max_strength_sigma: 0.008,
        autocorrelation_averaging_s: 30.0,
        initial_autocorrelation: 0.78,
        autocorrelation_limits: [0.6, 0.9],
    };
}

#[derive(Clone, Copy, Debug)]
pub(super) struct AdaptiveNoise {
    recent_noise: SampleNoise,
    last_strengths: [f32; 2],
    /// Last residual, radians, and running means of its square and lag-1 product.
    last_inclination_residual_rad: f32,
    inclination_mean_square_rad2: f32,
    inclination_lag_1_product_rad2: f32,
    /// Running mean, including slow errors.
    strength_mean_square: f32,
}

impl AdaptiveNoise {
    pub fn new(config: &AdaptiveNoiseConfig, calibration_noise: SampleNoise, strength: f32) -> Self {
        let dip_squared = calibration_noise.tilt_rad2 + calibration_noise.strength_variance;
        Self {
            recent_noise: calibration_noise,
            last_strengths: [strength; 2],
            last_inclination_residual_rad: 0.0,
            inclination_mean_square_rad2: dip_squared,
            inclination_lag_1_product_rad2: config.initial_autocorrelation * dip_squared,
            strength_mean_square: calibration_noise
                .strength_variance
                .max(config.min_strength_sigma * config.min_strength_sigma),
        }
    }

    /// Variance inflation by autocorrelation `rho`: `(1 + rho) / (1 - rho)`.
    pub fn correlated_noise_factor(&self, config: &AdaptiveNoiseConfig) -> f32 {
        let [least, most] = config.autocorrelation_limits;
        // 0/0 gives NaN, which `max` replaces by the lower limit.
        let rho = (self.inclination_lag_1_product_rad2 / self.inclination_mean_square_rad2).max(least).min(most);
        (1.0 + rho) / (1.0 - rho)
    }

    pub fn sample_noise(&self, config: &AdaptiveNoiseConfig, calibration_noise: SampleNoise) -> SampleNoise {
        let mixed = |recent: f32, calibration_noise: f32| {
            calibration_noise + config.recent_weight * (recent - calibration_noise)
        };
        SampleNoise {
            strength_variance: mixed(self.recent_noise.strength_variance, calibration_noise.strength_variance),
            tilt_rad2: mixed(self.recent_noise.tilt_rad2.max(0.0), calibration_noise.tilt_rad2),
        }
    }

    pub const fn strength_mean_square(&self) -> f32 {
        self.strength_mean_square
    }

    pub fn update_strength_residual(&mut self, config: &AdaptiveNoiseConfig, residual: f32, step_s: f32) {
        let least = config.min_strength_sigma * config.min_strength_sigma;
        let most = config.max_tilt_sigmas * config.max_tilt_sigmas * self.strength_mean_square;
        update_moving_average(
            &mut self.strength_mean_square,
            (residual * residual).min(most).max(least),
            step_s / config.autocorrelation_averaging_s,
        );
        self.strength_mean_square =
            self.strength_mean_square.min(config.max_strength_sigma * config.max_strength_sigma);
    }

    /// Updates the white part of the strength noise with a sample `step_s` after the last. A second difference has six
    /// times the variance of white noise, and slow changes cancel in it.
    pub fn update_strength_noise(
        &mut self,
        config: &AdaptiveNoiseConfig,
        calibration_noise: SampleNoise,
        strength: f32,
        step_s: f32,
    ) {
        let [before, last] = self.last_strengths;
        self.last_strengths = [last, strength];
        let second = strength - 2.0 * last + before;
        let most = config.max_strength_sigmas * config.max_strength_sigmas * calibration_noise.strength_variance;
        update_moving_average(
            &mut self.recent_noise.strength_variance,
            (second * second / 6.0).min(most),
            step_s / config.recent_time_s,
        );
    }

    /// Updates tilt noise and autocorrelation with an inclination residual, radians, `step_s` after the last. The
    /// sensor's noise in it is subtracted.
    pub fn update_tilt_noise(
        &mut self,
        config: &AdaptiveNoiseConfig,
        calibration_noise: SampleNoise,
        residual_rad: f32,
        step_s: f32,
    ) {
        let most = config.max_tilt_sigmas * config.max_tilt_sigmas * calibration_noise.tilt_rad2;
        let most_rad = sqrt(most);
        let residual_rad = residual_rad.max(-most_rad).min(most_rad);
        update_moving_average(
            &mut self.recent_noise.tilt_rad2,
            residual_rad * residual_rad - self.recent_noise.strength_variance,
            step_s / config.recent_time_s,
        );
        let part = step_s / config.autocorrelation_averaging_s;
        update_moving_average(&mut self.inclination_mean_square_rad2, residual_rad * residual_rad, part);
        update_moving_average(
            &mut self.inclination_lag_1_product_rad2,
            residual_rad * self.last_inclination_residual_rad,
            part,
        );
        self.last_inclination_residual_rad = residual_rad;
    }
}

fn update_moving_average(mean: &mut f32, value: f32, part: f32) {
    *mean += part.min(1.0) * (value - *mean);
}

#[cfg(test)]
mod tests {
    use testkit::random::Random;

    use super::*;

    const CALIBRATION_NOISE: SampleNoise = SampleNoise { strength_variance: 1e-4, tilt_rad2: 4e-4 };

    /// Noise after `seconds` of samples at 10 Hz with this multiple of the calibration's sigma, and a strength drift of
    /// 0.1 % per second.
    fn noise_after(sigmas: f32, seconds: u16) -> SampleNoise {
        let mut random = Random(1);
        let mut noise = AdaptiveNoise::new(&AdaptiveNoiseConfig::DEFAULT, CALIBRATION_NOISE, 1.0);
        for i in 0..10 * seconds {
            let strength = 1.0 + 1e-4 * f32::from(i) + 0.01 * sigmas * random.normal();
            noise.update_strength_noise(&AdaptiveNoiseConfig::DEFAULT, CALIBRATION_NOISE, strength, 0.1);
            let sensor_noise = 0.01 * sigmas * random.normal();
            noise.update_tilt_noise(
                &AdaptiveNoiseConfig::DEFAULT,
                CALIBRATION_NOISE,
                0.02 * sigmas * random.normal() + sensor_noise,
                0.1,
            );
        }
        noise.sample_noise(&AdaptiveNoiseConfig::DEFAULT, CALIBRATION_NOISE)
    }

    /// A quarter of the calibration's variance and three quarters of the actual one.
    #[test]
    fn recent_noise_has_a_weight_of_three_quarters() {
        for (sigmas, expected) in [(1.0, 1.0), (2.0, 3.25), (0.0, 0.25)] {
            let found = noise_after(sigmas, 120);
            assert!(
                (found.strength_variance / CALIBRATION_NOISE.strength_variance / expected - 1.0).abs() < 0.25,
                "{sigmas}: {found:?}"
            );
            assert!(
                (found.tilt_rad2 / CALIBRATION_NOISE.tilt_rad2 / expected - 1.0).abs() < 0.25,
                "{sigmas}: {found:?}"
            );
        }
    }

    #[test]
    fn recent_noise_has_a_time_constant_of_ten_seconds() {
        let mut noise = AdaptiveNoise::new(&AdaptiveNoiseConfig::DEFAULT, CALIBRATION_NOISE, 1.0);
        for _ in 0..100 {
            noise.update_tilt_noise(&AdaptiveNoiseConfig::DEFAULT, CALIBRATION_NOISE, 0.041_23, 0.1);
        }
        let recent = noise.recent_noise.tilt_rad2 / CALIBRATION_NOISE.tilt_rad2;
        assert!((recent - (1.0 + 3.0 * 0.632)).abs() < 0.02, "{recent}");
    }

    /// Limits: 16 and 36 times the calibration's variance.
    #[test]
    fn noise_estimates_are_clipped() {
        let mut noise = AdaptiveNoise::new(&AdaptiveNoiseConfig::DEFAULT, CALIBRATION_NOISE, 1.0);
        for i in 0..2000_u16 {
            noise.update_strength_noise(&AdaptiveNoiseConfig::DEFAULT, CALIBRATION_NOISE, f32::from(i % 2), 0.1);
        }
        assert!(
            (noise.recent_noise.strength_variance / CALIBRATION_NOISE.strength_variance - 36.0).abs() < 0.01,
            "{noise:?}"
        );
        let mut noise = AdaptiveNoise::new(&AdaptiveNoiseConfig::DEFAULT, CALIBRATION_NOISE, 1.0);
        for _ in 0..2000 {
            noise.update_tilt_noise(&AdaptiveNoiseConfig::DEFAULT, CALIBRATION_NOISE, 1.0, 0.1);
        }
        assert!((noise.recent_noise.tilt_rad2 / CALIBRATION_NOISE.tilt_rad2 - 15.75).abs() < 0.01, "{noise:?}");
    }

    #[test]
    fn the_tilt_variance_is_never_negative() {
        let mut noise = AdaptiveNoise::new(&AdaptiveNoiseConfig::DEFAULT, CALIBRATION_NOISE, 1.0);
        for _ in 0..2000 {
            noise.update_tilt_noise(&AdaptiveNoiseConfig::DEFAULT, CALIBRATION_NOISE, 0.0, 0.1);
        }
        let found = noise.sample_noise(&AdaptiveNoiseConfig::DEFAULT, CALIBRATION_NOISE);
        assert!((found.tilt_rad2 - 1e-4).abs() < 1e-9, "a quarter of the calibration's: {found:?}");
    }

    #[test]
    fn a_long_gap_replaces_the_recent_noise() {
        let mut noise = AdaptiveNoise::new(&AdaptiveNoiseConfig::DEFAULT, CALIBRATION_NOISE, 1.0);
        noise.update_tilt_noise(&AdaptiveNoiseConfig::DEFAULT, CALIBRATION_NOISE, 0.014_142, 1000.0);
        assert!((noise.recent_noise.tilt_rad2 - 1e-4).abs() < 1e-8, "{noise:?}");
    }
}
