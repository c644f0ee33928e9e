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

use nalgebra::{Matrix3, Vector3};

use crate::calibration::closed_form::starting_point::StartingPoint;
use crate::calibration::closed_form::two_plane;
use crate::calibration::method_selection;
use crate::calibration::method_selection::Procedure;
use crate::calibration::verification;
use crate::calibration::{
    Calibration, CollectionPart, Method, Orientation, Prior, SamplePart, Side, SolveError, matrix_rows, solve_samples,
};
use crate::frames::Field;
use synthetic::{Airframe, Flight, Random, RecordedTurns, max_abs, mean, quantile, random_vector, rms};

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

fn solve_turns(recorded: &RecordedTurns) -> Result<crate::calibration::assessment::Solution, SolveError> {
    solve_samples(Method::MaximumLikelihood, recorded.turns(), &NO_PRIOR)
}

/// Worst plausible airframes: soft iron 30 %, hard iron 3 H0, mounting 20 deg.
fn harsh_airframe(random: &mut Random) -> Airframe {
    Airframe::random(random, 0.3, 3.0, 20.0, [-60.0, 75.0])
}

/// Exact at constant bank and zero pitch. A conic loses half of f32's digits: 0.05 deg at worst.
#[test]
fn two_planes_are_exact_on_perfect_turns() {
    for seed in 0..50 {
        let mut random = Random(seed);
        let airframe = harsh_airframe(&mut random);
        let mut flight = Flight { bank_deg: random.uniform(15.0, 45.0), ..Flight::NOISE_FREE };
        flight.samples_per_side = 200;
        let mut recorded = flight.fly(&airframe, &mut random);
        for sample in recorded.left.iter_mut().chain(&mut recorded.right) {
            // The generator flies at 2 deg of pitch; the closed form requires zero.
            let heading = sample
                .attitude
                .to_level_frame(Field::new(airframe.a.try_inverse().unwrap() * (sample.field.ut - airframe.b_ut)));
            sample.attitude.pitch_rad = 0.0;
            sample.field = airframe.field(sample.attitude, heading.heading_rad());
        }
        let planes = two_plane::solve_two_plane(recorded.turns(), &Matrix3::identity()).unwrap();
        let w = planes.response_ut.try_inverse().unwrap().cast::<f32>();
        let none = Calibration::uncalibrated(Orientation::IDENTITY_ROTATION);
        let calibration =
            Calibration { w: matrix_rows(&w), b_ut: planes.hard_iron_ut.cast::<f32>().into(), total_ut: 1.0, ..none };
        let error = max_abs(&airframe.errors_deg(&calibration));
        assert!(error < 0.05, "seed {seed}: {error} deg");
    }
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
        let errors = airframe.errors_deg(&solution.calibration);
        let expected = solution.quality.expected_rms_deg;
        assert!(rms(&errors) < 3.0 * expected, "seed {seed}: {} deg, expected {expected}", rms(&errors));
    }
}

#[test]
fn expected_error_matches_the_actual_error_of_100_flights() {
    let mut actual = Vec::new();
    let mut constant = Vec::new();
    let mut ratios = Vec::new();
    for seed in 0..100 {
        let mut random = Random(5000 + seed);
        let airframe = Airframe::random(&mut random, 0.2, 1.5, 10.0, [-70.0, 70.0]);
        let solution = solve_turns(&Flight::TYPICAL.fly(&airframe, &mut random)).unwrap();
        let errors = airframe.errors_deg(&solution.calibration);
        actual.push(rms(&errors));
        constant.push(mean(&errors).abs());
        ratios.push(rms(&errors) / solution.quality.expected_rms_deg);
    }
    println!(
        "rms median {} worst {}; constant worst {}; actual/expected median {} worst {}, mean square {}",
        quantile(&actual, 0.5),
        max_abs(&actual),
        max_abs(&constant),
        quantile(&ratios, 0.5),
        max_abs(&ratios),
        mean(&ratios.iter().map(|r| r * r).collect::<Vec<_>>())
    );
    assert!(quantile(&actual, 0.5) <= 0.4);
    assert!(max_abs(&actual) <= 1.0);
    assert!(max_abs(&constant) <= 0.6);
    assert!(max_abs(&ratios) <= 3.0);
    // The mean square of actual over expected error, ideally 1, scatters by half in 100 flights.
    let mean_square = mean(&ratios.iter().map(|r| r * r).collect::<Vec<_>>());
    assert!((0.5..1.5).contains(&mean_square), "{mean_square}");
}

#[test]
fn every_right_angle_mounting_is_solved_and_a_wrong_one_reported() {
    let mut random = Random(7);
    let airframe = Airframe::random(&mut random, 0.1, 1.0, 5.0, [60.0, 60.0]);
    let recorded = Flight::TYPICAL.fly(&airframe, &mut random);
    for mount in Orientation::all_orientations() {
        let turned = recorded.in_mount(mount);
        let solution = solve_samples(Method::MaximumLikelihood, turned.turns(), &Prior { mount, ..NO_PRIOR }).unwrap();
        let in_chip_axes = Airframe {
            a: mount.body_from_sensor().transpose() * airframe.a,
            b_ut: mount.body_from_sensor().transpose() * airframe.b_ut,
            ..airframe
        };
        assert!(rms(&in_chip_axes.errors_deg(&solution.calibration)) < 1.0, "{}", mount.orientation_name());
        if mount != Orientation::IDENTITY_ROTATION {
            let contradicted = solve_turns(&turned).unwrap_err();
            assert_eq!(contradicted, SolveError::MountContradicted { found: mount });
        }
    }
}

#[test]
fn unsolvable_samples_are_rejected_with_a_reason() {
    let mut random = Random(11);
    let airframe = Airframe::random(&mut random, 0.1, 1.0, 5.0, [50.0, 50.0]);
    let good = Flight::TYPICAL.fly(&airframe, &mut random);
    let refused = |change: &dyn Fn(&mut RecordedTurns)| {
        let mut recorded = good.clone();
        change(&mut recorded);
        solve_turns(&recorded).map(|solution| solution.quality.expected_rms_deg)
    };
    let one_side = good.turns().without_part(CollectionPart::LEFT);
    let missing = method_selection::select_method(one_side, Procedure::Turns);
    assert!(matches!(missing, Err(SolveError::TooFewSamples { part: SamplePart::Turns(Side::Left), have: 0, .. })));
    assert_eq!(refused(&|r| r.right[3].field.ut.y = f32::NAN), Err(SolveError::NotFinite));
    assert_eq!(refused(&|r| r.left[9].attitude.roll_rad = f32::NAN), Err(SolveError::NotFinite));
    // With an inverted roll, right turns are labelled left.
    let reversed = refused(&|r| {
        core::mem::swap(&mut r.left, &mut r.right);
        for sample in r.left.iter_mut().chain(&mut r.right) {
            sample.attitude.roll_rad = -sample.attitude.roll_rad;
        }
    });
    assert!(reversed.is_err(), "{reversed:?}");
    let constant_heading = refused(&|r| {
        for sample in r.left.iter_mut().chain(&mut r.right) {
            sample.field = airframe.field(sample.attitude, 1.0);
        }
    });
    assert!(
        constant_heading.is_err() || constant_heading.is_ok_and(|expected_deg| expected_deg > 3.0),
        "{constant_heading:?}"
    );
    let mut noise = Random(3);
    let mut chaos = good.clone();
    for sample in chaos.left.iter_mut().chain(&mut chaos.right) {
        sample.field = Field::new(random_vector(&mut noise, 60.0));
    }
    assert!(solve_turns(&chaos).is_err());
}

#[test]
fn verification_scores_the_true_calibration_best() {
    let mut random = Random(21);
    let airframe = Airframe::random(&mut random, 0.2, 1.5, 10.0, [60.0, 60.0]);
    let held_back = Flight::TYPICAL.fly(&airframe, &mut random);
    let true_calibration = Calibration {
        w: matrix_rows(&airframe.a.try_inverse().unwrap()),
        b_ut: airframe.b_ut.into(),
        inclination_rad: airframe.inclination_rad,
        total_ut: airframe.total_ut,
        latency_s: 0.0,
        motor_current: crate::calibration::MotorCurrentInterference::NO_INTERFERENCE,
    };
    let uncalibrated = Calibration::uncalibrated(Orientation::IDENTITY_ROTATION);
    // 2 uT of hard iron are about 4 deg of heading in this field.
    let shifted = Calibration { b_ut: (airframe.b_ut + Vector3::new(2.0, 0.0, 0.0)).into(), ..true_calibration };
    for wrong_calibration in [uncalibrated, shifted] {
        let scores = verification::score_held_back(held_back.turns(), true, &true_calibration, &wrong_calibration);
        assert!(scores.candidate_score < scores.active_score, "{scores:?}");
    }
    let none = RecordedTurns { left: Vec::new(), right: Vec::new() };
    let scores = verification::score_held_back(none.turns(), true, &true_calibration, &uncalibrated);
    assert!(scores.candidate_score.is_nan() && scores.active_score.is_nan());
}
