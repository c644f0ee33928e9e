//! Unit tests of `hard_iron_change`.

use crate::calibration::tests::synthetic::Parts;
use nalgebra::{Matrix3, SVector};

use super::*;
use crate::calibration::closed_form::starting_point;
use crate::calibration::model::{JacobianRow, Likelihood, ModelConfig, NoiseModel};
use crate::calibration::tests::derivatives::assert_derivative;
use crate::calibration::tests::synthetic::{Airframe, Flight, Random, RecordedTurns, measured_sample};
use crate::calibration::uncertainty::information::Information;
use crate::calibration::{Calibration, LeastSquares, Method, Orientation, Prior, Sample};
use crate::frames::Field;

/// Flight with a hard-iron change by `beta_ut` before a time, and unknowns near the maximum likelihood.
struct Case {
    recorded: RecordedTurns,
    likelihood: Likelihood,
    unknowns: Vector13,
}

impl Case {
    fn new(beta_ut: Vector3<f32>, before_ms: u32) -> Self {
        let mut random = Random(77);
        let airframe = Airframe::random(&mut random, 0.1, 1.0, 5.0, [50.0, 60.0]);
        let mut recorded = Flight::TYPICAL.fly(&airframe, &mut random);
        for sample in &mut recorded.right {
            sample.time = WrappingMillis::new(sample.time.as_ms() + 75_000);
        }
        for sample in recorded.left.iter_mut().chain(&mut recorded.right) {
            sample.field.ut += if sample.time.as_ms() < before_ms { beta_ut } else { Vector3::zeros() };
        }
        let start = starting_point::sphere_start(recorded.turns(), &Matrix3::identity()).unwrap();
        let mut likelihood =
            Likelihood::new(&Prior::default(), ModelConfig::DEFAULT, recorded.turns(), airframe.total_ut);
        let unknowns = likelihood
            .unknowns_from_start(&starting_point::StartingPoint { field_unit_ut: airframe.total_ut, ..start })
            .unwrap();
        likelihood.noise = NoiseModel::new(0.003, 0.006, Matrix3::identity());
        // Huber weights would depend on the point of linearisation.
        likelihood.config.huber_sigmas = 1e3;
        let mut case = Self { recorded, likelihood, unknowns };
        for _ in 0..6 {
            case.unknowns += case.linearised_problem().step_to_maximum().unwrap();
        }
        case
    }

    fn linearised_problem(&self) -> LinearisedProblem {
        let mut likelihood = self.likelihood.clone();
        (likelihood.sample_stride, likelihood.uses_normal_equations) = (1, false);
        LinearisedProblem::linearise(&likelihood, self.recorded.turns(), &self.unknowns)
    }

    fn converged_fit<'a>(&'a self, calibration: &'a Calibration) -> ConvergedFit<'a> {
        let Self { recorded, likelihood, unknowns } = self;
        ConvergedFit { method: Method::MaximumLikelihood, likelihood, unknowns, calibration, samples: recorded.turns() }
    }

    fn information(&self, scan: Option<&mut HardIronScan>) -> Information {
        let mut information = Information::new(&self.linearised_problem());
        information.accumulate_samples(&self.likelihood, self.recorded.turns(), &self.unknowns, scan);
        information
    }

    fn scanned(&self) -> (HardIronScan, Information) {
        let mut scan = HardIronScan::new(self.recorded.turns(), &self.linearised_problem(), &self.unknowns).unwrap();
        let information = self.information(Some(&mut scan));
        (scan, information)
    }

    fn equations(&self, time_course: TestedTimeCourse) -> Vec<(ResidualEquation, Vector3<f32>, bool)> {
        let span = TimeSpan::from_samples(self.recorded.turns()).unwrap();
        let (parameters, w) =
            (ModelParameters::from_unknowns(&self.unknowns), ModelParameters::from_unknowns(&self.unknowns).w);
        let mut all = Vec::new();
        for (_, sample) in TimeOrdered::new(self.recorded.turns()) {
            let equations = self.likelihood.sample_equations(sample, None, &parameters);
            let share = span.change_fraction_at(time_course, sample);
            for (equation, is_norm) in hard_iron_residuals(&equations).zip([true, false]) {
                all.push((equation.clone(), derivative_by_hard_iron(&w, equation) * share, is_norm));
            }
        }
        all
    }
}

const PAYLOAD_CHANGE_UT: Vector3<f32> = Vector3::new(0.8, -0.5, 0.6);

#[test]
fn hard_iron_derivatives_equal_numerical_ones() {
    let mut case = Case::new(Vector3::zeros(), 0);
    case.likelihood.field_unit_ut = 40.0;
    let parameters = ModelParameters::from_unknowns(&case.unknowns);
    for sample in case.recorded.left.iter().step_by(20) {
        let equations_with = |beta: Vector3<f32>| {
            let field = Field::new(sample.field.ut - beta * case.likelihood.field_unit_ut);
            case.likelihood.sample_equations(&Sample { field, ..*sample }, None, &parameters)
        };
        let unchanged = equations_with(Vector3::zeros());
        for axis in 0..3 {
            let changed = |step: f32| equations_with(Vector3::ith(axis, step));
            let by = |equation: &ResidualEquation| derivative_by_hard_iron(&parameters.w, equation)[axis];
            assert_derivative(
                by(&unchanged.norm_equation),
                |step| changed(step).norm_equation.residual,
                "norm by hard iron",
            );
            let inclination = unchanged.inclination_equation.as_ref().unwrap();
            assert_derivative(
                by(inclination),
                |step| changed(step).inclination_equation.unwrap().residual,
                "inclination by hard iron",
            );
        }
    }
}

/// Agreement to 2 %, because the `f32` rounding allowance shrinks the estimate.
#[test]
fn estimate_equals_joint_least_squares() {
    let case = Case::new(PAYLOAD_CHANGE_UT, 60_000);
    for time_course in [TestedTimeCourse::Step(59_500), TestedTimeCourse::Drift] {
        let mut joint = LeastSquares::<16, 1>::new();
        let mut sums = ScoreTest::zero();
        for (equation, by_beta, _) in case.equations(time_course) {
            let row = SVector::<f32, 16>::from_fn(|i, _| {
                if i < 13 { equation.jacobian_row.as_vector()[i] } else { by_beta[i - 13] }
            });
            joint.add_weighted_row(&row, [-equation.residual], equation.weight);
            sums.add_weighted_equation(&equation, &by_beta, 1.0);
        }
        crate::calibration::model::for_each_prior(
            &case.likelihood,
            &ModelParameters::from_unknowns(&case.unknowns),
            &mut |prior| {
                let row = SVector::<f32, 16>::from_fn(|i, _| if i < 13 { prior.jacobian_row[i] } else { 0.0 });
                joint.add_weighted_row(&row, [-prior.residual], 1.0 / (prior.sigma * prior.sigma));
            },
        );
        let system = case.linearised_problem();
        let (beta, significance) =
            estimate_hard_iron_change(&sums, &system, &system.step_to_maximum().unwrap()).unwrap();
        let expected = joint.solve().unwrap().fixed_rows::<3>(13).into_owned();
        assert!((beta - expected).norm() < 0.02 * expected.norm(), "{beta} {expected}");
        // Reference: the reduction of the sum of squares by the three unknowns.
        let mut covariance = Matrix3::zeros();
        for axis in 0..3 {
            let column = joint.covariance_times(&SVector::<f32, 16>::ith(13 + axis, 1.0)).unwrap();
            covariance.set_column(axis, &column.fixed_rows::<3>(13));
        }
        let lower = expected.dot(&(covariance.try_inverse().unwrap() * expected));
        assert!((significance / lower - 1.0).abs() < 0.02, "{significance} {lower}");
    }
}

/// Constant hard iron is eliminated as one of the unknowns. The information that rounding leaves is below the floor.
#[test]
fn constant_hard_iron_is_no_change() {
    let case = Case::new(Vector3::zeros(), 0);
    let mut sums = ScoreTest::zero();
    for (equation, by_beta, _) in case.equations(TestedTimeCourse::Step(u32::MAX)) {
        sums.add_weighted_equation(&equation, &by_beta, 1.0);
    }
    let system = case.linearised_problem();
    let (beta, significance) = estimate_hard_iron_change(&sums, &system, &system.step_to_maximum().unwrap()).unwrap();
    assert!((0.0..1.0).contains(&significance), "{significance}");
    assert!(beta.norm() * case.likelihood.field_unit_ut < 0.1, "{beta}");
}

/// Duplicate samples add no information: the autocorrelation of their residuals outweighs their number.
#[test]
fn repeated_samples_add_no_significance() {
    let mut case = Case::new(PAYLOAD_CHANGE_UT, 65_000);
    let significance = |case: &Case| {
        let calibration = Calibration::uncalibrated(Orientation::IDENTITY_ROTATION);
        let (scan, information) = case.scanned();
        let found = scan.best_estimate.unwrap();
        scan.significance(&found, &case.converged_fit(&calibration), &information.linear_system, &information.residuals)
            .unwrap()
    };
    let once = significance(&case);
    for samples in [&mut case.recorded.left, &mut case.recorded.right] {
        *samples = samples.iter().flat_map(|sample| [*sample; 2]).collect();
    }
    let twice = significance(&case);
    assert!(twice.into_iter().zip(once).all(|(twice, once)| 0.0 < twice && twice < 1.1 * once), "{twice:?} {once:?}");
}

/// RMS over the headings of level flight; to 3 %, because the unknowns are those of a noisy flight.
#[test]
fn the_size_of_hysteresis_is_the_rms_of_its_response() {
    let case = Case::new(Vector3::zeros(), 0);
    let airframe = Airframe::random(&mut Random(77), 0.1, 1.0, 5.0, [50.0, 60.0]);
    let (scan, parameters) = (case.scanned().0, ModelParameters::from_unknowns(&case.unknowns));
    let mut squares = 0.0;
    for heading in 0_u8..36 {
        let heading_rad = (10.0 * f32::from(heading)).to_radians();
        let level = measured_sample(&airframe, crate::frames::Attitude::default(), heading_rad, 0.0, &mut Random(1));
        let equations = case.likelihood.sample_equations(&level, None, &parameters);
        squares += scan.hysteresis.field_response(&Vector3::z(), 1.0, &equations).norm_squared();
    }
    let (rms, size) = ((squares / 36.0).sqrt(), scan.hysteresis.rms_field_change(-1.0));
    assert!((size / rms - 1.0).abs() < 0.03, "{size} {rms}");
}

/// A sample's pair of residuals is added at once.
#[test]
fn the_sums_of_hysteresis_are_those_of_each_equation() {
    let case = Case::new(Vector3::zeros(), 0);
    let (scan, _) = case.scanned();
    let parameters = ModelParameters::from_unknowns(&case.unknowns);
    let (mut expected, mut last_turn) = (ScoreTest::<1>::zero(), LastTurn::default());
    for (_, sample) in TimeOrdered::new(case.recorded.turns()) {
        let equations = case.likelihood.sample_equations(sample, None, &parameters);
        let lagging = scan.hysteresis.field_response(
            &sample.attitude.tilt_rotation().down_in_body(),
            last_turn.direction_at_sample(sample),
            &equations,
        );
        for equation in hard_iron_residuals(&equations) {
            expected.add_weighted_equation(
                equation,
                &SVector::<f32, 1>::new(lagging.dot(&equation.jacobian_row.derivative_by_field)),
                1.0,
            );
        }
    }
    let found = as_three_unknowns(&scan.hysteresis_sums);
    assert!((found.information[(0, 0)] / expected.information.x - 1.0).abs() < 1e-3);
    assert!((found.gradient.x - expected.gradient.x).abs() < 1e-3 * expected.information.x.sqrt());
    let [found, expected] = [found.cross_information[0], expected.cross_information[0]];
    assert!((found - expected).norm() < 1e-3 * expected.norm(), "{found} {expected}");
}

#[test]
fn the_scan_finds_time_and_size() {
    let (mut scan, information) = Case::new(PAYLOAD_CHANGE_UT, 65_000).scanned();
    scan.extend_drift(0.0);
    scan.test_time_course(&information.linear_system, TestedTimeCourse::Drift);
    let found = scan.best_estimate.unwrap();
    assert_eq!(found.tested_time_course, TestedTimeCourse::Step(64_500));
    let unit_ut = Case::new(PAYLOAD_CHANGE_UT, 65_000).likelihood.field_unit_ut;
    assert!((found.beta * unit_ut - PAYLOAD_CHANGE_UT).norm() < 0.4, "{}", found.beta * unit_ut);
    assert!(found.significance > 100.0);
    let nothing = Case::new(Vector3::zeros(), 0).scanned().0.best_estimate.unwrap();
    assert!(nothing.significance < SECOND_PASS_SIGNIFICANCE, "{nothing:?}");
}

/// Drift sums approximated from the tested times have information and estimate accurate to 3 %.
#[test]
fn drift_sums_approximate_the_exact_sums() {
    let case = Case::new(PAYLOAD_CHANGE_UT, 65_000);
    let (mut scan, information) = case.scanned();
    scan.extend_drift(0.0);
    let mut exact = ScoreTest::zero();
    for (equation, by_beta, _) in case.equations(TestedTimeCourse::Drift) {
        exact.add_weighted_equation(&equation, &by_beta, 1.0);
    }
    let estimate_of = |sums: &ScoreTest<3>| {
        estimate_hard_iron_change(sums, &information.linear_system, &scan.step_to_maximum).unwrap()
    };
    let ((found, significance), (beta, expected)) =
        (estimate_of(&scan.drift_sums.score_test(&scan.w)), estimate_of(&exact));
    assert!((found - beta).norm() < 0.03 * beta.norm(), "{found} {beta}");
    assert!((significance / expected - 1.0).abs() < 0.03, "{significance} {expected}");
}

#[test]
fn the_gradient_effect_is_that_of_the_best_change() {
    let case = Case::new(PAYLOAD_CHANGE_UT, 60_000);
    let scan = case.scanned().0;
    let found = scan.best_estimate.unwrap();
    let effect =
        case.equations(found.tested_time_course).iter().fold(Vector13::zeros(), |sum, (equation, by_beta, _)| {
            sum + equation.jacobian_row.as_vector() * (equation.weight * by_beta.dot(&found.beta))
        });
    assert!((scan.gradient_effect - effect).norm() < 1e-3 * effect.norm());
}

#[test]
fn norm_significance_equals_direct_calculation() {
    let case = Case::new(PAYLOAD_CHANGE_UT, 60_000);
    let time_course = TestedTimeCourse::Step(59_500);
    let information = case.information(None);
    let mut sums = ScoreTest::zero();
    for (equation, by_beta, is_norm) in case.equations(time_course) {
        if is_norm {
            sums.add_weighted_equation(&equation, &by_beta, 1.0);
        }
    }
    let step_to_maximum = information.linear_system.step_to_maximum().unwrap();
    let columns =
        sums.cross_information.map(|cross_row| information.linear_system.covariance_times(&cross_row).unwrap());
    // Score after elimination of the thirteen unknowns; inclination residuals contribute to the eliminated part only.
    let left = |row: &JacobianRow, by_beta: Vector3<f32>| by_beta - Vector3::from_fn(|axis, _| row.dot(&columns[axis]));
    let of_inclination = |(equation, _, is_norm): (ResidualEquation, Vector3<f32>, bool)| {
        if is_norm { 0.0 } else { equation.weight * equation.jacobian_row.derivative_by_inclination.powi(2) }
    };
    let inclinations: f32 = case.equations(time_course).into_iter().map(of_inclination).sum();
    let inclination_excess =
        information.residuals.excess_inclination_information_times(&Vector13::ith(12, 1.0), 0.0)[12] / inclinations;
    let norm = 1.3;
    let mut variance = Matrix3::zeros();
    for (equation, by_beta, is_norm) in case.equations(time_course) {
        let left = left(&equation.jacobian_row, if is_norm { by_beta } else { Vector3::zeros() });
        variance +=
            left * left.transpose() * (equation.weight * if is_norm { norm } else { inclination_excess.max(norm) });
    }
    let gradient = sums.gradient - Vector3::from_fn(|axis, _| sums.cross_information[axis].dot(&step_to_maximum));
    let expected = gradient.dot(&(variance.try_inverse().unwrap() * gradient));
    let found =
        norm_significance(&sums, &information.linear_system, &information.residuals, &step_to_maximum, norm).unwrap();
    assert!((found / expected - 1.0).abs() < 0.05, "{found} {expected}");
    assert!(inclination_excess > 1.5, "{inclination_excess}");
}

fn estimate_of_course(tested_time_course: TestedTimeCourse, significance: f32) -> ChangeEstimate {
    ChangeEstimate { tested_time_course, beta: Vector3::zeros(), significance }
}

#[test]
fn both_significance_thresholds_must_be_exceeded() {
    let is_significant =
        |time_course, second_pass| is_significant(&estimate_of_course(time_course, 0.0), 1.0, second_pass);
    for time_course in [TestedTimeCourse::Step(0), TestedTimeCourse::Drift] {
        assert!(is_significant(time_course, [30.1, 16.1]) && !is_significant(time_course, [29.9, 1e3]));
        assert!(!is_significant(time_course, [1e3, 15.9]) && !is_significant(time_course, [f32::NAN, 1e3]));
    }
    let load = |significance| is_significant(TestedTimeCourse::LoadFactor, significance);
    assert!(load([30.1, 6.7]) && load([60.1, 0.0]) && !load([59.9, 6.5]) && !load([29.9, 1e3]));
    let hysteresis = |significance| is_significant(TestedTimeCourse::Hysteresis, significance);
    assert!(hysteresis([12.1, 6.7]) && hysteresis([30.1, 0.0]) && !hysteresis([11.9, 1e3]) && !hysteresis([29.9, 6.5]));
    // The misfit inflates sigma: with the change as an unknown the residuals are much smaller.
    let mut case = Case::new(PAYLOAD_CHANGE_UT * 4.0, 60_000);
    case.likelihood.noise = NoiseModel::new(0.012, 0.024, Matrix3::identity());
    let calibration = Calibration::uncalibrated(Orientation::IDENTITY_ROTATION);
    for (significance, is_found) in [(16.1, true), (15.9, false)] {
        let (mut scan, information) = case.scanned();
        (scan.drift_sums, scan.drift_fraction) = (HardIronSums::zero(), 0.0);
        (scan.load_factor_sums, scan.hysteresis_sums) = (HardIronSums::zero(), ScoreTest::zero());
        scan.best_estimate.as_mut().unwrap().significance = significance;
        let found =
            scan.confirm_change(&case.converged_fit(&calibration), &information.linear_system, &information.residuals);
        assert_eq!(found.is_some(), is_found, "{significance}");
    }
}

const STEADY_SAMPLE: Sample =
    Sample::new(Field::from_ut(0.0, 0.0, 0.0), crate::frames::Attitude { roll_rad: 0.0, pitch_rad: 0.0 });

/// The best step is the largest of many, so a linkage is preferred that has nearly its significance.
#[test]
fn a_step_must_exceed_a_linkage_by_a_tenth() {
    let (mut scan, information) = Case::new(PAYLOAD_CHANGE_UT, 60_000).scanned();
    let mut estimate_with_best = |best_estimate| {
        scan.best_estimate = best_estimate;
        scan.test_time_course(&information.linear_system, TestedTimeCourse::LoadFactor);
        scan.best_estimate.unwrap()
    };
    let linkage = estimate_with_best(None);
    for (ratio, expected) in [(1.05, linkage.tested_time_course), (1.15, TestedTimeCourse::Step(1))] {
        let significance = ratio * linkage.significance;
        let step = ChangeEstimate { tested_time_course: TestedTimeCourse::Step(1), significance, ..linkage };
        assert_eq!(estimate_with_best(Some(step)).tested_time_course, expected, "{ratio}");
    }
}

/// Iron of a step is hard iron before or after it, in turns and in level flight.
#[test]
fn only_iron_in_a_linkage_is_added_in_turns() {
    let case = Case::new(PAYLOAD_CHANGE_UT * 4.0, 60_000);
    let calibration = Calibration::uncalibrated(Orientation::IDENTITY_ROTATION);
    let (mut scan, information) = case.scanned();
    let step = scan.best_estimate.unwrap();
    for (tested_time_course, expected) in
        [(step.tested_time_course, Vector3::zeros()), (TestedTimeCourse::LoadFactor, scan.w * step.beta)]
    {
        scan.best_estimate = Some(ChangeEstimate { tested_time_course, significance: 1e6, ..step });
        let found =
            scan.confirm_change(&case.converged_fit(&calibration), &information.linear_system, &information.residuals);
        assert_eq!(found.unwrap().effect.added_in_turns, expected, "{tested_time_course:?}");
    }
}

#[test]
fn both_passes_together_confirm_iron_in_a_linkage() {
    let is_confirmed = |time_course, first_pass, size_ut, total_significance| {
        is_significant(&estimate_of_course(time_course, first_pass), size_ut, [total_significance, 0.0])
    };
    let load = |first, size_ut, total| is_confirmed(TestedTimeCourse::LoadFactor, first, size_ut, total);
    assert!(load(201.0, 19.9, 12.1));
    assert!(!load(199.0, 19.9, 12.1) && !load(201.0, 20.1, 12.1) && !load(201.0, 19.9, 11.9));
    for time_course in [TestedTimeCourse::Step(1), TestedTimeCourse::Drift] {
        assert!(!is_confirmed(time_course, 1e3, 5.0, 1e3));
    }
    assert!(!is_confirmed(TestedTimeCourse::Hysteresis, 1e3, 5.0, 29.9));
}

#[test]
fn fraction_of_the_change_at_a_time() {
    let span = TimeSpan { start: WrappingMillis::new(u32::MAX - 999), duration_ms: 4_000 };
    let at = |ms: u32| Sample { time: WrappingMillis::new((u32::MAX - 999).wrapping_add(ms)), ..STEADY_SAMPLE };
    for (ms, step, drift) in [(0, 1.0, 1.0), (1_000, 1.0, 0.75), (1_001, 0.0, 0.749_75), (4_000, 0.0, 0.0)] {
        assert!((span.change_fraction_at(TestedTimeCourse::Step(1_000), &at(ms)) - step).abs() < 1e-6, "{ms}");
        assert!((span.change_fraction_at(TestedTimeCourse::Drift, &at(ms)) - drift).abs() < 1e-6, "{ms}");
    }
    // Share of the change: 1 at the load factor of 25 deg of bank and above, 1/2 at half its excess over 1.
    for (load, fraction) in [(1.0, 0.0), (1.0517, 0.5), (1.1034, 1.0), (1.5, 1.0)] {
        let roll_rad = f32::acos(1.0 / load);
        let turning = Sample { attitude: crate::frames::Attitude { roll_rad, pitch_rad: 0.0 }, ..STEADY_SAMPLE };
        assert!((span.change_fraction_at(TestedTimeCourse::LoadFactor, &turning) - fraction).abs() < 1e-3, "{load}");
    }
    assert_eq!((whole_seconds(999), whole_seconds(31_999), whole_seconds(u32::MAX)), (0, 31, 65_535));
}

#[test]
fn the_time_span_covers_all_parts() {
    let at = |millis| Sample { time: WrappingMillis::new(millis), ..STEADY_SAMPLE };
    let (left, right, level) = ([at(50), at(900)], [at(20), at(300)], [at(400), at(700)]);
    let span_of =
        |left, right, level| TimeSpan::from_samples(Parts { left, right, level, ..Parts::default() }.samples());
    let span = span_of(&left, &right, &level).unwrap();
    assert_eq!((span.start.as_ms(), span.duration_ms), (20, 880));
    assert_eq!(span_of(&[], &[], &level).unwrap().duration_ms, 300);
    let any = Parts { free: &[level, left].concat(), ..Parts::default() }.samples();
    assert_eq!(TimeSpan::from_samples(any).map(|span| (span.start.as_ms(), span.duration_ms)), Some((50, 850)));
    assert!(span_of(&[], &[], &[]).is_none());
}
