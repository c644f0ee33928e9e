//! Efficient-score (Lagrange-multiplier) test of further unknowns (D. R. Cox and D. V. Hinkley, Theoretical Statistics,
//! 1974, 9.3).
//!
//! `K` further unknowns `beta` are linear about the fit without them. With the information and the gradient of `beta`
//! summed over the samples, and `H` the information of the thirteen unknowns, the efficient score is
//! `U = g_b - H_bu H^-1 g_u` with information `S = H_bb - H_bu H^-1 H_ub`: the thirteen are nuisance parameters, and
//! eliminated. The estimate is `beta = S^-1 U`, its significance `U S^-1 U`, chi-squared with `K` degrees of freedom
//! for independent errors of known sigma. The thirteen follow by `-H^-1 H_ub beta`.

use nalgebra::{Matrix3, SMatrix, SVector, Vector3};

use crate::calibration::fit::linearised_problem::LinearisedProblem;
use crate::calibration::model::{
    INCLINATION_INDEX, ResidualEquation, SampleEquations, UPPER_TRIANGLE_3, Vector13, unknown_index_of_product,
};

/// Sums over the residuals of the samples.
#[derive(Clone, Copy, Debug)]
pub(in crate::calibration) struct ScoreTest<const K: usize> {
    /// Cross information `H_ub`, by unknown of the hypothesis.
    pub cross_information: [Vector13; K],
    /// Information `H_bb` of the further unknowns.
    pub information: SMatrix<f32, K, K>,
    /// Gradient `g_b` by the further unknowns.
    pub gradient: SVector<f32, K>,
}

/// Information `S` and gradient `U` with the nuisance parameters eliminated.
#[derive(Clone, Debug)]
pub(in crate::calibration) struct EfficientScore<const K: usize> {
    /// Columns of `H^-1 H_ub`: change of the thirteen unknowns with each further unknown.
    pub nuisance_columns: [Vector13; K],
    pub information: SMatrix<f32, K, K>,
    pub gradient: SVector<f32, K>,
}

impl<const K: usize> ScoreTest<K> {
    pub fn zero() -> Self {
        Self { cross_information: [Vector13::zeros(); K], information: SMatrix::zeros(), gradient: SVector::zeros() }
    }

    /// Adds a residual. `derivative`: of the residual by `beta`; `fraction`: of `beta` that the sample has.
    pub fn add_weighted_equation(&mut self, equation: &ResidualEquation, derivative: &SVector<f32, K>, fraction: f32) {
        let weighted = derivative * (equation.weight * fraction);
        for (sum, axis_derivative) in self.cross_information.iter_mut().zip(&weighted) {
            equation.jacobian_row.add_scaled_to(sum, *axis_derivative);
        }
        self.information.ger(fraction, &weighted, derivative, 1.0);
        self.gradient.axpy(-equation.residual, &weighted, 1.0);
    }

    /// `H_ub beta`: effect of `beta` on the gradient of the thirteen unknowns.
    pub fn gradient_effect(&self, beta: &SVector<f32, K>) -> Vector13 {
        self.cross_information.iter().zip(beta).map(|(cross_row, beta)| cross_row * *beta).sum()
    }

    /// Eliminates the thirteen unknowns; `step_to_maximum`: their remaining step to the maximum likelihood, `H^-1 g_u`.
    pub fn eliminate_coefficients(
        &self,
        system: &LinearisedProblem,
        step_to_maximum: &Vector13,
    ) -> Option<EfficientScore<K>> {
        let mut score = EfficientScore {
            nuisance_columns: [Vector13::zeros(); K],
            information: self.information,
            gradient: self.gradient,
        };
        for (axis, cross_row) in self.cross_information.iter().enumerate() {
            let column = system.covariance_times(cross_row)?;
            for (other_axis, cross_row) in self.cross_information.iter().enumerate() {
                score.information[(axis, other_axis)] -= column.dot(cross_row);
            }
            score.gradient[axis] -= cross_row.dot(step_to_maximum);
            score.nuisance_columns[axis] = column;
        }
        Some(score)
    }
}

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
