//! The model: what it takes from samples, how it learns its noise, and what it makes of its unknowns.

use nalgebra::{Matrix3, Vector3};

use super::NO_PRIOR;
use super::synthetic::{Airframe, Flight, Random};
use crate::calibration::likelihood::{Config, Likelihood, Noise, Parameters, Prior, System, Vector13};
use crate::calibration::response::Start;
use crate::calibration::{Mark, Orientation, Rates, Sample, Samples, SolveError};
use crate::frames::{Attitude, Field};
use crate::time::WrappingMillis;

fn sample(ut: [f32; 3]) -> Sample {
    Sample {
        field: Field::new(ut.into()),
        attitude: Attitude::default(),
        time: WrappingMillis::default(),
        rates: Rates::NONE,
    }
}

fn straight() -> Vector13 {
    Parameters { w: Matrix3::identity(), d: Vector3::zeros(), inclination_rad: 0.0 }.unknowns().unwrap()
}

/// A likelihood after so many samples with these mean squares of residuals over sigma, which was 1 % and 0.02.
fn reweighted(samples: u16, mean_squares: [f32; 2]) -> Noise {
    let mut likelihood = Likelihood::new(&NO_PRIOR, Config::DEFAULT, Samples::default(), 50.0);
    likelihood.noise = Noise::new(0.01, 0.02, Matrix3::identity());
    let mut system = System::of_priors(&likelihood, &straight());
    system.samples = samples;
    system.clipped_squares = mean_squares.map(|square| square * f32::from(samples));
    likelihood.reweight(&system, &straight());
    likelihood.noise
}

/// The sum of squares of a fit with thirteen unknowns is that of the samples less thirteen, half of them for each kind
/// of residual; four samples of a usual sensor (0.4 %) and attitude source (0.34 deg) are counted with it; a clipped
/// normal variable has a mean square of 0.9205.
#[test]
fn the_noise_is_that_of_the_residuals() {
    for (samples, freedom) in [(256, 249.5), (100, 93.5), (12, 5.5), (8, 1.5), (7, 1.0), (2, 1.0)] {
        let noise = reweighted(samples, [0.9205, 0.9205 * 4.0]);
        let number = f32::from(samples);
        let norm = ((number * 0.01_f32.powi(2) + 4.0 * 0.004_f32.powi(2)) / (freedom + 4.0)).sqrt();
        let dip_rad = ((number * 0.04_f32.powi(2) + 4.0 * 0.006_f32.powi(2)) / (freedom + 4.0)).sqrt();
        assert!((noise.norm / norm - 1.0).abs() < 1e-3, "{samples}: {} {norm}", noise.norm);
        assert!((noise.dip_rad / dip_rad - 1.0).abs() < 1e-3, "{samples}: {} {dip_rad}", noise.dip_rad);
    }
}

/// A dozen samples that fit by chance are not believed to be perfect, nor are a thousand: quantisation and the chip's
/// linearity leave 0.05 % and 0.05 deg.
#[test]
fn nothing_is_perfect() {
    let few = reweighted(12, [0.0; 2]);
    assert!((few.norm - (4.0 * 0.004_f32.powi(2) / 9.5).sqrt()).abs() < 1e-6, "{}", few.norm);
    assert!((few.dip_rad - (4.0 * 0.006_f32.powi(2) / 9.5).sqrt()).abs() < 1e-6, "{}", few.dip_rad);
    let many = reweighted(1000, [0.0; 2]);
    assert!((many.norm - 0.0005).abs() < 1e-9 && (many.dip_rad - 0.0009).abs() < 1e-9, "{many:?}");
}

/// 5 % of the field and 5 deg of dip are ten times a poor sensor and attitude source.
#[test]
fn what_scatters_too_much_is_not_explained() {
    let mut likelihood = Likelihood::new(&NO_PRIOR, Config::DEFAULT, Samples::default(), 50.0);
    for (norm, dip_rad, explains) in [(0.049, 0.086, true), (0.051, 0.01, false), (0.01, 0.088, false)] {
        likelihood.noise = Noise::new(norm, dip_rad, Matrix3::identity());
        assert_eq!(likelihood.explains(), explains, "{norm} {dip_rad}");
    }
}

/// A bad start is left with a part of many samples, and the first round of weights does with half of very many; from
/// the second on, all count. Marks are few and always used.
#[test]
fn many_samples_are_looked_at_in_part_until_the_noise_is_known() {
    let turn: Vec<Sample> = (0..512_u16).map(|i| sample([f32::from(i % 40), 20.0, 30.0])).collect();
    let mark = Mark { sample: turn[0], heading_rad: 0.0 };
    for (samples, at_first) in [(512, 128), (384, 128), (383, 192), (256, 128), (255, 255), (12, 12)] {
        for marks in [&[][..], &[mark]] {
            let part = Samples { left: &turn[..samples], marks, ..Samples::default() };
            let mut likelihood = Likelihood::new(&NO_PRIOR, Config::DEFAULT, part, 50.0);
            // A mark counts as a sample when samples are counted.
            let at_first = if samples + marks.len() == 384 { 128 } else { at_first };
            let system = likelihood.linearise(part, &straight());
            if (samples + marks.len()) % 128 != 0 || marks.is_empty() {
                assert_eq!(usize::from(system.samples), at_first + marks.len(), "{samples}");
            }
            assert!(!likelihood.refined);
            likelihood.reweight(&system, &straight());
            assert!(likelihood.refined);
            let then = if samples == 512 { 256 } else { samples };
            let system = likelihood.linearise(part, &straight());
            assert_eq!(usize::from(system.samples), then + marks.len(), "{samples}");
            likelihood.reweight(&system, &straight());
            assert_eq!(usize::from(likelihood.linearise(part, &straight()).samples), samples + marks.len());
        }
    }
}

/// The mean of all samples, marks included, in mount axes and the unit of field; and it is what samples are less by:
/// the residual of a sample is that of `W (m - mean) + d`.
#[test]
fn samples_are_less_their_mean() {
    let mount = Orientation::from_name("yaw90").unwrap();
    let (left, right) = ([sample([10.0, 0.0, 5.0])], [sample([30.0, -8.0, 5.0])]);
    let marks = [Mark { sample: sample([20.0, 20.0, 35.0]), heading_rad: 0.0 }];
    let samples = Samples { left: &left, right: &right, marks: &marks, ..Samples::default() };
    let prior = Prior { mount, ..NO_PRIOR };
    let likelihood = Likelihood::new(&prior, Config::DEFAULT, samples, 10.0);
    // Yaw by 90 deg: the chip's x is the aircraft's y, its y the other way along x.
    let mean = Vector3::new(-0.4, 2.0, 1.5);
    assert!((likelihood.mean - mean).norm() < 1e-6, "{}", likelihood.mean);
    let mut norms = Vec::new();
    let parameters = Parameters { w: Matrix3::identity(), d: Vector3::new(0.0, 0.0, 2.0), inclination_rad: 0.0 };
    likelihood.for_each_sample(samples, &parameters, &mut |equations| norms.push(equations.norm.residual));
    for (norm, field) in norms.iter().zip([[0.0, 1.0, 0.5], [0.8, 3.0, 0.5], [-2.0, 2.0, 3.5]]) {
        let expected = (Vector3::from(field) - mean + parameters.d).norm() - 1.0;
        assert!((norm - expected).abs() < 1e-5, "{norm} {expected}");
    }
    assert_eq!(norms.len(), 3);
    assert_eq!(Likelihood::new(&prior, Config::DEFAULT, Samples::default(), 10.0).mean, Vector3::zeros());
}

/// Hard iron of sixty times the Earth's field leaves a calibration as exact as none: its digits are taken out with the
/// mean. Of f32's seven digits sixty times the field takes two; 0.1 deg is left in the worst of twenty airframes.
#[test]
fn huge_hard_iron_costs_no_digits() {
    for seed in 0..20 {
        let mut random = Random(6000 + seed);
        let airframe = Airframe::random(&mut random, 0.2, 0.0, 5.0, [-60.0, 60.0]);
        let airframe = Airframe { b_ut: Vector3::new(2000.0, -2000.0, 1000.0), ..airframe };
        let recorded = Flight { wander_deg: 2.0, ..Flight::PERFECT }.fly(&airframe, &mut random);
        let mut likelihood = Likelihood::new(&NO_PRIOR, Config::DEFAULT, recorded.turns(), airframe.total_ut);
        likelihood.config.hard_iron_sigma_ut = 1e5;
        let start = airframe.exact_start();
        let unknowns = likelihood.unknowns(&start).unwrap();
        let mut worst = 0.0_f32;
        likelihood.for_each_sample(recorded.turns(), &Parameters::new(&unknowns), &mut |equations| {
            worst = worst.max(equations.norm.residual.abs()).max(equations.dip.as_ref().unwrap().residual.abs());
        });
        assert!(worst < 1e-4, "seed {seed}: {worst}");
        let calibration = likelihood.calibration(&unknowns).unwrap();
        let error = super::largest(&airframe.errors_deg(&calibration));
        assert!(error < 0.1, "seed {seed}: {error}");
    }
}

/// The calibration does to a field in microtesla and chip axes what the unknowns do to it in theirs, up to the scale,
/// which it has as the total field.
#[test]
fn a_calibration_is_its_unknowns() {
    let mount = Orientation::from_name("roll90-yaw90").unwrap();
    let field = sample([12.0, -31.0, 28.0]);
    let samples = [field, sample([5.0, 3.0, -20.0]), sample([-30.0, 9.0, 2.0])];
    let samples = Samples { left: &samples, ..Samples::default() };
    let likelihood = Likelihood::new(&Prior { mount, ..NO_PRIOR }, Config::DEFAULT, samples, 40.0);
    let parameters = Parameters {
        w: Matrix3::new(1.2, 0.1, -0.2, 0.3, 0.9, 0.1, -0.1, 0.2, 1.1),
        d: Vector3::new(0.2, -0.4, 0.6),
        inclination_rad: 0.7,
    };
    let calibration = likelihood.calibration(&parameters.unknowns().unwrap()).unwrap();
    assert!((calibration.w_matrix().determinant() - 1.0).abs() < 1e-5);
    assert!((calibration.inclination_rad - 0.7).abs() < 1e-6);
    let x = mount.body_from_sensor() * field.field.ut / 40.0 - likelihood.mean;
    let expected = parameters.w * x + parameters.d;
    let found = calibration.apply(field.field).ut / calibration.total_ut;
    assert!((found - expected).norm() < 1e-5, "{found} {expected}");
    // b is where the corrected field is nothing.
    let nothing = calibration.apply(Field::new(calibration.b_vector_ut())).ut;
    let x = mount.body_from_sensor() * calibration.b_vector_ut() / 40.0 - likelihood.mean;
    assert!(nothing.norm() < 1e-4 && (parameters.w * x + parameters.d).norm() < 1e-5);
}

/// A chip's axes are right-handed, and no calibration flattens the field.
#[test]
fn what_mirrors_or_flattens_is_no_calibration() {
    let likelihood = Likelihood::new(&NO_PRIOR, Config::DEFAULT, Samples::default(), 40.0);
    for diagonal in [[1.0, 1.0, -1.0], [1.0, 1.0, 0.0], [1.0, f32::NAN, 1.0]] {
        let mut unknowns = straight();
        for (i, value) in diagonal.into_iter().enumerate() {
            unknowns[crate::calibration::likelihood::unknowns::w(i, i)] = value;
        }
        assert_eq!(likelihood.calibration(&unknowns), Err(SolveError::NotConverged));
    }
}

/// A start in its own unit is the unknowns that predict what it does.
#[test]
fn a_start_is_its_unknowns() {
    let samples = [sample([12.0, -31.0, 28.0]), sample([5.0, 3.0, -20.0])];
    let samples = Samples { left: &samples, ..Samples::default() };
    let likelihood = Likelihood::new(&NO_PRIOR, Config::DEFAULT, samples, 40.0);
    let w = Matrix3::new(1.2, 0.1, -0.2, 0.3, 0.9, 0.1, -0.1, 0.2, 1.1);
    let start = Start { unit_ut: 40.0, w, b: Vector3::new(0.1, 0.2, -0.3), inclination_rad: 0.4 };
    let parameters = Parameters::new(&likelihood.unknowns(&start).unwrap());
    assert!((parameters.d - w * (likelihood.mean - start.b)).norm() < 1e-6 && parameters.w == w);
    assert!((parameters.mean_from_b().unwrap() - (likelihood.mean - start.b)).norm() < 1e-5);
    assert!((parameters.inclination_rad - 0.4).abs() < 1e-6);
    assert!(likelihood.unknowns(&Start { b: Vector3::from_element(f32::NAN), ..start }).is_none());
}

/// The cost is the loss of every equation of every sample, and of the priors half the square over sigma; the scatter is
/// summed of norms and dips apart.
#[test]
fn the_cost_is_of_every_equation() {
    let mut random = Random(61);
    let airframe = Airframe::random(&mut random, 0.2, 1.0, 5.0, [-60.0, 60.0]);
    let recorded = Flight::REAL.fly(&airframe, &mut random);
    let marks =
        [Mark { sample: recorded.left[3], heading_rad: 1.0 }, Mark { sample: recorded.left[9], heading_rad: 2.0 }];
    let samples = Samples { left: &recorded.left[..40], marks: &marks, ..Samples::default() };
    for config in [Config::DEFAULT, Config::NO_ATTITUDE] {
        let likelihood = Likelihood::new(&NO_PRIOR, config, samples, airframe.total_ut);
        let unknowns = Parameters { d: likelihood.mean, ..Parameters::new(&straight()) }.unknowns().unwrap();
        let system = likelihood.linearise(samples, &unknowns);
        let mut cost = System::of_priors(&likelihood, &unknowns).cost;
        let mut clipped = [0.0, 0.0];
        likelihood.for_each_sample(samples, &Parameters::new(&unknowns), &mut |equations| {
            cost += equations.norm.loss;
            cost += equations.dip.as_ref().map_or(0.0, |dip| dip.loss);
            cost += equations.heading.as_ref().map_or(0.0, |heading| heading.loss);
            clipped[0] += equations.norm.clipped_square;
            clipped[1] += equations.dip.as_ref().map_or(0.0, |dip| dip.clipped_square);
        });
        assert!((system.cost / cost - 1.0).abs() < 1e-4, "{} {cost}", system.cost);
        assert!((system.clipped_squares[0] / clipped[0] - 1.0).abs() < 1e-4);
        assert!((system.clipped_squares[1] - clipped[1]).abs() <= 1e-4 * clipped[1]);
        assert_eq!(system.samples, 42);
    }
}

/// An inclination alone off its known value by two sigmas costs two, and damping shortens the way back: all of it, a
/// half, a quarter.
#[test]
fn damping_shortens_a_step() {
    let samples = [sample([50.0, 0.0, 0.0])];
    let samples = Samples { left: &samples, ..Samples::default() };
    let prior = Prior { inclination_rad: Some(0.3), ..NO_PRIOR };
    let likelihood = Likelihood::new(&prior, Config::NO_ATTITUDE, samples, 50.0);
    let parameters = Parameters { w: Matrix3::identity(), d: Vector3::x(), inclination_rad: 0.3 + 0.035 };
    let system = likelihood.linearise(samples, &parameters.unknowns().unwrap());
    assert!((system.cost - 2.0).abs() < 1e-3, "{}", system.cost);
    for (damping, share) in [(0.0, 1.0), (1.0, 0.5), (3.0, 0.25)] {
        let (change, promised) = system.step(damping).unwrap();
        let inclination_rad = change[crate::calibration::likelihood::unknowns::INCLINATION];
        assert!((inclination_rad / (-0.035 * share) - 1.0).abs() < 1e-3, "{damping}: {inclination_rad}");
        // Promised is half of change times gradient, which is all of the cost for the whole way.
        assert!((promised / (2.0 * share) - 1.0).abs() < 1e-3, "{damping}: {promised}");
    }
    assert!((system.change().unwrap() - system.step(0.0).unwrap().0).norm() < 1e-6);
}
