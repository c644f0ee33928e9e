use super::super::test_samples::{banked_sample, circle_sample, empty_memory, test_sample, turn_samples};
use super::*;
use crate::calibration::{CollectionPart, Side};
use crate::collection::level_limits::LevelLimits;
use crate::collection::progress::PartCoverage;

fn started_collector(procedure: Procedure) -> Collector<'static> {
    let mut collector = Collector::new(empty_memory());
    collector.begin_procedure(procedure);
    collector
}

fn hold_bank(collector: &mut Collector, roll_deg: f32, from_s: u32, to_s: u32) {
    for i in from_s * 10..to_s * 10 {
        collector.push_sample(banked_sample(roll_deg, 0.0, i * 100));
    }
}

fn sample_counts(collector: &Collector) -> [usize; 4] {
    CollectionPart::ALL_PARTS.map(|part| {
        collector.fit_samples().samples_of_part(part).len() + collector.held_back_samples().samples_of_part(part).len()
    })
}

/// A turn of 10 s: after 2 s of settling, a sample is stored every 0.4 s.
#[test]
fn turn_samples_are_stored_by_side() {
    let mut collector = started_collector(Procedure::Turns);
    hold_bank(&mut collector, -25.0, 0, 10);
    assert_eq!(
        (sample_counts(&collector), collector.collection_progress().turn_in_progress),
        ([20, 0, 0, 0], Some(Side::Left))
    );
    hold_bank(&mut collector, 25.0, 10, 20);
    assert_eq!(
        (sample_counts(&collector), collector.collection_progress().turn_in_progress),
        ([20, 20, 0, 0], Some(Side::Right))
    );
}

/// Parked near iron before the first turn; a bank of 1 s is not a turn.
#[test]
fn level_flight_counts_only_after_the_first_turn() {
    let mut collector = started_collector(Procedure::Turns);
    hold_bank(&mut collector, 0.0, 0, 10);
    hold_bank(&mut collector, 25.0, 10, 11);
    hold_bank(&mut collector, 0.0, 11, 20);
    assert_eq!(sample_counts(&collector), [0; 4]);
    hold_bank(&mut collector, 25.0, 20, 23);
    hold_bank(&mut collector, 0.0, 23, 31);
    assert_eq!(sample_counts(&collector), [0, 3, 20, 0]);
    collector.begin_procedure(Procedure::Turns);
    hold_bank(&mut collector, 0.0, 31, 40);
    assert_eq!(sample_counts(&collector), [0; 4]);
}

/// 8 deg lies within the hysteresis, which continues a turn but does not begin one.
#[test]
fn a_bank_of_8_deg_is_neither_level_nor_a_turn() {
    let mut collector = started_collector(Procedure::Turns);
    hold_bank(&mut collector, 25.0, 0, 3);
    hold_bank(&mut collector, 0.0, 3, 4);
    let before = sample_counts(&collector);
    hold_bank(&mut collector, 8.0, 4, 10);
    assert_eq!(sample_counts(&collector), before);
}

#[test]
fn level_is_seven_degrees_of_bank_and_twelve_of_pitch() {
    for procedure in [Procedure::Level, Procedure::Swing] {
        for (roll_deg, pitch_deg, is_level) in [(6.9, 11.9, true), (7.1, 0.0, false), (0.0, 12.1, false)] {
            for (roll_sign, pitch_sign) in [(1.0, 1.0), (-1.0, -1.0), (1.0, -1.0), (-1.0, 1.0)] {
                let mut collector = started_collector(procedure);
                collector.push_sample(banked_sample(roll_sign * roll_deg, pitch_sign * pitch_deg, 0));
                assert_eq!(sample_counts(&collector), [0, 0, usize::from(is_level), 0], "{roll_deg} {pitch_deg}");
            }
        }
    }
}

#[test]
fn level_begins_where_a_turn_ends() {
    let ends_rad = TurnDetectorConfig::DEFAULT.leave_roll_rad;
    assert_eq!(LevelLimits::DEFAULT.level_roll_rad.to_bits(), ends_rad.to_bits());
}

#[test]
fn a_tumbled_module_collects_every_attitude() {
    let mut collector = started_collector(Procedure::Tumble);
    for (i, roll_deg) in [0.0, 90.0, 180.0, -90.0].into_iter().enumerate() {
        let sample = Sample { field: circle_sample(roll_deg).field, ..banked_sample(roll_deg, 80.0, i as u32 * 400) };
        collector.push_sample(sample);
    }
    assert_eq!(sample_counts(&collector), [0, 0, 0, 4]);
}

/// Three circles each way at 13 deg/s, then the same without bank.
#[test]
fn a_flight_and_a_level_drive_become_complete() {
    let mut collector = started_collector(Procedure::Turns);
    for sample in turn_samples(-25.0, 0, 90, -13.0).chain(turn_samples(25.0, 90, 130, 13.0)) {
        collector.push_sample(sample);
    }
    let progress = collector.collection_progress();
    assert!(progress.coverage_of(CollectionPart::LEFT).is_complete() && !progress.is_complete(), "{progress:?}");
    turn_samples(25.0, 130, 190, 13.0).for_each(|sample| collector.push_sample(sample));
    assert!(collector.collection_progress().is_complete(), "{:?}", collector.collection_progress());
    collector.begin_procedure(Procedure::Level);
    turn_samples(0.0, 0, 60, 13.0).for_each(|sample| collector.push_sample(sample));
    assert!(collector.collection_progress().is_complete(), "{:?}", collector.collection_progress());
}

#[test]
fn there_is_room_for_thirty_six_marks() {
    let mut collector = started_collector(Procedure::Swing);
    let mark = |i: u16| HeadingMark { sample: circle_sample(f32::from(i) * 10.0), heading_rad: f32::from(i) };
    for i in 0..36 {
        assert!(collector.add_mark(mark(i)), "mark {i}");
    }
    assert!(!collector.add_mark(mark(36)));
    assert_eq!((collector.collection_progress().mark_count, collector.fit_samples().marks.len()), (36, 36));
    assert_eq!(collector.fit_samples().marks[35], mark(35));
}

#[test]
fn a_new_collection_discards_the_last_one() {
    let mut collector = started_collector(Procedure::Swing);
    collector.push_sample(banked_sample(0.0, 0.0, 0));
    collector.add_mark(HeadingMark { sample: circle_sample(0.0), heading_rad: 0.0 });
    collector.begin_procedure(Procedure::Turns);
    hold_bank(&mut collector, 25.0, 0, 5);
    assert_eq!((collector.procedure(), sample_counts(&collector)), (Procedure::Turns, [0, 8, 0, 0]));
    collector.begin_procedure(Procedure::Tumble);
    let progress = CollectionProgress { procedure: Procedure::Tumble, ..CollectionProgress::default() };
    assert_eq!((collector.collection_progress(), collector.procedure()), (progress, Procedure::Tumble));
    assert_eq!(
        (collector.fit_samples().all_samples().count(), collector.held_back_samples().all_samples().count()),
        (0, 0)
    );
}

/// The hold-back cycle, the sample interval and the distance of a tumble start again.
#[test]
fn a_new_collection_restarts_its_policy() {
    let mut collector = started_collector(Procedure::Swing);
    (0..3).for_each(|i| collector.push_sample(test_sample([i as f32, 0.0, 0.0], i * 400)));
    collector.begin_procedure(Procedure::Swing);
    collector.push_sample(test_sample([0.0; 3], 801));
    assert_eq!((collector.fit_samples().iter().count(), collector.held_back_samples().iter().count()), (1, 0));
    collector.begin_procedure(Procedure::Flight);
    (0..3).for_each(|i| collector.push_sample(test_sample([i as f32 * 2.0, 0.0, 0.0], i * 100)));
    collector.begin_procedure(Procedure::Flight);
    assert_eq!(
        (collector.collection_progress().coverage_of(CollectionPart::FREE), collector.distinct_sample_count()),
        (&PartCoverage::default(), 0)
    );
    (0..4).for_each(|i| collector.push_sample(test_sample([i as f32 * 2.0, 0.0, 0.0], i * 100)));
    assert_eq!((collector.distinct_sample_count(), collector.stored_count()), (4, 4));
    assert_eq!(collector.held_back_samples().iter().map(|sample| sample.time.as_ms()).collect::<Vec<_>>(), [300]);
    let tumble = |collector: &mut Collector, number: u32| {
        collector.begin_procedure(Procedure::Tumble);
        (0..number).for_each(|i| collector.push_sample(test_sample([i as f32 * 5.1, 0.0, 0.0], i * 400)));
        collector.fit_samples().iter().chain(collector.held_back_samples().iter()).count()
    };
    assert!(tumble(&mut collector, 300) < 252, "the distance grew");
    assert_eq!(tumble(&mut collector, 20), 20);
}

#[test]
fn a_turn_continues_while_the_clock_wraps() {
    let mut collector = started_collector(Procedure::Turns);
    for sample in turn_samples(25.0, 0, 30, 13.0) {
        let time = WrappingMillis::new(sample.time.as_ms().wrapping_sub(15_000));
        collector.push_sample(Sample { time, ..sample });
    }
    assert_eq!(sample_counts(&collector), [0, 70, 0, 0]);
}
