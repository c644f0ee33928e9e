//! The autopilot's correction of the field, and its inverse.

use nalgebra::{Matrix3, Vector3};

use super::compass_slot::{ardupilot_index, ardupilot_vector};
use super::mounting::px4_mounting;
use super::parameters::ParameterHistory;
use crate::numbers::{UT_PER_GAUSS, UT_PER_MILLIGAUSS};

/// Correction of hard iron, soft iron and motor current, body axes: `corrected = matrix (raw - hard_iron - motor I)`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FieldCorrection {
    /// Matrix that corrects soft iron and scale.
    pub matrix: Matrix3<f64>,
    /// Hard iron in the raw field, microtesla.
    pub hard_iron_ut: Vector3<f64>,
    /// Motor-current interference in the raw field, uT/A.
    pub motor_ut_per_a: Vector3<f64>,
}

impl FieldCorrection {
    /// Correction without effect.
    #[must_use]
    pub fn identity() -> Self {
        Self::without_current(Matrix3::identity(), Vector3::zeros())
    }

    /// A correction without motor-current interference.
    #[must_use]
    pub fn without_current(matrix: Matrix3<f64>, hard_iron_ut: Vector3<f64>) -> Self {
        Self { matrix, hard_iron_ut, motor_ut_per_a: Vector3::zeros() }
    }

    /// The corrected field, microtesla, of a raw field measured at a current in amperes.
    #[must_use]
    pub fn correct_field(&self, raw_ut: Vector3<f64>, current_a: f64) -> Vector3<f64> {
        self.matrix * (raw_ut - self.hard_iron_ut - self.motor_ut_per_a * current_a)
    }

    /// ArduPilot's last correction by the parameters of a slot, without throttle compensation.
    #[must_use]
    pub fn from_ardupilot(parameters: &ParameterHistory, slot: u8) -> Self {
        InvertibleCorrection::from_ardupilot_parameters(parameters, f64::INFINITY, slot).correction
    }

    /// PX4's last correction by the parameters `CAL_MAGn` of an index.
    #[must_use]
    pub fn from_px4(parameters: &ParameterHistory, index: u8) -> Self {
        InvertibleCorrection::from_px4_parameters(parameters, f64::INFINITY, index).correction
    }
}

/// Correction at one time with its inverse.
#[derive(Clone, Copy, Debug)]
pub(super) struct InvertibleCorrection {
    pub correction: FieldCorrection,
    inverse: Matrix3<f64>,
}

impl InvertibleCorrection {
    /// Correction without effect.
    pub fn identity() -> Self {
        Self { correction: FieldCorrection::identity(), inverse: Matrix3::identity() }
    }

    /// Recovers the raw field from a logged field, which contains `motor_compensation_ut`.
    pub fn raw_ut(&self, logged_ut: Vector3<f64>, motor_compensation_ut: Vector3<f64>) -> Vector3<f64> {
        self.inverse * (logged_ut - motor_compensation_ut) + self.correction.hard_iron_ut
    }

    /// Motor-current compensation in a logged field, microtesla.
    pub fn motor_compensation_ut(&self, current_a: f64) -> Vector3<f64> {
        self.correction.matrix * self.correction.motor_ut_per_a * -current_a
    }

    /// Inverse of a correction after which the autopilot adds a motor-current compensation, uT/A.
    fn from_correction(correction: FieldCorrection, compensation_ut_per_a: Vector3<f64>) -> Self {
        match correction.matrix.try_inverse() {
            Some(inverse) if inverse.iter().all(|number| number.is_finite()) => {
                let motor_ut_per_a = correction.motor_ut_per_a - inverse * compensation_ut_per_a;
                Self { correction: FieldCorrection { motor_ut_per_a, ..correction }, inverse }
            }
            // A singular correction matrix has no inverse; the logged field is then used unchanged.
            _ => Self::identity(),
        }
    }

    /// ArduPilot's correction by the parameters of a slot at a time: `f = M ((raw + OFS) SCALE)`, then motor-current compensation
    /// (`AP_Compass_Backend::correct_field`). As in ArduPilot, a scale outside 1/1.5 to 1.5 and diagonals of zero mean
    /// one.
    pub fn from_ardupilot_parameters(parameters: &ParameterHistory, t_s: f64, slot: u8) -> Self {
        let index = ardupilot_index(slot);
        let value = |name: &str| parameters.value_at(t_s, name);
        let vector = |parameter_part: &str| {
            Vector3::from(ardupilot_vector(parameter_part, slot).map(|name| value(&name).unwrap_or(0.0)))
        };
        let scale =
            value(&format!("COMPASS_SCALE{index}")).filter(|scale| (1.0 / 1.5..=1.5).contains(scale)).unwrap_or(1.0);
        let off_diagonal = vector("ODI");
        let diagonal = ardupilot_vector("DIA", slot).map(|name| value(&name));
        let soft_iron = if diagonal.iter().flatten().all(|axis| *axis == 0.0) {
            Matrix3::identity()
        } else {
            // A telemetry link may lose one of three related parameters, which is then assumed to have its default.
            symmetric_matrix(&Vector3::from(diagonal.map(|axis| axis.unwrap_or(1.0))), &off_diagonal)
        };
        let is_by_current =
            value("COMPASS_MOTCT").is_some_and(|compensation_type| compensation_type.round() as i32 == 2);
        let compensation_ut_per_a = if is_by_current { vector("MOT") * UT_PER_MILLIGAUSS } else { Vector3::zeros() };
        Self::from_correction(
            FieldCorrection::without_current(soft_iron * scale, -vector("OFS") * UT_PER_MILLIGAUSS),
            compensation_ut_per_a,
        )
    }

    /// PX4's correction by its parameters: `scale (raw + current COMP - offset)` in sensor axes, then turned to body
    /// axes (`calibration::Magnetometer::Correct`). `COMP` is in gauss per kiloampere, and of a battery if
    /// `CAL_MAG_COMP_TYP` is 2 or 3. `index` is that of `CAL_MAGn`.
    pub fn from_px4_parameters(parameters: &ParameterHistory, t_s: f64, index: u8) -> Self {
        let value = |name: &str| parameters.value_at(t_s, &format!("CAL_MAG{index}_{name}"));
        let vector = |parameter_part: &str, default: f64| {
            let [x, y, z] = ["X", "Y", "Z"].map(|axis| value(&format!("{axis}{parameter_part}")).unwrap_or(default));
            Vector3::new(x, y, z)
        };
        let mut diagonal = vector("SCALE", 1.0);
        if diagonal.iter().any(|scale| *scale < 1e-3) {
            diagonal = Vector3::repeat(1.0);
        }
        let body_from_sensor = px4_mounting(parameters, t_s, index);
        let scale =
            body_from_sensor * symmetric_matrix(&diagonal, &vector("ODIAG", 0.0)) * body_from_sensor.transpose();
        let is_by_current = parameters
            .value_at(t_s, "CAL_MAG_COMP_TYP")
            .is_some_and(|compensation_type| [2, 3].contains(&(compensation_type.round() as i32)));
        let compensation = if is_by_current { vector("COMP", 0.0) } else { Vector3::zeros() };
        let motor_ut_per_a = body_from_sensor * compensation * -UT_PER_GAUSS / 1000.0;
        let sensor_correction = FieldCorrection {
            motor_ut_per_a,
            ..FieldCorrection::without_current(scale, body_from_sensor * vector("OFF", 0.0) * UT_PER_GAUSS)
        };
        Self::from_correction(sensor_correction, Vector3::zeros())
    }
}

/// Symmetric matrix from its diagonal and its xy, xz and yz elements.
pub(crate) fn symmetric_matrix(diagonal: &Vector3<f64>, off_diagonal: &Vector3<f64>) -> Matrix3<f64> {
    let ([xx, yy, zz], [xy, xz, yz]): ([f64; 3], [f64; 3]) = ((*diagonal).into(), (*off_diagonal).into());
    Matrix3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz)
}

#[cfg(test)]
mod tests;
