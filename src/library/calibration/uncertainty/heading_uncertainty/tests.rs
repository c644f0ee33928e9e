//! Unit tests of `uncertainty`.

use nalgebra::Matrix3;

use super::*;
use crate::calibration::model::{COEFFICIENT_COUNT, Vector12, coefficient_jacobian_row};
use crate::calibration::tests::derivatives::{assert_derivative, numerical_derivative};
use crate::calibration::tests::synthetic::{Random, random_vector};
use crate::calibration::{MotorCurrentInterference, Orientation, matrix_rows};
use crate::frames::{RollPitch, wrap_pi};

#[test]
fn reduced_covariance_gives_the_same_heading_variance() {
    let mut random = Random(1);
    let mut number = || random.uniform(-1.0, 1.0);
    for _ in 0..50 {
        let root = nalgebra::SMatrix::<f32, 12, 12>::from_fn(|_, _| number());
        let full = root * root.transpose();
        let mut covariance = CoefficientCovariance::ZERO;
        covariance.set_lower_triangle(|i, j| full[(i, j)]);
        let [f, x] = [(); 2].map(|()| Vector3::from_fn(|_, _| number()));
        let row = coefficient_jacobian_row(&f, &x);
        let exact = row.dot(&(full * row));
        assert!((covariance.variance(&row) - exact).abs() < 1e-5 * exact.max(1.0));
        let found = HeadingUncertainty::from_covariance(&covariance, 0.0, 0.0).variance_from_coefficients(&f, &x);
        assert!((found - exact).abs() < 1e-5 * exact.max(1.0), "{found} {exact}");
    }
}

struct Case {
    calibration: Calibration,
    attitude: RollPitch,
    reading: Field<Sensor>,
}

impl Case {
    fn random(random: &mut Random) -> Self {
        let w = Matrix3::identity() + Matrix3::from_fn(|_, _| random.uniform(-0.2, 0.2));
        let calibration = Calibration {
            w: matrix_rows(&w),
            b_ut: random_vector(random, 40.0).into(),
            inclination_rad: random.uniform(-1.1, 1.1),
            total_ut: random.uniform(30.0, 60.0),
            latency_s: 0.0,
            motor_current: MotorCurrentInterference::NO_INTERFERENCE,
        };
        let attitude = RollPitch { roll_rad: random.uniform(-1.0, 1.0), pitch_rad: 0.0 };
        let level = Field::earth_field(calibration.total_ut, calibration.inclination_rad, random.uniform(-3.0, 3.0));
        let reading = w.try_inverse().unwrap() * attitude.to_body_frame(level).ut + calibration.b_vector_ut();
        Self { calibration, attitude, reading: Field::new(reading) }
    }

    fn heading_rad(&self, calibration: &Calibration) -> f32 {
        self.attitude.to_level_frame(calibration.calibrated_field(self.reading)).heading_rad()
    }

    fn sigma_rad(&self, uncertainty: &HeadingUncertainty) -> f32 {
        let tilt = self.attitude.tilt_rotation();
        let level = tilt.to_level_frame(self.calibration.calibrated_field(self.reading));
        uncertainty.heading_variance(&self.calibration, self.reading, &tilt, level).sigma_rad()
    }

    /// Calibration moved along `direction`: `W` by its elements, `b` so that the corrected field decreases by
    /// `beta`.
    fn perturbed_calibration(&self, direction: &Vector12, step: f32) -> Calibration {
        let change = |i: usize| direction[i] * step;
        let before = self.calibration.w_matrix();
        let after = before + Matrix3::from_fn(|row, column| change(w_index(row, column)));
        let of_total = Vector3::from_fn(|axis, _| change(beta_index(axis)));
        let b_ut = self.calibration.b_vector_ut() + after.try_inverse().unwrap() * of_total * self.calibration.total_ut;
        Calibration { w: matrix_rows(&after), b_ut: b_ut.into(), ..self.calibration }
    }
}

#[test]
fn jacobian_equals_numerical_derivatives() {
    let mut random = Random(2);
    for _ in 0..20 {
        let case = Case::random(&mut random);
        let tilt = case.attitude.tilt_rotation();
        let total_ut = case.calibration.total_ut;
        let level = tilt.to_level_frame(case.calibration.calibrated_field(case.reading)).ut / total_ut;
        let x = (case.reading.ut - case.calibration.b_vector_ut()) / total_ut;
        let row = coefficient_jacobian_row(&heading_derivative_by_field(&tilt, &level), &x);
        let reference_rad = case.heading_rad(&case.calibration);
        for i in 0..COEFFICIENT_COUNT {
            let direction = Vector12::ith(i, 1.0);
            let turned =
                |step| wrap_pi(case.heading_rad(&case.perturbed_calibration(&direction, step)) - reference_rad);
            assert_derivative(row[i], turned, &format!("heading by coefficient {i}"));
        }
    }
}

#[test]
fn sigma_equals_the_effect_of_noise() {
    let mut random = Random(4);
    for _ in 0..20 {
        let case = Case::random(&mut random);
        let reference_rad = case.heading_rad(&case.calibration);
        let total_ut = case.calibration.total_ut;
        let by_reading = |axis: usize| {
            numerical_derivative(|step| {
                let reading = case.reading.ut + Vector3::ith(axis, step * total_ut);
                let level = case.attitude.to_level_frame(case.calibration.calibrated_field(Field::new(reading)));
                wrap_pi(level.heading_rad() - reference_rad)
            })
        };
        let by_attitude = |roll: f32, pitch: f32| {
            numerical_derivative(|step| {
                let RollPitch { roll_rad, pitch_rad } = case.attitude;
                let attitude = RollPitch { roll_rad: roll_rad + roll * step, pitch_rad: pitch_rad + pitch * step };
                wrap_pi(
                    attitude.to_level_frame(case.calibration.calibrated_field(case.reading)).heading_rad()
                        - reference_rad,
                )
            })
        };
        let sensor = (0..3).map(by_reading).map(|d| d * d).sum::<f32>().sqrt();
        let attitude = by_attitude(1.0, 0.0).hypot(by_attitude(0.0, 1.0));
        for (relative_sensor_sigma, attitude_sigma_rad) in [(0.01, 0.0), (0.0, 0.01), (0.003, 0.004)] {
            let uncertainty =
                HeadingUncertainty { relative_sensor_sigma, attitude_sigma_rad, ..HeadingUncertainty::NO_UNCERTAINTY };
            let (found, expected) =
                (case.sigma_rad(&uncertainty), (sensor * relative_sensor_sigma).hypot(attitude * attitude_sigma_rad));
            assert!((found / expected - 1.0).abs() < 2e-3, "{found} {expected}");
        }
    }
}

#[test]
fn next_to_a_pole_sigma_is_finite() {
    let calibration = Calibration { total_ut: 50.0, ..Calibration::uncalibrated(Orientation::IDENTITY_ROTATION) };
    let uncertainty = HeadingUncertainty {
        relative_sensor_sigma: 0.01,
        attitude_sigma_rad: 0.01,
        ..HeadingUncertainty::NO_UNCERTAINTY
    };
    let sensor = Field::from_ut(0.0, 0.0, 50.0);
    let tilt = RollPitch::default().tilt_rotation();
    let sigma_rad = uncertainty
        .heading_variance(&calibration, sensor, &tilt, tilt.to_level_frame(calibration.calibrated_field(sensor)))
        .sigma_rad();
    assert!(sigma_rad.is_finite() && sigma_rad > 3.0, "{sigma_rad}");
}

#[test]
fn every_number_must_be_finite() {
    assert!(HeadingUncertainty::NO_UNCERTAINTY.is_finite());
    for bad in [f32::NAN, f32::INFINITY] {
        let mut all = [HeadingUncertainty::NO_UNCERTAINTY; 4];
        all[0].relative_sensor_sigma = bad;
        all[1].attitude_sigma_rad = bad;
        all[2].reduced_covariance[0][0] = bad;
        all[3].reduced_covariance[5][9] = bad;
        assert!(all.iter().all(|uncertainty| !uncertainty.is_finite()));
    }
    let mut covariance = CoefficientCovariance::ZERO;
    covariance.set_lower_triangle(|_, _| 1.0);
    assert!(covariance.is_finite());
    covariance.set_lower_triangle(|i, j| if (i, j) == (11, 11) { f32::NAN } else { 1.0 });
    assert!(!covariance.is_finite());
}

#[test]
fn a_variance_is_never_negative() {
    let mut covariance = CoefficientCovariance::ZERO;
    covariance.set_lower_triangle(|i, j| if i == j { -1.0 } else { 0.0 });
    assert_eq!(covariance.variance(&Vector12::ith(3, 1.0)).to_bits(), 0);
    let uncertainty = HeadingUncertainty::from_covariance(&covariance, 0.0, 0.0);
    assert_eq!(uncertainty.variance_from_coefficients(&Vector3::x(), &Vector3::y()).to_bits(), 0);
}
