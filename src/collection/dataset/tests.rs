use super::super::circle::Circle;
use super::super::testing::{memory, sample, turn};
use super::*;
use crate::calibration::Rates;
use crate::frames::{Attitude, Field};
use crate::time::WrappingMillis;

fn empty() -> Dataset<'static> {
    let crate::collection::Kept { left, right, level, .. } = memory();
    let mut dataset = Dataset::new(left, right, level, [0; 7]);
    dataset.clear();
    dataset
}

fn collect(samples: impl Iterator<Item = Sample>) -> Dataset<'static> {
    let mut dataset = empty();
    for sample in samples {
        dataset.push_turn(Side::Right, sample);
    }
    dataset
}

fn coverage(samples: impl Iterator<Item = Sample>) -> Coverage {
    collect(samples).turns(Side::Right)
}

#[test]
fn three_circles_fill_a_side_in_spite_of_the_hard_iron() {
    // 28 s a circle. Half a circle is 6 of 12 sectors, one more where it ends inside one.
    let half = coverage(turn(25.0, 0, 14, 13.0));
    assert!((6..=8).contains(&half.sectors), "{half:?}");
    assert!(!half.is_complete());
    let full = coverage(turn(25.0, 0, 84, 13.0));
    assert_eq!((full.sectors, full.percent), (12, 100), "{full:?}");
}

#[test]
fn a_complete_side_stays_complete() {
    for tenths in (100..200_u16).step_by(4) {
        let mut dataset = empty();
        let mut completed = false;
        for sample in turn(25.0, 0, 150, f32::from(tenths) / 10.0) {
            dataset.push_turn(Side::Right, sample);
            let complete = dataset.turns(Side::Right).is_complete();
            assert!(complete || !completed, "{tenths} tenths of a degree a second, at {} ms", sample.time.count());
            completed = complete;
        }
        assert!(completed);
    }
}

#[test]
fn a_held_heading_is_no_coverage_however_long() {
    let straight = coverage(turn(25.0, 0, 300, 0.0));
    // Bank wander draws a short line, which is an arc of two sectors at most.
    assert!(straight.sectors <= 2 && straight.percent < 20, "{straight:?}");
}

#[test]
fn a_full_buffer_makes_room_for_headings_it_lacks() {
    // Ten minutes to and fro over a third of the circle, then one circle: the new headings must all come in.
    let third = (0..12).flat_map(|i| turn(25.0, i * 50, i * 50 + 9, 13.0));
    let later = turn(25.0, 700, 728, 13.0);
    let dataset = collect(third.chain(later));
    let coverage = dataset.turns(Side::Right);
    assert_eq!(coverage.samples as usize, FIT_CAPACITY, "the buffer was full");
    assert_eq!(coverage.sectors, 12);
    assert!(dataset.fit().right.is_sorted_by_key(|s| s.time.count()));
}

#[test]
fn held_back_samples_are_apart_from_those_of_the_fit_and_as_well_spread() {
    let dataset = collect(turn(25.0, 0, 120, 13.0));
    let (fit, held) = (dataset.fit().right, dataset.held_back().right);
    assert!(held.iter().all(|h| fit.iter().all(|f| f.time != h.time)));
    let circle = Circle::through(&Samples { left: held, ..Samples::default() }).unwrap();
    for sector in 0..SECTORS {
        assert!(held.iter().filter(|s| circle.sector(s) == sector).count() >= 2, "sector {sector}");
    }
}

/// What verification may count on, and no more than that.
#[test]
fn a_complete_part_has_the_held_back_samples_it_promises() {
    assert_eq!(HELD_BACK_WHEN_COMPLETE, 15, "a third of the 48 of level flight, less the last one");
    let mut dataset = empty();
    for sample in turn(0.0, 0, 84, 13.0).take_while(|s| s.time.count() < 84_000) {
        dataset.push_level(sample);
        if dataset.level().is_complete() {
            break;
        }
    }
    let level = dataset.level();
    assert!(level.is_complete() && level.held_back >= HELD_BACK_WHEN_COMPLETE, "{level:?}");
}

#[test]
fn parts_do_not_mix_and_are_forgotten_together() {
    let mut dataset = empty();
    let lengths = |samples: Samples<'_>| [samples.left.len(), samples.right.len(), samples.level.len()];
    for i in 0..8_u32 {
        // Eight left, four right, four level: of each four one is held back.
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
    assert_eq!([Side::Left, Side::Right].map(|side| numbers(dataset.turns(side))), [(6, 2), (3, 1)]);
    assert_eq!(numbers(dataset.level()), (3, 1));
    dataset.clear();
    assert_eq!((lengths(dataset.fit()), lengths(dataset.held_back())), ([0; 3], [0; 3]));
    assert_eq!([dataset.turns(Side::Left), dataset.turns(Side::Right), dataset.level()], [Coverage::default(); 3]);
}

/// A point every `step_ut` along a line, so many of them, offered as samples of all attitudes; what is kept.
fn tumbled(dataset: &mut Dataset, number: u32, step_ut: f32) -> usize {
    dataset.clear();
    for i in 0..number {
        dataset.push_any(sample([i as f32 * step_ut, 0.0, 0.0], i * 400));
    }
    dataset.fit().left.len() + dataset.held_back().left.len()
}

#[test]
fn samples_of_all_attitudes_are_five_microtesla_apart() {
    let mut dataset = empty();
    assert_eq!(tumbled(&mut dataset, 20, 5.1), 20);
    assert_eq!(tumbled(&mut dataset, 20, 5.0), 20, "at the very distance");
    assert_eq!(tumbled(&mut dataset, 20, 4.9), 10, "every other one");
    assert_eq!(tumbled(&mut dataset, 5, 5.1), 5);
    assert_eq!(dataset.held_back().left.len(), 1, "every fourth is held back");
}

/// The 253rd is one more than both buffers hold: the distance grows from 5 to 6.5 uT, which thins steps of 5.1.
#[test]
fn a_full_buffer_of_all_attitudes_is_thinned_and_forgetting_brings_the_distance_back() {
    let mut dataset = empty();
    let both = FIT_CAPACITY + HELD_BACK_CAPACITY;
    assert_eq!(tumbled(&mut dataset, both as u32, 5.1), both);
    assert_eq!(tumbled(&mut dataset, both as u32 + 1, 5.1), HELD_BACK_CAPACITY + thinned() + 1);
    assert!((dataset.apart_ut - 6.5).abs() < 1e-4, "{}", dataset.apart_ut);
    let coverage = dataset.turns(Side::Left);
    assert_eq!((coverage.samples as usize, coverage.held_back as usize), (thinned() + 1, HELD_BACK_CAPACITY));
    // From now on the new distance counts, from the samples of both buffers, until all is forgotten.
    let kept = dataset.fit().left.len();
    let last_ut = dataset.fit().left.last().unwrap().field.ut.x;
    dataset.push_any(sample([last_ut + 6.4, 0.0, 0.0], 1_000_000));
    assert_eq!(dataset.fit().left.len(), kept);
    dataset.push_any(sample([last_ut + 6.6, 0.0, 0.0], 1_000_000));
    assert_eq!(dataset.fit().left.len(), kept + 1);
    assert_eq!(tumbled(&mut dataset, 20, 5.1), 20);
}

/// Of steps of 5.1 uT, of which every fourth was held back, those nearer than 6.5 uT to the one kept before go.
fn thinned() -> usize {
    let is_held_back = |i: usize| i % 4 == 3 && i / 4 < HELD_BACK_CAPACITY;
    let fit = (0..FIT_CAPACITY + HELD_BACK_CAPACITY).filter(|i| !is_held_back(*i)).map(|i| i as f64 * 5.1);
    fit.fold((0, f64::NEG_INFINITY), |(kept, last), x| if x - last >= 6.5 { (kept + 1, x) } else { (kept, last) }).0
}

#[test]
fn samples_of_all_attitudes_are_counted_against_sixty_six() {
    let mut dataset = empty();
    for (number, percent) in [(44, 50), (86, 98), (87, 100), (200, 100)] {
        // Three of four are for the fit: 33, 65, 66, 150.
        tumbled(&mut dataset, number, 6.0);
        assert_eq!(dataset.turns(Side::Left).percent, percent, "{number}");
        assert_eq!(dataset.turns(Side::Left).sectors, 0);
    }
}

#[test]
fn what_is_not_finite_is_no_sample() {
    let mut dataset = empty();
    for (i, broken) in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY].into_iter().enumerate() {
        for axis in 0..3 {
            let mut field_ut = [20.0; 3];
            field_ut[axis] = broken;
            let broken = sample(field_ut, (i * 3 + axis) as u32 * 400);
            dataset.push_turn(Side::Left, broken);
            dataset.push_level(broken);
            dataset.push_any(broken);
        }
    }
    assert_eq!((dataset.fit().all().count(), dataset.held_back().all().count()), (0, 0));
}

#[test]
fn nothing_a_sensor_could_say_panics() {
    let values = [0.0, f32::NAN, f32::INFINITY, f32::MAX, 1e-30, -400.0];
    let samples = (0..600_u32).map(|i| Sample {
        field: Field::from_ut(values[i as usize % 6], values[i as usize / 6 % 6], values[i as usize / 36 % 6]),
        attitude: Attitude::from_deg(25.0, 0.0),
        time: WrappingMillis::new(i * 400),
        rates: Rates::NONE,
    });
    assert!(coverage(samples).samples > 0);
}

/// Of whatever is flown: turns to the right, level, to the left, one after the other, and a wobble; fast enough for every
/// sample to be another.
fn flown(seconds: u16) -> impl Iterator<Item = Sample> {
    let leg = |from_s: u16| [25.0, 0.0, -25.0][usize::from(from_s / 20 % 3)];
    (0..seconds).step_by(20).flat_map(move |from_s| turn(leg(from_s), from_s, from_s + 20, 60.0))
}

fn spread(samples: impl Iterator<Item = Sample>) -> Dataset<'static> {
    let mut dataset = empty();
    for sample in samples {
        dataset.push_spread(sample);
    }
    dataset
}

fn times(samples: Samples<'_>) -> Vec<u32> {
    samples.any.into_iter().flatten().map(|sample| sample.time.count()).collect()
}

const ALL_FIT: usize = 2 * FIT_CAPACITY + LEVEL_FIT_CAPACITY;
const ALL_HELD_BACK: usize = 2 * HELD_BACK_CAPACITY + LEVEL_HELD_BACK_CAPACITY;

/// All there is room for, every fourth held back, in the order of time, and none lost.
#[test]
fn whatever_is_flown_is_kept_until_there_is_no_room() {
    let dataset = spread(flown(40));
    let (fit, held_back) = (times(dataset.spread()), times(dataset.spread_held_back()));
    assert_eq!((fit.len(), held_back.len()), (300, 100));
    assert_eq!(held_back[..3], [300, 700, 1100]);
    let mut all = [fit.clone(), held_back].concat();
    all.sort_unstable();
    assert_eq!(all, (0..400).map(|i| i * 100).collect::<Vec<_>>());
    assert!(fit.is_sorted());
    assert_eq!(dataset.spread_coverage(), Coverage { samples: 300, held_back: 100, ..Coverage::default() });
    assert!(dataset.spread().left.is_empty() && dataset.spread_held_back().level.is_empty());
}

/// Twenty minutes of level flight, then a turn each way: it comes in, and what was flown before goes; each piece stays in
/// the order of time.
#[test]
fn what_tells_more_takes_the_place_of_what_tells_least() {
    let level = |minutes: u16| turn(0.0, 0, 60 * minutes, 60.0);
    let mut dataset = spread(level(5));
    for sample in [turn(25.0, 300, 320, 60.0), turn(-25.0, 320, 340, 60.0)].into_iter().flatten() {
        dataset.push_spread(sample);
    }
    for (samples, capacity) in [(dataset.spread(), ALL_FIT), (dataset.spread_held_back(), ALL_HELD_BACK)] {
        let banked = samples.any.into_iter().flatten().filter(|s| s.attitude.roll_rad.abs() > 0.3).count();
        assert_eq!(times(samples).len(), capacity);
        // Of 400 that were flown, one in four to verify with.
        let flown = if capacity == ALL_FIT { 300 } else { 100 };
        assert!(banked * 10 >= flown * 8 || banked * 10 >= capacity * 7, "{banked} of {flown}");
        for piece in samples.any {
            assert!(piece.is_sorted_by_key(|sample| sample.time.count()));
        }
    }
}

/// A full buffer of what tells much takes nothing in that tells little.
#[test]
fn what_tells_little_is_left() {
    let mut dataset = spread(flown(400));
    let before = times(dataset.spread());
    let still = turn(0.0, 500, 510, 60.0);
    for sample in still {
        dataset.push_spread(sample);
    }
    let after = times(dataset.spread());
    let new = after.iter().filter(|time| !before.contains(time)).count();
    assert!(new <= 8, "{new} of 75");
}

/// Who stands tells it once: 1 uT and 1.5 deg are another sample.
#[test]
fn who_stands_is_kept_once() {
    let mut dataset = empty();
    let mut push = |x_ut: f32, roll_deg: f32, pitch_deg: f32| {
        let attitude = Attitude::from_deg(roll_deg, pitch_deg);
        let before = dataset.spread_coverage();
        dataset.push_spread(Sample { attitude, ..sample([x_ut, 5.0, 40.0], 100) });
        dataset.spread_coverage() != before
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
fn forgotten_is_forgotten_of_whatever_was_flown() {
    let mut dataset = spread(flown(3));
    dataset.clear();
    assert_eq!(dataset.spread_coverage(), Coverage::default());
    // The round begins anew, too.
    for sample in flown(20).take(4) {
        dataset.push_spread(sample);
    }
    assert_eq!(times(dataset.spread_held_back()), [300]);
}
