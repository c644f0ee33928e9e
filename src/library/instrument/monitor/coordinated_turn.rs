//! Coordinated-turn pseudo-measurement: the pitch rate in a turn observes roll errors without the magnetometer.
//!
//! Body rates give `theta' = q cos(phi) - r sin(phi)` with the reported roll. A roll that is too large by `e` adds
//! `-psi' cos(theta) e` to it, so that the integral deviates from the reported pitch. Over a window of 2 s in a turn
//! the deviation measures `a_r + k phi`.

use super::super::gyro_error::{GYRO_ERROR_COUNT, GyroErrors};
use super::super::ud_filter::Measurement;
use super::measurement_model::{
    BANK_SCALE_ERROR_INDEX, FIRST_GYRO_ERROR_INDEX, ROLL_BIAS_INDEX, STATE_COUNT, StateVector,
};
use crate::attitude::EulerRates;
use crate::frames::RollPitch;

/// Integration window, seconds: long against the noise of pitch, short against a turn.
const WINDOW_S: f32 = 2.0;

/// Measurement variance, (rad/s)^2: attitude noise at both ends of the window.
const PITCH_RATE_VARIANCE_RAD2_S2: f32 = 0.006 * 0.006;

#[derive(Clone, Copy, Debug)]
pub(super) struct CoordinatedTurn {
    start_pitch_rad: Option<f32>,
    duration_s: f32,
    /// Rate at the last sample.
    pitch_rate_rad_s: f32,
    pitch_change_rad: f32,
    heading_change_rad: f32,
    roll_integral_rad_times_s: f32,
    /// Derivatives of the pitch change by the gyro's errors.
    gyro_error_row: GyroErrors,
}

impl CoordinatedTurn {
    pub const EMPTY: Self = Self {
        start_pitch_rad: None,
        duration_s: 0.0,
        pitch_rate_rad_s: 0.0,
        pitch_change_rad: 0.0,
        heading_change_rad: 0.0,
        roll_integral_rad_times_s: 0.0,
        gyro_error_row: [0.0; GYRO_ERROR_COUNT],
    };

    /// Integrates a sample `step_s` after the last; returns a measurement at the end of each window.
    pub fn integrate(
        &mut self,
        reported: RollPitch,
        euler_rates: &EulerRates,
        gyro_error_row: &GyroErrors,
        step_s: f32,
        unknowns: &StateVector,
    ) -> Option<Measurement<STATE_COUNT>> {
        // Pitch and its rate are means of a sample's readings, so that the trapezoid rule is exact to second order.
        let last_pitch_rate_rad_s = core::mem::replace(&mut self.pitch_rate_rad_s, euler_rates.pitch_rad_s);
        let Some(from_pitch_rad) = self.start_pitch_rad else {
            self.start_pitch_rad = Some(reported.pitch_rad);
            return None;
        };
        self.duration_s += step_s;
        self.pitch_change_rad += last_pitch_rate_rad_s.midpoint(euler_rates.pitch_rad_s) * step_s;
        self.heading_change_rad += euler_rates.heading_rad_s * step_s;
        self.roll_integral_rad_times_s += reported.roll_rad * step_s;
        for (sum, d) in self.gyro_error_row.iter_mut().zip(gyro_error_row) {
            *sum += d * step_s;
        }
        if self.duration_s < WINDOW_S {
            return None;
        }
        let (heading_rad_s, roll_rad) =
            (self.heading_change_rad / self.duration_s, self.roll_integral_rad_times_s / self.duration_s);
        let unbalanced = (self.pitch_change_rad - (reported.pitch_rad - from_pitch_rad)) / self.duration_s;
        let mut row = [0.0; STATE_COUNT];
        for (d, sum) in row.iter_mut().skip(FIRST_GYRO_ERROR_INDEX).zip(self.gyro_error_row) {
            *d = sum / self.duration_s;
        }
        let (start_pitch_rad, pitch_rate_rad_s) = (Some(reported.pitch_rad), euler_rates.pitch_rad_s);
        *self = Self { start_pitch_rad, pitch_rate_rad_s, ..Self::EMPTY };
        row[ROLL_BIAS_INDEX] = -heading_rad_s;
        row[BANK_SCALE_ERROR_INDEX] = -heading_rad_s * roll_rad;
        let predicted = row.iter().zip(unknowns).map(|(d, x)| d * x).sum::<f32>();
        Some(Measurement { jacobian: row, residual: unbalanced - predicted, variance: PITCH_RATE_VARIANCE_RAD2_S2 })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::attitude::BodyRates;

    const NO_GYRO_ERRORS: GyroErrors = [0.0; GYRO_ERROR_COUNT];

    /// Number of samples at 10 Hz until the first measurement, and the measurement.
    fn measure(
        turn: &mut CoordinatedTurn,
        mut attitude_at: impl FnMut() -> RollPitch,
        euler_rates: EulerRates,
        gyro_error_row: &GyroErrors,
        unknowns: &StateVector,
    ) -> (usize, Measurement<STATE_COUNT>) {
        (1..40)
            .find_map(|i| Some((i, turn.integrate(attitude_at(), &euler_rates, gyro_error_row, 0.1, unknowns)?)))
            .unwrap()
    }

    /// Residual of a level turn at 45 deg bank and 0.3 rad/s with roll bias and bank-angle scale error.
    fn turn_residual(bias_rad: f32, bank_scale_error: f32, unknowns: &StateVector) -> f32 {
        let (roll_rad, heading_rad_s) = (0.8_f32, 0.3);
        let reported = RollPitch { roll_rad: roll_rad * (1.0 + bank_scale_error) + bias_rad, pitch_rad: 0.0 };
        let rates_rad_s = [0.0, heading_rad_s * roll_rad.sin(), heading_rad_s * roll_rad.cos()];
        let euler_rates = EulerRates::from_body_rates(BodyRates::from_rad_s(rates_rad_s).unwrap(), reported);
        let mut turn = CoordinatedTurn::EMPTY;
        measure(&mut turn, || reported, euler_rates, &NO_GYRO_ERRORS, unknowns).1.residual
    }

    /// Bias: 0.02 rad * 0.3 rad/s = 6 mrad/s; scale error: 0.1 * 0.8 rad * 0.3 rad/s = 24 mrad/s. Estimated errors
    /// leave no residual.
    #[test]
    fn a_bank_error_appears_in_the_pitch_rate_residual() {
        let estimated = |index: usize, value: f32| {
            let mut unknowns = [0.0; STATE_COUNT];
            unknowns[index] = value;
            unknowns
        };
        let nothing = [0.0; STATE_COUNT];
        for (bias_rad, bank_scale_error, unknowns, expected) in [
            (0.0, 0.0, nothing, 0.0),
            (0.02, 0.0, nothing, -0.006),
            (0.0, 0.1, nothing, -0.024),
            (0.02, 0.0, estimated(ROLL_BIAS_INDEX, 0.02), 0.0),
            (0.0, 0.1, estimated(BANK_SCALE_ERROR_INDEX, 0.1 / 1.1), 0.0),
        ] {
            let residual = turn_residual(bias_rad, bank_scale_error, &unknowns);
            assert!((residual - expected).abs() < 3e-4, "{bias_rad} {bank_scale_error}: {residual}");
        }
    }

    #[test]
    fn pitch_motion_explained_by_rates_has_no_residual() {
        let euler_rates = EulerRates { pitch_rad_s: 0.05, heading_rad_s: 0.2, roll_rad_s: 0.0 };
        let mut turn = CoordinatedTurn::EMPTY;
        let mut pitch_rad = 0.0;
        let [first_samples, next_samples] = ["first", "next"].map(|window| {
            let attitude_at = || {
                pitch_rad += 0.05 * 0.1;
                RollPitch { roll_rad: 0.3, pitch_rad }
            };
            let (samples, found) = measure(&mut turn, attitude_at, euler_rates, &NO_GYRO_ERRORS, &[0.0; STATE_COUNT]);
            assert!(found.residual.abs() < 1e-5, "{window}: {found:?}");
            samples
        });
        // Two seconds; a window starts at the end of the last one.
        assert!((21..=22).contains(&first_samples) && next_samples == first_samples - 1, "{next_samples}");
    }

    /// The Jacobian has the mean of the gyro's rows, and the derivatives by bank of a level turn.
    #[test]
    fn the_jacobian_is_the_mean_over_the_window() {
        let euler_rates = EulerRates { heading_rad_s: 0.3, ..EulerRates::default() };
        let reported = RollPitch { roll_rad: 0.8, pitch_rad: 0.0 };
        let gyro_error_row: GyroErrors = core::array::from_fn(|i| 0.1 * i as f32 - 0.3);
        let mut turn = CoordinatedTurn::EMPTY;
        let found = measure(&mut turn, || reported, euler_rates, &gyro_error_row, &[0.0; STATE_COUNT]).1.jacobian;
        let mut expected = [0.0; STATE_COUNT];
        expected[FIRST_GYRO_ERROR_INDEX..].copy_from_slice(&gyro_error_row);
        (expected[ROLL_BIAS_INDEX], expected[BANK_SCALE_ERROR_INDEX]) = (-0.3, -0.24);
        assert!(found.iter().zip(expected).all(|(d, expected)| (d - expected).abs() < 1e-5), "{found:?}");
    }
}
