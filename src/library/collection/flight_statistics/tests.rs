//! Unit tests of `flight_statistics`.

use super::super::Collector;
use super::super::test_samples::{banked_sample, empty_memory, turn_samples};
use super::*;
use crate::calibration::method_selection::Procedure;

fn diagnose_banks(step_ms: u32, banks: &[(f32, u32)]) -> Option<CollectionProblem> {
    let (mut statistics, mut filter) = (FlightStatistics::EMPTY, TiltFilter::NOT_STARTED);
    let mut time_ms = u32::MAX - 5000;
    for &(roll_deg, seconds) in banks {
        for _ in 0..seconds * 1000 / step_ms {
            statistics.add_sample(&mut filter, &banked_sample(roll_deg, 0.0, time_ms));
            time_ms = time_ms.wrapping_add(step_ms);
        }
    }
    statistics.diagnose(&CollectionProgress::default())
}

#[test]
fn long_sample_intervals_are_reported() {
    let turns = [(-25.0, 60), (25.0, 60)];
    assert_eq!(diagnose_banks(500, &turns), None);
    let Some(CollectionProblem::SampleIntervalTooLong { interval_s: every_s }) = diagnose_banks(510, &turns) else {
        panic!()
    };
    assert!((every_s - 0.51).abs() < 0.01, "{every_s}");
    // More than half of the sample intervals must be long.
    let mixed = |slow: u32| {
        let (mut statistics, mut filter) = (FlightStatistics::EMPTY, TiltFilter::NOT_STARTED);
        let mut time_ms = 0;
        for i in 0..100 {
            time_ms += if i % 20 >= 20 - slow { 1000 } else { 100 };
            statistics.add_sample(&mut filter, &banked_sample(if i < 50 { 25.0 } else { -25.0 }, 0.0, time_ms));
        }
        statistics.diagnose(&CollectionProgress::default())
    };
    assert!(
        matches!((mixed(10), mixed(11)), (None, Some(CollectionProblem::SampleIntervalTooLong { .. }))),
        "{:?} {:?}",
        mixed(10),
        mixed(11)
    );
}

/// 45 deg sent as 0.8 rad and read as degrees are no tilt.
#[test]
fn an_attitude_in_radians_is_reported() {
    assert!(
        matches!(diagnose_banks(100, &[(-0.8, 60), (0.8, 60)]), Some(CollectionProblem::NoTilt { max_tilt_deg }) if (max_tilt_deg - 0.8).abs() < 0.01)
    );
    assert!(matches!(diagnose_banks(100, &[(-1.9, 60), (1.9, 60)]), Some(CollectionProblem::NoTilt { .. })));
    assert!(matches!(diagnose_banks(100, &[(-2.1, 60), (2.1, 60)]), Some(CollectionProblem::InsufficientBank { .. })));
    let (mut statistics, mut filter) = (FlightStatistics::EMPTY, TiltFilter::NOT_STARTED);
    (0..300).for_each(|i| statistics.add_sample(&mut filter, &banked_sample(0.0, -15.0, i * 100)));
    assert!((insufficient_bank_deg(statistics.diagnose(&CollectionProgress::default())) - 15.0).abs() < 0.1);
}

/// Largest tilt of [`CollectionProblem::InsufficientBank`], degrees; NaN for any other problem.
fn insufficient_bank_deg(problem: Option<CollectionProblem>) -> f32 {
    if let Some(CollectionProblem::InsufficientBank { max_tilt_deg }) = problem { max_tilt_deg } else { f32::NAN }
}

/// A side needs 10 deg of bank for 5 s, after the 1 s low-pass filter.
#[test]
fn small_or_short_banks_are_reported() {
    assert!((insufficient_bank_deg(diagnose_banks(100, &[(-9.9, 60), (9.9, 60)])) - 9.9).abs() < 0.1);
    assert_eq!(diagnose_banks(100, &[(-10.1, 60), (10.1, 60)]), None);
    // The filter delays both edges of a bank of 20 deg equally: its time above 10 deg is unchanged.
    let for_tenths = |tenths: u32| {
        let (mut statistics, mut filter) = (FlightStatistics::EMPTY, TiltFilter::NOT_STARTED);
        for i in 0..600 {
            let roll_deg = if (300..300 + tenths).contains(&i) { 20.0 } else { 0.0 };
            statistics.add_sample(&mut filter, &banked_sample(roll_deg, 0.0, i * 100));
        }
        statistics.diagnose(&CollectionProgress::default())
    };
    assert!(matches!(for_tenths(48), Some(CollectionProblem::InsufficientBank { .. })), "{:?}", for_tenths(48));
    assert_eq!(for_tenths(52), Some(CollectionProblem::OneSideOnly(Side::Right)));
    // 1 s at 20 deg gives a filtered 20 (1 - 0.91^10).
    let gust = for_tenths(10);
    assert!(
        matches!(gust, Some(CollectionProblem::InsufficientBank { max_tilt_deg }) if (max_tilt_deg - 12.3).abs() < 0.2),
        "{gust:?}"
    );
}

#[test]
fn a_missing_side_is_reported() {
    assert_eq!(diagnose_banks(100, &[(-25.0, 60)]), Some(CollectionProblem::OneSideOnly(Side::Left)));
    assert_eq!(diagnose_banks(100, &[(25.0, 60)]), Some(CollectionProblem::OneSideOnly(Side::Right)));
    assert_eq!(diagnose_banks(100, &[(25.0, 60), (-25.0, 4)]), Some(CollectionProblem::OneSideOnly(Side::Right)));
    assert_eq!(diagnose_banks(100, &[(25.0, 60), (-25.0, 7)]), None);
}

#[test]
fn a_short_flight_has_no_diagnosis() {
    assert_eq!(diagnose_banks(100, &[(0.0, 20)]), None);
    assert!(diagnose_banks(100, &[(0.0, 21)]).is_some());
    assert_eq!(diagnose_banks(2000, &[(0.0, 38)]), None);
    assert!(diagnose_banks(2000, &[(0.0, 40)]).is_some());
    assert_eq!(diagnose_banks(100, &[(f32::NAN, 100)]), None, "what is no number is no flight");
}

/// Two circles of 90 s, against arcs of 120 deg in 90 s.
#[test]
fn arcs_are_reported() {
    let through = |rate_deg_s: f32, seconds: u16| {
        let mut collector = Collector::new(empty_memory());
        collector.begin_procedure(Procedure::Turns);
        turn_samples(-25.0, 0, seconds, -rate_deg_s).for_each(|sample| collector.push_sample(sample));
        turn_samples(25.0, seconds, 2 * seconds, rate_deg_s).for_each(|sample| collector.push_sample(sample));
        collector.collection_problem()
    };
    assert_eq!(through(4.5, 90), None);
    assert!(
        matches!(through(1.3, 90), Some(CollectionProblem::ArcOnly { side: Side::Left, sectors }) if sectors <= 8),
        "{:?}",
        through(1.3, 90)
    );
    let progress_of = |samples, sectors| {
        let mut progress = CollectionProgress::default();
        progress.part_coverages[1] =
            PartCoverage { fit_count: samples, covered_sector_count: sectors, ..PartCoverage::default() };
        progress
    };
    let (mut both, mut filter) = (FlightStatistics::EMPTY, TiltFilter::NOT_STARTED);
    turn_samples(-25.0, 0, 20, 9.0)
        .chain(turn_samples(25.0, 20, 40, 9.0))
        .for_each(|sample| both.add_sample(&mut filter, &sample));
    assert_eq!(both.diagnose(&progress_of(60, 8)), Some(CollectionProblem::ArcOnly { side: Side::Right, sectors: 8 }));
    assert_eq!((both.diagnose(&progress_of(59, 8)), both.diagnose(&progress_of(60, 9))), (None, None));
}

#[test]
fn bank_problems_are_reported_for_turns_only_and_reset_at_each_start() {
    let mut collector = Collector::new(empty_memory());
    for (procedure, is_reported) in
        [(Procedure::Turns, true), (Procedure::Flight, false), (Procedure::Level, false), (Procedure::Swing, false)]
    {
        collector.begin_procedure(procedure);
        (0..300).for_each(|i| collector.push_sample(banked_sample(5.0, 0.0, i * 100)));
        assert_eq!(collector.collection_problem().is_some(), is_reported, "{procedure:?}");
    }
    collector.begin_procedure(Procedure::Flight);
    assert_eq!(collector.collection_problem(), None);
    (0..300).for_each(|i| collector.push_sample(banked_sample(1.9, 0.0, i * 100)));
    assert!(
        matches!(collector.collection_problem(), Some(CollectionProblem::NoTilt { .. })),
        "of whatever is flown nothing else is asked"
    );
    collector.begin_procedure(Procedure::Turns);
    assert_eq!(collector.collection_problem(), None);
}
