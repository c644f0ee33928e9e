//! How wrong a heading may be: what is left unknown of the coefficients, and the noise of sensor and attitude.

use nalgebra::{SVector, Vector3};
use serde::{Deserialize, Serialize};

use super::Calibration;
use crate::frames::{Field, Sensor, Tilt};

/// The corrected field, in units of the total field, is `W x - beta` with `x = (m - b) / F` and `beta = 0`: twelve
/// coefficients whose errors move it.
pub(super) const COEFFICIENTS: usize = 12;
pub(super) type Vector12 = SVector<f32, COEFFICIENTS>;

/// Covariance of the twelve coefficients: `W` row by row, and `beta` in units of the total field. Lower triangle, row by
/// row.
#[derive(Clone, Debug)]
pub(super) struct Covariance([f32; COEFFICIENTS * (COEFFICIENTS + 1) / 2]);

impl Covariance {
    /// Everything known exactly.
    pub const EXACT: Self = Self([0.0; COEFFICIENTS * (COEFFICIENTS + 1) / 2]);

    /// Takes its elements: asked for row by row, from the first column to the diagonal. `None` if one is not finite.
    pub fn fill(&mut self, mut element: impl FnMut(usize, usize) -> f32) -> Option<()> {
        let triangle = (0..COEFFICIENTS).flat_map(|row| (0..=row).map(move |column| (row, column)));
        for (packed, (row, column)) in self.0.iter_mut().zip(triangle) {
            *packed = element(row, column);
        }
        self.0.iter().all(|c| c.is_finite()).then_some(())
    }

    fn at(&self, i: usize, j: usize) -> f32 {
        let (row, column) = (i.max(j), i.min(j));
        self.0.get(row * (row + 1) / 2 + column).copied().unwrap_or(0.0)
    }

    /// `row^T covariance row`, never negative.
    pub fn variance(&self, row: &Vector12) -> f32 {
        let mut packed = self.0.iter();
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

/// Pairs `(a, b)` with `a <= b` of four numbers, and of three.
const PAIRS_OF_4: [(usize, usize); 10] =
    [(0, 0), (0, 1), (0, 2), (0, 3), (1, 1), (1, 2), (1, 3), (2, 2), (2, 3), (3, 3)];
const PAIRS_OF_3: [(usize, usize); 6] = [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)];

/// What is left unknown of the coefficients, as far as headings show it, and the noise that the samples showed. 248 bytes.
///
/// A heading moves by `f . (dW x - d beta)`, so its variance is a sum over products of two of `f`'s components and two of
/// `y = (x, -1)`'s: sixty numbers, of which each is that of all elements of the covariance with the same product.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Uncertainty {
    /// By products of `f`'s components, then by products of `y`'s; pairs in the order of the rows of a triangle.
    pub(crate) products: [[f32; 10]; 6],
    /// Noise of an averaged reading on each axis, in units of the total field.
    pub sensor_sigma: f32,
    /// Noise of roll and of pitch, radians.
    pub attitude_sigma_rad: f32,
}

impl Uncertainty {
    /// Everything known exactly.
    pub const NONE: Self = Self { products: [[0.0; 10]; 6], sensor_sigma: 0.0, attitude_sigma_rad: 0.0 };

    /// What a covariance means for headings.
    pub(super) fn new(covariance: &Covariance, sensor_sigma: f32, attitude_sigma_rad: f32) -> Self {
        // The coefficient that `f`'s k-th and `y`'s a-th component multiply.
        let coefficient = |k: usize, a: usize| if a < 3 { 3 * k + a } else { 9 + k };
        let products = PAIRS_OF_3.map(|(k, l)| {
            PAIRS_OF_4.map(|(a, b)| {
                let one = covariance.at(coefficient(k, a), coefficient(l, b));
                let other = covariance.at(coefficient(k, b), coefficient(l, a));
                let sum = if a == b { one } else { one + other };
                if k == l { sum } else { 2.0 * sum }
            })
        });
        Self { products, sensor_sigma, attitude_sigma_rad }
    }

    /// Whether all numbers are finite: asked of what comes out of flash.
    #[must_use]
    pub fn is_finite(&self) -> bool {
        self.products.as_flattened().iter().all(|c| c.is_finite())
            && self.sensor_sigma.is_finite()
            && self.attitude_sigma_rad.is_finite()
    }

    /// Standard deviation of a heading, radians: from the coefficients' errors, and from the noise of attitude and sensor
    /// at this very attitude. `level` is the corrected field at that attitude in units of the total field; `readings` is how many readings an averaged
    /// one was made of, whose noise is that much smaller than the one reading's behind this heading.
    #[must_use]
    pub fn heading_sigma_rad(
        &self,
        calibration: &Calibration,
        sensor: &Field<Sensor>,
        tilt: &Tilt,
        level: &Vector3<f32>,
        readings: f32,
    ) -> f32 {
        let per_total = 1.0 / calibration.total_ut;
        let by_field = heading_by_field(tilt, level);
        // `W^T f`, written out for the same reason as below.
        let [[a, b, c], [d, e, f], [g, h, i]] = calibration.w;
        let rx = a * by_field.x + d * by_field.y + g * by_field.z;
        let ry = b * by_field.x + e * by_field.y + h * by_field.z;
        let rz = c * by_field.x + f * by_field.y + i * by_field.z;
        let x = (sensor.ut - calibration.b_vector_ut()) * per_total;
        let horizontal = level.x * level.x + level.y * level.y;
        let tan_squared = level.z * level.z / horizontal.max(MIN_HORIZONTAL);
        let noise = (rx * rx + ry * ry + rz * rz) * self.sensor_sigma * self.sensor_sigma * readings;
        let attitude = self.attitude_sigma_rad * self.attitude_sigma_rad * tan_squared;
        libm::sqrtf(self.variance(&by_field, &x) + noise + attitude)
    }

    /// Of the coefficients' share, never negative.
    fn variance(&self, by_field: &Vector3<f32>, x: &Vector3<f32>) -> f32 {
        let (f, x) = (by_field, x);
        // In the order of `PAIRS_OF_3` and `PAIRS_OF_4`; written out, for this is done at every heading.
        let of_f = [f.x * f.x, f.x * f.y, f.x * f.z, f.y * f.y, f.y * f.z, f.z * f.z];
        let of_x = [x.x * x.x, x.x * x.y, x.x * x.z, x.y * x.y, x.y * x.z, x.z * x.z];
        let variance = self.products.iter().zip(of_f).map(|([xx, xy, xz, x1, yy, yz, y1, zz, z1, one], f)| {
            let second = xx * of_x[0] + xy * of_x[1] + xz * of_x[2] + yy * of_x[3] + yz * of_x[4] + zz * of_x[5];
            f * (second - (x1 * x.x + y1 * x.y + z1 * x.z) + one)
        });
        variance.sum::<f32>().max(0.0)
    }
}

/// Next to a magnetic pole there is no heading; the floor keeps the figure finite and huge.
const MIN_HORIZONTAL: f32 = 1e-6;

/// Derivative of the heading by the corrected field in body axes and units of the total field: with
/// `psi = atan2(-l_y, l_x)`, `d psi = (l_y d l_x - l_x d l_y) / (l_x^2 + l_y^2)`.
pub(super) fn heading_by_field(tilt: &Tilt, level: &Vector3<f32>) -> Vector3<f32> {
    let horizontal = (level.x * level.x + level.y * level.y).max(MIN_HORIZONTAL);
    tilt.body(Field::from_ut(level.y / horizontal, -level.x / horizontal, 0.0)).ut
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

#[cfg(test)]
mod tests {
    use super::*;

    /// The sixty numbers are the 78 as far as headings go: on any covariance, to the digits of `f32`.
    #[test]
    fn a_heading_s_variance_is_that_of_the_whole_covariance() {
        let mut random = testkit::random::Random(1);
        let mut number = || random.uniform(-1.0, 1.0);
        for _ in 0..50 {
            let root = nalgebra::SMatrix::<f32, 12, 12>::from_fn(|_, _| number());
            let full = root * root.transpose();
            let mut covariance = Covariance::EXACT;
            covariance.fill(|i, j| full[(i, j)]).unwrap();
            let [f, x] = [(); 2].map(|()| Vector3::from_fn(|_, _| number()));
            let row = coefficient_row(&f, &x);
            let exact = row.dot(&(full * row));
            assert!((covariance.variance(&row) - exact).abs() < 1e-5 * exact.max(1.0));
            let found = Uncertainty::new(&covariance, 0.0, 0.0).variance(&f, &x);
            assert!((found - exact).abs() < 1e-5 * exact.max(1.0), "{found} {exact}");
        }
    }
}
