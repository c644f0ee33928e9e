//! Unit tests of `plausibility`.

use super::super::{BodyRates, SenderId};
use super::*;
use crate::time::WrappingMillis;

fn report(roll_deg: f32, pitch_deg: f32) -> AttitudeReport {
    let attitude = Attitude::from_deg(roll_deg, pitch_deg);
    AttitudeReport {
        sender: SenderId::default(),
        sender_clock_at_sending: WrappingMillis::default(),
        attitude,
        body_rates: None,
    }
}

/// Updates with the field of an aircraft rotated about an axis until the mean has settled.
fn settle_rotated_field(freeze: &mut FreezeDetector, axis: Vector3<f32>, turned_deg: f32) {
    let turn = nalgebra::Rotation3::new(axis.normalize() * turned_deg.to_radians());
    let field = Field::new(turn * Vector3::new(20.0, 0.0, 20.0));
    (0..200).for_each(|_| freeze.update_field(field));
}

/// Whether a source is frozen after a first step and `report_count` equal reports, while the aircraft rotates about
/// `axis` by `turned_deg` after 0.4 s.
fn is_frozen_in_rotation(
    axis: Vector3<f32>,
    first_step_deg: f32,
    report_count: u32,
    interval_us: u64,
    turned_deg: f32,
) -> bool {
    is_frozen_at_attitude([0.0, 0.0], axis, first_step_deg, report_count, interval_us, turned_deg)
}

/// As `is_frozen_in_rotation`, at this roll and pitch, degrees.
fn is_frozen_at_attitude(
    [roll_deg, pitch_deg]: [f32; 2],
    axis: Vector3<f32>,
    first_step_deg: f32,
    report_count: u32,
    interval_us: u64,
    turned_deg: f32,
) -> bool {
    let mut freeze = FreezeDetector::new();
    settle_rotated_field(&mut freeze, axis, 0.0);
    freeze.process_report(Timestamp::from_us(0), &report(roll_deg, pitch_deg));
    for i in 1..=report_count {
        let at_us = interval_us * u64::from(i);
        let turned = at_us > 400_000 + 2 * interval_us;
        settle_rotated_field(&mut freeze, axis, if turned { turned_deg } else { 0.0 });
        freeze.process_report(Timestamp::from_us(at_us), &report(roll_deg + first_step_deg, pitch_deg));
    }
    freeze.frozen_at().is_some()
}

/// As `is_frozen_in_rotation`, for the y axis: the rotation changes the test field's inclination by its angle.
fn is_frozen_while_pitching(first_step_deg: f32, report_count: u32, interval_us: u64, turned_deg: f32) -> bool {
    is_frozen_in_rotation(Vector3::y(), first_step_deg, report_count, interval_us, turned_deg)
}

/// Limits of a fine source: changes of 0.05 deg, five equal reports, 80 ms.
#[test]
fn fine_resolution_is_frozen_after_five_reports() {
    for step_deg in [0.04, -0.04] {
        assert!(
            is_frozen_while_pitching(step_deg, 5, 20_000, 0.0) && !is_frozen_while_pitching(step_deg, 4, 30_000, 0.0),
            "{step_deg}"
        );
    }
    assert!(!is_frozen_while_pitching(0.06, 100, 20_000, 0.0) && !is_frozen_while_pitching(-0.06, 100, 20_000, 0.0));
    // At 100 Hz, 80 ms are nine reports.
    assert!(!is_frozen_while_pitching(0.04, 8, 10_000, 0.0) && is_frozen_while_pitching(0.04, 9, 10_000, 0.0));
}

#[test]
fn a_fine_step_of_pitch_counts() {
    for pitch_deg in [0.04, -0.04] {
        let mut freeze = FreezeDetector::new();
        freeze.process_report(Timestamp::from_us(0), &report(0.0, 0.0));
        (1..=5).for_each(|i| freeze.process_report(Timestamp::from_us(i * 20_000), &report(0.0, pitch_deg)));
        assert!(freeze.frozen_at().is_some());
        // A change of either angle ends the freeze.
        freeze.process_report(Timestamp::from_us(120_000), &report(0.01, pitch_deg));
        assert!(freeze.frozen_at().is_none());
    }
}

/// Limits of a coarse source: 1.75 deg of field rotation, 0.5 s, five equal reports.
#[test]
fn coarse_resolution_is_frozen_when_the_field_rotated() {
    for sign in [1.0, -1.0] {
        assert!(
            is_frozen_while_pitching(0.1, 30, 20_000, sign * 1.85)
                && !is_frozen_while_pitching(0.1, 30, 20_000, sign * 1.65)
        );
    }
    // 26 reports at 50 Hz are 0.5 s.
    assert!(is_frozen_while_pitching(0.1, 26, 20_000, 20.0) && !is_frozen_while_pitching(0.1, 25, 20_000, 20.0));
    // Four reports at 4 Hz are too few, though long enough.
    assert!(!is_frozen_while_pitching(0.1, 4, 250_000, 20.0) && is_frozen_while_pitching(0.1, 5, 250_000, 20.0));
}

/// About an axis 10 deg from the vertical, 8.5 deg of rotation change the inclination by 1.4 deg, 4.5 deg by 0.7
/// deg.
#[test]
fn a_level_turn_about_the_vertical_is_not_frozen() {
    for turned_deg in [5.0, 90.0, -170.0] {
        assert!(!is_frozen_in_rotation(Vector3::z(), 0.1, 30, 20_000, turned_deg), "{turned_deg}");
    }
    let tilted = Vector3::new(0.0, 10_f32.to_radians().sin(), 10_f32.to_radians().cos());
    assert!(
        is_frozen_in_rotation(tilted, 0.1, 30, 20_000, 8.5) && !is_frozen_in_rotation(tilted, 0.1, 30, 20_000, 4.5)
    );
    assert!(
        is_frozen_in_rotation(tilted, 0.1, 30, 20_000, -8.5) && !is_frozen_in_rotation(tilted, 0.1, 30, 20_000, -4.5)
    );
}

/// A banked vehicle that turns flies, and its attitude varies. The axis of rotation is the vertical.
#[test]
fn a_banked_turn_about_the_vertical_is_frozen() {
    for (attitude_deg, frozen) in
        [([9.5, 0.0], false), ([10.5, 0.0], true), ([-10.5, 0.0], true), ([0.0, 9.5], false), ([0.0, -10.5], true)]
    {
        let down = Attitude::from_deg(attitude_deg[0] + 0.1, attitude_deg[1]).tilt_rotation().down_in_body();
        assert_eq!(is_frozen_at_attitude(attitude_deg, down, 0.1, 30, 20_000, 20.0), frozen, "{attitude_deg:?}");
        assert!(!is_frozen_at_attitude(attitude_deg, down, 0.1, 30, 20_000, 2.0), "{attitude_deg:?}");
    }
}

/// Whether a coarse source whose attitude repeats at 50 Hz is frozen after each report, with these yaw rates, rad/s.
fn frozen_after_each_report(rates_rad_s: impl IntoIterator<Item = f32>) -> Vec<bool> {
    let mut freeze = FreezeDetector::new();
    let mut process = |(i, rate_rad_s): (u64, f32)| {
        let repeated =
            AttitudeReport { body_rates: BodyRates::from_rad_s([0.0, 0.0, rate_rad_s]), ..report(25.0, 0.0) };
        freeze.process_report(Timestamp::from_us(i * 20_000), &repeated);
        freeze.frozen_at().is_some()
    };
    (0..).zip(rates_rad_s).map(&mut process).collect()
}

/// Rates derived from angles vanish when a source stops in a turn of 18 deg/s. After 0.12 s 2 deg are missing; with a
/// steady field, or an unknown one, the vehicle is taken to stand after 1 s.
#[test]
fn a_source_whose_rates_vanish_is_frozen() {
    let stops = |rate_rad_s: f32| [0.314; 2].into_iter().chain([rate_rad_s; 600]);
    let found = frozen_after_each_report(stops(0.1));
    let changes: Vec<_> = (1..found.len()).filter(|&i| found[i] != found[i - 1]).collect();
    assert_eq!(changes, [6, 50]);
    assert!(!frozen_after_each_report(stops(0.314)).contains(&true), "a steady turn");
    assert!(!frozen_after_each_report(stops(0.2)).contains(&true), "a turn that becomes slower");
    assert!(!frozen_after_each_report([0.0; 100]).contains(&true), "at rest");
}

#[test]
fn field_rotation_before_settling_is_ignored() {
    let mut freeze = FreezeDetector::new();
    let level = Field::<Body>::from_ut(0.0, -20.0, 40.0);
    let banked = Attitude::from_deg(25.0, 0.0);
    let in_bank = banked.to_body_frame(Field::new(level.ut));
    (0..200).for_each(|_| freeze.update_field(in_bank));
    freeze.process_report(Timestamp::from_us(0), &report(25.0, 0.0));
    // The mean field direction lags behind the roll-out and still contains the bank.
    for i in 1..100 {
        freeze.process_report(Timestamp::from_us(i * 20_000), &report(0.1, 0.0));
        (0..2).for_each(|_| freeze.update_field(Field::new(level.ut)));
        assert!(freeze.frozen_at().is_none(), "{i}");
    }
}

/// Ten minutes at rest: 25 uT with the noise of a LIS3MDL, attitude in tenths of a degree.
#[test]
fn a_coarse_source_at_rest_is_not_frozen() {
    let mut random = testkit::random::Random(3);
    let mut freeze = FreezeDetector::new();
    for i in 0..600 * 80_u64 {
        if i % 8 == 0 {
            freeze.process_report(Timestamp::from_us(i * 12_500), &report(0.3, -1.2));
            assert!(freeze.frozen_at().is_none(), "after {i} readings");
        }
        let [x, y, z] = [10.0, -5.0, 22.0].map(|ut| ut + 0.35 * random.normal());
        freeze.update_field(Field::from_ut(x, y, z));
    }
}

#[test]
fn a_nan_field_is_discarded() {
    let mut freeze = FreezeDetector::new();
    freeze.update_field(Field::from_ut(f32::NAN, 0.0, 0.0));
    freeze.update_field(Field::from_ut(0.0, 0.0, 0.0));
    assert!(freeze.field_direction.mean().is_none() && !freeze.has_field_rotated(Attitude::default()));
    freeze.update_field(Field::from_ut(0.0, 2.0, 0.0));
    assert_eq!(freeze.field_direction.mean(), Some(Vector3::new(0.0, 1.0, 0.0)));
}

#[test]
fn the_angle_between_attitudes_is_that_of_their_down_directions() {
    let between = |a: [f32; 2], b: [f32; 2]| {
        tilt_between(Attitude::from_deg(a[0], a[1]), Attitude::from_deg(b[0], b[1])).to_degrees()
    };
    for (a, b, expected_deg) in [
        ([10.0, 0.0], [30.0, 0.0], 20.0),
        ([0.0, -10.0], [0.0, 10.0], 20.0),
        ([179.0, 0.0], [-179.0, 0.0], 2.0),
        ([0.0, 90.0], [120.0, 90.0], 0.0),
        ([0.0, 0.0], [180.0, 0.0], 180.0),
    ] {
        assert!((between(a, b) - expected_deg).abs() < 0.05, "{a:?} {b:?}: {}", between(a, b));
    }
}
