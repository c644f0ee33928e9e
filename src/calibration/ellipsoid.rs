//! Ellipsoid: nine coefficients from tumbling on a bench, without any attitude (Liu 2007 section 2).
//!
//! Turned through all attitudes, an ideal sensor's measurements lie on a sphere, those of a real one on an ellipsoid
//! round `b`. Its shape gives `W` up to a rotation, which is chosen so that `W` is symmetric in the axes of the mount:
//! the mounting cannot be seen without attitude. The fit is that of [maximum likelihood](super::maximum_likelihood) with
//! the norm's residuals alone, started from a sphere.
//!
//! The samples of left and right turns lie on two ellipses only, and many ellipsoids go through those; so whoever solves
//! must ask [`is_determined`].

use super::evidence::Evidence;
use super::likelihood::{Likelihood, Quantity, Vector13};

/// Whether the samples, and not the priors, determine shape and centre.
pub(super) fn is_determined(evidence: &Evidence, likelihood: &Likelihood, unknowns: &Vector13) -> bool {
    evidence
        .left_to_priors(likelihood, unknowns)
        .is_some_and(|mut left| !left.any(|quantity| matches!(quantity, Quantity::SoftIron | Quantity::HardIron)))
}
