//! What is tried again, from another start or without what was told, and what comes of it.

use super::NO_PRIOR;
use super::synthetic::{Airframe, Flight, Random, Recorded, rms};
use crate::calibration::{Method, Orientation, Prior, Solution, SolveError, solve};

fn flown(seed: u64, flight: Flight, inclination_deg: f32) -> (Airframe, Recorded) {
    let mut random = Random(9500 + seed);
    let airframe = Airframe::random(&mut random, 0.2, 1.5, 10.0, [inclination_deg; 2]);
    let recorded = flight.fly(&airframe, &mut random);
    (airframe, recorded)
}

fn told(recorded: &Recorded, inclination_deg: f32) -> Result<Solution, SolveError> {
    let prior = Prior { inclination_rad: Some(inclination_deg.to_radians()), ..NO_PRIOR };
    solve(Method::MaximumLikelihood, recorded.turns(), &prior)
}

/// Where a chart was read wrongly, by a little, by a lot or with the other hemisphere's sign, the samples' own
/// inclination is named: to a degree and the rounding to one.
#[test]
fn a_wrong_inclination_is_named() {
    for true_deg in [-65.0, -40.0, -12.0, 12.0, 40.0, 65.0_f32] {
        for seed in 0..2 {
            let (_, recorded) = flown(seed, Flight::REAL, true_deg);
            for told_deg in [true_deg + 6.0, true_deg - 6.0, true_deg + 10.0, true_deg - 20.0, -true_deg] {
                let Err(SolveError::InclinationContradicted { found_deg }) = told(&recorded, told_deg) else {
                    panic!("{true_deg}, told {told_deg}: {:?}", told(&recorded, told_deg));
                };
                assert!((f32::from(found_deg) - true_deg).abs() <= 1.5, "{true_deg}, told {told_deg}: {found_deg}");
            }
            for told_deg in [true_deg + 40.0, true_deg - 40.0] {
                if told_deg.abs() < 85.0 {
                    let named = matches!(told(&recorded, told_deg), Err(SolveError::InclinationContradicted { .. }));
                    assert!(named, "{true_deg}, told {told_deg}");
                }
            }
        }
    }
}

/// A chart is good to half a degree and the ground to the rest; one that is right to two degrees is never the reason,
/// however few the samples are.
#[test]
fn a_right_inclination_is_never_the_reason() {
    for samples in [12, 20, 40, 150] {
        for seed in 0..12 {
            let flight = Flight { samples, attitude_noise_deg: 0.6, ..Flight::REAL };
            let (_, recorded) = flown(seed, flight, if seed % 2 == 0 { 62.0 } else { -35.0 });
            for off_deg in [-2.0, 0.0, 2.0] {
                let found = told(&recorded, if seed % 2 == 0 { 62.0 } else { -35.0 } + off_deg);
                let refused = matches!(found, Err(SolveError::InclinationContradicted { .. }));
                assert!(!refused, "{samples} samples, seed {seed}, {off_deg} deg off: {found:?}");
            }
        }
    }
}

/// Four sigmas of a chart's degree and of what samples know: between 3.5 and 4.8 deg of a good flight.
#[test]
fn a_contradiction_is_of_four_sigmas() {
    for seed in 0..8 {
        let (_, recorded) = flown(seed, Flight { attitude_bias_deg: 0.0, bank_scale: 0.0, ..Flight::REAL }, 50.0);
        for sign in [-1.0, 1.0] {
            assert!(told(&recorded, 50.0 + sign * 3.5).is_ok(), "seed {seed}");
            assert!(told(&recorded, 50.0 + sign * 4.8).is_err(), "seed {seed}");
        }
    }
}

/// With the inclination right, another mounting is still what it was: told or not.
#[test]
fn a_wrong_mounting_is_not_blamed_on_the_inclination() {
    let (_, recorded) = flown(1, Flight::REAL, 55.0);
    for name in ["yaw90", "roll180", "pitch180", "roll90-yaw270"] {
        let found = Orientation::from_name(name).unwrap();
        let refused = told(&recorded.in_mount(found), 55.0).unwrap_err();
        assert_eq!(refused, SolveError::MountContradicted { found }, "{name}");
    }
}

/// What nothing explains is not explained by leaving out the inclination either: the first reason counts.
#[test]
fn what_fails_anyway_keeps_its_reason() {
    let (_, mut recorded) = flown(2, Flight::REAL, 55.0);
    let mut random = Random(5);
    for sample in recorded.left.iter_mut().chain(&mut recorded.right) {
        sample.field.ut = super::synthetic::vector(&mut random, 60.0);
    }
    assert_eq!(told(&recorded, 55.0).unwrap_err(), SolveError::NotConverged);
}

/// A thin flight that expects more than is of use is sought from both starts; the better fit is kept, and what is told
/// to be right still sharpens it or is left out.
#[test]
fn a_thin_flight_loses_nothing_by_a_second_start() {
    let mut doubtful = 0;
    for seed in 0..40 {
        let flight = Flight { samples: 14, attitude_noise_deg: 0.8, bank_deg: 15.0, ..Flight::REAL };
        let (airframe, recorded) = flown(seed, flight, 60.0);
        let Ok(solution) = solve(Method::MaximumLikelihood, recorded.turns(), &NO_PRIOR) else { continue };
        let expected_deg = solution.quality.expected_rms_deg;
        doubtful += usize::from(expected_deg > 3.0);
        let error_deg = rms(&airframe.errors_deg(&solution.calibration));
        assert!(error_deg < 3.5 * expected_deg, "seed {seed}: {error_deg} {expected_deg}");
    }
    assert!(doubtful >= 5, "{doubtful}");
}
