//! Iron that goes with the current: found, used where it is known, and what it means for everything else.

use nalgebra::{Matrix3, SVector, Vector3};

use super::synthetic::{Airframe, Flight, Random, Recorded, mean, rms, vector};
use super::{NO_PRIOR, solved};
use crate::calibration::current_iron::Found;
use crate::calibration::information::Information;
use crate::calibration::likelihood::{Config, Likelihood, Noise, Parameters, for_each_prior};
use crate::calibration::{
    Calibration, CurrentIron, LeastSquares, Method, Orientation, Prior, Sample, Solution, solve, verification,
};
use crate::frames::Field;

/// How the current goes on a flight, amperes, by seconds and by which turn it is.
#[derive(Clone, Copy, Debug)]
enum Currents {
    /// Bursts of 30 A on 10 A, of 3 s, every 9 s.
    Bursts,
    /// 20 A, give or take a tenth.
    Steady,
    /// 10 A in the left turn, 30 A in the right.
    BySide,
}

impl Currents {
    fn at(self, t_s: f32, is_right: bool, random: &mut Random) -> f32 {
        match self {
            Self::Bursts => (if t_s % 9.0 < 3.0 { 40.0 } else { 10.0 }) + random.normal(),
            Self::Steady => 20.0 + 0.1 * random.normal(),
            Self::BySide => (if is_right { 30.0 } else { 10.0 }) + 0.1 * random.normal(),
        }
    }
}

/// Two turns with iron of `k`, microtesla per ampere in chip axes.
fn fly(airframe: &Airframe, k: Vector3<f32>, currents: Currents, random: &mut Random) -> Recorded {
    let mut recorded = Flight::REAL.fly(airframe, random);
    for (is_right, side) in [(false, &mut recorded.left), (true, &mut recorded.right)] {
        for (i, sample) in side.iter_mut().enumerate() {
            let current_a = currents.at(i as f32 * 0.4, is_right, random);
            sample.field.ut += k * current_a;
            sample.rates = sample.rates.with_current(Some(current_a));
        }
    }
    recorded
}

/// Of many flights.
#[derive(Default)]
struct Shown {
    used: usize,
    /// Errors of `k` on each axis over its sigma, where it was used.
    errors: Vec<f32>,
    /// RMS heading error at the mean current.
    errors_deg: Vec<f32>,
    expected_deg: Vec<f32>,
}

/// Heading errors of a solution, degrees, at its mean current and a spread to either side.
fn errors_deg(airframe: &Airframe, k: Vector3<f32>, solution: &Solution) -> Vec<f32> {
    let CurrentIron { mean_a, spread_a, .. } = solution.calibration.current;
    let at = |current_a: f32| {
        // The field of a current, less what the calibration takes it to add, is that of another hard iron.
        let added = k * current_a - solution.calibration.current.ut(Some(current_a));
        Airframe { b_ut: airframe.b_ut + added, ..*airframe }.errors_deg(&solution.calibration)
    };
    [mean_a - spread_a, mean_a + spread_a].map(at).concat()
}

fn flown(size_ut_per_a: f32, currents: Currents) -> Shown {
    let mut shown = Shown::default();
    for seed in 0..40 {
        let mut random = Random(4000 + seed);
        let airframe = Airframe::random(&mut random, 0.1, 1.0, 5.0, [-65.0, 65.0]);
        let k = vector(&mut random, 1.0).normalize() * size_ut_per_a;
        let solution = solved(&fly(&airframe, k, currents, &mut random)).unwrap();
        let iron = solution.calibration.current;
        if iron.is_used() {
            shown.used += 1;
            let off = Vector3::from(iron.ut_per_a) - k;
            shown.errors.extend(off.iter().map(|axis| axis / iron.sigma_ut_per_a));
        }
        shown.errors_deg.push(rms(&errors_deg(&airframe, k, &solution)));
        shown.expected_deg.push(solution.quality.expected_rms_deg);
    }
    shown
}

impl Shown {
    fn ratio(&self) -> f32 {
        rms(&self
            .errors_deg
            .iter()
            .zip(&self.expected_deg)
            .map(|(error, expected)| error / expected)
            .collect::<Vec<_>>())
    }
}

/// 0.4 uT per ampere in bursts of 30 A, 12 uT, are found with their sigma, which is of the least known axis, and always
/// used; headings are then as good as expected, and that is good.
#[test]
fn iron_that_goes_with_the_current_is_found_and_used() {
    let shown = flown(0.4, Currents::Bursts);
    assert_eq!(shown.used, 40);
    assert!((0.5..1.1).contains(&rms(&shown.errors)), "{}", rms(&shown.errors));
    assert!((0.6..1.05).contains(&shown.ratio()), "{}", shown.ratio());
    assert!(mean(&shown.expected_deg) < 0.35 && mean(&shown.errors_deg) < 0.3, "{:?}", shown.errors_deg);
}

/// Where there is none, it is not used, and what it could be hardly widens what is expected.
#[test]
fn what_is_chance_is_not_used() {
    let shown = flown(0.0, Currents::Bursts);
    assert_eq!(shown.used, 0);
    assert!((0.6..1.05).contains(&shown.ratio()), "{}", shown.ratio());
    assert!(mean(&shown.expected_deg) < 0.35, "{:?}", shown.expected_deg);
}

/// A current that hardly changes shows nothing of it, and does nothing: what the mean adds is hard iron.
#[test]
fn a_steady_current_is_hard_iron() {
    let shown = flown(0.4, Currents::Steady);
    assert_eq!(shown.used, 0);
    assert!((0.6..1.05).contains(&shown.ratio()), "{}", shown.ratio());
    assert!(mean(&shown.expected_deg) < 0.35, "{:?}", shown.expected_deg);
}

/// A current that goes with the turn could be taken for other iron in each of them, but not in both: it is found, and what is
/// expected is somewhat more, as it should be.
#[test]
fn a_current_that_goes_with_the_turn_is_found() {
    let shown = flown(0.4, Currents::BySide);
    assert_eq!(shown.used, 40);
    assert!((0.6..1.05).contains(&shown.ratio()), "{}", shown.ratio());
    assert!(mean(&shown.expected_deg) < 0.4, "{:?}", shown.expected_deg);
}

fn one(seed: u64) -> (Airframe, Vector3<f32>, Recorded) {
    let mut random = Random(seed);
    let airframe = Airframe::random(&mut random, 0.1, 1.0, 5.0, [50.0, 60.0]);
    let k = Vector3::new(0.25, -0.3, 0.15);
    let recorded = fly(&airframe, k, Currents::Bursts, &mut random);
    (airframe, k, recorded)
}

/// Without a current, or with one that most samples do not know, all is as it was before there was any.
#[test]
fn without_a_current_nothing_is_known_of_it() {
    let mut random = Random(1);
    let airframe = Airframe::random(&mut random, 0.1, 1.0, 5.0, [50.0, 60.0]);
    // So much that all is accepted without it.
    let recorded = fly(&airframe, Vector3::new(0.05, -0.06, 0.03), Currents::Bursts, &mut random);
    let strip = |samples: &[Sample], every: usize| -> Vec<Sample> {
        let rates = |i: usize, s: &Sample| if i.is_multiple_of(every) { s.rates.with_current(None) } else { s.rates };
        samples.iter().enumerate().map(|(i, s)| Sample { rates: rates(i, s), ..*s }).collect()
    };
    let of = |every: usize| Recorded { left: strip(&recorded.left, every), right: strip(&recorded.right, every) };
    let [none, few, many] = [1, 3, 5].map(|every| solved(&of(every)).unwrap());
    assert_eq!((none.calibration.current, few.calibration.current), (CurrentIron::NONE, CurrentIron::NONE));
    assert_eq!(none.calibration, few.calibration);
    // One of five that does not know it counts as of the mean.
    assert!(many.calibration.current.is_used());
    let with = solved(&recorded).unwrap();
    assert!(with.quality.norm_residual < 0.5 * none.quality.norm_residual, "{with:?} {none:?}");
}

/// Who verifies looks at samples with what each calibration takes their currents to have added.
#[test]
fn held_back_samples_are_seen_without_what_their_current_added() {
    let (_, _, recorded) = one(2);
    let calibration = solved(&recorded).unwrap().calibration;
    let unused = Calibration { current: CurrentIron::NONE, ..calibration };
    let scores = verification::verify(recorded.turns(), true, &calibration, &unused);
    assert!(scores.candidate < 0.2 * scores.incumbent, "{scores:?}");
}

/// What is corrected for a current is the field where none flows, of an unknown one that of the mean; and a heading is less
/// sure at currents that were not flown, by what is not known of `k`, and where the current is not known, by all of it.
#[test]
fn a_heading_at_another_current_is_less_sure() {
    let current = CurrentIron { ut_per_a: [0.3, 0.0, 0.4], sigma_ut_per_a: 0.02, mean_a: 20.0, spread_a: 10.0 };
    let calibration = Calibration {
        inclination_rad: 60_f32.to_radians(),
        total_ut: 50.0,
        current,
        ..Calibration::uncalibrated(NO_PRIOR.mount)
    };
    let field = Field::from_ut(10.0, 5.0, 40.0);
    for (current_a, added) in [(Some(10.0), 10.0), (Some(0.0), 0.0), (None, 20.0)] {
        let expected = field.ut - Vector3::new(0.3, 0.0, 0.4) * added;
        assert!((calibration.without_current(field, current_a).ut - expected).norm() < 1e-5);
    }
    for (current_a, sigma_ut) in [
        (Some(20.0), 0.0),
        (Some(10.0), 0.0),
        (Some(30.0), 0.0),
        (Some(50.0), 0.02 * f32::sqrt(900.0 - 100.0)),
        (Some(0.0), 0.02 * f32::sqrt(400.0 - 100.0)),
        (None, 0.5 * 10.0),
    ] {
        let sigma_rad = calibration.current_variance_rad2(current_a).sqrt();
        assert!((sigma_rad - sigma_ut / 25.0).abs() < 1e-5, "{current_a:?}: {sigma_rad}");
    }
    // Nor is a sum of nothing and infinity a number.
    assert_eq!(Calibration::uncalibrated(NO_PRIOR.mount).current_variance_rad2(None).to_bits(), 0);
}

/// Eliminated, it is what least squares of all sixteen unknowns at once make of it, prior included; and the others follow as
/// they do there. What is left unknown of it is that of the sixteen, too, for errors that are not alike.
#[test]
fn it_is_what_sixteen_unknowns_would_make_of_it() {
    let (airframe, k, recorded) = one(3);
    let samples = recorded.turns();
    let mut likelihood = Likelihood::new(&NO_PRIOR, Config::DEFAULT, samples, airframe.total_ut);
    likelihood.noise = Noise::new(0.01, 0.02, Matrix3::identity());
    (likelihood.stride, likelihood.sums_up) = (1, false);
    for used in [0.0, 0.9] {
        likelihood.current.ut_per_a = (k * used).into();
        let unknowns = likelihood.unknowns(&airframe.exact_start()).unwrap();
        let parameters = Parameters::new(&unknowns);
        let mut joint = LeastSquares::<16, 1>::new();
        let extended = |row: &SVector<f32, 13>, more: Vector3<f32>| row.push(more.x).push(more.y).push(more.z);
        for_each_prior(&likelihood, &parameters, &mut |prior| {
            joint.add(&extended(&prior.row, Vector3::zeros()), [-prior.residual], 1.0 / (prior.sigma * prior.sigma));
        });
        for axis in 0..3 {
            let row = SVector::<f32, 16>::ith(13 + axis, 1.0);
            joint.add(&row, [-likelihood.k()[axis]], Found::prior(likelihood.unit_ut));
        }
        for sample in samples.iter() {
            let equations = likelihood.equations(sample, None, &parameters);
            let share_a = sample.rates.current_a().unwrap() - likelihood.current.mean_a;
            for equation in equations.all() {
                let more = -parameters.w.tr_mul(&equation.row.by_field) * share_a;
                joint.add(&extended(&equation.row.dense(), more), [-equation.residual], equation.weight);
            }
        }
        let expected = joint.solve().unwrap();
        let mut information = Information::new(&likelihood.linearise(samples, &unknowns));
        information.look(&likelihood, samples, &unknowns, None);
        let found = information.current(&likelihood).unwrap();
        let step = found.k - likelihood.k();
        let of_k = expected.fixed_rows::<3>(13).into_owned();
        assert!((step - of_k).norm() < 0.01 * found.sigma(), "{step} {of_k}");
        let follow = information.following(&step).unwrap();
        let change = information.system.change().unwrap() + follow;
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

/// What is found is tried once it matters, kept while it is known and certain, sought again until it stays, and left when it
/// is not known well enough after all.
#[test]
fn it_is_used_while_it_is_known_and_matters() {
    let zero = Vector3::zeros();
    let found = |x: f32, sigma: f32, significance| Found {
        k: Vector3::new(x, 0.0, 0.0),
        covariance: Matrix3::from_diagonal(&Vector3::new(0.5, 1.0, 0.2)) * (sigma * sigma),
        significance,
    };
    let k = |x: f32| Some(Vector3::new(x, 0.0, 0.0));
    // Not in use.
    assert_eq!(found(0.01, 1e-4, [31.0, 1.0]).next(&zero, 0, 500.0), k(0.01));
    assert_eq!(found(0.01, 1e-4, [29.0, 29.0]).next(&zero, 0, 500.0), None);
    assert_eq!(found(0.01, 1e-4, [31.0, 31.0]).next(&zero, 1, 500.0), None, "it was left before");
    // In use: half a microtesla at the current's spread.
    let used = Vector3::new(0.01, 0.0, 0.0);
    assert_eq!(found(0.01, 0.99e-3, [99.0, 16.4]).next(&used, 2, 500.0), None);
    assert_eq!(found(0.01, 1.01e-3, [99.0, 16.4]).next(&used, 2, 500.0), Some(zero));
    assert_eq!(found(0.01, 0.99e-3, [99.0, 16.2]).next(&used, 2, 500.0), Some(zero));
    assert_eq!(found(0.02, 0.99e-3, [99.0, 16.2]).next(&used, 1, 500.0), k(0.02), "it may be known better yet");
    // Until it stays, or four times.
    assert_eq!(found(0.0102, 0.5e-3, [99.0, 99.0]).next(&used, 2, 500.0), k(0.0102));
    assert_eq!(found(0.0101, 0.5e-3, [99.0, 99.0]).next(&used, 2, 500.0), None);
    assert_eq!(found(0.02, 0.5e-3, [99.0, 99.0]).next(&used, 3, 500.0), k(0.02));
    assert_eq!(found(0.02, 0.5e-3, [99.0, 99.0]).next(&used, 4, 500.0), None);
}

/// The squares of the roots are the covariance, and what was found but is not used is one more.
#[test]
fn roots_are_those_of_the_covariance() {
    let a = Matrix3::new(1.0, 0.2, -0.3, 0.0, 0.7, 0.1, 0.5, 0.0, 0.4);
    let found = Found { k: Vector3::new(1.0, 2.0, 3.0), covariance: a * a.transpose(), significance: [17.0; 2] };
    let used = Vector3::new(0.5, 2.0, 3.0);
    let roots = found.roots(&used);
    let sum: Matrix3<f32> = roots.iter().take(3).map(|root| root * root.transpose()).sum();
    assert!((sum - found.covariance).norm() < 1e-5, "{sum}");
    assert_eq!(roots[3], Vector3::new(0.5, 0.0, 0.0));
    let by_chance = Found { significance: [99.0, 16.0], ..found.clone() };
    assert_eq!(by_chance.roots(&used)[3], Vector3::zeros());
    let nothing = Found { covariance: Matrix3::zeros(), ..found }.roots(&used);
    assert!(nothing.iter().take(3).all(|root| *root == Vector3::zeros()));
}

/// However the chip sits it is the same iron, in the chip's axes, and known as well: rounding alone makes it another, a tenth
/// of its sigma at the most.
#[test]
fn it_is_told_in_the_axes_of_the_chip() {
    let (_, _, recorded) = one(5);
    let straight = solved(&recorded).unwrap().calibration.current;
    let mount = Orientation::from_name("roll90-yaw90").unwrap();
    let rotation = mount.body_from_sensor();
    let turned = |samples: &[Sample]| -> Vec<Sample> {
        samples.iter().map(|s| Sample { field: Field::new(rotation.tr_mul(&s.field.ut)), ..*s }).collect()
    };
    let turned = Recorded { left: turned(&recorded.left), right: turned(&recorded.right) };
    let solution = solve(Method::MaximumLikelihood, turned.turns(), &Prior { mount, ..NO_PRIOR }).unwrap();
    let current = solution.calibration.current;
    let off = rotation * Vector3::from(current.ut_per_a) - Vector3::from(straight.ut_per_a);
    assert!(straight.is_used() && off.norm() < 0.1 * straight.sigma_ut_per_a, "{current:?} {straight:?}");
    assert!((current.sigma_ut_per_a / straight.sigma_ut_per_a - 1.0).abs() < 0.02, "{current:?} {straight:?}");
}

/// Mean and spread of the currents that are known, if three quarters are.
#[test]
fn currents_are_those_of_the_samples() {
    let (_, _, mut recorded) = one(4);
    let all: Vec<f32> = recorded.turns().all().filter_map(|s| s.rates.current_a()).collect();
    let iron = CurrentIron::of(recorded.turns());
    assert!((iron.mean_a - mean(&all)).abs() < 1e-3);
    let rest: Vec<f32> = all.iter().map(|a| a - mean(&all)).collect();
    assert!((iron.spread_a - rms(&rest)).abs() < 1e-3 && !iron.is_used());
    let number = recorded.left.len() + recorded.right.len();
    for (unknown, is_known) in [(number / 4, true), (number / 4 + 1, false), (number, false)] {
        for sample in recorded.left.iter_mut().chain(&mut recorded.right).take(unknown) {
            sample.rates = sample.rates.with_current(None);
        }
        assert_eq!(CurrentIron::of(recorded.turns()) != CurrentIron::NONE, is_known, "{unknown}");
    }
    assert_eq!(CurrentIron::of(crate::calibration::Samples::default()), CurrentIron::NONE);
}
