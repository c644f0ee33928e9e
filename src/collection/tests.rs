use super::testing::{banked, memory, on_circle, turn};
use super::*;
use crate::time::WrappingMillis;

fn beginning(procedure: Procedure) -> Collector<'static> {
    let mut collector = Collector::new(memory());
    collector.begin(procedure);
    collector
}

/// Pushes a bank, held from one second to another, at 10 Hz.
fn hold(collector: &mut Collector, roll_deg: f32, from_s: u32, to_s: u32) {
    for i in from_s * 10..to_s * 10 {
        collector.push(banked(roll_deg, 0.0, i * 100));
    }
}

/// Samples of left turns, right turns and level flight, held back or not.
fn numbers(collector: &Collector) -> [usize; 3] {
    let (fit, held_back) = (collector.fit(), collector.held_back());
    [
        fit.left.len() + held_back.left.len(),
        fit.right.len() + held_back.right.len(),
        fit.level.len() + held_back.level.len(),
    ]
}

/// 10 s of a turn: 8 s after settling, a sample every 0.4 s.
#[test]
fn turns_go_to_their_side() {
    let mut collector = beginning(Procedure::Turns);
    hold(&mut collector, -25.0, 0, 10);
    assert_eq!((numbers(&collector), collector.progress().turning), ([20, 0, 0], Some(Side::Left)));
    hold(&mut collector, 25.0, 10, 20);
    assert_eq!((numbers(&collector), collector.progress().turning), ([20, 20, 0], Some(Side::Right)));
}

/// The aircraft may stand beside a hangar until it turns in the air; a bank that is not sustained is no turn.
#[test]
fn level_flight_counts_only_after_the_first_turn() {
    let mut collector = beginning(Procedure::Turns);
    hold(&mut collector, 0.0, 0, 10);
    hold(&mut collector, 25.0, 10, 11);
    hold(&mut collector, 0.0, 11, 20);
    assert_eq!(numbers(&collector), [0, 0, 0]);
    hold(&mut collector, 25.0, 20, 23);
    hold(&mut collector, 0.0, 23, 31);
    assert_eq!(numbers(&collector), [0, 3, 20]);
    // The next collection has turned as little as the first.
    collector.begin(Procedure::Turns);
    hold(&mut collector, 0.0, 31, 40);
    assert_eq!(numbers(&collector), [0, 0, 0]);
}

/// 8 deg of bank is neither level nor a turn; in a turn that is flattening it still is one.
#[test]
fn a_low_wing_is_neither_level_nor_a_turn() {
    let mut collector = beginning(Procedure::Turns);
    hold(&mut collector, 25.0, 0, 3);
    hold(&mut collector, 0.0, 3, 4);
    let before = numbers(&collector);
    hold(&mut collector, 8.0, 4, 10);
    assert_eq!(numbers(&collector), before);
}

#[test]
fn level_is_seven_degrees_of_bank_and_twelve_of_pitch() {
    for procedure in [Procedure::Level, Procedure::Swing] {
        for (roll_deg, pitch_deg, is_level) in [(6.9, 11.9, true), (7.1, 0.0, false), (0.0, 12.1, false)] {
            for (roll_sign, pitch_sign) in [(1.0, 1.0), (-1.0, -1.0), (1.0, -1.0), (-1.0, 1.0)] {
                let mut collector = beginning(procedure);
                collector.push(banked(roll_sign * roll_deg, pitch_sign * pitch_deg, 0));
                assert_eq!(numbers(&collector), [0, 0, usize::from(is_level)], "{roll_deg} {pitch_deg}");
            }
        }
    }
}

/// Level by the collection's limit is what a turn has ended at, and a turn begins where level samples show no more.
#[test]
fn level_begins_where_a_turn_ends() {
    let ends_rad = detector::Config::DEFAULT.leave_roll_rad;
    assert_eq!(Config::DEFAULT.level_roll_rad.to_bits(), ends_rad.to_bits());
}

#[test]
fn a_tumbled_module_collects_every_attitude() {
    let mut collector = beginning(Procedure::Tumble);
    for (i, roll_deg) in [0.0, 90.0, 180.0, -90.0].into_iter().enumerate() {
        let sample = Sample { field: on_circle(roll_deg).field, ..banked(roll_deg, 80.0, i as u32 * 400) };
        collector.push(sample);
    }
    assert_eq!(numbers(&collector), [4, 0, 0]);
}

#[test]
fn a_collection_is_complete_by_its_procedure() {
    let full = Coverage { percent: 100, ..Coverage::default() };
    let part = Coverage { percent: 99, ..full };
    let is_complete = |procedure, [left, right, level]: [Coverage; 3]| {
        Progress { procedure, left, right, level, ..Progress::default() }.is_complete()
    };
    assert!(is_complete(Procedure::Turns, [full, full, part]));
    assert!(!is_complete(Procedure::Turns, [full, part, full]));
    assert!(!is_complete(Procedure::Turns, [part, full, full]));
    assert!(is_complete(Procedure::Level, [part, part, full]));
    assert!(!is_complete(Procedure::Level, [full, full, part]));
    assert!(!is_complete(Procedure::Swing, [full; 3]));
    assert!(!is_complete(Procedure::Tumble, [full; 3]));
}

/// Three circles each way at 13 deg/s, then level; and the same on the ground.
#[test]
fn a_flight_and_a_level_drive_become_complete() {
    let mut collector = beginning(Procedure::Turns);
    for sample in turn(-25.0, 0, 90, -13.0).chain(turn(25.0, 90, 130, 13.0)) {
        collector.push(sample);
    }
    let flown = collector.progress();
    assert!(flown.left.is_complete() && !flown.is_complete(), "{flown:?}");
    turn(25.0, 130, 190, 13.0).for_each(|sample| collector.push(sample));
    assert!(collector.progress().is_complete(), "{:?}", collector.progress());
    collector.begin(Procedure::Level);
    turn(0.0, 0, 60, 13.0).for_each(|sample| collector.push(sample));
    assert!(collector.progress().is_complete(), "{:?}", collector.progress());
}

#[test]
fn there_is_room_for_thirty_six_marks() {
    let mut collector = beginning(Procedure::Swing);
    let mark = |i: u16| Mark { sample: on_circle(f32::from(i) * 10.0), heading_rad: f32::from(i) };
    for i in 0..36 {
        assert!(collector.mark(mark(i)), "mark {i}");
    }
    assert!(!collector.mark(mark(36)));
    assert_eq!((collector.progress().marks, collector.fit().marks.len()), (36, 36));
    assert_eq!(collector.fit().marks[35], mark(35));
}

#[test]
fn a_new_collection_forgets_the_last_one() {
    let mut collector = beginning(Procedure::Swing);
    collector.push(banked(0.0, 0.0, 0));
    collector.mark(Mark { sample: on_circle(0.0), heading_rad: 0.0 });
    collector.begin(Procedure::Turns);
    hold(&mut collector, 25.0, 0, 5);
    assert_eq!((collector.procedure(), numbers(&collector)), (Procedure::Turns, [0, 8, 0]));
    collector.begin(Procedure::Tumble);
    let progress = Progress { procedure: Procedure::Tumble, ..Progress::default() };
    assert_eq!((collector.progress(), collector.procedure()), (progress, Procedure::Tumble));
    assert_eq!((collector.fit().all().count(), collector.held_back().all().count()), (0, 0));
}

/// The clock may have wrapped between two samples: half a minute of a turn across it is as good as any.
#[test]
fn a_turn_goes_on_while_the_milliseconds_wrap() {
    let mut collector = beginning(Procedure::Turns);
    for sample in turn(25.0, 0, 30, 13.0) {
        let time = WrappingMillis::new(sample.time.count().wrapping_sub(15_000));
        collector.push(Sample { time, ..sample });
    }
    assert_eq!(numbers(&collector), [0, 70, 0]);
}
