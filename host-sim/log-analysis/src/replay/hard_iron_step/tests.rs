//! Unit tests of `hard_iron_step`.

use autoswing::frames::{Attitude, Field, Level};
use testkit::random::Random;

use super::*;

/// First row after the step, of 1800, midway between two candidate times.
const FIRST_ROW_AFTER_STEP: u16 = 1007;
const INCLINATION_RAD: f32 = std::f32::consts::FRAC_PI_3;
const TURN_RAD_S: f32 = 0.2;

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
        let earth = attitude.to_body_frame(Field::earth_field(50.0, INCLINATION_RAD, TURN_RAD_S * t_s)).ut;
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

/// White noise of both residuals, independent of each other: the standard deviation allows for ten correlated rows, so
/// errors are a third of it (0.316). The RMS of 120 errors is certain to 6.5 %, that of the 40 of an axis to 11 %; the
/// bounds are three times that.
#[test]
fn a_hard_iron_step_is_found_with_its_time_and_the_sigma_of_each_axis() {
    let step_ut = Vector3::new(4.0, -3.0, 2.0);
    let mut squares = [0.0; 3];
    for seed in 0..40 {
        let mut random = Random(seed);
        let mut rows = rows_with_step(step_ut, 0.0, Vector3::zeros(), seed);
        for row in &mut rows {
            let [strength_ut, down_ut] = [0.5 * random.normal(), 0.5 * random.normal()];
            let (sin_inclination, cos_inclination) = libm::sincosf(INCLINATION_RAD);
            let (sin_heading, cos_heading) = libm::sincosf(TURN_RAD_S * row.t_s as f32);
            let north_ut = (strength_ut - down_ut * sin_inclination) / cos_inclination;
            let noise = Field::<Level>::from_ut(north_ut * cos_heading, -north_ut * sin_heading, down_ut);
            row.raw_field.ut += row.attitude.to_body_frame(noise).ut;
        }
        let change = find_step(&rows, &FieldCorrection::identity()).unwrap();
        assert!((change.time_s - f64::from(FIRST_ROW_AFTER_STEP) / 10.0).abs() < 0.35, "{change:?}");
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
    let mut rows = rows_with_step(Vector3::zeros(), 0.0, Vector3::zeros(), 1);
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
        let change = find_step(&distorted_rows(step_ut), &FieldCorrection::identity()).unwrap();
        assert!((change.time_s - f64::from(FIRST_ROW_AFTER_STEP) / 10.0).abs() < 1e-9, "{change:?}");
        assert!((Vector3::from(change.step_ut) - step_ut.map(f64::from)).norm() < 1e-3, "{change:?}");
    }
}

/// An outlier of three steps: unclipped, it would count as eight rows after the step.
#[test]
fn an_outlier_shortly_before_a_hard_iron_step_does_not_shift_its_time() {
    let step_ut = Vector3::new(3.0, -2.0, 1.5);
    let mut rows = rows_with_step(step_ut, 0.05, Vector3::zeros(), 1);
    rows[usize::from(FIRST_ROW_AFTER_STEP) - 4].raw_field.ut += 3.0 * step_ut;
    let change = find_step(&rows, &FieldCorrection::identity()).unwrap();
    assert!((change.time_s - f64::from(FIRST_ROW_AFTER_STEP) / 10.0).abs() < 1e-9, "{change:?}");
}

#[test]
fn residual_derivatives_equal_finite_differences() {
    let rows = distorted_rows(Vector3::new(3.0, -2.0, 1.5));
    let estimate = StepEstimate {
        matrix: Matrix3::new(0.97, 0.02, -0.05, 0.04, 1.06, 0.01, -0.03, 0.07, 1.02),
        hard_iron_ut: Vector3::new(5.0, -3.0, 2.0),
        strength_ut: 48.0,
        vertical_ut: 41.0,
        motor_ut_per_a: Vector3::new(0.1, -0.2, 0.3),
        step_ut: Vector3::new(2.0, -4.0, 3.0),
    };
    for (row, is_after) in rows.iter().step_by(300).flat_map(|row| [(row, false), (row, true)]) {
        let derivatives = estimate.residual_derivatives(row, is_after);
        for unknown in 0..UNKNOWNS_WITH_STEP {
            let changed = |by: f64| {
                let mut changed = estimate.clone();
                changed
                    .add_to_unknowns(&DVector::from_fn(UNKNOWNS_WITH_STEP, |i, _| if i == unknown { by } else { 0.0 }));
                changed.residuals(row, is_after)
            };
            let [more, less] = [changed(1e-4), changed(-1e-4)];
            for (i, derivatives) in derivatives.iter().enumerate() {
                // After its time the step acts as the hard iron.
                let derivative = match unknown.checked_sub(UNKNOWNS_WITHOUT_STEP) {
                    Some(axis) => f64::from(u8::from(is_after)) * derivatives[9 + axis],
                    None => derivatives[unknown],
                };
                let expected = (more[i] - less[i]) / 2e-4;
                assert!((derivative - expected).abs() < 1e-5, "{unknown}, {i}: {derivative} {expected}");
            }
        }
    }
}

/// Against a singular-value decomposition of all rows, with the priors as further rows and the step in columns of its
/// own.
#[test]
fn the_sums_of_a_candidate_give_the_least_squares_solution() {
    const ROWS: usize = 50;
    const FIRST_AFTER: usize = 20;
    let mut random = Random(1);
    let derivatives = DMatrix::from_fn(ROWS, UNKNOWNS_WITHOUT_STEP, |_, _| f64::from(random.normal()));
    let residuals = DVector::from_fn(ROWS, |_, _| f64::from(random.normal()));
    let prior_sigmas: [f64; UNKNOWNS_WITH_STEP] = std::array::from_fn(|i| 0.1 + 0.2 * i as f64);
    let sums_from = |first: usize| {
        let after = derivatives.rows(first, ROWS - first);
        (after.transpose() * after, -(after.transpose() * residuals.rows(first, ROWS - first)))
    };
    let ((matrix, right_side), (matrix_after, right_side_after)) = (sums_from(0), sums_from(FIRST_AFTER));
    let (solution, reduction, sigma) =
        solve_unknowns(&matrix, &right_side, &matrix_after, &right_side_after, &prior_sigmas).unwrap();

    let all =
        DMatrix::from_fn(ROWS + UNKNOWNS_WITH_STEP, UNKNOWNS_WITH_STEP, |row, column| match row.checked_sub(ROWS) {
            Some(unknown) => {
                if unknown == column {
                    prior_sigmas[unknown].recip()
                } else {
                    0.0
                }
            }
            None if column < UNKNOWNS_WITHOUT_STEP => derivatives[(row, column)],
            None => {
                if row < FIRST_AFTER {
                    0.0
                } else {
                    derivatives[(row, column - UNKNOWNS_WITHOUT_STEP + 9)]
                }
            }
        });
    let target = DVector::from_fn(ROWS + UNKNOWNS_WITH_STEP, |row, _| if row < ROWS { -residuals[row] } else { 0.0 });
    let inverse = all.clone().pseudo_inverse(1e-12).unwrap();
    let expected = &inverse * &target;
    assert!((&solution - &expected).amax() < 1e-9, "{solution} {expected}");
    let expected_reduction = target.norm_squared() - (&all * &expected - &target).norm_squared();
    assert!((reduction - expected_reduction).abs() < 1e-9, "{reduction} {expected_reduction}");
    for axis in 0..3 {
        let expected_sigma = inverse.row(UNKNOWNS_WITHOUT_STEP + axis).norm();
        assert!((sigma[axis] - expected_sigma).abs() < 1e-9, "{axis}: {sigma} {expected_sigma}");
    }
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
