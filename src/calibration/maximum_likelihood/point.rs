//! The model at one set of unknowns: residuals of a sample and their derivatives.

use nalgebra::{Matrix3, Vector3};

use super::Vector13;
use crate::calibration::Sample;

/// `W` and `b` in the unit of field, and the inclination.
pub struct Point {
    pub w: Matrix3<f32>,
    pub b: Vector3<f32>,
    inclination_rad: f32,
}

/// The residuals of a sample and their derivatives.
pub struct Residuals {
    pub norm: f32,
    pub norm_row: Vector13,
    pub dip: f32,
    pub dip_row: Vector13,
    /// Change of `dip` by a radian of roll bias, of pitch bias, and by a relative bank error of one.
    pub attitude_effects: [f32; 3],
}

impl Point {
    pub fn new(unknowns: &Vector13) -> Self {
        let w = Matrix3::from_fn(|row, column| unknowns[3 * row + column]);
        Self { w, b: Vector3::new(unknowns[9], unknowns[10], unknowns[11]), inclination_rad: unknowns[12] }
    }

    /// The derivative by the unknowns of `k . w`, with `w = W x`, `x = m - b`: `k x^T` by `W`, `-W^T k` by `b`.
    pub fn row(&self, k: &Vector3<f32>, x: &Vector3<f32>) -> Vector13 {
        let by_b = -self.w.tr_mul(k);
        let mut row = Vector13::zeros();
        for i in 0..3 {
            for j in 0..3 {
                row[3 * i + j] = k[i] * x[j];
            }
            row[9 + i] = by_b[i];
        }
        row
    }

    pub fn residuals(&self, field: Vector3<f32>, sample: &Sample) -> Residuals {
        let x = field - self.b;
        let w = self.w * x;
        // A field of zero has no direction; the floor keeps its residual finite and large.
        let f = w.norm().max(1e-6);
        let u = w / f;
        let (sin_roll, cos_roll) = libm::sincosf(sample.attitude.roll_rad);
        let (sin_pitch, cos_pitch) = libm::sincosf(sample.attitude.pitch_rad);
        let down = Vector3::new(-sin_pitch, cos_pitch * sin_roll, cos_pitch * cos_roll);
        let sin_dip = u.dot(&down).clamp(-1.0, 1.0);
        // Near a pole the dip's derivative grows without bound; 0.05 is 3 deg from it.
        let cos_dip = libm::sqrtf(1.0 - sin_dip * sin_dip).max(0.05);
        let mut dip_row = self.row(&((down - u * sin_dip) / (f * cos_dip)), &x);
        dip_row[12] = -1.0;
        let by_roll = Vector3::new(0.0, cos_pitch * cos_roll, -cos_pitch * sin_roll).dot(&u) / cos_dip;
        let by_pitch = Vector3::new(-cos_pitch, -sin_pitch * sin_roll, -sin_pitch * cos_roll).dot(&u) / cos_dip;
        Residuals {
            norm: f - 1.0,
            norm_row: self.row(&u, &x),
            dip: libm::asinf(sin_dip) - self.inclination_rad,
            dip_row,
            attitude_effects: [by_roll, by_pitch, by_roll * sample.attitude.roll_rad],
        }
    }
}
