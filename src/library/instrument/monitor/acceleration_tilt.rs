//! Acceleration-induced tilt error of the attitude.
//!
//! Attitude sources use accelerometers, which cannot distinguish acceleration from tilt. A multirotor raises its nose
//! to brake and lowers it to accelerate, so a pitch excursion predicts a worse attitude than during the calibration,
//! before the gates detect it. Bank does not: an aeroplane banks in coordinated turns, without sideways acceleration.
//!
//! Reported pitch and integrated pitch rate must both show the excursion: a jump of the attitude alone is an error, and
//! rates projected with a wrong bank integrate to arbitrary angles.

use crate::attitude::EulerRates;
use crate::frames::Attitude;

/// Tilt error per pitch excursion. A multirotor that brakes by tilt and drag decelerates by about `2 g` times the
/// excursion; attitude sources err by 0.4 deg per m/s^2, which makes 0.15.
const TILT_ERROR_PER_EXCURSION: f32 = 0.15;

/// Upper limit of the tilt error, radians. Larger pitch is a steep climb, not braking; on a recorded flight with 90 deg
/// bank, a higher limit only weakened the heading measurement.
const MAX_TILT_ERROR_RAD: f32 = 0.015;

/// Time constant of the pitch average, seconds; a sustained climb is not an excursion.
const AVERAGING_TIME_S: f32 = 20.0;

#[expect(clippy::struct_field_names, reason = "the unit")]
#[derive(Clone, Copy, Debug)]
pub(super) struct AccelerationTilt {
    last_pitch_rad: Option<f32>,
    /// Excursion by reported pitch and by integrated pitch rate, radians.
    reported_pitch_excursion_rad: f32,
    integrated_pitch_excursion_rad: f32,
}

impl AccelerationTilt {
    pub const INITIAL: Self =
        Self { last_pitch_rad: None, reported_pitch_excursion_rad: 0.0, integrated_pitch_excursion_rad: 0.0 };

    pub fn update_tilt(&mut self, Attitude { pitch_rad, .. }: Attitude, euler_rates: &EulerRates, step_s: f32) {
        let last_rad = self.last_pitch_rad.replace(pitch_rad).unwrap_or(pitch_rad);
        let decay = (1.0 - step_s / AVERAGING_TIME_S).max(0.0);
        self.reported_pitch_excursion_rad = decay * (self.reported_pitch_excursion_rad + pitch_rad - last_rad);
        self.integrated_pitch_excursion_rad =
            decay * (self.integrated_pitch_excursion_rad + euler_rates.pitch_rad_s * step_s);
    }

    /// Variance of the tilt error about each horizontal axis, square radians.
    pub fn variance_rad2(&self) -> f32 {
        let off_rad = (TILT_ERROR_PER_EXCURSION
            * self.reported_pitch_excursion_rad.abs().min(self.integrated_pitch_excursion_rad.abs()))
        .min(MAX_TILT_ERROR_RAD);
        off_rad * off_rad
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Tilt error after a minute of level flight and a pitch excursion within 0.5 s, by reported pitch and by rates,
    /// held until `seconds`.
    fn tilt_error_rad(reported_rad: f32, by_rates_rad: f32, seconds: u16) -> f32 {
        let mut tilt = AccelerationTilt::INITIAL;
        let mut see = |pitch_rad: f32, pitch_rad_s: f32| {
            let motion = EulerRates { pitch_rad_s, ..EulerRates::default() };
            tilt.update_tilt(Attitude { roll_rad: 0.3, pitch_rad }, &motion, 0.1);
        };
        for _ in 0..600 {
            see(0.05, 0.0);
        }
        for i in 1..=10 * seconds {
            let part = f32::from(i.min(5)) / 5.0;
            see(0.05 + part * reported_rad, if i <= 5 { 2.0 * by_rates_rad } else { 0.0 });
        }
        libm::sqrtf(tilt.variance_rad2())
    }

    /// 0.15 times the excursion, less its decay within a second.
    #[test]
    fn pitch_motion_adds_acceleration_induced_tilt_error() {
        for side in [1.0, -1.0] {
            let found = tilt_error_rad(0.08 * side, 0.08 * side, 1);
            assert!((found - 0.012).abs() < 0.000_6, "{found}");
        }
        assert!((tilt_error_rad(0.08, 0.04, 1) - 0.006).abs() < 0.000_4);
        assert!((tilt_error_rad(0.04, -0.08, 1) - 0.006).abs() < 0.000_4);
        assert!((tilt_error_rad(0.5, 0.5, 1) - 0.015).abs() < 1e-6 && tilt_error_rad(0.095, 0.095, 1) < 0.014_5);
    }

    /// Cases: a jump of pitch, a pitch rate without a change of pitch, a roll.
    #[test]
    fn attitude_or_rate_change_alone_adds_no_tilt_error() {
        assert!(tilt_error_rad(0.14, 0.0, 1) < 1e-6 && tilt_error_rad(0.0, 0.14, 1) < 1e-6);
        let mut tilt = AccelerationTilt::INITIAL;
        for i in 0..10_u8 {
            let motion = EulerRates { roll_rad_s: 0.5, heading_rad_s: 0.3, ..EulerRates::default() };
            tilt.update_tilt(Attitude { roll_rad: 0.05 * f32::from(i), pitch_rad: 0.1 }, &motion, 0.1);
        }
        assert!(tilt.variance_rad2() < 1e-12);
    }

    /// Time constant 20 s; complete decay in a longer gap.
    #[test]
    fn tilt_error_decays_in_a_steady_climb() {
        let found = tilt_error_rad(0.08, 0.08, 20) / 0.012;
        assert!((found - 0.372).abs() < 0.02, "{found}");
        let mut tilt = AccelerationTilt::INITIAL;
        for (pitch_rad, step_s) in [(0.0, 0.1), (0.3, 25.0)] {
            tilt.update_tilt(
                Attitude { roll_rad: 0.0, pitch_rad },
                &EulerRates { pitch_rad_s: 0.01, ..EulerRates::default() },
                step_s,
            );
        }
        assert!(tilt.variance_rad2() < 1e-12);
    }
}
