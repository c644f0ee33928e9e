//! A measurement seen through a set of coefficients: the field it stands for, and how that depends on everything.

use nalgebra::{Matrix3, Vector3};

use super::{UNKNOWNS, Vector13};
use crate::calibration::uncertainty::heading_by_field;
use crate::frames::{Field, Tilt};

/// One set of unknowns, in the unit of field: the corrected field is `W x + d`, `x` being the field less the mean of all
/// samples. `d` stands for `b = mean - W^-1 d`: with `b` itself, samples that hardly move along an axis could not tell the
/// axis' scale from its hard iron but by the difference of two large sums, for which `f32` has too few digits.
#[derive(Clone, Debug)]
pub(in crate::calibration) struct Point {
    pub w: Matrix3<f32>,
    pub d: Vector3<f32>,
    pub inclination_rad: f32,
}

impl Point {
    /// From the unknowns: `W` row by row, `d`, `I`.
    pub fn new(unknowns: &Vector13) -> Self {
        let w = Matrix3::from_fn(|row, column| unknowns[3 * row + column]);
        Self { w, d: Vector3::new(unknowns[9], unknowns[10], unknowns[11]), inclination_rad: unknowns[12] }
    }

    /// The unknowns; `None` if one is not a finite number.
    pub fn unknowns(&self) -> Option<Vector13> {
        let mut unknowns = Vector13::zeros();
        for i in 0..3 {
            for j in 0..3 {
                unknowns[3 * i + j] = self.w[(i, j)];
            }
            unknowns[9 + i] = self.d[i];
        }
        unknowns[12] = self.inclination_rad;
        unknowns.iter().all(|u| u.is_finite()).then_some(unknowns)
    }

    /// From the hard iron to the mean of all samples: `W^-1 d`. `None` when `W` has no inverse.
    pub fn mean_from_b(&self) -> Option<Vector3<f32>> {
        self.w.try_inverse().map(|field_from_body| field_from_body * self.d)
    }

    /// What a field less the mean looks like from here, at the tilt of its attitude.
    pub fn view(&self, x: Vector3<f32>, tilt: &Tilt) -> View {
        let body = self.w * x + self.d;
        // A field of zero has no direction; the floor keeps its residual finite and large.
        let total = body.norm().max(1e-6);
        let direction = body / total;
        let level = tilt.level(Field::new(direction)).ut;
        // Next to a magnetic pole the dip's derivative grows without bound; 0.05 is 3 deg from it.
        let horizontal = libm::sqrtf(level.x * level.x + level.y * level.y).max(0.05);
        View {
            x,
            total,
            direction,
            towards_down: (tilt.down() - direction * level.z) / (total * horizontal),
            level,
            horizontal,
            dip_rad: libm::atan2f(level.z, horizontal),
        }
    }

    /// The derivative by the unknowns of `k . (W x + d)`: `k x^T` by `W`, `k` by `d`, none by `I`.
    pub fn row(k: &Vector3<f32>, x: &Vector3<f32>) -> Vector13 {
        // Written out, for this is done twice for each sample and pass.
        let [a, b, c] = [k.x, k.y, k.z];
        let [x, y, z] = [x.x, x.y, x.z];
        Vector13::from([a * x, a * y, a * z, b * x, b * y, b * z, c * x, c * y, c * z, a, b, c, 0.0])
    }

    /// The field less the mean, noise-free, at an attitude and a heading.
    pub fn expected_field(&self, tilt: &Tilt, heading_rad: f32) -> Option<Vector3<f32>> {
        let level = Field::earth(1.0, self.inclination_rad, heading_rad);
        Some(self.w.try_inverse()? * (tilt.body(level).ut - self.d))
    }
}

/// What a measurement looks like through a point.
#[derive(Clone, Debug)]
pub(in crate::calibration) struct View {
    /// The measurement less the mean.
    pub x: Vector3<f32>,
    /// Size of the corrected field; one, if all is right.
    pub total: f32,
    /// Direction of the corrected field in body axes: the derivative of `total` by the corrected field.
    pub direction: Vector3<f32>,
    /// Derivative of the dip by the corrected field.
    pub towards_down: Vector3<f32>,
    /// Direction of the corrected field in level axes.
    pub level: Vector3<f32>,
    /// Size of its horizontal part.
    pub horizontal: f32,
    pub dip_rad: f32,
}

impl View {
    pub fn norm_row(&self) -> Vector13 {
        Point::row(&self.direction, &self.x)
    }

    /// Of the dip less the inclination.
    pub fn dip_row(&self) -> Vector13 {
        let mut row = Point::row(&self.towards_down, &self.x);
        row[UNKNOWNS - 1] = -1.0;
        row
    }

    /// Derivative of the heading by the corrected field, in body axes.
    pub fn heading_by_field(&self, tilt: &Tilt) -> Vector3<f32> {
        heading_by_field(tilt, &self.level) / self.total
    }

    /// Change of the dip by a radian of roll and of pitch. Together they are of size one at zero pitch.
    pub fn dip_by_attitude(&self, tilt: &Tilt) -> [f32; 2] {
        [tilt.cos_pitch() * self.level.y / self.horizontal, -self.level.x / self.horizontal]
    }
}
