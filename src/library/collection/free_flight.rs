//! Policy of free flight: a full buffer replaces the least informative sample.

use super::d_optimal_selection::DOptimalSelection;
use super::part_view::PartView;
use super::quota::{SampleQuota, SampleUse};
use crate::calibration::Sample;
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
    let level_quota = SampleQuota::LEVEL.quota_of(sample_use);
    let weakest = match sample_use {
        SampleUse::Fit if !selection.may_exceed_weakest(new_sample) => None,
        SampleUse::Fit => selection.find_least_informative_sample(new_sample, samples, level_quota),
        SampleUse::Verification => {
            selection.with_reset_leverages().find_least_informative_sample(new_sample, samples, level_quota)
        }
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
mod tests {
    use super::super::test_samples::{TestBuffer, test_sample, turn_samples};
    use super::*;
    use crate::calibration::CollectionPart;
    use crate::collection::progress::PartCoverage;

    /// Buffer and selection of a free flight.
    struct FreeFlight {
        buffer: TestBuffer,
        selection: DOptimalSelection,
    }

    impl FreeFlight {
        fn new() -> Self {
            Self { buffer: TestBuffer::new(), selection: DOptimalSelection::NO_SELECTION }
        }

        fn collect_samples(samples: impl Iterator<Item = Sample>) -> Self {
            let mut flight = Self::new();
            samples.for_each(|sample| {
                flight.push_sample(sample);
            });
            flight
        }

        fn push_sample(&mut self, sample: Sample) -> OfferedSampleResult {
            push_sample(self.buffer.part_view(CollectionPart::FREE), &mut self.selection, sample)
        }

        fn fit_times_ms(&self) -> Vec<u32> {
            times_ms(self.buffer.fit_samples(CollectionPart::FREE))
        }

        fn held_back_times_ms(&self) -> Vec<u32> {
            times_ms(self.buffer.held_back_samples(CollectionPart::FREE))
        }

        fn coverage(&mut self) -> PartCoverage {
            self.buffer.coverage(CollectionPart::FREE)
        }
    }

    fn times_ms(samples: &[Sample]) -> Vec<u32> {
        samples.iter().map(|sample| sample.time.as_ms()).collect()
    }

    /// Right turn, level, left turn, 20 s each, with bank wander; consecutive samples differ.
    fn free_flight(seconds: u16) -> impl Iterator<Item = Sample> {
        let leg = |from_s: u16| [25.0, 0.0, -25.0][usize::from(from_s / 20 % 3)];
        (0..seconds).step_by(20).flat_map(move |from_s| turn_samples(leg(from_s), from_s, from_s + 20, 60.0))
    }

    #[test]
    fn free_flight_samples_are_stored_until_full() {
        let mut flight = FreeFlight::collect_samples(free_flight(40));
        let (fit, held_back) = (flight.fit_times_ms(), flight.held_back_times_ms());
        assert_eq!((fit.len(), held_back.len()), (300, 100));
        assert_eq!(held_back[..3], [300, 700, 1100]);
        let mut all = [fit.clone(), held_back].concat();
        all.sort_unstable();
        assert_eq!(all, (0..400).map(|i| i * 100).collect::<Vec<_>>());
        assert!(fit.is_sorted());
        assert_eq!(flight.coverage(), PartCoverage { fit_count: 300, held_back_count: 100, ..PartCoverage::default() });
        assert!(
            flight.buffer.fit_samples(CollectionPart::LEFT).is_empty()
                && flight.buffer.held_back_samples(CollectionPart::LEVEL).is_empty()
        );
    }

    /// Five minutes of level flight, then a turn each way.
    #[test]
    fn informative_samples_replace_uninformative_ones() {
        let level = |minutes: u16| turn_samples(0.0, 0, 60 * minutes, 60.0);
        let mut flight = FreeFlight::collect_samples(level(5));
        let turns = turn_samples(25.0, 300, 320, 60.0).chain(turn_samples(-25.0, 320, 340, 60.0));
        let stored = turns.filter(|sample| flight.push_sample(*sample) == OfferedSampleResult::Stored).count();
        let mut banked_sum = 0;
        for sample_use in [SampleUse::Fit, SampleUse::Verification] {
            let (samples, capacity) = (
                flight.buffer.samples.samples_of_part(sample_use, CollectionPart::FREE),
                SampleQuota::WHOLE_BUFFER.quota_of(sample_use),
            );
            let banked = samples.iter().filter(|s| s.attitude.roll_rad.abs() > 0.3).count();
            banked_sum += banked;
            assert_eq!(samples.len(), capacity);
            // Of 400 banked samples, one in four is held back.
            let samples_offered = if sample_use == SampleUse::Fit { 300 } else { 100 };
            assert!(banked * 10 >= samples_offered * 8 || banked * 10 >= capacity * 7, "{banked} of {samples_offered}");
            let ends = section_ends(sample_use, samples.len());
            for [start, end] in [[0, ends[0]], [ends[0], ends[1]], [ends[1], ends[2]]] {
                assert!(times_ms(&samples[start..end]).is_sorted());
            }
        }
        assert!(stored >= banked_sum && stored <= 400, "{stored}, {banked_sum}");
    }

    /// A minute of level flight before or after four minutes of circles: level samples tell iron in turns from hard
    /// iron.
    #[test]
    fn circles_leave_a_quota_of_level_samples() {
        let circles = |start_s: u16| {
            (start_s..start_s + 240).step_by(60).flat_map(|from_s| {
                turn_samples(25.0, from_s, from_s + 30, 60.0).chain(turn_samples(-25.0, from_s + 30, from_s + 60, 60.0))
            })
        };
        for samples in [
            turn_samples(0.0, 0, 60, 60.0).chain(circles(60)).collect::<Vec<_>>(),
            circles(0).chain(turn_samples(0.0, 240, 300, 60.0)).collect(),
        ] {
            let flight = FreeFlight::collect_samples(samples.into_iter());
            for sample_use in [SampleUse::Fit, SampleUse::Verification] {
                let samples = flight.buffer.samples.samples_of_part(sample_use, CollectionPart::FREE);
                let level_count = samples.iter().filter(|sample| sample.attitude.roll_rad.abs() < 0.1).count();
                assert!(level_count >= SampleQuota::LEVEL.quota_of(sample_use), "{level_count} of {}", samples.len());
            }
        }
    }

    #[test]
    fn uninformative_samples_are_rejected() {
        let mut flight = FreeFlight::collect_samples(free_flight(400));
        let before = flight.fit_times_ms();
        let ends: Vec<_> = turn_samples(0.0, 500, 510, 60.0).map(|sample| flight.push_sample(sample)).collect();
        let new = flight.fit_times_ms().iter().filter(|time| !before.contains(time)).count();
        assert!(new <= 8, "{new} of 75");
        assert!(ends.iter().filter(|end| **end == OfferedSampleResult::Rejected).count() >= 67, "{ends:?}");
    }

    #[test]
    fn identical_samples_are_stored_once() {
        let mut flight = FreeFlight::new();
        let mut is_stored = |x_ut: f32, roll_deg: f32, pitch_deg: f32| {
            let attitude = Attitude::from_deg(roll_deg, pitch_deg);
            let before = flight.coverage();
            let end = flight.push_sample(Sample { attitude, ..test_sample([x_ut, 5.0, 40.0], 100) });
            let expected =
                if flight.coverage() == before { OfferedSampleResult::Ignored } else { OfferedSampleResult::Stored };
            assert_eq!(end, expected);
            end == OfferedSampleResult::Stored
        };
        assert!(is_stored(20.0, 0.0, 0.0));
        for _ in 0..100 {
            assert!(!is_stored(20.0, 0.0, 0.0) && !is_stored(20.9, 0.0, 0.0) && !is_stored(20.0, 1.0, -1.0));
        }
        assert!(is_stored(21.1, 0.0, 0.0));
        assert!(is_stored(21.1, -1.6, 0.0) && !is_stored(21.1, -1.6, 0.0));
        assert!(is_stored(21.1, -1.6, 1.6));
        assert!(
            !is_stored(f32::NAN, 0.0, 0.0) && !is_stored(90.0, f32::NAN, 0.0) && !is_stored(90.0, 0.0, f32::INFINITY)
        );
    }
}
