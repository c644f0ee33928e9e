//! How wrong a heading may be: what is left unknown of the coefficients, and the noise of sensor and attitude.

use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

use super::Calibration;
use super::likelihood::unknowns::{COEFFICIENTS, Vector12, beta, w};
use super::likelihood::{heading_by_field, horizontal_squared};
use crate::frames::{Field, Level, Sensor, Tilt};

/// Covariance of the twelve coefficients, in the order of [`unknowns`](super::likelihood::unknowns) and units of the
/// total field. Lower triangle, row by row.
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

/// What is left unknown of the coefficients, as far as headings show it, and the noise that the samples showed. 248
/// bytes.
///
/// A heading moves by `f . (dW x - d beta)`, so its variance is a sum over products of two of `f`'s components and two
/// of
/// `y = (x, -1)`'s: sixty numbers, of which each is that of all elements of the covariance with the same product.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Uncertainty {
    /// By products of `f`'s components, then by products of `y`'s; pairs in the order of the rows of a triangle.
    products: [[f32; 10]; 6],
    /// Noise of a single reading on each axis, in units of the total field.
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
        let coefficient = |k: usize, a: usize| if a < 3 { w(k, a) } else { beta(k) };
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

    /// Standard deviation of a heading, radians: from the coefficients' errors, and from the noise of attitude and of a
    /// single reading of the sensor at this very attitude. `level` is the reading corrected by the calibration and
    /// levelled by the tilt.
    #[must_use]
    pub fn heading_sigma_rad(
        &self,
        calibration: &Calibration,
        sensor: Field<Sensor>,
        tilt: &Tilt,
        level: Field<Level>,
    ) -> f32 {
        let per_total = 1.0 / calibration.total_ut;
        let level = level.ut * per_total;
        let x = (sensor.ut - calibration.b_vector_ut()) * per_total;
        let by_field = heading_by_field(tilt, &level);
        // `W^T f`, written out for the same reason as below.
        let [[a, b, c], [d, e, f], [g, h, i]] = calibration.w;
        let rx = a * by_field.x + d * by_field.y + g * by_field.z;
        let ry = b * by_field.x + e * by_field.y + h * by_field.z;
        let rz = c * by_field.x + f * by_field.y + i * by_field.z;
        let sensor = (rx * rx + ry * ry + rz * rz) * self.sensor_sigma * self.sensor_sigma;
        // A tilt of the level frame turns the heading by `tan(dip)` times the tilt towards the field.
        let tan_squared = level.z * level.z / horizontal_squared(&level);
        let attitude = self.attitude_sigma_rad * self.attitude_sigma_rad * tan_squared;
        libm::sqrtf(self.variance(&by_field, &x) + sensor + attitude)
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

#[cfg(test)]
mod tests {
    use super::super::likelihood::unknowns::coefficients_row;
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
            let row = coefficients_row(&f, &x);
            let exact = row.dot(&(full * row));
            assert!((covariance.variance(&row) - exact).abs() < 1e-5 * exact.max(1.0));
            let found = Uncertainty::new(&covariance, 0.0, 0.0).variance(&f, &x);
            assert!((found - exact).abs() < 1e-5 * exact.max(1.0), "{found} {exact}");
        }
    }
}
