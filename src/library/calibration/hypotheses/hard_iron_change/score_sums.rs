//! Score-test sums of a hard-iron change, in the products that they have in common.

use nalgebra::{Matrix3, Vector3};

use crate::calibration::hypotheses::score_test::ScoreTest;
use crate::calibration::model::{
    INCLINATION_INDEX, ResidualEquation, SampleEquations, UPPER_TRIANGLE_3, unknown_index_of_product,
};

/// Sums over residuals with the derivative `k` by the corrected field and the fraction `f` of the change: of
/// `f k k^T (x, 1)`, `f^2 k k^T`, and `f k` times residual and derivative by the inclination. A quarter of the
/// operations of a [`ScoreTest`], which follows by the derivative `-W^T k` of a residual by hard iron.
#[derive(Clone, Debug)]
pub(super) struct HardIronSums {
    /// Sums of products by pairs of components of `k`, then by components of `(x, 1)`.
    pair_products: [[f32; 4]; 6],
    inclination_products: Vector3<f32>,
    information: [f32; 6],
    gradient: Vector3<f32>,
}

/// Products of one sample: of `k k^T`, and of `k` times residual and derivative by the inclination, over both
/// residuals.
pub(super) struct SampleProducts {
    pair_products: [f32; 6],
    centred_field: Vector3<f32>,
    inclination_products: Vector3<f32>,
    gradient: Vector3<f32>,
}

impl SampleProducts {
    /// Unrolled: runs for each sample.
    pub fn new(equations: &SampleEquations) -> Self {
        let mut products = Self {
            pair_products: [0.0; 6],
            centred_field: equations.norm_equation.jacobian_row.centred_field,
            inclination_products: Vector3::zeros(),
            gradient: Vector3::zeros(),
        };
        for equation in hard_iron_residuals(equations) {
            let k = equation.jacobian_row.derivative_by_field;
            let weighted = k * equation.weight;
            let [a, b, c, d, e, f] = products.pair_products;
            products.pair_products = [
                a + weighted.x * k.x,
                b + weighted.x * k.y,
                c + weighted.x * k.z,
                d + weighted.y * k.y,
                e + weighted.y * k.z,
                f + weighted.z * k.z,
            ];
            products.gradient += weighted * equation.residual;
            products.inclination_products += weighted * equation.jacobian_row.derivative_by_inclination;
        }
        products
    }
}

impl HardIronSums {
    pub const fn zero() -> Self {
        Self {
            pair_products: [[0.0; 4]; 6],
            inclination_products: Vector3::new(0.0, 0.0, 0.0),
            information: [0.0; 6],
            gradient: Vector3::new(0.0, 0.0, 0.0),
        }
    }

    /// Adds a sample that has a fraction of the change.
    pub fn add_sample_products(&mut self, sample: &SampleProducts, fraction: f32) {
        let x = &sample.centred_field;
        for ((sums, information), pair) in
            self.pair_products.iter_mut().zip(&mut self.information).zip(&sample.pair_products)
        {
            let pair = pair * fraction;
            sums[0] += pair * x.x;
            sums[1] += pair * x.y;
            sums[2] += pair * x.z;
            sums[3] += pair;
            *information += pair * fraction;
        }
        self.inclination_products += sample.inclination_products * fraction;
        self.gradient += sample.gradient * fraction;
    }

    /// Adds the sums of samples that have a fraction of the change, given with its square.
    pub fn add_scaled(&mut self, sums: &Self, fraction: f32, fraction_squared: f32) {
        for (sum, addend) in self.pair_products.as_flattened_mut().iter_mut().zip(sums.pair_products.as_flattened()) {
            *sum += addend * fraction;
        }
        for (sum, addend) in self.information.iter_mut().zip(&sums.information) {
            *sum += addend * fraction_squared;
        }
        self.inclination_products += sums.inclination_products * fraction;
        self.gradient += sums.gradient * fraction;
    }

    /// Score-test sums over the derivatives by the hard-iron change.
    pub fn score_test(&self, w: &Matrix3<f32>) -> ScoreTest<3> {
        let mut test = ScoreTest::zero();
        let mut information = Matrix3::zeros();
        for ((&(k, l), products), pair_information) in
            UPPER_TRIANGLE_3.iter().zip(&self.pair_products).zip(&self.information)
        {
            information[(k, l)] = *pair_information;
            information[(l, k)] = *pair_information;
            for (axis, sums) in test.cross_information.iter_mut().enumerate() {
                for (a, product) in products.iter().enumerate() {
                    sums[unknown_index_of_product(k, a)] -= w[(l, axis)] * product;
                    if k != l {
                        sums[unknown_index_of_product(l, a)] -= w[(k, axis)] * product;
                    }
                }
            }
        }
        let inclination_products = w.tr_mul(&self.inclination_products);
        for (axis, sums) in test.cross_information.iter_mut().enumerate() {
            sums[INCLINATION_INDEX] = -inclination_products[axis];
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
