//! Merges the samples of a flight's parts in time order.

use super::samples::{CollectionPart, Sample, Samples};

/// Number of parts of a collection.
pub(in crate::calibration) const PART_COUNT: usize = CollectionPart::ALL_PARTS.len();

/// Runs of samples in order of time: free flight has up to three.
const MAX_ORDERED_RUNS: usize = PART_COUNT + 2;

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
    use crate::frames::{Attitude, Field};
    use crate::time::WrappingMillis;

    fn samples_at_ms(millis: &[u32]) -> Vec<Sample> {
        let sample = |&millis: &u32| Sample {
            time: WrappingMillis::new(millis),
            ..Sample::new(Field::from_ut(0.0, 0.0, 0.0), Attitude::default())
        };
        millis.iter().map(sample).collect()
    }

    fn merged_order(left: &[u32], right: &[u32], level: &[u32]) -> Vec<(usize, u32)> {
        let [left, right, level] = [left, right, level].map(samples_at_ms);
        let samples = Parts { left: &left, right: &right, level: &level, ..Parts::default() }.samples();
        TimeOrdered::new(samples).map(|(part, sample)| (part, sample.time.as_ms())).collect()
    }

    #[test]
    fn parts_are_merged_by_time() {
        assert_eq!(merged_order(&[5, 9], &[1, 7, 8], &[6]), [(1, 1), (0, 5), (2, 6), (1, 7), (1, 8), (0, 9)]);
        assert_eq!(merged_order(&[], &[1, 2], &[]), [(1, 1), (1, 2)]);
        assert_eq!(merged_order(&[], &[], &[]), []);
    }

    #[test]
    fn runs_of_free_flight_are_merged() {
        let [level, free] = [&[4][..], &[2, 9, 3, 7, 1]].map(samples_at_ms);
        let samples = Parts { level: &level, free: &free, ..Parts::default() }.samples();
        let order: Vec<_> = TimeOrdered::new(samples).map(|(part, sample)| (part, sample.time.as_ms())).collect();
        assert_eq!(order, [(3, 1), (3, 2), (3, 3), (2, 4), (3, 7), (3, 9)]);
    }

    #[test]
    fn simultaneous_samples_keep_the_part_order() {
        assert_eq!(merged_order(&[1, 2], &[1, 2], &[1]), [(0, 1), (1, 1), (2, 1), (0, 2), (1, 2)]);
    }

    #[test]
    fn order_survives_clock_wrap() {
        assert_eq!(merged_order(&[5], &[u32::MAX - 5], &[]), [(1, u32::MAX - 5), (0, 5)]);
        assert_eq!(merged_order(&[u32::MAX - 5], &[5], &[]), [(0, u32::MAX - 5), (1, 5)]);
    }
}
