//! Unit tests of `hard_iron_step`.

use autoswing::frames::{Attitude, Field};
use testkit::random::Random;

use super::*;

/// First row after the step, of 1800, midway between two candidate times.
const FIRST_ROW_AFTER_STEP: u16 = 1007;

/// 180 s of banks to 30 deg and pitch to 15 deg in 50 uT, with a step, white noise, and motor-current interference
/// at 10 A before and 30 A after the step.
fn rows_with_step(step_ut: Vector3<f32>, noise_ut: f32, motor_ut_per_a: Vector3<f32>, seed: u64) -> Vec<ReplayRow> {
    rows_with_step_at(FIRST_ROW_AFTER_STEP, step_ut, noise_ut, motor_ut_per_a, seed)
}

fn rows_with_step_at(
    step_row: u16,
    step_ut: Vector3<f32>,
    noise_ut: f32,
    motor_ut_per_a: Vector3<f32>,
    seed: u64,
) -> Vec<ReplayRow> {
    let mut random = Random(seed);
    let row_at = |i: u16| {
        let (t_s, is_after) = (f32::from(i) / 10.0, i >= step_row);
        let attitude = Attitude::from_deg(30.0 * libm::sinf(t_s * 0.31), 15.0 * libm::sinf(t_s * 0.47));
        let earth = attitude.to_body_frame(Field::earth_field(50.0, 60_f32.to_radians(), 0.2 * t_s)).ut;
        let noise = Vector3::from_fn(|_, _| random.normal() * noise_ut);
        let current_a = if is_after { 30.0 } else { 10.0 };
        let step_ut = if is_after { step_ut } else { Vector3::zeros() };
        let field = Field::new(earth + noise + step_ut + motor_ut_per_a * current_a);
        ReplayRow {
            t_s: f64::from(i) / 10.0,
            raw_field: field,
            logged_field: field,
            attitude,
            rates_rad_s: None,
            current_a: Some(current_a),
            is_usable: true,
            reference_deg: None,
        }
    };
    (0..1800).map(row_at).collect()
}

fn find_simulated_step(step_ut: [f32; 3], noise_ut: f32, seed: u64) -> Option<HardIronStep> {
    find_step(&rows_with_step(step_ut.into(), noise_ut, Vector3::zeros(), seed), &FieldCorrection::identity())
}

/// White noise: the standard deviation allows for ten correlated rows, so errors are a third of it.
#[test]
fn a_hard_iron_step_is_found_with_its_time_and_sigma() {
    let mut errors = Vec::new();
    for seed in 0..20 {
        let step_ut = [4.0, -3.0, 2.0];
        let change = find_simulated_step(step_ut, 0.5, seed).unwrap();
        assert!((change.time_s - f64::from(FIRST_ROW_AFTER_STEP) / 10.0).abs() < 0.35, "{change:?}");
        assert_eq!(change.axis(), 'x');
        errors.extend((0..3).map(|i| (change.step_ut[i] - f64::from(step_ut[i])) / change.sigma_ut[i]));
    }
    let rms = (errors.iter().map(|error| error * error).sum::<f64>() / errors.len() as f64).sqrt();
    assert!((0.2..0.6).contains(&rms), "{rms}");
}

#[test]
fn small_or_uncertain_hard_iron_steps_are_not_reported() {
    for (moved_ut, noise_ut, is_one) in [(1.3, 0.1, true), (0.8, 0.1, false), (0.0, 0.1, false), (3.0, 5.0, false)] {
        for seed in 0..5 {
            let change = find_simulated_step([0.0, moved_ut, 0.0], noise_ut, seed);
            assert_eq!(change.is_some(), is_one, "{moved_ut} uT in {noise_ut}: {change:?}");
        }
    }
}

#[test]
fn each_axis_of_a_hard_iron_step_has_its_own_sigma() {
    let step_ut = [4.0, -3.0, 2.0];
    let changes: Vec<HardIronStep> = (0..20).map(|seed| find_simulated_step(step_ut, 0.5, seed).unwrap()).collect();
    for (axis, expected) in step_ut.into_iter().map(f64::from).enumerate() {
        let over_sigma = |change: &HardIronStep| (change.step_ut[axis] - expected) / change.sigma_ut[axis];
        let rms = (changes.iter().map(over_sigma).map(|error| error * error).sum::<f64>() / 20.0).sqrt();
        assert!((0.2..0.6).contains(&rms), "{axis}: {rms}");
    }
}

/// With one row in twelve the step is below eight standard deviations.
#[test]
fn a_hard_iron_step_needs_enough_rows() {
    for seed in 0..5 {
        let all_rows = rows_with_step(Vector3::new(0.0, 3.0, 0.0), 1.0, Vector3::zeros(), seed);
        let thinned_rows: Vec<ReplayRow> = all_rows.iter().step_by(12).copied().collect();
        assert!(
            find_step(&all_rows, &FieldCorrection::identity()).is_some()
                && find_step(&thinned_rows, &FieldCorrection::identity()).is_none(),
            "{seed}"
        );
    }
}

#[test]
fn motor_current_interference_is_not_a_hard_iron_step() {
    let motor_ut_per_a = Vector3::new(0.3, -0.2, 0.1);
    let rows = rows_with_step(Vector3::zeros(), 0.3, motor_ut_per_a, 1);
    let correction = FieldCorrection { motor_ut_per_a: motor_ut_per_a.map(f64::from), ..FieldCorrection::identity() };
    assert_eq!(find_step(&rows, &correction), None);
    let change = find_step(&rows, &FieldCorrection::identity()).unwrap();
    assert!((change.step_ut[0] - 6.0).abs() < 0.5, "20 A of 0.3 uT: {change:?}");
}

#[test]
fn unusable_rows_give_no_hard_iron_step() {
    let mut rows = rows_with_step(Vector3::new(8.0, 0.0, 0.0), 0.3, Vector3::zeros(), 1);
    rows.iter_mut().skip(usize::from(FIRST_ROW_AFTER_STEP)).for_each(|row| row.is_usable = false);
    assert_eq!(find_step(&rows, &FieldCorrection::identity()), None);
}

#[test]
fn a_hard_iron_step_needs_six_seconds_of_rows_on_each_side() {
    let all_rows = rows_with_step(Vector3::new(8.0, -4.0, 3.0), 0.1, Vector3::zeros(), 1);
    let step_row = usize::from(FIRST_ROW_AFTER_STEP);
    for (around, is_found) in [(59, false), (61, true)] {
        let change = find_step(&all_rows[step_row - around..step_row + around], &FieldCorrection::identity());
        assert_eq!(change.is_some(), is_found, "{around}: {change:?}");
    }
}

/// Outliers of 100 uT in one row of 40.
#[test]
fn outliers_neither_cause_nor_hide_a_hard_iron_step() {
    for seed in 0..4 {
        let detected_step = |moved_ut: f32| {
            let mut rows = rows_with_step(Vector3::new(moved_ut, 0.0, 0.0), 0.3, Vector3::zeros(), seed);
            rows.iter_mut().skip(300).step_by(40).for_each(|row| row.raw_field.ut.y += 100.0);
            find_step(&rows, &FieldCorrection::identity())
        };
        assert_eq!(detected_step(0.0), None, "{seed}");
        let change = detected_step(4.0).unwrap();
        let off_ut = (Vector3::from(change.step_ut) - Vector3::new(4.0, 0.0, 0.0)).norm();
        // The limit is three standard deviations of the step.
        assert!(off_ut < 0.3, "{seed}: {change:?}");
    }
}

/// The step reduces the residuals by an eighth only.
#[test]
fn a_step_that_does_not_reduce_the_scatter_is_not_reported() {
    for seed in 0..3 {
        let detected_step = |moved_ut: f32| {
            let both_flights = [seed, seed + 10]
                .map(|seed| rows_with_step(Vector3::new(0.0, moved_ut, 0.0), 1.0, Vector3::zeros(), seed));
            let mut rows = both_flights.concat();
            rows.sort_by(|a, b| a.t_s.total_cmp(&b.t_s));
            find_step(&rows, &FieldCorrection::identity())
        };
        assert_eq!(detected_step(1.7), None, "{seed}");
        assert!(detected_step(3.0).is_some(), "{seed}");
    }
}

/// A tenth of the rows hardly affects the overall median.
#[test]
fn a_hard_iron_step_in_a_tenth_of_the_rows_is_found() {
    for step_row in [150, 1650] {
        for (moved_ut, noise_ut, is_found) in [(8.0, 0.5, true), (5.0, 0.5, true), (0.0, 0.5, false), (2.0, 1.5, false)]
        {
            for seed in 0..4 {
                let step_ut = Vector3::new(moved_ut, 0.0, 0.0);
                let rows = rows_with_step_at(step_row, step_ut, noise_ut, Vector3::zeros(), seed);
                // The correction fits the majority of the rows.
                let centre_ut = if step_row < FIRST_ROW_AFTER_STEP { step_ut.map(f64::from) } else { Vector3::zeros() };
                let change =
                    find_step(&rows, &FieldCorrection { hard_iron_ut: centre_ut, ..FieldCorrection::identity() });
                assert_eq!(change.is_some(), is_found, "{step_row}, {seed}: {moved_ut} uT in {noise_ut}: {change:?}");
                if let Some(change) = change {
                    assert!((change.time_s - f64::from(step_row) / 10.0).abs() < 1.0, "{change:?}");
                    assert!((change.size_ut() - f64::from(moved_ut)).abs() < 1.0, "{change:?}");
                }
            }
        }
    }
}
