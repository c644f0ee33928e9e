use super::super::test_samples::{banked_sample, circle_sample, collected, stored_times_ms, test_sample, turn_samples};
use super::*;
use crate::frames::RollPitch;

fn hold_bank(collector: &mut Collector, roll_deg: f32, from_s: u32, to_s: u32) {
    for i in from_s * 10..to_s * 10 {
        collector.push_sample(banked_sample(roll_deg, 0.0, i * 100));
    }
}

/// Numbers of fit and held-back samples of each part: left, right, level, free.
fn sample_counts(collector: &Collector) -> [[usize; 2]; 4] {
    CollectionPart::ALL_PARTS.map(|part| stored_times_ms(collector, part).map(|times_ms| times_ms.len()))
}

const NO_SAMPLES: [[usize; 2]; 4] = [[0; 2]; 4];

/// A turn of 10 s: after 2 s of settling, a sample is stored every 0.4 s, every fourth held back.
#[test]
fn turn_samples_are_stored_by_side() {
    let mut collector = collected(Procedure::Turns, []);
    hold_bank(&mut collector, -25.0, 0, 10);
    assert_eq!(sample_counts(&collector), [[15, 5], [0, 0], [0, 0], [0, 0]]);
    assert_eq!(collector.collection_progress().turn_in_progress, Some(CollectionPart::LEFT));
    hold_bank(&mut collector, 25.0, 10, 20);
    assert_eq!(sample_counts(&collector), [[15, 5], [15, 5], [0, 0], [0, 0]]);
    assert_eq!(collector.collection_progress().turn_in_progress, Some(CollectionPart::RIGHT));
}

/// Parked near iron before the first turn; a bank of 1 s is not a turn.
#[test]
fn level_flight_counts_only_after_the_first_turn() {
    let mut collector = collected(Procedure::Turns, []);
    hold_bank(&mut collector, 0.0, 0, 10);
    hold_bank(&mut collector, 25.0, 10, 11);
    hold_bank(&mut collector, 0.0, 11, 20);
    assert_eq!(sample_counts(&collector), NO_SAMPLES);
    hold_bank(&mut collector, 25.0, 20, 23);
    hold_bank(&mut collector, 0.0, 23, 31);
    assert_eq!(sample_counts(&collector), [[0, 0], [3, 0], [15, 5], [0, 0]]);
    collector.begin_procedure(Procedure::Turns);
    hold_bank(&mut collector, 0.0, 31, 40);
    assert_eq!(sample_counts(&collector), NO_SAMPLES);
}

/// The hysteresis continues a turn but does not begin one. Level begins where a turn ends.
#[test]
fn a_bank_of_8_deg_is_neither_level_nor_a_turn() {
    let mut collector = collected(Procedure::Turns, []);
    hold_bank(&mut collector, 25.0, 0, 3);
    hold_bank(&mut collector, 0.0, 3, 4);
    let before = sample_counts(&collector);
    hold_bank(&mut collector, 8.0, 4, 10);
    assert_eq!(sample_counts(&collector), before);
}

/// Level are 7 deg of bank and 12 deg of pitch, in which a vehicle on wheels and a hover stay.
#[test]
fn level_procedures_store_level_samples_and_a_tumble_every_attitude() {
    for (roll_deg, pitch_deg, is_level) in [
        (6.0, 11.0, true),
        (-6.0, -11.0, true),
        (8.0, 0.0, false),
        (-8.0, 0.0, false),
        (0.0, 13.0, false),
        (0.0, -13.0, false),
    ] {
        for procedure in [Procedure::Level, Procedure::Swing] {
            let collector = collected(procedure, [banked_sample(roll_deg, pitch_deg, 0)]);
            assert_eq!(sample_counts(&collector)[2][0], usize::from(is_level), "{roll_deg} {pitch_deg}");
        }
    }
    let tumbled = [0.0, 90.0, 180.0, -90.0].into_iter().zip(0..).map(|(roll_deg, i)| {
        let field = circle_sample(roll_deg).field;
        Sample { field, ..banked_sample(roll_deg, 80.0, i * 400) }
    });
    assert_eq!(sample_counts(&collected(Procedure::Tumble, tumbled)), [[0, 0], [0, 0], [0, 0], [3, 1]]);
}

/// The attitude's errors are correlated over half a second. A sample that is too early does not count. The clock wraps
/// during the collection.
#[test]
fn samples_are_stored_every_0_4_s_and_every_fourth_is_held_back() {
    for (procedure, part) in [(Procedure::Level, CollectionPart::LEVEL), (Procedure::Swing, CollectionPart::LEVEL)] {
        for (interval_ms, samples_per_stored) in [(400, 1), (300, 2), (100, 4)] {
            let number = 13 * samples_per_stored;
            let time_ms = |i: u32| (i * interval_ms).wrapping_sub(1000);
            let collector =
                collected(procedure, (0..number).map(|i| test_sample([i as f32 * 6.0, 0.0, 0.0], time_ms(i))));
            let (held_back, fit) = (0..13).partition::<Vec<u32>, _>(|i| i % 4 == 3);
            let expected = [fit, held_back]
                .map(|stored| stored.iter().map(|i| time_ms(i * samples_per_stored)).collect::<Vec<_>>());
            assert_eq!(stored_times_ms(&collector, part), expected, "{procedure:?} {interval_ms}");
        }
    }
}

#[test]
fn nonfinite_samples_are_rejected_and_extreme_ones_do_not_panic() {
    let extreme = [0.0, f32::NAN, f32::INFINITY, f32::NEG_INFINITY, f32::MAX, 1e-30, -400.0];
    let fields = (0..600_usize).map(|i| [extreme[i % 7], extreme[i / 7 % 7], extreme[i / 49 % 7]]);
    for procedure in Procedure::ALL_PROCEDURES {
        let samples = fields.clone().zip(0..).map(|(field_ut, i)| Sample {
            attitude: RollPitch::from_deg(if procedure == Procedure::Turns { 25.0 } else { 0.0 }, 0.0),
            ..test_sample(field_ut, i * 400)
        });
        let collector = collected(procedure, samples);
        let mut stored = collector.fit_samples().iter().chain(collector.held_back_samples().iter());
        assert!(stored.clone().count() > 3, "{procedure:?}");
        assert!(stored.all(|sample| sample.field.ut.iter().all(|ut| ut.is_finite())), "{procedure:?}");
    }
}

/// Three circles each way at 13 deg/s, then the same without bank.
#[test]
fn a_flight_and_a_level_drive_become_complete() {
    let flight = turn_samples(-25.0, 0, 90, -13.0).chain(turn_samples(25.0, 90, 130, 13.0));
    let mut collector = collected(Procedure::Turns, flight);
    let progress = collector.collection_progress();
    assert!(progress.coverage_of(CollectionPart::LEFT).is_complete() && !progress.is_complete(), "{progress:?}");
    turn_samples(25.0, 130, 190, 13.0).for_each(|sample| collector.push_sample(sample));
    assert!(collector.collection_progress().is_complete(), "{:?}", collector.collection_progress());
    let drive = collected(Procedure::Level, turn_samples(0.0, 0, 60, 13.0)).collection_progress();
    assert!(drive.is_complete(), "{drive:?}");
}

/// Ten minutes of left circles fill the buffer; three right ones complete the collection and are kept.
#[test]
fn one_side_leaves_room_for_the_other() {
    let mut collector = collected(Procedure::Turns, turn_samples(-25.0, 0, 600, -13.0));
    let [[full, _], ..] = sample_counts(&collector);
    turn_samples(25.0, 600, 690, 13.0).for_each(|sample| collector.push_sample(sample));
    assert!(collector.collection_progress().is_complete(), "{:?}", collector.collection_progress());
    let [[left, _], [right, _], ..] = sample_counts(&collector);
    assert_eq!((full, left + right), (448, 448));
    assert!(right > 140, "{right} of some 165 offered");
}

/// Also the hold-back cycle and the sample interval start again.
#[test]
fn a_new_collection_is_as_if_it_were_the_first() {
    let samples = |number: u32| (0..number).map(|i| test_sample([i as f32 * 5.1, 0.0, 0.0], i * 400));
    let later = || samples(21).map(|sample| Sample { time: sample.time.plus_ms(125_000), ..sample });
    for procedure in Procedure::ALL_PROCEDURES {
        let state = |collector: &Collector| {
            let stored = CollectionPart::ALL_PARTS.map(|part| stored_times_ms(collector, part));
            let marks = collector.fit_samples().marks.to_vec();
            let counts = (collector.taken_count(), collector.stored_count());
            (collector.collection_progress(), collector.procedure(), stored, marks, counts)
        };
        let first = state(&collected(procedure, later()));
        for last_procedure in Procedure::ALL_PROCEDURES {
            let mut collector = collected(last_procedure, samples(300));
            collector.add_mark(HeadingMark { sample: circle_sample(0.0), heading_rad: 0.0 });
            hold_bank(&mut collector, 25.0, 120, 124);
            collector.push_sample(test_sample([3000.0, 0.0, 0.0], 124_900));
            collector.begin_procedure(procedure);
            later().for_each(|sample| collector.push_sample(sample));
            assert_eq!(state(&collector), first, "{procedure:?} after {last_procedure:?}");
        }
    }
}
