//! The one buffer of a collection, in retained memory.
//!
//! Samples are ordered by use, part, and time: the fit samples are contiguous, so are the held-back ones, and each part
//! within them. A new sample is the latest of its part; storing it moves all samples behind that part.
//! A full free flight is in order of time within three sections only, in which its policy replaces samples.

use super::quota::{SampleQuota, SampleUse};
use crate::calibration::{CollectionPart, Sample, Samples, part_range, samples_of_part};
use crate::frames::{Field, RollPitch};

const SAMPLE_CAPACITY: usize = SampleQuota::WHOLE_BUFFER.fit_quota + SampleQuota::WHOLE_BUFFER.held_back_quota;

pub(super) const UNUSED_SAMPLE: Sample = Sample {
    part: CollectionPart::LEFT,
    ..Sample::new(Field::from_ut(0.0, 0.0, 0.0), RollPitch { roll_rad: 0.0, pitch_rad: 0.0 })
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
mod tests {
    use super::super::test_samples::{test_sample, times_ms};
    use super::*;

    const PARTS: [CollectionPart; 3] = [CollectionPart::LEFT, CollectionPart::LEVEL, CollectionPart::FREE];

    const BOTH_USES: [SampleUse; 2] = [SampleUse::Fit, SampleUse::Verification];

    fn insert_test_sample(buffer: &mut SampleBuffer, sample_use: SampleUse, part: CollectionPart, time_ms: u32) {
        buffer.insert_sample(sample_use, Sample { part, ..test_sample([1.0; 3], time_ms) });
    }

    /// Times of the fit samples, then of those held back.
    fn stored_times_ms(buffer: &SampleBuffer) -> [Vec<u32>; 2] {
        BOTH_USES.map(|sample_use| times_ms(buffer.samples_of_use(sample_use)))
    }

    /// Fit and held-back samples of three parts, stored in turn.
    fn filled_buffer() -> SampleBuffer {
        let mut buffer = SampleBuffer::EMPTY;
        for time_ms in (0..60).step_by(10) {
            for (i, part) in PARTS.into_iter().enumerate() {
                let sample_use = if time_ms % 20 == 0 { SampleUse::Fit } else { SampleUse::Verification };
                insert_test_sample(&mut buffer, sample_use, part, time_ms + i as u32);
            }
        }
        buffer
    }

    #[test]
    fn samples_are_ordered_by_use_part_and_time() {
        let buffer = filled_buffer();
        let expected = [[0, 20, 40, 1, 21, 41, 2, 22, 42], [10, 30, 50, 11, 31, 51, 12, 32, 52]];
        assert_eq!(stored_times_ms(&buffer), expected);
        assert_eq!(times_ms(buffer.all_samples()), expected.concat());
        assert_eq!(times_ms(buffer.samples_of_part(SampleUse::Fit, CollectionPart::LEVEL)), [1, 21, 41]);
        assert_eq!(times_ms(buffer.samples_of_part(SampleUse::Verification, CollectionPart::FREE)), [12, 32, 52]);
        assert!(buffer.samples_of_part(SampleUse::Fit, CollectionPart::RIGHT).is_empty());
        for (i, part) in (0..).zip(PARTS) {
            let both: Vec<Sample> = buffer.part_fit_then_held_back(part).iter().copied().collect();
            assert_eq!(times_ms(&both), [0, 20, 40, 10, 30, 50].map(|time_ms| time_ms + i));
        }
    }

    #[test]
    fn removing_a_sample_leaves_the_others_in_order() {
        for (sample_use, part, position, removed) in [
            (SampleUse::Fit, CollectionPart::LEFT, 0, 0),
            (SampleUse::Fit, CollectionPart::FREE, 2, 42),
            (SampleUse::Verification, CollectionPart::LEFT, 1, 30),
            (SampleUse::Verification, CollectionPart::FREE, 2, 52),
        ] {
            let mut buffer = filled_buffer();
            buffer.remove_sample(sample_use, part, position);
            let without_removed =
                |times_ms: Vec<u32>| times_ms.into_iter().filter(|time_ms| *time_ms != removed).collect::<Vec<_>>();
            assert_eq!(stored_times_ms(&buffer), stored_times_ms(&filled_buffer()).map(without_removed), "{removed}");
        }
        let mut buffer = filled_buffer();
        buffer.remove_sample(SampleUse::Fit, CollectionPart::LEFT, 3);
        buffer.remove_sample(SampleUse::Fit, CollectionPart::RIGHT, 0);
        assert_eq!(buffer.all_samples(), filled_buffer().all_samples(), "there is none");
    }

    #[test]
    fn a_replacement_changes_its_part_only() {
        let mut buffer = filled_buffer();
        let new = |part, time_ms| Sample { part, ..test_sample([2.0; 3], time_ms) };
        buffer.replace_sample(SampleUse::Fit, 1, 3, new(CollectionPart::LEVEL, 99));
        assert_eq!(times_ms(buffer.samples_of_use(SampleUse::Fit)), [0, 20, 40, 1, 41, 99, 2, 22, 42]);
        buffer.replace_sample(SampleUse::Verification, 0, 3, new(CollectionPart::FREE, 98));
        assert_eq!(times_ms(buffer.samples_of_use(SampleUse::Verification)), [10, 30, 50, 11, 31, 51, 32, 52, 98]);
        let before = buffer.clone();
        buffer.replace_sample(SampleUse::Fit, 3, 3, new(CollectionPart::LEVEL, 97));
        assert_eq!(buffer.all_samples(), before.all_samples(), "there is none");
    }

    #[test]
    fn a_full_buffer_accepts_no_more() {
        let mut buffer = SampleBuffer::EMPTY;
        for time_ms in 0..SAMPLE_CAPACITY as u32 + 5 {
            insert_test_sample(&mut buffer, BOTH_USES[usize::from(time_ms % 4 == 3)], CollectionPart::FREE, time_ms);
        }
        assert_eq!(buffer.all_samples().len(), SAMPLE_CAPACITY);
        assert!(stored_times_ms(&buffer).iter().all(|times_ms| times_ms.is_sorted()));
        buffer.clear();
        assert!(buffer.all_samples().is_empty() && stored_times_ms(&buffer) == [[], []]);
    }

    /// Memory has arbitrary numbers at power-on.
    #[test]
    fn numbers_beyond_the_capacity_are_an_empty_buffer() {
        for (fit_count, held_back_count) in
            [(SAMPLE_CAPACITY as u16 + 1, 0), (1, SAMPLE_CAPACITY as u16), (u16::MAX, u16::MAX)]
        {
            let mut buffer = SampleBuffer { fit_count, held_back_count, ..filled_buffer() };
            assert_eq!(stored_times_ms(&buffer), [[], []]);
            buffer.remove_sample(SampleUse::Verification, CollectionPart::FREE, 0);
            buffer.replace_sample(SampleUse::Verification, 0, 1, test_sample([0.0; 3], 2));
            buffer.clear();
            insert_test_sample(&mut buffer, SampleUse::Fit, CollectionPart::FREE, 3);
            assert_eq!(times_ms(buffer.all_samples()), [3]);
        }
    }
}
