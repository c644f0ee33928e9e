//! Policy of free flight: a full buffer replaces the least informative sample.

use super::d_optimal_selection::DOptimalSelection;
use super::part_view::PartView;
use super::quota::{SampleQuota, SampleUse};
use crate::calibration::Sample;
use crate::frames::{RollPitch, wrap_pi};
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
    let RollPitch { roll_rad, pitch_rad } = sample.attitude;
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
    use super::super::test_samples::{collected, stored_times_ms, test_sample, times_ms, turn_samples};
    use super::*;
    use crate::calibration::method_selection::Procedure;
    use crate::calibration::{CollectionPart, Samples};
    use crate::collection::Collector;
    use crate::collection::progress::PartCoverage;

    fn collect_in_flight(samples: impl IntoIterator<Item = Sample>) -> Collector<'static> {
        collected(Procedure::Flight, samples)
    }

    fn stored_samples<'a>(collector: &'a Collector<'_>) -> [(SampleUse, Samples<'a>); 2] {
        [(SampleUse::Fit, collector.fit_samples()), (SampleUse::Verification, collector.held_back_samples())]
    }

    /// Right turn, level, left turn, 20 s each, with bank wander; consecutive samples differ.
    fn free_flight(seconds: u16) -> impl Iterator<Item = Sample> {
        let leg = |from_s: u16| [25.0, 0.0, -25.0][usize::from(from_s / 20 % 3)];
        (0..seconds).step_by(20).flat_map(move |from_s| turn_samples(leg(from_s), from_s, from_s + 20, 60.0))
    }

    #[test]
    fn free_flight_samples_are_stored_until_full() {
        let collector = collect_in_flight(free_flight(40));
        let [fit, held_back] = stored_times_ms(&collector, CollectionPart::FREE);
        let (expected_held_back, expected_fit) = (0..400).map(|i| i * 100).partition::<Vec<_>, _>(|ms| ms % 400 == 300);
        assert_eq!((fit, held_back), (expected_fit, expected_held_back));
        let coverage = PartCoverage { fit_count: 300, held_back_count: 100, ..PartCoverage::default() };
        assert_eq!(collector.collection_progress().coverage_of(CollectionPart::FREE), &coverage);
        assert_eq!((collector.distinct_sample_count(), collector.stored_count()), (400, 400));
    }

    /// Five minutes of level flight, then a turn each way.
    #[test]
    fn informative_samples_replace_uninformative_ones() {
        let mut collector = collect_in_flight(turn_samples(0.0, 0, 300, 60.0));
        let before = collector.stored_count();
        let turns = turn_samples(25.0, 300, 320, 60.0).chain(turn_samples(-25.0, 320, 340, 60.0));
        turns.for_each(|sample| collector.push_sample(sample));
        let newly_stored = usize::from(collector.stored_count() - before);
        let mut banked_sum = 0;
        // Of 400 banked samples, one in four is held back.
        for ((sample_use, samples), offered) in stored_samples(&collector).into_iter().zip([300, 100]) {
            let samples = samples.samples_of_part(CollectionPart::FREE);
            let capacity = SampleQuota::WHOLE_BUFFER.quota_of(sample_use);
            assert_eq!(samples.len(), capacity);
            let banked = samples.iter().filter(|sample| sample.attitude.roll_rad.abs() > 0.3).count();
            assert!(banked * 10 >= offered * 8 || banked * 10 >= capacity * 7, "{banked} of {offered}");
            banked_sum += banked;
            let ends = section_ends(sample_use, samples.len());
            for [start, end] in [[0, ends[0]], [ends[0], ends[1]], [ends[1], ends[2]]] {
                assert!(times_ms(&samples[start..end]).is_sorted());
            }
        }
        assert!(newly_stored >= banked_sum && newly_stored <= 400, "{newly_stored}, {banked_sum}");
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
        for collector in [
            collect_in_flight(turn_samples(0.0, 0, 60, 60.0).chain(circles(60))),
            collect_in_flight(circles(0).chain(turn_samples(0.0, 240, 300, 60.0))),
        ] {
            for (sample_use, samples) in stored_samples(&collector) {
                let level_count = samples.iter().filter(|sample| sample.attitude.roll_rad.abs() < 0.1).count();
                assert!(level_count >= SampleQuota::LEVEL.quota_of(sample_use), "{sample_use:?}: {level_count}");
            }
        }
    }

    /// 100 level samples, after minutes of the same flight.
    #[test]
    fn uninformative_samples_are_rejected() {
        let mut collector = collect_in_flight(free_flight(400));
        let rejected_count =
            |collector: &Collector| collector.distinct_sample_count() - u32::from(collector.stored_count());
        let before = rejected_count(&collector);
        turn_samples(0.0, 500, 510, 60.0).for_each(|sample| collector.push_sample(sample));
        assert!(rejected_count(&collector) - before >= 67, "{}", rejected_count(&collector) - before);
        let [fit, _] = stored_times_ms(&collector, CollectionPart::FREE);
        let new_fit_count = fit.iter().filter(|ms| **ms >= 500_000).count();
        assert!(new_fit_count <= 8, "{new_fit_count} of 75");
    }

    /// Three sigma of an averaged sample are 1 uT.
    #[test]
    fn identical_samples_are_stored_once() {
        let mut collector = collect_in_flight([]);
        let nan = f32::NAN;
        for (x_ut, roll_deg, pitch_deg, is_stored) in [
            (20.0, 0.0, 0.0, true),
            (20.0, 0.0, 0.0, false),
            (20.8, 0.0, 0.0, false),
            (20.0, 1.0, -1.0, false),
            (21.2, 0.0, 0.0, true),
            (21.2, -1.6, 0.0, true),
            (21.2, -1.6, 0.0, false),
            (21.2, -1.6, 1.6, true),
            (nan, 0.0, 0.0, false),
            (90.0, nan, 0.0, false),
            (90.0, 0.0, f32::INFINITY, false),
        ] {
            let before = (collector.stored_count(), collector.distinct_sample_count());
            let attitude = RollPitch::from_deg(roll_deg, pitch_deg);
            collector.push_sample(Sample { attitude, ..test_sample([x_ut, 5.0, 40.0], 100) });
            let expected = (before.0 + u16::from(is_stored), before.1 + u32::from(is_stored));
            let found = (collector.stored_count(), collector.distinct_sample_count());
            assert_eq!(found, expected, "{x_ut} uT {roll_deg} {pitch_deg}");
        }
    }
}
