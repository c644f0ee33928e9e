//! One set of unknowns as matrix, vector and angle.

use nalgebra::{Matrix3, Vector3};

use super::prediction::FieldPrediction;
use super::unknowns::{INCLINATION_INDEX, Vector13, corrected_mean_index, w_index};
use crate::calibration::linear_algebra::matrix::{inverse, multiply};
use crate::frames::{AttitudeRotation, Field};

/// One set of unknowns in units of field: the corrected field is `W x + d`, with `x` the field minus the mean of all
/// samples. `d` replaces `b = mean - W^-1 d`: with `b`, scale and hard iron of an axis with little variation would
/// differ only in the last digits of large `f32` sums.
#[derive(Clone, Debug)]
pub(in crate::calibration) struct ModelParameters {
    pub w: Matrix3<f32>,
    /// `d`: corrected field of a measurement equal to the mean.
    pub corrected_mean_field: Vector3<f32>,
    pub inclination_rad: f32,
}

impl ModelParameters {
    pub fn from_unknowns(unknowns: &Vector13) -> Self {
        Self {
            w: Matrix3::from_fn(|row, column| unknowns[w_index(row, column)]),
            corrected_mean_field: Vector3::from_fn(|axis, _| unknowns[corrected_mean_index(axis)]),
            inclination_rad: unknowns[INCLINATION_INDEX],
        }
    }

    /// Vector of unknowns; `None` if not finite.
    pub fn unknowns(&self) -> Option<Vector13> {
        let mut unknowns = Vector13::zeros();
        for i in 0..3 {
            for j in 0..3 {
                unknowns[w_index(i, j)] = self.w[(i, j)];
            }
            unknowns[corrected_mean_index(i)] = self.corrected_mean_field[i];
        }
        unknowns[INCLINATION_INDEX] = self.inclination_rad;
        unknowns.iter().all(|u| u.is_finite()).then_some(unknowns)
    }

    /// Mean field minus hard iron, `W^-1 d`; `None` when `W` is singular.
    pub fn mean_minus_hard_iron(&self) -> Option<Vector3<f32>> {
        inverse(&self.w).map(|field_from_body| field_from_body * self.corrected_mean_field)
    }

    #[inline]
    pub fn predict_field(&self, centred_field: Vector3<f32>, tilt: &AttitudeRotation) -> FieldPrediction {
        FieldPrediction::new(centred_field, &(multiply(&self.w, &centred_field) + self.corrected_mean_field), tilt)
    }

    /// Noise-free field minus the mean, at an attitude and heading: `W^-1 (C^T h - d)`. `None` when `W` is singular.
    pub fn expected_field(&self, tilt: &AttitudeRotation, heading_rad: f32) -> Option<Vector3<f32>> {
        let level = Field::earth_field(1.0, self.inclination_rad, heading_rad);
        Some(inverse(&self.w)? * (tilt.to_body_frame(level).ut - self.corrected_mean_field))
    }
}
