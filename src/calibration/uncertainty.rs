//! How wrong a heading may be: what is left unknown of the coefficients, and the noise of sensor and attitude.

use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

use super::Calibration;
use super::likelihood::unknowns::{COEFFICIENTS, PAIRS_OF_3, PAIRS_OF_4, Vector12, beta, w};
use super::likelihood::{heading_by_field, horizontal_squared};
use crate::frames::{Field, Level, Sensor, Tilt};

/// Covariance of the twelve coefficients, in the order of [`unknowns`](super::likelihood::unknowns) and units of the
/// total field. Lower triangle, row by row.
#[derive(Clone, Debug)]
pub(super) struct Covariance([f32; COEFFICIENTS * (COEFFICIENTS + 1) / 2]);

impl Covariance {
    /// Everything known exactly.
    pub const EXACT: Self = Self([0.0; COEFFICIENTS * (COEFFICIENTS + 1) / 2]);

    /// Takes its elements: asked for row by row, from the first column to the diagonal.
    pub fn fill(&mut self, mut element: impl FnMut(usize, usize) -> f32) {
        let triangle = (0..COEFFICIENTS).flat_map(|row| (0..=row).map(move |column| (row, column)));
        for (packed, (row, column)) in self.0.iter_mut().zip(triangle) {
            *packed = element(row, column);
        }
    }

    /// Adds `weight vector vector^T`.
    pub fn add_square(&mut self, vector: &Vector12, weight: f32) {
        let mut packed = self.0.iter_mut();
        for i in 0..COEFFICIENTS {
            let weighted = weight * vector[i];
            for (&v, c) in vector.iter().take(i + 1).zip(&mut packed) {
                *c += weighted * v;
            }
        }
    }

    /// Whether every element is a number.
    pub fn is_finite(&self) -> bool {
        self.0.iter().all(|c| c.is_finite())
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

/// What is left unknown of the coefficients, as far as headings show it, and the noise that the samples showed. 248
/// bytes.
///
/// A heading moves by `f . (dW x - d beta)`, so its variance is a sum over products of two of `f`'s components and two
/// of
/// `y = (x, -1)`'s: sixty numbers, of which each is that of all elements of the covariance with the same product.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Uncertainty {
    /// By products of `f`'s components, then by products of `y`'s; pairs in the order of the rows of a triangle.
    pub(crate) products: [[f32; 10]; 6],
    /// White noise of a single reading on each axis, in units of the total field: what shrinks with averaging. That of a
    /// mean of `n` readings is its `sqrt(n)`-th part.
    pub sensor_sigma: f32,
    /// Noise of roll and of pitch, radians: what the dips of all samples of the fit scattered by, in a robust mean, less
    /// what is white of the sensor's. What is slow in the field is in it, which does as much to a heading. It does not
    /// shrink with averaging.
    pub attitude_sigma_rad: f32,
}

/// Variance of a heading, radians squared, in its two shares.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HeadingVariance {
    /// Of what is left unknown of the coefficients: the same in all readings at an attitude and a heading.
    pub coefficients: f32,
    /// Of the noise of sensor and attitude.
    pub noise: f32,
}

impl HeadingVariance {
    /// Standard deviation by both, radians.
    #[must_use]
    pub fn sigma_rad(&self) -> f32 {
        libm::sqrtf(self.coefficients + self.noise)
    }
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

    /// Variance of a heading: from the coefficients' errors, and from the noise of attitude and of a single reading of the
    /// sensor at this very attitude. `level` is the reading corrected by the calibration and
    /// levelled by the tilt.
    #[must_use]
    pub fn heading_variance(
        &self,
        calibration: &Calibration,
        sensor: Field<Sensor>,
        tilt: &Tilt,
        level: Field<Level>,
    ) -> HeadingVariance {
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
        HeadingVariance { coefficients: self.coefficients_variance(&by_field, &x), noise: sensor + attitude }
    }

    /// Variance that the coefficients' errors make of something with this derivative by the corrected field, at
    /// `x = (m - b) / F`; both in units of the total field. Never negative.
    pub(crate) fn coefficients_variance(&self, by_field: &Vector3<f32>, x: &Vector3<f32>) -> f32 {
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
    use nalgebra::Matrix3;

    use super::super::likelihood::unknowns::coefficients_row;
    use super::super::rows;
    use super::super::tests::derivatives::{assert_derivative, derivative};
    use super::super::tests::synthetic::{Random, vector};
    use super::*;
    use crate::frames::{Attitude, wrap_pi};

    /// The sixty numbers are the 78 as far as headings go: on any covariance, to the digits of `f32`.
    #[test]
    fn a_heading_s_variance_is_that_of_the_whole_covariance() {
        let mut random = Random(1);
        let mut number = || random.uniform(-1.0, 1.0);
        for _ in 0..50 {
            let root = nalgebra::SMatrix::<f32, 12, 12>::from_fn(|_, _| number());
            let full = root * root.transpose();
            let mut covariance = Covariance::EXACT;
            covariance.fill(|i, j| full[(i, j)]);
            let [f, x] = [(); 2].map(|()| Vector3::from_fn(|_, _| number()));
            let row = coefficients_row(&f, &x);
            let exact = row.dot(&(full * row));
            assert!((covariance.variance(&row) - exact).abs() < 1e-5 * exact.max(1.0));
            let found = Uncertainty::new(&covariance, 0.0, 0.0).coefficients_variance(&f, &x);
            assert!((found - exact).abs() < 1e-5 * exact.max(1.0), "{found} {exact}");
        }
    }

    /// A calibration, and a reading at an attitude that it makes a heading of.
    struct Case {
        calibration: Calibration,
        attitude: Attitude,
        reading: Field<Sensor>,
    }

    impl Case {
        /// Bad airframes at any bank, the field no closer to the vertical than 25 deg.
        fn random(random: &mut Random) -> Self {
            let w = Matrix3::identity() + Matrix3::from_fn(|_, _| random.uniform(-0.2, 0.2));
            let calibration = Calibration {
                w: rows(&w),
                b_ut: vector(random, 40.0).into(),
                inclination_rad: random.uniform(-1.1, 1.1),
                total_ut: random.uniform(30.0, 60.0),
                latency_s: 0.0,
                current: crate::calibration::CurrentIron::NONE,
            };
            let attitude = Attitude { roll_rad: random.uniform(-1.0, 1.0), pitch_rad: 0.0 };
            let level = Field::earth(calibration.total_ut, calibration.inclination_rad, random.uniform(-3.0, 3.0));
            let reading = w.try_inverse().unwrap() * attitude.body(level).ut + calibration.b_vector_ut();
            Self { calibration, attitude, reading: Field::new(reading) }
        }

        fn heading_rad(&self, calibration: &Calibration) -> f32 {
            self.attitude.level(calibration.apply(self.reading)).heading_rad()
        }

        fn sigma_rad(&self, uncertainty: &Uncertainty) -> f32 {
            let tilt = self.attitude.tilt();
            let level = tilt.level(self.calibration.apply(self.reading));
            uncertainty.heading_variance(&self.calibration, self.reading, &tilt, level).sigma_rad()
        }

        /// The calibration with its coefficients moved: `W` by elements, and `b` so that the corrected field is less by
        /// `beta` of the total.
        fn moved(&self, direction: &Vector12, step: f32) -> Calibration {
            let change = |i: usize| direction[i] * step;
            let before = self.calibration.w_matrix();
            let after = before + Matrix3::from_fn(|row, column| change(w(row, column)));
            let of_total = Vector3::from_fn(|axis, _| change(beta(axis)));
            let b_ut =
                self.calibration.b_vector_ut() + after.try_inverse().unwrap() * of_total * self.calibration.total_ut;
            Calibration { w: rows(&after), b_ut: b_ut.into(), ..self.calibration }
        }
    }

    /// The row of the coefficients holds the changes of the heading that a changed calibration shows.
    #[test]
    fn the_heading_by_the_coefficients() {
        let mut random = Random(2);
        for _ in 0..20 {
            let case = Case::random(&mut random);
            let tilt = case.attitude.tilt();
            let total_ut = case.calibration.total_ut;
            let level = tilt.level(case.calibration.apply(case.reading)).ut / total_ut;
            let x = (case.reading.ut - case.calibration.b_vector_ut()) / total_ut;
            let row = coefficients_row(&heading_by_field(&tilt, &level), &x);
            let here = case.heading_rad(&case.calibration);
            for i in 0..COEFFICIENTS {
                let direction = Vector12::ith(i, 1.0);
                let turned = |step| wrap_pi(case.heading_rad(&case.moved(&direction, step)) - here);
                assert_derivative(row[i], turned, &format!("heading by coefficient {i}"));
            }
        }
    }

    /// Coefficients that are wrong by a sigma in one direction turn a heading by its sigma: the whole way from a
    /// covariance to a heading's sigma, against calibrations that are wrong.
    #[test]
    fn sigma_is_what_wrong_coefficients_do() {
        let mut random = Random(3);
        for _ in 0..20 {
            let case = Case::random(&mut random);
            let direction = Vector12::from_fn(|_, _| random.uniform(-1.0, 1.0));
            let mut covariance = Covariance::EXACT;
            covariance.add_square(&direction, 1.0);
            let here = case.heading_rad(&case.calibration);
            let turned =
                derivative(|step| wrap_pi(case.heading_rad(&case.moved(&(direction * 0.3), step)) - here)) / 0.3;
            let sigma_rad = case.sigma_rad(&Uncertainty::new(&covariance, 0.0, 0.0));
            assert!((sigma_rad - turned.abs()).abs() < 0.005 + 0.002 * sigma_rad, "{sigma_rad} {turned}");
        }
    }

    /// A sigma of noise on each axis of the sensor, and on roll and pitch, turn the heading by its sigma.
    #[test]
    fn sigma_is_what_noise_does() {
        let mut random = Random(4);
        for _ in 0..20 {
            let case = Case::random(&mut random);
            let here = case.heading_rad(&case.calibration);
            let total_ut = case.calibration.total_ut;
            let by_reading = |axis: usize| {
                derivative(|step| {
                    let reading = case.reading.ut + Vector3::ith(axis, step * total_ut);
                    let level = case.attitude.level(case.calibration.apply(Field::new(reading)));
                    wrap_pi(level.heading_rad() - here)
                })
            };
            let by_attitude = |roll: f32, pitch: f32| {
                derivative(|step| {
                    let Attitude { roll_rad, pitch_rad } = case.attitude;
                    let attitude = Attitude { roll_rad: roll_rad + roll * step, pitch_rad: pitch_rad + pitch * step };
                    wrap_pi(attitude.level(case.calibration.apply(case.reading)).heading_rad() - here)
                })
            };
            let sensor = (0..3).map(by_reading).map(|d| d * d).sum::<f32>().sqrt();
            let attitude = by_attitude(1.0, 0.0).hypot(by_attitude(0.0, 1.0));
            for (sensor_sigma, attitude_sigma_rad) in [(0.01, 0.0), (0.0, 0.01), (0.003, 0.004)] {
                let uncertainty = Uncertainty { sensor_sigma, attitude_sigma_rad, ..Uncertainty::NONE };
                let (found, expected) =
                    (case.sigma_rad(&uncertainty), (sensor * sensor_sigma).hypot(attitude * attitude_sigma_rad));
                assert!((found / expected - 1.0).abs() < 2e-3, "{found} {expected}");
            }
        }
    }

    /// Straight up and down there is no heading: its sigma is large, and a number.
    #[test]
    fn next_to_a_pole_sigma_is_finite() {
        let calibration = Calibration { total_ut: 50.0, ..Calibration::uncalibrated(super::super::Orientation::NONE) };
        let uncertainty = Uncertainty { sensor_sigma: 0.01, attitude_sigma_rad: 0.01, ..Uncertainty::NONE };
        let sensor = Field::from_ut(0.0, 0.0, 50.0);
        let tilt = Attitude::default().tilt();
        let sigma_rad = uncertainty
            .heading_variance(&calibration, sensor, &tilt, tilt.level(calibration.apply(sensor)))
            .sigma_rad();
        assert!(sigma_rad.is_finite() && sigma_rad > 3.0, "{sigma_rad}");
    }

    /// What comes out of flash may be anything.
    #[test]
    fn every_number_must_be_finite() {
        assert!(Uncertainty::NONE.is_finite());
        let spoilt = |spoil: &dyn Fn(&mut Uncertainty)| {
            let mut uncertainty = Uncertainty::NONE;
            spoil(&mut uncertainty);
            uncertainty.is_finite()
        };
        for bad in [f32::NAN, f32::INFINITY] {
            assert!(!spoilt(&|u| u.sensor_sigma = bad) && !spoilt(&|u| u.attitude_sigma_rad = bad));
            assert!(!spoilt(&|u| u.products[0][0] = bad) && !spoilt(&|u| u.products[5][9] = bad));
        }
        let mut covariance = Covariance::EXACT;
        covariance.fill(|_, _| 1.0);
        assert!(covariance.is_finite());
        covariance.fill(|i, j| if (i, j) == (11, 11) { f32::NAN } else { 1.0 });
        assert!(!covariance.is_finite());
    }

    /// A square along a direction is what it adds to the variance along it.
    #[test]
    fn a_square_is_added_to_every_element() {
        let mut random = Random(5);
        let [one, two] = [(); 2].map(|()| Vector12::from_fn(|_, _| random.uniform(-1.0, 1.0)));
        let mut covariance = Covariance::EXACT;
        covariance.fill(|i, j| one[i] * one[j]);
        covariance.add_square(&two, -0.5);
        for i in 0..COEFFICIENTS {
            for j in 0..COEFFICIENTS {
                assert!((covariance.at(i, j) - (one[i] * one[j] - 0.5 * two[i] * two[j])).abs() < 1e-6, "{i} {j}");
            }
        }
    }

    /// Rounding may leave a variance below nothing; a sigma is a number all the same.
    #[test]
    fn a_variance_is_never_negative() {
        let mut covariance = Covariance::EXACT;
        covariance.fill(|i, j| if i == j { -1.0 } else { 0.0 });
        assert_eq!(covariance.variance(&Vector12::ith(3, 1.0)).to_bits(), 0);
        let uncertainty = Uncertainty::new(&covariance, 0.0, 0.0);
        assert_eq!(uncertainty.coefficients_variance(&Vector3::x(), &Vector3::y()).to_bits(), 0);
    }
}
