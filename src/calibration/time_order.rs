//! The samples of a flight in the order in which they were taken, whatever the order of its parts.

use super::{Sample, Samples};

/// Left turns, right turns, level flight, any attitudes.
pub(super) const PARTS: usize = 4;

/// The part of samples of any attitude, however many pieces they come in.
const ANY: usize = 3;

/// Pieces that the parts come in.
const PIECES: usize = 6;

/// Samples in the order of time, each with the number of its part.
#[derive(Clone, Debug)]
pub(super) struct InTime<'a> {
    /// What is left of each part, itself in the order of time.
    left: [&'a [Sample]; PIECES],
}

impl<'a> InTime<'a> {
    /// Of the samples of turns and level flight. Marks, which have no order among these, are left out.
    pub fn new(samples: Samples<'a>) -> Self {
        let [first, second, third] = samples.any;
        Self { left: [samples.left, samples.right, samples.level, first, second, third] }
    }
}

impl<'a> Iterator for InTime<'a> {
    type Item = (usize, &'a Sample);

    fn next(&mut self) -> Option<Self::Item> {
        let mut earliest: Option<Self::Item> = None;
        for (piece, left) in self.left.iter().enumerate() {
            let Some(sample) = left.first() else { continue };
            // Of two that were taken at once, the one of the earlier part comes first.
            if earliest.is_none_or(|(_, before)| sample.time.difference(before.time) < 0) {
                earliest = Some((piece, sample));
            }
        }
        let (piece, sample) = earliest?;
        if let Some(left) = self.left.get_mut(piece) {
            *left = left.get(1..).unwrap_or_default();
        }
        Some((piece.min(ANY), sample))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::calibration::Rates;
    use crate::frames::{Attitude, Field};
    use crate::time::WrappingMillis;

    fn at(millis: &[u32]) -> Vec<Sample> {
        let sample = |&millis: &u32| Sample {
            field: Field::from_ut(0.0, 0.0, 0.0),
            attitude: Attitude::default(),
            time: WrappingMillis::new(millis),
            rates: Rates::NONE,
        };
        millis.iter().map(sample).collect()
    }

    fn order(left: &[u32], right: &[u32], level: &[u32]) -> Vec<(usize, u32)> {
        let [left, right, level] = [left, right, level].map(at);
        let samples = Samples { left: &left, right: &right, level: &level, ..Samples::default() };
        InTime::new(samples).map(|(part, sample)| (part, sample.time.count())).collect()
    }

    #[test]
    fn parts_are_merged_by_time() {
        assert_eq!(order(&[5, 9], &[1, 7, 8], &[6]), [(1, 1), (0, 5), (2, 6), (1, 7), (1, 8), (0, 9)]);
        assert_eq!(order(&[], &[1, 2], &[]), [(1, 1), (1, 2)]);
        assert_eq!(order(&[], &[], &[]), []);
    }

    /// However many pieces they come in, they are one part.
    #[test]
    fn samples_of_no_side_are_one_part() {
        let [level, first, second, third] = [&[4][..], &[2, 9], &[3, 7], &[1]].map(at);
        let samples = Samples { level: &level, any: [&first, &second, &third], ..Samples::default() };
        let order: Vec<_> = InTime::new(samples).map(|(part, sample)| (part, sample.time.count())).collect();
        assert_eq!(order, [(3, 1), (3, 2), (3, 3), (2, 4), (3, 7), (3, 9)]);
    }

    #[test]
    fn at_once_is_in_the_order_of_the_parts() {
        assert_eq!(order(&[1, 2], &[1, 2], &[1]), [(0, 1), (1, 1), (2, 1), (0, 2), (1, 2)]);
    }

    /// The clock wraps after 49 days.
    #[test]
    fn a_flight_goes_on_past_the_end_of_the_clock() {
        assert_eq!(order(&[5], &[u32::MAX - 5], &[]), [(1, u32::MAX - 5), (0, 5)]);
        assert_eq!(order(&[u32::MAX - 5], &[5], &[]), [(0, u32::MAX - 5), (1, 5)]);
    }
}
