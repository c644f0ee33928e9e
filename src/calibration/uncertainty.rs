//! How wrong a heading may be: what is left unknown of the coefficients, and the noise of sensor and attitude.

use nalgebra::{Matrix3, SVector, Vector3};
use serde::{Deserialize, Serialize};

use super::Calibration;
use crate::frames::{Field, Level, Sensor};

/// The corrected field, in units of the total field, is `W x - beta` with `x = (m - b) / F` and `beta = 0`: twelve
/// coefficients whose errors move it.
pub(super) const COEFFICIENTS: usize = 12;
pub(super) type Vector12 = SVector<f32, COEFFICIENTS>;

/// Covariance of the twelve coefficients, and the noise that the samples showed. 320 bytes.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Uncertainty {
    /// Lower triangle, row by row, of the covariance of `W` (row by row) and `beta`, the latter in units of the total
    /// field. As an array of arrays because the stored format has no longer ones.
    covariance: [[f32; 13]; 6],
    /// Noise of an averaged reading on each axis, in units of the total field.
    pub sensor_sigma: f32,
    /// Noise of roll and of pitch, radians.
    pub attitude_sigma_rad: f32,
}

impl Uncertainty {
    /// Everything known exactly.
    pub const NONE: Self = Self { covariance: [[0.0; 13]; 6], sensor_sigma: 0.0, attitude_sigma_rad: 0.0 };

    /// From the elements of the covariance: asked for row by row, from the first column to the diagonal.
    pub(super) fn new(
        sensor_sigma: f32,
        attitude_sigma_rad: f32,
        mut covariance: impl FnMut(usize, usize) -> f32,
    ) -> Self {
        let mut packed = [[0.0; 13]; 6];
        for (packed, (row, column)) in packed.as_flattened_mut().iter_mut().zip(triangle()) {
            *packed = covariance(row, column);
        }
        Self { covariance: packed, sensor_sigma, attitude_sigma_rad }
    }

    /// Whether all numbers are finite: asked of what comes out of flash.
    #[must_use]
    pub fn is_finite(&self) -> bool {
        self.covariance.as_flattened().iter().all(|c| c.is_finite())
            && self.sensor_sigma.is_finite()
            && self.attitude_sigma_rad.is_finite()
    }

    /// Standard deviation of a heading, radians: from the coefficients' errors, and from the noise of attitude and sensor
    /// at this very attitude. `level` is the corrected field at that attitude; `readings` is how many readings an averaged
    /// one was made of, whose noise is that much smaller than the one reading's behind this heading.
    #[must_use]
    pub fn heading_sigma_rad(
        &self,
        calibration: &Calibration,
        sensor: &Field<Sensor>,
        level_from_body: &Matrix3<f32>,
        level: &Field<Level>,
        readings: f32,
    ) -> f32 {
        let total_ut = calibration.total_ut;
        let level = Field::new(level.ut / total_ut);
        let by_field = heading_by_field(level_from_body, &level);
        let by_reading = calibration.w_matrix().tr_mul(&by_field);
        let x = (sensor.ut - calibration.b_vector_ut()) / total_ut;
        let horizontal = level.ut.x * level.ut.x + level.ut.y * level.ut.y;
        let tan_squared = level.ut.z * level.ut.z / horizontal.max(MIN_HORIZONTAL);
        let noise = by_reading.norm_squared() * self.sensor_sigma * self.sensor_sigma * readings;
        let attitude = self.attitude_sigma_rad * self.attitude_sigma_rad * tan_squared;
        libm::sqrtf(self.variance(&coefficient_row(&by_field, &x)) + noise + attitude)
    }

    /// `row^T covariance row`, never negative.
    pub(super) fn variance(&self, row: &Vector12) -> f32 {
        let mut packed = self.covariance.as_flattened().iter();
        let mut sum = 0.0;
        for i in 0..COEFFICIENTS {
            let mut partial = 0.0;
            for (&column, &c) in row.iter().take(i).zip(&mut packed) {
                partial += column * c;
            }
            let diagonal = packed.next().copied().unwrap_or(0.0);
            sum += row[i] * (2.0 * partial + row[i] * diagonal);
        }
        sum.max(0.0)
    }
}

/// Next to a magnetic pole there is no heading; the floor keeps the figure finite and huge.
const MIN_HORIZONTAL: f32 = 1e-6;

/// Rows and columns of the lower triangle.
fn triangle() -> impl Iterator<Item = (usize, usize)> {
    (0..COEFFICIENTS).flat_map(|row| (0..=row).map(move |column| (row, column)))
}

/// Derivative of the heading by the corrected field in body axes and units of the total field: with
/// `psi = atan2(-l_y, l_x)`, `d psi = (l_y d l_x - l_x d l_y) / (l_x^2 + l_y^2)`.
pub(super) fn heading_by_field(level_from_body: &Matrix3<f32>, direction: &Field<Level>) -> Vector3<f32> {
    let level = direction.ut;
    let horizontal = (level.x * level.x + level.y * level.y).max(MIN_HORIZONTAL);
    level_from_body.tr_mul(&Vector3::new(level.y, -level.x, 0.0)) / horizontal
}

/// Derivative by the coefficients of `by_field . (W x - beta)`.
pub(super) fn coefficient_row(by_field: &Vector3<f32>, x: &Vector3<f32>) -> Vector12 {
    let mut row = Vector12::zeros();
    for i in 0..3 {
        for j in 0..3 {
            row[3 * i + j] = by_field[i] * x[j];
        }
        row[9 + i] = -by_field[i];
    }
    row
}
