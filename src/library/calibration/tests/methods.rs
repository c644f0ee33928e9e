//! Each method on its intended data.

use crate::calibration::tests::synthetic::Parts;
use core::f32::consts::TAU;

use nalgebra::Matrix3;

use super::synthetic::{Airframe, Flight, Random, level_circle, max_abs, mean, measured_sample, rms};
use crate::calibration::closed_form::four_ellipse;
use crate::calibration::method_selection;
use crate::calibration::method_selection::Procedure;
use crate::calibration::tests::NO_PRIOR;
use crate::calibration::{
    AttitudeEnvelope, ConsiderSigmas, HeadingMark, Method, Prior, Quality, Sample, SamplePart, Solution, SolveError,
    Solver, solve_samples,
};
use crate::frames::{Attitude, Field};
use crate::time::WrappingMillis;

/// Turn at constant bank and zero pitch without noise, as the paper assumes.
fn fly_circle(airframe: &Airframe, bank_deg: f32, sample_count: u16) -> Vec<Sample> {
    let attitude = Attitude::from_deg(bank_deg, 0.0);
    let turn_sign = if bank_deg < 0.0 { -1.0 } else { 1.0 };
    (0..sample_count)
        .map(|i| {
            let heading_rad = turn_sign * f32::from(i) / f32::from(sample_count) * TAU;
            let sample = measured_sample(airframe, attitude, heading_rad, 0.0, &mut Random(0));
            Sample { time: WrappingMillis::new(u32::from(i) * 400), ..sample }
        })
        .collect()
}

fn airframe_with_iron(a: Matrix3<f32>, b_ut: [f32; 3]) -> Airframe {
    Airframe { a, b_ut: b_ut.into(), total_ut: 50.0, inclination_rad: 0.94 }
}

/// Without axis coupling the phase hypothesis holds exactly. f32 rounding leaves 0.02 deg.
#[test]
fn four_ellipses_recover_a_diagonal_airframe_exactly() {
    let airframe = airframe_with_iron(Matrix3::from_diagonal(&[0.9, 1.15, 1.02].into()), [12.0, -7.0, 20.0]);
    for (left_deg, right_deg) in [(-20.0, 20.0), (-15.0, 40.0)] {
        let (left, right) = (fly_circle(&airframe, left_deg, 72), fly_circle(&airframe, right_deg, 72));
        let samples = Parts { left: &left, right: &right, ..Parts::default() }.samples();
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
    let airframe = airframe_with_iron(Matrix3::identity(), [12.0, -7.0, 20.0]);
    let (left, right) = (fly_circle(&airframe, -20.0, 72), fly_circle(&airframe, 20.0, 72));
    let samples = Parts { left: &left, right: &right, ..Parts::default() }.samples();
    for (inclination_rad, expected_rad) in [(None, airframe.inclination_rad), (Some(0.9), 0.9)] {
        let found = four_ellipse::solve_four_ellipse(samples, &Matrix3::identity(), inclination_rad).unwrap();
        let found_rad = found.tan_inclination.atan();
        assert!((found_rad - expected_rad).abs() < 1e-3, "{inclination_rad:?}: {found_rad}");
    }
}

#[test]
fn axis_coupling_needs_two_planes() {
    let coupled = Matrix3::new(0.98, 0.03, -0.02, -0.02, 0.92, -0.02, -0.01, 0.02, 0.99);
    let airframe = airframe_with_iron(coupled, [9.0, -1.0, 0.0]);
    let (left, right) = (fly_circle(&airframe, -20.0, 72), fly_circle(&airframe, 20.0, 72));
    let samples = Parts { left: &left, right: &right, ..Parts::default() }.samples();
    let error = |method| max_abs(&airframe.errors_deg(&solve_samples(method, samples, &NO_PRIOR).unwrap().calibration));
    assert!((0.5..4.0).contains(&error(Method::FourEllipse)), "{}", error(Method::FourEllipse));
    assert!(error(Method::TwoPlane) < 0.02, "{}", error(Method::TwoPlane));
}

/// The fitted ellipse is exact; the phase hypothesis leaves a constant error, which includes the mounting. Attitude
/// wander of 0.5 deg is 1.4 deg of heading at 70 deg of inclination; 48 samples reduce this to a seventh, twice that at
/// the worst heading. Limit: three sigma.
#[test]
fn level_flight_leaves_a_constant_error() {
    let mut worst: f32 = 0.0;
    for seed in 0..50 {
        let mut random = Random(300 + seed);
        let airframe = Airframe::random(&mut random, 0.2, 1.5, 10.0, [-70.0, 70.0]);
        let samples = level_circle(&airframe, 48, &mut random);
        let level = Parts { level: &samples, ..Parts::default() }.samples();
        assert_eq!(method_selection::select_method(level, Procedure::Level), Ok(Method::Level));
        let solution = solve_samples(Method::Level, level, &NO_PRIOR).unwrap();
        let errors = airframe.errors_at_deg(&solution.calibration, &[0.0]);
        let constant = mean(&errors);
        let rest: Vec<f32> = errors.iter().map(|e| e - constant).collect();
        assert!(rms(&rest) < 3.0 * solution.quality.expected_rms_deg, "seed {seed}: {} deg", rms(&rest));
        worst = worst.max(max_abs(&rest));
    }
    assert!(worst < 1.2, "{worst} deg");
}

#[test]
fn level_flight_at_too_few_headings_is_refused() {
    let airframe = airframe_with_iron(Matrix3::identity(), [5.0, 3.0, 0.0]);
    let legs = |headings: u8| -> Vec<Sample> {
        let mut random = Random(1);
        (0..20 * headings)
            .map(|i| {
                let heading_rad = f32::from(i % headings) / f32::from(headings) * TAU;
                measured_sample(&airframe, Attitude::default(), heading_rad, 0.1, &mut random)
            })
            .collect()
    };
    let solve =
        |legs: &[Sample]| solve_samples(Method::Level, Parts { level: legs, ..Parts::default() }.samples(), &NO_PRIOR);
    assert!(matches!(solve(&legs(4)), Err(SolveError::TooFewHeadings { need: 5, .. })), "{:?}", solve(&legs(4)));
    assert_eq!(solve(&legs(1)).map(|_| ()).unwrap_err(), SolveError::NotAnEllipse(SamplePart::Level));
    let solution = solve(&legs(5)).unwrap();
    // Five headings leave no redundancy: 0.1 uT of noise in a field of 29 uT is 0.2 deg; limit: three sigma.
    assert!(max_abs(&airframe.errors_at_deg(&solution.calibration, &[0.0])) < 0.6);
}

/// Twelve headings tilted either way, as in Liu 2007 section 4, each known to 0.5 deg.
#[test]
fn a_tilted_swing_determines_all_coefficients() {
    for seed in 0..50 {
        let mut random = Random(700 + seed);
        let airframe = Airframe::random(&mut random, 0.2, 1.5, 10.0, [-70.0, 70.0]);
        let marks: Vec<HeadingMark> = (0..24_u8)
            .map(|i| {
                let heading_rad = f32::from(i % 12) / 12.0 * TAU;
                let attitude = Attitude::from_deg(if i < 12 { 20.0 } else { -20.0 }, 0.0);
                let sample = measured_sample(&airframe, attitude, heading_rad, 0.05, &mut random);
                HeadingMark { sample, heading_rad: heading_rad + (random.normal() * 0.5).to_radians() }
            })
            .collect();
        let samples = Parts { marks: &marks, ..Parts::default() }.samples();
        let solution =
            solve_samples(Method::CompassSwing, samples, &NO_PRIOR).unwrap_or_else(|e| panic!("seed {seed}: {e:?}"));
        let errors = airframe.errors_deg(&solution.calibration);
        assert!(rms(&errors) < 3.0 * solution.quality.expected_rms_deg, "seed {seed}: {}", rms(&errors));
        assert!(rms(&errors) < 1.0, "seed {seed}: {} deg", rms(&errors));
    }
}

/// A level swing determines level headings including the mounting, but not banked ones.
#[test]
fn a_level_swing_is_accurate_level_and_honest_when_banked() {
    for seed in 0..50 {
        let mut random = Random(900 + seed);
        let airframe = Airframe::random(&mut random, 0.2, 1.5, 10.0, [-70.0, 70.0]);
        let marks: Vec<HeadingMark> = (0..8_u8)
            .map(|i| {
                let heading_rad = f32::from(i) / 8.0 * TAU;
                let sample = measured_sample(&airframe, Attitude::default(), heading_rad, 0.05, &mut random);
                HeadingMark { sample, heading_rad: heading_rad + (random.normal() * 0.5).to_radians() }
            })
            .collect();
        let samples = Parts { marks: &marks, ..Parts::default() }.samples();
        let solution =
            solve_samples(Method::CompassSwing, samples, &NO_PRIOR).unwrap_or_else(|e| panic!("seed {seed}: {e:?}"));
        let level = airframe.errors_at_deg(&solution.calibration, &[0.0]);
        assert!(rms(&level) < 1.5, "seed {seed}: {} deg", rms(&level));
        assert_eq!(solution.quality.envelope, AttitudeEnvelope::Level);
        assert!(rms(&level) < 3.0 * solution.quality.expected_rms_deg, "seed {seed}: {} deg", rms(&level));
        // Banked headings have a larger sigma.
        let banks_deg = [30.0, -30.0];
        let banked = rms(&airframe.errors_at_deg(&solution.calibration, &banks_deg));
        assert!(banked < 3.0 * rms(&sigmas_deg(&solution, &banks_deg)), "seed {seed}: {banked} deg");
    }
}

#[test]
fn too_few_marks_are_refused() {
    let airframe = airframe_with_iron(Matrix3::identity(), [5.0, 3.0, 0.0]);
    let mark = HeadingMark {
        sample: measured_sample(&airframe, Attitude::default(), 1.0, 0.0, &mut Random(0)),
        heading_rad: 1.0,
    };
    let solve = |marks: &[HeadingMark]| {
        solve_samples(Method::CompassSwing, Parts { marks, ..Parts::default() }.samples(), &NO_PRIOR).map(|_| ())
    };
    let missing = SolveError::TooFewSamples { part: SamplePart::Marks, have: 3, need: 4 };
    assert_eq!(solve(&[mark; 3]), Err(missing));
    assert!(solve(&[mark; 6]).is_err());
}

/// Bench calibration without attitude. The rotation hidden by a symmetric `W` is zero here: the airframe is symmetric
/// and aligned.
#[test]
fn tumbling_determines_shape_and_centre() {
    for seed in 0..50 {
        let mut random = Random(1100 + seed);
        let airframe = Airframe::random(&mut random, 0.2, 1.5, 0.0, [-70.0, 70.0]);
        let tumbled: Vec<Sample> = (0..160)
            .map(|_| {
                let attitude = Attitude {
                    roll_rad: random.uniform(-3.1, 3.1),
                    // Attitudes uniform over the sphere.
                    pitch_rad: random.uniform(-1.0, 1.0).asin(),
                };
                let heading_rad = random.uniform(0.0, TAU);
                let measured = measured_sample(&airframe, attitude, heading_rad, 0.12, &mut random);
                Sample { attitude: Attitude::default(), ..measured }
            })
            .collect();
        let samples = Parts { left: &tumbled, ..Parts::default() }.samples();
        assert_eq!(method_selection::select_method(samples, Procedure::Tumble), Ok(Method::Ellipsoid));
        let solution =
            solve_samples(Method::Ellipsoid, samples, &NO_PRIOR).unwrap_or_else(|e| panic!("seed {seed}: {e:?}"));
        let errors = airframe.errors_deg(&solution.calibration);
        assert!(rms(&errors) < 0.6, "seed {seed}: {} deg", rms(&errors));
        assert!(rms(&errors) < 3.0 * solution.quality.expected_rms_deg, "seed {seed}: {}", rms(&errors));
        assert!(!solution.quality.knows_inclination);
        let given = Prior { inclination_rad: Some(solution.calibration.inclination_rad), ..NO_PRIOR };
        assert!(solve_samples(Method::Ellipsoid, samples, &given).unwrap().quality.knows_inclination);
    }
}

/// Many ellipsoids contain two given ellipses (Liu 2007 section 2).
#[test]
fn turns_do_not_determine_an_ellipsoid() {
    for seed in 0..20 {
        let mut random = Random(1300 + seed);
        let airframe = Airframe::random(&mut random, 0.2, 1.5, 5.0, [-60.0, 60.0]);
        let flight = Flight { wander_deg: 0.5, ..Flight::TYPICAL };
        let recorded = flight.fly(&airframe, &mut random);
        let result = solve_samples(Method::Ellipsoid, recorded.turns(), &NO_PRIOR);
        let open = matches!(result, Err(SolveError::NotDetermined(SamplePart::All) | SolveError::NotConverged));
        assert!(open, "seed {seed}: {:?}", result.map(|s| s.quality));
    }
}

/// A level swing leaves the vertical response unobservable, mainly the inclination. Configured to 0.3 deg (field model
/// and local geology), it removes two thirds of the banked error of 5.5 deg.
#[test]
fn a_configured_inclination_improves_a_level_swing_when_banked() {
    let (mut free, mut configured) = (Vec::new(), Vec::new());
    for seed in 0..50_u8 {
        let mut random = Random(5000 + u64::from(seed));
        let airframe = Airframe::random(&mut random, 0.2, 1.5, 10.0, [-70.0, 70.0]);
        let marks: Vec<HeadingMark> = (0..8_u8)
            .map(|i| {
                let heading_rad = f32::from(i) / 8.0 * TAU;
                let tilt = Attitude::from_deg(random.normal() * 0.5, random.normal() * 0.5);
                let sample = measured_sample(&airframe, tilt, heading_rad, 0.05, &mut random);
                HeadingMark { sample, heading_rad: heading_rad + (random.normal() * 0.5).to_radians() }
            })
            .collect();
        let samples = Parts { marks: &marks, ..Parts::default() }.samples();
        let error = |inclination_rad: Option<f32>| {
            let solution =
                solve_samples(Method::CompassSwing, samples, &Prior { inclination_rad, ..NO_PRIOR }).unwrap();
            rms(&airframe.errors_deg(&solution.calibration))
        };
        let off_rad = f32::to_radians(if seed % 2 == 0 { 0.3 } else { -0.3 });
        free.push(error(None));
        configured.push(error(Some(airframe.inclination_rad + off_rad)));
    }
    assert!(rms(&configured) < 0.4 * rms(&free), "{} {}", rms(&configured), rms(&free));
}

#[test]
fn a_wrong_configured_inclination_does_little_harm() {
    let mut configured = Vec::new();
    let mut free = Vec::new();
    let mut near = Vec::new();
    let mut wrong = Vec::new();
    for seed in 0..40 {
        let mut random = Random(1500 + seed);
        let airframe = Airframe::random(&mut random, 0.2, 1.5, 10.0, [-70.0, 70.0]);
        let recorded = Flight { bank_deg: 15.0, ..Flight::TYPICAL }.fly(&airframe, &mut random);
        let error = |inclination_rad: Option<f32>| {
            let prior = Prior { inclination_rad, ..NO_PRIOR };
            let solution = solve_samples(Method::MaximumLikelihood, recorded.turns(), &prior).unwrap();
            rms(&airframe.errors_deg(&solution.calibration))
        };
        free.push(error(None));
        configured.push(error(Some(airframe.inclination_rad)));
        near.push(error(Some(airframe.inclination_rad + 0.005_2)));
        wrong.push(error(Some(airframe.inclination_rad + 0.035)));
    }
    assert!(rms(&near) <= 1.02 * rms(&free), "{} {}", rms(&near), rms(&free));
    assert!(rms(&configured) <= 1.02 * rms(&free), "{} {}", rms(&configured), rms(&free));
    assert!(rms(&wrong) < 1.5 * rms(&free), "{} {}", rms(&wrong), rms(&free));
}

#[test]
fn one_side_and_level_flight_have_an_honest_expected_error() {
    let mut ratios = Vec::new();
    for seed in 0..50 {
        let mut random = Random(1700 + seed);
        let airframe = Airframe::random(&mut random, 0.2, 1.5, 10.0, [-65.0, 65.0]);
        let turns = Flight { attitude_bias_deg: 0.0, ..Flight::TYPICAL }.fly(&airframe, &mut random);
        let level = level_circle(&airframe, 60, &mut random);
        let samples = Parts { left: &turns.left, level: &level, ..Parts::default() }.samples();
        assert_eq!(method_selection::select_method(samples, Procedure::Turns), Ok(Method::MaximumLikelihood));
        let solution = solve_samples(Method::MaximumLikelihood, samples, &NO_PRIOR).unwrap();
        ratios.push(rms(&airframe.errors_deg(&solution.calibration)) / solution.quality.expected_rms_deg);
    }
    assert!(max_abs(&ratios) < 3.0, "{}", max_abs(&ratios));
}

/// Without consider states, heading sigma without sensor noise and expected error agree; with them only the expected
/// error grows.
#[test]
fn sigma_over_the_envelope_is_the_expected_error() {
    let mut random = Random(3);
    let airframe = Airframe::random(&mut random, 0.2, 1.5, 10.0, [50.0, 50.0]);
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
    let sigma_deg = |bank_deg: f32, heading_deg: u16| {
        let attitude = Attitude::from_deg(bank_deg, 0.0);
        let heading_rad = f32::from(heading_deg).to_radians();
        let level = Field::earth_field(calibration.total_ut, calibration.inclination_rad, heading_rad);
        let field = Field::new(field_from_body * attitude.to_body_frame(level).ut + calibration.b_vector_ut());
        quiet.heading_variance(calibration, field, &attitude.tilt_rotation(), level).sigma_rad().to_degrees()
    };
    let headings = || (0..360).step_by(30);
    banks_deg.iter().flat_map(|&bank| headings().map(move |heading| sigma_deg(bank, heading))).collect()
}
