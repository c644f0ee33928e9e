//! Invariances of the solution.

use nalgebra::{Rotation3, Unit};

use super::NO_PRIOR;
use super::synthetic::{
    Airframe, Flight, Random, RecordedTurns, exact_circle, level_samples, marked_samples, random_vector,
    samples_in_mount, swing_marks, tumbled_samples, turn_samples,
};
use crate::calibration::{Calibration, Method, Orientation, Prior, Sample, Samples, solve_samples};
use crate::frames::{Field, wrap_pi};

/// Largest heading difference of two calibrations of one flight, each on its own samples, degrees.
fn max_heading_difference_deg(a: (&Calibration, Samples<'_>), b: (&Calibration, Samples<'_>)) -> f32 {
    let headings = |(calibration, samples): (&Calibration, Samples<'_>)| -> Vec<f32> {
        let heading =
            |sample: &Sample| sample.attitude.to_level_frame(calibration.calibrated_field(sample.field)).heading_rad();
        samples.all_samples().map(heading).collect()
    };
    let pairs = headings(a).into_iter().zip(headings(b));
    pairs.map(|(a, b)| wrap_pi(a - b).abs().to_degrees()).fold(0.0, f32::max)
}

fn flights() -> impl Iterator<Item = (u64, RecordedTurns, Random)> {
    (0..20).map(|seed| {
        let (mut random, airframe) = Airframe::seeded(2000 + seed, 0.2, 1.5, 5.0, [-65.0, 65.0]);
        (seed, Flight::TYPICAL.fly(&airframe, &mut random), random)
    })
}

fn calibrate(method: Method, samples: Samples<'_>, mount: Orientation) -> Calibration {
    solve_samples(method, samples, &Prior { mount, ..NO_PRIOR }).unwrap().calibration
}

/// Asserts the same headings from changed samples, to a tolerance in degrees.
#[track_caller]
fn assert_invariant(seed: u64, recorded: &RecordedTurns, changed: &RecordedTurns, tolerance_deg: f32) {
    let [before, after] = [recorded, changed].map(RecordedTurns::turns);
    let [a, b] =
        [before, after].map(|turns| calibrate(Method::MaximumLikelihood, turns, Orientation::IDENTITY_ROTATION));
    let difference_deg = max_heading_difference_deg((&a, before), (&b, after));
    assert!(difference_deg < tolerance_deg, "seed {seed}: {difference_deg} deg");
}

#[test]
fn invariant_to_rotation_of_sensor_and_mount() {
    for (seed, recorded, _) in flights() {
        let samples = recorded.turns();
        let straight = calibrate(Method::MaximumLikelihood, samples, Orientation::IDENTITY_ROTATION);
        for mount in Orientation::all_orientations() {
            let turned = samples_in_mount(samples, mount);
            let calibration = calibrate(Method::MaximumLikelihood, turned, mount);
            let difference_deg = max_heading_difference_deg((&straight, samples), (&calibration, turned));
            assert!(difference_deg < 0.005, "seed {seed}, {}: {difference_deg} deg", mount.orientation_name());
        }
    }
}

/// Closed forms of level flight assume a vertical axis, so the rotation is about it. Only rounding differs.
#[test]
fn every_method_corrects_for_the_mounting() {
    let airframe = Airframe::with_hard_iron([12.0, -7.0, 20.0]);
    let mut random = Random(1400);
    let [left, right, level] = [-20.0, 20.0, 0.0].map(|bank_deg| exact_circle(&airframe, bank_deg, 72));
    let turns = turn_samples(&left, &right);
    let yaw90 = Orientation::from_name("yaw90").unwrap();
    for (method, samples) in [
        (Method::Level, level_samples(&level)),
        (Method::FourEllipse, turns),
        (Method::TwoPlane, turns),
        (Method::CompassSwing, marked_samples(&swing_marks(&airframe, 12, &[20.0, -20.0], &mut random))),
        (Method::Ellipsoid, turn_samples(&tumbled_samples(&airframe, 0.12, &mut random), &[])),
    ] {
        let turned = samples_in_mount(samples, yaw90);
        let [straight, calibration] =
            [(samples, Orientation::IDENTITY_ROTATION), (turned, yaw90)].map(|(s, mount)| calibrate(method, s, mount));
        let difference_deg = max_heading_difference_deg((&straight, samples), (&calibration, turned));
        assert!(difference_deg < 0.02, "{}: {difference_deg} deg", method.method_name());
    }
}

/// A mounting error of 10 deg affects only the weak priors: less than a twentieth of the heading sigma.
#[test]
fn invariant_to_rotation_of_the_sensor_in_its_mount() {
    for (seed, recorded, mut random) in flights() {
        let axis = Unit::new_normalize(random_vector(&mut random, 1.0));
        let turn = Rotation3::from_axis_angle(&axis, 10.0_f32.to_radians());
        let turned = recorded.map_samples(|sample| Sample { field: Field::new(turn * sample.field.ut), ..*sample });
        assert_invariant(seed, &recorded, &turned, 0.03);
    }
}

/// Only ratios of fields matter, except for the weak hard-iron prior in uT.
#[test]
fn invariant_to_field_scale() {
    for (seed, recorded, mut random) in flights() {
        let scale = random.uniform(0.5, 2.0);
        let scaled = recorded.map_samples(|sample| Sample { field: Field::new(sample.field.ut * scale), ..*sample });
        assert_invariant(seed, &recorded, &scaled, 0.01);
    }
}

#[test]
fn invariant_to_sample_order() {
    for (seed, recorded, mut random) in flights() {
        let mut permuted = recorded.clone();
        for side in [&mut permuted.left, &mut permuted.right] {
            for i in (1..side.len()).rev() {
                side.swap(i, random.uniform(0.0, i as f32 + 0.999) as usize);
            }
        }
        let [before, after] = [&recorded, &permuted].map(RecordedTurns::turns);
        let [a, b] =
            [before, after].map(|turns| calibrate(Method::MaximumLikelihood, turns, Orientation::IDENTITY_ROTATION));
        let difference_deg = max_heading_difference_deg((&a, before), (&b, before));
        assert!(difference_deg < 0.01, "seed {seed}: {difference_deg} deg");
    }
}
