//! Every derivative that is written down, against the differences of what it is the derivative of (as the gradient
//! checkers of Ceres and GTSAM do). A derivative with a wrong sign or in a wrong place still lets some flights
//! converge, to a place that is slightly wrong.

use nalgebra::{Matrix3, Vector3};

use super::synthetic::{Random, vector};
use crate::calibration::likelihood::unknowns::{UNKNOWNS, Vector13};
use crate::calibration::likelihood::{
    Config, Equations, Likelihood, Measured, Noise, Parameters, Prediction, Prior, Quantity, for_each_prior,
};
use crate::calibration::{Rates, Sample, Samples};
use crate::frames::{Attitude, Field, Level, wrap_pi};
use crate::time::WrappingMillis;

/// Step of the differences. What is differentiated is of size one and bends on a scale of 0.4 or more, so that the
/// fourth-order rule is good to 1e-5; the seven digits of `f32` leave 1e-7 / 0.02.
const STEP: f32 = 0.02;

/// Differences and derivatives agree to this, relative to one and to the derivative: ten times what the step leaves,
/// and a hundredth of what the smallest slip of a sign or an index makes.
const TOLERANCE: f32 = 3e-4;

/// Derivative at zero of a function: central differences of fourth order.
pub(crate) fn derivative(function: impl Fn(f32) -> f32) -> f32 {
    let difference = |step: f32| function(step) - function(-step);
    (8.0 * difference(STEP) - difference(2.0 * STEP)) / (12.0 * STEP)
}

/// Asserts that a written derivative is that of a function.
#[track_caller]
pub(crate) fn assert_derivative(written: f32, function: impl Fn(f32) -> f32, what: &str) {
    let numerical = derivative(function);
    assert!((written - numerical).abs() <= TOLERANCE * (1.0 + numerical.abs()), "{what}: {written}, not {numerical}");
}

/// Asserts that a row holds the derivatives of a function by the unknowns.
#[track_caller]
fn assert_row(row: &Vector13, at: &Vector13, function: impl Fn(&Vector13) -> f32, what: &str) {
    for i in 0..UNKNOWNS {
        let moved = |step: f32| {
            let mut unknowns = *at;
            unknowns[i] += step;
            function(&unknowns)
        };
        assert_derivative(row[i], moved, &format!("{what} by unknown {i}"));
    }
}

/// Parameters and a measurement.
struct Case {
    unknowns: Vector13,
    attitude: Attitude,
    x: Vector3<f32>,
}

impl Case {
    /// Airframes up to bad ones and any bank and pitch up to steep ones, the field no closer to the vertical than 20
    /// deg: nearer to it headings and dips bend too sharply for the step.
    fn random(random: &mut Random) -> Self {
        loop {
            let parameters = Parameters {
                w: Matrix3::identity() + Matrix3::from_fn(|_, _| random.uniform(-0.3, 0.3)),
                d: vector(random, 0.5),
                inclination_rad: random.uniform(-1.2, 1.2),
            };
            let case = Self {
                unknowns: parameters.unknowns().unwrap(),
                attitude: Attitude { roll_rad: random.uniform(-1.2, 1.2), pitch_rad: random.uniform(-0.7, 0.7) },
                x: vector(random, 1.0),
            };
            let prediction = case.predict(&case.unknowns);
            if (0.7..1.4).contains(&prediction.total) && prediction.horizontal > 0.4 {
                return case;
            }
        }
    }

    /// One whose corrected field is of size one, as it should be.
    fn of_size_one(random: &mut Random) -> Self {
        let mut case = Self::random(random);
        let mut parameters = Parameters::new(&case.unknowns);
        let total = case.predict(&case.unknowns).total;
        parameters.w /= total;
        parameters.d /= total;
        case.unknowns = parameters.unknowns().unwrap();
        case
    }

    fn predict(&self, unknowns: &Vector13) -> Prediction {
        Parameters::new(unknowns).predict(self.x, &self.attitude.tilt())
    }
}

fn cases(make: impl Fn(&mut Random) -> Case) -> impl Iterator<Item = Case> {
    let mut random = Random(81);
    (0..40).map(move |_| make(&mut random))
}

#[test]
fn the_norm_s_row() {
    for case in cases(Case::random) {
        let row = case.predict(&case.unknowns).norm_row().dense();
        assert_row(&row, &case.unknowns, |u| case.predict(u).total - 1.0, "norm");
    }
}

#[test]
fn the_dip_s_row() {
    for case in cases(Case::random) {
        let row = case.predict(&case.unknowns).dip_row().dense();
        let residual = |u: &Vector13| case.predict(u).dip_rad - Parameters::new(u).inclination_rad;
        assert_row(&row, &case.unknowns, residual, "dip");
    }
}

#[test]
fn the_heading_s_row() {
    for case in cases(Case::random) {
        let here = case.predict(&case.unknowns);
        let residual = |u: &Vector13| wrap_pi(case.predict(u).heading_rad() - here.heading_rad());
        assert_row(&here.heading_row(&case.attitude.tilt()).dense(), &case.unknowns, residual, "heading");
    }
}

/// Direction, `towards_down` and `heading_by_field` are derivatives by the corrected field in body axes.
#[test]
fn total_dip_and_heading_by_the_field() {
    for case in cases(Case::random) {
        let tilt = case.attitude.tilt();
        let here = case.predict(&case.unknowns);
        let heading = here.heading_by_field(&tilt);
        for axis in 0..3 {
            let moved =
                |step| Prediction::new(case.x, &(here.direction * here.total + Vector3::ith(axis, step)), &tilt);
            assert_derivative(here.direction[axis], |step| moved(step).total, "total by field");
            assert_derivative(here.towards_down[axis], |step| moved(step).dip_rad, "dip by field");
            let turned = |step| wrap_pi(moved(step).heading_rad() - here.heading_rad());
            assert_derivative(heading[axis], turned, "heading by field");
        }
    }
}

/// A relative bank error of one is a roll error of the roll.
#[test]
fn the_dip_by_attitude() {
    for case in cases(Case::of_size_one) {
        let parameters = Parameters::new(&case.unknowns);
        let dip_rad = |attitude: Attitude| parameters.predict(case.x, &attitude.tilt()).dip_rad;
        let Attitude { roll_rad, pitch_rad } = case.attitude;
        let rolled = |step| dip_rad(Attitude { roll_rad: roll_rad + step, pitch_rad });
        let pitched = |step| dip_rad(Attitude { roll_rad, pitch_rad: pitch_rad + step });
        let scaled = |step: f32| dip_rad(Attitude { roll_rad: roll_rad * (1.0 + step), pitch_rad });
        let [by_roll, by_pitch] =
            parameters.predict(case.x, &case.attitude.tilt()).dip_by_attitude(&case.attitude.tilt());
        assert_derivative(by_roll, rolled, "dip by roll");
        assert_derivative(by_pitch, pitched, "dip by pitch");
        let equations = equations(&case, &case.unknowns, None, false);
        let [roll_bias, pitch_bias, bank_scale, latency] = equations.attitude_effects;
        assert_derivative(roll_bias, rolled, "dip by roll bias");
        assert_derivative(pitch_bias, pitched, "dip by pitch bias");
        assert_derivative(bank_scale, scaled, "dip by bank scale");
        let later = |step: f32| {
            let sample = Sample { rates: rates(), ..at(case.attitude) };
            dip_rad(sample.attitude_after(step))
        };
        assert_derivative(latency, later, "dip by latency");
    }
}

/// How fast attitudes change here: each derivative by it is of size one.
fn rates() -> Rates {
    Rates::from_rad_s([0.8, -0.6, 0.0])
}

/// A sample at an attitude, whatever it measured.
fn at(attitude: Attitude) -> Sample {
    Sample { field: Field::from_ut(0.0, 0.0, 0.0), attitude, rates: Rates::NONE, time: WrappingMillis::default() }
}

fn equations(case: &Case, unknowns: &Vector13, heading_rad: Option<f32>, refined: bool) -> Equations {
    let Attitude { roll_rad, .. } = case.attitude;
    let measured = Measured { x: case.x, tilt: case.attitude.tilt(), roll_rad, rates: rates(), heading_rad };
    // The sensor's noise skewed by another W, so that it is in norm and dip both.
    let noise = Noise::new(0.01, 0.02, Matrix3::new(1.2, 0.1, -0.2, 0.3, 0.9, 0.1, -0.1, 0.2, 1.1));
    Equations::new(&Parameters::new(unknowns), &measured, &noise, &Config::DEFAULT, refined)
}

/// The rows as they enter the problem, residuals made independent and measurements corrected: where the residuals are
/// nothing, neither adds to the derivative. The heading's residual is that of the corrected measurement, which moves
/// with the other two, so its row is looked at without the correction.
#[test]
fn the_equations_rows() {
    for case in cases(Case::of_size_one) {
        let mut parameters = Parameters::new(&case.unknowns);
        let here = case.predict(&case.unknowns);
        parameters.inclination_rad = here.dip_rad;
        let at = parameters.unknowns().unwrap();
        // A tenth of the step, so that no residual comes to Huber's limit, which bends the correction.
        let slightly = |u: &Vector13| at + (u - at) * 0.1;
        for refined in [false, true] {
            let of = |u: &Vector13| equations(&case, u, Some(here.heading_rad()), refined);
            let row = of(&at).norm.row.dense();
            assert_row(&row, &at, |u| of(&slightly(u)).norm.residual * 10.0, "equation of the norm");
            let row = of(&at).dip.unwrap().row.dense();
            assert_row(&row, &at, |u| of(&slightly(u)).dip.unwrap().residual * 10.0, "equation of the dip");
        }
        let of = |u: &Vector13| equations(&case, u, Some(here.heading_rad()), false).heading.unwrap();
        assert_row(&of(&at).row.dense(), &at, |u| of(u).residual, "equation of the heading");
    }
}

/// The slope is that of the dip's noise on the norm's: what is left of the dip is independent of the norm. From the
/// noise alone: both residuals' errors by the sensor's on each axis.
#[test]
fn norm_and_dip_are_made_independent_and_weighed_by_what_is_left() {
    let noise_w = Matrix3::new(1.2, 0.1, -0.2, 0.3, 0.9, 0.1, -0.1, 0.2, 1.1);
    for case in cases(Case::of_size_one) {
        let here = case.predict(&case.unknowns);
        let equations = equations(&case, &case.unknowns, None, false);
        let (norm_by_x, dip_by_x) = (noise_w.tr_mul(&here.direction), noise_w.tr_mul(&here.towards_down));
        let slope = norm_by_x.dot(&dip_by_x) / norm_by_x.norm_squared();
        let tilt_variance = 0.02_f32.powi(2) - 0.01_f32.powi(2);
        let [roll, pitch] = here.dip_by_attitude(&case.attitude.tilt());
        let left = (dip_by_x - norm_by_x * slope).norm_squared() * 0.01_f32.powi(2)
            + tilt_variance * (roll * roll + pitch * pitch);
        let dip = equations.dip.unwrap();
        let expected = here.dip_row().dense() - here.norm_row().dense() * slope;
        assert!((dip.row.dense() - expected).norm() < 1e-4 * expected.norm());
        let norm_variance = norm_by_x.norm_squared() * 0.01_f32.powi(2);
        assert!((equations.norm.weight * norm_variance - 1.0).abs() < 1e-4);
        // Far residuals are weighed down: Huber's part, tested with the equation.
        let sigma = left.sqrt();
        let huber = (Config::DEFAULT.huber * sigma / dip.residual.abs()).min(1.0);
        assert!((dip.weight * left / huber - 1.0).abs() < 1e-3, "{} {}", dip.weight * left, huber);
    }
}

/// A likelihood whose samples have a mean, and a unit that is not one.
fn likelihood(known_inclination_rad: Option<f32>) -> Likelihood {
    let prior = Prior { inclination_rad: known_inclination_rad, ..Prior::default() };
    let mut likelihood = Likelihood::new(&prior, Config::DEFAULT, Samples::default(), 40.0);
    likelihood.mean = Vector3::new(0.3, -0.8, 0.5);
    likelihood
}

fn priors(likelihood: &Likelihood, unknowns: &Vector13) -> Vec<(Quantity, Vector13, f32, f32)> {
    let mut priors = Vec::new();
    for_each_prior(likelihood, &Parameters::new(unknowns), &mut |p| priors.push((p.of, p.row, p.residual, p.sigma)));
    priors
}

#[test]
fn the_priors_rows() {
    for case in cases(Case::random) {
        for likelihood in [likelihood(None), likelihood(Some(0.9))] {
            for (i, (of, row, ..)) in priors(&likelihood, &case.unknowns).into_iter().enumerate() {
                assert_row(&row, &case.unknowns, |u| priors(&likelihood, u)[i].2, &format!("prior {i} of {of:?}"));
            }
        }
    }
}

/// What the priors are about, from what the words mean: a mounting turned by a small angle is of that size in the
/// mounting's priors and in no other's, a stretched axis in the soft iron's, hard iron in its own.
#[test]
fn a_prior_is_about_what_it_says() {
    let likelihood = likelihood(Some(0.9));
    let straight = Parameters { w: Matrix3::identity(), d: likelihood.mean, inclination_rad: 0.9 };
    let sizes = |parameters: &Parameters| {
        let mut sizes = [0.0_f32; Quantity::COUNT];
        for (of, _, residual, _) in priors(&likelihood, &parameters.unknowns().unwrap()) {
            sizes[of as usize] = sizes[of as usize].hypot(residual);
        }
        sizes
    };
    let close = |found: [f32; 4], expected: [f32; 4]| {
        let largest = found.iter().zip(expected).map(|(f, e)| (f - e).abs()).fold(0.0, f32::max);
        assert!(largest < 1e-4, "{found:?} {expected:?}");
    };
    // In the order of the quantities: soft iron, mounting, hard iron, inclination.
    close(sizes(&straight), [0.0; 4]);
    close(sizes(&Parameters { inclination_rad: 1.0, ..straight.clone() }), [0.0, 0.0, 0.0, 0.1]);
    let hard_iron = Vector3::new(0.1, 0.2, -0.2);
    close(sizes(&Parameters { d: straight.d - hard_iron, ..straight.clone() }), [0.0, 0.0, 0.3, 0.0]);
    // A change of W moves the hard iron too, unless d follows.
    let with = |w: Matrix3<f32>| Parameters { d: w * likelihood.mean, w, ..straight.clone() };
    close(sizes(&with(Matrix3::identity() * 1.3)), [0.0; 4]);
    let turn = Vector3::new(0.02, -0.01, 0.02);
    close(sizes(&with(Matrix3::identity() + turn.cross_matrix())), [0.0, 0.03, 0.0, 0.0]);
    let stretched = Matrix3::from_diagonal(&[1.1, 1.0, 0.9].into());
    close(sizes(&with(stretched)), [0.02_f32.sqrt(), 0.0, 0.0, 0.0]);
    let skewed = Matrix3::new(1.0, 0.1, 0.0, 0.1, 1.0, 0.2, 0.0, 0.2, 1.0);
    close(sizes(&with(skewed)), [0.05_f32.sqrt(), 0.0, 0.0, 0.0]);
}

/// Soft iron of 30 % and hard iron of three times the Earth's field (in the unit of field, here 40 uT) are bad
/// airframes, 0.35 rad is a mounting off by 20 deg; half a degree of it where it cannot be seen. A chart's inclination
/// is good to a degree; one that is not known is free.
#[test]
fn a_prior_is_as_sharp_as_its_reason() {
    let unknowns = Parameters { w: Matrix3::identity(), d: Vector3::zeros(), inclination_rad: 0.5 }.unknowns().unwrap();
    for (config, mounting) in [(Config::DEFAULT, 0.35), (Config::ALIGNED, 0.009), (Config::NO_ATTITUDE, 0.009)] {
        for known in [None, Some(0.9)] {
            let priors = priors(&Likelihood { config, ..likelihood(known) }, &unknowns);
            let of = |quantity| priors.iter().filter(move |(of, ..)| *of == quantity).map(|p| p.3).collect::<Vec<_>>();
            assert_eq!(of(Quantity::SoftIron), [0.3; 6]);
            assert_eq!(of(Quantity::Mounting), [mounting; 3]);
            assert_eq!(of(Quantity::HardIron), [3.75; 3]);
            let sigma_rad = of(Quantity::Inclination);
            assert!(if known.is_some() { sigma_rad == [0.0175] } else { sigma_rad[0] > 3.0 }, "{sigma_rad:?}");
        }
    }
}

/// The field that is expected is the one that predicts itself.
#[test]
fn an_expected_field_has_no_residuals() {
    let mut random = Random(82);
    for case in cases(Case::of_size_one) {
        let parameters = Parameters::new(&case.unknowns);
        let heading_rad = random.uniform(-3.0, 3.0);
        let tilt = case.attitude.tilt();
        let x = parameters.expected_field(&tilt, heading_rad).unwrap();
        let prediction = parameters.predict(x, &tilt);
        let level = Field::<Level>::earth(1.0, parameters.inclination_rad, heading_rad).ut;
        assert!((prediction.total - 1.0).abs() < 1e-5 && (prediction.level - level).norm() < 1e-5);
        assert!((prediction.dip_rad - parameters.inclination_rad).abs() < 1e-5);
        assert!(wrap_pi(prediction.heading_rad() - heading_rad).abs() < 1e-5);
    }
}

/// Unknowns to parameters and back; what is not finite is none.
#[test]
fn parameters_are_their_unknowns() {
    let unknowns = Vector13::from_fn(|i, _| i as f32 + 1.0);
    assert_eq!(Parameters::new(&unknowns).unknowns(), Some(unknowns));
    for i in 0..UNKNOWNS {
        let mut bad = unknowns;
        bad[i] = f32::NAN;
        assert_eq!(Parameters::new(&bad).unknowns(), None);
    }
}

/// A field of nearly nothing, or straight down: numbers, if useless ones.
#[test]
fn a_field_without_heading_has_finite_equations() {
    let straight = Parameters { w: Matrix3::identity(), d: Vector3::zeros(), inclination_rad: 1.0 };
    for x in [Vector3::new(1e-9, 0.0, 0.0), Vector3::new(0.0, 0.0, 1.0)] {
        let case = Case { unknowns: straight.unknowns().unwrap(), attitude: Attitude::default(), x };
        let equations = equations(&case, &case.unknowns, Some(0.0), true);
        for equation in [Some(equations.norm), equations.dip, equations.heading].into_iter().flatten() {
            assert!(equation.row.dense().iter().all(|r| r.is_finite()) && equation.residual.is_finite());
            assert!(equation.weight > 0.0 && equation.weight.is_finite());
        }
    }
}
