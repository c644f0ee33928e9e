//! The one buffer of a collection, in retained memory, and its quota of level samples.
//!
//! The fit samples are first, then the held-back ones, both in order of time. Each sample has the part of the flight to
//! which it belongs.

use crate::calibration::{CollectionPart, Sample, Samples};
use crate::frames::{Field, RollPitch};

/// Use of a stored sample.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum SampleUse {
    /// The sample is used to fit the coefficients.
    Fit,
    /// The sample is held back, to compare a solution with the active calibration.
    Verification,
}

/// Numbers of samples.
#[derive(Clone, Copy, Debug)]
pub(super) struct SampleNumbers {
    pub fit_samples: usize,
    pub held_back_samples: usize,
}

/// Level samples that are retained whatever their information.
pub(super) const LEVEL_QUOTA: SampleNumbers = SampleNumbers { fit_samples: 64, held_back_samples: 20 };

/// Capacity of the buffer: 21 KB.
pub(super) const WHOLE_BUFFER: SampleNumbers = SampleNumbers { fit_samples: 448, held_back_samples: 140 };

impl SampleNumbers {
    pub const fn of_use(self, sample_use: SampleUse) -> usize {
        match sample_use {
            SampleUse::Fit => self.fit_samples,
            SampleUse::Verification => self.held_back_samples,
        }
    }
}

const SAMPLE_CAPACITY: usize = WHOLE_BUFFER.fit_samples + WHOLE_BUFFER.held_back_samples;

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

    /// Samples of one use, in order of time.
    pub fn samples_of_use(&self, sample_use: SampleUse) -> &[Sample] {
        let (fit, held_back) = self.all_samples().split_at_checked(usize::from(self.fit_count)).unwrap_or_default();
        match sample_use {
            SampleUse::Fit => fit,
            SampleUse::Verification => held_back,
        }
    }

    /// Number of samples of one use and part.
    pub fn part_count(&self, sample_use: SampleUse, part: CollectionPart) -> usize {
        Samples::new(self.samples_of_use(sample_use)).samples_of_part(part).iter().count()
    }

    pub fn clear(&mut self) {
        (self.fit_count, self.held_back_count) = (0, 0);
    }

    /// Stores the latest sample; drops it if the buffer is full.
    pub fn insert_sample(&mut self, sample_use: SampleUse, sample: Sample) {
        let sample_count = self.all_samples().len();
        let (end, number) = match sample_use {
            SampleUse::Fit => (usize::from(self.fit_count), &mut self.fit_count),
            SampleUse::Verification => (sample_count, &mut self.held_back_count),
        };
        if let Some(shifted @ [_, ..]) = self.samples.get_mut(end..=sample_count) {
            shifted.copy_within(..shifted.len() - 1, 1);
            shifted[0] = sample;
            *number += 1;
        }
    }

    /// Stores the latest sample in place of the one at a position of its use.
    pub fn replace_sample(&mut self, sample_use: SampleUse, position: usize, sample: Sample) {
        let [start, end] = match sample_use {
            SampleUse::Fit => [0, self.fit_count.into()],
            SampleUse::Verification => [self.fit_count.into(), self.all_samples().len()],
        };
        if let Some(shifted @ [_, ..]) = self.samples.get_mut(start + position..end) {
            shifted.copy_within(1.., 0);
            shifted[shifted.len() - 1] = sample;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::test_samples::{test_sample, times_ms};
    use super::*;

    const BOTH_USES: [SampleUse; 2] = [SampleUse::Fit, SampleUse::Verification];

    fn insert_test_sample(buffer: &mut SampleBuffer, sample_use: SampleUse, part: CollectionPart, time_ms: u32) {
        buffer.insert_sample(sample_use, Sample { part, ..test_sample([1.0; 3], time_ms) });
    }

    /// Times of the fit samples, then of those held back.
    fn stored_times_ms(buffer: &SampleBuffer) -> [Vec<u32>; 2] {
        BOTH_USES.map(|sample_use| times_ms(buffer.samples_of_use(sample_use)))
    }

    /// Fit and held-back samples of two parts, stored in turn.
    fn filled_buffer() -> SampleBuffer {
        let mut buffer = SampleBuffer::EMPTY;
        for (time_ms, sample_use) in (0..6).zip(BOTH_USES.into_iter().cycle()) {
            let part = if time_ms < 4 { CollectionPart::LEFT } else { CollectionPart::LEVEL };
            insert_test_sample(&mut buffer, sample_use, part, time_ms);
        }
        buffer
    }

    #[test]
    fn samples_are_ordered_by_use_and_time() {
        let mut buffer = filled_buffer();
        assert_eq!(stored_times_ms(&buffer), [[0, 2, 4], [1, 3, 5]]);
        assert_eq!(times_ms(buffer.all_samples()), [0, 2, 4, 1, 3, 5]);
        let counts = [CollectionPart::LEFT, CollectionPart::LEVEL, CollectionPart::FREE]
            .map(|part| BOTH_USES.map(|sample_use| buffer.part_count(sample_use, part)));
        assert_eq!(counts, [[2, 2], [1, 1], [0, 0]]);
        for (sample_use, position, time_ms, expected) in [
            (SampleUse::Fit, 1, 6, [[0, 4, 6], [1, 3, 5]]),
            (SampleUse::Verification, 0, 7, [[0, 4, 6], [3, 5, 7]]),
            (SampleUse::Fit, 2, 8, [[0, 4, 8], [3, 5, 7]]),
            (SampleUse::Fit, 3, 9, [[0, 4, 8], [3, 5, 7]]),
        ] {
            buffer.replace_sample(sample_use, position, test_sample([2.0; 3], time_ms));
            assert_eq!(stored_times_ms(&buffer), expected, "{time_ms}");
        }
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
            buffer.replace_sample(SampleUse::Verification, 0, test_sample([0.0; 3], 2));
            buffer.clear();
            insert_test_sample(&mut buffer, SampleUse::Fit, CollectionPart::FREE, 3);
            assert_eq!(times_ms(buffer.all_samples()), [3]);
        }
    }
}
