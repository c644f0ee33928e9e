//! Covariance of the twelve coefficients, and the conversion from the unknowns of the model to them.

use nalgebra::{Matrix3, Vector3};

use crate::calibration::model::{
    COEFFICIENT_COUNT, Likelihood, ModelParameters, Vector12, Vector13, corrected_mean_index, row_and_column, w_index,
};
use crate::trig;

/// Covariance of the twelve coefficients, in the order of the [model](crate::calibration::model), units of the total
/// field. Packed lower triangle, row by row.
#[derive(Clone, Debug)]
pub(in crate::calibration) struct CoefficientCovariance([f32; COEFFICIENT_COUNT * (COEFFICIENT_COUNT + 1) / 2]);

impl CoefficientCovariance {
    pub const ZERO: Self = Self([0.0; COEFFICIENT_COUNT * (COEFFICIENT_COUNT + 1) / 2]);

    pub fn set_lower_triangle(&mut self, mut element: impl FnMut(usize, usize) -> f32) {
        let triangle = (0..COEFFICIENT_COUNT).flat_map(|row| (0..=row).map(move |column| (row, column)));
        for (packed, (row, column)) in self.0.iter_mut().zip(triangle) {
            *packed = element(row, column);
        }
    }

    pub fn add_outer_product(&mut self, vector: &Vector12, weight: f32) {
        let mut packed = self.0.iter_mut();
        for i in 0..COEFFICIENT_COUNT {
            let weighted = weight * vector[i];
            for (&v, c) in vector.iter().take(i + 1).zip(&mut packed) {
                *c += weighted * v;
            }
        }
    }

    pub fn is_finite(&self) -> bool {
        self.0.iter().all(|component| component.is_finite())
    }

    pub(super) fn element(&self, i: usize, j: usize) -> f32 {
        let (row, column) = (i.max(j), i.min(j));
        self.0.get(row * (row + 1) / 2 + column).copied().unwrap_or(0.0)
    }

    /// `row^T covariance row`, at least 0.
    pub fn variance(&self, row: &Vector12) -> f32 {
        let mut packed = self.0.iter();
        let mut sum = 0.0;
        for i in 0..COEFFICIENT_COUNT {
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

/// Conversion from the unknowns `W` and `d` to the coefficients: `W` in chip axes with determinant 1, and `beta`. The
/// corrected field changes by `dW x + dd`; `x` minus the hard iron is `x + W^-1 d`, so `d beta = dW W^-1 d - dd`.
pub(super) struct CoefficientConversion {
    pub determinant_scale: f32,
    chip_from_mount: Matrix3<f32>,
    mean_minus_hard_iron: Vector3<f32>,
}

impl CoefficientConversion {
    pub fn new(likelihood: &Likelihood, unknowns: &Vector13) -> Option<Self> {
        let parameters = ModelParameters::from_unknowns(unknowns);
        let per_unit = trig::reciprocal_cbrt(parameters.w.determinant());
        Some(Self {
            determinant_scale: per_unit,
            chip_from_mount: likelihood.mount_from_chip.transpose() * per_unit,
            mean_minus_hard_iron: parameters.mean_minus_hard_iron()?,
        })
    }

    pub fn jacobian_row(&self, coefficient_index: usize) -> Vector13 {
        let mut derivative = Vector13::zeros();
        match row_and_column(coefficient_index) {
            (row @ 0..3, column) => {
                derivative
                    .fixed_rows_mut::<3>(w_index(row, 0))
                    .copy_from(&self.chip_from_mount.row(column).transpose());
            }
            (_, axis) => {
                derivative.fixed_rows_mut::<3>(w_index(axis, 0)).copy_from(&self.mean_minus_hard_iron);
                derivative[corrected_mean_index(axis)] = -1.0;
            }
        }
        derivative
    }
}
