use testkit::random::Random;

use super::super::test_samples::{circle_sample, collected, stored_times_ms, test_sample, turn_samples};
use super::*;
use crate::calibration::CollectionPart;
use crate::calibration::method_selection::Procedure;
use crate::collection::Collector;
use crate::collection::progress::PartCoverage;
use crate::time::WrappingMillis;

/// Coverage of right turns; the first 2 s of each turn are not stored.
fn right_turn_coverage(collector: &Collector<'_>) -> PartCoverage {
    *collector.collection_progress().coverage_of(CollectionPart::RIGHT)
}

fn level_coverage(collector: &Collector<'_>) -> PartCoverage {
    *collector.collection_progress().coverage_of(CollectionPart::LEVEL)
}

/// Level samples at these headings, each due.
fn collected_at_headings(headings_deg: impl Iterator<Item = f32>) -> Collector<'static> {
    let samples = (0..)
        .zip(headings_deg)
        .map(|(i, heading_deg)| Sample { time: WrappingMillis::new(i * 400), ..circle_sample(heading_deg) });
    collected(Procedure::Level, samples)
}

/// At 13 deg/s a circle takes 28 s. Half a circle covers 6 of 12 sectors, plus a partial one at each end.
#[test]
fn three_circles_complete_a_side_in_spite_of_hard_iron() {
    let after_s =
        |seconds: u16| right_turn_coverage(&collected(Procedure::Turns, turn_samples(25.0, 0, seconds, 13.0)));
    let half = after_s(2 + 14);
    assert!((6..=8).contains(&half.covered_sector_count) && half.percent < 35, "{half:?}");
    let two = after_s(2 + 56);
    assert!(two.covered_sector_count == 12 && (60..100).contains(&two.percent), "{two:?}");
    let three = after_s(2 + 84);
    assert_eq!((three.covered_sector_count, three.percent), (12, 100), "{three:?}");
}

#[test]
fn a_complete_side_stays_complete() {
    for tenths in (100..200_u16).step_by(4) {
        let mut collector = collected(Procedure::Turns, []);
        let mut completed = false;
        for sample in turn_samples(25.0, 0, 150, f32::from(tenths) / 10.0) {
            collector.push_sample(sample);
            let complete = right_turn_coverage(&collector).is_complete();
            assert!(complete || !completed, "{tenths} tenths of a degree a second, at {} ms", sample.time.as_ms());
            completed = complete;
        }
        assert!(completed);
    }
}

/// Bank wander moves the field along a short line, within two sectors; noise of a vehicle at rest gives no circle.
#[test]
fn a_constant_heading_gives_no_coverage() {
    let straight = right_turn_coverage(&collected(Procedure::Turns, turn_samples(25.0, 0, 300, 0.0)));
    assert!(straight.covered_sector_count <= 2 && straight.percent < 20, "{straight:?}");
    let mut random = Random(1);
    let noise = (0..100).map(|i| test_sample([20.0, 0.0, 40.0].map(|ut| ut + random.uniform(-1.0, 1.0)), i * 400));
    let at_rest = level_coverage(&collected(Procedure::Level, noise));
    assert_eq!((at_rest.covered_sector_count, at_rest.percent), (0, 0));
    assert!(at_rest.fit_count > 40, "they are stored all the same");
}

/// Three points are always on a circle.
#[test]
fn few_samples_give_no_coverage() {
    let coverage = level_coverage(&collected_at_headings((0..5_u8).map(|i| f32::from(i) * 72.0)));
    assert_eq!((coverage.fit_count, coverage.covered_sector_count, coverage.percent), (4, 0, 0));
}

/// After two circles a vehicle stands at one heading for ten minutes.
#[test]
fn standing_replaces_no_sample_of_the_circles() {
    let circles = (0..90_u16).map(|i| f32::from(i) * 9.0);
    let collector = collected_at_headings(circles.chain(core::iter::repeat_n(100.0, 1500)));
    let stored = stored_times_ms(&collector, CollectionPart::LEVEL).concat();
    assert_eq!(stored.len(), 588, "the buffer is full");
    let circle_count = stored.iter().filter(|ms| **ms < 90 * 400).count();
    assert_eq!(circle_count, 90);
}

#[test]
fn a_complete_part_has_enough_held_back_samples_for_verification() {
    let mut collector = collected(Procedure::Level, []);
    for sample in turn_samples(0.0, 0, 84, 13.0) {
        collector.push_sample(sample);
        if level_coverage(&collector).is_complete() {
            break;
        }
    }
    let level = level_coverage(&collector);
    assert!(level.is_complete() && level.held_back_count >= MIN_HELD_BACK_WHEN_COMPLETE, "{level:?}");
}

fn circle_through(samples: &[Sample]) -> Option<TurnCircle> {
    TurnCircle::fit_circle(Samples::new(samples))
}

#[test]
fn two_points_or_nonfinite_values_have_no_circle() {
    let points = [0.0, 90.0, 200.0].map(circle_sample);
    assert!(circle_through(&points[..2]).is_none());
    assert!(circle_through(&points).is_some());
    let broken = Sample { field: crate::frames::Field::from_ut(f32::NAN, 0.0, 0.0), ..points[0] };
    assert!(circle_through(&[points[0], points[1], points[2], broken]).is_none());
}

/// An angle of exactly pi would be a thirteenth sector.
#[test]
fn an_angle_of_pi_is_in_the_last_sector() {
    assert_eq!(
        (sector_of_direction(Vector2::new(-1.0, 0.0)), sector_of_direction(Vector2::new(-1.0, -0.0))),
        (SECTOR_COUNT - 1, 0)
    );
    assert_eq!(
        [0.1, -0.1].map(|y| sector_of_direction(Vector2::new(1.0, y))),
        [SECTOR_COUNT / 2, SECTOR_COUNT / 2 - 1]
    );
    assert_eq!(sector_of_direction(Vector2::new(f32::NAN, 1.0)), 0);
}
