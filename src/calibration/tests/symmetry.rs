//! What must not matter does not.

use nalgebra::{Rotation3, Unit};

use super::NO_PRIOR;
use super::synthetic::{Airframe, Flight, Random, Recorded, vector};
use crate::calibration::{Calibration, Method, Orientation, Prior, Sample, solve};
use crate::frames::{Field, wrap_pi};

/// The largest difference of heading between two calibrations of the same flight, each on its own samples, degrees.
fn difference_deg(a: (&Calibration, &Recorded), b: (&Calibration, &Recorded)) -> f32 {
    let headings = |(calibration, recorded): (&Calibration, &Recorded)| -> Vec<f32> {
        let heading = |s: &Sample| s.attitude.level(calibration.apply(s.field)).heading_rad();
        recorded.left.iter().chain(&recorded.right).map(heading).collect()
    };
    let pairs = headings(a).into_iter().zip(headings(b));
    pairs.map(|(a, b)| wrap_pi(a - b).abs().to_degrees()).fold(0.0, f32::max)
}

fn changed(recorded: &Recorded, change: impl Fn(&Sample) -> Sample) -> Recorded {
    Recorded { left: recorded.left.iter().map(&change).collect(), right: recorded.right.iter().map(&change).collect() }
}

fn flights() -> impl Iterator<Item = (u64, Recorded, Random)> {
    (0..20).map(|seed| {
        let mut random = Random(2000 + seed);
        let airframe = Airframe::random(&mut random, 0.2, 1.5, 5.0, [-65.0, 65.0]);
        (seed, Flight::REAL.fly(&airframe, &mut random), random)
    })
}

fn calibrate(recorded: &Recorded, mount: Orientation) -> Calibration {
    solve(Method::MaximumLikelihood, recorded.turns(), &Prior { mount, ..NO_PRIOR }).unwrap().calibration
}

/// Sensor and configured mounting turned together: the refinement works in the mount's axes, so only f32 differs.
#[test]
fn rotating_sensor_and_mount_together() {
    for (seed, recorded, _) in flights() {
        let straight = calibrate(&recorded, Orientation::NONE);
        for mount in Orientation::all() {
            let turned = recorded.in_mount(mount);
            let calibration = calibrate(&turned, mount);
            let difference = difference_deg((&straight, &recorded), (&calibration, &turned));
            assert!(difference < 0.005, "seed {seed}, {}: {difference} deg", mount.name());
        }
    }
}

/// A sensor turned by a few degrees more, in the same mount: that is a mounting error to be found. Only the weak priors
/// on mounting and soft iron see it; they move a heading by less than a twentieth of its sigma.
#[test]
fn rotating_the_sensor_in_its_mount() {
    for (seed, recorded, mut random) in flights() {
        let axis = Unit::new_normalize(vector(&mut random, 1.0));
        let turn = Rotation3::from_axis_angle(&axis, 10.0_f32.to_radians());
        let turned = changed(&recorded, |s| Sample { field: Field::new(turn * s.field.ut), ..*s });
        let (a, b) = (calibrate(&recorded, Orientation::NONE), calibrate(&turned, Orientation::NONE));
        let difference = difference_deg((&a, &recorded), (&b, &turned));
        assert!(difference < 0.03, "seed {seed}: {difference} deg");
    }
}

/// Only ratios of fields matter; the one number in microtesla is the weak prior on hard iron.
#[test]
fn scaling_the_field() {
    for (seed, recorded, mut random) in flights() {
        let scale = random.uniform(0.5, 2.0);
        let scaled = changed(&recorded, |s| Sample { field: Field::new(s.field.ut * scale), ..*s });
        let (a, b) = (calibrate(&recorded, Orientation::NONE), calibrate(&scaled, Orientation::NONE));
        let difference = difference_deg((&a, &recorded), (&b, &scaled));
        assert!(difference < 0.01, "seed {seed}, by {scale}: {difference} deg");
    }
}

/// The order of the samples is used for the direction of the turns alone, and their times keep that.
#[test]
fn permuting_the_samples() {
    for (seed, recorded, mut random) in flights() {
        let mut permuted = recorded.clone();
        for side in [&mut permuted.left, &mut permuted.right] {
            for i in (1..side.len()).rev() {
                side.swap(i, random.uniform(0.0, i as f32 + 0.999) as usize);
            }
        }
        let (a, b) = (calibrate(&recorded, Orientation::NONE), calibrate(&permuted, Orientation::NONE));
        let difference = difference_deg((&a, &recorded), (&b, &recorded));
        assert!(difference < 0.01, "seed {seed}: {difference} deg");
    }
}
