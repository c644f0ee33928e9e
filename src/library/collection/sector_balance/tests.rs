use super::super::test_samples::{TestBuffer, circle_sample, test_sample, turn_samples};
use super::*;
use crate::calibration::{CollectionPart, Samples};
use crate::collection::progress::PartCoverage;
use crate::frames::{Attitude, Field};
use crate::time::WrappingMillis;

const BALANCE_WITH_QUOTA_12: SectorBalance =
    SectorBalance { quota: SampleQuota { fit_quota: 12, held_back_quota: 12 }, ..SectorBalance::TURNS };

fn push_right_turn_sample(buffer: &mut TestBuffer, sample: Sample) -> bool {
    SectorBalance::TURNS.push_sample(buffer.part_view(CollectionPart::RIGHT), sample)
}

fn collect(samples: impl Iterator<Item = Sample>) -> TestBuffer {
    let mut buffer = TestBuffer::new();
    for sample in samples {
        push_right_turn_sample(&mut buffer, sample);
    }
    buffer
}

fn coverage(samples: impl Iterator<Item = Sample>) -> PartCoverage {
    collect(samples).coverage(CollectionPart::RIGHT)
}

#[test]
fn three_circles_complete_a_side_in_spite_of_hard_iron() {
    // A circle takes 28 s. Half a circle covers 6 of 12 sectors, plus a partial one at each end.
    let half = coverage(turn_samples(25.0, 0, 14, 13.0));
    assert!((6..=8).contains(&half.covered_sector_count), "{half:?}");
    assert!(!half.is_complete());
    let full = coverage(turn_samples(25.0, 0, 84, 13.0));
    assert_eq!((full.covered_sector_count, full.percent), (12, 100), "{full:?}");
}

#[test]
fn a_complete_side_stays_complete() {
    for tenths in (100..200_u16).step_by(4) {
        let mut buffer = TestBuffer::new();
        let mut completed = false;
        for sample in turn_samples(25.0, 0, 150, f32::from(tenths) / 10.0) {
            push_right_turn_sample(&mut buffer, sample);
            let complete = buffer.coverage(CollectionPart::RIGHT).is_complete();
            assert!(complete || !completed, "{tenths} tenths of a degree a second, at {} ms", sample.time.as_ms());
            completed = complete;
        }
        assert!(completed);
    }
}

#[test]
fn a_constant_heading_gives_no_coverage() {
    let straight = coverage(turn_samples(25.0, 0, 300, 0.0));
    // At a constant heading bank wander moves the field along a short line, within two sectors.
    assert!(straight.covered_sector_count <= 2 && straight.percent < 20, "{straight:?}");
}

#[test]
fn a_full_buffer_stores_samples_of_missing_headings() {
    // Ten minutes back and forth over a third of the circle, then one full circle.
    let third = (0..12).flat_map(|i| turn_samples(25.0, i * 50, i * 50 + 9, 13.0));
    let later = turn_samples(25.0, 700, 728, 13.0);
    let mut buffer = collect(third.chain(later));
    let coverage = buffer.coverage(CollectionPart::RIGHT);
    assert_eq!(coverage.fit_count as usize, SampleQuota::TURN.fit_quota, "the buffer was full");
    assert_eq!(coverage.covered_sector_count, 12);
    assert!(buffer.fit_samples(CollectionPart::RIGHT).is_sorted_by_key(|sample| sample.time.as_ms()));
}

#[test]
fn held_back_samples_differ_from_the_fit_and_cover_every_sector() {
    let buffer = collect(turn_samples(25.0, 0, 120, 13.0));
    let (fit, held) = (buffer.fit_samples(CollectionPart::RIGHT), buffer.held_back_samples(CollectionPart::RIGHT));
    assert!(held.iter().all(|h| fit.iter().all(|f| f.time != h.time)));
    let circle = TurnCircle::fit_circle(&Samples::new(held)).unwrap();
    for sector in 0..SECTOR_COUNT {
        assert!(held.iter().filter(|s| circle.sector_of(s) == sector).count() >= 2, "sector {sector}");
    }
}

#[test]
fn a_complete_level_part_has_15_held_back_samples() {
    assert_eq!(MIN_HELD_BACK_WHEN_COMPLETE, 15, "a third of the 48 of level flight, less the last one");
    let mut buffer = TestBuffer::new();
    for sample in turn_samples(0.0, 0, 84, 13.0).take_while(|s| s.time.as_ms() < 84_000) {
        SectorBalance::LEVEL.push_sample(buffer.part_view(CollectionPart::LEVEL), sample);
        if buffer.coverage(CollectionPart::LEVEL).is_complete() {
            break;
        }
    }
    let level = buffer.coverage(CollectionPart::LEVEL);
    assert!(level.is_complete() && level.held_back_count >= MIN_HELD_BACK_WHEN_COMPLETE, "{level:?}");
}

#[test]
fn parts_are_separate() {
    let mut buffer = TestBuffer::new();
    for i in 0..8_u32 {
        // Of eight left, four right and four level samples every fourth is held back.
        SectorBalance::TURNS
            .push_sample(buffer.part_view(CollectionPart::LEFT), test_sample([i as f32, 0.0, 0.0], i * 400));
        if i < 4 {
            SectorBalance::TURNS
                .push_sample(buffer.part_view(CollectionPart::RIGHT), test_sample([i as f32, 1.0, 0.0], i * 400));
            SectorBalance::LEVEL
                .push_sample(buffer.part_view(CollectionPart::LEVEL), test_sample([i as f32, 2.0, 0.0], i * 400));
        }
    }
    for (number, part, numbers) in [
        (0.0_f32, CollectionPart::LEFT, (6, 2)),
        (1.0, CollectionPart::RIGHT, (3, 1)),
        (2.0, CollectionPart::LEVEL, (3, 1)),
    ] {
        let coverage = buffer.coverage(part);
        assert_eq!((coverage.fit_count, coverage.held_back_count), numbers);
        let samples = [buffer.fit_samples(part), buffer.held_back_samples(part)].concat();
        assert!(samples.iter().all(|sample| sample.part == part && sample.field.ut.y.to_bits() == number.to_bits()));
    }
    assert_eq!(buffer.coverage(CollectionPart::FREE), PartCoverage::default());
}

#[test]
fn nonfinite_samples_are_rejected() {
    let mut buffer = TestBuffer::new();
    for (i, broken) in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY].into_iter().enumerate() {
        for axis in 0..3 {
            let mut field_ut = [20.0; 3];
            field_ut[axis] = broken;
            assert!(!push_right_turn_sample(&mut buffer, test_sample(field_ut, (i * 3 + axis) as u32 * 400)));
        }
    }
    assert_eq!(buffer.stored_count(CollectionPart::RIGHT), 0);
}

#[test]
fn no_sensor_value_panics() {
    let values = [0.0, f32::NAN, f32::INFINITY, f32::MAX, 1e-30, -400.0];
    let samples = (0..600_u32).map(|i| Sample {
        time: WrappingMillis::new(i * 400),
        ..Sample::new(
            Field::from_ut(values[i as usize % 6], values[i as usize / 6 % 6], values[i as usize / 36 % 6]),
            Attitude::from_deg(25.0, 0.0),
        )
    });
    assert!(coverage(samples).fit_count > 0);
}

/// Number of samples stored if offered at this interval, across a wrap of the clock.
fn stored_count_at_interval(spacing_ms: u32, number: u32) -> usize {
    let at = |i: u32| test_sample([i as f32, 0.0, 0.0], (i * spacing_ms).wrapping_sub(1000));
    collect((0..number).map(at)).stored_count(CollectionPart::RIGHT)
}

#[test]
fn turn_samples_are_stored_at_most_every_0_4_s() {
    assert_eq!(stored_count_at_interval(400, 40), 40);
    assert_eq!(stored_count_at_interval(399, 40), 20, "every other one");
    assert_eq!(stored_count_at_interval(100, 40), 10, "every fourth one");
}

#[test]
fn every_fourth_sample_is_held_back() {
    let buffer = collect((0..13).map(|i| test_sample([i as f32, 0.0, 0.0], i * 400)));
    let times = |samples: &[Sample]| samples.iter().map(|sample| sample.time.as_ms() / 400).collect::<Vec<_>>();
    assert_eq!(times(buffer.held_back_samples(CollectionPart::RIGHT)), [3, 7, 11]);
    assert_eq!(times(buffer.fit_samples(CollectionPart::RIGHT)), [0, 1, 2, 4, 5, 6, 8, 9, 10, 12]);
}

#[test]
fn a_sample_too_early_does_not_count() {
    let mut buffer = TestBuffer::new();
    assert!(push_right_turn_sample(&mut buffer, test_sample([0.0; 3], 0)));
    assert!(!push_right_turn_sample(&mut buffer, test_sample([1.0, 0.0, 0.0], 399)));
    assert!(push_right_turn_sample(&mut buffer, test_sample([1.0, 0.0, 0.0], 400)));
    assert_eq!(buffer.part_view(CollectionPart::RIGHT).part_state.due_sample_count, 2);
}

/// Six samples with the time `100 sector + age`; sector 3 is the most crowded.
fn buffer_with_crowded_sector() -> TestBuffer {
    let mut buffer = TestBuffer::new();
    for time_ms in [100, 301, 302, 500, 303, 700] {
        buffer.part_view(CollectionPart::LEFT).insert_sample(SampleUse::Fit, test_sample([0.0; 3], time_ms));
    }
    buffer
}

const QUOTA_6: SampleQuota = SampleQuota { fit_quota: 6, held_back_quota: 6 };

fn insert_at(buffer: &mut TestBuffer, quota: SampleQuota, time_ms: u32) {
    let sector_from_time = |sample: &Sample| sample.time.as_ms() as usize / 100;
    insert_balanced(
        &mut buffer.part_view(CollectionPart::LEFT),
        SampleUse::Fit,
        quota,
        test_sample([0.0; 3], time_ms),
        sector_from_time,
    );
}

fn stored_times_ms(buffer: &TestBuffer) -> Vec<u32> {
    buffer.fit_samples(CollectionPart::LEFT).iter().map(|sample| sample.time.as_ms()).collect()
}

#[test]
fn a_full_part_replaces_the_oldest_sample_of_the_fullest_sector() {
    let mut buffer = buffer_with_crowded_sector();
    insert_at(&mut buffer, QUOTA_6, 1100);
    assert_eq!(stored_times_ms(&buffer), [100, 302, 500, 303, 700, 1100]);
    insert_at(&mut buffer, QUOTA_6, 0);
    assert_eq!(stored_times_ms(&buffer), [100, 500, 303, 700, 1100, 0]);
}

#[test]
fn a_full_part_rejects_samples_of_its_fullest_sector() {
    let mut buffer = buffer_with_crowded_sector();
    insert_at(&mut buffer, QUOTA_6, 399);
    assert_eq!(stored_times_ms(&buffer), stored_times_ms(&buffer_with_crowded_sector()));
}

#[test]
fn a_part_with_room_accepts_all() {
    let mut buffer = buffer_with_crowded_sector();
    for time_ms in [304, 305, 306] {
        insert_at(&mut buffer, SampleQuota { fit_quota: 9, ..QUOTA_6 }, time_ms);
    }
    assert_eq!(stored_times_ms(&buffer), [100, 301, 302, 500, 303, 700, 304, 305, 306]);
}

#[test]
fn a_turn_is_complete_with_8_samples_per_sector_and_132_in_all() {
    let turns = |counts: &[u16; SECTOR_COUNT], samples| SectorBalance::TURNS.balance_percent(counts, samples);
    let mut counts = [8; SECTOR_COUNT];
    assert_eq!(turns(&counts, 132), 100);
    assert_eq!(turns(&counts, 131), 99);
    assert_eq!(turns(&counts, 66), 50);
    counts[5] = 7;
    assert_eq!(turns(&counts, 132), 98);
    counts = [50; SECTOR_COUNT];
    counts[0] = 0;
    assert_eq!(turns(&counts, 132), 91);
    let level = |counts: &[u16; SECTOR_COUNT], samples| SectorBalance::LEVEL.balance_percent(counts, samples);
    assert_eq!(
        (level(&[4; SECTOR_COUNT], 48), level(&[4; SECTOR_COUNT], 47), level(&[3; SECTOR_COUNT], 48)),
        (100, 97, 75)
    );
}

fn circle_coverage(radius_ut: f32, fit_count: u16) -> PartCoverage {
    // Every fourth sample is held back.
    let number = u32::from(fit_count + (fit_count - 1) / 3);
    let coverage = coverage((0..number).map(|i| {
        let (sin, cos) = (i as f32 * 30.5).to_radians().sin_cos();
        test_sample([radius_ut * cos, radius_ut * sin, 40.0], i * 400)
    }));
    assert_eq!(coverage.fit_count, fit_count);
    coverage
}

#[test]
fn sectors_need_a_circle_of_4_ut_and_ten_samples() {
    let sectors = |coverage: PartCoverage| (coverage.covered_sector_count > 0, coverage.percent > 0);
    assert_eq!(sectors(circle_coverage(4.1, 60)), (true, true));
    assert_eq!(sectors(circle_coverage(3.9, 60)), (false, false));
    assert_eq!(sectors(circle_coverage(20.0, 10)), (true, true));
    assert_eq!(sectors(circle_coverage(20.0, 9)), (false, false));
    assert_eq!(
        (circle_coverage(3.9, 60).fit_count, circle_coverage(3.9, 60).held_back_count),
        (60, 19),
        "they are counted all the same"
    );
    assert_eq!(circle_coverage(20.0, 150).percent, 100);
}

/// Sectors follow the samples of either use: of twelve in one sector at least ten are replaced by others.
#[test]
fn the_circle_is_fitted_to_fit_and_held_back_samples() {
    let at = |i: u32| {
        let heading_deg = if i < 12 { 1.0 + i as f32 * 2.0 } else { 15.0 + i as f32 * 30.0 };
        Sample { time: WrappingMillis::new(i * 400), ..circle_sample(heading_deg) }
    };
    for sample_use in [SampleUse::Fit, SampleUse::Verification] {
        let mut buffer = TestBuffer::new();
        (0..12).for_each(|i| buffer.part_view(CollectionPart::LEFT).insert_sample(sample_use, at(i)));
        for i in 12..36 {
            // Makes the next sample one of the tested use.
            buffer.part_view(CollectionPart::LEFT).part_state.due_sample_count =
                if sample_use == SampleUse::Fit { 0 } else { 3 };
            assert!(BALANCE_WITH_QUOTA_12.push_sample(buffer.part_view(CollectionPart::LEFT), at(i)));
        }
        let samples = if sample_use == SampleUse::Fit {
            buffer.fit_samples(CollectionPart::LEFT)
        } else {
            buffer.held_back_samples(CollectionPart::LEFT)
        };
        assert_eq!((samples.len(), buffer.stored_count(CollectionPart::LEFT)), (12, 12));
        assert!(samples.iter().filter(|sample| sample.time.as_ms() >= 12 * 400).count() >= 10, "{samples:?}");
        assert!(
            sample_use == SampleUse::Verification || buffer.coverage(CollectionPart::LEFT).covered_sector_count >= 11
        );
    }
}

#[test]
fn sectors_with_a_sample_are_counted() {
    let coverage = coverage((0..14_u32).map(|i| {
        // Two arcs of 18 deg touch at most four sectors.
        let heading_deg = if i < 7 { i as f32 * 3.0 } else { 180.0 + (i - 7) as f32 * 3.0 };
        Sample { time: WrappingMillis::new(i * 400), ..circle_sample(heading_deg) }
    }));
    assert!((2..=4).contains(&coverage.covered_sector_count), "{coverage:?}");
}

#[test]
fn a_complete_part_stays_complete() {
    let mut buffer =
        collect((0..190_u32).map(|i| Sample { time: WrappingMillis::new(i * 400), ..circle_sample(i as f32 * 13.0) }));
    assert!(buffer.coverage(CollectionPart::RIGHT).is_complete());
    for i in 190..194_u32 {
        push_right_turn_sample(&mut buffer, test_sample([900.0, 0.0, 0.0], i * 400));
        assert!(buffer.coverage(CollectionPart::RIGHT).is_complete(), "{:?}", buffer.coverage(CollectionPart::RIGHT));
    }
}

#[test]
fn the_quota_must_suffice_for_a_complete_part() {
    let balance_with =
        |fit| SectorBalance { quota: SampleQuota { fit_quota: fit, held_back_quota: 60 }, ..SectorBalance::LEVEL };
    assert!(balance_with(48).is_quota_sufficient() && !balance_with(47).is_quota_sufficient(), "either target");
    assert!(!SectorBalance { complete_fit_samples: 49, ..balance_with(48) }.is_quota_sufficient());
    assert!(!SectorBalance { samples_per_full_sector: 5, ..balance_with(59) }.is_quota_sufficient());
    assert!(SectorBalance { samples_per_full_sector: 5, ..balance_with(60) }.is_quota_sufficient());
    assert!(!SectorBalance { min_samples: 49, ..balance_with(100) }.is_quota_sufficient());
    assert!(SectorBalance { min_samples: 48, ..balance_with(100) }.is_quota_sufficient());
    let held_back = |held_back| SectorBalance {
        quota: SampleQuota { fit_quota: 48, held_back_quota: held_back },
        ..SectorBalance::LEVEL
    };
    assert!(held_back(15).is_quota_sufficient() && !held_back(14).is_quota_sufficient());
    assert_eq!(
        (SectorBalance::TURNS.min_held_back_when_complete(), SectorBalance::LEVEL.min_held_back_when_complete()),
        (43, 15)
    );
}
