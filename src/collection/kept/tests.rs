use testkit::random::Random;

use super::super::testing::{banked, memory, on_circle, sample, turn};
use super::super::{Collector, Context, Course, Lack, Progress};
use super::*;
use crate::calibration::Samples;
use crate::calibration::ladder::Procedure;

const BY_HAND: Context = Context { by_itself: false, serial: 7 };

/// A flight that leaves samples in all buffers: left, level, right, level.
fn flight() -> impl Iterator<Item = Sample> {
    let legs = [(-25.0, 0, 40, -13.0), (0.0, 40, 60, 3.0), (25.0, 60, 90, 13.0), (0.0, 90, 95, 3.0)];
    legs.into_iter().flat_map(|(roll_deg, from_s, to_s, rate)| turn(roll_deg, from_s, to_s, rate))
}

/// A collection of these in some memory.
fn collect(kept: &mut Kept, procedure: Procedure, samples: impl Iterator<Item = Sample>) {
    let mut collector = Collector::new(kept);
    collector.begin(procedure);
    for sample in samples {
        collector.push(sample);
        collector.keep(BY_HAND);
    }
    if procedure == Procedure::Swing {
        assert!(collector.mark(Mark { sample: on_circle(30.0), heading_rad: 0.5 }));
        collector.keep(BY_HAND);
    }
}

fn all(samples: Samples<'_>) -> Vec<Sample> {
    samples.all().copied().collect()
}

/// All that can be seen of a collection.
fn seen(collector: &Collector<'_>) -> (Progress, Vec<Sample>, Vec<Sample>, Option<Lack>, u32) {
    // The turn of now is told after two seconds of it.
    let progress = Progress { turning: None, ..collector.progress() };
    (progress, all(collector.fit()), all(collector.held_back()), collector.lack(), collector.news())
}

/// As it was sealed.
#[test]
fn what_was_collected_is_there_after_a_restart() {
    for procedure in Procedure::ALL {
        let kept = memory();
        collect(kept, procedure, flight());
        let mut uninterrupted = memory().clone();
        let mut before = Collector::new(&mut uninterrupted);
        before.begin(procedure);
        flight().for_each(|sample| before.push(sample));
        if procedure == Procedure::Swing {
            before.mark(Mark { sample: on_circle(30.0), heading_rad: 0.5 });
        }
        let after = Collector::new(kept);
        let ((progress, fit, held_back, ..), then) = (seen(&after), seen(&before));
        assert_eq!((after.found(), after.course()), (Some(BY_HAND), Course::GoesOn), "{procedure:?}");
        assert_eq!(progress, then.0, "{procedure:?}");
        assert!(fit == then.1 && held_back == then.2, "{procedure:?}");
        assert_eq!(after.lack().is_some(), before.lack().is_some(), "{procedure:?}");
        assert!(fit.len() > 20 && held_back.len() > 5, "{procedure:?}");
        // Measurements after the last one that was kept are counted by whoever was not restarted.
        assert!(before.news() - after.news() <= 4, "{procedure:?}");
    }
}

/// Cut at any sample, with the clock of the module at zero again: what is kept at the end is as much, in the order of time,
/// and a collection of turns is complete as soon, but for the two seconds in which a bank becomes a turn, twice.
#[test]
fn a_collection_goes_on_after_a_restart() {
    let samples: Vec<Sample> = turn(-25.0, 0, 90, -13.0).chain(turn(25.0, 90, 180, 13.0)).collect();
    for cut in (50..samples.len()).step_by(97) {
        let kept = memory();
        collect(kept, Procedure::Turns, samples[..cut].iter().copied());
        let mut collector = Collector::new(kept);
        let anew = samples[cut].time;
        for &sample in &samples[cut..] {
            let time = WrappingMillis::new(300 + sample.time.since(anew));
            collector.push(Sample { time, ..sample });
            collector.keep(BY_HAND);
        }
        assert!(collector.progress().is_complete(), "{cut}: {:?}", collector.progress());
        for part in [collector.fit().left, collector.fit().right, collector.held_back().left] {
            assert!(part.is_sorted_by_key(|sample| sample.time.count()), "{cut}");
            assert!(part.windows(2).all(|two| two[1].time.since(two[0].time) >= 400), "{cut}");
        }
    }
}

/// That it is stopped, or over, and who began it.
#[test]
fn how_it_stands_is_kept() {
    let kept = memory();
    collect(kept, Procedure::Flight, flight());
    let mut collector = Collector::new(kept);
    let by_itself = Context { by_itself: true, serial: 8 };
    collector.keep(by_itself);
    let mut collector = Collector::new(kept);
    assert_eq!((collector.found(), collector.course()), (Some(by_itself), Course::GoesOn));
    collector.go_on(Course::Stopped);
    collector.keep(BY_HAND);
    let mut collector = Collector::new(kept);
    assert_eq!((collector.found(), collector.course()), (Some(BY_HAND), Course::Stopped));
    assert!(collector.is_worth_something() && collector.fit().all().next().is_some());
    collector.go_on(Course::Over);
    collector.keep(BY_HAND);
    assert!(collector.fit().all().next().is_some(), "they stay for another solve");
    let collector = Collector::new(kept);
    assert_eq!((collector.found(), collector.course()), (Some(Context::default()), Course::Over));
    assert!(collector.fit().all().next().is_none() && !collector.is_worth_something());
}

/// Ten samples to fit to are the first that are missed.
#[test]
fn a_few_samples_are_no_loss() {
    let kept = memory();
    let mut collector = Collector::new(kept);
    collector.begin(Procedure::Tumble);
    for i in 0..14_u32 {
        collector.push(sample([i as f32 * 10.0, 0.0, 0.0], i * 400));
        let fit = collector.fit().all().count();
        assert_eq!(collector.is_worth_something(), fit >= 10, "{fit}");
    }
}

/// The memory in its words.
fn words(kept: &Kept) -> Vec<u32> {
    let mut words = Vec::new();
    kept.clone().change(|word| {
        words.push(word);
        word
    });
    words
}

fn of_words(words: &[u32]) -> Kept {
    let (mut kept, mut next) = (Kept::EMPTY, words.iter());
    kept.change(|_| *next.next().expect("as many"));
    kept
}

/// A reset at any instant of a change leaves some of its words written and some not, in whatever order they are: it is found
/// as it was before, or as it was to be, or not at all. For every change of a flight that fills all buffers.
#[test]
fn a_change_that_is_cut_is_whole_or_nothing() {
    let mut random = Random(1);
    let found = |kept: &Kept| {
        let mut kept = kept.clone();
        let collector = Collector::new(&mut kept);
        collector.found().map(|_| (all(collector.fit()), all(collector.held_back())))
    };
    let kept = memory();
    let mut before: Option<Kept> = None;
    let [mut whole, mut nothing] = [0; 2];
    let mut flown: Vec<Sample> = Vec::new();
    for (i, sample) in flight().chain(flight()).enumerate() {
        flown.push(Sample { time: WrappingMillis::new(i as u32 * 100), ..sample });
        if i % 61 < 59 {
            continue;
        }
        *kept = Kept::EMPTY;
        collect(kept, Procedure::Flight, flown.iter().copied());
        let now = kept.clone();
        if let Some(before) = before.filter(|_| i % 61 == 60) {
            let (old, new) = (words(&before), words(&now));
            let changed: Vec<usize> = (0..old.len()).filter(|&at| old[at] != new[at]).collect();
            for _ in 0..40 {
                let mut mixed = old.clone();
                let share = random.byte();
                changed.iter().filter(|_| random.byte() <= share).for_each(|&at| mixed[at] = new[at]);
                match found(&of_words(&mixed)) {
                    Some(found_now) => {
                        assert!(found(&before).as_ref() == Some(&found_now) || found(&now) == Some(found_now), "{i}");
                        whole += 1;
                    }
                    None => nothing += 1,
                }
            }
        }
        before = Some(now);
    }
    assert!(nothing > 300 && whole > 5, "{whole} whole, {nothing} nothing");
}

/// A bit that is another, wherever it is: not a collection any more, unless it is where nothing is told.
#[test]
fn a_wrong_bit_is_never_taken_for_a_collection() {
    let kept = memory();
    collect(kept, Procedure::Turns, flight());
    let good = words(kept);
    let mut collector = Collector::new(kept);
    let then = seen(&collector);
    collector.forgive_restarts();
    let mut random = Random(2);
    let mut same = 0;
    for i in 0..3000 {
        let mut damaged = good.clone();
        // All of the header, and anywhere.
        let bit = if i < 32 * 19 { i } else { random.bits() as usize % (32 * good.len()) };
        damaged[bit / 32] ^= 1 << (bit % 32);
        let mut damaged = of_words(&damaged);
        let mut collector = Collector::new(&mut damaged);
        if collector.found().is_some() {
            assert!((collector.found(), seen(&collector)) == (Some(BY_HAND), then.clone()), "bit {bit}");
            same += 1;
        } else {
            assert!(collector.course() == Course::Over && all(collector.fit()).is_empty(), "bit {bit}");
            assert_eq!(collector.progress(), Progress::default(), "bit {bit}");
            collector.begin(Procedure::Flight);
        }
    }
    // Half of the memory is not in use yet.
    assert!((500..2500).contains(&same), "{same}");
}

/// What power-on leaves: any words, small ones too, which are lengths and names that there are.
#[test]
fn any_memory_is_no_collection_and_can_be_collected_in() {
    for (seed, mask) in (0..400).zip([u32::MAX, 0x1F_001F, 0xFF, 0].into_iter().cycle()) {
        let (mut random, kept) = (Random(seed), memory());
        kept.change(|_| random.bits() as u32 & mask);
        let mut collector = Collector::new(kept);
        assert_eq!((collector.found(), collector.course()), (None, Course::Over));
        assert_eq!(collector.progress(), Progress::default());
        collector.begin(Procedure::Flight);
        flight().take(30).for_each(|sample| collector.push(sample));
        assert!(collector.fit().all().all(|sample| sample.field.ut.norm() < 200.0));
    }
}

/// What another firmware has sealed.
#[test]
fn another_firmware_s_collection_is_none() {
    let kept = memory();
    collect(kept, Procedure::Turns, flight());
    let seal = |kept: &mut Kept, firmware: u32| {
        let mut copy = kept.clone();
        let collector = Collector::new(&mut copy);
        kept.header.sum = sum(firmware, &kept.header.words, collector.dataset.all(), &[]);
    };
    seal(kept, FIRMWARE ^ 1);
    assert_eq!(Collector::new(&mut kept.clone()).found(), None);
    let mut same = memory().clone();
    collect(&mut same, Procedure::Turns, flight());
    seal(&mut same, FIRMWARE);
    assert_eq!(Collector::new(&mut same).found(), Some(BY_HAND));
}

/// The third restart in a row that nobody asked for finds it; the fourth does not. A restart that was asked for, or the end of
/// a solve, begins the count anew.
#[test]
fn what_restarts_the_module_again_and_again_is_dropped() {
    let kept = memory();
    collect(kept, Procedure::Turns, flight());
    for _ in 0..3 {
        Collector::new(kept).forgive_restarts();
        assert_eq!(Collector::new(kept).found(), Some(BY_HAND));
    }
    // What was dropped is over.
    for found in [Some(BY_HAND), Some(BY_HAND), None, Some(Context::default())] {
        assert_eq!(Collector::new(kept).found(), found);
    }
    collect(kept, Procedure::Turns, flight());
    assert_eq!(Collector::new(kept).found(), Some(BY_HAND), "another begins anew");
}

/// Between samples that are kept nothing is written but what changes.
#[test]
fn a_sample_that_is_not_taken_leaves_the_memory_as_it_is() {
    let kept = memory();
    collect(kept, Procedure::Turns, flight());
    let mut collector = Collector::new(kept);
    collector.forgive_restarts();
    collector.push(banked(8.0, 0.0, 1000));
    collector.keep(BY_HAND);
    let before = words(kept);
    let mut collector = Collector::new(kept);
    collector.forgive_restarts();
    for i in 0..10 {
        collector.push(banked(8.0, 0.0, 2000 + i * 100));
        collector.keep(BY_HAND);
    }
    assert_eq!(words(kept)[2..], before[2..], "neither level nor turned");
}
