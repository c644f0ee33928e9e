//! Conversion from the unknowns of the model to the coefficients of a calibration.

use nalgebra::{Matrix3, Vector3};

use crate::calibration::model::{Coefficient, Likelihood, ModelParameters, Vector13, corrected_mean_index, w_index};
use crate::trig;

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
        match Coefficient::from_index(coefficient_index) {
            Coefficient::W { row, column } => {
                derivative
                    .fixed_rows_mut::<3>(w_index(row, 0))
                    .copy_from(&self.chip_from_mount.row(column).transpose());
            }
            Coefficient::Beta(axis) => {
                derivative.fixed_rows_mut::<3>(w_index(axis, 0)).copy_from(&self.mean_minus_hard_iron);
                derivative[corrected_mean_index(axis)] = -1.0;
            }
        }
        derivative
    }
}
