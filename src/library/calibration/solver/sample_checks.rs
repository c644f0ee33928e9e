//! Checks of the samples before a solve.

use nalgebra::Vector3;

use crate::calibration::closed_form::turns::MIN_SAMPLES;
use crate::calibration::fit::ConvergedFit;
use crate::calibration::types::coefficients::Calibration;
use crate::calibration::types::quality::{Axis, Method, SolveError};
use crate::calibration::types::samples::{CollectionPart, Sample, Samples};
use crate::calibration::uncertainty::information::Information;
use crate::calibration::uncertainty::observability::unobservable_quantities;
use crate::frames::RollPitch;

/// Upper limit of a plausible field, microtesla: 10,000 times the Earth's field.
const MAX_FIELD_UT: f32 = 1e6;

/// Minimum distance of the fields from their mean, microtesla RMS: a full turn in the horizontal field at 82 deg of
/// inclination. A copter that hovers on one heading has 3 to 6.
const MIN_FIELD_SPREAD_UT: f32 = 7.0;

/// Width of each end of an axis' range, as a fraction of the range.
const RANGE_END_FRACTION: f32 = 0.01;

/// Stuck if more than 1/5 of the samples are at one end of the range,
const MIN_STUCK_FRACTION: f32 = 0.2;
/// and have at least this share of the scatter of all fields: a frozen axis has all of it, a module at rest nothing.
const MIN_STUCK_SCATTER: f32 = 0.03;

pub(super) fn check_samples(method: Method, samples: Samples<'_>) -> Result<(), SolveError> {
    let part = if method == Method::Level { CollectionPart::LEVEL } else { CollectionPart::FREE };
    let need = if samples.marks.is_empty() { MIN_SAMPLES } else { 1 };
    SolveError::require_samples(part, samples.all_samples().count(), need)?;
    let headings = samples.marks.iter().all(|mark| mark.heading_rad.is_finite());
    // In one pass: it counts against the instruction limits of a solve.
    let mut spread = FieldSpread::default();
    let mut is_usable = |sample: &Sample| {
        spread.add(sample.field.ut);
        is_finite(sample)
    };
    if !(headings && samples.all_samples().all(&mut is_usable)) {
        return Err(SolveError::NotFinite);
    }
    if let Some(axis) = stuck_axis(samples) {
        return Err(SolveError::AxisStuck { axis });
    }
    let has_turned = !samples.marks.is_empty() || spread.variance_ut2() >= MIN_FIELD_SPREAD_UT * MIN_FIELD_SPREAD_UT;
    if has_turned { Ok(()) } else { Err(SolveError::NotDetermined(part)) }
}

/// Sums of fields, less the first one, microtesla.
#[derive(Clone, Copy, Default)]
struct FieldSpread {
    first_ut: Option<Vector3<f32>>,
    count: f32,
    sum_ut: Vector3<f32>,
    squares_ut2: f32,
}

impl FieldSpread {
    fn add(&mut self, field_ut: Vector3<f32>) {
        let offset_ut = field_ut - *self.first_ut.get_or_insert(field_ut);
        self.count += 1.0;
        self.sum_ut += offset_ut;
        self.squares_ut2 += offset_ut.norm_squared();
    }

    /// Mean square distance of the fields from their mean.
    fn variance_ut2(&self) -> f32 {
        self.scatter_ut2() / self.count
    }

    /// Sum of the squared distances of the fields from their mean.
    fn scatter_ut2(&self) -> f32 {
        self.squares_ut2 - self.sum_ut.norm_squared() / self.count.max(1.0)
    }
}

/// Whether all values are finite, and their fourth powers as well.
fn is_finite(sample: &Sample) -> bool {
    let RollPitch { roll_rad, pitch_rad } = sample.attitude;
    sample.field.ut.iter().all(|ut| ut.abs() < MAX_FIELD_UT) && roll_rad.is_finite() && pitch_rad.is_finite()
}

/// Axis that stays at one end of its range while the others change: saturated or frozen. In a full circle, 1 sample in 16
/// is within 1 % of either end.
pub(super) fn stuck_axis(samples: Samples<'_>) -> Option<Axis> {
    let fields = || samples.without_part(CollectionPart::LEVEL).iter().map(|sample| sample.field.ut);
    let (mut all, mut low, mut high) = (FieldSpread::default(), Vector3::repeat(f32::MAX), Vector3::repeat(f32::MIN));
    for field in fields() {
        all.add(field);
        (low, high) = (low.inf(&field), high.sup(&field));
    }
    let end_width = (high - low) * RANGE_END_FRACTION;
    let mut at_ends = [[FieldSpread::default(); 2]; 3];
    for field in fields() {
        for (axis, [at_low, at_high]) in at_ends.iter_mut().enumerate() {
            if field[axis] - low[axis] <= end_width[axis] {
                at_low.add(field);
            }
            if high[axis] - field[axis] <= end_width[axis] {
                at_high.add(field);
            }
        }
    }
    let is_stuck = |at_end: &FieldSpread| {
        all.count >= MIN_SAMPLES as f32
            && at_end.count > MIN_STUCK_FRACTION * all.count
            && at_end.scatter_ut2() > MIN_STUCK_SCATTER * all.scatter_ut2()
    };
    [Axis::X, Axis::Y, Axis::Z].into_iter().find(|&axis| at_ends[axis as usize].iter().any(is_stuck))
}

/// Minimum number of covered directions of 24: the six faces of a cube with four quadrants each. Left and right turns
/// cover up to 20, tumbling all.
const MIN_DIRECTIONS: u32 = 22;

/// Ellipsoid: nine coefficients from tumbling without attitude (Liu 2007 section 2).
///
/// The measurements of an ideal sensor at all attitudes form a sphere, those of a real one an ellipsoid around `b`. Its
/// shape determines `W` up to a rotation; the symmetric `W` in mount axes is chosen, because the mounting is
/// unobservable without attitude. The fit is that of [maximum likelihood](crate::calibration::fit) with norm
/// residuals only, started from a sphere.
///
/// Turns alone lie on two ellipses, through which many ellipsoids pass. So a solve must check [`is_determined`].
pub(super) fn is_determined(fit: &ConvergedFit<'_>, information: &Information) -> bool {
    count_directions(fit.samples, fit.calibration) >= MIN_DIRECTIONS
        && unobservable_quantities(&information.linear_system, fit.likelihood, fit.unknowns)
            .is_some_and(|unobservable| !unobservable.soft_iron && !unobservable.hard_iron)
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
mod ellipsoid_tests {
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
