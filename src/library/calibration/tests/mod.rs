//! Tests of the solver. This file: accuracy.

mod change_detection;
pub(crate) mod derivatives;
mod expected_error;
mod free_flight;
mod latency;
mod likelihood;
mod manoeuvre_advice;
mod methods;
mod motor_current;
mod rejections;
mod robustness;
mod second_starts;
mod symmetry;
pub(crate) mod synthetic;
mod value_types;

use nalgebra::Vector3;

use crate::calibration::closed_form::starting_point::StartingPoint;
use crate::calibration::model::{JacobianRow, ResidualEquation};
use crate::calibration::{Method, Orientation, Prior, Solution, SolveError, solve_samples};
use synthetic::{Airframe, Flight, Random, RecordedTurns, max_abs, mean, quantile, rms};

impl Airframe {
    pub(in crate::calibration) fn exact_start(&self) -> StartingPoint {
        StartingPoint {
            field_unit_ut: self.total_ut,
            w: self.a.try_inverse().unwrap(),
            hard_iron: self.b_ut / self.total_ut,
            inclination_rad: self.inclination_rad,
        }
    }
}

const NO_PRIOR: Prior = Prior {
    mount: Orientation::IDENTITY_ROTATION,
    inclination_rad: None,
    is_inclination_modelled: false,
    readings_per_sample: 1,
};

/// Agreement to `f32` rounding.
pub(in crate::calibration) fn is_close(found: f32, expected: f32) -> bool {
    (found - expected).abs() <= 2e-4 * expected.abs()
}

pub(in crate::calibration) const ZERO_ROW: JacobianRow = JacobianRow {
    derivative_by_field: Vector3::new(0.0, 0.0, 0.0),
    centred_field: Vector3::new(0.0, 0.0, 0.0),
    derivative_by_inclination: 0.0,
};

/// Equation of a residual that no unknown affects, unclipped.
pub(in crate::calibration) fn constant_equation(weight: f32, residual: f32) -> ResidualEquation {
    ResidualEquation::new(ZERO_ROW, residual, 1.0 / weight, 1e6)
}

fn solve_turns(recorded: &RecordedTurns) -> Result<Solution, SolveError> {
    solve_samples(Method::MaximumLikelihood, recorded.turns(), &NO_PRIOR)
}

/// Worst plausible airframes: soft iron 30 %, hard iron 3 H0, mounting 20 deg.
fn harsh_airframe(random: &mut Random) -> Airframe {
    Airframe::random(random, 0.3, 3.0, 20.0, [-60.0, 75.0])
}

#[test]
fn maximum_likelihood_is_exact_without_noise() {
    for seed in 0..50 {
        let mut random = Random(seed);
        let airframe = harsh_airframe(&mut random);
        let flight = Flight { wander_deg: 2.0, ..Flight::NOISE_FREE };
        let solution = solve_turns(&flight.fly(&airframe, &mut random)).unwrap();
        let error = max_abs(&airframe.errors_deg(&solution.calibration));
        // The priors bias the fit, because the residual scales have lower limits: 0.1 deg at worst.
        assert!(error < 0.1, "seed {seed}: {error} deg");
    }
}

#[test]
fn every_start_converges() {
    for seed in 0..200 {
        let mut random = Random(1000 + seed);
        let airframe = harsh_airframe(&mut random);
        let flight = Flight { bank_deg: random.uniform(15.0, 45.0), sensor_noise_ut: 0.3, ..Flight::TYPICAL };
        let solution =
            solve_turns(&flight.fly(&airframe, &mut random)).unwrap_or_else(|e| panic!("seed {seed}: {e:?}"));
        airframe.assert_expected_error_is_honest(&solution, seed);
    }
}

#[test]
fn expected_error_matches_the_actual_error_of_100_flights() {
    let mut actual = Vec::new();
    let mut constant = Vec::new();
    let mut ratios = Vec::new();
    for seed in 0..100 {
        let (mut random, airframe) = Airframe::seeded(5000 + seed, 0.2, 1.5, 10.0, [-70.0, 70.0]);
        let solution = solve_turns(&Flight::TYPICAL.fly(&airframe, &mut random)).unwrap();
        let errors = airframe.errors_deg(&solution.calibration);
        actual.push(rms(&errors));
        constant.push(mean(&errors).abs());
        ratios.push(airframe.error_ratio(&solution));
    }
    assert!(quantile(&actual, 0.5) <= 0.4 && max_abs(&actual) <= 1.0, "{actual:?}");
    assert!(max_abs(&constant) <= 0.6, "{constant:?}");
    assert!(max_abs(&ratios) <= 3.0, "{ratios:?}");
    // The mean square of actual over expected error, ideally 1, scatters by half in 100 flights.
    let mean_square = rms(&ratios).powi(2);
    assert!((0.5..1.5).contains(&mean_square), "{mean_square}");
}
