//! Second starts, and solutions without the configured inclination.

use super::NO_PRIOR;
use super::synthetic::{Airframe, Flight, Random, RecordedTurns};
use crate::calibration::{Method, Prior, Solution, SolveError, solve_samples};

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

/// The reported inclination is accurate to 1 deg plus rounding; 40 deg off, the field may be next to the vertical.
#[test]
fn a_wrong_inclination_is_reported() {
    for true_deg in [-65.0, -40.0, -12.0, 12.0, 40.0, 65.0_f32] {
        for seed in 0..2 {
            let (_, recorded) = flight_at_inclination(seed, Flight::TYPICAL, true_deg);
            for (off_deg, is_accurate) in [
                (6.0, true),
                (-6.0, true),
                (10.0, true),
                (-20.0, true),
                (-2.0 * true_deg, true),
                (40.0, false),
                (-40.0, false),
            ] {
                let configured_deg = true_deg + off_deg;
                if !is_accurate && configured_deg.abs() >= 85.0 {
                    continue;
                }
                let refused = solve_with_inclination(&recorded, configured_deg).map(|solution| solution.quality);
                let Err(SolveError::InclinationContradicted { found_deg }) = refused else {
                    panic!("{true_deg}, configured {configured_deg}: {refused:?}")
                };
                let error_deg = (f32::from(found_deg) - true_deg).abs();
                assert!(!is_accurate || error_deg <= 1.5, "{true_deg}, configured {configured_deg}: {found_deg}");
            }
        }
    }
}

#[test]
fn a_correct_inclination_is_never_contradicted() {
    for samples in [12, 20, 40, 150] {
        for seed in 0..12 {
            let flight = Flight { samples_per_side: samples, attitude_noise_deg: 0.6, ..Flight::TYPICAL };
            let true_deg = if seed % 2 == 0 { 62.0 } else { -35.0 };
            let (_, recorded) = flight_at_inclination(seed, flight, true_deg);
            for deviation_deg in [-2.0, 0.0, 2.0] {
                let found = solve_with_inclination(&recorded, true_deg + deviation_deg);
                let refused = matches!(found, Err(SolveError::InclinationContradicted { .. }));
                assert!(!refused, "{samples} samples, seed {seed}, {deviation_deg} deg off: {found:?}");
            }
        }
    }
}

/// A flight with a large expected error is solved from both starts.
#[test]
fn poor_fits_stay_within_3_5_times_the_expected_error() {
    let mut poor_fits = 0;
    for seed in 0..40 {
        let flight = Flight { samples_per_side: 14, attitude_noise_deg: 0.8, bank_deg: 15.0, ..Flight::TYPICAL };
        let (airframe, recorded) = flight_at_inclination(seed, flight, 60.0);
        let Ok(solution) = solve_samples(Method::MaximumLikelihood, recorded.turns(), &NO_PRIOR) else { continue };
        poor_fits += usize::from(solution.quality.expected_rms_deg > 3.0);
        assert!(airframe.error_ratio(&solution) < 3.5, "seed {seed}: {}", airframe.error_ratio(&solution));
    }
    assert!(poor_fits >= 5, "{poor_fits}");
}
