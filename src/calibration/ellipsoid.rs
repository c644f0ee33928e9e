//! Ellipsoid: nine coefficients from tumbling on a bench, without any attitude (Liu 2007 section 2).
//!
//! Turned through all attitudes, an ideal sensor's measurements lie on a sphere, those of a real one on an ellipsoid
//! round `b`. Its shape gives `W` up to a rotation, which is chosen so that `W` is symmetric in the axes of the mount:
//! the mounting cannot be seen without attitude. The fit is that of [maximum likelihood](super::maximum_likelihood)
//! with the norm's residuals alone, started from a sphere.
//!
//! The samples of left and right turns lie on two ellipses only, and many ellipsoids go through those (wandering bank
//! and noise may single one out, but not the right one); so whoever solves must ask [`is_determined`].

use nalgebra::Vector3;

use super::information::Information;
use super::likelihood::{Likelihood, Quantity, Vector13};
use super::{Calibration, Samples};

/// Of the 24 directions that the six faces of a cube, cut in four, divide space into, so many must have been seen. Left
/// and right turns see up to 20, a sensor turned in the hands all of them.
const MIN_DIRECTIONS: u32 = 22;

/// Whether the samples, and not the priors, determine shape and centre.
pub(super) fn is_determined(
    samples: Samples<'_>,
    calibration: &Calibration,
    information: &Information,
    likelihood: &Likelihood,
    unknowns: &Vector13,
) -> bool {
    directions(samples, calibration) >= MIN_DIRECTIONS
        && information
            .left_to_priors(likelihood, unknowns)
            .is_some_and(|mut left| !left.any(|quantity| matches!(quantity, Quantity::SoftIron | Quantity::HardIron)))
}

/// How many of the 24 directions the corrected fields have.
fn directions(samples: Samples<'_>, calibration: &Calibration) -> u32 {
    let seen = samples.all().fold(0_u32, |seen, s| seen | 1 << direction(&calibration.apply(s.field).ut));
    seen.count_ones()
}

/// Which of the 24: the face that the largest component points to, and the signs of the other two.
fn direction(field: &Vector3<f32>) -> usize {
    let axis = field.iamax();
    let sign = |i: usize| usize::from(field[(axis + i) % 3] < 0.0);
    axis * 8 + sign(0) * 4 + sign(1) * 2 + sign(2)
}

#[cfg(test)]
mod tests {
    use testkit::random::Random;

    use super::*;
    use crate::calibration::{Method, Part, Prior, Quality, Rates, Sample, SolveError, solve};
    use crate::frames::{Attitude, Field};
    use crate::time::WrappingMillis;

    #[test]
    fn there_are_twenty_four_directions() {
        let mut seen = [false; 24];
        for (axis, [u, v]) in
            (0..3).flat_map(|axis| [[0.5, 0.6], [-0.5, 0.6], [0.5, -0.6], [-0.5, -0.6]].map(|uv| (axis, uv)))
        {
            for sign in [1.0, -1.0] {
                let mut field = Vector3::zeros();
                (field[axis], field[(axis + 1) % 3], field[(axis + 2) % 3]) = (sign, u, v);
                let direction = direction(&(field * 40.0));
                assert!(!seen[direction], "{field} is direction {direction} again");
                seen[direction] = true;
            }
        }
        assert!(seen.iter().all(|&seen| seen));
    }

    /// A sensor turned in the hands, but never to these directions.
    fn tumbled(missing: usize) -> Result<Quality, SolveError> {
        let mut random = Random(5);
        let mut noise = move || Vector3::from_fn(|_, _| random.normal());
        let samples: Vec<Sample> = core::iter::repeat_with(&mut noise)
            .map(|v| v.normalize() * 50.0)
            .filter(|field| direction(field) >= missing)
            .take(300)
            .map(|field| Vector3::new(1.1 * field.x + 9.0, field.y - 20.0, 0.95 * field.z + 3.0))
            .map(|ut| Sample {
                field: Field::new(ut),
                attitude: Attitude::default(),
                time: WrappingMillis::default(),
                rates: Rates::NONE,
            })
            .collect();
        solve(Method::Ellipsoid, Samples { level: &samples, ..Samples::default() }, &Prior::default())
            .map(|s| s.quality)
    }

    #[test]
    fn twenty_two_directions_are_enough_and_twenty_one_are_not() {
        assert!(tumbled(0).is_ok());
        assert!(tumbled(2).is_ok(), "{:?}", tumbled(2));
        assert_eq!(tumbled(3).map(|_| ()), Err(SolveError::NotDetermined(Part::All)));
    }
}
