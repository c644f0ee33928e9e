//! Motor-current interference: estimation, use, and effect on the expected error.

use nalgebra::{Matrix3, SVector, Vector3};

use super::synthetic::{Airframe, Flight, Random, RecordedTurns, mean, random_vector, rms};
use crate::calibration::fit::linearised_problem::LinearisedProblem;
use crate::calibration::hypotheses::motor_current::InterferenceEstimate;
use crate::calibration::model::{Likelihood, ModelConfig, ModelParameters, NoiseModel, for_each_prior};
use crate::calibration::tests::{NO_PRIOR, solve_turns};
use crate::calibration::uncertainty::information::Information;
use crate::calibration::verification;
use crate::calibration::{
    Calibration, LeastSquares, Method, MotorCurrent, MotorCurrentInterference, Orientation, Prior, Sample, Solution,
    solve_samples,
};
use crate::frames::Field;

#[derive(Clone, Copy, Debug)]
enum CurrentProfile {
    /// 10 A, and 40 A for 3 s in every 9 s.
    Bursts,
    /// 20 A with 0.1 A of noise.
    Steady,
    /// 10 A in the left turn, 30 A in the right.
    BySide,
}

impl CurrentProfile {
    fn current_a(self, t_s: f32, is_right: bool, random: &mut Random) -> f32 {
        match self {
            Self::Bursts => (if t_s % 9.0 < 3.0 { 40.0 } else { 10.0 }) + random.normal(),
            Self::Steady => 20.0 + 0.1 * random.normal(),
            Self::BySide => (if is_right { 30.0 } else { 10.0 }) + 0.1 * random.normal(),
        }
    }
}

fn fly_with_current(
    airframe: &Airframe,
    k: Vector3<f32>,
    currents: CurrentProfile,
    random: &mut Random,
) -> RecordedTurns {
    let mut recorded = Flight::TYPICAL.fly(airframe, random);
    for (is_right, side) in [(false, &mut recorded.left), (true, &mut recorded.right)] {
        for (i, sample) in side.iter_mut().enumerate() {
            let current_a = currents.current_a(i as f32 * 0.4, is_right, random);
            sample.field.ut += k * current_a;
            sample.current = MotorCurrent::from_a(Some(current_a));
        }
    }
    recorded
}

#[derive(Default)]
struct FlightResults {
    applied_flight_count: usize,
    normalised_errors: Vec<f32>,
    errors_deg: Vec<f32>,
    expected_errors_deg: Vec<f32>,
}

/// Heading errors at the mean current plus and minus its standard deviation, degrees.
fn errors_deg(airframe: &Airframe, k: Vector3<f32>, solution: &Solution) -> Vec<f32> {
    let MotorCurrentInterference { mean_current_a: mean_a, current_sigma_a: spread_a, .. } =
        solution.calibration.motor_current;
    let at = |current_a: f32| {
        // Uncorrected interference acts as additional hard iron.
        let added = k * current_a - solution.calibration.motor_current.interference_ut(Some(current_a));
        Airframe { b_ut: airframe.b_ut + added, ..*airframe }.errors_deg(&solution.calibration)
    };
    [mean_a - spread_a, mean_a + spread_a].map(at).concat()
}

fn interference_results(size_ut_per_a: f32, currents: CurrentProfile) -> FlightResults {
    let mut shown = FlightResults::default();
    for seed in 0..40 {
        let mut random = Random(4000 + seed);
        let airframe = Airframe::random(&mut random, 0.1, 1.0, 5.0, [-65.0, 65.0]);
        let k = random_vector(&mut random, 1.0).normalize() * size_ut_per_a;
        let solution = solve_turns(&fly_with_current(&airframe, k, currents, &mut random)).unwrap();
        let interference = solution.calibration.motor_current;
        if interference.is_applied() {
            shown.applied_flight_count += 1;
            let estimate_error = Vector3::from(interference.ut_per_a) - k;
            shown.normalised_errors.extend(estimate_error.iter().map(|axis| axis / interference.sigma_ut_per_a));
        }
        shown.errors_deg.push(rms(&errors_deg(&airframe, k, &solution)));
        shown.expected_errors_deg.push(solution.quality.expected_rms_deg);
    }
    shown
}

impl FlightResults {
    fn error_ratio_rms(&self) -> f32 {
        rms(&self
            .errors_deg
            .iter()
            .zip(&self.expected_errors_deg)
            .map(|(error, expected)| error / expected)
            .collect::<Vec<_>>())
    }
}

/// 0.4 uT/A with bursts of 30 A is 12 uT. The sigma is that of the least observable axis, so normalised errors are
/// below 1.
#[test]
fn interference_is_estimated_and_used() {
    let shown = interference_results(0.4, CurrentProfile::Bursts);
    assert_eq!(shown.applied_flight_count, 40);
    assert!((0.5..1.1).contains(&rms(&shown.normalised_errors)), "{}", rms(&shown.normalised_errors));
    assert!((0.6..1.05).contains(&shown.error_ratio_rms()), "{}", shown.error_ratio_rms());
    assert!(mean(&shown.expected_errors_deg) < 0.35 && mean(&shown.errors_deg) < 0.3, "{:?}", shown.errors_deg);
}

#[test]
fn insignificant_interference_is_not_used() {
    let shown = interference_results(0.0, CurrentProfile::Bursts);
    assert_eq!(shown.applied_flight_count, 0);
    assert!((0.6..1.05).contains(&shown.error_ratio_rms()), "{}", shown.error_ratio_rms());
    assert!(mean(&shown.expected_errors_deg) < 0.35, "{:?}", shown.expected_errors_deg);
}

#[test]
fn a_steady_current_is_hard_iron() {
    let shown = interference_results(0.4, CurrentProfile::Steady);
    assert_eq!(shown.applied_flight_count, 0);
    assert!((0.6..1.05).contains(&shown.error_ratio_rms()), "{}", shown.error_ratio_rms());
    assert!(mean(&shown.expected_errors_deg) < 0.35, "{:?}", shown.expected_errors_deg);
}

/// The current correlates with the turn side, as would a change of hard iron; both sides together determine `k`, with a
/// larger expected error.
#[test]
fn interference_correlated_with_the_turn_is_estimated() {
    let shown = interference_results(0.4, CurrentProfile::BySide);
    assert_eq!(shown.applied_flight_count, 40);
    assert!((0.6..1.05).contains(&shown.error_ratio_rms()), "{}", shown.error_ratio_rms());
    assert!(mean(&shown.expected_errors_deg) < 0.4, "{:?}", shown.expected_errors_deg);
}

fn flight_with_current(seed: u64) -> (Airframe, Vector3<f32>, RecordedTurns) {
    let mut random = Random(seed);
    let airframe = Airframe::random(&mut random, 0.1, 1.0, 5.0, [50.0, 60.0]);
    let k = Vector3::new(0.25, -0.3, 0.15);
    let recorded = fly_with_current(&airframe, k, CurrentProfile::Bursts, &mut random);
    (airframe, k, recorded)
}

#[test]
fn without_current_there_is_no_estimate() {
    let mut random = Random(1);
    let airframe = Airframe::random(&mut random, 0.1, 1.0, 5.0, [50.0, 60.0]);
    // Interference small enough for a calibration to be accepted without its correction.
    let recorded = fly_with_current(&airframe, Vector3::new(0.05, -0.06, 0.03), CurrentProfile::Bursts, &mut random);
    let strip = |samples: &[Sample], period: usize| -> Vec<Sample> {
        let current = |i: usize, s: &Sample| if i.is_multiple_of(period) { MotorCurrent::UNKNOWN } else { s.current };
        samples.iter().enumerate().map(|(i, s)| Sample { current: current(i, s), ..*s }).collect()
    };
    let with_every_nth_current =
        |period: usize| RecordedTurns { left: strip(&recorded.left, period), right: strip(&recorded.right, period) };
    let [none, few, many] = [1, 3, 5].map(|period| solve_turns(&with_every_nth_current(period)).unwrap());
    assert_eq!(
        (none.calibration.motor_current, few.calibration.motor_current),
        (MotorCurrentInterference::NO_INTERFERENCE, MotorCurrentInterference::NO_INTERFERENCE)
    );
    assert_eq!(none.calibration, few.calibration);
    // One sample in five lacks a current.
    assert!(many.calibration.motor_current.is_applied());
    let solution_with_currents = solve_turns(&recorded).unwrap();
    assert!(
        solution_with_currents.quality.norm_residual < 0.5 * none.quality.norm_residual,
        "{solution_with_currents:?} {none:?}"
    );
}

#[test]
fn verification_corrects_for_the_current() {
    let (_, _, recorded) = flight_with_current(2);
    let calibration = solve_turns(&recorded).unwrap().calibration;
    let without_interference = Calibration { motor_current: MotorCurrentInterference::NO_INTERFERENCE, ..calibration };
    let scores = verification::score_held_back(recorded.turns(), true, &calibration, &without_interference);
    assert!(scores.candidate_score < 0.2 * scores.active_score, "{scores:?}");
}

/// At unknown current the field is corrected for the mean current. Heading variance grows outside the calibrated
/// currents with the sigma of `k`, and with `k` itself at unknown current.
#[test]
fn heading_variance_grows_outside_the_calibrated_currents() {
    let current = MotorCurrentInterference {
        ut_per_a: [0.3, 0.0, 0.4],
        sigma_ut_per_a: 0.02,
        mean_current_a: 20.0,
        current_sigma_a: 10.0,
    };
    let calibration = Calibration {
        inclination_rad: 60_f32.to_radians(),
        total_ut: 50.0,
        motor_current: current,
        ..Calibration::uncalibrated(NO_PRIOR.mount)
    };
    let field = Field::from_ut(10.0, 5.0, 40.0);
    for (current_a, added) in [(Some(10.0), 10.0), (Some(0.0), 0.0), (None, 20.0)] {
        let expected = field.ut - Vector3::new(0.3, 0.0, 0.4) * added;
        assert!((calibration.remove_motor_current(field, current_a).ut - expected).norm() < 1e-5);
    }
    for (current_a, sigma_ut) in [
        (Some(20.0), 0.0),
        (Some(10.0), 0.0),
        (Some(30.0), 0.0),
        (Some(50.0), 0.02 * f32::sqrt(900.0 - 100.0)),
        (Some(0.0), 0.02 * f32::sqrt(400.0 - 100.0)),
        (None, 0.5 * 10.0),
    ] {
        let sigma_rad = calibration.motor_current_heading_variance_rad2(current_a).sqrt();
        assert!((sigma_rad - sigma_ut / 25.0).abs() < 1e-5, "{current_a:?}: {sigma_rad}");
    }
    // No NaN from zero interference with an unlimited current range.
    assert_eq!(Calibration::uncalibrated(NO_PRIOR.mount).motor_current_heading_variance_rad2(None).to_bits(), 0);
}

/// Eliminating the three unknowns gives the step and covariance of a joint least-squares solution for sixteen unknowns
/// with priors, for white errors.
#[test]
fn elimination_equals_a_joint_solution_of_sixteen_unknowns() {
    let (airframe, k, recorded) = flight_with_current(3);
    let samples = recorded.turns();
    let mut likelihood = Likelihood::new(&NO_PRIOR, ModelConfig::DEFAULT, samples, airframe.total_ut);
    likelihood.noise = NoiseModel::new(0.01, 0.02, Matrix3::identity());
    (likelihood.sample_stride, likelihood.uses_normal_equations) = (1, false);
    for applied in [0.0, 0.9] {
        likelihood.motor_current.ut_per_a = (k * applied).into();
        let unknowns = likelihood.unknowns_from_start(&airframe.exact_start()).unwrap();
        let parameters = ModelParameters::from_unknowns(&unknowns);
        let mut joint = LeastSquares::<16, 1>::new();
        let extended = |row: &SVector<f32, 13>, current_derivative: Vector3<f32>| {
            row.push(current_derivative.x).push(current_derivative.y).push(current_derivative.z)
        };
        for_each_prior(&likelihood, &parameters, &mut |prior| {
            joint.add_weighted_row(
                &extended(&prior.jacobian_row, Vector3::zeros()),
                [-prior.residual],
                1.0 / (prior.sigma * prior.sigma),
            );
        });
        for axis in 0..3 {
            let row = SVector::<f32, 16>::ith(13 + axis, 1.0);
            joint.add_weighted_row(
                &row,
                [-likelihood.interference_per_ampere()[axis]],
                InterferenceEstimate::prior_precision(likelihood.field_unit_ut),
            );
        }
        for sample in samples.iter() {
            let equations = likelihood.sample_equations(sample, None, &parameters);
            let share_a = sample.current.amperes().unwrap() - likelihood.motor_current.mean_current_a;
            for equation in equations.iter() {
                let current_derivative = -parameters.w.tr_mul(&equation.jacobian_row.derivative_by_field) * share_a;
                joint.add_weighted_row(
                    &extended(&equation.jacobian_row.as_vector(), current_derivative),
                    [-equation.residual],
                    equation.weight,
                );
            }
        }
        let expected = joint.solve().unwrap();
        let mut information = Information::new(&LinearisedProblem::linearise(&likelihood, samples, &unknowns));
        information.accumulate_samples(&likelihood, samples, &unknowns, None);
        let found = information.estimate_interference(&likelihood).unwrap();
        let step = found.interference_per_ampere - likelihood.interference_per_ampere();
        let interference_part = expected.fixed_rows::<3>(13).into_owned();
        assert!((step - interference_part).norm() < 0.01 * found.largest_axis_sigma(), "{step} {interference_part}");
        let follow = information.step_for_interference_change(&step).unwrap();
        let change = information.linear_system.step_to_maximum().unwrap() + follow;
        let others = expected.fixed_rows::<13>(0).into_owned();
        assert!((change - others).norm() < 0.02 * others.norm(), "{change} {others}");
        let inflation = found.significance[0] / found.significance[1];
        for axis in 0..3 {
            let column = joint.covariance_times(&SVector::<f32, 16>::ith(13 + axis, 1.0)).unwrap();
            let ratio = found.covariance[(axis, axis)] / (column[13 + axis] * inflation);
            assert!((0.9..1.02).contains(&ratio), "{axis}: {ratio}");
        }
    }
}

#[test]
fn interference_is_used_while_certain_and_significant() {
    let zero = Vector3::zeros();
    let found = |x: f32, sigma: f32, significance| InterferenceEstimate {
        interference_per_ampere: Vector3::new(x, 0.0, 0.0),
        covariance: Matrix3::from_diagonal(&Vector3::new(0.5, 1.0, 0.2)) * (sigma * sigma),
        significance,
    };
    let k = |x: f32| Some(Vector3::new(x, 0.0, 0.0));
    // An interference that is not in use needs a significance of 30.
    assert_eq!(found(0.01, 1e-4, [31.0, 1.0]).next_interference(&zero, 0, 500.0), k(0.01));
    assert_eq!(found(0.01, 1e-4, [29.0, 29.0]).next_interference(&zero, 0, 500.0), None);
    assert_eq!(found(0.01, 1e-4, [31.0, 31.0]).next_interference(&zero, 1, 500.0), None, "it was left before");
    // An interference in use needs a sigma of at most 0.5 uT at the current's standard deviation (500 A).
    let applied = Vector3::new(0.01, 0.0, 0.0);
    assert_eq!(found(0.01, 0.99e-3, [99.0, 16.4]).next_interference(&applied, 2, 500.0), None);
    assert_eq!(found(0.01, 1.01e-3, [99.0, 16.4]).next_interference(&applied, 2, 500.0), Some(zero));
    assert_eq!(found(0.01, 0.99e-3, [99.0, 16.2]).next_interference(&applied, 2, 500.0), Some(zero));
    assert_eq!(
        found(0.02, 0.99e-3, [99.0, 16.2]).next_interference(&applied, 1, 500.0),
        k(0.02),
        "it may be known better yet"
    );
    assert_eq!(found(0.0102, 0.5e-3, [99.0, 99.0]).next_interference(&applied, 2, 500.0), k(0.0102));
    assert_eq!(found(0.0101, 0.5e-3, [99.0, 99.0]).next_interference(&applied, 2, 500.0), None);
    assert_eq!(found(0.02, 0.5e-3, [99.0, 99.0]).next_interference(&applied, 3, 500.0), k(0.02));
    assert_eq!(found(0.02, 0.5e-3, [99.0, 99.0]).next_interference(&applied, 4, 500.0), None);
}

#[test]
fn covariance_factors_multiply_to_the_covariance() {
    let a = Matrix3::new(1.0, 0.2, -0.3, 0.0, 0.7, 0.1, 0.5, 0.0, 0.4);
    let found = InterferenceEstimate {
        interference_per_ampere: Vector3::new(1.0, 2.0, 3.0),
        covariance: a * a.transpose(),
        significance: [17.0; 2],
    };
    let applied = Vector3::new(0.5, 2.0, 3.0);
    let roots = found.covariance_factors(&applied);
    let sum: Matrix3<f32> = roots.iter().take(3).map(|root| root * root.transpose()).sum();
    assert!((sum - found.covariance).norm() < 1e-5, "{sum}");
    assert_eq!(roots[3], Vector3::new(0.5, 0.0, 0.0));
    let insignificant = InterferenceEstimate { significance: [99.0, 16.0], ..found.clone() };
    assert_eq!(insignificant.covariance_factors(&applied)[3], Vector3::zeros());
    let nothing = InterferenceEstimate { covariance: Matrix3::zeros(), ..found }.covariance_factors(&applied);
    assert!(nothing.iter().take(3).all(|root| *root == Vector3::zeros()));
}

/// For another mounting only rounding differs, by at most a tenth of sigma.
#[test]
fn interference_is_estimated_in_sensor_axes() {
    let (_, _, recorded) = flight_with_current(5);
    let straight = solve_turns(&recorded).unwrap().calibration.motor_current;
    let mount = Orientation::from_name("roll90-yaw90").unwrap();
    let rotation = mount.body_from_sensor();
    let turned = |samples: &[Sample]| -> Vec<Sample> {
        samples
            .iter()
            .map(|sample| Sample { field: Field::new(rotation.tr_mul(&sample.field.ut)), ..*sample })
            .collect()
    };
    let turned = RecordedTurns { left: turned(&recorded.left), right: turned(&recorded.right) };
    let solution = solve_samples(Method::MaximumLikelihood, turned.turns(), &Prior { mount, ..NO_PRIOR }).unwrap();
    let current = solution.calibration.motor_current;
    let rotation_difference = rotation * Vector3::from(current.ut_per_a) - Vector3::from(straight.ut_per_a);
    assert!(
        straight.is_applied() && rotation_difference.norm() < 0.1 * straight.sigma_ut_per_a,
        "{current:?} {straight:?}"
    );
    assert!((current.sigma_ut_per_a / straight.sigma_ut_per_a - 1.0).abs() < 0.02, "{current:?} {straight:?}");
}

/// Currents known for three quarters of the samples.
#[test]
fn current_statistics_are_those_of_the_samples() {
    let (_, _, mut recorded) = flight_with_current(4);
    let all: Vec<f32> = recorded.turns().all_samples().filter_map(|s| s.current.amperes()).collect();
    let interference = MotorCurrentInterference::from_samples(recorded.turns());
    assert!((interference.mean_current_a - mean(&all)).abs() < 1e-3);
    let rest: Vec<f32> = all.iter().map(|a| a - mean(&all)).collect();
    assert!((interference.current_sigma_a - rms(&rest)).abs() < 1e-3 && !interference.is_applied());
    let number = recorded.left.len() + recorded.right.len();
    for (unknown, is_known) in [(number / 4, true), (number / 4 + 1, false), (number, false)] {
        for sample in recorded.left.iter_mut().chain(&mut recorded.right).take(unknown) {
            sample.current = MotorCurrent::UNKNOWN;
        }
        assert_eq!(
            MotorCurrentInterference::from_samples(recorded.turns()) != MotorCurrentInterference::NO_INTERFERENCE,
            is_known,
            "{unknown}"
        );
    }
    assert_eq!(
        MotorCurrentInterference::from_samples(crate::calibration::Samples::default()),
        MotorCurrentInterference::NO_INTERFERENCE
    );
}
