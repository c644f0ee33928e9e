//! Magnetic hysteresis of the soft iron: its field lags in turns, and keeps the lag of the last turn in the straight
//! flight after it.
//!
//! Soft iron that lags by a small angle has the field of an earlier heading. With `S` the response of the soft iron
//! alone and `dh` the change of the field in body axes by a turn of one radian, the measurement has an additional `-lag
//! S dh`. The unknown is the lag angle `lag`, radians.

use nalgebra::{Matrix3, Vector3};

use crate::calibration::linear_algebra::{inverse, multiply};
use crate::calibration::model::{ModelParameters, SampleEquations};
use crate::calibration::types::samples::Sample;
use crate::trig::sqrt;

/// Heading rate above which an aircraft is in a turn, rad/s: 3 deg/s.
const MIN_TURN_RATE_RAD_S: f32 = 0.05;

/// Bank above which an aircraft without rates is in a turn, radians: 8 deg.
const MIN_TURN_BANK_RAD: f32 = 0.14;

/// Iterations of the polar decomposition, which converges quadratically.
const POLAR_DECOMPOSITION_ITERATIONS: u8 = 5;

/// Direction of the last turn: 1 right, -1 left, 0 before the first.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct LastTurn(f32);

impl LastTurn {
    /// Updates with the next sample; returns the direction of the last turn at this sample: 1 right, -1 left.
    pub fn direction_at_sample(&mut self, sample: &Sample) -> f32 {
        let (rate, bank) = (sample.rates.heading_rad_s(), sample.attitude.roll_rad);
        if rate.abs() > MIN_TURN_RATE_RAD_S {
            self.0 = 1_f32.copysign(rate);
        } else if !sample.rates.is_known() && bank.abs() > MIN_TURN_BANK_RAD {
            self.0 = 1_f32.copysign(bank);
        }
        self.0
    }
}

/// Response of the corrected field to the soft iron's lag.
#[derive(Clone, Debug)]
pub(super) struct Hysteresis {
    /// Response of the corrected field to the soft iron alone, `W S`.
    soft_iron_response: Matrix3<f32>,
    w: Matrix3<f32>,
    corrected_mean_field: Vector3<f32>,
    cos_inclination: f32,
}

impl Hysteresis {
    /// `S` is the response `W^-1` less its rotation, the mounting, of equal volume. `None` if `W` is singular.
    pub fn new(parameters: &ModelParameters) -> Option<Self> {
        let response = inverse(&parameters.w)?;
        let mut mounting = response;
        for _ in 0..POLAR_DECOMPOSITION_ITERATIONS {
            mounting = (mounting + inverse(&mounting)?.transpose()) * 0.5;
        }
        let scale = libm::cbrtf(response.determinant());
        Some(Self {
            soft_iron_response: Matrix3::identity() - parameters.w * mounting * scale,
            w: parameters.w,
            corrected_mean_field: parameters.corrected_mean_field,
            cos_inclination: libm::cosf(parameters.inclination_rad),
        })
    }

    /// Derivative of the corrected field by the lag angle, after a turn in a direction; down in body axes.
    pub fn field_response(
        &self,
        down: &Vector3<f32>,
        turn_direction: f32,
        equations: &SampleEquations,
    ) -> Vector3<f32> {
        let body = multiply(&self.w, &equations.norm_equation.jacobian_row.centred_field) + self.corrected_mean_field;
        multiply(&self.soft_iron_response, &(down.cross(&body) * turn_direction))
    }

    /// RMS field change by a lag angle, radians, over the headings, units of field.
    pub fn rms_field_change(&self, lag_rad: f32) -> f32 {
        lag_rad.abs() * sqrt(0.5 * self.soft_iron_response.fixed_columns::<2>(0).norm_squared()) * self.cos_inclination
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::calibration::AngleRates;
    use crate::frames::{Field, RollPitch};

    /// The heading rate decides if known, otherwise the bank. Straight flight keeps the direction of the last turn.
    #[test]
    fn the_last_turn_is_shown_by_the_heading_rate_or_the_bank() {
        let rate = |deg_s: f32| AngleRates::from_rad_s([0.0, 0.0, deg_s.to_radians()]);
        for (roll_deg, rates, expected) in [
            (0.0, rate(2.0), 0.0),
            (0.0, rate(5.0), 1.0),
            (0.0, rate(-5.0), -1.0),
            (25.0, rate(2.0), 0.0),
            (25.0, rate(-5.0), -1.0),
            (5.0, AngleRates::UNKNOWN, 0.0),
            (12.0, AngleRates::UNKNOWN, 1.0),
            (-12.0, AngleRates::UNKNOWN, -1.0),
        ] {
            let mut last = LastTurn::default();
            for (roll_deg, rates) in [(roll_deg, rates), (0.0, rate(2.0))] {
                let attitude = RollPitch::from_deg(roll_deg, 0.0);
                let sample = Sample { rates, ..Sample::new(Field::new(Vector3::zeros()), attitude) };
                let found = last.direction_at_sample(&sample);
                assert_eq!(found.to_bits(), f32::to_bits(expected), "{roll_deg} deg, {rates:?}");
            }
        }
    }
}
