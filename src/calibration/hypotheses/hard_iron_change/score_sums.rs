//! Score-test sums of a hard-iron change, in the products that they have in common.

use nalgebra::{Matrix3, Vector3};

use crate::calibration::hypotheses::score_test::ScoreTest;
use crate::calibration::model::{
    INCLINATION_INDEX, ResidualEquation, SampleEquations, UPPER_TRIANGLE_3, product_index,
};

/// Sums over residuals with the derivative `k` by the corrected field and the fraction `f` of the change: of
/// `f k k^T (x, 1)`, `f^2 k k^T`, and `f k` times residual and derivative by the inclination. A quarter of the
/// operations of a [`ScoreTest`], which follows by the derivative `-W^T k` of a residual by hard iron.
#[derive(Clone, Debug)]
pub(super) struct HardIronSums {
    /// Products by pairs of components of `k`, then by components of `(x, 1)`.
    products: [[f32; 4]; 6],
    with_inclination: Vector3<f32>,
    information: [f32; 6],
    gradient: Vector3<f32>,
}

/// Products of one sample: of `k k^T`, and of `k` times residual and derivative by the inclination, over both
/// residuals.
pub(super) struct SampleProducts {
    pairs: [f32; 6],
    x: Vector3<f32>,
    with_inclination: Vector3<f32>,
    gradient: Vector3<f32>,
}

impl SampleProducts {
    /// Unrolled: runs for each sample.
    pub fn new(equations: &SampleEquations) -> Self {
        let mut products = Self {
            pairs: [0.0; 6],
            x: equations.norm_equation.jacobian_row.x,
            with_inclination: Vector3::zeros(),
            gradient: Vector3::zeros(),
        };
        for equation in hard_iron_residuals(equations) {
            let k = equation.jacobian_row.derivative_by_field;
            let weighted = k * equation.weight;
            let [a, b, c, d, e, f] = products.pairs;
            products.pairs = [
                a + weighted.x * k.x,
                b + weighted.x * k.y,
                c + weighted.x * k.z,
                d + weighted.y * k.y,
                e + weighted.y * k.z,
                f + weighted.z * k.z,
            ];
            products.gradient += weighted * equation.residual;
            products.with_inclination += weighted * equation.jacobian_row.by_inclination;
        }
        products
    }
}

impl HardIronSums {
    pub const fn zero() -> Self {
        Self {
            products: [[0.0; 4]; 6],
            with_inclination: Vector3::new(0.0, 0.0, 0.0),
            information: [0.0; 6],
            gradient: Vector3::new(0.0, 0.0, 0.0),
        }
    }

    /// Adds a sample that has a fraction of the change.
    pub fn add_sample_products(&mut self, sample: &SampleProducts, fraction: f32) {
        let x = &sample.x;
        for ((sums, information), pair) in self.products.iter_mut().zip(&mut self.information).zip(&sample.pairs) {
            let pair = pair * fraction;
            sums[0] += pair * x.x;
            sums[1] += pair * x.y;
            sums[2] += pair * x.z;
            sums[3] += pair;
            *information += pair * fraction;
        }
        self.with_inclination += sample.with_inclination * fraction;
        self.gradient += sample.gradient * fraction;
    }

    /// Adds the sums of samples that have a fraction of the change, given with its square.
    pub fn add_scaled(&mut self, sums: &Self, fraction: f32, squared: f32) {
        for (sum, addend) in self.products.as_flattened_mut().iter_mut().zip(sums.products.as_flattened()) {
            *sum += addend * fraction;
        }
        for (sum, addend) in self.information.iter_mut().zip(&sums.information) {
            *sum += addend * squared;
        }
        self.with_inclination += sums.with_inclination * fraction;
        self.gradient += sums.gradient * fraction;
    }

    /// Score-test sums over the derivatives by the hard-iron change.
    pub fn score_test(&self, w: &Matrix3<f32>) -> ScoreTest<3> {
        let mut test = ScoreTest::zero();
        let mut information = Matrix3::zeros();
        for ((&(k, l), products), pair_information) in
            UPPER_TRIANGLE_3.iter().zip(&self.products).zip(&self.information)
        {
            information[(k, l)] = *pair_information;
            information[(l, k)] = *pair_information;
            for (axis, sums) in test.cross_information.iter_mut().enumerate() {
                for (a, product) in products.iter().enumerate() {
                    sums[product_index(k, a)] -= w[(l, axis)] * product;
                    if k != l {
                        sums[product_index(l, a)] -= w[(k, axis)] * product;
                    }
                }
            }
        }
        let with_inclination = w.tr_mul(&self.with_inclination);
        for (axis, sums) in test.cross_information.iter_mut().enumerate() {
            sums[INCLINATION_INDEX] = -with_inclination[axis];
        }
        test.information = w.tr_mul(&(information * w));
        test.gradient = w.tr_mul(&self.gradient);
        test
    }
}

/// Residuals of a sample that hard iron affects: of the norm, and of the inclination where it is used.
pub(in crate::calibration) fn hard_iron_residuals(
    equations: &SampleEquations,
) -> impl Iterator<Item = &ResidualEquation> {
    core::iter::once(&equations.norm_equation).chain(&equations.inclination_equation)
}
