use super::super::test_samples::{circle_sample, sample};
use super::*;

fn empty_part(fit: usize, held_back: usize) -> PartSamples<'static> {
    let room = |number| vec![sample([0.0; 3], 0); number].leak();
    PartSamples::new(room(fit), room(held_back), [0; 2])
}

fn buffer(room: usize, samples: impl IntoIterator<Item = Sample>) -> BorrowedBuffer<'static, Sample> {
    let mut buffer = BorrowedBuffer::new(vec![sample([0.0; 3], 0); room].leak(), 0);
    samples.into_iter().for_each(|sample| assert!(buffer.push(sample)));
    buffer
}

/// Number of samples stored at this interval, across a wrap of the clock.
fn stored_at_interval(spacing_ms: u32, number: u32) -> usize {
    let mut part = empty_part(100, 100);
    for i in 0..number {
        part.push_by_sector(&PartConfig::TURNS, sample([i as f32, 0.0, 0.0], (i * spacing_ms).wrapping_sub(1000)));
    }
    part.fit().len() + part.held_back().len()
}

#[test]
fn turn_samples_are_stored_at_most_every_0_4_s() {
    assert_eq!(stored_at_interval(400, 40), 40);
    assert_eq!(stored_at_interval(399, 40), 20, "every other one");
    assert_eq!(stored_at_interval(100, 40), 10, "every fourth one");
}

#[test]
fn tumbled_samples_are_stored_at_most_every_0_4_s() {
    for (spacing_ms, expected) in [(400, 20), (399, 10)] {
        let mut part = empty_part(100, 100);
        for i in 0..20 {
            part.push_by_distance(&PartConfig::TURNS, &mut 5.0, sample([i as f32 * 10.0, 0.0, 0.0], i * spacing_ms));
        }
        assert_eq!(part.fit().len() + part.held_back().len(), expected);
    }
}

#[test]
fn every_fourth_sample_is_held_back() {
    let mut part = empty_part(100, 100);
    for i in 0..13 {
        part.push_by_sector(&PartConfig::TURNS, sample([i as f32, 0.0, 0.0], i * 400));
    }
    let times = |samples: &[Sample]| samples.iter().map(|s| s.time.as_ms() / 400).collect::<Vec<_>>();
    assert_eq!(times(part.held_back()), [3, 7, 11]);
    assert_eq!(times(part.fit()), [0, 1, 2, 4, 5, 6, 8, 9, 10, 12]);
}

/// The hold-back cycle and the sample interval restart.
#[test]
fn clearing_restarts_a_part() {
    let mut part = empty_part(12, 8);
    for i in 0..3 {
        part.push_by_sector(&PartConfig::TURNS, sample([i as f32, 0.0, 0.0], i * 400));
    }
    part.clear();
    part.push_by_sector(&PartConfig::TURNS, sample([0.0; 3], 801));
    assert_eq!((part.fit().len(), part.held_back().len()), (1, 0));
}

/// Samples at `100 sector + age`; sector 3 is the most crowded.
fn crowded_buffer() -> BorrowedBuffer<'static, Sample> {
    buffer(6, [100, 301, 302, 500, 303, 700].map(|time_ms| sample([0.0; 3], time_ms)))
}

fn times(samples: &BorrowedBuffer<'_, Sample>) -> Vec<u32> {
    samples.as_slice().iter().map(|s| s.time.as_ms()).collect()
}

fn sector_from_time(sample: &Sample) -> usize {
    sample.time.as_ms() as usize / 100
}

#[test]
fn a_full_buffer_replaces_the_oldest_sample_of_the_fullest_sector() {
    let mut samples = crowded_buffer();
    insert_balanced(&mut samples, sample([0.0; 3], 1100), sector_from_time);
    assert_eq!(times(&samples), [100, 302, 500, 303, 700, 1100]);
    insert_balanced(&mut samples, sample([0.0; 3], 0), sector_from_time);
    assert_eq!(times(&samples), [100, 500, 303, 700, 1100, 0]);
}

#[test]
fn a_full_buffer_rejects_samples_of_its_fullest_sector() {
    let mut samples = crowded_buffer();
    insert_balanced(&mut samples, sample([0.0; 3], 399), sector_from_time);
    assert_eq!(samples.as_slice(), crowded_buffer().as_slice());
}

#[test]
fn a_buffer_with_room_accepts_all() {
    let mut samples = buffer(3, []);
    for time_ms in [300, 301, 302] {
        insert_balanced(&mut samples, sample([0.0; 3], time_ms), sector_from_time);
    }
    assert_eq!(times(&samples), [300, 301, 302]);
}

/// 8 samples in each of 12 sectors and 132 in all.
#[test]
fn a_turn_is_complete_with_8_samples_per_sector_and_132_in_all() {
    let turns = |counts: &[u16; SECTORS], samples| percent_of_turn(&PartConfig::TURNS, counts, samples);
    let mut counts = [8; SECTORS];
    assert_eq!(turns(&counts, 132), 100);
    assert_eq!(turns(&counts, 131), 99);
    assert_eq!(turns(&counts, 66), 50);
    counts[5] = 7;
    assert_eq!(turns(&counts, 132), 98);
    counts = [50; SECTORS];
    counts[0] = 0;
    assert_eq!(turns(&counts, 132), 91);
    let level = |counts: &[u16; SECTORS], samples| percent_of_turn(&PartConfig::LEVEL, counts, samples);
    assert_eq!((level(&[4; SECTORS], 48), level(&[4; SECTORS], 47), level(&[3; SECTORS], 48)), (100, 97, 75));
}

#[test]
fn percent_is_rounded_down_and_ends_at_a_hundred() {
    assert_eq!(
        [(0, 3), (1, 3), (2, 3), (3, 3), (4, 3)].map(|(part, whole)| percent(part, whole)),
        [0, 33, 66, 100, 100]
    );
    assert_eq!((percent(u16::MAX, 1), percent(5, 0)), (100, 100));
}

fn circle_coverage(radius_ut: f32, fit: u16) -> Coverage {
    let mut part = empty_part(200, 70);
    // The last of each four is held back.
    for i in 0..u32::from(fit + (fit - 1) / 3) {
        let (sin, cos) = (i as f32 * 30.5).to_radians().sin_cos();
        part.push_by_sector(&PartConfig::TURNS, sample([radius_ut * cos, radius_ut * sin, 40.0], i * 400));
    }
    assert_eq!(part.fit().len(), usize::from(fit));
    part.coverage()
}

#[test]
fn sectors_need_a_circle_of_4_ut_and_ten_samples() {
    let sectors = |coverage: Coverage| (coverage.sectors > 0, coverage.percent > 0);
    assert_eq!(sectors(circle_coverage(4.1, 60)), (true, true));
    assert_eq!(sectors(circle_coverage(3.9, 60)), (false, false));
    assert_eq!(sectors(circle_coverage(20.0, 10)), (true, true));
    assert_eq!(sectors(circle_coverage(20.0, 9)), (false, false));
    assert_eq!(
        (circle_coverage(3.9, 60).samples, circle_coverage(3.9, 60).held_back),
        (60, 19),
        "they are counted all the same"
    );
    assert_eq!(circle_coverage(20.0, 150).percent, 100);
}

#[test]
fn the_circle_is_fitted_to_fit_and_held_back_samples() {
    let fill = |hold_back_every: u16| {
        let config = PartConfig { hold_back_cycle: hold_back_every, ..PartConfig::TURNS };
        let mut part = empty_part(12, 12);
        for i in 0..36_u32 {
            let heading_deg = if i < 12 { i as f32 * 2.0 } else { i as f32 * 30.0 };
            part.push_by_sector(&config, Sample { time: WrappingMillis::new(i * 400), ..circle_sample(heading_deg) });
        }
        part
    };
    let (all_fit, all_held_back) = (fill(1000), fill(1));
    assert!(all_fit.coverage().sectors >= 11, "{:?}", all_fit.coverage());
    for samples in [all_fit.fit(), all_held_back.held_back()] {
        assert_eq!(samples.len(), 12);
        assert!(samples.iter().filter(|s| s.time.as_ms() >= 12 * 400).count() >= 10, "{samples:?}");
    }
}

#[test]
fn sectors_with_a_sample_are_counted() {
    let mut part = empty_part(200, 70);
    for i in 0..14_u32 {
        // Two arcs of 18 deg: at most four sectors.
        let heading_deg = if i < 7 { i as f32 * 3.0 } else { 180.0 + (i - 7) as f32 * 3.0 };
        part.push_by_sector(
            &PartConfig::TURNS,
            Sample { time: WrappingMillis::new(i * 400), ..circle_sample(heading_deg) },
        );
    }
    assert!((2..=4).contains(&part.coverage().sectors), "{:?}", part.coverage());
}

#[test]
fn a_part_is_complete_at_100_percent() {
    assert!(Coverage { percent: 100, ..Coverage::NONE }.is_complete());
    assert!(!Coverage { percent: 99, ..Coverage::NONE }.is_complete());
}

/// A distant sample spoils the circle.
#[test]
fn a_complete_part_stays_complete() {
    let mut part = empty_part(200, 70);
    for i in 0..190_u32 {
        part.push_by_sector(
            &PartConfig::TURNS,
            Sample { time: WrappingMillis::new(i * 400), ..circle_sample(i as f32 * 13.0) },
        );
    }
    assert!(part.coverage().is_complete());
    for i in 190..194_u32 {
        part.push_by_sector(&PartConfig::TURNS, sample([900.0, 0.0, 0.0], i * 400));
        assert!(part.coverage().is_complete(), "{:?}", part.coverage());
    }
}

#[test]
fn thinning_keeps_the_first_of_close_samples() {
    let mut samples = buffer(8, [0.0, 1.0, 2.0, 3.0, 2.5, 10.0].map(|x| sample([x, 0.0, 0.0], 0)));
    remove_close_samples(&mut samples, 2.0);
    assert_eq!(samples.as_slice().iter().map(|s| s.field.ut.x).collect::<Vec<_>>(), [0.0, 2.0, 10.0]);
}

#[test]
fn a_full_held_back_buffer_passes_tumbled_samples_to_the_fit() {
    let mut part = empty_part(12, 1);
    for i in 0..8 {
        part.push_by_distance(&PartConfig::TURNS, &mut 5.0, sample([i as f32 * 10.0, 0.0, 0.0], i * 400));
    }
    assert_eq!((part.fit().len(), part.held_back().len()), (7, 1));
}

#[test]
fn buffer_capacity_must_suffice_for_a_complete_part() {
    let config = PartConfig { target: 48, sector_samples: 4, min_samples: 10, ..PartConfig::TURNS };
    assert!(config.fits_capacity(48) && !config.fits_capacity(47), "either target");
    assert!(!PartConfig { target: 49, ..config }.fits_capacity(48));
    assert!(
        !PartConfig { sector_samples: 5, ..config }.fits_capacity(59)
            && PartConfig { sector_samples: 5, ..config }.fits_capacity(60)
    );
    assert!(
        !PartConfig { min_samples: 49, ..config }.fits_capacity(100)
            && PartConfig { min_samples: 48, ..config }.fits_capacity(100)
    );
    assert_eq!(
        (PartConfig::TURNS.min_held_back_when_complete(), PartConfig::LEVEL.min_held_back_when_complete()),
        (43, 15)
    );
}
