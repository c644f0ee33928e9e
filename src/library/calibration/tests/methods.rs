//! Each method on its intended data.

use core::f32::consts::TAU;

use nalgebra::Matrix3;

use super::synthetic::{
    Airframe, Flight, Parts, Random, exact_circle, level_circle, level_samples, marked_samples, max_abs, mean,
    measured_sample, rms, swing_marks, tumbled_samples, turn_samples,
};
use super::{NO_PRIOR, harsh_airframe};
use crate::calibration::closed_form::four_ellipse;
use crate::calibration::method_selection::{Procedure, select_method};
use crate::calibration::{
    AttitudeEnvelope, CollectionPart, ConsiderSigmas, HeadingMark, Method, Prior, Quality, Samples, Solution,
    SolveError, Solver, solve_samples,
};
use crate::frames::{Field, RollPitch};

fn exact_turns(airframe: &Airframe, left_deg: f32, right_deg: f32) -> Samples<'static> {
    turn_samples(&exact_circle(airframe, left_deg, 72), &exact_circle(airframe, right_deg, 72))
}

fn random_airframe(random: &mut Random) -> Airframe {
    Airframe::random(random, 0.2, 1.5, 10.0, [-70.0, 70.0])
}

fn solve(method: Method, samples: Samples<'_>) -> Solution {
    solve_samples(method, samples, &NO_PRIOR).unwrap_or_else(|error| panic!("{}: {error:?}", method.method_name()))
}

/// Without axis coupling the phase hypothesis holds exactly. f32 rounding leaves 0.02 deg.
#[test]
fn four_ellipses_recover_a_diagonal_airframe_exactly() {
    let a = Matrix3::from_diagonal(&[0.9, 1.15, 1.02].into());
    let airframe = Airframe { a, ..Airframe::with_hard_iron([12.0, -7.0, 20.0]) };
    for (left_deg, right_deg) in [(-20.0, 20.0), (-15.0, 40.0)] {
        let samples = exact_turns(&airframe, left_deg, right_deg);
        for inclination_rad in [None, Some(airframe.inclination_rad)] {
            let prior = Prior { inclination_rad, ..NO_PRIOR };
            let solution = solve_samples(Method::FourEllipse, samples, &prior).unwrap();
            let error = max_abs(&airframe.errors_deg(&solution.calibration));
            assert!(error < 0.02, "{left_deg} {right_deg} {inclination_rad:?}: {error} deg");
        }
    }
}

#[test]
fn four_ellipses_use_a_configured_inclination() {
    let airframe = Airframe::with_hard_iron([12.0, -7.0, 20.0]);
    let samples = exact_turns(&airframe, -20.0, 20.0);
    for (inclination_rad, expected_rad) in [(None, airframe.inclination_rad), (Some(0.9), 0.9)] {
        let found = four_ellipse::solve_four_ellipse(samples, &Matrix3::identity(), inclination_rad).unwrap();
        let found_rad = found.tan_inclination.atan();
        assert!((found_rad - expected_rad).abs() < 1e-3, "{inclination_rad:?}: {found_rad}");
    }
}

#[test]
fn axis_coupling_needs_two_planes() {
    let a = Matrix3::new(0.98, 0.03, -0.02, -0.02, 0.92, -0.02, -0.01, 0.02, 0.99);
    let airframe = Airframe { a, ..Airframe::with_hard_iron([9.0, -1.0, 0.0]) };
    let samples = exact_turns(&airframe, -20.0, 20.0);
    let error = |method| max_abs(&airframe.errors_deg(&solve(method, samples).calibration));
    assert!((0.5..4.0).contains(&error(Method::FourEllipse)), "{}", error(Method::FourEllipse));
    assert!(error(Method::TwoPlane) < 0.02, "{}", error(Method::TwoPlane));
}

/// Exact at constant bank and zero pitch. A conic loses half of f32's digits: 0.05 deg at worst.
#[test]
fn two_planes_are_exact_on_perfect_turns() {
    for seed in 0..50 {
        let mut random = Random(seed);
        let airframe = harsh_airframe(&mut random);
        let bank_deg = random.uniform(15.0, 45.0);
        let solution = solve(Method::TwoPlane, exact_turns(&airframe, -bank_deg, bank_deg));
        let error = max_abs(&airframe.errors_deg(&solution.calibration));
        assert!(error < 0.05, "seed {seed}: {error} deg");
    }
}

/// The fitted ellipse is exact; the phase hypothesis leaves a constant error, which includes the mounting. Attitude
/// wander of 0.5 deg is 1.4 deg of heading at 70 deg of inclination; 48 samples reduce this to a seventh, twice that at
/// the worst heading. Limit: three sigma.
#[test]
fn level_flight_leaves_a_constant_error() {
    let mut worst: f32 = 0.0;
    for seed in 0..50 {
        let mut random = Random(300 + seed);
        let airframe = random_airframe(&mut random);
        let level = level_samples(&level_circle(&airframe, 48, &mut random));
        assert_eq!(select_method(level, Procedure::Level), Ok(Method::Level));
        let solution = solve(Method::Level, level);
        let errors = airframe.errors_at_deg(&solution.calibration, &[0.0]);
        let constant = mean(&errors);
        let rest: Vec<f32> = errors.iter().map(|e| e - constant).collect();
        assert!(rms(&rest) < 3.0 * solution.quality.expected_rms_deg, "seed {seed}: {} deg", rms(&rest));
        worst = worst.max(max_abs(&rest));
    }
    assert!(worst < 1.2, "{worst} deg");
}

/// Twelve headings tilted either way, as in Liu 2007 section 4.
#[test]
fn a_tilted_swing_determines_all_coefficients() {
    for seed in 0..50 {
        let mut random = Random(700 + seed);
        let airframe = random_airframe(&mut random);
        let marks = swing_marks(&airframe, 12, &[20.0, -20.0], &mut random);
        let solution = solve(Method::CompassSwing, marked_samples(&marks));
        airframe.assert_expected_error_is_honest(&solution, seed);
        let error_deg = airframe.rms_error_deg(&solution.calibration);
        assert!(error_deg < 1.0, "seed {seed}: {error_deg} deg");
    }
}

/// A level swing determines level headings including the mounting, but not banked ones, which have a larger sigma.
#[test]
fn a_level_swing_is_accurate_level_and_honest_when_banked() {
    for seed in 0..50 {
        let mut random = Random(900 + seed);
        let airframe = random_airframe(&mut random);
        let marks = swing_marks(&airframe, 8, &[0.0], &mut random);
        let solution = solve(Method::CompassSwing, marked_samples(&marks));
        let Quality { envelope, expected_rms_deg, .. } = solution.quality;
        let [level_deg, banked_deg] = [&[0.0][..], &[30.0, -30.0]]
            .map(|banks_deg| rms(&airframe.errors_at_deg(&solution.calibration, banks_deg)));
        assert_eq!(envelope, AttitudeEnvelope::Level);
        assert!(level_deg < 1.5 && level_deg < 3.0 * expected_rms_deg, "seed {seed}: {level_deg} deg");
        let banked_sigma_deg = rms(&sigmas_deg(&solution, &[30.0, -30.0]));
        assert!(banked_deg < 3.0 * banked_sigma_deg, "seed {seed}: {banked_deg} deg");
    }
}

/// A level swing leaves the vertical response unobservable, mainly the inclination. Configured to 0.3 deg (field model
/// and local geology), it removes two thirds of the banked error of 5.5 deg.
#[test]
fn a_configured_inclination_improves_a_level_swing_when_banked() {
    let (mut free, mut configured) = (Vec::new(), Vec::new());
    for seed in 0..50_u8 {
        let mut random = Random(5000 + u64::from(seed));
        let airframe = random_airframe(&mut random);
        let level_marks = swing_marks(&airframe, 8, &[0.0], &mut random);
        // The vehicle stands 0.5 deg off level at each heading.
        let tilted = |mark: &HeadingMark, random: &mut Random| {
            let attitude = RollPitch::from_deg(random.normal() * 0.5, random.normal() * 0.5);
            let sample = measured_sample(&airframe, attitude, mark.heading_rad, 0.05, random);
            HeadingMark { sample, ..*mark }
        };
        let marks: Vec<_> = level_marks.iter().map(|mark| tilted(mark, &mut random)).collect();
        let error_deg = |inclination_rad: Option<f32>| {
            let prior = Prior { inclination_rad, ..NO_PRIOR };
            let solution = solve_samples(Method::CompassSwing, marked_samples(&marks), &prior).unwrap();
            airframe.rms_error_deg(&solution.calibration)
        };
        let off_rad = f32::to_radians(if seed % 2 == 0 { 0.3 } else { -0.3 });
        free.push(error_deg(None));
        configured.push(error_deg(Some(airframe.inclination_rad + off_rad)));
    }
    assert!(rms(&configured) < 0.4 * rms(&free), "{} {}", rms(&configured), rms(&free));
}

/// Bench calibration without attitude. The rotation hidden by a symmetric `W` is zero here: the airframe is symmetric
/// and aligned.
#[test]
fn tumbling_determines_shape_and_centre() {
    for seed in 0..50 {
        let (mut random, airframe) = Airframe::seeded(1100 + seed, 0.2, 1.5, 0.0, [-70.0, 70.0]);
        let samples = turn_samples(&tumbled_samples(&airframe, 0.12, &mut random), &[]);
        assert_eq!(select_method(samples, Procedure::Tumble), Ok(Method::Ellipsoid));
        let solution = solve(Method::Ellipsoid, samples);
        airframe.assert_expected_error_is_honest(&solution, seed);
        let error_deg = airframe.rms_error_deg(&solution.calibration);
        assert!(error_deg < 0.6, "seed {seed}: {error_deg} deg");
        assert!(!solution.quality.knows_inclination);
        let given = Prior { inclination_rad: Some(solution.calibration.inclination_rad), ..NO_PRIOR };
        assert!(solve_samples(Method::Ellipsoid, samples, &given).unwrap().quality.knows_inclination);
    }
}

/// Many ellipsoids contain two given ellipses (Liu 2007 section 2).
#[test]
fn turns_do_not_determine_an_ellipsoid() {
    for seed in 0..20 {
        let (mut random, airframe) = Airframe::seeded(1300 + seed, 0.2, 1.5, 5.0, [-60.0, 60.0]);
        let recorded = Flight { wander_deg: 0.5, ..Flight::TYPICAL }.fly(&airframe, &mut random);
        let result = solve_samples(Method::Ellipsoid, recorded.turns(), &NO_PRIOR);
        let open = matches!(result, Err(SolveError::NotDetermined(CollectionPart::FREE) | SolveError::NotConverged));
        assert!(open, "seed {seed}: {:?}", result.map(|s| s.quality));
    }
}

#[test]
fn a_wrong_configured_inclination_does_little_harm() {
    let mut errors_deg = [const { Vec::new() }; 4];
    for seed in 0..40 {
        let mut random = Random(1500 + seed);
        let airframe = random_airframe(&mut random);
        let recorded = Flight { bank_deg: 15.0, ..Flight::TYPICAL }.fly(&airframe, &mut random);
        let off_rad = [None, Some(0.0), Some(0.005_2), Some(0.035)];
        for (errors_deg, off_rad) in errors_deg.iter_mut().zip(off_rad) {
            let prior = Prior { inclination_rad: off_rad.map(|off| airframe.inclination_rad + off), ..NO_PRIOR };
            let solution = solve_samples(Method::MaximumLikelihood, recorded.turns(), &prior).unwrap();
            errors_deg.push(airframe.rms_error_deg(&solution.calibration));
        }
    }
    let [free, configured, near, wrong] = errors_deg.map(|errors_deg| rms(&errors_deg));
    assert!(near <= 1.02 * free && configured <= 1.02 * free, "{near} {configured} {free}");
    assert!(wrong < 1.5 * free, "{wrong} {free}");
}

#[test]
fn one_side_and_level_flight_have_an_honest_expected_error() {
    for seed in 0..50 {
        let (mut random, airframe) = Airframe::seeded(1700 + seed, 0.2, 1.5, 10.0, [-65.0, 65.0]);
        let turns = Flight { attitude_bias_deg: 0.0, ..Flight::TYPICAL }.fly(&airframe, &mut random);
        let level = level_circle(&airframe, 60, &mut random);
        let samples = Parts { left: &turns.left, level: &level, ..Parts::default() }.samples();
        assert_eq!(select_method(samples, Procedure::Turns), Ok(Method::MaximumLikelihood));
        airframe.assert_expected_error_is_honest(&solve(Method::MaximumLikelihood, samples), seed);
    }
}

/// Without consider states, heading sigma without sensor noise and expected error agree; with them only the expected
/// error grows.
#[test]
fn sigma_over_the_envelope_is_the_expected_error() {
    let (mut random, airframe) = Airframe::seeded(3, 0.2, 1.5, 10.0, [50.0, 50.0]);
    let flight = Flight::TYPICAL.fly(&airframe, &mut random);
    let solved = |consider: ConsiderSigmas| {
        let solver = Solver::with_consider_sigmas(Method::MaximumLikelihood, flight.turns(), &NO_PRIOR, consider);
        solver.unwrap().run(flight.turns()).unwrap()
    };
    let (solution, usual) = (solved(ConsiderSigmas::ZERO), solved(ConsiderSigmas::DEFAULT));
    assert_eq!(solution.uncertainty, usual.uncertainty);
    assert!(usual.quality.expected_rms_deg > 1.5 * solution.quality.expected_rms_deg);
    let sigmas_deg = sigmas_deg(&solution, &[-30.0, 0.0, 30.0]);
    let Quality { expected_rms_deg, expected_worst_deg, .. } = solution.quality;
    assert!((rms(&sigmas_deg) - expected_rms_deg).abs() < 1e-4, "{} {expected_rms_deg}", rms(&sigmas_deg));
    assert!((max_abs(&sigmas_deg) - expected_worst_deg).abs() < 1e-4);
}

fn sigmas_deg(solution: &Solution, banks_deg: &[f32]) -> Vec<f32> {
    let Solution { calibration, uncertainty, .. } = solution;
    let mut quiet = *uncertainty;
    (quiet.relative_sensor_sigma, quiet.attitude_sigma_rad) = (0.0, 0.0);
    let field_from_body = calibration.w_matrix().try_inverse().unwrap();
    let sigma_deg = |bank_deg: f32, heading_index: u8| {
        let attitude = RollPitch::from_deg(bank_deg, 0.0);
        let heading_rad = f32::from(heading_index) / 12.0 * TAU;
        let level = Field::earth_field(calibration.total_ut, calibration.inclination_rad, heading_rad);
        let field = Field::new(field_from_body * attitude.to_body_frame(level).ut + calibration.b_vector_ut());
        quiet.heading_variance(calibration, field, &attitude.tilt_rotation(), level).sigma_rad().to_degrees()
    };
    banks_deg.iter().flat_map(|&bank_deg| (0..12).map(move |heading| sigma_deg(bank_deg, heading))).collect()
}
