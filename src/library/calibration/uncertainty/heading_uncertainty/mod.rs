//! Heading variance from the covariance of the coefficients and the noise of sensor and attitude.

use nalgebra::Vector3;

use super::coefficient_covariance::{CoefficientConversion, CoefficientCovariance};
use crate::calibration::model::{
    Likelihood, UPPER_TRIANGLE_3, UPPER_TRIANGLE_4, Vector13, beta_index, heading_derivative_by_field,
    horizontal_squared, w_index,
};
use crate::calibration::types::coefficients::Calibration;
use crate::frames::{AttitudeRotation, Field, Level, Sensor};
use crate::trig::sqrt;

/// Attitude noise assumed when no sample shows it, radians: 0.5 deg.
const DEFAULT_ATTITUDE_SIGMA_RAD: f32 = 0.0087;

/// Covariance of the coefficients reduced to what headings depend on, and the noise. 248 bytes.
///
/// A heading changes by `f . (dW x - d beta)`, so its variance is a sum over products of two components of `f` and two
/// of `y = (x, -1)`: 60 different numbers.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct HeadingUncertainty {
    /// Sums of covariance elements, by products of `f`'s components, then of `y`'s, in the order of an upper triangle's
    /// rows.
    pub reduced_covariance: [[f32; 10]; 6],
    /// White noise of a single reading on each axis, units of the total field. The mean of `n` readings has
    /// `1 / sqrt(n)` of it.
    pub relative_sensor_sigma: f32,
    /// Noise of roll and pitch, radians: robust scale of the inclination residuals minus the sensor's white noise.
    /// Includes slow field errors, which affect a heading equally. Not reduced by averaging.
    pub attitude_sigma_rad: f32,
}

/// Variance of a heading, square radians, in two parts.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HeadingVariance {
    /// Variance from errors of the coefficients: constant at an attitude and heading.
    pub coefficient_variance_rad2: f32,
    /// Variance from noise of sensor and attitude.
    pub noise_variance_rad2: f32,
}

impl HeadingVariance {
    /// Total standard deviation, radians.
    #[must_use]
    pub fn sigma_rad(&self) -> f32 {
        sqrt(self.coefficient_variance_rad2 + self.noise_variance_rad2)
    }
}

impl HeadingUncertainty {
    /// Zero uncertainty.
    pub const NO_UNCERTAINTY: Self =
        Self { reduced_covariance: [[0.0; 10]; 6], relative_sensor_sigma: 0.0, attitude_sigma_rad: 0.0 };

    fn from_covariance(
        covariance: &CoefficientCovariance,
        relative_sensor_sigma: f32,
        attitude_sigma_rad: f32,
    ) -> Self {
        // Index of the coefficient multiplied by components `k` of `f` and `a` of `y`.
        let coefficient = |k: usize, a: usize| if a < 3 { w_index(k, a) } else { beta_index(k) };
        let products = UPPER_TRIANGLE_3.map(|(k, l)| {
            UPPER_TRIANGLE_4.map(|(a, b)| {
                let first = covariance.element(coefficient(k, a), coefficient(l, b));
                let second = covariance.element(coefficient(k, b), coefficient(l, a));
                let sum = if a == b { first } else { first + second };
                if k == l { sum } else { 2.0 * sum }
            })
        });
        Self { reduced_covariance: products, relative_sensor_sigma, attitude_sigma_rad }
    }

    /// Whether all numbers are finite: check for data from flash.
    #[must_use]
    pub fn is_finite(&self) -> bool {
        self.reduced_covariance.as_flattened().iter().all(|component| component.is_finite())
            && self.relative_sensor_sigma.is_finite()
            && self.attitude_sigma_rad.is_finite()
    }

    /// Heading variance from errors of the coefficients and from the noise of attitude and a single reading. `level`:
    /// the reading corrected and levelled.
    #[must_use]
    pub fn heading_variance(
        &self,
        calibration: &Calibration,
        sensor: Field<Sensor>,
        tilt: &AttitudeRotation,
        level: Field<Level>,
    ) -> HeadingVariance {
        let per_total = 1.0 / calibration.total_ut;
        let level = level.ut * per_total;
        let x = (sensor.ut - calibration.b_vector_ut()) * per_total;
        let by_field = heading_derivative_by_field(tilt, &level);
        // `W^T f`, unrolled because it runs for every heading.
        let [[a, b, c], [d, e, f], [g, h, i]] = calibration.w;
        let rx = a * by_field.x + d * by_field.y + g * by_field.z;
        let ry = b * by_field.x + e * by_field.y + h * by_field.z;
        let rz = c * by_field.x + f * by_field.y + i * by_field.z;
        let sensor = (rx * rx + ry * ry + rz * rz) * self.relative_sensor_sigma * self.relative_sensor_sigma;
        // A tilt error rotates the heading by `tan(inclination)` times its component towards the field.
        let tan_squared = level.z * level.z / horizontal_squared(&level);
        let attitude = self.attitude_sigma_rad * self.attitude_sigma_rad * tan_squared;
        HeadingVariance {
            coefficient_variance_rad2: self.variance_from_coefficients(&by_field, &x),
            noise_variance_rad2: sensor + attitude,
        }
    }

    /// Variance from errors of the coefficients of a quantity with this derivative by the corrected field, at
    /// `x = (m - b) / F`; units of the total field. At least 0.
    pub(crate) fn variance_from_coefficients(
        &self,
        derivative_by_field: &Vector3<f32>,
        relative_field: &Vector3<f32>,
    ) -> f32 {
        let (f, x) = (derivative_by_field, relative_field);
        // In the order of `UPPER_TRIANGLE_3` and `UPPER_TRIANGLE_4`, unrolled because it runs for every heading.
        let products_of_f = [f.x * f.x, f.x * f.y, f.x * f.z, f.y * f.y, f.y * f.z, f.z * f.z];
        let products_of_x = [x.x * x.x, x.x * x.y, x.x * x.z, x.y * x.y, x.y * x.z, x.z * x.z];
        let variance = self.reduced_covariance.iter().zip(&products_of_f).map(
            |([xx, xy, xz, x1, yy, yz, y1, zz, z1, unit], f)| {
                let quadratic_form = xx * products_of_x[0]
                    + xy * products_of_x[1]
                    + xz * products_of_x[2]
                    + yy * products_of_x[3]
                    + yz * products_of_x[4]
                    + zz * products_of_x[5];
                f * (quadratic_form - (x1 * x.x + y1 * x.y + z1 * x.z) + unit)
            },
        );
        variance.sum::<f32>().max(0.0)
    }
}

/// Heading uncertainty from the covariance, the noise, and the white fraction of the norm residuals' variance.
///
/// Attitude noise is the variance of the inclination residual minus the sensor's white noise. It thus contains slow
/// field errors, which affect a heading equally. Its scale is Huber's proposal 2,
/// `mean(min(e^2, (2 s)^2)) / 0.92 = s^2`, which unlike a median needs no buffer.
pub(in crate::calibration) fn heading_uncertainty(
    likelihood: &Likelihood,
    unknowns: &Vector13,
    covariance: &CoefficientCovariance,
    white_fraction: f32,
) -> Option<HeadingUncertainty> {
    let noise = &likelihood.noise;
    let white = noise.norm_sigma * noise.norm_sigma * white_fraction;
    let attitude_sigma_rad = if likelihood.config.uses_attitude {
        sqrt((noise.inclination_sigma_rad * noise.inclination_sigma_rad - white).max(0.0))
    } else {
        DEFAULT_ATTITUDE_SIGMA_RAD
    };
    // White noise of one reading from that of a mean of `readings_per_sample`.
    let reading_sigma = sqrt(white * f32::from(likelihood.readings_per_sample.max(1)));
    let relative_sensor_sigma = reading_sigma / CoefficientConversion::new(likelihood, unknowns)?.determinant_scale;
    Some(HeadingUncertainty::from_covariance(covariance, relative_sensor_sigma, attitude_sigma_rad))
        .filter(HeadingUncertainty::is_finite)
}

#[cfg(test)]
mod tests;
