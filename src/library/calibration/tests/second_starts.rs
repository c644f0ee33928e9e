//! Second starts, and solutions without the configured inclination.

use super::synthetic::{Airframe, Flight, Random, RecordedTurns, rms};
use crate::calibration::tests::NO_PRIOR;
use crate::calibration::{Method, Orientation, Prior, Solution, SolveError, solve_samples};

fn flight_at_inclination(seed: u64, flight: Flight, inclination_deg: f32) -> (Airframe, RecordedTurns) {
    let mut random = Random(9500 + seed);
    let airframe = Airframe::random(&mut random, 0.2, 1.5, 10.0, [inclination_deg; 2]);
    let recorded = flight.fly(&airframe, &mut random);
    (airframe, recorded)
}

fn solve_with_inclination(recorded: &RecordedTurns, inclination_deg: f32) -> Result<Solution, SolveError> {
    let prior = Prior { inclination_rad: Some(inclination_deg.to_radians()), ..NO_PRIOR };
    solve_samples(Method::MaximumLikelihood, recorded.turns(), &prior)
}

/// The reported inclination is accurate to 1 deg plus rounding.
#[test]
fn a_wrong_inclination_is_reported() {
    for true_deg in [-65.0, -40.0, -12.0, 12.0, 40.0, 65.0_f32] {
        for seed in 0..2 {
            let (_, recorded) = flight_at_inclination(seed, Flight::TYPICAL, true_deg);
            for configured_deg in [true_deg + 6.0, true_deg - 6.0, true_deg + 10.0, true_deg - 20.0, -true_deg] {
                let Err(SolveError::InclinationContradicted { found_deg }) =
                    solve_with_inclination(&recorded, configured_deg)
                else {
                    panic!(
                        "{true_deg}, configured {configured_deg}: {:?}",
                        solve_with_inclination(&recorded, configured_deg)
                    );
                };
                assert!(
                    (f32::from(found_deg) - true_deg).abs() <= 1.5,
                    "{true_deg}, configured {configured_deg}: {found_deg}"
                );
            }
            for configured_deg in [true_deg + 40.0, true_deg - 40.0] {
                if configured_deg.abs() < 85.0 {
                    let named = matches!(
                        solve_with_inclination(&recorded, configured_deg),
                        Err(SolveError::InclinationContradicted { .. })
                    );
                    assert!(named, "{true_deg}, configured {configured_deg}");
                }
            }
        }
    }
}

#[test]
fn a_correct_inclination_is_never_contradicted() {
    for samples in [12, 20, 40, 150] {
        for seed in 0..12 {
            let flight = Flight { samples_per_side: samples, attitude_noise_deg: 0.6, ..Flight::TYPICAL };
            let (_, recorded) = flight_at_inclination(seed, flight, if seed % 2 == 0 { 62.0 } else { -35.0 });
            for deviation_deg in [-2.0, 0.0, 2.0] {
                let found = solve_with_inclination(&recorded, if seed % 2 == 0 { 62.0 } else { -35.0 } + deviation_deg);
                let refused = matches!(found, Err(SolveError::InclinationContradicted { .. }));
                assert!(!refused, "{samples} samples, seed {seed}, {deviation_deg} deg off: {found:?}");
            }
        }
    }
}

/// Four sigma of the prior (1 deg) and the samples: between 3.5 and 4.8 deg in a good flight.
#[test]
fn the_contradiction_limit_is_four_sigma() {
    for seed in 0..8 {
        let (_, recorded) =
            flight_at_inclination(seed, Flight { attitude_bias_deg: 0.0, bank_scale: 0.0, ..Flight::TYPICAL }, 50.0);
        for sign in [-1.0, 1.0] {
            assert!(solve_with_inclination(&recorded, 50.0 + sign * 3.5).is_ok(), "seed {seed}");
            assert!(solve_with_inclination(&recorded, 50.0 + sign * 4.8).is_err(), "seed {seed}");
        }
    }
}

#[test]
fn a_wrong_mounting_is_reported_with_an_inclination() {
    let (_, recorded) = flight_at_inclination(1, Flight::TYPICAL, 55.0);
    for name in ["yaw90", "roll180", "pitch180", "roll90-yaw270"] {
        let found = Orientation::from_name(name).unwrap();
        let refused = solve_with_inclination(&recorded.in_mount(found), 55.0).unwrap_err();
        assert_eq!(refused, SolveError::MountContradicted { found }, "{name}");
    }
}

#[test]
fn the_first_failure_is_reported() {
    let (_, mut recorded) = flight_at_inclination(2, Flight::TYPICAL, 55.0);
    let mut random = Random(5);
    for sample in recorded.left.iter_mut().chain(&mut recorded.right) {
        sample.field.ut = crate::calibration::tests::synthetic::random_vector(&mut random, 60.0);
    }
    assert_eq!(solve_with_inclination(&recorded, 55.0).unwrap_err(), SolveError::NotConverged);
}

/// A flight with a large expected error is solved from both starts.
#[test]
fn poor_fits_stay_within_3_5_times_the_expected_error() {
    let mut poor_fits = 0;
    for seed in 0..40 {
        let flight = Flight { samples_per_side: 14, attitude_noise_deg: 0.8, bank_deg: 15.0, ..Flight::TYPICAL };
        let (airframe, recorded) = flight_at_inclination(seed, flight, 60.0);
        let Ok(solution) = solve_samples(Method::MaximumLikelihood, recorded.turns(), &NO_PRIOR) else { continue };
        let expected_deg = solution.quality.expected_rms_deg;
        poor_fits += usize::from(expected_deg > 3.0);
        let error_deg = rms(&airframe.errors_deg(&solution.calibration));
        assert!(error_deg < 3.5 * expected_deg, "seed {seed}: {error_deg} {expected_deg}");
    }
    assert!(poor_fits >= 5, "{poor_fits}");
}
