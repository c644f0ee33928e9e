//! One set of unknowns, as the matrix, the vector and the angle that they are.

use nalgebra::{Matrix3, Vector3};

use super::Prediction;
use super::unknowns::{INCLINATION, Vector13, d, w};
use crate::calibration::inverse;
use crate::frames::{Field, Tilt};

/// One set of unknowns, in the unit of field: the corrected field is `W x + d`, `x` being the field less the mean of
/// all samples. `d` stands for `b = mean - W^-1 d`: with `b` itself, samples that hardly move along an axis could not
/// tell the axis' scale from its hard iron but by the difference of two large sums, for which `f32` has too few digits.
#[derive(Clone, Debug)]
pub(in crate::calibration) struct Parameters {
    /// Takes the field in mount axes to the body frame.
    pub w: Matrix3<f32>,
    /// The corrected field where the measured one is the mean of all samples.
    pub d: Vector3<f32>,
    /// Inclination of the Earth field, radians, positive down.
    pub inclination_rad: f32,
}

impl Parameters {
    /// From the unknowns, in the order of [`unknowns`](super::unknowns).
    pub fn new(unknowns: &Vector13) -> Self {
        Self {
            w: Matrix3::from_fn(|row, column| unknowns[w(row, column)]),
            d: Vector3::from_fn(|axis, _| unknowns[d(axis)]),
            inclination_rad: unknowns[INCLINATION],
        }
    }

    /// The unknowns; `None` if one is not a finite number.
    pub fn unknowns(&self) -> Option<Vector13> {
        let mut unknowns = Vector13::zeros();
        for i in 0..3 {
            for j in 0..3 {
                unknowns[w(i, j)] = self.w[(i, j)];
            }
            unknowns[d(i)] = self.d[i];
        }
        unknowns[INCLINATION] = self.inclination_rad;
        unknowns.iter().all(|u| u.is_finite()).then_some(unknowns)
    }

    /// From the hard iron to the mean of all samples: `W^-1 d`. `None` when `W` has no inverse.
    pub fn mean_from_b(&self) -> Option<Vector3<f32>> {
        inverse(&self.w).map(|field_from_body| field_from_body * self.d)
    }

    /// What these parameters make of a measurement, given as the field less the mean, at the tilt of its attitude.
    pub fn predict(&self, x: Vector3<f32>, tilt: &Tilt) -> Prediction {
        Prediction::new(x, &(self.w * x + self.d), tilt)
    }

    /// The field less the mean, noise-free, at an attitude and a heading: `W^-1 (C^T h - d)`. `None` when `W` has no
    /// inverse.
    pub fn expected_field(&self, tilt: &Tilt, heading_rad: f32) -> Option<Vector3<f32>> {
        let level = Field::earth(1.0, self.inclination_rad, heading_rad);
        Some(inverse(&self.w)? * (tilt.body(level).ut - self.d))
    }
}
