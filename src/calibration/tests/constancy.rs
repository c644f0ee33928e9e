//! Samples of two airframes, and attitude sources that misread bank: what is said of them, and what of good flights.

use nalgebra::Vector3;

use super::synthetic::{Airframe, Flight, Random, Recorded, largest, mean, rms, vector};
use super::{NO_PRIOR, solved};
use crate::calibration::{Course, IronChange, Method, Solution, SolveError, solve};
use crate::time::WrappingMillis;

/// An ordinary flight: 75 s of left turns, then 75 s of right ones.
fn flown(seed: u64, flight: Flight) -> (Airframe, Recorded) {
    let mut random = Random(9000 + seed);
    let airframe = Airframe::random(&mut random, 0.2, 1.5, 10.0, [-70.0, 70.0]);
    let mut recorded = flight.fly(&airframe, &mut random);
    for sample in &mut recorded.right {
        sample.time = WrappingMillis::new(sample.time.count() + 75_000);
    }
    (airframe, recorded)
}

/// All of a flight.
const SPAN_MS: u32 = 149_500;

/// The same flight with hard iron that was more by `beta_ut` times a share that depends on time; and at its end as the
/// airframe says.
fn changed(recorded: &Recorded, beta_ut: Vector3<f32>, share: impl Fn(u32) -> f32) -> Recorded {
    let mut changed = recorded.clone();
    for sample in changed.left.iter_mut().chain(&mut changed.right) {
        sample.field.ut += beta_ut * share(sample.time.count());
    }
    changed
}

fn moved_at(recorded: &Recorded, beta_ut: Vector3<f32>, at_ms: u32) -> Recorded {
    changed(recorded, beta_ut, |ms| if ms < at_ms { 1.0 } else { 0.0 })
}

fn error_deg(airframe: &Airframe, solution: &Solution) -> f32 {
    rms(&airframe.errors_deg(&solution.calibration))
}

/// A clean flight in still to rough air says nothing of either; of 75, five look as if bank was misread by chance.
#[test]
fn a_constant_airframe_is_not_doubted() {
    let mut suspected = 0;
    for wander_deg in [0.5, 2.0, 4.0] {
        for seed in 0..25 {
            let (_, recorded) = flown(seed, Flight { wander_deg, ..Flight::REAL });
            let solution = solved(&recorded).unwrap();
            assert_eq!(solution.iron, None, "seed {seed}, wander {wander_deg} deg");
            suspected += usize::from(solution.bank.is_some());
        }
    }
    assert!(suspected <= 8, "{suspected}");
}

/// A payload that moved is found, with its size, and when; whether it is refused is for acceptance to say, but what is
/// expected allows for it. 1 uT is found to a fifth at the median, the instant to the 5 s between those tried.
#[test]
fn a_payload_that_moved_is_found() {
    for (size_ut, at_ms) in [(1.0, 40_000), (2.0, 75_000), (4.0, 20_000), (4.0, 130_000)] {
        let (mut sizes, mut late_s, mut ratios) = (Vec::new(), Vec::new(), Vec::new());
        for seed in 0..20 {
            let (airframe, recorded) = flown(seed, Flight::REAL);
            let mut random = Random(seed);
            let beta_ut = vector(&mut random, 1.0).normalize() * size_ut;
            let Ok(solution) = solved(&moved_at(&recorded, beta_ut, at_ms)) else { continue };
            ratios.push(error_deg(&airframe, &solution) / solution.quality.expected_rms_deg);
            let Some(doubt) = solution.iron else { continue };
            assert!(doubt.error_deg > 0.0 && doubt.without_deg > 0.0);
            let total = doubt.error_deg.hypot(doubt.without_deg);
            assert!((total / solution.quality.expected_rms_deg - 1.0).abs() < 1e-3, "{doubt:?}");
            let IronChange { ut, course, of_s } = doubt.of;
            assert_eq!(of_s, 149);
            sizes.push(ut / size_ut);
            if let Course::Step { after_s } = course {
                late_s.push(f32::from(after_s) - at_ms as f32 / 1000.0);
            }
        }
        assert!(sizes.len() >= 19 && late_s.len() >= 18, "{size_ut} uT: {sizes:?} {late_s:?}");
        sizes.sort_by(f32::total_cmp);
        assert!((0.8..1.2).contains(&sizes[sizes.len() / 2]), "{size_ut} uT: {sizes:?}");
        late_s.sort_by(f32::total_cmp);
        assert!(late_s[late_s.len() / 2].abs() <= 5.0, "{late_s:?}");
        assert!(largest(&ratios) < 3.0, "{size_ut} uT at {at_ms} ms: {ratios:?}");
    }
}

/// A zero that drifts is told from a step.
#[test]
fn a_drift_is_found() {
    for seed in 0..20 {
        let (airframe, recorded) = flown(seed, Flight::REAL);
        let mut random = Random(seed);
        let beta_ut = vector(&mut random, 1.0).normalize() * 3.0;
        let drifted = changed(&recorded, beta_ut, |ms| 1.0 - ms as f32 / SPAN_MS as f32);
        let solution = solved(&drifted).unwrap();
        let IronChange { ut, course, .. } = solution.iron.unwrap().of;
        assert_eq!(course, Course::Drift, "seed {seed}");
        assert!((ut / 3.0 - 1.0).abs() < 0.35, "seed {seed}: {ut}");
        let ratio = error_deg(&airframe, &solution) / solution.quality.expected_rms_deg;
        assert!(ratio < 2.0, "seed {seed}: {ratio}");
    }
}

/// A change is found whichever way the closed forms or the refinement came to their coefficients, and in any mounting
/// of the clock: it wraps in mid-flight.
#[test]
fn a_change_is_found_by_every_method_of_turns_and_at_any_time() {
    let flight = Flight { wander_deg: 0.5, ..Flight::REAL };
    let (_, recorded) = flown(3, flight);
    let mut moved = moved_at(&recorded, Vector3::new(1.5, 0.0, 1.5), 60_000);
    for offset in [0, u32::MAX - 80_000] {
        for sample in moved.left.iter_mut().chain(&mut moved.right) {
            sample.time = WrappingMillis::new(sample.time.count().wrapping_add(offset));
        }
        for method in [Method::MaximumLikelihood, Method::TwoPlane] {
            let iron = solve(method, moved.turns(), &NO_PRIOR).unwrap().iron.unwrap();
            let Course::Step { after_s } = iron.of.course else { panic!("{iron:?}") };
            assert!((55..=65).contains(&after_s), "{method:?}: {iron:?}");
        }
    }
}

/// Samples without times, as far as they say, are of one instant: nothing changes in that.
#[test]
fn samples_of_one_instant_show_no_change() {
    let (_, recorded) = flown(4, Flight::REAL);
    let mut moved = moved_at(&recorded, Vector3::new(2.0, 0.0, 2.0), 60_000);
    for sample in moved.left.iter_mut().chain(&mut moved.right) {
        sample.time = WrappingMillis::default();
    }
    assert_eq!(solved(&moved).unwrap().iron, None);
}

/// What changed by so much that nothing explains the samples is named all the same, instead of a mounting or nothing.
#[test]
fn a_change_beyond_all_fits_is_named() {
    let mut named = 0;
    for seed in 0..20 {
        let (_, recorded) = flown(seed, Flight::REAL);
        let mut random = Random(seed);
        let beta_ut = vector(&mut random, 1.0).normalize() * 12.0;
        match solved(&moved_at(&recorded, beta_ut, 75_000)) {
            Err(SolveError::IronChanged(IronChange { ut, .. })) => {
                assert!(ut > 2.0, "seed {seed}: {ut}");
                named += 1;
            }
            Ok(solution) => assert!(solution.iron.is_some(), "seed {seed}"),
            Err(_) => {}
        }
    }
    assert!(named >= 3, "{named}");
}

/// An attitude source that leans for the last five seconds makes dips that look like other iron, but not norms.
#[test]
fn a_lean_at_the_end_is_not_a_change_of_the_iron() {
    for seed in 0..20 {
        let (_, mut recorded) = flown(seed, Flight::REAL);
        for sample in recorded.right.iter_mut().skip(140) {
            sample.attitude.roll_rad += 0.08;
            sample.attitude.pitch_rad -= 0.05;
        }
        assert_eq!(solved(&recorded).unwrap().iron, None, "seed {seed}");
    }
}

/// A source that reads 90 % of the bank: what is expected is at least half of what is. Without a doubt it was a fifth.
#[test]
fn a_lean_in_turns_is_allowed_for() {
    for (bank_scale, told) in [(-0.1, 0.9), (0.1, 1.1)] {
        let (mut ratios, mut reads) = (Vec::new(), Vec::new());
        for seed in 0..30 {
            let (airframe, recorded) = flown(seed, Flight { bank_scale, ..Flight::REAL });
            let solution = solved(&recorded).unwrap();
            ratios.push(error_deg(&airframe, &solution) / solution.quality.expected_rms_deg);
            assert_eq!(solution.iron, None, "seed {seed}");
            let Some(doubt) = solution.bank else { continue };
            let total = doubt.error_deg.hypot(doubt.without_deg);
            assert!((total / solution.quality.expected_rms_deg - 1.0).abs() < 1e-3, "{doubt:?}");
            assert!(doubt.of.sigmas > 1.7, "{doubt:?}");
            reads.push(doubt.of.read);
        }
        assert!(ratios.iter().filter(|&&ratio| ratio > 2.0).count() <= 2, "{bank_scale}: {ratios:?}");
        assert!(reads.len() >= 28 && (mean(&reads) - told).abs() < 0.02, "{bank_scale}: {reads:?}");
    }
}

/// Where bank does not wander, nothing is seen of it but the noise of the source, which is no error of bank.
#[test]
fn steady_bank_says_nothing_of_the_source() {
    for seed in 0..20 {
        let (_, recorded) = flown(seed, Flight { wander_deg: 0.05, ..Flight::REAL });
        assert_eq!(solved(&recorded).unwrap().bank, None, "seed {seed}");
    }
}
