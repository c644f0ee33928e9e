//! Unit tests of steps of hard iron.

use autoswing::frames::{Field, Level, RollPitch};
use nalgebra::{Matrix3, Vector3};
use testkit::random::Random;

use super::super::*;
use crate::log::LogFormat;
use crate::numbers::square;

/// First row after the step, of 1800, midway between two candidate times.
const FIRST_ROW_AFTER_STEP: u16 = 1007;
const INCLINATION_RAD: f32 = std::f32::consts::FRAC_PI_3;
const TURN_RAD_S: f32 = 0.2;

/// 180 s of banks to 30 deg and pitch to 15 deg in 50 uT, with a step, white noise, and the interference of a motor
/// current that steps from 10 to 30 A.
struct SteppedFlight {
    step_row: u16,
    current_step_row: u16,
    step_ut: Vector3<f32>,
    noise_ut: f32,
    motor_ut_per_a: Vector3<f32>,
}

impl SteppedFlight {
    fn new(step_ut: [f32; 3], noise_ut: f32) -> Self {
        let (step_row, current_step_row) = (FIRST_ROW_AFTER_STEP, 500);
        Self { step_row, current_step_row, step_ut: step_ut.into(), noise_ut, motor_ut_per_a: Vector3::zeros() }
    }

    fn rows(&self, seed: u64) -> Vec<ReplayRow> {
        let mut random = Random(seed);
        let row_at = |i: u16| {
            let t_s = f32::from(i) / 10.0;
            let attitude = RollPitch::from_deg(30.0 * libm::sinf(t_s * 0.31), 15.0 * libm::sinf(t_s * 0.47));
            let earth = attitude.to_body_frame(Field::earth_field(50.0, INCLINATION_RAD, TURN_RAD_S * t_s)).ut;
            let noise = Vector3::from_fn(|_, _| random.normal() * self.noise_ut);
            let step_ut = if i >= self.step_row { self.step_ut } else { Vector3::zeros() };
            let current_a = if i >= self.current_step_row { 30.0 } else { 10.0 };
            let field = Field::new(earth + noise + step_ut + self.motor_ut_per_a * current_a);
            ReplayRow { current_a: Some(current_a), ..ReplayRow::of_field(f64::from(i) / 10.0, field, attitude) }
        };
        (0..1800).map(row_at).collect()
    }
}

/// The change found in rows without body rates, by a correction that fits most of them.
fn found_change(rows: &[ReplayRow], initial: &FieldCorrection) -> Option<HardIronChange> {
    let flight = LoggedFlight { has_measured_rates: false, ..LoggedFlight::new(LogFormat::Csv) };
    let found = find_changes(rows, &flight, initial, f64::INFINITY).unwrap();
    assert!(found.len() <= 1, "{found:?}");
    found.first().copied()
}

fn change_without_correction(rows: &[ReplayRow]) -> Option<HardIronChange> {
    found_change(rows, &FieldCorrection::identity())
}

fn assert_step_time(change: &HardIronChange, tolerance_s: f64) {
    assert!((change.time_s - f64::from(FIRST_ROW_AFTER_STEP) / 10.0).abs() < tolerance_s, "{change:?}");
}

/// White noise of both residuals, independent of each other: the standard deviation allows for ten correlated rows, so
/// errors are a third of it (0.316). The RMS of 36 errors is certain to 12 %, that of the 12 of an axis to 20 %; the
/// bounds are three times that.
#[test]
fn a_hard_iron_step_is_found_with_its_time_and_the_sigma_of_each_axis() {
    let step_ut = Vector3::new(4.0, -3.0, 2.0);
    let mut squares = [0.0; 3];
    for seed in 0..40 {
        let mut random = Random(seed);
        let mut rows = SteppedFlight::new(step_ut.into(), 0.0).rows(seed);
        for row in &mut rows {
            let [strength_ut, down_ut] = [0.5 * random.normal(), 0.5 * random.normal()];
            let (sin_inclination, cos_inclination) = libm::sincosf(INCLINATION_RAD);
            let (sin_heading, cos_heading) = libm::sincosf(TURN_RAD_S * row.t_s as f32);
            let north_ut = (strength_ut - down_ut * sin_inclination) / cos_inclination;
            let noise = Field::<Level>::from_ut(north_ut * cos_heading, -north_ut * sin_heading, down_ut);
            row.raw_field.ut += row.attitude.to_body_frame(noise).ut;
        }
        let change = change_without_correction(&rows).unwrap();
        assert_step_time(&change, 0.35);
        assert_eq!(change.axis(), 'x');
        for axis in 0..3 {
            squares[axis] += square((change.step_ut[axis] - f64::from(step_ut[axis])) / change.sigma_ut[axis]) / 40.0;
        }
    }
    let rms = (squares.iter().sum::<f64>() / 3.0).sqrt();
    assert!((0.255..0.38).contains(&rms), "{rms}");
    assert!(squares.iter().all(|square| (0.21..0.42).contains(&square.sqrt())), "{squares:?}");
}

/// Rows without noise, distorted by soft and hard iron that no correction removes.
fn distorted_rows(step_ut: Vector3<f32>) -> Vec<ReplayRow> {
    let soft_iron = Matrix3::new(1.05, 0.04, -0.03, -0.02, 0.93, 0.05, 0.06, -0.01, 0.98);
    let mut rows = SteppedFlight::new([0.0; 3], 0.0).rows(1);
    for (i, row) in rows.iter_mut().enumerate() {
        row.raw_field.ut = soft_iron * row.raw_field.ut + Vector3::new(6.0, -4.0, 3.0);
        row.raw_field.ut += if i < usize::from(FIRST_ROW_AFTER_STEP) { Vector3::zeros() } else { step_ut };
    }
    rows
}

/// A large step clips residuals and takes many iterations. Errors are those of `f32` fields, 4e-6 uT, and of the last
/// iteration, a tenth of a standard deviation.
#[test]
fn without_noise_a_hard_iron_step_is_exact_whatever_the_initial_correction() {
    for step_ut in [Vector3::new(3.0, -2.0, 1.5), Vector3::new(-25.0, 18.0, 40.0)] {
        let change = change_without_correction(&distorted_rows(step_ut)).unwrap();
        assert_step_time(&change, 1e-9);
        assert!((change.step_ut - step_ut.map(f64::from)).norm() < 1e-3, "{change:?}");
    }
}

#[test]
fn small_or_uncertain_hard_iron_steps_are_not_reported() {
    let flight = |y_ut, noise_ut, seed| SteppedFlight::new([0.0, y_ut, 0.0], noise_ut).rows(seed);
    for seed in 0..5 {
        let few_rows = flight(3.0, 1.0, seed).into_iter().step_by(12).collect();
        let mut unusable = flight(8.0, 0.3, seed);
        unusable.iter_mut().skip(usize::from(FIRST_ROW_AFTER_STEP)).for_each(|row| row.is_usable = false);
        for (name, rows, is_reported) in [
            ("no step", flight(0.0, 0.1, seed), false),
            ("below an effect on headings", flight(0.8, 0.1, seed), false),
            ("small but certain", flight(1.3, 0.1, seed), true),
            ("in much noise", flight(3.0, 5.0, seed), false),
            ("in some noise", flight(6.0, 1.0, seed), true),
            ("in one row of twelve", few_rows, false),
            ("in unusable rows", unusable, false),
        ] {
            let change = change_without_correction(&rows);
            assert_eq!(change.is_some(), is_reported, "{name}, seed {seed}: {change:?}");
        }
    }
}

/// What a motor current explains is no change, whether its interference is known before or not.
#[test]
fn motor_current_interference_is_not_a_hard_iron_step() {
    let motor_ut_per_a = Vector3::new(0.3, -0.2, 0.1);
    let of_motors = SteppedFlight { motor_ut_per_a, ..SteppedFlight::new([0.0; 3], 0.3) };
    let known = FieldCorrection { motor_ut_per_a: motor_ut_per_a.map(f64::from), ..FieldCorrection::identity() };
    for initial in [FieldCorrection::identity(), known] {
        assert_eq!(found_change(&of_motors.rows(1), &initial), None);
        let of_both = SteppedFlight { step_ut: Vector3::new(0.0, 5.0, 0.0), ..of_motors };
        let change = found_change(&of_both.rows(1), &initial).unwrap();
        assert_step_time(&change, 0.3);
        assert!((change.step_ut - Vector3::new(0.0, 5.0, 0.0)).norm() < 0.3, "{change:?}");
    }
}

/// Outliers of 100 uT in one row of 40.
#[test]
fn outliers_neither_cause_nor_hide_a_hard_iron_step() {
    for seed in 0..4 {
        let detected_step = |moved_ut: f32| {
            let mut rows = SteppedFlight::new([moved_ut, 0.0, 0.0], 0.3).rows(seed);
            rows.iter_mut().skip(300).step_by(40).for_each(|row| row.raw_field.ut.y += 100.0);
            change_without_correction(&rows)
        };
        assert_eq!(detected_step(0.0), None, "{seed}");
        let change = detected_step(4.0).unwrap();
        let off_ut = (change.step_ut - Vector3::new(4.0, 0.0, 0.0)).norm();
        // The limit is three standard deviations of the step.
        assert!(off_ut < 0.3, "{seed}: {change:?}");
    }
}

/// A tenth of the rows hardly affects the overall median.
#[test]
fn a_hard_iron_step_in_a_tenth_of_the_rows_is_found() {
    for (step_row, moved_ut, noise_ut, is_found) in
        [(150, 8.0, 0.5, true), (1650, 8.0, 0.5, true), (150, 0.0, 0.5, false), (1650, 2.0, 1.5, false)]
    {
        for seed in 0..4 {
            let flight = SteppedFlight { step_row, ..SteppedFlight::new([moved_ut, 0.0, 0.0], noise_ut) };
            // The correction fits the majority of the rows.
            let hard_iron_ut =
                if step_row < FIRST_ROW_AFTER_STEP { flight.step_ut.map(f64::from) } else { Vector3::zeros() };
            let change =
                found_change(&flight.rows(seed), &FieldCorrection { hard_iron_ut, ..FieldCorrection::identity() });
            assert_eq!(change.is_some(), is_found, "{step_row}, {seed}: {moved_ut} uT in {noise_ut}: {change:?}");
            if let Some(change) = change {
                assert!((change.time_s - f64::from(step_row) / 10.0).abs() < 1.0, "{change:?}");
                assert!((change.step_ut.norm() - f64::from(moved_ut)).abs() < 1.0, "{change:?}");
            }
        }
    }
}
