//! Unit tests of `d_optimal_selection`.

use core::f32::consts::TAU;

use nalgebra::Matrix3;
use testkit::random::Random;

use super::super::test_samples::test_sample;
use super::*;
use crate::frames::{Attitude, Field, Level};

fn sample_at(heading_rad: f32, roll_deg: f32, pitch_deg: f32, soft_iron: &Matrix3<f32>) -> Sample {
    let attitude = Attitude::from_deg(roll_deg, pitch_deg);
    let body = attitude.to_body_frame(Field::<Level>::earth_field(50.0, 1.1, heading_rad)).ut;
    let field = soft_iron * body + Vector3::new(60.0, -45.0, 80.0);
    Sample { attitude, ..test_sample(field.into(), 0) }
}

fn random_samples(soft_iron: &Matrix3<f32>) -> Vec<Sample> {
    let mut random = Random(3);
    (0..60)
        .map(|_| {
            let heading_rad = random.uniform(0.0, TAU);
            sample_at(heading_rad, random.uniform(-20.0, 20.0), random.uniform(-20.0, 20.0), soft_iron)
        })
        .collect()
}

fn weakest_sample_index(samples: &[Sample]) -> Option<usize> {
    let mut spread = DOptimalSelection::NO_SELECTION;
    let (new, others) = samples.split_first()?;
    spread.find_least_informative_sample(new, others, 0)
}

#[test]
fn repeated_samples_have_the_least_leverage() {
    for first in [0, 20, 60] {
        let mut samples = random_samples(&Matrix3::identity());
        samples.splice(first..first, vec![sample_at(1.0, 0.0, 0.0, &Matrix3::identity()); 40]);
        let place = weakest_sample_index(&samples).unwrap();
        assert!((first..first + 40).contains(&place), "{first} {place}");
    }
}

/// A single tilted sample among level ones.
#[test]
fn unique_samples_are_retained() {
    let level = |i: u8| sample_at(f32::from(i) / 40.0 * TAU, 0.0, 0.0, &Matrix3::identity());
    for rare in [sample_at(0.3, 15.0, 0.0, &Matrix3::identity()), sample_at(0.3, 0.0, -15.0, &Matrix3::identity())] {
        let mut samples: Vec<Sample> = (0..40).map(level).collect();
        samples.insert(7, rare);
        while samples.len() > 13 {
            let place = weakest_sample_index(&samples).unwrap();
            assert_ne!(samples.remove(place), rare, "of {}", samples.len());
        }
    }
}

/// Level samples among turns at 25 deg of bank, which have three times their leverage.
#[test]
fn a_quota_of_level_samples_is_retained() {
    const LEVEL_QUOTA: usize = 10;
    let circle = |roll_deg: f32| {
        (0..40_u8).map(move |i| sample_at(f32::from(i) / 40.0 * TAU, roll_deg, 0.0, &Matrix3::identity()))
    };
    let mut samples: Vec<Sample> = circle(25.0).chain(circle(-25.0)).chain(circle(0.0)).collect();
    while samples.len() > 60 {
        let (new, others) = samples.split_first().unwrap();
        let mut selection = DOptimalSelection::NO_SELECTION;
        samples.remove(selection.find_least_informative_sample(new, others, LEVEL_QUOTA).unwrap());
    }
    assert_eq!(samples.iter().filter(|sample| is_level(sample)).count(), LEVEL_QUOTA);
}

/// Soft iron that deflects the field by up to 20 deg and scales it by a third: the selection hardly changes.
#[test]
fn soft_iron_hardly_changes_the_selection() {
    let bent = Matrix3::new(1.3, 0.2, -0.1, 0.05, 0.7, 0.15, -0.2, 0.1, 1.1);
    let selections = [Matrix3::identity(), bent].map(|soft_iron| {
        let mut samples: Vec<(usize, Sample)> = random_samples(&soft_iron).into_iter().enumerate().collect();
        while samples.len() > 20 {
            let plain_samples: Vec<Sample> = samples.iter().map(|&(_, sample)| sample).collect();
            samples.remove(weakest_sample_index(&plain_samples).unwrap());
        }
        samples.into_iter().map(|(number, _)| number).collect::<Vec<_>>()
    });
    let both = selections[0].iter().filter(|number| selections[1].contains(number)).count();
    // A random selection would retain 7.
    assert!(both >= 12, "{both} of 20");
}

/// Attitude enters the inclination equation; a stronger reading is normalised.
#[test]
fn attitude_changes_the_leverage_and_norm_noise_does_not() {
    let level: Vec<Sample> =
        (0..40).map(|i: u8| sample_at(f32::from(i) / 40.0 * TAU, 0.0, 0.0, &Matrix3::identity())).collect();
    let tilted = Sample { attitude: Attitude::from_deg(8.0, 0.0), ..level[3] };
    let mut samples = level;
    samples.push(tilted);
    for _ in 0..20 {
        let place = weakest_sample_index(&samples).unwrap();
        assert_ne!(samples.remove(place), tilted);
    }
    // Each sample and its copy, 2 % stronger, are removed at the same rate.
    let samples = random_samples(&Matrix3::identity());
    let centre_ut = Vector3::new(60.0, -45.0, 80.0);
    let stronger = |s: &Sample| Sample { field: Field::new(centre_ut + (s.field.ut - centre_ut) * 1.02), ..*s };
    let mut both: Vec<(bool, Sample)> = samples.iter().flat_map(|s| [(false, *s), (true, stronger(s))]).collect();
    while both.len() > 60 {
        let plain_samples: Vec<Sample> = both.iter().map(|&(_, sample)| sample).collect();
        both.remove(weakest_sample_index(&plain_samples).unwrap());
    }
    let stronger_count = both.iter().filter(|(is_stronger, _)| *is_stronger).count();
    assert!((22..=38).contains(&stronger_count), "{stronger_count} of 60");
}

/// Among equivalent samples the new one is removed. 10 % more tilt raises its leverage by a fifth, within the
/// margin; 100 % more exceeds it.
#[test]
fn a_new_sample_must_exceed_the_margin() {
    let ring = |tilt_deg: f32| (0..40_u8).map(move |i| (f32::from(i) / 40.0 * TAU, tilt_deg));
    let others =
        ring(10.0).chain(ring(-10.0)).map(|(heading, roll)| sample_at(heading, roll, 0.0, &Matrix3::identity()));
    let others: Vec<Sample> = others.collect();
    for (roll_deg, is_replaced) in [(10.0, true), (10.6, true), (20.0, false)] {
        let new = sample_at(0.05, roll_deg, 0.0, &Matrix3::identity());
        let samples: Vec<Sample> = core::iter::once(new).chain(others.iter().copied()).collect();
        assert_eq!(weakest_sample_index(&samples) == Some(0), is_replaced, "{roll_deg}");
    }
}

#[test]
fn the_quick_test_accepts_what_the_full_evaluation_accepts() {
    let samples = random_samples(&Matrix3::identity());
    let mut known = DOptimalSelection::NO_SELECTION;
    assert!(known.may_exceed_weakest(&samples[0]));
    known.find_least_informative_sample(&samples[0], &samples[1..], 0).unwrap();
    let mut random = Random(5);
    let mut decisions = [0; 2];
    for _ in 0..200 {
        let tilt_deg = random.uniform(0.0, 14.0);
        let sample = sample_at(random.uniform(0.0, TAU), tilt_deg, -tilt_deg, &Matrix3::identity());
        let all = [&[sample], &samples[..]].concat();
        let gains = weakest_sample_index(&all) != Some(0);
        decisions[usize::from(gains)] += 1;
        assert!(!gains || known.may_exceed_weakest(&sample), "{tilt_deg}");
    }
    assert!(decisions.iter().all(|&times| times > 20), "{decisions:?}");
    let inside = sample_at(0.3, 0.0, 0.0, &Matrix3::identity());
    assert!(!known.may_exceed_weakest(&inside));
    assert_eq!(weakest_sample_index(&[&[inside], &samples[..]].concat()), Some(0));
    let no_number = Sample { field: Field::from_ut(f32::NAN, 0.0, 0.0), ..inside };
    assert!(known.may_exceed_weakest(&no_number), "the caller knows what to do with it");
}

/// Coefficients of a trial solve for a soft iron: its inverse, normalised to determinant 1.
fn trial_linearisation(soft_iron: &Matrix3<f32>, sensor_noise_share_of_trial: f32) -> Linearisation {
    let w = soft_iron.try_inverse().unwrap();
    let w = w / w.determinant().cbrt();
    let calibration = Calibration {
        w: core::array::from_fn(|i| core::array::from_fn(|j| w[(i, j)])),
        b_ut: [60.0, -45.0, 80.0],
        inclination_rad: 1.1,
        ..Linearisation::NO_COEFFICIENTS.calibration
    };
    Linearisation {
        calibration,
        sensor_noise_share: sensor_noise_share_of_trial,
        new_sample_leverage_factor: 0.9,
        is_from_trial: true,
    }
}

/// Both residuals are noise of the sensor if they are equal; of norm and inclination residuals of 1 : 2 a quarter of
/// the inclination's variance is the sensor's. Without residuals there is nothing to attribute.
#[test]
fn the_sensor_share_of_noise_is_the_ratio_of_variances() {
    for (norm_residual, inclination_residual_rad, expected) in
        [(0.01, 0.02_f32, 0.25), (0.002, 0.02, 0.01), (0.03, 0.02, 1.0), (0.0, 0.0, 1.0)]
    {
        let quality = Quality {
            method: crate::calibration::Method::MaximumLikelihood,
            envelope: crate::calibration::AttitudeEnvelope::Banked,
            expected_rms_deg: 1.0,
            expected_worst_deg: 2.0,
            norm_residual,
            inclination_residual_deg: inclination_residual_rad.to_degrees(),
            samples: 100,
            latency: None,
            knows_inclination: true,
        };
        let found = Linearisation::from_trial(&Linearisation::NO_COEFFICIENTS.calibration, &quality).sensor_noise_share;
        assert!((found - expected).abs() < 1e-5, "{norm_residual} {inclination_residual_rad}: {found}");
    }
}

/// Noise of 1 % of the field or 0.6 deg of attitude changes the inclination row to second order only, if the
/// coefficients are known and the noise is attributed to its true source. With sphere coefficients under soft iron,
/// or the wrong source, it changes to first order.
#[test]
fn noise_does_not_change_the_inclination_row() {
    const NOISE: f32 = 0.01;
    let bent = Matrix3::new(1.3, 0.2, -0.1, 0.05, 0.7, 0.15, -0.2, 0.1, 1.1);
    let centre_ut = Vector3::new(60.0, -45.0, 80.0);
    let from_sphere = Linearisation::from_centre(centre_ut);
    let change = |view: &Linearisation, noisy: &dyn Fn(&Sample) -> Sample| {
        random_samples(&bent)
            .iter()
            .map(|sample| {
                let [before, after] = [sample, &noisy(sample)].map(|sample| view.jacobian_rows(sample)[1].as_vector());
                (after - before).norm() / before.norm()
            })
            .fold(0.0, f32::max)
    };
    for size in [NOISE, -NOISE] {
        let with_reading_noise = |sample: &Sample| {
            // Perturbation of the corrected field, across it towards the vertical.
            let body = bent.try_inverse().unwrap() * (sample.field.ut - centre_ut);
            let down = sample.attitude.tilt_rotation().down_in_body();
            let towards_down = (down - body * (down.dot(&body) / body.norm_squared())).normalize();
            let field = Field::new(sample.field.ut + bent * towards_down * (50.0 * size));
            Sample { field, ..*sample }
        };
        let with_attitude_noise = |sample: &Sample| {
            let body = bent.try_inverse().unwrap() * (sample.field.ut - centre_ut);
            let [by_roll, by_pitch] = FieldPrediction::new(body, &body, &sample.attitude.tilt_rotation())
                .inclination_derivatives_by_attitude(&sample.attitude.tilt_rotation());
            let Attitude { roll_rad, pitch_rad } = sample.attitude;
            let attitude = Attitude { roll_rad: roll_rad + by_roll * size, pitch_rad: pitch_rad + by_pitch * size };
            Sample { attitude, ..*sample }
        };
        // A first-order change of a row has the size `NOISE`.
        assert!(change(&trial_linearisation(&bent, 1.0), &with_reading_noise) < 0.1 * NOISE);
        assert!(change(&trial_linearisation(&bent, 0.0), &with_attitude_noise) < 0.1 * NOISE);
        assert!(change(&trial_linearisation(&bent, 0.0), &with_reading_noise) > 0.5 * NOISE);
        assert!(change(&from_sphere, &with_attitude_noise) > 0.1 * NOISE);
    }
}

/// Trial coefficients also apply to the verification set, and invalidate earlier leverages.
#[test]
fn a_trial_solution_applies_to_all_sets() {
    let samples = random_samples(&Matrix3::identity());
    let mut spread = DOptimalSelection::NO_SELECTION;
    spread.find_least_informative_sample(&samples[0], &samples[1..], 0).unwrap();
    let inside = sample_at(0.3, 0.0, 0.0, &Matrix3::identity());
    assert!(!spread.may_exceed_weakest(&inside));
    let Calibration { b_ut: before_ut, .. } = spread.linearisation.calibration;
    spread.set_linearisation(trial_linearisation(&Matrix3::identity(), 0.5));
    assert!(spread.may_exceed_weakest(&inside));
    spread.find_least_informative_sample(&samples[0], &samples[1..], 0).unwrap();
    assert!(!spread.may_exceed_weakest(&inside));
    assert_ne!(
        before_ut.map(f32::to_bits),
        spread.linearisation.calibration.b_ut.map(f32::to_bits),
        "nor is it a sphere again"
    );
    let mut others = spread.with_reset_leverages();
    assert_eq!(others.linearisation.calibration, spread.linearisation.calibration);
    assert!(others.may_exceed_weakest(&inside), "what these tell, those do not");
    others.reset_selection();
    assert_eq!(others.linearisation.calibration, Linearisation::NO_COEFFICIENTS.calibration);
}

#[test]
fn identical_readings_have_no_weakest_sample() {
    assert_eq!(weakest_sample_index(&[]), None);
    assert_eq!(weakest_sample_index(&vec![test_sample([20.0, 0.0, 40.0], 0); 30]), None);
}
