//! Policy of a tumble: a minimum distance in field space, which grows when the part is full.

use super::part_view::PartView;
use super::progress::percent;
use super::quota::{SampleQuota, SampleUse};
use crate::calibration::Sample;
use crate::trig::VectorLength as _;

/// Initial minimum distance between samples, microtesla: a thirtieth of a circle in a weak field.
pub(super) const INITIAL_MIN_DISTANCE_UT: f32 = 5.0;

/// Factor on the distance when the part is full.
const DISTANCE_GROWTH: f32 = 1.3;

/// Fit samples that count as 100 percent.
const COMPLETE_SAMPLE_COUNT: u16 = 66;
const _: () = assert!(COMPLETE_SAMPLE_COUNT as usize <= SampleQuota::TURN.fit_quota);

/// Stores a sample of any attitude if it is due and at least `min_distance_ut` from the others; increases this when
/// the quota is used. Returns whether the sample was stored.
pub(super) fn push_sample(
    mut part: PartView<'_>,
    quota: SampleQuota,
    min_distance_ut: &mut f32,
    sample: Sample,
) -> bool {
    let is_far = !part.fit_then_held_back().iter().any(|other| field_distance(other, &sample) < *min_distance_ut);
    let is_taken = part.is_due(&sample) && is_far;
    if is_taken {
        let sample_use = part.count_and_assign_use(&sample);
        store_sample(&mut part, sample_use, quota, min_distance_ut, sample);
        part.part_state.percent = percent(part.samples_of_use(SampleUse::Fit).len() as u16, COMPLETE_SAMPLE_COUNT);
    }
    is_taken
}

/// Stores a sample; for the fit if there is no room among the held-back ones.
fn store_sample(
    part: &mut PartView<'_>,
    sample_use: SampleUse,
    quota: SampleQuota,
    min_distance_ut: &mut f32,
    sample: Sample,
) {
    if sample_use == SampleUse::Verification && !part.is_full(sample_use, quota) {
        return part.insert_sample(sample_use, sample);
    }
    if part.is_full(SampleUse::Fit, quota) {
        *min_distance_ut *= DISTANCE_GROWTH;
        remove_close_samples(part, *min_distance_ut);
    }
    // If thinning removed nothing, the sample is dropped.
    if !part.is_full(SampleUse::Fit, quota) {
        part.insert_sample(SampleUse::Fit, sample);
    }
}

/// Removes every fit sample nearer than `min_distance_ut` to an earlier one.
fn remove_close_samples(part: &mut PartView<'_>, min_distance_ut: f32) {
    let mut i = 0;
    while let Some((sample, earlier)) = part.samples_of_use(SampleUse::Fit).get(..=i).and_then(<[_]>::split_last) {
        if earlier.iter().any(|other| field_distance(other, sample) < min_distance_ut) {
            part.remove_sample(SampleUse::Fit, i);
        } else {
            i += 1;
        }
    }
}

/// Distance of two samples in field space, microtesla.
fn field_distance(a: &Sample, b: &Sample) -> f32 {
    (a.field.ut - b.field.ut).vector_length()
}

#[cfg(test)]
mod tests;
