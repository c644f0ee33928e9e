//! The twelve deviation coefficients and their application.

use nalgebra::{Matrix3, Vector3};

use super::motor_current::MotorCurrentInterference;
use super::orientation::Orientation;
use super::samples::Sample;
use crate::calibration::linear_algebra::matrix::matrix_rows;
use crate::frames::{Body, Field, Level, Sensor};
use crate::trig;

/// The twelve deviation coefficients and the Earth field of the fit.
///
/// Liu 2007 eq. 8 solved for the field: `h_body = W (m - b)`, `W = A^-1`.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Calibration {
    /// `W`, row-major, dimensionless, determinant 1: maps the field minus hard iron from chip axes to the body frame.
    /// Contains soft iron, scale, non-orthogonality and mounting.
    pub w: [[f32; 3]; 3],
    /// `b`, microtesla, chip axes: hard iron and zero offset at zero motor current.
    pub b_ut: [f32; 3],
    /// Inclination of the Earth field of the fit, radians, positive down.
    pub inclination_rad: f32,
    /// Strength of the corrected field in the scale of `w`, microtesla.
    pub total_ut: f32,
    /// Attitude latency beyond the nominal latency of the attitude source, seconds; 0 if not applied.
    pub latency_s: f32,
    /// Motor-current interference in the measured field.
    pub motor_current: MotorCurrentInterference,
}

impl Calibration {
    /// Calibration with the mounting only: no hard iron, no soft iron.
    #[must_use]
    pub fn uncalibrated(mount: Orientation) -> Self {
        let rotation = mount.body_from_sensor();
        Self {
            w: matrix_rows(&rotation),
            b_ut: [0.0; 3],
            inclination_rad: 0.0,
            total_ut: 0.0,
            latency_s: 0.0,
            motor_current: MotorCurrentInterference::NO_INTERFERENCE,
        }
    }

    /// `W` as a matrix.
    #[must_use]
    pub fn w_matrix(&self) -> Matrix3<f32> {
        Matrix3::from_fn(|row, column| self.w[row][column])
    }

    /// `b` as a vector, microtesla.
    #[must_use]
    pub fn b_vector_ut(&self) -> Vector3<f32> {
        Vector3::from(self.b_ut)
    }

    /// Corrected field in the body frame, `W (m - b)` (Liu 2007 eq. 8), microtesla. The motor-current interference must
    /// already be removed.
    #[must_use]
    #[inline]
    pub fn calibrated_field(&self, sensor: Field<Sensor>) -> Field<Body> {
        let from_b = sensor.ut - self.b_vector_ut();
        // Scalar expressions: on a Cortex-M4 they compile to straight-line code.
        let [x, y, z] = self.w.map(|[wx, wy, wz]| wx * from_b.x + wy * from_b.y + wz * from_b.z);
        Field::from_ut(x, y, z)
    }

    /// Corrected field of a sample in the level frame, microtesla, with attitude latency and motor current compensated.
    #[must_use]
    pub fn corrected_level_field(&self, sample: &Sample) -> Field<Level> {
        sample.latency_compensated_attitude(self.latency_s).to_level_frame(self.corrected_body_field(sample))
    }

    /// Whether all coefficients are finite: check for data from flash or from a solver.
    #[must_use]
    pub fn is_finite(&self) -> bool {
        self.w.as_flattened().iter().chain(&self.b_ut).all(|component| component.is_finite())
            && [self.inclination_rad, self.total_ut, self.latency_s].iter().all(|number| number.is_finite())
            && self.motor_current.is_finite()
    }

    /// Whether an attitude latency is applied.
    #[must_use]
    pub fn uses_latency(&self) -> bool {
        self.latency_s != 0.0
    }

    /// Field without motor-current interference, chip axes.
    #[must_use]
    #[inline]
    pub fn remove_motor_current(&self, field: Field<Sensor>, current_a: Option<f32>) -> Field<Sensor> {
        Field::new(field.ut - self.motor_current.interference_ut(current_a))
    }

    /// Heading variance, square radians, from unknown current or interference beyond the covariance of the
    /// coefficients, on one axis of the horizontal field.
    #[must_use]
    pub fn motor_current_heading_variance_rad2(&self, current_a: Option<f32>) -> f32 {
        let horizontal_ut = self.total_ut * trig::sin_cos(self.inclination_rad).1;
        let variance_ut2 = self.motor_current.variance_beyond_covariance_ut2(current_a);
        if variance_ut2 > 0.0 { variance_ut2 / (horizontal_ut * horizontal_ut) } else { 0.0 }
    }

    /// Corrected field of a sample in the body frame, microtesla, without motor-current interference.
    #[must_use]
    #[inline]
    pub fn corrected_body_field(&self, sample: &Sample) -> Field<Body> {
        self.calibrated_field(self.remove_motor_current(sample.field, sample.current.amperes()))
    }
}
