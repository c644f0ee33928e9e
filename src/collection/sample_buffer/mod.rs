//! The one buffer of a collection, in retained memory.
//!
//! Samples are ordered by use, part, and time: the fit samples are contiguous, so are the held-back ones, and each part
//! within them. A new sample is the latest of its part; storing it moves all samples behind that part.
//! A full free flight is in order of time within three sections only, in which its policy replaces samples.

use super::quota::{SampleQuota, SampleUse};
use crate::calibration::{CollectionPart, Sample, Samples, part_range, samples_of_part};
use crate::frames::{Attitude, Field};

const SAMPLE_CAPACITY: usize = SampleQuota::WHOLE_BUFFER.fit_quota + SampleQuota::WHOLE_BUFFER.held_back_quota;

pub(super) const UNUSED_SAMPLE: Sample = Sample {
    part: CollectionPart::LEFT,
    ..Sample::new(Field::from_ut(0.0, 0.0, 0.0), Attitude { roll_rad: 0.0, pitch_rad: 0.0 })
};

/// Samples and their numbers; valid for every content of its memory.
#[derive(Clone, Debug)]
pub(super) struct SampleBuffer {
    pub samples: [Sample; SAMPLE_CAPACITY],
    pub fit_count: u16,
    pub held_back_count: u16,
}

impl SampleBuffer {
    #[expect(clippy::large_stack_arrays, reason = "a constant, not on a stack")]
    pub const EMPTY: Self = Self { samples: [UNUSED_SAMPLE; SAMPLE_CAPACITY], fit_count: 0, held_back_count: 0 };

    /// All samples; empty if the numbers exceed the capacity, as at power-on.
    pub fn all_samples(&self) -> &[Sample] {
        let sample_count = usize::from(self.fit_count) + usize::from(self.held_back_count);
        self.samples.get(..sample_count).unwrap_or_default()
    }

    /// Samples of one use, ordered by part, then time.
    pub fn samples_of_use(&self, sample_use: SampleUse) -> &[Sample] {
        let (fit, held_back) = self.all_samples().split_at_checked(usize::from(self.fit_count)).unwrap_or_default();
        match sample_use {
            SampleUse::Fit => fit,
            SampleUse::Verification => held_back,
        }
    }

    /// Samples of one use and part, ordered by time.
    pub fn samples_of_part(&self, sample_use: SampleUse, part: CollectionPart) -> &[Sample] {
        samples_of_part(self.samples_of_use(sample_use), part)
    }

    /// Fit samples of a part, then the held-back ones.
    pub fn part_fit_then_held_back(&self, part: CollectionPart) -> Samples<'_> {
        CollectionPart::ALL_PARTS
            .into_iter()
            .filter(|other_part| *other_part != part)
            .fold(Samples::new(self.all_samples()), Samples::without_part)
    }

    pub fn clear(&mut self) {
        (self.fit_count, self.held_back_count) = (0, 0);
    }

    /// Stores a sample as the latest of its part; drops it if the buffer is full.
    pub fn insert_sample(&mut self, sample_use: SampleUse, sample: Sample) {
        let [_, end] = self.index_range(sample_use, sample.part);
        let sample_count = self.all_samples().len();
        if let Some(shifted @ [_, ..]) = self.samples.get_mut(end..=sample_count) {
            shifted.copy_within(..shifted.len() - 1, 1);
            shifted[0] = sample;
            *self.count_mut(sample_use) += 1;
        }
    }

    /// Removes the sample at a position of its part.
    pub fn remove_sample(&mut self, sample_use: SampleUse, part: CollectionPart, position: usize) {
        let [start, end] = self.index_range(sample_use, part);
        let sample_count = self.all_samples().len();
        if start + position < end
            && let Some(shifted) = self.samples.get_mut(start + position..sample_count)
        {
            shifted.copy_within(1.., 0);
            *self.count_mut(sample_use) -= 1;
        }
    }

    /// Stores a sample at `end` of its part, exclusive, in place of the one at an earlier position.
    pub fn replace_sample(&mut self, sample_use: SampleUse, position: usize, end: usize, sample: Sample) {
        let [start, _] = self.index_range(sample_use, sample.part);
        if let Some(shifted @ [_, ..]) = self.samples.get_mut(start + position..start + end) {
            shifted.copy_within(1.., 0);
            shifted[shifted.len() - 1] = sample;
        }
    }

    /// First and last position (exclusive) of a part.
    fn index_range(&self, sample_use: SampleUse, part: CollectionPart) -> [usize; 2] {
        let start = match sample_use {
            SampleUse::Fit => 0,
            SampleUse::Verification => usize::from(self.fit_count),
        };
        part_range(self.samples_of_use(sample_use), part).map(|position| start + position)
    }

    fn count_mut(&mut self, sample_use: SampleUse) -> &mut u16 {
        match sample_use {
            SampleUse::Fit => &mut self.fit_count,
            SampleUse::Verification => &mut self.held_back_count,
        }
    }
}

#[cfg(test)]
mod tests;
