//! Ellipsoid: nine coefficients from tumbling on a bench, without any attitude (Liu 2007 section 2).
//!
//! Turned through all attitudes, an ideal sensor's measurements lie on a sphere, those of a real one on an ellipsoid
//! round `b`. Its shape gives `W` up to a rotation, which is chosen so that `W` is symmetric in the axes of the mount:
//! the mounting cannot be seen without attitude. The fit is that of [maximum likelihood](super::maximum_likelihood) with
//! the norm's residuals alone, started from a sphere.
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
