//! Errors of the gyro as they act on the rates of heading and pitch.
//!
//! The measured body rates are `(I + M) w + b`, with the true rates `w` and the offsets `b`. The diagonal of `M` has
//! the scale errors, its other elements the cross-axis sensitivities. In `theta' = q cos(phi) - r sin(phi)` and
//! `psi' = (q sin(phi) + r cos(phi)) / cos(theta)` only the rows of y and z appear: eight numbers.

use crate::attitude::{EulerRates, MIN_COS_PITCH};
use crate::frames::RollPitch;
use crate::trig::{self, square};

/// Gyro errors: offset `b_y`, rad/s, and the row of y in `M`, then offset `b_z` and the row of z.
pub(super) type GyroErrors = [f32; GYRO_ERROR_COUNT];

pub(super) const GYRO_ERROR_COUNT: usize = 8;

/// Derivatives of the measured rates of heading and pitch by the errors.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct GyroErrorRows {
    pub heading_row: GyroErrors,
    pub pitch_row: GyroErrors,
    /// Square of the heading rate by errors of roll and pitch, `(theta'^2 + (psi' sin(theta))^2) / cos(theta)^2`, rad^2/s^2.
    pub heading_by_tilt_squared: f32,
}

impl GyroErrorRows {
    pub fn new(attitude: RollPitch, euler_rates: &EulerRates) -> Self {
        let (sin_roll, cos_roll) = trig::sin_cos(attitude.roll_rad);
        let (sin_pitch, cos_pitch) = trig::sin_cos(attitude.pitch_rad);
        let [p, q, r] = euler_rates.to_body_rates(attitude);
        let axis_derivatives = [1.0, p, q, r];
        let per_cos_pitch = 1.0 / cos_pitch.max(MIN_COS_PITCH);
        Self {
            heading_row: gyro_error_row(&axis_derivatives, sin_roll * per_cos_pitch, cos_roll * per_cos_pitch),
            pitch_row: gyro_error_row(&axis_derivatives, cos_roll, -sin_roll),
            heading_by_tilt_squared: square(per_cos_pitch)
                * (square(euler_rates.pitch_rad_s) + square(euler_rates.heading_rad_s * sin_pitch)),
        }
    }
}

/// Derivatives by the gyro errors: those of the y axis multiplied by `y_factor`, those of the z axis by `z_factor`.
fn gyro_error_row(axis_derivatives: &[f32; 4], y_factor: f32, z_factor: f32) -> GyroErrors {
    core::array::from_fn(|i| axis_derivatives[i % 4] * if i < 4 { y_factor } else { z_factor })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::attitude::BodyRates;

    fn euler_rates(attitude: RollPitch, rates_rad_s: [f32; 3]) -> EulerRates {
        EulerRates::from_body_rates(BodyRates::from_rad_s(rates_rad_s).unwrap(), attitude)
    }

    /// By the model of the module's documentation: measured rates `(I + M) w + b`.
    #[test]
    fn rows_are_the_derivatives_of_the_measured_rates() {
        let attitude = RollPitch::from_deg(35.0, -12.0);
        let rates = [0.3, -0.1, 0.25];
        let exact = euler_rates(attitude, rates);
        let rows = GyroErrorRows::new(attitude, &exact);
        for i in 0..GYRO_ERROR_COUNT {
            let (axis, error) = (1 + i / 4, 1e-2);
            let mut measured = rates;
            measured[axis] += error * if i % 4 == 0 { 1.0 } else { rates[i % 4 - 1] };
            let found = euler_rates(attitude, measured);
            let heading = (found.heading_rad_s - exact.heading_rad_s) / error;
            let pitch = (found.pitch_rad_s - exact.pitch_rad_s) / error;
            assert!((rows.heading_row[i] - heading).abs() < 1e-4, "{i}: {} {heading}", rows.heading_row[i]);
            assert!((rows.pitch_row[i] - pitch).abs() < 1e-4, "{i}: {} {pitch}", rows.pitch_row[i]);
        }
    }
}
