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
    use super::super::test_samples::{TestBuffer, test_sample};
    use super::*;
    use crate::calibration::CollectionPart;
    use crate::collection::progress::PartCoverage;

    /// Buffer and minimum distance of a tumble.
    struct Tumble {
        buffer: TestBuffer,
        quota: SampleQuota,
        min_distance_ut: f32,
    }

    impl Tumble {
        fn new(quota: SampleQuota) -> Self {
            Self { buffer: TestBuffer::new(), quota, min_distance_ut: INITIAL_MIN_DISTANCE_UT }
        }

        /// Collects a number of points on a line, `step_ut` apart.
        fn collect_on_line(number: u32, step_ut: f32) -> Self {
            let mut tumble = Self::new(SampleQuota::TURN);
            (0..number).for_each(|i| tumble.push_at(i as f32 * step_ut, i * 400));
            tumble
        }

        fn push_at(&mut self, x_ut: f32, time_ms: u32) {
            push_sample(
                self.buffer.part_view(CollectionPart::FREE),
                self.quota,
                &mut self.min_distance_ut,
                test_sample([x_ut, 0.0, 0.0], time_ms),
            );
        }

        fn fit_samples(&self) -> &[Sample] {
            self.buffer.fit_samples(CollectionPart::FREE)
        }

        fn stored_count(&self) -> usize {
            self.buffer.stored_count(CollectionPart::FREE)
        }

        fn coverage(&mut self) -> PartCoverage {
            self.buffer.coverage(CollectionPart::FREE)
        }
    }

    #[test]
    fn tumbled_samples_are_at_least_5_ut_apart() {
        assert_eq!(Tumble::collect_on_line(20, 5.1).stored_count(), 20);
        assert_eq!(Tumble::collect_on_line(20, 5.0).stored_count(), 20, "at the very distance");
        assert_eq!(Tumble::collect_on_line(20, 4.9).stored_count(), 10, "every other one");
        let five = Tumble::collect_on_line(5, 5.1);
        assert_eq!(
            (five.stored_count(), five.buffer.held_back_samples(CollectionPart::FREE).len()),
            (5, 1),
            "every fourth is held back"
        );
    }

    #[test]
    fn tumbled_samples_are_stored_at_most_every_0_4_s() {
        for (spacing_ms, expected) in [(400, 20), (399, 10)] {
            let mut tumble = Tumble::new(SampleQuota::TURN);
            (0..20).for_each(|i| tumble.push_at(i as f32 * 10.0, i * spacing_ms));
            assert_eq!(tumble.stored_count(), expected);
        }
    }

    /// The 253rd sample exceeds the quota: the distance grows from 5 to 6.5 uT and thins steps of 5.1 uT.
    #[test]
    fn a_full_tumble_is_thinned() {
        let both = SampleQuota::TURN.fit_quota + SampleQuota::TURN.held_back_quota;
        assert_eq!(Tumble::collect_on_line(both as u32, 5.1).stored_count(), both);
        let mut tumble = Tumble::collect_on_line(both as u32 + 1, 5.1);
        assert_eq!(tumble.stored_count(), SampleQuota::TURN.held_back_quota + expected_fit_count_after_thinning() + 1);
        assert!((tumble.min_distance_ut - 6.5).abs() < 1e-4, "{}", tumble.min_distance_ut);
        let coverage = tumble.coverage();
        assert_eq!(
            (coverage.fit_count as usize, coverage.held_back_count as usize),
            (expected_fit_count_after_thinning() + 1, SampleQuota::TURN.held_back_quota)
        );
        // After thinning, samples nearer than 6.5 uT are not stored.
        let stored_count = tumble.fit_samples().len();
        let last_ut = tumble.fit_samples().last().unwrap().field.ut.x;
        tumble.push_at(last_ut + 6.4, 1_000_000);
        assert_eq!(tumble.fit_samples().len(), stored_count);
        tumble.push_at(last_ut + 6.6, 1_000_000);
        assert_eq!(tumble.fit_samples().len(), stored_count + 1);
    }

    fn expected_fit_count_after_thinning() -> usize {
        let SampleQuota { fit_quota: fit, held_back_quota: held_back } = SampleQuota::TURN;
        let is_held_back = |i: usize| i % 4 == 3 && i / 4 < held_back;
        let fit = (0..fit + held_back).filter(|i| !is_held_back(*i)).map(|i| i as f64 * 5.1);
        fit.fold(
            (0, f64::NEG_INFINITY),
            |(count, last), x| if x - last >= 6.5 { (count + 1, x) } else { (count, last) },
        )
        .0
    }

    #[test]
    fn a_tumble_is_complete_at_66_fit_samples() {
        for (number, percent) in [(44, 50), (86, 98), (87, 100), (200, 100)] {
            // Three of four samples are for the fit: 33 of 44, 65 of 86, 66 of 87, 150 of 200.
            let coverage = Tumble::collect_on_line(number, 6.0).coverage();
            assert_eq!((coverage.percent, coverage.covered_sector_count), (percent, 0), "{number}");
        }
    }

    #[test]
    fn thinning_keeps_the_first_of_close_samples() {
        let mut tumble = Tumble::new(SampleQuota::TURN);
        for x_ut in [0.0, 1.0, 2.0, 3.0, 2.5, 10.0] {
            tumble
                .buffer
                .part_view(CollectionPart::FREE)
                .insert_sample(SampleUse::Fit, test_sample([x_ut, 0.0, 0.0], 0));
        }
        remove_close_samples(&mut tumble.buffer.part_view(CollectionPart::FREE), 2.0);
        assert_eq!(tumble.fit_samples().iter().map(|sample| sample.field.ut.x).collect::<Vec<_>>(), [0.0, 2.0, 10.0]);
    }

    #[test]
    fn a_full_held_back_quota_passes_samples_to_the_fit() {
        let mut tumble = Tumble::new(SampleQuota { fit_quota: 12, held_back_quota: 1 });
        (0..8).for_each(|i| tumble.push_at(i as f32 * 10.0, i * 400));
        let coverage = tumble.coverage();
        assert_eq!((coverage.fit_count, coverage.held_back_count), (7, 1));
    }

    #[test]
    fn a_part_of_distant_samples_stays_as_it_is() {
        let mut tumble = Tumble::new(SampleQuota { fit_quota: 3, held_back_quota: 1 });
        (0..12).for_each(|i| tumble.push_at(i as f32 * 1000.0, i * 400));
        assert_eq!(tumble.fit_samples().iter().map(|sample| sample.time.as_ms() / 400).collect::<Vec<_>>(), [0, 1, 2]);
    }

    #[test]
    fn nonfinite_samples_are_rejected() {
        let mut tumble = Tumble::new(SampleQuota::TURN);
        for (i, broken) in (0..).zip([f32::NAN, f32::INFINITY, f32::NEG_INFINITY]) {
            tumble.push_at(broken, i * 400);
        }
        assert_eq!(tumble.stored_count(), 0);
    }
}
