//! Policy of free flight: a full buffer replaces the least informative sample.

use super::d_optimal_selection::DOptimalSelection;
use super::part_view::PartView;
use super::quota::{SampleQuota, SampleUse};
use crate::calibration::{Sample, Samples};
use crate::frames::{Attitude, wrap_pi};
use crate::trig;
use crate::trig::VectorLength as _;

/// Smallest change of the field between distinct samples, microtesla: three sigma of an averaged sample.
const MIN_FIELD_CHANGE_UT: f32 = 1.0;

/// Smallest change of the attitude between distinct samples, radians (1.5 deg).
const MIN_ATTITUDE_CHANGE_RAD: f32 = 0.026;

/// Result of offering a sample.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum OfferedSampleResult {
    /// Dropped, because it is not finite or does not differ from the last stored one.
    Ignored,
    /// Distinct, but not more informative than those stored.
    Rejected,
    /// The sample was stored.
    Stored,
}

/// Stores a sample if it is distinct, in place of the least informative one if the quota is used.
pub(super) fn push_sample(
    mut part: PartView<'_>,
    selection: &mut DOptimalSelection,
    sample: Sample,
) -> OfferedSampleResult {
    if !is_new_measurement(&part, &sample) {
        return OfferedSampleResult::Ignored;
    }
    let sample_use = part.count_and_assign_use(&sample);
    if !part.is_full(sample_use, SampleQuota::WHOLE_BUFFER) {
        part.insert_sample(sample_use, sample);
        return OfferedSampleResult::Stored;
    }
    let Some(weakest) = find_least_informative_sample(part.samples_of_use(sample_use), sample_use, selection, &sample)
    else {
        return OfferedSampleResult::Rejected;
    };
    let section_end = section_ends(sample_use, part.samples_of_use(sample_use).len())
        .into_iter()
        .find(|section_end| weakest < *section_end)
        .unwrap_or(0);
    part.replace_within_section(sample_use, weakest, section_end, sample);
    OfferedSampleResult::Stored
}

/// Ends of the sections in which samples are in order of time: a sample replaces one of its section.
fn section_ends(sample_use: SampleUse, length: usize) -> [usize; 3] {
    let turn_quota = SampleQuota::TURN.quota_of(sample_use);
    [turn_quota, 2 * turn_quota, length].map(|end| end.min(length))
}

/// Position of the sample that contributes less information than the new one.
fn find_least_informative_sample(
    samples: &[Sample],
    sample_use: SampleUse,
    selection: &mut DOptimalSelection,
    new_sample: &Sample,
) -> Option<usize> {
    let samples = Samples::new(samples);
    let weakest = match sample_use {
        SampleUse::Fit if !selection.may_exceed_weakest(new_sample) => None,
        SampleUse::Fit => selection.find_least_informative_sample(new_sample, samples),
        SampleUse::Verification => selection.with_reset_leverages().find_least_informative_sample(new_sample, samples),
    };
    weakest?.checked_sub(1)
}

/// Whether a sample is finite and differs from the last stored one. A parked aircraft adds no information, and may
/// be near the iron of a hangar.
fn is_new_measurement(part: &PartView<'_>, sample: &Sample) -> bool {
    let lasts = [SampleUse::Fit, SampleUse::Verification].into_iter().flat_map(|sample_use| {
        let samples = part.samples_of_use(sample_use);
        section_ends(sample_use, samples.len()).into_iter().filter_map(|end| samples.get(..end)?.last())
    });
    let last = lasts.min_by_key(|last| sample.time.ms_since(last.time));
    let Attitude { roll_rad, pitch_rad } = sample.attitude;
    let is_measurement = sample.field.ut.iter().chain(&[roll_rad, pitch_rad]).all(|component| component.is_finite());
    is_measurement && last.is_none_or(|last| is_distinct(last, sample))
}

fn is_distinct(last_stored: &Sample, sample: &Sample) -> bool {
    let tilt_rad = trig::hypot(
        wrap_pi(sample.attitude.roll_rad - last_stored.attitude.roll_rad),
        sample.attitude.pitch_rad - last_stored.attitude.pitch_rad,
    );
    (sample.field.ut - last_stored.field.ut).vector_length() >= MIN_FIELD_CHANGE_UT
        || tilt_rad >= MIN_ATTITUDE_CHANGE_RAD
}

#[cfg(test)]
mod tests;
