//! Motor-current interference: estimation, use, and effect on the expected error.

use nalgebra::{Matrix3, Vector3};

use super::synthetic::{Airframe, Flight, Random, RecordedTurns, mean, random_vector, rms, samples_in_mount};
use crate::calibration::hypotheses::motor_current::{InterferenceEstimate, MAX_UPDATES};
use crate::calibration::tests::{NO_PRIOR, solve_turns};
use crate::calibration::{
    Calibration, Method, MotorCurrent, MotorCurrentInterference, Orientation, Prior, Samples, Solution, solve_samples,
    verification,
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

/// Heading errors at the mean current plus and minus its standard deviation, degrees.
fn errors_deg(airframe: &Airframe, k: Vector3<f32>, solution: &Solution) -> Vec<f32> {
    let MotorCurrentInterference { mean_current_a, current_sigma_a, .. } = solution.calibration.motor_current;
    let at = |current_a: f32| {
        // Uncorrected interference acts as additional hard iron.
        let added = k * current_a - solution.calibration.motor_current.interference_ut(Some(current_a));
        Airframe { b_ut: airframe.b_ut + added, ..*airframe }.errors_deg(&solution.calibration)
    };
    [mean_current_a - current_sigma_a, mean_current_a + current_sigma_a].map(at).concat()
}

/// 0.4 uT/A with bursts of 30 A is 12 uT. A steady current is hard iron. A current that correlates with the turn side
/// acts as a change of hard iron; both sides together determine `k`, with a larger expected error. The sigma is that of
/// the least observable axis, so normalised errors are below 1.
#[test]
fn significant_interference_is_estimated_and_used() {
    for (size_ut_per_a, currents, is_used, max_expected_deg) in [
        (0.4, CurrentProfile::Bursts, true, 0.35),
        (0.0, CurrentProfile::Bursts, false, 0.35),
        (0.4, CurrentProfile::Steady, false, 0.35),
        (0.4, CurrentProfile::BySide, true, 0.4),
    ] {
        let [mut normalised_errors, mut actual_deg, mut expected_deg, mut ratios] = [const { Vec::new() }; 4];
        for seed in 0..40 {
            let (mut random, airframe) = Airframe::seeded(4000 + seed, 0.1, 1.0, 5.0, [-65.0, 65.0]);
            let k = random_vector(&mut random, 1.0).normalize() * size_ut_per_a;
            let solution = solve_turns(&fly_with_current(&airframe, k, currents, &mut random)).unwrap();
            let interference = solution.calibration.motor_current;
            assert_eq!(interference.is_applied(), is_used, "{size_ut_per_a} uT/A, {currents:?}, seed {seed}");
            let estimate_error = Vector3::from(interference.ut_per_a) - k;
            normalised_errors.extend(estimate_error.iter().map(|axis| axis / interference.sigma_ut_per_a));
            actual_deg.push(rms(&errors_deg(&airframe, k, &solution)));
            expected_deg.push(solution.quality.expected_rms_deg);
            ratios.push(actual_deg[actual_deg.len() - 1] / solution.quality.expected_rms_deg);
        }
        assert!((0.6..1.05).contains(&rms(&ratios)), "{size_ut_per_a} uT/A, {currents:?}: {}", rms(&ratios));
        assert!(mean(&expected_deg) < max_expected_deg, "{currents:?}: {expected_deg:?}");
        if matches!(currents, CurrentProfile::Bursts) && is_used {
            assert!((0.5..1.1).contains(&rms(&normalised_errors)), "{}", rms(&normalised_errors));
            assert!(mean(&actual_deg) < 0.3, "{actual_deg:?}");
        }
    }
}

fn flight_with_current(seed: u64) -> (Airframe, Vector3<f32>, RecordedTurns) {
    let (mut random, airframe) = Airframe::seeded(seed, 0.1, 1.0, 5.0, [50.0, 60.0]);
    let k = Vector3::new(0.25, -0.3, 0.15);
    let recorded = fly_with_current(&airframe, k, CurrentProfile::Bursts, &mut random);
    (airframe, k, recorded)
}

/// A third of the currents may not be missing, a fifth may.
#[test]
fn without_most_currents_there_is_no_estimate() {
    let (mut random, airframe) = Airframe::seeded(1, 0.1, 1.0, 5.0, [50.0, 60.0]);
    // Interference small enough for a calibration to be accepted without its correction.
    let recorded = fly_with_current(&airframe, Vector3::new(0.05, -0.06, 0.03), CurrentProfile::Bursts, &mut random);
    let without_every_nth = |period: usize| {
        let mut recorded = recorded.clone();
        recorded.samples_mut().step_by(period).for_each(|sample| sample.current = MotorCurrent::UNKNOWN);
        solve_turns(&recorded).unwrap()
    };
    let [none, few, many] = [1, 3, 5].map(without_every_nth);
    assert_eq!(none.calibration.motor_current, MotorCurrentInterference::NO_INTERFERENCE);
    assert_eq!(none.calibration, few.calibration);
    assert!(many.calibration.motor_current.is_applied());
    let all = solve_turns(&recorded).unwrap();
    assert!(all.quality.norm_residual < 0.5 * none.quality.norm_residual, "{all:?} {none:?}");
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

/// Dropped if uncertain, with a sigma above 0.5 uT at the current's spread of 500 A, or insignificant; the first estimate
/// may still hide the significance. The updates are bounded.
#[test]
fn interference_is_used_while_certain_and_significant() {
    let [zero, k, near] = [0.0, 0.01, 0.010_01].map(|x| Vector3::new(x, 0.0, 0.0));
    let significant = [99.0, 99.0];
    for (name, estimate, sigma_ut, significance, applied, updates, expected) in [
        ("significant for independent residuals", k, 0.1, [99.0, 1.0], zero, 0, Some(k)),
        ("insignificant", k, 0.1, [9.0, 9.0], zero, 0, None),
        ("dropped before", k, 0.1, significant, zero, 1, None),
        ("converged", near, 0.25, significant, k, 1, None),
        ("inaccurate", k * 2.0, 0.25, significant, k, 1, Some(k * 2.0)),
        ("uncertain, and so far only tried", k * 2.0, 2.0, significant, k, 1, Some(k * 2.0)),
        ("uncertain", k, 2.0, significant, k, 2, Some(zero)),
        ("no longer significant", k, 0.25, [99.0, 5.0], k, 2, Some(zero)),
        ("updated too often", k * 2.0, 0.25, significant, k, MAX_UPDATES, None),
    ] {
        let sigma: f32 = sigma_ut / 500.0;
        let covariance = Matrix3::from_diagonal(&Vector3::new(0.5, 1.0, 0.2)) * (sigma * sigma);
        let found = InterferenceEstimate { interference_per_ampere: estimate, covariance, significance };
        assert_eq!(found.next_interference(&applied, updates, 500.0), expected, "{name}");
    }
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
    let turned = samples_in_mount(recorded.turns(), mount);
    let solution = solve_samples(Method::MaximumLikelihood, turned, &Prior { mount, ..NO_PRIOR }).unwrap();
    let current = solution.calibration.motor_current;
    let in_body_axes = mount.body_from_sensor() * Vector3::from(current.ut_per_a);
    let difference = (in_body_axes - Vector3::from(straight.ut_per_a)).norm();
    assert!(straight.is_applied() && difference < 0.1 * straight.sigma_ut_per_a, "{current:?} {straight:?}");
    assert!((current.sigma_ut_per_a / straight.sigma_ut_per_a - 1.0).abs() < 0.02, "{current:?} {straight:?}");
}

#[test]
fn current_statistics_are_those_of_the_samples() {
    let (_, _, recorded) = flight_with_current(4);
    let all: Vec<f32> = recorded.turns().all_samples().filter_map(|s| s.current.amperes()).collect();
    let interference = MotorCurrentInterference::from_samples(recorded.turns());
    assert!((interference.mean_current_a - mean(&all)).abs() < 1e-3);
    let rest: Vec<f32> = all.iter().map(|a| a - mean(&all)).collect();
    assert!((interference.current_sigma_a - rms(&rest)).abs() < 1e-3 && !interference.is_applied());
    let nothing = MotorCurrentInterference::from_samples(Samples::default());
    assert_eq!(nothing, MotorCurrentInterference::NO_INTERFERENCE);
}
