//! Circle through the field of a turn's samples, to assign samples to heading sectors before calibration.
//!
//! Hard iron several times the horizontal field hides the heading. A turn at constant bank is a plane ellipse in sensor
//! space: samples are projected on their principal plane, a circle is fitted there, and the angle about its centre
//! gives the sector. The configured mounting has no influence.

use core::f32::consts::TAU;

use nalgebra::{Matrix3, Vector2};

use crate::calibration::{LeastSquares, PrincipalPlane, Sample, Samples};
use crate::trig::sqrt;

/// Number of heading sectors, 30 deg each.
pub const SECTOR_COUNT: usize = 12;

const MIN_CIRCLE_POINTS: usize = 3;

#[derive(Clone, Copy, Debug)]
pub(super) struct TurnCircle {
    plane: PrincipalPlane,
    centre_ut: Vector2<f32>,
    pub radius_ut: f32,
}

impl TurnCircle {
    /// Least-squares fit of `x^2 + y^2 = a x + b y + c` (I. Kasa, "A circle fitting procedure and its error analysis",
    /// IEEE Trans. Instrum. Meas. 25(1), 1976) in the plane of the two largest principal axes. An arc is enough; `None`
    /// if the fit is singular.
    pub fn fit_circle(samples: &Samples<'_>) -> Option<Self> {
        if samples.iter().count() < MIN_CIRCLE_POINTS {
            return None;
        }
        let plane = PrincipalPlane::fit_plane(samples, &Matrix3::identity())?;
        let mut least_squares = LeastSquares::<3, 1>::new();
        for sample in samples.iter() {
            let p = plane.plane_coordinates(&sample.field.ut);
            least_squares.add_weighted_row(&p.push(1.0), [p.norm_squared()], 1.0);
        }
        let solution = least_squares.solve()?;
        let centre_ut = solution.xy() / 2.0;
        let radius_ut = sqrt((centre_ut.norm_squared() + solution.z).max(0.0));
        radius_ut.is_finite().then_some(Self { plane, centre_ut, radius_ut })
    }

    /// Heading sector of a sample, 0..[`SECTOR_COUNT`].
    pub fn sector_of(&self, sample: &Sample) -> usize {
        sector_of_direction(self.plane.plane_coordinates(&sample.field.ut) - self.centre_ut)
    }
}

fn sector_of_direction(direction: Vector2<f32>) -> usize {
    let turns = libm::atan2f(direction.y, direction.x) / TAU + 0.5;
    // The cast saturates and maps NaN to 0.
    ((turns * SECTOR_COUNT as f32) as usize).min(SECTOR_COUNT - 1)
}

#[cfg(test)]
mod tests {
    use super::super::test_samples::{RADIUS_UT, circle_sample};
    use super::*;

    fn circle_through(samples: &[Sample]) -> Option<TurnCircle> {
        TurnCircle::fit_circle(&Samples::new(samples))
    }

    /// 60 deg of arc. Tolerance: `f32` rounding of 100 uT hard iron squared, 1e-6, times ten.
    #[test]
    fn an_arc_determines_the_circle() {
        let arc: Vec<Sample> = (0..=60).step_by(5).map(|heading_deg| circle_sample(heading_deg as f32)).collect();
        let circle = circle_through(&arc).unwrap();
        assert!((circle.radius_ut - RADIUS_UT).abs() < 0.01, "{circle:?}");
    }

    #[test]
    fn two_points_or_nonfinite_values_have_no_circle() {
        let points = [0.0, 90.0, 200.0].map(circle_sample);
        assert!(circle_through(&points[..2]).is_none());
        assert!(circle_through(&points).is_some());
        let broken = Sample { field: crate::frames::Field::from_ut(f32::NAN, 0.0, 0.0), ..points[0] };
        assert!(circle_through(&[points[0], points[1], points[2], broken]).is_none());
    }

    /// An angle of exactly pi would be a thirteenth sector.
    #[test]
    fn an_angle_of_pi_is_in_the_last_sector() {
        assert_eq!(
            (sector_of_direction(Vector2::new(-1.0, 0.0)), sector_of_direction(Vector2::new(-1.0, -0.0))),
            (SECTOR_COUNT - 1, 0)
        );
        assert_eq!(
            [0.1, -0.1].map(|y| sector_of_direction(Vector2::new(1.0, y))),
            [SECTOR_COUNT / 2, SECTOR_COUNT / 2 - 1]
        );
        assert_eq!(sector_of_direction(Vector2::new(f32::NAN, 1.0)), 0);
    }

    /// The position of the first sector depends on the plane's axes.
    #[test]
    fn sectors_are_twelve_of_thirty_degrees_in_order() {
        let all: Vec<Sample> = (0..360_u16).map(|heading_deg| circle_sample(f32::from(heading_deg))).collect();
        let circle = circle_through(&all).unwrap();
        let sectors: Vec<usize> = all.iter().map(|s| circle.sector_of(s)).collect();
        for sector in 0..SECTOR_COUNT {
            let wide = sectors.iter().filter(|s| **s == sector).count();
            assert!((29..=31).contains(&wide), "sector {sector} is {wide} deg wide");
        }
        let changes = sectors.iter().zip(sectors.iter().cycle().skip(1)).filter(|(a, b)| a != b);
        assert_eq!(changes.clone().count(), SECTOR_COUNT);
        assert!(changes.clone().all(|(a, b)| a.abs_diff(*b) == 1 || a.abs_diff(*b) == SECTOR_COUNT - 1));
    }
}
