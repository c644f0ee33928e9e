//! What parameters make of a measurement: the field it stands for, and how that depends on everything.

use nalgebra::Vector3;

use super::unknowns::Row;
use crate::frames::{Field, Tilt};

/// A field of zero has no direction; the floor keeps its residual finite and large.
const MIN_TOTAL: f32 = 1e-6;

/// Next to a magnetic pole the dip's derivative grows without bound; this is 3 deg from it.
const MIN_HORIZONTAL: f32 = 0.05;

/// Next to a magnetic pole there is no heading; the floor keeps its derivative finite and huge.
const MIN_HORIZONTAL_SQUARED: f32 = 1e-6;

/// What parameters make of a measurement: the corrected field `w = W x + d` in the unit of field, its direction
/// `n = w / |w|`, and that in level axes, `l = C n`.
#[derive(Clone, Debug)]
pub(crate) struct Prediction {
    /// The measurement less the mean.
    pub x: Vector3<f32>,
    /// Size of the corrected field, `|w|`; one, if all is right.
    pub total: f32,
    /// Direction of the corrected field in body axes, `n`: the derivative of `total` by the corrected field.
    pub direction: Vector3<f32>,
    /// Derivative of the dip by the corrected field: with `sin dip = down . n` and `d n = (1 - n n^T) d w / |w|`,
    /// `(down - n l_z) / (|w| cos dip)`.
    pub towards_down: Vector3<f32>,
    /// Direction of the corrected field in level axes, `l`.
    pub level: Vector3<f32>,
    /// Size of its horizontal part, `cos dip = sqrt(l_x^2 + l_y^2)`.
    pub horizontal: f32,
    /// `dip = atan2(l_z, sqrt(l_x^2 + l_y^2))`, radians.
    pub dip_rad: f32,
}

impl Prediction {
    /// Of a measurement less the mean `x` and its corrected field, at the tilt of its attitude.
    pub fn new(x: Vector3<f32>, corrected: &Vector3<f32>, tilt: &Tilt) -> Self {
        let total = corrected.norm().max(MIN_TOTAL);
        let direction = corrected / total;
        let level = tilt.level(Field::new(direction)).ut;
        let horizontal = libm::sqrtf(level.x * level.x + level.y * level.y).max(MIN_HORIZONTAL);
        Self {
            x,
            total,
            direction,
            towards_down: (tilt.down() - direction * level.z) / (total * horizontal),
            level,
            horizontal,
            dip_rad: libm::atan2f(level.z, horizontal),
        }
    }

    /// Derivative by the unknowns of `e_norm = |W x + d| - 1`: `n x^T` by `W`, `n` by `d`, none by `I`.
    pub(crate) fn norm_row(&self) -> Row {
        Row { by_field: self.direction, x: self.x, by_inclination: 0.0 }
    }

    /// Derivative by the unknowns of `e_dip = dip - I`: with `t` for [`towards_down`](Self::towards_down), `t x^T` by
    /// `W`, `t` by `d`, -1 by `I`.
    pub(crate) fn dip_row(&self) -> Row {
        Row { by_field: self.towards_down, x: self.x, by_inclination: -1.0 }
    }

    /// Derivative by the unknowns of `e_heading = atan2(-l_y, l_x) - given`: with `g` for
    /// [`heading_by_field`](Self::heading_by_field), `g x^T` by `W`, `g` by `d`, none by `I`.
    pub(in crate::calibration) fn heading_row(&self, tilt: &Tilt) -> Row {
        Row { by_field: self.heading_by_field(tilt), x: self.x, by_inclination: 0.0 }
    }

    /// Magnetic heading, radians (Liu 2007 eq. 3).
    pub fn heading_rad(&self) -> f32 {
        libm::atan2f(-self.level.y, self.level.x)
    }

    /// Derivative of the heading by the corrected field, in body axes.
    pub fn heading_by_field(&self, tilt: &Tilt) -> Vector3<f32> {
        heading_by_field(tilt, &self.level) / self.total
    }

    /// Derivatives of the dip by roll and by pitch. With `sin dip = down . n` and
    /// `down = (-sin theta, cos theta sin phi, cos theta cos phi)` they are `cos theta l_y / cos dip` and
    /// `-l_x / cos dip`, together of size one at zero pitch.
    pub fn dip_by_attitude(&self, tilt: &Tilt) -> [f32; 2] {
        [tilt.cos_pitch() * self.level.y / self.horizontal, -self.level.x / self.horizontal]
    }

    /// Derivatives of the heading by roll and by pitch. A roll turns the level field about
    /// `(cos theta, 0, -sin theta)`, a pitch about `(0, 1, 0)`, which makes `sin theta + cos theta l_x l_z / cos^2 dip`
    /// and `l_y l_z / cos^2 dip`.
    pub fn heading_by_attitude(&self, tilt: &Tilt) -> [f32; 2] {
        let per_horizontal = self.level.z / (self.horizontal * self.horizontal);
        [tilt.sin_pitch() + tilt.cos_pitch() * self.level.x * per_horizontal, self.level.y * per_horizontal]
    }
}

/// Square of the horizontal part of a level field in units of the total field, never nothing.
pub(in crate::calibration) fn horizontal_squared(level: &Vector3<f32>) -> f32 {
    (level.x * level.x + level.y * level.y).max(MIN_HORIZONTAL_SQUARED)
}

/// Derivative of the heading by the corrected field in body axes, both in units of the total field: with
/// `psi = atan2(-l_y, l_x)` (Liu 2007 eq. 3), `d psi = (l_y d l_x - l_x d l_y) / (l_x^2 + l_y^2)`.
pub(in crate::calibration) fn heading_by_field(tilt: &Tilt, level: &Vector3<f32>) -> Vector3<f32> {
    let horizontal = horizontal_squared(level);
    tilt.body(Field::from_ut(level.y / horizontal, -level.x / horizontal, 0.0)).ut
}
