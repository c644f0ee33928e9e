//! One part of the buffer and its state, on which a retention policy acts.

use super::progress::PartCoverage;
use super::quota::{SampleQuota, SampleUse};
use super::retained_samples::PartState;
use super::sample_buffer::SampleBuffer;
use crate::calibration::{CollectionPart, Sample, Samples};
use crate::time::WrappingMillis;

/// Shortest interval of stored samples, milliseconds: attitude errors are correlated over about 0.5 s.
const SAMPLE_INTERVAL_MS: u32 = 400;

/// Period of held-back samples: one in this number is held back.
pub(super) const HOLD_BACK_CYCLE: u16 = 4;

/// Number of parts of the sample buffer.
pub(super) const PART_COUNT: usize = CollectionPart::ALL_PARTS.len();

/// One part of the sample buffer, with its state.
pub(super) struct PartView<'a> {
    part: CollectionPart,
    buffer: &'a mut SampleBuffer,
    pub part_state: &'a mut PartState,
    last_due_sample_at: &'a mut Option<WrappingMillis>,
}

impl<'a> PartView<'a> {
    /// View of a part, with all parts' states and times by [`CollectionPart::index`].
    pub fn new(
        part: CollectionPart,
        buffer: &'a mut SampleBuffer,
        states: &'a mut [PartState; PART_COUNT],
        last_due_sample_at: &'a mut [Option<WrappingMillis>; PART_COUNT],
    ) -> Self {
        let index = part.index();
        Self { part, buffer, part_state: &mut states[index], last_due_sample_at: &mut last_due_sample_at[index] }
    }

    /// The part's samples for one purpose, fit or held back, in the order of their storage.
    pub fn samples_of_use(&self, sample_use: SampleUse) -> &[Sample] {
        self.buffer.samples_of_part(sample_use, self.part)
    }

    pub fn fit_then_held_back(&self) -> Samples<'_> {
        self.buffer.part_fit_then_held_back(self.part)
    }

    pub fn is_full(&self, sample_use: SampleUse, quota: SampleQuota) -> bool {
        self.samples_of_use(sample_use).len() >= quota.quota_of(sample_use)
    }

    /// Whether a sample is finite and at least one sample interval after the last.
    pub fn is_due(&self, sample: &Sample) -> bool {
        let is_late =
            self.last_due_sample_at.is_none_or(|taken_at| sample.time.ms_since(taken_at) >= SAMPLE_INTERVAL_MS);
        is_late && sample.field.ut.iter().all(|component| component.is_finite())
    }

    pub fn count_and_assign_use(&mut self, sample: &Sample) -> SampleUse {
        *self.last_due_sample_at = Some(sample.time);
        self.part_state.due_sample_count = self.part_state.due_sample_count.wrapping_add(1);
        let is_held_back = self.part_state.due_sample_count.is_multiple_of(HOLD_BACK_CYCLE);
        if is_held_back { SampleUse::Verification } else { SampleUse::Fit }
    }

    /// Stores the latest sample.
    pub fn insert_sample(&mut self, sample_use: SampleUse, sample: Sample) {
        self.buffer.insert_sample(sample_use, Sample { part: self.part, ..sample });
    }

    /// Stores the latest sample in place of the one at a position.
    pub fn replace_sample(&mut self, sample_use: SampleUse, position: usize, sample: Sample) {
        self.replace_within_section(sample_use, position, self.samples_of_use(sample_use).len(), sample);
    }

    pub fn replace_within_section(&mut self, sample_use: SampleUse, position: usize, end: usize, sample: Sample) {
        self.buffer.replace_sample(sample_use, position, end, Sample { part: self.part, ..sample });
    }

    pub fn remove_sample(&mut self, sample_use: SampleUse, position: usize) {
        self.buffer.remove_sample(sample_use, self.part, position);
    }

    pub fn coverage(&self) -> PartCoverage {
        coverage(self.buffer, self.part, *self.part_state)
    }
}

pub(super) fn coverage(buffer: &SampleBuffer, part: CollectionPart, state: PartState) -> PartCoverage {
    let [samples, held_back] = [SampleUse::Fit, SampleUse::Verification]
        .map(|sample_use| buffer.samples_of_part(sample_use, part).len() as u16);
    PartCoverage {
        fit_count: samples,
        held_back_count: held_back,
        covered_sector_count: state.covered_sector_count,
        percent: state.percent,
    }
}
