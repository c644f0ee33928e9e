//! Analytic derivatives against numerical ones. With a wrong sign or index some flights still converge, slightly off.

use nalgebra::{Matrix3, Vector3};

use super::synthetic::{Random, random_vector};
use crate::calibration::hypotheses::attitude_error::AttitudeState;
use crate::calibration::hypotheses::attitude_error_table::ATTITUDE_ERRORS;
use crate::calibration::model::{
    FieldPrediction, Likelihood, MeasuredSample, ModelConfig, ModelParameters, NoiseModel, PriorQuantity,
    SampleEquations, UNKNOWN_COUNT, Vector13, for_each_prior,
};
use crate::calibration::{AngleRates, Prior, Sample, Samples};
use crate::frames::{Field, Level, RollPitch, wrap_pi};

/// Step of the differences. The functions are of size one with curvature scale above 0.4: the fourth-order rule leaves
/// 1e-5, `f32` rounding 1e-7 / 0.02.
const STEP: f32 = 0.02;

/// Tolerance, absolute and relative: ten times the numerical error, a hundredth of the effect of the smallest sign or
/// index error.
const TOLERANCE: f32 = 3e-4;

/// Derivative at zero by fourth-order central differences.
pub(crate) fn numerical_derivative(function: impl Fn(f32) -> f32) -> f32 {
    let difference = |step: f32| function(step) - function(-step);
    (8.0 * difference(STEP) - difference(2.0 * STEP)) / (12.0 * STEP)
}

#[track_caller]
pub(crate) fn assert_derivative(analytic: f32, function: impl Fn(f32) -> f32, label: &str) {
    let numerical = numerical_derivative(function);
    assert!(
        (analytic - numerical).abs() <= TOLERANCE * (1.0 + numerical.abs()),
        "{label}: {analytic}, not {numerical}"
    );
}

#[track_caller]
fn assert_jacobian_row(row: &Vector13, at: &Vector13, function: impl Fn(&Vector13) -> f32, label: &str) {
    for i in 0..UNKNOWN_COUNT {
        let value_after = |step: f32| {
            let mut unknowns = *at;
            unknowns[i] += step;
            function(&unknowns)
        };
        assert_derivative(row[i], value_after, &format!("{label} by unknown {i}"));
    }
}

struct Case {
    unknowns: Vector13,
    attitude: RollPitch,
    centred_field: Vector3<f32>,
}

impl Case {
    /// Bad airframes and steep attitudes, with the field at least 20 deg from the vertical, where curvature allows the
    /// step.
    fn random(random: &mut Random) -> Self {
        loop {
            let parameters = ModelParameters {
                w: Matrix3::identity() + Matrix3::from_fn(|_, _| random.uniform(-0.3, 0.3)),
                corrected_mean_field: random_vector(random, 0.5),
                inclination_rad: random.uniform(-1.2, 1.2),
            };
            let case = Self {
                unknowns: parameters.unknowns().unwrap(),
                attitude: RollPitch { roll_rad: random.uniform(-1.2, 1.2), pitch_rad: random.uniform(-0.7, 0.7) },
                centred_field: random_vector(random, 1.0),
            };
            let prediction = case.predict(&case.unknowns);
            if (0.7..1.4).contains(&prediction.norm) && prediction.cos_inclination > 0.4 {
                return case;
            }
        }
    }

    /// Random parameters and sample with a corrected field of norm one.
    fn normalised(random: &mut Random) -> Self {
        let mut case = Self::random(random);
        let mut parameters = ModelParameters::from_unknowns(&case.unknowns);
        let total = case.predict(&case.unknowns).norm;
        parameters.w /= total;
        parameters.corrected_mean_field /= total;
        case.unknowns = parameters.unknowns().unwrap();
        case
    }

    fn predict(&self, unknowns: &Vector13) -> FieldPrediction {
        ModelParameters::from_unknowns(unknowns).predict_field(self.centred_field, &self.attitude.tilt_rotation())
    }
}

fn random_cases(make: impl Fn(&mut Random) -> Case) -> impl Iterator<Item = Case> {
    let mut random = Random(81);
    (0..40).map(move |_| make(&mut random))
}

#[test]
fn prediction_rows_equal_numerical_derivatives() {
    for case in random_cases(Case::random) {
        let (at, predict) = (&case.unknowns, |u: &Vector13| case.predict(u));
        let prediction = predict(at);
        let [norm, inclination, heading] = [
            prediction.norm_row(),
            prediction.inclination_row(),
            prediction.heading_row(&case.attitude.tilt_rotation()),
        ]
        .map(|row| row.as_vector());
        assert_jacobian_row(&norm, at, |u| predict(u).norm - 1.0, "norm");
        let inclination_residual =
            |u: &Vector13| predict(u).inclination_rad - ModelParameters::from_unknowns(u).inclination_rad;
        assert_jacobian_row(&inclination, at, inclination_residual, "inclination");
        let turned = |u: &Vector13| wrap_pi(predict(u).heading_rad() - prediction.heading_rad());
        assert_jacobian_row(&heading, at, turned, "heading");
    }
}

/// A bank scale of 1 is a roll error equal to the roll.
#[test]
fn inclination_derivatives_by_attitude_equal_numerical_ones() {
    for case in random_cases(Case::normalised) {
        let parameters = ModelParameters::from_unknowns(&case.unknowns);
        let predicted_inclination_rad = |attitude: RollPitch| {
            parameters.predict_field(case.centred_field, &attitude.tilt_rotation()).inclination_rad
        };
        let RollPitch { roll_rad, pitch_rad } = case.attitude;
        let rolled = |step| predicted_inclination_rad(RollPitch { roll_rad: roll_rad + step, pitch_rad });
        let pitched = |step| predicted_inclination_rad(RollPitch { roll_rad, pitch_rad: pitch_rad + step });
        let scaled = |step: f32| predicted_inclination_rad(RollPitch { roll_rad: roll_rad * (1.0 + step), pitch_rad });
        let [by_roll, by_pitch] = parameters
            .predict_field(case.centred_field, &case.attitude.tilt_rotation())
            .inclination_derivatives_by_attitude(&case.attitude.tilt_rotation());
        assert_derivative(by_roll, rolled, "inclination by roll");
        assert_derivative(by_pitch, pitched, "inclination by pitch");
        let equations = equations(&case, &case.unknowns, None, false);
        let [roll_bias, pitch_bias, bank_scale, latency] = core::array::from_fn(|index| {
            ATTITUDE_ERRORS[index]
                .inclination_derivative(&equations, &AttitudeState::steady_turn(case.attitude, test_rates()))
        });
        assert_derivative(roll_bias, rolled, "inclination by roll bias");
        assert_derivative(pitch_bias, pitched, "inclination by pitch bias");
        assert_derivative(bank_scale, scaled, "inclination by bank scale");
        let later = |step: f32| {
            let sample = Sample::new(Field::from_ut(0.0, 0.0, 0.0), case.attitude);
            let sample = Sample { rates: test_rates(), ..sample };
            predicted_inclination_rad(sample.latency_compensated_attitude(step))
        };
        assert_derivative(latency, later, "inclination by latency");
    }
}

fn test_rates() -> AngleRates {
    AngleRates::from_rad_s([0.8, -0.6, 0.0])
}

fn equations(case: &Case, unknowns: &Vector13, heading_rad: Option<f32>, refined: bool) -> SampleEquations {
    let measured =
        MeasuredSample { centred_field: case.centred_field, tilt_rotation: case.attitude.tilt_rotation(), heading_rad };
    // Noise with another W correlates norm and inclination.
    let noise = NoiseModel::new(0.01, 0.02, Matrix3::new(1.2, 0.1, -0.2, 0.3, 0.9, 0.1, -0.1, 0.2, 1.1));
    SampleEquations::new(&ModelParameters::from_unknowns(unknowns), &measured, &noise, &ModelConfig::DEFAULT, refined)
}

/// Rows after decorrelation and attitude correction, at zero residuals, where these do not contribute. The heading
/// residual uses the corrected measurement, which depends on the other two, and is tested without the correction.
#[test]
fn equation_rows_equal_numerical_derivatives() {
    for case in random_cases(Case::normalised) {
        let mut parameters = ModelParameters::from_unknowns(&case.unknowns);
        let prediction = case.predict(&case.unknowns);
        parameters.inclination_rad = prediction.inclination_rad;
        let at = parameters.unknowns().unwrap();
        // A tenth of the step keeps residuals below the Huber limit.
        let slightly = |u: &Vector13| at + (u - at) * 0.1;
        let heading_rad = Some(prediction.heading_rad());
        for refined in [false, true] {
            let both = |u: &Vector13| {
                let equations = equations(&case, u, heading_rad, refined);
                [equations.norm_equation, equations.inclination_equation.unwrap()]
            };
            for (i, equation) in both(&at).into_iter().enumerate() {
                let residual = |u: &Vector13| both(&slightly(u))[i].residual * 10.0;
                assert_jacobian_row(&equation.jacobian_row.as_vector(), &at, residual, ["norm", "inclination"][i]);
            }
        }
        let heading_equation = |u: &Vector13| equations(&case, u, heading_rad, false).heading_equation.unwrap();
        let row = heading_equation(&at).jacobian_row.as_vector();
        assert_jacobian_row(&row, &at, |u| heading_equation(u).residual, "heading");
    }
}

/// The inclination equation is decorrelated by the regression slope of the sensor noise.
#[test]
fn inclination_is_decorrelated_from_the_norm() {
    let noise_w = Matrix3::new(1.2, 0.1, -0.2, 0.3, 0.9, 0.1, -0.1, 0.2, 1.1);
    for case in random_cases(Case::normalised) {
        let prediction = case.predict(&case.unknowns);
        let equations = equations(&case, &case.unknowns, None, false);
        let [norm_by_x, inclination_by_x] = [prediction.field_direction, prediction.inclination_derivative_by_field]
            .map(|derivative| noise_w.tr_mul(&derivative));
        let slope = norm_by_x.dot(&inclination_by_x) / norm_by_x.norm_squared();
        let tilt_variance = 0.02_f32.powi(2) - 0.01_f32.powi(2);
        let [roll, pitch] = prediction.inclination_derivatives_by_attitude(&case.attitude.tilt_rotation());
        let left = (inclination_by_x - norm_by_x * slope).norm_squared() * 0.01_f32.powi(2)
            + tilt_variance * (roll * roll + pitch * pitch);
        let inclination_equation = equations.inclination_equation.unwrap();
        let expected = prediction.inclination_row().as_vector() - prediction.norm_row().as_vector() * slope;
        assert!((inclination_equation.jacobian_row.as_vector() - expected).norm() < 1e-4 * expected.norm());
        let norm_variance = norm_by_x.norm_squared() * 0.01_f32.powi(2);
        assert!((equations.norm_equation.weight * norm_variance - 1.0).abs() < 1e-4);
        let sigma = left.sqrt();
        let huber = (ModelConfig::DEFAULT.huber_sigmas * sigma / inclination_equation.residual.abs()).min(1.0);
        let weight_ratio = inclination_equation.weight * left / huber;
        assert!((weight_ratio - 1.0).abs() < 1e-3, "{weight_ratio}");
    }
}

/// Likelihood with a nonzero mean and a unit other than one.
fn likelihood(known_inclination_rad: Option<f32>) -> Likelihood {
    let prior = Prior { inclination_rad: known_inclination_rad, ..Prior::default() };
    let mut likelihood = Likelihood::new(&prior, ModelConfig::DEFAULT, Samples::default(), 40.0);
    likelihood.mean_field = Vector3::new(0.3, -0.8, 0.5);
    likelihood
}

fn priors(likelihood: &Likelihood, unknowns: &Vector13) -> Vec<(PriorQuantity, Vector13, f32, f32)> {
    let mut priors = Vec::new();
    for_each_prior(likelihood, &ModelParameters::from_unknowns(unknowns), &mut |p| {
        priors.push((p.prior_quantity, p.jacobian_row, p.residual, p.sigma));
    });
    priors
}

#[test]
fn prior_rows_equal_numerical_derivatives() {
    for case in random_cases(Case::random) {
        for likelihood in [likelihood(None), likelihood(Some(0.9))] {
            for (i, (quantity, row, ..)) in priors(&likelihood, &case.unknowns).into_iter().enumerate() {
                let residual = |u: &Vector13| priors(&likelihood, u)[i].2;
                assert_jacobian_row(&row, &case.unknowns, residual, &format!("prior {i} of {quantity:?}"));
            }
        }
    }
}

/// Each prior reacts to its own quantity only: mounting to rotation, soft iron to stretching, hard iron and inclination
/// to their own.
#[test]
fn each_prior_constrains_its_own_quantity() {
    let likelihood = likelihood(Some(0.9));
    let straight =
        ModelParameters { w: Matrix3::identity(), corrected_mean_field: likelihood.mean_field, inclination_rad: 0.9 };
    let sizes = |parameters: &ModelParameters| {
        let mut sizes = [0.0_f32; 4];
        for (quantity, _, residual, _) in priors(&likelihood, &parameters.unknowns().unwrap()) {
            sizes[quantity as usize] = sizes[quantity as usize].hypot(residual);
        }
        sizes
    };
    // Adjusting `d` keeps the hard iron when W changes.
    let with_w =
        |w: Matrix3<f32>| ModelParameters { corrected_mean_field: w * likelihood.mean_field, w, ..straight.clone() };
    let moved = straight.corrected_mean_field - Vector3::new(0.1, 0.2, -0.2);
    let turn = Vector3::new(0.02, -0.01, 0.02).cross_matrix();
    let skewed = Matrix3::new(1.0, 0.1, 0.0, 0.1, 1.0, 0.2, 0.0, 0.2, 1.0);
    // Sizes in the order soft iron, mounting, hard iron, inclination.
    for (name, parameters, expected) in [
        ("nothing", straight.clone(), [0.0; 4]),
        ("inclination", ModelParameters { inclination_rad: 1.0, ..straight.clone() }, [0.0, 0.0, 0.0, 0.1]),
        ("hard iron", ModelParameters { corrected_mean_field: moved, ..straight.clone() }, [0.0, 0.0, 0.3, 0.0]),
        ("scale", with_w(Matrix3::identity() * 1.3), [0.0; 4]),
        ("mounting", with_w(Matrix3::identity() + turn), [0.0, 0.03, 0.0, 0.0]),
        ("stretch", with_w(Matrix3::from_diagonal(&[1.1, 1.0, 0.9].into())), [0.02_f32.sqrt(), 0.0, 0.0, 0.0]),
        ("skew", with_w(skewed), [0.05_f32.sqrt(), 0.0, 0.0, 0.0]),
    ] {
        let found = sizes(&parameters);
        let largest = found.iter().zip(expected).map(|(f, e)| (f - e).abs()).fold(0.0, f32::max);
        assert!(largest < 1e-4, "{name}: {found:?} {expected:?}");
    }
}

#[test]
fn an_expected_field_has_no_residuals() {
    let mut random = Random(82);
    for case in random_cases(Case::normalised) {
        let parameters = ModelParameters::from_unknowns(&case.unknowns);
        let heading_rad = random.uniform(-3.0, 3.0);
        let tilt = case.attitude.tilt_rotation();
        let x = parameters.expected_field(&tilt, heading_rad).unwrap();
        let prediction = parameters.predict_field(x, &tilt);
        let level = Field::<Level>::earth_field(1.0, parameters.inclination_rad, heading_rad).ut;
        assert!((prediction.norm - 1.0).abs() < 1e-5 && (prediction.level_field - level).norm() < 1e-5);
        assert!((prediction.inclination_rad - parameters.inclination_rad).abs() < 1e-5);
        assert!(wrap_pi(prediction.heading_rad() - heading_rad).abs() < 1e-5);
    }
}

#[test]
fn parameters_round_trip_through_unknowns() {
    let unknowns = Vector13::from_fn(|i, _| i as f32 + 1.0);
    assert_eq!(ModelParameters::from_unknowns(&unknowns).unknowns(), Some(unknowns));
    for i in 0..UNKNOWN_COUNT {
        let mut bad = unknowns;
        bad[i] = f32::NAN;
        assert_eq!(ModelParameters::from_unknowns(&bad).unknowns(), None);
    }
}

#[test]
fn a_field_without_heading_has_finite_equations() {
    let straight =
        ModelParameters { w: Matrix3::identity(), corrected_mean_field: Vector3::zeros(), inclination_rad: 1.0 };
    for centred_field in [Vector3::new(1e-9, 0.0, 0.0), Vector3::new(0.0, 0.0, 1.0)] {
        let case = Case { unknowns: straight.unknowns().unwrap(), attitude: RollPitch::default(), centred_field };
        let equations = equations(&case, &case.unknowns, Some(0.0), true);
        for equation in [Some(equations.norm_equation), equations.inclination_equation, equations.heading_equation]
            .into_iter()
            .flatten()
        {
            assert!(equation.jacobian_row.as_vector().iter().all(|r| r.is_finite()) && equation.residual.is_finite());
            assert!(equation.weight > 0.0 && equation.weight.is_finite());
        }
    }
}
