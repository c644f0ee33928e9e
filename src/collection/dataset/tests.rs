use super::super::circle::TurnCircle;
use super::super::test_samples::{empty_memory, sample, turn_samples};
use super::*;
use crate::calibration::Rates;
use crate::frames::{Attitude, Field};
use crate::time::WrappingMillis;

fn empty_dataset() -> Dataset<'static> {
    let crate::collection::RetainedSamples { left, right, level, .. } = empty_memory();
    let mut dataset = Dataset::new(left, right, level, [0; 7]);
    dataset.clear();
    dataset
}

fn collect(samples: impl Iterator<Item = Sample>) -> Dataset<'static> {
    let mut dataset = empty_dataset();
    for sample in samples {
        dataset.push_turn(Side::Right, sample);
    }
    dataset
}

fn coverage(samples: impl Iterator<Item = Sample>) -> Coverage {
    collect(samples).turn_coverage(Side::Right)
}

#[test]
fn three_circles_complete_a_side_in_spite_of_hard_iron() {
    // 28 s per circle. Half a circle is 6 of 12 sectors, plus a partial one at each end.
    let half = coverage(turn_samples(25.0, 0, 14, 13.0));
    assert!((6..=8).contains(&half.sectors), "{half:?}");
    assert!(!half.is_complete());
    let full = coverage(turn_samples(25.0, 0, 84, 13.0));
    assert_eq!((full.sectors, full.percent), (12, 100), "{full:?}");
}

#[test]
fn a_complete_side_stays_complete() {
    for tenths in (100..200_u16).step_by(4) {
        let mut dataset = empty_dataset();
        let mut completed = false;
        for sample in turn_samples(25.0, 0, 150, f32::from(tenths) / 10.0) {
            dataset.push_turn(Side::Right, sample);
            let complete = dataset.turn_coverage(Side::Right).is_complete();
            assert!(complete || !completed, "{tenths} tenths of a degree a second, at {} ms", sample.time.as_ms());
            completed = complete;
        }
        assert!(completed);
    }
}

#[test]
fn a_constant_heading_gives_no_coverage() {
    let straight = coverage(turn_samples(25.0, 0, 300, 0.0));
    // Bank wander draws a short line: at most two sectors.
    assert!(straight.sectors <= 2 && straight.percent < 20, "{straight:?}");
}

#[test]
fn a_full_buffer_stores_samples_of_missing_headings() {
    // Ten minutes back and forth over a third of the circle, then one full circle.
    let third = (0..12).flat_map(|i| turn_samples(25.0, i * 50, i * 50 + 9, 13.0));
    let later = turn_samples(25.0, 700, 728, 13.0);
    let dataset = collect(third.chain(later));
    let coverage = dataset.turn_coverage(Side::Right);
    assert_eq!(coverage.samples as usize, FIT_CAPACITY, "the buffer was full");
    assert_eq!(coverage.sectors, 12);
    assert!(dataset.fit().right.is_sorted_by_key(|s| s.time.as_ms()));
}

#[test]
fn held_back_samples_differ_from_the_fit_and_cover_every_sector() {
    let dataset = collect(turn_samples(25.0, 0, 120, 13.0));
    let (fit, held) = (dataset.fit().right, dataset.held_back().right);
    assert!(held.iter().all(|h| fit.iter().all(|f| f.time != h.time)));
    let circle = TurnCircle::fit_to(&Samples { left: held, ..Samples::default() }).unwrap();
    for sector in 0..SECTORS {
        assert!(held.iter().filter(|s| circle.sector_of(s) == sector).count() >= 2, "sector {sector}");
    }
}

#[test]
fn a_complete_level_part_has_15_held_back_samples() {
    assert_eq!(MIN_HELD_BACK_WHEN_COMPLETE, 15, "a third of the 48 of level flight, less the last one");
    let mut dataset = empty_dataset();
    for sample in turn_samples(0.0, 0, 84, 13.0).take_while(|s| s.time.as_ms() < 84_000) {
        dataset.push_level(sample);
        if dataset.level_coverage().is_complete() {
            break;
        }
    }
    let level = dataset.level_coverage();
    assert!(level.is_complete() && level.held_back >= MIN_HELD_BACK_WHEN_COMPLETE, "{level:?}");
}

#[test]
fn parts_are_separate_and_cleared_together() {
    let mut dataset = empty_dataset();
    let lengths = |samples: Samples<'_>| [samples.left.len(), samples.right.len(), samples.level.len()];
    for i in 0..8_u32 {
        // Eight left, four right, four level; every fourth is held back.
        dataset.push_turn(Side::Left, sample([i as f32, 0.0, 0.0], i * 400));
        if i < 4 {
            dataset.push_turn(Side::Right, sample([i as f32, 1.0, 0.0], i * 400));
            dataset.push_level(sample([i as f32, 2.0, 0.0], i * 400));
        }
    }
    assert_eq!(lengths(dataset.fit()), [6, 3, 3]);
    assert_eq!(lengths(dataset.held_back()), [2, 1, 1]);
    assert!(dataset.fit().right.iter().chain(dataset.held_back().right).all(|s| s.field.ut.y.to_bits() == 0x3F80_0000));
    let numbers = |coverage: Coverage| (coverage.samples, coverage.held_back);
    assert_eq!([Side::Left, Side::Right].map(|side| numbers(dataset.turn_coverage(side))), [(6, 2), (3, 1)]);
    assert_eq!(numbers(dataset.level_coverage()), (3, 1));
    dataset.clear();
    assert_eq!((lengths(dataset.fit()), lengths(dataset.held_back())), ([0; 3], [0; 3]));
    assert_eq!(
        [dataset.turn_coverage(Side::Left), dataset.turn_coverage(Side::Right), dataset.level_coverage()],
        [Coverage::default(); 3]
    );
}

/// Number of samples stored of `number` points on a line, `step_ut` apart.
fn stored_on_line(dataset: &mut Dataset, number: u32, step_ut: f32) -> usize {
    dataset.clear();
    for i in 0..number {
        dataset.push_tumbled(sample([i as f32 * step_ut, 0.0, 0.0], i * 400));
    }
    dataset.fit().left.len() + dataset.held_back().left.len()
}

#[test]
fn tumbled_samples_are_at_least_5_ut_apart() {
    let mut dataset = empty_dataset();
    assert_eq!(stored_on_line(&mut dataset, 20, 5.1), 20);
    assert_eq!(stored_on_line(&mut dataset, 20, 5.0), 20, "at the very distance");
    assert_eq!(stored_on_line(&mut dataset, 20, 4.9), 10, "every other one");
    assert_eq!(stored_on_line(&mut dataset, 5, 5.1), 5);
    assert_eq!(dataset.held_back().left.len(), 1, "every fourth is held back");
}

/// The 253rd sample exceeds both buffers: the distance grows from 5 to 6.5 uT and thins steps of 5.1 uT.
#[test]
fn a_full_tumble_buffer_is_thinned_and_clearing_resets_the_distance() {
    let mut dataset = empty_dataset();
    let both = FIT_CAPACITY + HELD_BACK_CAPACITY;
    assert_eq!(stored_on_line(&mut dataset, both as u32, 5.1), both);
    assert_eq!(stored_on_line(&mut dataset, both as u32 + 1, 5.1), HELD_BACK_CAPACITY + expected_after_thinning() + 1);
    assert!((dataset.min_distance_ut - 6.5).abs() < 1e-4, "{}", dataset.min_distance_ut);
    let coverage = dataset.turn_coverage(Side::Left);
    assert_eq!(
        (coverage.samples as usize, coverage.held_back as usize),
        (expected_after_thinning() + 1, HELD_BACK_CAPACITY)
    );
    // The new distance applies to both buffers until the dataset is cleared.
    let stored_count = dataset.fit().left.len();
    let last_ut = dataset.fit().left.last().unwrap().field.ut.x;
    dataset.push_tumbled(sample([last_ut + 6.4, 0.0, 0.0], 1_000_000));
    assert_eq!(dataset.fit().left.len(), stored_count);
    dataset.push_tumbled(sample([last_ut + 6.6, 0.0, 0.0], 1_000_000));
    assert_eq!(dataset.fit().left.len(), stored_count + 1);
    assert_eq!(stored_on_line(&mut dataset, 20, 5.1), 20);
}

fn expected_after_thinning() -> usize {
    let is_held_back = |i: usize| i % 4 == 3 && i / 4 < HELD_BACK_CAPACITY;
    let fit = (0..FIT_CAPACITY + HELD_BACK_CAPACITY).filter(|i| !is_held_back(*i)).map(|i| i as f64 * 5.1);
    fit.fold((0, f64::NEG_INFINITY), |(count, last), x| if x - last >= 6.5 { (count + 1, x) } else { (count, last) }).0
}

#[test]
fn a_tumble_is_complete_at_66_fit_samples() {
    let mut dataset = empty_dataset();
    for (number, percent) in [(44, 50), (86, 98), (87, 100), (200, 100)] {
        // Three of four are for the fit: 33, 65, 66, 150.
        stored_on_line(&mut dataset, number, 6.0);
        assert_eq!(dataset.turn_coverage(Side::Left).percent, percent, "{number}");
        assert_eq!(dataset.turn_coverage(Side::Left).sectors, 0);
    }
}

#[test]
fn nonfinite_samples_are_rejected() {
    let mut dataset = empty_dataset();
    for (i, broken) in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY].into_iter().enumerate() {
        for axis in 0..3 {
            let mut field_ut = [20.0; 3];
            field_ut[axis] = broken;
            let broken = sample(field_ut, (i * 3 + axis) as u32 * 400);
            dataset.push_turn(Side::Left, broken);
            dataset.push_level(broken);
            dataset.push_tumbled(broken);
        }
    }
    assert_eq!((dataset.fit().all().count(), dataset.held_back().all().count()), (0, 0));
}

#[test]
fn no_sensor_value_panics() {
    let values = [0.0, f32::NAN, f32::INFINITY, f32::MAX, 1e-30, -400.0];
    let samples = (0..600_u32).map(|i| Sample {
        field: Field::from_ut(values[i as usize % 6], values[i as usize / 6 % 6], values[i as usize / 36 % 6]),
        attitude: Attitude::from_deg(25.0, 0.0),
        time: WrappingMillis::new(i * 400),
        rates: Rates::NONE,
    });
    assert!(coverage(samples).samples > 0);
}

/// Right turn, level, left turn, 20 s each, with bank wander; consecutive samples differ.
fn free_flight(seconds: u16) -> impl Iterator<Item = Sample> {
    let leg = |from_s: u16| [25.0, 0.0, -25.0][usize::from(from_s / 20 % 3)];
    (0..seconds).step_by(20).flat_map(move |from_s| turn_samples(leg(from_s), from_s, from_s + 20, 60.0))
}

fn collect_free_flight(samples: impl Iterator<Item = Sample>) -> Dataset<'static> {
    let mut dataset = empty_dataset();
    for sample in samples {
        dataset.push_free_flight(sample);
    }
    dataset
}

fn free_flight_times(samples: Samples<'_>) -> Vec<u32> {
    samples.unassigned.into_iter().flatten().map(|sample| sample.time.as_ms()).collect()
}

const ALL_FIT: usize = 2 * FIT_CAPACITY + LEVEL_FIT_CAPACITY;
const ALL_HELD_BACK: usize = 2 * HELD_BACK_CAPACITY + LEVEL_HELD_BACK_CAPACITY;

#[test]
fn free_flight_samples_are_stored_until_full() {
    let dataset = collect_free_flight(free_flight(40));
    let (fit, held_back) =
        (free_flight_times(dataset.free_flight_fit()), free_flight_times(dataset.free_flight_held_back()));
    assert_eq!((fit.len(), held_back.len()), (300, 100));
    assert_eq!(held_back[..3], [300, 700, 1100]);
    let mut all = [fit.clone(), held_back].concat();
    all.sort_unstable();
    assert_eq!(all, (0..400).map(|i| i * 100).collect::<Vec<_>>());
    assert!(fit.is_sorted());
    assert_eq!(dataset.free_flight_coverage(), Coverage { samples: 300, held_back: 100, ..Coverage::default() });
    assert!(dataset.free_flight_fit().left.is_empty() && dataset.free_flight_held_back().level.is_empty());
}

/// Five minutes of level flight, then a turn each way.
#[test]
fn informative_samples_replace_uninformative_ones() {
    let level = |minutes: u16| turn_samples(0.0, 0, 60 * minutes, 60.0);
    let mut dataset = collect_free_flight(level(5));
    for sample in [turn_samples(25.0, 300, 320, 60.0), turn_samples(-25.0, 320, 340, 60.0)].into_iter().flatten() {
        dataset.push_free_flight(sample);
    }
    for (samples, capacity) in [(dataset.free_flight_fit(), ALL_FIT), (dataset.free_flight_held_back(), ALL_HELD_BACK)]
    {
        let banked = samples.unassigned.into_iter().flatten().filter(|s| s.attitude.roll_rad.abs() > 0.3).count();
        assert_eq!(free_flight_times(samples).len(), capacity);
        // Of 400 banked samples, one in four is held back.
        let samples_offered = if capacity == ALL_FIT { 300 } else { 100 };
        assert!(banked * 10 >= samples_offered * 8 || banked * 10 >= capacity * 7, "{banked} of {samples_offered}");
        for piece in samples.unassigned {
            assert!(piece.is_sorted_by_key(|sample| sample.time.as_ms()));
        }
    }
}

#[test]
fn uninformative_samples_are_rejected() {
    let mut dataset = collect_free_flight(free_flight(400));
    let before = free_flight_times(dataset.free_flight_fit());
    let still = turn_samples(0.0, 500, 510, 60.0);
    for sample in still {
        dataset.push_free_flight(sample);
    }
    let after = free_flight_times(dataset.free_flight_fit());
    let new = after.iter().filter(|time| !before.contains(time)).count();
    assert!(new <= 8, "{new} of 75");
}

/// Thresholds: 1 uT and 1.5 deg.
#[test]
fn identical_samples_are_stored_once() {
    let mut dataset = empty_dataset();
    let mut push = |x_ut: f32, roll_deg: f32, pitch_deg: f32| {
        let attitude = Attitude::from_deg(roll_deg, pitch_deg);
        let before = dataset.free_flight_coverage();
        dataset.push_free_flight(Sample { attitude, ..sample([x_ut, 5.0, 40.0], 100) });
        dataset.free_flight_coverage() != before
    };
    assert!(push(20.0, 0.0, 0.0));
    for _ in 0..100 {
        assert!(!push(20.0, 0.0, 0.0) && !push(20.9, 0.0, 0.0) && !push(20.0, 1.0, -1.0));
    }
    assert!(push(21.1, 0.0, 0.0));
    assert!(push(21.1, -1.6, 0.0));
    assert!(push(21.1, -1.6, 1.6));
    assert!(!push(f32::NAN, 0.0, 0.0) && !push(90.0, f32::NAN, 0.0) && !push(90.0, 0.0, f32::INFINITY));
}

#[test]
fn clearing_discards_free_flight_samples() {
    let mut dataset = collect_free_flight(free_flight(3));
    dataset.clear();
    assert_eq!(dataset.free_flight_coverage(), Coverage::default());
    for sample in free_flight(20).take(4) {
        dataset.push_free_flight(sample);
    }
    assert_eq!(free_flight_times(dataset.free_flight_held_back()), [300]);
}
