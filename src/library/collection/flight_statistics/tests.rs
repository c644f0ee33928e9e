//! Unit tests of `flight_statistics`.

use super::super::test_samples::{banked_sample, collected};
use super::*;
use crate::calibration::method_selection::Procedure;

/// Problem of a collection in turns, with these banks in degrees and their durations in seconds, across a wrap of the
/// clock.
fn diagnose_banks(step_ms: u32, banks: &[(f32, f32)]) -> String {
    let samples_of = |&(roll_deg, seconds): &(f32, f32)| {
        core::iter::repeat_n(roll_deg, (seconds * 1000.0 / step_ms as f32).round() as usize)
    };
    let times_ms = (0..).map(|i: u32| (i * step_ms).wrapping_sub(5000));
    let samples = times_ms.zip(banks.iter().flat_map(samples_of));
    problem_text(Procedure::Turns, samples.map(|(time_ms, roll_deg)| banked_sample(roll_deg, 0.0, time_ms)))
}

/// Text of the problem of a collection; empty without one.
fn problem_text(procedure: Procedure, samples: impl Iterator<Item = Sample>) -> String {
    collected(procedure, samples).collection_problem().map_or_else(String::new, |problem| problem.to_string())
}

fn assert_problem(name: &str, found: &str, expected: &str) {
    assert!(found.starts_with(expected) && found.is_empty() == expected.is_empty(), "{name}: {found}");
}

/// 45 deg sent as 0.8 rad and read as degrees are no tilt. A gust of 1 s at 20 deg gives a filtered 20 (1 - 0.91^10)
/// deg; the filter delays both edges of a longer bank equally.
#[test]
fn the_problem_of_a_flight_is_reported() {
    for (name, step_ms, banks, expected) in [
        ("turns at 2 samples a second", 500, &[(-25.0, 30.0), (25.0, 30.0)][..], ""),
        ("turns at 1 sample a second", 1000, &[(-25.0, 30.0), (25.0, 30.0)], "a sample comes every 1.0 s"),
        ("radians as degrees", 100, &[(-0.8, 30.0), (0.8, 30.0)], "the attitude tilts by 0.8 deg at most"),
        ("hardly any bank", 100, &[(-3.0, 30.0), (3.0, 30.0)], "too little bank, 3.0 deg at most"),
        ("small banks", 100, &[(-9.0, 30.0), (9.0, 30.0)], "too little bank, 9.0 deg at most"),
        ("banks of the manual", 100, &[(-15.0, 30.0), (15.0, 30.0)], ""),
        ("a gust", 100, &[(0.0, 30.0), (20.0, 1.0), (0.0, 30.0)], "too little bank, 12.3 deg at most"),
        ("a short bank", 100, &[(0.0, 30.0), (20.0, 4.0), (0.0, 30.0)], "too little bank, 19.6 deg at most"),
        ("a bank of 6 s", 100, &[(0.0, 30.0), (20.0, 6.0), (0.0, 30.0)], "only right turns"),
        ("left only", 100, &[(-25.0, 30.0)], "only left turns"),
        ("a short left turn", 100, &[(25.0, 30.0), (-25.0, 4.0)], "only right turns"),
        ("a left turn", 100, &[(25.0, 30.0), (-25.0, 8.0)], ""),
        ("a short flight", 100, &[(0.0, 19.0)], ""),
        ("half a minute on the ground", 100, &[(0.0, 30.0)], "the attitude tilts by 0.0 deg"),
        ("few samples", 2000, &[(0.0, 36.0)], ""),
        ("slow samples", 2000, &[(0.0, 42.0)], "a sample comes every 1.9 s"),
        ("not a number", 100, &[(f32::NAN, 100.0)], ""),
    ] {
        assert_problem(name, &diagnose_banks(step_ms, banks), expected);
    }
}

/// More than half of the sample intervals must be long.
#[test]
fn occasional_gaps_are_no_problem() {
    for (long_intervals_of_20, is_reported) in [(9, false), (12, true)] {
        let intervals_ms = (0..100).map(|i| if i % 20 < long_intervals_of_20 { 1000 } else { 100 });
        let times_ms = intervals_ms.scan(0, |time_ms, interval_ms| {
            *time_ms += interval_ms;
            Some(*time_ms)
        });
        let roll_deg = |i: usize| if i < 50 { 25.0 } else { -25.0 };
        let samples = times_ms.enumerate().map(|(i, time_ms)| banked_sample(roll_deg(i), 0.0, time_ms));
        let expected = if is_reported { "a sample comes every 0." } else { "" };
        assert_problem("", &problem_text(Procedure::Turns, samples), expected);
    }
}

/// In free flight any tilt is sufficient.
#[test]
fn bank_problems_are_reported_for_turns_only_and_reset_at_each_start() {
    let tilted = |roll_deg: f32, pitch_deg: f32| (0..300).map(move |i| banked_sample(roll_deg, pitch_deg, i * 100));
    for (procedure, roll_deg, pitch_deg, expected) in [
        (Procedure::Turns, 5.0, 0.0, "too little bank, 5.0"),
        (Procedure::Turns, 0.0, -15.0, "too little bank, 15.0"),
        (Procedure::Flight, 5.0, 0.0, ""),
        (Procedure::Flight, 1.5, 0.0, "the attitude tilts by 1.5"),
        (Procedure::Level, 5.0, 0.0, ""),
        (Procedure::Swing, 5.0, 0.0, ""),
    ] {
        assert_problem(procedure.procedure_name(), &problem_text(procedure, tilted(roll_deg, pitch_deg)), expected);
        let mut collector = collected(procedure, tilted(roll_deg, pitch_deg));
        collector.begin_procedure(procedure);
        assert_eq!(collector.collection_problem(), None, "{procedure:?}");
    }
}
