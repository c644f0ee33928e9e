//! A-posteriori variance factor of the calibration's coefficients.
//!
//! The covariance of a calibration includes errors whose size a solve can only bound, such as hard iron that changed
//! during the collection. In turns, the residuals of strength and inclination show how large they are: the factor is
//! the mean squared residual over the mean predicted variance. The noise of the samples is in the residuals and not in
//! the prediction, so that an accurate calibration keeps its factor of 1.

use core::f32::consts::TAU;

/// Turn with whose exponential the means are taken, radians: a circle shows an error on all headings.
const MEMORY_RAD: f32 = TAU;

/// Share of the predicted variance that the residuals show, because the filter's states follow the rest.
const RESIDUAL_SHARE: f32 = 0.5;

/// Largest square of a residual, relative to the mean variance: beyond it, the cause is a disturbance.
const MAX_RATIO: f32 = 4.0;

/// Smallest factor: half the sigma. Strength and inclination do not show all errors of the heading.
const MIN_FACTOR: f32 = 0.25;

#[derive(Clone, Copy, Debug)]
pub(super) struct CoefficientVarianceFactor {
    /// Means for strength and inclination; `None` before the first sample.
    means: Option<[ResidualMeans; 2]>,
}

#[derive(Clone, Copy, Debug)]
struct ResidualMeans {
    /// Mean squared residual over [`RESIDUAL_SHARE`].
    square: f32,
    /// Mean predicted variance.
    variance: f32,
}

impl CoefficientVarianceFactor {
    pub const INITIAL: Self = Self { means: None };

    /// Adds the residuals of strength and inclination (radians), and the variances that the coefficients' covariance
    /// predicts for them, after a turn since the last sample.
    pub fn update_means(&mut self, residuals: [Option<f32>; 2], variances: [f32; 2], turned_rad: f32) {
        let weight = turned_rad.abs() / (MEMORY_RAD + turned_rad.abs());
        let means =
            self.means.get_or_insert_with(|| variances.map(|variance| ResidualMeans { square: variance, variance }));
        for ((mean, residual), variance) in means.iter_mut().zip(residuals).zip(variances) {
            let Some(residual) = residual else { continue };
            mean.variance += weight * (variance - mean.variance);
            let square = residual * residual / RESIDUAL_SHARE;
            mean.square += weight * (square.min(MAX_RATIO * mean.variance) - mean.square);
        }
    }

    /// Factor on the variance that the coefficients cause in a heading.
    pub fn variance_factor(&self) -> f32 {
        // Without a variance the ratio is not a number, which `min` replaces.
        let ratios = self.means.map(|means| means.map(|mean| (mean.square / mean.variance).min(1.0)));
        ratios.map_or(1.0, |[strength, inclination]| strength.max(inclination).max(MIN_FACTOR))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Factor after turning with constant residuals, in predicted sigmas, at 10 Hz and 15 deg/s.
    fn factor_after(residual_sigmas: [Option<f32>; 2], circles: f32) -> f32 {
        let mut factor = CoefficientVarianceFactor::INITIAL;
        let residuals = [residual_sigmas[0].map(|n| 0.01 * n), residual_sigmas[1].map(|n| -0.02 * n)];
        for _ in 0..(circles * 240.0) as u32 {
            factor.update_means(residuals, [1e-4, 4e-4], TAU / 240.0);
        }
        factor.variance_factor()
    }

    /// The larger ratio counts, and both must be measured.
    #[test]
    fn residuals_as_predicted_keep_the_factor() {
        for residuals in [[Some(0.72), Some(0.1)], [Some(0.1), Some(0.72)], [Some(3.0); 2], [Some(0.1), None]] {
            assert!((factor_after(residuals, 10.0) - 1.0).abs() < 1e-3, "{residuals:?}");
        }
    }
}
