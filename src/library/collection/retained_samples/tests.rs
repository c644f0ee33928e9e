use testkit::random::Random;

use super::super::test_samples::{banked_sample, circle_sample, collected, test_sample, turn_samples};
use super::super::{CollectionContext, CollectionProblem, CollectionProgress, CollectionState, Collector};
use super::*;
use crate::calibration::Sample;
use crate::calibration::method_selection::Procedure;
use crate::time::WrappingMillis;

const MANUAL_CONTEXT: CollectionContext = CollectionContext { is_automatic: false, calibration_serial: 7 };

/// Flight with samples for all buffers.
fn flight() -> impl Iterator<Item = Sample> {
    let legs = [(-25.0, 0, 40, -13.0), (0.0, 40, 60, 3.0), (25.0, 60, 90, 13.0), (0.0, 90, 95, 3.0)];
    legs.into_iter().flat_map(|(roll_deg, from_s, to_s, rate)| turn_samples(roll_deg, from_s, to_s, rate))
}

/// A collection of the flight, sealed after each sample, and with a mark in a swing.
fn collect(retained: &mut RetainedSamples, procedure: Procedure, samples: impl Iterator<Item = Sample>) {
    let mut collector = Collector::new(retained);
    collector.begin_procedure(procedure);
    for sample in samples {
        collector.push_sample(sample);
        collector.update_header(MANUAL_CONTEXT);
    }
    if procedure == Procedure::Swing {
        assert!(collector.add_mark(HeadingMark { sample: circle_sample(30.0), heading_rad: 0.5 }));
        collector.update_header(MANUAL_CONTEXT);
    }
}

/// Memory with a collection of the whole flight.
fn memory_after_flight(procedure: Procedure) -> RetainedSamples {
    let mut retained = RetainedSamples::EMPTY;
    collect(&mut retained, procedure, flight());
    retained
}

/// Fit and held-back samples.
fn stored_samples(collector: &Collector<'_>) -> [Vec<Sample>; 2] {
    [collector.fit_samples(), collector.held_back_samples()].map(|samples| samples.all_samples().copied().collect())
}

/// Progress without the turn in progress, which is detected only after two seconds.
fn progress(collector: &Collector<'_>) -> CollectionProgress {
    CollectionProgress { turn_in_progress: None, ..collector.collection_progress() }
}

fn observable_state(
    collector: &Collector<'_>,
) -> (CollectionProgress, [Vec<Sample>; 2], Option<CollectionProblem>, u16) {
    let counts = collector.taken_count();
    (progress(collector), stored_samples(collector), collector.collection_problem(), counts)
}

#[test]
fn samples_survive_a_restart() {
    for procedure in Procedure::ALL_PROCEDURES {
        let mut uninterrupted = RetainedSamples::EMPTY;
        let mut before = Collector::new(&mut uninterrupted);
        before.begin_procedure(procedure);
        flight().for_each(|sample| before.push_sample(sample));
        if procedure == Procedure::Swing {
            before.add_mark(HeadingMark { sample: circle_sample(30.0), heading_rad: 0.5 });
        }
        let mut retained = memory_after_flight(procedure);
        let after = Collector::new(&mut retained);
        assert_eq!(after.restored_context(), Some(MANUAL_CONTEXT), "{procedure:?}");
        assert_eq!((after.collection_state(), after.procedure()), (CollectionState::Running, procedure));
        assert_eq!(progress(&after), progress(&before));
        let stored = stored_samples(&after);
        assert!(stored == stored_samples(&before), "{procedure:?}");
        assert!(stored[0].len() > 20 && stored[1].len() > 5, "{procedure:?}");
        assert_eq!(after.collection_problem().is_some(), before.collection_problem().is_some(), "{procedure:?}");
        assert_eq!(before.taken_count(), after.taken_count(), "{procedure:?}");
    }
}

/// The samples of an ended collection stay for another solve, until a restart.
#[test]
fn state_and_context_are_stored() {
    let mut retained = memory_after_flight(Procedure::Flight);
    let automatic = CollectionContext { is_automatic: true, calibration_serial: 8 };
    let ended = CollectionContext::default();
    for (state, context, restored_context, is_kept) in [
        (CollectionState::Running, automatic, automatic, true),
        (CollectionState::Stopped, MANUAL_CONTEXT, MANUAL_CONTEXT, true),
        (CollectionState::Inactive, MANUAL_CONTEXT, ended, false),
    ] {
        let mut collector = Collector::new(&mut retained);
        collector.reset_restart_count();
        collector.set_state(state);
        collector.update_header(context);
        assert!(!stored_samples(&collector)[0].is_empty(), "{state:?}");
        let restored = Collector::new(&mut retained);
        assert_eq!((restored.restored_context(), restored.collection_state()), (Some(restored_context), state));
        assert_eq!((!stored_samples(&restored)[0].is_empty(), restored.is_loss_reportable()), (is_kept, is_kept));
    }
}

#[test]
fn losing_few_samples_is_not_reported() {
    let mut collector = collected(Procedure::Tumble, []);
    for i in 0..14_u32 {
        collector.push_sample(test_sample([i as f32 * 10.0, 0.0, 0.0], i * 400));
        let fit = collector.fit_samples().all_samples().count();
        assert_eq!(collector.is_loss_reportable(), fit >= 10, "{fit}");
    }
}

fn memory_words(retained: &RetainedSamples) -> Vec<u32> {
    let mut words = Vec::new();
    retained.clone().transform_words(|word| {
        words.push(word);
        word
    });
    words
}

fn memory_from_words(words: &[u32]) -> RetainedSamples {
    let (mut retained, mut next) = (RetainedSamples::EMPTY, words.iter());
    retained.transform_words(|_| *next.next().expect("as many"));
    retained
}

/// A reset during a change writes any subset of the changed words. Memory is then valid with the old or the new
/// content, or invalid. Tested for changes throughout a flight that fills all buffers.
#[test]
fn an_interrupted_change_is_atomic() {
    let restore = |mut retained: RetainedSamples| {
        let collector = Collector::new(&mut retained);
        collector.restored_context().map(|_| stored_samples(&collector))
    };
    let offered: Vec<Sample> = flight()
        .chain(flight())
        .zip(0..)
        .map(|(sample, i)| Sample { time: WrappingMillis::new(i * 100), ..sample })
        .collect();
    let (mut random, mut valid_count, mut invalid_count) = (Random(1), 0, 0);
    for number in (60..offered.len()).step_by(61) {
        let [old, new] = [number, number + 1].map(|number| {
            let mut retained = RetainedSamples::EMPTY;
            collect(&mut retained, Procedure::Flight, offered[..number].iter().copied());
            memory_words(&retained)
        });
        let [before, after] = [&old, &new].map(|words| restore(memory_from_words(words)));
        let changed: Vec<usize> = (0..old.len()).filter(|&at| old[at] != new[at]).collect();
        for trial in 0..40 {
            // The first trial replaces no word, the last trial all words.
            let share = match trial {
                0 => 0,
                39 => 256,
                _ => 1 + u16::from(random.byte()),
            };
            let mut mixed = old.clone();
            changed.iter().filter(|_| u16::from(random.byte()) < share).for_each(|&at| mixed[at] = new[at]);
            let found = restore(memory_from_words(&mixed));
            assert!(found.is_none() || found == before || found == after, "{number}");
            *(if found.is_some() { &mut valid_count } else { &mut invalid_count }) += 1;
        }
    }
    assert!(invalid_count > 300 && valid_count > 5, "{valid_count} valid, {invalid_count} invalid");
}

/// Except for bits of unused memory.
#[test]
fn a_flipped_bit_invalidates_the_memory() {
    let mut retained = memory_after_flight(Procedure::Turns);
    let good = memory_words(&retained);
    let state_before = observable_state(&Collector::new(&mut retained));
    let (mut random, mut same_count) = (Random(2), 0);
    for i in 0..3000 {
        let mut damaged = good.clone();
        let bit = if i < 32 * 19 { i } else { random.bits() as usize % (32 * good.len()) };
        damaged[bit / 32] ^= 1 << (bit % 32);
        let mut damaged = memory_from_words(&damaged);
        let mut collector = Collector::new(&mut damaged);
        if let Some(context) = collector.restored_context() {
            assert!((context, observable_state(&collector)) == (MANUAL_CONTEXT, state_before.clone()), "bit {bit}");
            same_count += 1;
        } else {
            assert_discarded(&collector);
            collector.begin_procedure(Procedure::Flight);
        }
    }
    // Half of the memory is unused.
    assert!((500..2500).contains(&same_count), "{same_count}");
}

fn assert_discarded(collector: &Collector<'_>) {
    assert_eq!((collector.restored_context(), collector.collection_state()), (None, CollectionState::Inactive));
    assert_eq!((collector.collection_progress(), stored_samples(collector)), <_>::default());
}

/// Power-on content: random words, masked to small values that are plausible lengths and enum values.
#[test]
fn random_memory_is_rejected_and_usable() {
    for (seed, mask) in (0..400).zip([u32::MAX, 0x1F_001F, 0xFF, 0].into_iter().cycle()) {
        let (mut random, mut retained) = (Random(seed), RetainedSamples::EMPTY);
        retained.transform_words(|_| random.bits() as u32 & mask);
        let mut collector = Collector::new(&mut retained);
        assert_discarded(&collector);
        collector.begin_procedure(Procedure::Flight);
        flight().take(30).for_each(|sample| collector.push_sample(sample));
        assert!(collector.fit_samples().all_samples().all(|sample| sample.field.ut.norm() < 200.0));
    }
}

#[test]
fn another_use_of_a_sample_or_a_changed_mark_invalidates_the_memory() {
    let mut turns = memory_after_flight(Procedure::Turns);
    turns.samples.fit_count += 1;
    turns.samples.held_back_count -= 1;
    let mut swing = memory_after_flight(Procedure::Swing);
    swing.marks[0].heading_rad += 0.1;
    for retained in [&mut turns, &mut swing] {
        assert_eq!(Collector::new(retained).restored_context(), None);
    }
}

#[test]
fn memory_of_other_firmware_is_rejected() {
    let mut retained = memory_after_flight(Procedure::Turns);
    for (firmware, found) in [(FIRMWARE_SEED ^ 1, None), (FIRMWARE_SEED, Some(MANUAL_CONTEXT))] {
        retained.checksum = retained.compute_checksum(firmware);
        assert_eq!(Collector::new(&mut retained.clone()).restored_context(), found);
    }
}

/// The collection is discarded at the fourth unexpected restart; a requested restart or a completed solve resets the
/// count.
#[test]
fn a_collection_is_discarded_after_repeated_restarts() {
    let mut retained = memory_after_flight(Procedure::Turns);
    let restart = |retained: &mut RetainedSamples| Collector::new(retained).restored_context();
    for _ in 0..3 {
        Collector::new(&mut retained).reset_restart_count();
        assert_eq!(restart(&mut retained), Some(MANUAL_CONTEXT));
    }
    for found in [Some(MANUAL_CONTEXT), Some(MANUAL_CONTEXT), None, Some(CollectionContext::default())] {
        assert_eq!(restart(&mut retained), found);
    }
    collect(&mut retained, Procedure::Turns, flight());
    assert_eq!(restart(&mut retained), Some(MANUAL_CONTEXT), "a new collection");
}

/// A bank of 8 deg is neither level nor a turn.
#[test]
fn a_sample_that_is_not_stored_does_not_change_the_memory() {
    let mut retained = memory_after_flight(Procedure::Turns);
    let mut words_after = |samples: u32| {
        let mut collector = Collector::new(&mut retained);
        for i in 0..samples {
            collector.push_sample(banked_sample(8.0, 0.0, 1000 + i * 100));
            collector.update_header(MANUAL_CONTEXT);
        }
        // Without the count of restarts.
        memory_words(&retained)[2..].to_vec()
    };
    assert_eq!(words_after(1), words_after(10));
}
