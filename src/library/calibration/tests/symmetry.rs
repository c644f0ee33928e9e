//! Invariances of the solution.

use nalgebra::{Rotation3, Unit};

use super::synthetic::{Airframe, Flight, Random, RecordedTurns, random_vector};
use crate::calibration::tests::NO_PRIOR;
use crate::calibration::{Calibration, Method, Orientation, Prior, Sample, solve_samples};
use crate::frames::{Field, wrap_pi};

/// Largest heading difference of two calibrations of one flight, each on its own samples, degrees.
fn max_heading_difference_deg(a: (&Calibration, &RecordedTurns), b: (&Calibration, &RecordedTurns)) -> f32 {
    let headings = |(calibration, recorded): (&Calibration, &RecordedTurns)| -> Vec<f32> {
        let heading =
            |sample: &Sample| sample.attitude.to_level_frame(calibration.calibrated_field(sample.field)).heading_rad();
        recorded.left.iter().chain(&recorded.right).map(heading).collect()
    };
    let pairs = headings(a).into_iter().zip(headings(b));
    pairs.map(|(a, b)| wrap_pi(a - b).abs().to_degrees()).fold(0.0, f32::max)
}

fn map_samples(recorded: &RecordedTurns, change: impl Fn(&Sample) -> Sample) -> RecordedTurns {
    RecordedTurns {
        left: recorded.left.iter().map(&change).collect(),
        right: recorded.right.iter().map(&change).collect(),
    }
}

fn flights() -> impl Iterator<Item = (u64, RecordedTurns, Random)> {
    (0..20).map(|seed| {
        let mut random = Random(2000 + seed);
        let airframe = Airframe::random(&mut random, 0.2, 1.5, 5.0, [-65.0, 65.0]);
        (seed, Flight::TYPICAL.fly(&airframe, &mut random), random)
    })
}

fn calibrate(recorded: &RecordedTurns, mount: Orientation) -> Calibration {
    solve_samples(Method::MaximumLikelihood, recorded.turns(), &Prior { mount, ..NO_PRIOR }).unwrap().calibration
}

#[test]
fn invariant_to_rotation_of_sensor_and_mount() {
    for (seed, recorded, _) in flights() {
        let straight = calibrate(&recorded, Orientation::IDENTITY_ROTATION);
        for mount in Orientation::all_orientations() {
            let turned = recorded.in_mount(mount);
            let calibration = calibrate(&turned, mount);
            let difference = max_heading_difference_deg((&straight, &recorded), (&calibration, &turned));
            assert!(difference < 0.005, "seed {seed}, {}: {difference} deg", mount.orientation_name());
        }
    }
}

/// A mounting error of 10 deg affects only the weak priors: less than a twentieth of the heading sigma.
#[test]
fn invariant_to_rotation_of_the_sensor_in_its_mount() {
    for (seed, recorded, mut random) in flights() {
        let axis = Unit::new_normalize(random_vector(&mut random, 1.0));
        let turn = Rotation3::from_axis_angle(&axis, 10.0_f32.to_radians());
        let turned = map_samples(&recorded, |sample| Sample { field: Field::new(turn * sample.field.ut), ..*sample });
        let (a, b) =
            (calibrate(&recorded, Orientation::IDENTITY_ROTATION), calibrate(&turned, Orientation::IDENTITY_ROTATION));
        let difference = max_heading_difference_deg((&a, &recorded), (&b, &turned));
        assert!(difference < 0.03, "seed {seed}: {difference} deg");
    }
}

/// Only ratios of fields matter, except for the weak hard-iron prior in uT.
#[test]
fn invariant_to_field_scale() {
    for (seed, recorded, mut random) in flights() {
        let scale = random.uniform(0.5, 2.0);
        let scaled = map_samples(&recorded, |sample| Sample { field: Field::new(sample.field.ut * scale), ..*sample });
        let (a, b) =
            (calibrate(&recorded, Orientation::IDENTITY_ROTATION), calibrate(&scaled, Orientation::IDENTITY_ROTATION));
        let difference = max_heading_difference_deg((&a, &recorded), (&b, &scaled));
        assert!(difference < 0.01, "seed {seed}, by {scale}: {difference} deg");
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
        let (a, b) = (
            calibrate(&recorded, Orientation::IDENTITY_ROTATION),
            calibrate(&permuted, Orientation::IDENTITY_ROTATION),
        );
        let difference = max_heading_difference_deg((&a, &recorded), (&b, &recorded));
        assert!(difference < 0.01, "seed {seed}: {difference} deg");
    }
}
