use testkit::random::Random;

use super::super::test_samples::{banked_sample, circle_sample, empty_memory, test_sample, turn_samples};
use super::super::{CollectionContext, CollectionProblem, CollectionProgress, CollectionState, Collector};
use super::*;
use crate::calibration::method_selection::Procedure;
use crate::calibration::{CollectionPart, Sample, Samples};
use crate::time::WrappingMillis;

const MANUAL_CONTEXT: CollectionContext = CollectionContext { is_automatic: false, calibration_serial: 7 };

/// Flight with samples for all buffers.
fn flight() -> impl Iterator<Item = Sample> {
    let legs = [(-25.0, 0, 40, -13.0), (0.0, 40, 60, 3.0), (25.0, 60, 90, 13.0), (0.0, 90, 95, 3.0)];
    legs.into_iter().flat_map(|(roll_deg, from_s, to_s, rate)| turn_samples(roll_deg, from_s, to_s, rate))
}

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

fn copy_all(samples: Samples<'_>) -> Vec<Sample> {
    samples.all_samples().copied().collect()
}

fn observable_state(
    collector: &Collector<'_>,
) -> (CollectionProgress, Vec<Sample>, Vec<Sample>, Option<CollectionProblem>, u32) {
    // The turn in progress is detected only after two seconds.
    let progress = CollectionProgress { turn_in_progress: None, ..collector.collection_progress() };
    (
        progress,
        copy_all(collector.fit_samples()),
        copy_all(collector.held_back_samples()),
        collector.collection_problem(),
        collector.distinct_sample_count(),
    )
}

#[test]
fn samples_survive_a_restart() {
    for procedure in Procedure::ALL_PROCEDURES {
        let retained = empty_memory();
        collect(retained, procedure, flight());
        let mut uninterrupted = empty_memory().clone();
        let mut before = Collector::new(&mut uninterrupted);
        before.begin_procedure(procedure);
        flight().for_each(|sample| before.push_sample(sample));
        if procedure == Procedure::Swing {
            before.add_mark(HeadingMark { sample: circle_sample(30.0), heading_rad: 0.5 });
        }
        let after = Collector::new(retained);
        let ((progress, fit, held_back, ..), then) = (observable_state(&after), observable_state(&before));
        assert_eq!(
            (after.restored_context(), after.collection_state()),
            (Some(MANUAL_CONTEXT), CollectionState::Running),
            "{procedure:?}"
        );
        assert_eq!((progress, progress.procedure), (then.0, procedure));
        assert!(fit == then.1 && held_back == then.2, "{procedure:?}");
        assert_eq!(after.collection_problem().is_some(), before.collection_problem().is_some(), "{procedure:?}");
        assert!(fit.len() > 20 && held_back.len() > 5, "{procedure:?}");
        // The count of distinct samples is retained only with a stored sample.
        assert!(before.distinct_sample_count() - after.distinct_sample_count() <= 4, "{procedure:?}");
    }
}

/// Restart at any sample, with the module's clock at zero; the collection then completes after two settling times of 2
/// s.
#[test]
fn a_collection_continues_after_a_restart() {
    let samples: Vec<Sample> = turn_samples(-25.0, 0, 90, -13.0).chain(turn_samples(25.0, 90, 180, 13.0)).collect();
    for cut in (50..samples.len()).step_by(97) {
        let retained = empty_memory();
        collect(retained, Procedure::Turns, samples[..cut].iter().copied());
        let mut collector = Collector::new(retained);
        let anew = samples[cut].time;
        for &sample in &samples[cut..] {
            let time = WrappingMillis::new(300 + sample.time.ms_since(anew));
            collector.push_sample(Sample { time, ..sample });
            collector.update_header(MANUAL_CONTEXT);
        }
        assert!(collector.collection_progress().is_complete(), "{cut}: {:?}", collector.collection_progress());
        for part in [
            collector.fit_samples().samples_of_part(CollectionPart::LEFT),
            collector.fit_samples().samples_of_part(CollectionPart::RIGHT),
            collector.held_back_samples().samples_of_part(CollectionPart::LEFT),
        ] {
            assert!(part.is_sorted_by_key(|sample| sample.time.as_ms()), "{cut}");
            assert!(part.windows(2).all(|two| two[1].time.ms_since(two[0].time) >= 400), "{cut}");
        }
    }
}

#[test]
fn state_and_context_are_stored() {
    let retained = empty_memory();
    collect(retained, Procedure::Flight, flight());
    let mut collector = Collector::new(retained);
    let automatic = CollectionContext { is_automatic: true, calibration_serial: 8 };
    collector.update_header(automatic);
    let mut collector = Collector::new(retained);
    assert_eq!(
        (collector.restored_context(), collector.collection_state()),
        (Some(automatic), CollectionState::Running)
    );
    collector.set_state(CollectionState::Stopped);
    collector.update_header(MANUAL_CONTEXT);
    let mut collector = Collector::new(retained);
    assert_eq!(
        (collector.restored_context(), collector.collection_state()),
        (Some(MANUAL_CONTEXT), CollectionState::Stopped)
    );
    assert!(collector.is_loss_reportable() && collector.fit_samples().all_samples().next().is_some());
    collector.set_state(CollectionState::Inactive);
    collector.update_header(MANUAL_CONTEXT);
    assert!(collector.fit_samples().all_samples().next().is_some(), "they stay for another solve");
    let collector = Collector::new(retained);
    assert_eq!(
        (collector.restored_context(), collector.collection_state()),
        (Some(CollectionContext::default()), CollectionState::Inactive)
    );
    assert!(collector.fit_samples().all_samples().next().is_none() && !collector.is_loss_reportable());
}

#[test]
fn losing_few_samples_is_not_reported() {
    let retained = empty_memory();
    let mut collector = Collector::new(retained);
    collector.begin_procedure(Procedure::Tumble);
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
    let mut random = Random(1);
    let found = |retained: &RetainedSamples| {
        let mut retained = retained.clone();
        let collector = Collector::new(&mut retained);
        collector
            .restored_context()
            .map(|_| (copy_all(collector.fit_samples()), copy_all(collector.held_back_samples())))
    };
    let retained = empty_memory();
    let mut before: Option<RetainedSamples> = None;
    let [mut whole, mut nothing] = [0; 2];
    let mut offered: Vec<Sample> = Vec::new();
    for (i, sample) in flight().chain(flight()).enumerate() {
        offered.push(Sample { time: WrappingMillis::new(i as u32 * 100), ..sample });
        if i % 61 < 59 {
            continue;
        }
        *retained = RetainedSamples::EMPTY;
        collect(retained, Procedure::Flight, offered.iter().copied());
        let now = retained.clone();
        if let Some(before) = before.filter(|_| i % 61 == 60) {
            let (old, new) = (memory_words(&before), memory_words(&now));
            let changed: Vec<usize> = (0..old.len()).filter(|&at| old[at] != new[at]).collect();
            for trial in 0..40 {
                let mut mixed = old.clone();
                // The first trial replaces no word, the last trial all words.
                let share = if trial == 0 {
                    0
                } else if trial == 39 {
                    256
                } else {
                    1 + u16::from(random.byte())
                };
                changed.iter().filter(|_| u16::from(random.byte()) < share).for_each(|&at| mixed[at] = new[at]);
                match found(&memory_from_words(&mixed)) {
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

#[test]
fn a_flipped_bit_invalidates_the_memory() {
    let retained = empty_memory();
    collect(retained, Procedure::Turns, flight());
    let good = memory_words(retained);
    let mut collector = Collector::new(retained);
    let state_before = observable_state(&collector);
    collector.reset_restart_count();
    let mut random = Random(2);
    let mut same = 0;
    for i in 0..3000 {
        let mut damaged = good.clone();
        let bit = if i < 32 * 19 { i } else { random.bits() as usize % (32 * good.len()) };
        damaged[bit / 32] ^= 1 << (bit % 32);
        let mut damaged = memory_from_words(&damaged);
        let mut collector = Collector::new(&mut damaged);
        if collector.restored_context().is_some() {
            assert!(
                (collector.restored_context(), observable_state(&collector))
                    == (Some(MANUAL_CONTEXT), state_before.clone()),
                "bit {bit}"
            );
            same += 1;
        } else {
            assert!(
                collector.collection_state() == CollectionState::Inactive
                    && copy_all(collector.fit_samples()).is_empty(),
                "bit {bit}"
            );
            assert_eq!(collector.collection_progress(), CollectionProgress::default(), "bit {bit}");
            collector.begin_procedure(Procedure::Flight);
        }
    }
    // Half of the memory is unused.
    assert!((500..2500).contains(&same), "{same}");
}

/// Power-on content: random words, masked to small values that are plausible lengths and enum values.
#[test]
fn random_memory_is_rejected_and_usable() {
    for (seed, mask) in (0..400).zip([u32::MAX, 0x1F_001F, 0xFF, 0].into_iter().cycle()) {
        let (mut random, retained) = (Random(seed), empty_memory());
        retained.transform_words(|_| random.bits() as u32 & mask);
        let mut collector = Collector::new(retained);
        assert_eq!((collector.restored_context(), collector.collection_state()), (None, CollectionState::Inactive));
        assert_eq!(collector.collection_progress(), CollectionProgress::default());
        collector.begin_procedure(Procedure::Flight);
        flight().take(30).for_each(|sample| collector.push_sample(sample));
        assert!(collector.fit_samples().all_samples().all(|sample| sample.field.ut.norm() < 200.0));
    }
}

#[test]
fn another_use_of_a_sample_invalidates_the_memory() {
    let retained = empty_memory();
    collect(retained, Procedure::Turns, flight());
    retained.samples.fit_count += 1;
    retained.samples.held_back_count -= 1;
    assert_eq!(Collector::new(retained).restored_context(), None);
}

#[test]
fn memory_of_other_firmware_is_rejected() {
    let retained = empty_memory();
    collect(retained, Procedure::Turns, flight());
    for (firmware, found) in [(FIRMWARE_SEED ^ 1, None), (FIRMWARE_SEED, Some(MANUAL_CONTEXT))] {
        retained.checksum = retained.compute_checksum(firmware);
        assert_eq!(Collector::new(&mut retained.clone()).restored_context(), found);
    }
}

/// The collection is discarded at the fourth unexpected restart; a requested restart or a completed solve resets the
/// count.
#[test]
fn a_collection_is_discarded_after_repeated_restarts() {
    let retained = empty_memory();
    collect(retained, Procedure::Turns, flight());
    for _ in 0..3 {
        Collector::new(retained).reset_restart_count();
        assert_eq!(Collector::new(retained).restored_context(), Some(MANUAL_CONTEXT));
    }
    for found in [Some(MANUAL_CONTEXT), Some(MANUAL_CONTEXT), None, Some(CollectionContext::default())] {
        assert_eq!(Collector::new(retained).restored_context(), found);
    }
    collect(retained, Procedure::Turns, flight());
    assert_eq!(Collector::new(retained).restored_context(), Some(MANUAL_CONTEXT), "another begins anew");
}

#[test]
fn a_sample_that_is_not_stored_does_not_change_the_memory() {
    let retained = empty_memory();
    collect(retained, Procedure::Turns, flight());
    let mut collector = Collector::new(retained);
    collector.reset_restart_count();
    collector.push_sample(banked_sample(8.0, 0.0, 1000));
    collector.update_header(MANUAL_CONTEXT);
    let before = memory_words(retained);
    let mut collector = Collector::new(retained);
    collector.reset_restart_count();
    for i in 0..10 {
        collector.push_sample(banked_sample(8.0, 0.0, 2000 + i * 100));
        collector.update_header(MANUAL_CONTEXT);
    }
    assert_eq!(memory_words(retained)[2..], before[2..], "neither level nor turned");
}
