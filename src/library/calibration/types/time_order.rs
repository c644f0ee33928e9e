//! Merges the samples of a flight's parts in time order.

use super::samples::{CollectionPart, Sample, Samples};
use crate::time::WrappingMillis;

/// Number of parts of a collection.
pub(in crate::calibration) const PART_COUNT: usize = CollectionPart::ALL_PARTS.len();

/// Runs of samples in order of time: free flight has up to three.
const MAX_ORDERED_RUNS: usize = PART_COUNT + 2;

/// Time from the first to the last sample of a flight.
#[derive(Clone, Copy, Debug)]
pub(in crate::calibration) struct TimeSpan {
    pub start: WrappingMillis,
    /// Positive.
    pub duration_ms: u32,
}

impl TimeSpan {
    /// `None` if all samples have the same time.
    pub fn from_samples(samples: Samples<'_>) -> Option<Self> {
        let (_, first) = TimeOrdered::new(samples).next()?;
        let duration_ms = samples.iter().map(|sample| sample.time.ms_since(first.time)).max()?;
        (duration_ms > 0).then_some(Self { start: first.time, duration_ms })
    }

    /// Elapsed fraction of the time.
    pub fn elapsed_fraction(self, time: WrappingMillis) -> f32 {
        time.ms_since(self.start) as f32 / self.duration_ms as f32
    }
}

/// Iterator over samples in time order, each with the index of its part.
#[derive(Clone, Debug)]
pub(in crate::calibration) struct TimeOrdered<'a> {
    remaining: [&'a [Sample]; MAX_ORDERED_RUNS],
}

impl<'a> TimeOrdered<'a> {
    /// Merges all parts except samples with given headings, whose times are unrelated.
    pub fn new(samples: Samples<'a>) -> Self {
        let is_in_order = |before: &Sample, after: &Sample| after.time.signed_ms_since(before.time) >= 0;
        let mut runs =
            CollectionPart::ALL_PARTS.into_iter().flat_map(|part| samples.samples_of_part(part).chunk_by(is_in_order));
        Self { remaining: core::array::from_fn(|_| runs.next().unwrap_or_default()) }
    }
}

impl<'a> Iterator for TimeOrdered<'a> {
    type Item = (usize, &'a Sample);

    fn next(&mut self) -> Option<Self::Item> {
        let mut earliest: Option<Self::Item> = None;
        for (run, samples) in self.remaining.iter().enumerate() {
            let Some(sample) = samples.first() else { continue };
            // At equal times the earlier part comes first.
            if earliest.is_none_or(|(_, first)| sample.time.signed_ms_since(first.time) < 0) {
                earliest = Some((run, sample));
            }
        }
        let (run, sample) = earliest?;
        if let Some(samples) = self.remaining.get_mut(run) {
            *samples = samples.get(1..).unwrap_or_default();
        }
        Some((sample.part.index(), sample))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::calibration::tests::synthetic::Parts;
    use crate::frames::{Field, RollPitch};

    fn samples_at_ms(millis: &[u32]) -> Vec<Sample> {
        let sample = |&millis: &u32| Sample {
            time: WrappingMillis::new(millis),
            ..Sample::new(Field::from_ut(0.0, 0.0, 0.0), RollPitch::default())
        };
        millis.iter().map(sample).collect()
    }

    /// Order of samples of left turns, right turns, level and free flight at these times, as parts and times.
    fn merged_order(times: [&[u32]; 4]) -> Vec<(usize, u32)> {
        let [left, right, level, free] = &times.map(samples_at_ms);
        let samples = Parts { left, right, level, free, ..Parts::default() }.samples();
        TimeOrdered::new(samples).map(|(part, sample)| (part, sample.time.as_ms())).collect()
    }

    #[test]
    fn parts_are_merged_by_time() {
        const LATE: u32 = u32::MAX - 5;
        for (name, times, expected) in [
            (
                "three parts",
                [&[5, 9][..], &[1, 7, 8], &[6], &[]],
                &[(1, 1), (0, 5), (2, 6), (1, 7), (1, 8), (0, 9)][..],
            ),
            ("one part", [&[], &[1, 2], &[], &[]], &[(1, 1), (1, 2)]),
            ("nothing", [&[]; 4], &[]),
            (
                "runs of free flight",
                [&[], &[], &[4], &[2, 9, 3, 7, 1]],
                &[(3, 1), (3, 2), (3, 3), (2, 4), (3, 7), (3, 9)],
            ),
            ("equal times", [&[1, 2], &[1, 2], &[1], &[]], &[(0, 1), (1, 1), (2, 1), (0, 2), (1, 2)]),
            ("a wrap of the clock", [&[5], &[LATE], &[], &[]], &[(1, LATE), (0, 5)]),
            ("a wrap in the other part", [&[LATE], &[5], &[], &[]], &[(0, LATE), (1, 5)]),
        ] {
            assert_eq!(merged_order(times), expected, "{name}");
        }
    }
}
