//! One set of unknowns, the corrected field of a measurement, and the derivatives of its norm, inclination and heading.

use nalgebra::{Matrix3, Vector3};

use super::unknowns::{INCLINATION_INDEX, JacobianRow, Vector13, corrected_mean_index, w_index};
use crate::calibration::linear_algebra::{inverse, multiply};
use crate::frames::{AttitudeRotation, Field};
use crate::trig::{VectorLength as _, sqrt};

/// Floor of the norm: keeps direction and residual finite.
const MIN_NORM: f32 = 1e-6;

/// Floor of the relative horizontal field: 3 deg from a magnetic pole, where the inclination's derivative diverges.
const MIN_HORIZONTAL: f32 = 0.05;

/// Floor of the squared relative horizontal field: keeps the heading's derivative finite.
const MIN_HORIZONTAL_SQUARED: f32 = 1e-6;

/// Corrected field `w = W x + d`, units of field; its direction `n = w / |w|` in body and `l = C n` in level axes.
#[derive(Clone, Debug)]
pub(crate) struct FieldPrediction {
    /// `x`: measured field minus the mean of all samples.
    pub centred_field: Vector3<f32>,
    /// Norm of the corrected field, `|w|`; nominally 1.
    pub norm: f32,
    /// Direction `n` of the corrected field, body axes; also the derivative of its norm by the field.
    pub field_direction: Vector3<f32>,
    /// Derivative of the inclination `i` by the corrected field. From `sin i = down . n` and
    /// `d n = (1 - n n^T) d w / |w|`: `(down - n l_z) / (|w| cos i)`.
    pub inclination_derivative_by_field: Vector3<f32>,
    /// Direction `l` of the corrected field, level axes.
    pub level_field: Vector3<f32>,
    /// Cosine of the inclination, `cos i = sqrt(l_x^2 + l_y^2)`.
    pub cos_inclination: f32,
    /// Inclination `i = atan2(l_z, sqrt(l_x^2 + l_y^2))`, radians.
    pub inclination_rad: f32,
}

impl FieldPrediction {
    #[expect(clippy::inline_always, reason = "runs twice for each sample and pass, and returns sixteen numbers")]
    #[inline(always)]
    pub fn new(centred_field: Vector3<f32>, corrected: &Vector3<f32>, tilt: &AttitudeRotation) -> Self {
        let total = corrected.vector_length().max(MIN_NORM);
        let direction = corrected / total;
        let level = tilt.to_level_frame(Field::new(direction)).ut;
        let horizontal = sqrt(level.x * level.x + level.y * level.y).max(MIN_HORIZONTAL);
        Self {
            centred_field,
            norm: total,
            field_direction: direction,
            inclination_derivative_by_field: (tilt.down_in_body() - direction * level.z) / (total * horizontal),
            level_field: level,
            cos_inclination: horizontal,
            inclination_rad: libm::atan2f(level.z, horizontal),
        }
    }

    /// Jacobian row of `e_norm = |W x + d| - 1`: `n x^T` by `W`, `n` by `d`, 0 by `I`.
    pub(crate) fn norm_row(&self) -> JacobianRow {
        JacobianRow {
            derivative_by_field: self.field_direction,
            centred_field: self.centred_field,
            derivative_by_inclination: 0.0,
        }
    }

    /// Jacobian row of `e_incl = i - I`, with `t` the derivative of `i` by the field: `t x^T` by `W`, `t` by `d`, -1 by
    /// `I`.
    pub(crate) fn inclination_row(&self) -> JacobianRow {
        JacobianRow {
            derivative_by_field: self.inclination_derivative_by_field,
            centred_field: self.centred_field,
            derivative_by_inclination: -1.0,
        }
    }

    /// Jacobian row of `e_heading = atan2(-l_y, l_x) - given`, `g` the derivative of the heading by the field:
    /// `g x^T` by `W`, `g` by `d`, 0 by `I`.
    pub(in crate::calibration) fn heading_row(&self, tilt: &AttitudeRotation) -> JacobianRow {
        JacobianRow {
            derivative_by_field: self.heading_derivative_by_field(tilt),
            centred_field: self.centred_field,
            derivative_by_inclination: 0.0,
        }
    }

    /// Magnetic heading, radians (Liu 2007 eq. 3).
    pub fn heading_rad(&self) -> f32 {
        libm::atan2f(-self.level_field.y, self.level_field.x)
    }

    /// Derivative of the heading by the corrected field, in body axes.
    pub fn heading_derivative_by_field(&self, tilt: &AttitudeRotation) -> Vector3<f32> {
        heading_derivative_by_field(tilt, &self.level_field) / self.norm
    }

    /// Derivatives of the inclination by roll and by pitch. From `sin i = down . n` and
    /// `down = (-sin theta, cos theta sin phi, cos theta cos phi)`: `cos theta l_y / cos i` and `-l_x / cos i`.
    pub fn inclination_derivatives_by_attitude(&self, tilt: &AttitudeRotation) -> [f32; 2] {
        [tilt.cos_pitch() * self.level_field.y / self.cos_inclination, -self.level_field.x / self.cos_inclination]
    }

    /// Derivatives of the heading by roll and by pitch. A roll rotates the level field about
    /// `(cos theta, 0, -sin theta)`, a pitch about `(0, 1, 0)`: `sin theta + cos theta l_x l_z / cos^2 i` and
    /// `l_y l_z / cos^2 i`.
    pub fn heading_derivatives_by_attitude(&self, tilt: &AttitudeRotation) -> [f32; 2] {
        let per_horizontal = self.level_field.z / (self.cos_inclination * self.cos_inclination);
        [tilt.sin_pitch() + tilt.cos_pitch() * self.level_field.x * per_horizontal, self.level_field.y * per_horizontal]
    }
}

pub(in crate::calibration) fn horizontal_squared(level: &Vector3<f32>) -> f32 {
    (level.x * level.x + level.y * level.y).max(MIN_HORIZONTAL_SQUARED)
}

/// Derivative of the heading by the corrected field in body axes, both in units of field. From `psi = atan2(-l_y, l_x)`
/// (Liu 2007 eq. 3): `d psi = (l_y d l_x - l_x d l_y) / (l_x^2 + l_y^2)`.
pub(in crate::calibration) fn heading_derivative_by_field(
    tilt: &AttitudeRotation,
    level: &Vector3<f32>,
) -> Vector3<f32> {
    let horizontal = horizontal_squared(level);
    tilt.to_body_frame(Field::from_ut(level.y / horizontal, -level.x / horizontal, 0.0)).ut
}

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
