//! What the closed forms give, and the sphere: where a refinement begins.

use nalgebra::{Matrix3, Vector3, Vector4};

use super::Samples;
use super::least_squares::LeastSquares;
use crate::frames::Field;
use crate::trig;

/// The response of the sensor in mount axes, unit of field microtesla: what each closed form gives.
#[derive(Clone, Debug)]
pub(super) struct Response {
    /// Response to a field of H0 in body axes: `A` times H0, microtesla.
    pub a_ut: Matrix3<f32>,
    /// Hard iron, microtesla.
    pub b_ut: Vector3<f32>,
    /// `D`, the tangent of the inclination.
    pub tan_inclination: f32,
}

/// Where a refinement begins, in a unit of field of its own.
#[derive(Clone, Debug)]
pub(super) struct Start {
    /// The unit, microtesla.
    pub unit_ut: f32,
    pub w: Matrix3<f32>,
    pub b: Vector3<f32>,
    pub inclination_rad: f32,
}

impl Response {
    /// In the unit of field in which `W` has a determinant of one. `None` if `A` has no inverse or mirrors: a chip's axes
    /// are right-handed.
    pub fn start(&self) -> Option<Start> {
        // Total field in units of H0.
        let total = libm::sqrtf(1.0 + self.tan_inclination * self.tan_inclination);
        let w = self.a_ut.try_inverse()? / total;
        let unit_ut = trig::reciprocal_cbrt(w.determinant());
        (unit_ut.is_finite() && unit_ut > 0.0).then(|| Start {
            unit_ut,
            w: w * unit_ut,
            b: self.b_ut / unit_ut,
            inclination_rad: libm::atan2f(self.tan_inclination, 1.0),
        })
    }
}

/// Weight of the assumption that there is no hard iron, beside that of the samples.
const SPHERE_RIDGE: f32 = 1e-4;

/// A sphere through all samples: hard iron only. The fields are rotated by `rotation`
/// first.
pub(super) fn sphere(samples: Samples<'_>, rotation: &Matrix3<f32>) -> Option<Start> {
    let fields = || samples.all().map(|s| (rotation * s.field.ut, s));
    let number = fields().count() as f32;
    let mean = fields().map(|(f, _)| f).sum::<Vector3<f32>>() / number;
    // |m|^2 = 2 m . b + (r^2 - |b|^2), linear in b and the bracket; fields from their mean, for the digits.
    let mut system = LeastSquares::<4, 1>::new();
    let mut spread = 0.0;
    for (field, _) in fields() {
        let p = field - mean;
        system.add(&(p * 2.0).push(1.0), [p.norm_squared()], 1.0);
        spread += p.norm_squared();
    }
    // Weakly, no hard iron: it decides where a single turn leaves the centre open along its axis.
    for i in 0..3 {
        system.add(&Vector4::ith(i, 1.0), [-mean[i]], SPHERE_RIDGE * spread);
    }
    let solution = system.solve()?;
    let centre = solution.fixed_rows::<3>(0).into_owned();
    let unit_ut = libm::sqrtf((solution[3] + centre.norm_squared()).max(1.0));
    let b_ut = mean + centre;
    let sin_dip = fields()
        .map(|(field, s)| {
            let level = s.attitude.level(Field::new(field - b_ut));
            level.ut.z / level.total_ut().max(1e-6)
        })
        .sum::<f32>()
        / number;
    let inclination_rad = trig::asin(sin_dip);
    Some(Start { unit_ut, w: Matrix3::identity(), b: b_ut / unit_ut, inclination_rad })
}

/// Tangent of an inclination in radians.
pub(super) fn tangent(inclination_rad: f32) -> f32 {
    let (sin, cos) = trig::sin_cos(inclination_rad);
    sin / cos
}
