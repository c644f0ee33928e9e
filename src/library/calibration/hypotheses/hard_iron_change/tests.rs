//! Unit tests of `hard_iron_change`.

use nalgebra::Matrix3;

use super::*;
use crate::calibration::closed_form::starting_point;
use crate::calibration::model::{Likelihood, ModelConfig, NoiseModel};
use crate::calibration::tests::derivatives::assert_derivative;
use crate::calibration::tests::synthetic::{Airframe, Flight, Parts, RecordedTurns};
use crate::calibration::uncertainty::information::Information;
use crate::calibration::{Calibration, Method, Orientation, Prior, Sample};
use crate::frames::{Field, RollPitch};
use crate::time::WrappingMillis;

/// Flight with a hard-iron change by `beta_ut` before a time, and unknowns near the maximum likelihood.
struct Case {
    recorded: RecordedTurns,
    likelihood: Likelihood,
    unknowns: Vector13,
}

impl Case {
    fn new(beta_ut: Vector3<f32>, before_ms: u32) -> Self {
        let (mut random, airframe) = Airframe::seeded(77, 0.1, 1.0, 5.0, [50.0, 60.0]);
        let mut recorded = Flight::TYPICAL.fly(&airframe, &mut random).left_then_right();
        for sample in recorded.samples_mut().filter(|sample| sample.time.as_ms() < before_ms) {
            sample.field.ut += beta_ut;
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

    /// Each residual with its derivative by the hard-iron change.
    fn equations(&self, time_course: HardIronTimeCourse) -> Vec<(ResidualEquation, Vector3<f32>)> {
        let span = TimeSpan::from_samples(self.recorded.turns()).unwrap();
        let parameters = ModelParameters::from_unknowns(&self.unknowns);
        let mut all = Vec::new();
        for sample in self.recorded.turns().iter() {
            let equations = self.likelihood.sample_equations(sample, None, &parameters);
            let fraction = span.change_fraction_at(time_course, sample);
            for equation in hard_iron_residuals(&equations) {
                all.push((equation.clone(), derivative_by_hard_iron(&parameters.w, equation) * fraction));
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
            let norm = |step: f32| changed(step).norm_equation.residual;
            assert_derivative(by(&unchanged.norm_equation), norm, "norm by hard iron");
            let inclination = |step: f32| changed(step).inclination_equation.unwrap().residual;
            let equation = unchanged.inclination_equation.as_ref().unwrap();
            assert_derivative(by(equation), inclination, "inclination by hard iron");
        }
    }
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

#[test]
fn the_gradient_effect_is_that_of_the_best_change() {
    let case = Case::new(PAYLOAD_CHANGE_UT, 60_000);
    let scan = case.scanned().0;
    let found = scan.best_estimate.unwrap();
    let effect = case.equations(found.time_course).iter().fold(Vector13::zeros(), |sum, (equation, by_beta)| {
        sum + equation.jacobian_row.as_vector() * (equation.weight * by_beta.dot(&found.beta))
    });
    assert!((scan.gradient_effect - effect).norm() < 1e-3 * effect.norm());
}

const STEADY_SAMPLE: Sample = Sample::new(Field::from_ut(0.0, 0.0, 0.0), RollPitch { roll_rad: 0.0, pitch_rad: 0.0 });

/// Iron of a step is hard iron before or after it, in turns and in level flight.
#[test]
fn only_iron_in_a_linkage_is_added_in_turns() {
    let case = Case::new(PAYLOAD_CHANGE_UT * 4.0, 60_000);
    let calibration = Calibration::uncalibrated(Orientation::IDENTITY_ROTATION);
    let (mut scan, information) = case.scanned();
    let step = scan.best_estimate.unwrap();
    for (time_course, expected) in
        [(step.time_course, Vector3::zeros()), (HardIronTimeCourse::LoadFactor, scan.w * step.beta)]
    {
        scan.best_estimate = Some(ChangeEstimate { time_course, significance: 1e6, ..step });
        let found =
            scan.confirm_change(&case.converged_fit(&calibration), &information.linear_system, &information.residuals);
        assert_eq!(found.unwrap().effect.added_in_turns, expected, "{time_course:?}");
    }
}

#[test]
fn fraction_of_the_change_at_a_time() {
    let span = TimeSpan { start: WrappingMillis::new(u32::MAX - 999), duration_ms: 4_000 };
    let at = |ms: u32| Sample { time: WrappingMillis::new((u32::MAX - 999).wrapping_add(ms)), ..STEADY_SAMPLE };
    for (ms, step, drift) in [(0, 1.0, 1.0), (1_000, 1.0, 0.75), (1_001, 0.0, 0.749_75), (4_000, 0.0, 0.0)] {
        assert!(
            (span.change_fraction_at(HardIronTimeCourse::Step { after_ms: 1_000 }, &at(ms)) - step).abs() < 1e-6,
            "{ms}"
        );
        assert!((span.change_fraction_at(HardIronTimeCourse::Drift, &at(ms)) - drift).abs() < 1e-6, "{ms}");
    }
    // Share of the change: 1 at the load factor of 25 deg of bank and above, 1/2 at half its excess over 1.
    for (load, fraction) in [(1.0, 0.0), (1.0517, 0.5), (1.1034, 1.0), (1.5, 1.0)] {
        let roll_rad = f32::acos(1.0 / load);
        let turning = Sample { attitude: RollPitch { roll_rad, pitch_rad: 0.0 }, ..STEADY_SAMPLE };
        assert!((span.change_fraction_at(HardIronTimeCourse::LoadFactor, &turning) - fraction).abs() < 1e-3, "{load}");
    }
}

#[test]
fn the_time_span_covers_all_parts() {
    let at = |millis| Sample { time: WrappingMillis::new(millis), ..STEADY_SAMPLE };
    let (left, right, level, free) = ([at(50)], [at(20), at(300)], [at(400), at(900)], [at(700), at(30)]);
    for (samples, expected) in [
        (Parts { left: &left, right: &right, level: &level, ..Parts::default() }, Some((20, 880))),
        (Parts { level: &level, ..Parts::default() }, Some((400, 500))),
        (Parts { level: &level, free: &free, ..Parts::default() }, Some((30, 870))),
        (Parts::default(), None),
    ] {
        let span = TimeSpan::from_samples(samples.samples());
        assert_eq!(span.map(|span| (span.start.as_ms(), span.duration_ms)), expected);
    }
}

/// Rules of the second pass: each hypothesis with the significance in total and of the norm alone; an attitude error
/// looks like a step in the total, iron in a linkage counts without the norm where it is certain or shows in both passes.
#[test]
fn each_hypothesis_is_confirmed_by_its_own_significance() {
    use HardIronTimeCourse::{Drift, Hysteresis, LoadFactor};
    const STEP: HardIronTimeCourse = HardIronTimeCourse::Step { after_ms: 0 };
    // Hypothesis, significance of the first pass, size in microtesla, second pass.
    for (time_course, first_pass, size_ut, second_pass, is_confirmed) in [
        (STEP, 50.0, 5.0, [45.0, 20.0], true),
        (STEP, 50.0, 5.0, [25.0, 20.0], false),
        (Drift, 50.0, 5.0, [45.0, 10.0], false),
        (LoadFactor, 90.0, 5.0, [80.0, 0.0], true),
        (LoadFactor, 90.0, 5.0, [45.0, 8.0], true),
        (LoadFactor, 90.0, 5.0, [45.0, 5.0], false),
        (LoadFactor, 300.0, 15.0, [20.0, 0.0], true),
        (LoadFactor, 300.0, 25.0, [20.0, 0.0], false),
        (LoadFactor, 150.0, 15.0, [20.0, 0.0], false),
        (LoadFactor, 300.0, 15.0, [8.0, 0.0], false),
        (Hysteresis, 40.0, 5.0, [40.0, 0.0], true),
        (Hysteresis, 40.0, 5.0, [20.0, 8.0], true),
        (Hysteresis, 40.0, 5.0, [20.0, 5.0], false),
    ] {
        let estimate = ChangeEstimate { time_course, beta: Vector3::zeros(), significance: first_pass };
        let found = is_significant(&estimate, size_ut, second_pass);
        assert_eq!(found, is_confirmed, "{time_course:?}, {first_pass}, {size_ut} uT, {second_pass:?}");
    }
}
