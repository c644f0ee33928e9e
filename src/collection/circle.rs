//! The circle that a turn's samples run round, seen in their own plane: which heading sector a sample lies in.
//!
//! The heading is not known while a compass is being calibrated, and hard iron several times the horizontal field turns
//! the raw direction into a few degrees to and fro. What is known is that a turn at constant bank is a plane ellipse in
//! sensor space. So a side's samples are projected on their own principal plane, a circle is fitted there, and the angle
//! about its centre divides the turn into sectors. No axis convention enters: a wrongly configured mounting collects as
//! well as a right one.

use nalgebra::{Matrix3, Vector2};

use super::dataset::SECTORS;
use crate::calibration::{LeastSquares, Plane, Sample, Samples};

/// A circle in the principal plane of a turn's samples.
#[derive(Clone, Copy, Debug)]
pub(super) struct Circle {
    plane: Plane,
    /// The centre, in the plane's coordinates.
    centre_ut: Vector2<f32>,
    pub radius_ut: f32,
}

impl Circle {
    /// Least squares of `x^2 + y^2 = a x + b y + c` (Kasa's fit) in the plane of the largest two principal axes. An arc is
    /// enough; `None` while there is no arc to speak of.
    pub fn through(samples: &Samples<'_>) -> Option<Self> {
        if samples.iter().count() < 3 {
            return None;
        }
        let plane = Plane::through(samples, &Matrix3::identity())?;
        let mut system = LeastSquares::<3, 1>::new();
        for sample in samples.iter() {
            let p = plane.flat(&sample.field.ut);
            system.add(&p.push(1.0), [p.norm_squared()], 1.0);
        }
        let solution = system.solve()?;
        let centre_ut = solution.xy() / 2.0;
        let radius_ut = libm::sqrtf((centre_ut.norm_squared() + solution.z).max(0.0));
        radius_ut.is_finite().then_some(Self { plane, centre_ut, radius_ut })
    }

    /// Which sector a sample lies in, 0..[`SECTORS`].
    pub fn sector(&self, sample: &Sample) -> usize {
        let p = self.plane.flat(&sample.field.ut) - self.centre_ut;
        let angle_rad = libm::atan2f(p.y, p.x);
        let turns = angle_rad / core::f32::consts::TAU + 0.5;
        // The cast saturates and takes NaN to 0, so the index is in range for every input.
        ((turns * SECTORS as f32) as usize).min(SECTORS - 1)
    }
}
