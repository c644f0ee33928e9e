//! Ellipsoid: nine coefficients from tumbling without attitude (Liu 2007 section 2).
//!
//! The measurements of an ideal sensor at all attitudes form a sphere, those of a real one an ellipsoid around `b`. Its
//! shape determines `W` up to a rotation; the symmetric `W` in mount axes is chosen, because the mounting is
//! unobservable without attitude. The fit is that of [maximum likelihood](crate::calibration::fit) with norm
//! residuals only, started from a sphere.
//!
//! Turns alone lie on two ellipses, through which many ellipsoids pass. So a solve must check [`is_determined`].

use nalgebra::Vector3;

use crate::calibration::fit::converged_fit::ConvergedFit;
use crate::calibration::model::PriorQuantity;
use crate::calibration::types::coefficients::Calibration;
use crate::calibration::types::samples::Samples;
use crate::calibration::uncertainty::information::Information;
use crate::calibration::uncertainty::observability::unobservable_quantities;

/// Minimum number of covered directions of 24: the six faces of a cube with four quadrants each. Left and right turns
/// cover up to 20, tumbling all.
const MIN_DIRECTIONS: u32 = 22;

/// Whether the samples determine the nine coefficients.
pub(super) fn is_determined(fit: &ConvergedFit<'_>, information: &Information) -> bool {
    count_directions(fit.samples, fit.calibration) >= MIN_DIRECTIONS
        && unobservable_quantities(&information.linear_system, fit.likelihood, fit.unknowns).is_some_and(
            |mut unobservable| {
                !unobservable.any(|quantity| matches!(quantity, PriorQuantity::SoftIron | PriorQuantity::HardIron))
            },
        )
}

fn count_directions(samples: Samples<'_>, calibration: &Calibration) -> u32 {
    let directions = samples
        .all_samples()
        .fold(0_u32, |directions, s| directions | 1 << direction_index(&calibration.calibrated_field(s.field).ut));
    directions.count_ones()
}

/// Direction of a field: axis of the largest component, and the signs of all three.
fn direction_index(field: &Vector3<f32>) -> usize {
    let axis = field.iamax();
    let sign = |i: usize| usize::from(field[(axis + i) % 3] < 0.0);
    axis * 8 + sign(0) * 4 + sign(1) * 2 + sign(2)
}

#[cfg(test)]
mod tests {
    use crate::calibration::tests::synthetic::Parts;
    use testkit::random::Random;

    use super::*;
    use crate::calibration::{CollectionPart, Method, Prior, Quality, Sample, SolveError, solve_samples};
    use crate::frames::{Field, RollPitch};

    fn tumbled_samples(missing_direction_count: usize) -> Vec<Sample> {
        let mut random = Random(5);
        let mut noise = move || Vector3::from_fn(|_, _| random.normal());
        core::iter::repeat_with(&mut noise)
            .map(|v| v.normalize() * 50.0)
            .filter(|field| direction_index(field) >= missing_direction_count)
            .take(300)
            .map(|field| Vector3::new(1.1 * field.x + 9.0, field.y - 20.0, 0.95 * field.z + 3.0))
            .map(|ut| Sample::new(Field::new(ut), RollPitch::default()))
            .collect()
    }

    fn solve_tumbled(missing_direction_count: usize) -> Result<Quality, SolveError> {
        solve_samples(Method::Ellipsoid, Samples::new(&tumbled_samples(missing_direction_count)), &Prior::default())
            .map(|s| s.quality)
    }

    /// The ellipsoid fit starts from the sphere fit; its advice assumes turns.
    #[test]
    fn neither_attitude_nor_part_of_tumbled_samples_matters() {
        let mut samples = tumbled_samples(0);
        for (i, sample) in samples.iter_mut().enumerate() {
            sample.attitude = RollPitch::from_deg(40.0 * (i as f32).sin(), 30.0 * (1.7 * i as f32).cos());
        }
        let solved = |parts: Parts<'_>| {
            let solution = solve_samples(Method::Ellipsoid, parts.samples(), &Prior::default()).unwrap();
            (solution.calibration, solution.advice)
        };
        let free = solved(Parts { free: &samples, ..Parts::default() });
        assert_eq!(free, solved(Parts { left: &samples, ..Parts::default() }));
        assert!(free.1.is_some());
    }

    /// Two directions may be missing, as behind the hand that holds the sensor.
    #[test]
    fn most_field_directions_are_required() {
        assert!(solve_tumbled(0).is_ok() && solve_tumbled(2).is_ok(), "{:?}", solve_tumbled(2));
        assert_eq!(solve_tumbled(6).map(|_| ()), Err(SolveError::NotDetermined(CollectionPart::FREE)));
    }
}
