//! The circle that a turn's samples run round, seen in their own plane: which heading sector a sample lies in.
//!
//! The heading is not known while a compass is being calibrated, and hard iron several times the horizontal field turns
//! the raw direction into a few degrees to and fro. What is known is that a turn at constant bank is a plane ellipse in
//! sensor space. So a side's samples are projected on their own principal plane, a circle is fitted there, and the
//! angle about its centre divides the turn into sectors. No axis convention enters: a wrongly configured mounting
//! collects as well as a right one.

use core::f32::consts::TAU;

use nalgebra::{Matrix3, Vector2};

use crate::calibration::{LeastSquares, Plane, Sample, Samples};

/// Sectors a circle is divided into, 30 deg each.
pub const SECTORS: usize = 12;

/// Fewer points than these three have no circle.
const MIN_POINTS: usize = 3;

/// A circle in the principal plane of a turn's samples.
#[derive(Clone, Copy, Debug)]
pub(super) struct Circle {
    plane: Plane,
    /// The centre, in the plane's coordinates.
    centre_ut: Vector2<f32>,
    pub radius_ut: f32,
}

impl Circle {
    /// Least squares of `x^2 + y^2 = a x + b y + c` (I. Kasa, "A circle fitting procedure and its error analysis",
    /// IEEE Trans. Instrum. Meas. 25(1), 1976) in the plane of the largest two principal axes. An arc is enough; `None`
    /// while there is no arc to speak of.
    pub fn through(samples: &Samples<'_>) -> Option<Self> {
        if samples.iter().count() < MIN_POINTS {
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
        sector(self.plane.flat(&sample.field.ut) - self.centre_ut)
    }
}

/// Which sector a direction lies in, counted from the negative x axis.
fn sector(direction: Vector2<f32>) -> usize {
    let turns = libm::atan2f(direction.y, direction.x) / TAU + 0.5;
    // The cast saturates and takes NaN to 0, so the index is in range for every input.
    ((turns * SECTORS as f32) as usize).min(SECTORS - 1)
}

#[cfg(test)]
mod tests {
    use super::super::testing::{RADIUS_UT, on_circle};
    use super::*;

    fn through(samples: &[Sample]) -> Option<Circle> {
        Circle::through(&Samples { left: samples, ..Samples::default() })
    }

    /// A sixth of the circle is enough to know the rest; f32 leaves 1e-6 of 100 uT of hard iron, ten times that here.
    #[test]
    fn an_arc_gives_the_circle() {
        let arc: Vec<Sample> = (0..=60).step_by(5).map(|heading_deg| on_circle(heading_deg as f32)).collect();
        let circle = through(&arc).unwrap();
        assert!((circle.radius_ut - RADIUS_UT).abs() < 0.01, "{circle:?}");
    }

    #[test]
    fn two_points_and_what_is_not_finite_have_no_circle() {
        let points = [0.0, 90.0, 200.0].map(on_circle);
        assert!(through(&points[..2]).is_none());
        assert!(through(&points).is_some());
        let broken = Sample { field: crate::frames::Field::from_ut(f32::NAN, 0.0, 0.0), ..points[0] };
        assert!(through(&[points[0], points[1], points[2], broken]).is_none());
    }

    /// The angle pi is a whole turn from -pi, which would be a thirteenth sector.
    #[test]
    fn the_last_sector_ends_where_the_first_begins() {
        assert_eq!((sector(Vector2::new(-1.0, 0.0)), sector(Vector2::new(-1.0, -0.0))), (SECTORS - 1, 0));
        assert_eq!([0.1, -0.1].map(|y| sector(Vector2::new(1.0, y))), [SECTORS / 2, SECTORS / 2 - 1]);
        assert_eq!(sector(Vector2::new(f32::NAN, 1.0)), 0);
    }

    /// Where the sectors begin depends on the plane's axes; that each is 30 deg wide and next to its neighbours does
    /// not.
    #[test]
    fn sectors_are_twelve_of_thirty_degrees_in_order() {
        let all: Vec<Sample> = (0..360_u16).map(|heading_deg| on_circle(f32::from(heading_deg))).collect();
        let circle = through(&all).unwrap();
        let sectors: Vec<usize> = all.iter().map(|s| circle.sector(s)).collect();
        for sector in 0..SECTORS {
            // A sample on a border may fall to either side.
            let wide = sectors.iter().filter(|s| **s == sector).count();
            assert!((29..=31).contains(&wide), "sector {sector} is {wide} deg wide");
        }
        let changes = sectors.iter().zip(sectors.iter().cycle().skip(1)).filter(|(a, b)| a != b);
        assert_eq!(changes.clone().count(), SECTORS);
        assert!(changes.clone().all(|(a, b)| a.abs_diff(*b) == 1 || a.abs_diff(*b) == SECTORS - 1));
    }
}
