//! Checks of the samples before a solve.

use nalgebra::Vector3;

use crate::calibration::closed_form::turns::MIN_SAMPLES;
use crate::calibration::types::error::{Axis, SolveError};
use crate::calibration::types::method::Method;
use crate::calibration::types::samples::{CollectionPart, Sample, SamplePart, Samples};
use crate::frames::RollPitch;
use crate::trig::sqrt;

/// Upper limit of a plausible field, microtesla: 10,000 times the Earth's field.
const MAX_FIELD_UT: f32 = 1e6;

/// Minimum distance of the fields from their mean, microtesla RMS: a full turn in the horizontal field at 82 deg of
/// inclination. A copter that hovers on one heading has 3 to 6.
const MIN_FIELD_SPREAD_UT: f32 = 7.0;

/// Width of each end of an axis' range, as a fraction of the range.
const RANGE_END_FRACTION: f32 = 0.01;

/// Stuck if more than 1/5 of the samples are at one end of the range.
const STUCK_FRACTION_DIVISOR: usize = 5;

pub(super) fn check_samples(method: Method, samples: Samples<'_>) -> Result<(), SolveError> {
    let part = if method == Method::Level { SamplePart::Level } else { SamplePart::All };
    let need = if samples.marks.is_empty() { MIN_SAMPLES } else { 1 };
    SolveError::require_samples(part, samples.all_samples().count(), need)?;
    let headings = samples.marks.iter().all(|mark| mark.heading_rad.is_finite());
    if !(headings && samples.all_samples().all(is_finite)) {
        return Err(SolveError::NotFinite);
    }
    if let Some(axis) = stuck_axis(samples) {
        return Err(SolveError::AxisStuck { axis });
    }
    let has_turned = !samples.marks.is_empty() || field_spread_ut(samples) >= MIN_FIELD_SPREAD_UT;
    if has_turned { Ok(()) } else { Err(SolveError::NotDetermined(part)) }
}

/// RMS distance of the fields from their mean, microtesla, by every fourth sample.
fn field_spread_ut(samples: Samples<'_>) -> f32 {
    let Some(origin) = samples.all_samples().next().map(|sample| sample.field.ut) else { return 0.0 };
    let (mut count, mut sum, mut squares) = (0.0_f32, Vector3::zeros(), 0.0_f32);
    for sample in samples.all_samples().step_by(4) {
        let offset = sample.field.ut - origin;
        count += 1.0;
        sum += offset;
        squares += offset.norm_squared();
    }
    sqrt((squares / count - (sum / count).norm_squared()).max(0.0))
}

/// Whether all values are finite, and their fourth powers as well.
fn is_finite(sample: &Sample) -> bool {
    let RollPitch { roll_rad, pitch_rad } = sample.attitude;
    sample.field.ut.iter().all(|ut| ut.abs() < MAX_FIELD_UT) && roll_rad.is_finite() && pitch_rad.is_finite()
}

/// Axis that stays at one end of its range in turns: saturated or frozen. In a full circle, 1 sample in 16 is within 1
/// % of either end.
pub(super) fn stuck_axis(samples: Samples<'_>) -> Option<Axis> {
    let turns = || samples.without_part(CollectionPart::LEVEL).iter();
    let sample_count = turns().count();
    [Axis::X, Axis::Y, Axis::Z].into_iter().find(|&axis| {
        let values = || turns().map(|sample| sample.field.ut[axis as usize]);
        let (low, high) = values().fold((f32::MAX, f32::MIN), |(low, high), v| (low.min(v), high.max(v)));
        let end_width = RANGE_END_FRACTION * (high - low);
        let is_stuck_at = |range_end: f32| {
            values().filter(|v| (v - range_end).abs() <= end_width).count() * STUCK_FRACTION_DIVISOR > sample_count
        };
        sample_count >= MIN_SAMPLES && (is_stuck_at(low) || is_stuck_at(high))
    })
}
