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
mod tests {
    use super::super::test_samples::{collected, stored_count, test_sample};
    use super::*;
    use crate::calibration::CollectionPart;
    use crate::calibration::method_selection::Procedure;
    use crate::collection::Collector;

    /// A tumble with this number of samples on a line, `step_ut` apart.
    fn tumble_on_line(number: u32, step_ut: f32) -> Collector<'static> {
        collected(Procedure::Tumble, (0..number).map(|i| test_sample([i as f32 * step_ut, 0.0, 0.0], i * 400)))
    }

    fn fit_positions_ut(collector: &Collector<'_>) -> Vec<f32> {
        collector.fit_samples().samples_of_part(CollectionPart::FREE).iter().map(|sample| sample.field.ut.x).collect()
    }

    /// Samples a thirtieth of a circle apart are distinct, also in a weak field of 5 uT.
    #[test]
    fn samples_of_a_tumble_are_distinct() {
        for (step_ut, expected) in [(6.0, 20), (5.0, 20), (4.0, 10), (0.0, 1)] {
            assert_eq!(stored_count(&tumble_on_line(20, step_ut), CollectionPart::FREE), expected, "{step_ut} uT");
        }
    }

    /// A full tumble doubles no region: every other sample is dropped, those of either end stay, and later ones must be
    /// as far apart.
    #[test]
    fn a_full_tumble_is_thinned_evenly() {
        let capacity = SampleQuota::TURN.fit_quota + SampleQuota::TURN.held_back_quota;
        assert_eq!(stored_count(&tumble_on_line(capacity as u32, 5.1), CollectionPart::FREE), capacity);
        let mut collector = tumble_on_line(capacity as u32 + 1, 5.1);
        let positions_ut = fit_positions_ut(&collector);
        let last_ut = capacity as f32 * 5.1;
        assert!(positions_ut[0] == 0.0 && positions_ut.last() == Some(&last_ut), "{positions_ut:?}");
        // A held-back sample can lie between two others.
        assert!(positions_ut.windows(2).all(|pair| (6.5..=15.4).contains(&(pair[1] - pair[0]))), "{positions_ut:?}");
        for (distance_ut, is_stored) in [(6.0, false), (7.0, true)] {
            collector.push_sample(test_sample([last_ut + distance_ut, 0.0, 0.0], 1_000_000));
            assert_eq!(fit_positions_ut(&collector).len(), positions_ut.len() + usize::from(is_stored));
        }
    }

    #[test]
    fn a_full_tumble_of_distant_samples_keeps_the_first_ones() {
        let capacity = SampleQuota::TURN.fit_quota + SampleQuota::TURN.held_back_quota;
        let positions_ut = fit_positions_ut(&tumble_on_line(capacity as u32 + 10, 1000.0));
        assert_eq!(positions_ut.len(), SampleQuota::TURN.fit_quota);
        assert!(positions_ut.iter().all(|x_ut| *x_ut < capacity as f32 * 1000.0));
    }

    /// Three of four samples are for the fit.
    #[test]
    fn a_tumble_is_complete_at_66_fit_samples() {
        for (number, percent) in [(44, 50), (84, 95), (88, 100), (200, 100)] {
            let progress = tumble_on_line(number, 6.0).collection_progress();
            let coverage = progress.coverage_of(CollectionPart::FREE);
            assert_eq!((coverage.percent, coverage.covered_sector_count), (percent, 0), "{number}");
        }
    }
}
