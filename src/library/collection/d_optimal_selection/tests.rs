//! Unit tests of `d_optimal_selection`.

use core::f32::consts::TAU;

use nalgebra::Matrix3;
use testkit::random::Random;

use super::super::test_samples::{HARD_IRON_UT, collected, stored_times_ms, test_sample, times_ms, turn_samples};
use super::*;
use crate::calibration::CollectionPart;
use crate::calibration::method_selection::Procedure;
use crate::collection::Collector;
use crate::collection::progress::PartCoverage;
use crate::frames::{Field, Level};

/// Soft iron that deflects the field by up to 20 deg and scales it by a third.
const BENT: Matrix3<f32> = Matrix3::new(1.3, 0.2, -0.1, 0.05, 0.7, 0.15, -0.2, 0.1, 1.1);

fn sample_with_soft_iron(heading_rad: f32, roll_deg: f32, pitch_deg: f32, soft_iron: &Matrix3<f32>) -> Sample {
    let attitude = RollPitch::from_deg(roll_deg, pitch_deg);
    let body = attitude.to_body_frame(Field::<Level>::earth_field(50.0, 1.1, heading_rad)).ut;
    Sample { attitude, ..test_sample((soft_iron * body + HARD_IRON_UT).into(), 0) }
}

fn sample_at(heading_rad: f32, roll_deg: f32, pitch_deg: f32) -> Sample {
    sample_with_soft_iron(heading_rad, roll_deg, pitch_deg, &Matrix3::identity())
}

/// Forty samples around a circle.
fn circle(roll_deg: f32) -> impl Iterator<Item = Sample> {
    (0..40_u8).map(move |i| sample_at(f32::from(i) / 40.0 * TAU, roll_deg, 0.0))
}

fn random_samples(soft_iron: &Matrix3<f32>) -> Vec<Sample> {
    let mut random = Random(3);
    (0..60)
        .map(|_| {
            let heading_rad = random.uniform(0.0, TAU);
            sample_with_soft_iron(heading_rad, random.uniform(-20.0, 20.0), random.uniform(-20.0, 20.0), soft_iron)
        })
        .collect()
}

fn weakest_sample_index(samples: &[Sample], level_quota: usize) -> Option<usize> {
    let (new, others) = samples.split_first()?;
    let mut selection = DOptimalSelection::NO_SELECTION;
    selection.find_least_informative_sample(new, others, level_quota)
}

#[test]
fn repeated_samples_have_the_least_leverage() {
    for first in [0, 20, 60] {
        let mut samples = random_samples(&Matrix3::identity());
        samples.splice(first..first, vec![sample_at(1.0, 0.0, 0.0); 40]);
        let place = weakest_sample_index(&samples, 0).unwrap();
        assert!((first..first + 40).contains(&place), "{first} {place}");
    }
}

/// Among equivalent samples the new one is removed; 100 % more tilt exceeds the margin.
#[test]
fn a_new_sample_must_exceed_the_margin() {
    let others: Vec<Sample> = circle(10.0).chain(circle(-10.0)).collect();
    for (roll_deg, is_rejected) in [(10.0, true), (20.0, false)] {
        let samples = [&[sample_at(0.05, roll_deg, 0.0)], &others[..]].concat();
        assert_eq!(weakest_sample_index(&samples, 0) == Some(0), is_rejected, "{roll_deg}");
    }
}

#[test]
fn the_quick_test_accepts_what_the_full_evaluation_accepts() {
    let samples = random_samples(&Matrix3::identity());
    let mut selection = DOptimalSelection::NO_SELECTION;
    assert!(selection.may_exceed_weakest(&samples[0]));
    selection.find_least_informative_sample(&samples[0], &samples[1..], 0).unwrap();
    let mut random = Random(5);
    let mut decisions = [0; 2];
    for _ in 0..200 {
        let tilt_deg = random.uniform(0.0, 14.0);
        let sample = sample_at(random.uniform(0.0, TAU), tilt_deg, -tilt_deg);
        let is_accepted = weakest_sample_index(&[&[sample], &samples[..]].concat(), 0) != Some(0);
        decisions[usize::from(is_accepted)] += 1;
        assert!(!is_accepted || selection.may_exceed_weakest(&sample), "{tilt_deg}");
    }
    assert!(decisions.iter().all(|&times| times > 20), "{decisions:?}");
    let inside = sample_at(0.3, 0.0, 0.0);
    assert!(!selection.may_exceed_weakest(&inside));
    assert_eq!(weakest_sample_index(&[&[inside], &samples[..]].concat(), 0), Some(0));
    let no_number = Sample { field: Field::from_ut(f32::NAN, 0.0, 0.0), ..inside };
    assert!(selection.may_exceed_weakest(&no_number), "left to the full evaluation");
}

/// Coefficients of a trial solve for a soft iron: its inverse, normalised to determinant 1.
fn trial_linearisation(soft_iron: &Matrix3<f32>, sensor_noise_share: f32) -> Linearisation {
    let w = soft_iron.try_inverse().unwrap();
    let w = w / w.determinant().cbrt();
    let calibration = Calibration {
        w: core::array::from_fn(|i| core::array::from_fn(|j| w[(i, j)])),
        b_ut: HARD_IRON_UT.into(),
        inclination_rad: 1.1,
        ..Linearisation::NO_COEFFICIENTS.calibration
    };
    Linearisation { calibration, sensor_noise_share, new_sample_leverage_factor: 0.9, is_from_trial: true }
}

/// Noise of 1 % of the field or 0.6 deg of attitude changes the inclination row to second order only, if the
/// coefficients are known and the noise is attributed to its true source. With sphere coefficients under soft iron,
/// or the wrong source, it changes to first order.
#[test]
fn noise_does_not_change_the_inclination_row() {
    const NOISE: f32 = 0.01;
    let corrected = |sample: &Sample| BENT.try_inverse().unwrap() * (sample.field.ut - HARD_IRON_UT);
    // Perturbation of the corrected field, across it towards the vertical.
    let with_reading_noise = |sample: &Sample, size: f32| {
        let body = corrected(sample);
        let down = sample.attitude.tilt_rotation().down_in_body();
        let towards_down = (down - body * (down.dot(&body) / body.norm_squared())).normalize();
        Sample { field: Field::new(sample.field.ut + BENT * towards_down * (50.0 * size)), ..*sample }
    };
    let with_attitude_noise = |sample: &Sample, size: f32| {
        let (body, rotation) = (corrected(sample), sample.attitude.tilt_rotation());
        let [by_roll, by_pitch] =
            FieldPrediction::new(body, &body, &rotation).inclination_derivatives_by_attitude(&rotation);
        let RollPitch { roll_rad, pitch_rad } = sample.attitude;
        let attitude = RollPitch { roll_rad: roll_rad + by_roll * size, pitch_rad: pitch_rad + by_pitch * size };
        Sample { attitude, ..*sample }
    };
    // Largest relative change of the row in units of the noise: about one if it is of first order.
    let change = |linearisation: &Linearisation, noisy: &dyn Fn(&Sample, f32) -> Sample| {
        let samples = random_samples(&BENT);
        let signed = samples.iter().flat_map(|sample| [NOISE, -NOISE].map(|size| (sample, noisy(sample, size))));
        signed.fold(0.0, |largest: f32, (sample, noisy)| {
            let [before, after] = [sample, &noisy].map(|sample| linearisation.jacobian_rows(sample)[1].as_vector());
            largest.max((after - before).norm() / before.norm() / NOISE)
        })
    };
    assert!(change(&trial_linearisation(&BENT, 1.0), &with_reading_noise) < 0.1);
    assert!(change(&trial_linearisation(&BENT, 0.0), &with_attitude_noise) < 0.1);
    assert!(change(&trial_linearisation(&BENT, 0.0), &with_reading_noise) > 0.5);
    assert!(change(&Linearisation::from_centre(HARD_IRON_UT), &with_attitude_noise) > 0.1);
}

/// Trial coefficients also apply to the verification set, and invalidate earlier leverages.
#[test]
fn a_trial_solution_applies_to_all_sets() {
    let samples = random_samples(&Matrix3::identity());
    let inside = sample_at(0.3, 0.0, 0.0);
    let mut selection = DOptimalSelection::NO_SELECTION;
    let evaluate = |selection: &mut DOptimalSelection| {
        selection.find_least_informative_sample(&samples[0], &samples[1..], 0).unwrap();
        assert!(!selection.may_exceed_weakest(&inside));
    };
    evaluate(&mut selection);
    let trial = trial_linearisation(&Matrix3::identity(), 0.5);
    selection.set_linearisation(trial.clone());
    assert!(selection.may_exceed_weakest(&inside), "earlier leverages do not apply");
    evaluate(&mut selection);
    assert_eq!(selection.linearisation.calibration, trial.calibration, "it stays");
    let mut others = selection.with_reset_leverages();
    assert_eq!(others.linearisation.calibration, trial.calibration);
    assert!(others.may_exceed_weakest(&inside), "the leverages of one set do not apply to another");
    others.reset_selection();
    assert_eq!(others.linearisation.calibration, Linearisation::NO_COEFFICIENTS.calibration);
}

#[test]
fn identical_readings_have_no_weakest_sample() {
    assert_eq!(weakest_sample_index(&[], 0), None);
    assert_eq!(weakest_sample_index(&vec![test_sample([20.0, 0.0, 40.0], 0); 30], 0), None);
}

fn collect_in_flight(samples: impl IntoIterator<Item = Sample>) -> Collector<'static> {
    collected(Procedure::Flight, samples)
}

fn stored_samples<'a>(collector: &'a Collector<'_>) -> [(SampleUse, Samples<'a>); 2] {
    [(SampleUse::Fit, collector.fit_samples()), (SampleUse::Verification, collector.held_back_samples())]
}

/// Right turn, level, left turn, 20 s each, with bank wander; consecutive samples differ.
fn free_flight(seconds: u16) -> impl Iterator<Item = Sample> {
    let leg = |from_s: u16| [25.0, 0.0, -25.0][usize::from(from_s / 20 % 3)];
    (0..seconds).step_by(20).flat_map(move |from_s| turn_samples(leg(from_s), from_s, from_s + 20, 60.0))
}

#[test]
fn free_flight_samples_are_stored_until_full() {
    let collector = collect_in_flight(free_flight(40));
    let [fit, held_back] = stored_times_ms(&collector, CollectionPart::FREE);
    let (expected_held_back, expected_fit) = (0..400).map(|i| i * 100).partition::<Vec<_>, _>(|ms| ms % 400 == 300);
    assert_eq!((fit, held_back), (expected_fit, expected_held_back));
    let coverage = PartCoverage { fit_count: 300, held_back_count: 100, ..PartCoverage::default() };
    assert_eq!(collector.collection_progress().coverage_of(CollectionPart::FREE), &coverage);
    assert_eq!((collector.taken_count(), collector.stored_count()), (400, 400));
}

/// Five minutes of level flight, then a turn each way.
#[test]
fn informative_samples_replace_uninformative_ones() {
    let mut collector = collect_in_flight(turn_samples(0.0, 0, 300, 60.0));
    let before = collector.stored_count();
    let turns = turn_samples(25.0, 300, 320, 60.0).chain(turn_samples(-25.0, 320, 340, 60.0));
    turns.for_each(|sample| collector.push_sample(sample));
    let newly_stored = usize::from(collector.stored_count() - before);
    let mut banked_sum = 0;
    // Of 400 banked samples, one in four is held back.
    for ((sample_use, samples), offered) in stored_samples(&collector).into_iter().zip([300, 100]) {
        let capacity = WHOLE_BUFFER.of_use(sample_use);
        assert_eq!(samples.iter().count(), capacity);
        let banked = samples.iter().filter(|sample| sample.attitude.roll_rad.abs() > 0.3).count();
        assert!(banked * 10 >= offered * 8 || banked * 10 >= capacity * 7, "{banked} of {offered}");
        banked_sum += banked;
        assert!(times_ms(samples.iter()).is_sorted());
    }
    assert!(newly_stored >= banked_sum && newly_stored <= 400, "{newly_stored}, {banked_sum}");
}

/// A minute of level flight before or after four minutes of circles: level samples separate what iron does
/// in turns from hard iron.
#[test]
fn circles_leave_a_quota_of_level_samples() {
    let circles = |start_s: u16| {
        (start_s..start_s + 240).step_by(60).flat_map(|from_s| {
            turn_samples(25.0, from_s, from_s + 30, 60.0).chain(turn_samples(-25.0, from_s + 30, from_s + 60, 60.0))
        })
    };
    for collector in [
        collect_in_flight(turn_samples(0.0, 0, 60, 60.0).chain(circles(60))),
        collect_in_flight(circles(0).chain(turn_samples(0.0, 240, 300, 60.0))),
    ] {
        for (sample_use, samples) in stored_samples(&collector) {
            let level_count = samples.iter().filter(|sample| sample.attitude.roll_rad.abs() < 0.1).count();
            assert!(level_count >= LEVEL_QUOTA.of_use(sample_use), "{sample_use:?}: {level_count}");
        }
    }
}

/// 100 level samples, after minutes of the same flight.
#[test]
fn uninformative_samples_are_rejected() {
    let mut collector = collect_in_flight(free_flight(400));
    let rejected_count = |collector: &Collector| collector.taken_count() - collector.stored_count();
    let before = rejected_count(&collector);
    turn_samples(0.0, 500, 510, 60.0).for_each(|sample| collector.push_sample(sample));
    assert!(rejected_count(&collector) - before >= 67, "{}", rejected_count(&collector) - before);
    let [fit, _] = stored_times_ms(&collector, CollectionPart::FREE);
    let new_fit_count = fit.iter().filter(|ms| **ms >= 500_000).count();
    assert!(new_fit_count <= 8, "{new_fit_count} of 75");
}

/// Three sigma of an averaged sample are 1 uT.
#[test]
fn identical_samples_are_stored_once() {
    let mut collector = collect_in_flight([]);
    let nan = f32::NAN;
    for (x_ut, roll_deg, pitch_deg, is_stored) in [
        (20.0, 0.0, 0.0, true),
        (20.0, 0.0, 0.0, false),
        (20.8, 0.0, 0.0, false),
        (20.0, 1.0, -1.0, false),
        (21.2, 0.0, 0.0, true),
        (21.2, -1.6, 0.0, true),
        (21.2, -1.6, 0.0, false),
        (21.2, -1.6, 1.6, true),
        (nan, 0.0, 0.0, false),
        (90.0, nan, 0.0, false),
        (90.0, 0.0, f32::INFINITY, false),
    ] {
        let before = (collector.stored_count(), collector.taken_count());
        let attitude = RollPitch::from_deg(roll_deg, pitch_deg);
        collector.push_sample(Sample { attitude, ..test_sample([x_ut, 5.0, 40.0], 100) });
        let expected = (before.0 + u16::from(is_stored), before.1 + u16::from(is_stored));
        let found = (collector.stored_count(), collector.taken_count());
        assert_eq!(found, expected, "{x_ut} uT {roll_deg} {pitch_deg}");
    }
}

/// A tumble has no attitude: its samples are distinct by their field, and a full buffer keeps all directions.
#[test]
fn a_full_tumble_keeps_all_directions() {
    let mut random = Random(7);
    let direction = |random: &mut Random| Vector3::from_fn(|_, _| random.normal()).normalize();
    let samples = (0..1500).map(|i| test_sample((HARD_IRON_UT + direction(&mut random) * 50.0).into(), i * 100));
    let collector = collected(Procedure::Tumble, samples);
    for (sample_use, samples) in stored_samples(&collector) {
        let octant = |sample: &Sample| {
            let from_centre = sample.field.ut - HARD_IRON_UT;
            (0..3).map(|axis| usize::from(from_centre[axis] > 0.0) << axis).sum::<usize>()
        };
        let mut counts = [0; 8];
        samples.iter().for_each(|sample| counts[octant(sample)] += 1);
        let capacity = WHOLE_BUFFER.of_use(sample_use);
        assert_eq!(counts.iter().sum::<usize>(), capacity);
        assert!(counts.iter().all(|count| count * 8 > capacity / 3), "{counts:?}");
    }
}
